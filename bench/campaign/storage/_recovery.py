"""Journal and run folders brought back in agreement, after a kill or when results are to be rerun."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from bench.contracts import Outcome
from bench.errors import Fault, SetupError

from ._completeness import PROVISIONAL_OUTCOMES, accepted_realizations
from ._files import digest_of
from ._firmware_ends import drawn_out_realizations
from ._folder import RESULT, CampaignFolder
from ._journal import Journal, JournalEntry, RealizationState
from ._results import read_result


def parse_rerun_outcomes(names: Collection[str]) -> frozenset[Outcome]:
    """The outcomes with these names. Raises SetupError for each that does not exist or cannot be rerun."""
    wrong = sorted(set(names) - PROVISIONAL_OUTCOMES)
    if wrong:
        remedy = f"give {', '.join(sorted(PROVISIONAL_OUTCOMES))}"
        raise SetupError(
            [Fault("--again", f"results with the outcome {name!s} cannot be rerun", remedy) for name in wrong]
        )
    return frozenset(map(Outcome, names))


def reset_for_rerun(folder: CampaignFolder, journal: Journal, rerun: Collection[Outcome] = ()) -> list[str]:
    """Plan every realization again whose outcome is provisional and not accepted, and return their ids.

    One whose real autopilot failed in flight as often as it may is planned again only if its outcome is in `rerun`. The
    results are kept in aside/.
    """
    accepted, drawn_out = accepted_realizations(journal), drawn_out_realizations(journal)
    reset = []
    for entry in journal.entries():
        if entry.id in drawn_out and entry.outcome not in rerun:
            continue
        if entry.outcome in PROVISIONAL_OUTCOMES and entry.id not in accepted:
            # The file first: after a crash in between, `reconcile` sees that the result is gone and plans it
            # again.
            folder.set_aside(entry.id, entry.attempts)
            journal.forget(entry.id, f"flown again: {entry.outcome}")
            reset.append(entry.id)
    return reset


def is_unnoted(journal: Journal, entry: JournalEntry, result: Path) -> bool:
    """Whether a result that the journal does not have is one that a killed runner had no time to note, or one
    that the chain of evidence knows. Any other was put there by somebody.
    """
    return entry.attempts > 0 or journal.evidence.knows(entry.id, digest_of(result))


def reconcile(folder: CampaignFolder, journal: Journal) -> list[str]:
    """Make the journal agree with the run folders. `evidence_faults` found that nothing was changed.

    A complete result counts even if the runner was killed before it could note it. A result that is gone is
    planned again; the ids of those are returned.
    """
    lost = []
    for entry in journal.entries():
        run = folder.run(entry.id)
        result = read_result(run, entry.id)
        if entry.state is RealizationState.DONE and (
            result is None or digest_of(run / RESULT) != entry.result_sha256
        ):
            journal.forget(entry.id, "its result or its recording is gone")
            lost.append(entry.id)
        elif (
            result is not None
            and entry.state is not RealizationState.DONE
            and is_unnoted(journal, entry, run / RESULT)
        ):
            journal.finish(result, digest_of(run / RESULT))
    return lost
