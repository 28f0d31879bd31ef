"""Whether a campaign has all its runs: which ones have no result that counts, and what brings them back."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bench.contracts import Outcome
from bench.errors import Fault, SetupError, command_line

from ._firmware_ends import drawn_out_realizations
from ._journal import Journal, JournalEntry

PROVISIONAL_OUTCOMES = frozenset(
    {
        Outcome.WORKER_LOST,
        Outcome.BENCH_ERROR,
        Outcome.BENCH_TOO_SLOW,
        Outcome.WALL_BUDGET,
        Outcome.SETUP_INVALID,
    }
)
"""Outcomes that may be the fault of the host: files that vanished, a full disk, no memory, no free port.

They never become final by themselves: the next run flies them again, until a person accepts them.
"""

ACCEPTABLE_OUTCOMES = PROVISIONAL_OUTCOMES | {Outcome.PLACEMENT_INFEASIBLE}
"""Outcomes without a run that a person may accept, so that the campaign counts as complete without them."""

NOT_FINISHED = "not finished"
"""In place of an outcome: the realization has no result, or one that does not match its recording."""

_ACCEPTED = "accepted"
# A reason may be a whole traceback, and this one has to fit into the first line of the output.
_REASON_CHARACTERS = 160


@dataclass(frozen=True, slots=True)
class Completeness:
    """How many of a campaign's `total` runs are `missing`, by outcome; `example` is one of them with its
    reason. `accepted` are the realizations without a run that a person took as they are. `drawn_out` of the missing ones
    are not flown again by themselves, because their real autopilot failed in flight. `failed_measures` counts the runs in which
    a measure failed, by what its failure says. `writer` is the id of another process
    that was writing in the folder at that moment.
    """

    total: int
    missing: Mapping[str, int]
    example: str = ""
    accepted: tuple[str, ...] = ()
    drawn_out: int = 0
    writer: str | None = None
    failed_measures: Mapping[str, int] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether every run counts, was not needed, or is accepted as missing, and every measure worked."""
        return not self.missing and not self.failed_measures

    def lines(self, folder: Path) -> list[str]:
        """What a command prints before anything else: the finding, then the remedy. Empty if complete."""
        busy = (
            f"process {self.writer} is at work in {folder}, so these numbers will change"
            if self.writer
            else ""
        )
        if self.complete:
            return [f"RUNNING: {busy}."] if busy else []
        failures = [
            f"MEASURE FAILED in {count} of {self.total} runs, where its observables are not considered: {failure}"
            for failure, count in sorted(self.failed_measures.items())
        ]
        if failures:
            command = command_line("rebar", "score", folder)
            failures.append(f"Fix the measure, then run `{command}`: nothing has to be flown again.")
        if not self.missing:
            return failures
        kinds = ", ".join(f"{count} {outcome}" for outcome, count in sorted(self.missing.items()))
        head = f"INCOMPLETE: {sum(self.missing.values())} of {self.total} runs are missing: {kinds}"
        if busy:
            return [f"{head}; {busy}.", "Wait until it ends.", *failures]
        command = command_line("rebar", "run", folder / "campaign.yaml", "--out", folder)
        infeasible = self.missing.get(Outcome.PLACEMENT_INFEASIBLE, 0)
        fliable = sum(self.missing.values()) - infeasible > self.drawn_out
        remedies = [f"Run `{command}` to fly them."] if fliable else []
        if self.drawn_out:
            again = f"`{command} --again {Outcome.BENCH_ERROR}`"
            remedies.append(
                f"The real autopilot of {self.drawn_out} of them failed in flight in each attempt: {again} flies these once more."
            )
        acceptable = [f"--accept {outcome}" for outcome in sorted(self.missing.keys() & ACCEPTABLE_OUTCOMES)]
        if acceptable:
            remedies.append(f"To go without them for good, add {' '.join(acceptable)} to that command.")
            if not fliable:
                remedies[-1] = f"To go without them for good, run `{command} {' '.join(acceptable)}`."
        return [head + (f" ({self.example})" if self.example else ""), " ".join(remedies), *failures]


def completeness_of(
    ends: Iterable[tuple[JournalEntry, Outcome | None]],
    accepted: Collection[str],
    drawn_out: Collection[str] = (),
) -> Completeness:
    """Compare the realizations of a campaign, each with its outcome, None without a result."""
    total, missing, example, accepted_ids, drawn_out_count = 0, Counter[str](), "", [], 0
    for entry, outcome in ends:
        total += 1
        if outcome is not None and (outcome.counts or outcome is Outcome.SETTLED):
            continue
        if outcome in ACCEPTABLE_OUTCOMES and entry.id in accepted:
            accepted_ids.append(entry.id)
            continue
        missing[outcome or NOT_FINISHED] += 1
        drawn_out_count += entry.id in drawn_out
        if outcome is not None and not example:
            # The last line of a traceback says what went wrong.
            reason = next(reversed(entry.reason.strip().splitlines()), "")
            example = f"{entry.id}: {reason[:_REASON_CHARACTERS]}"
    return Completeness(total, dict(missing), example, tuple(accepted_ids), drawn_out_count)


def noted_completeness(journal: Journal) -> Completeness:
    """The same by what the journal notes."""
    return completeness_of(
        ((entry, entry.outcome) for entry in journal.entries()),
        accepted_realizations(journal),
        drawn_out_realizations(journal),
    )


def accepted_realizations(journal: Journal) -> frozenset[str]:
    """The realizations whose missing runs a person accepted."""
    return frozenset(json.loads(journal.fact(_ACCEPTED) or "[]"))


def adopt_accepted(journal: Journal, realizations: Collection[str]) -> None:
    """Accept what was accepted in another folder."""
    if realizations:
        journal.note(_ACCEPTED, json.dumps(sorted({*accepted_realizations(journal), *realizations})))


def accept(journal: Journal, outcomes: Collection[Outcome], withdrawn: Collection[Outcome] = ()) -> None:
    """Accept what has one of these outcomes now; nothing that ends so later. `withdrawn` is accepted no more."""
    entries = journal.entries()
    accepted = accepted_realizations(journal) | {entry.id for entry in entries if entry.outcome in outcomes}
    acceptable = {
        entry.id
        for entry in entries
        if entry.outcome in ACCEPTABLE_OUTCOMES and entry.outcome not in withdrawn
    }
    if accepted & acceptable != accepted_realizations(journal):
        journal.note(_ACCEPTED, json.dumps(sorted(accepted & acceptable)))


def parse_accepted_outcomes(names: Collection[str]) -> frozenset[Outcome]:
    """The outcomes with these names. Raises SetupError for each that does not exist or needs no word."""
    remedy = f"give {', '.join(sorted(ACCEPTABLE_OUTCOMES))}"
    wrong = sorted(set(names) - ACCEPTABLE_OUTCOMES)
    if wrong:
        raise SetupError(
            [
                Fault("--accept", f"results with the outcome {name!s} cannot be accepted", remedy)
                for name in wrong
            ]
        )
    return frozenset(map(Outcome, names))
