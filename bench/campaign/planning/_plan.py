"""From a campaign to the entries of its journal: every SimSpec realized, placed, checked and written once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from bench.contracts import Outcome, SessionResult
from bench.documents import dump_yaml, read_text
from bench.errors import Fault, SetupError
from bench.realization import PlacementInfeasible, RealizationPlan, place
from bench.simspec import SimSpec, factor_values
from decompositions import Decomposition

from .._document import Campaign
from ..storage._files import digest_of
from ..storage._folder import CampaignFolder
from ..storage._journal import Journal, JournalEntry, PlannedRealization
from ..storage._results import write_result
from ._inputs import write_input
from ._realizations import intents_of, realizations
from ._scenes import open_scene_writer, write_scenes

CheckTakeoff = Callable[[Iterable[SimSpec]], list[Fault]]
"""Finds what is known to be wrong with sessions of these SimSpecs before any of them flies."""


def plan_campaign(
    campaign: Campaign,
    folder: CampaignFolder,
    journal: Journal,
    decomposition: Decomposition,
    check_takeoff: CheckTakeoff = lambda simspecs: [],
    workers: int = 1,
) -> list[RealizationPlan]:
    """Every realization of the campaign, added to the journal, with its SimSpec in simspecs/. Up to `workers` processes
    place the actors.

    Entries that the journal has already stay as they are. Raises SetupError if they belong to another
    campaign, if the decomposition cannot rate one of the situations (such a session could be flown and never
    be scored), and with all that `check_takeoff` finds about the realizations that have no result yet.
    """
    plans = realizations(campaign)
    intents = intents_of(plans)
    _check_same(folder, journal, intents, decomposition.digest)
    known = {entry.id: entry for entry in journal.entries()}
    added = [plan for plan in plans if plan.id not in known]
    with open_scene_writer(added, folder, workers, with_infeasible=True) as write:
        _check_rated(added, decomposition)
        done = {entry.id for entry in known.values() if entry.outcome is not None and entry.outcome.counts}
        if faults := check_takeoff(plan.simspec for plan in plans if plan.id not in done):
            raise SetupError(faults)
        folder.path.mkdir(parents=True, exist_ok=True)
        write_input(folder.campaign, dump_yaml(_with_local_decomposition(campaign, folder, journal)), journal)
        if len(known) < len(plans):
            folder.lay_out(len(plans))
        digests = write().digests
    journal.note("decomposition_sha256", decomposition.digest)
    # After the files: an entry in the journal promises that its SimSpec is on disk.
    journal.add(PlannedRealization(plan, intents[plan.id], digests[plan.id]) for plan in added)
    _restore(
        [plan for plan in plans if plan.id in known and not _is_intact(known[plan.id], folder)], folder, known
    )
    return plans


def _is_intact(entry: JournalEntry, folder: CampaignFolder) -> bool:
    path = folder.simspec(entry.id)
    return path.is_file() and digest_of(path) == entry.simspec_sha256


def _with_local_decomposition(campaign: Campaign, folder: CampaignFolder, journal: Journal) -> Campaign:
    """The campaign as its folder holds it, with a copy of the decomposition if that was a file."""
    file = Path(campaign.decomposition)
    if not file.is_file():
        return campaign
    if file.resolve() != folder.decomposition.resolve():
        write_input(folder.decomposition, read_text(file), journal)
    return campaign.model_copy(update={"decomposition": folder.decomposition.name})


def finish_infeasible(
    plans: Sequence[RealizationPlan], folder: CampaignFolder, journal: Journal
) -> Iterator[SessionResult]:
    """Write, note and yield the results of realizations that placement found no room for.

    They are never flown.
    """
    waiting = {entry.id: entry for entry in journal.entries() if entry.outcome is None}
    reasons: dict[str, str] = {}
    for plan in plans:
        # Without positions the file is the intent itself. A base that brings positions is checked where it is
        # flown.
        entry = waiting.get(plan.id)
        if entry is None or plan.simspec.realized is not None or entry.simspec_sha256 != entry.intent_sha256:
            continue
        scene = f"{plan.design_point}-r{plan.replicate}"
        if scene not in reasons:
            reasons[scene] = "no placement was found when the campaign was planned"
            try:
                place(plan.simspec)
            except PlacementInfeasible as error:
                reasons[scene] = str(error)
        result = SessionResult(
            realization=plan.id, outcome=Outcome.PLACEMENT_INFEASIBLE, reason=reasons[scene]
        )
        journal.finish(result, write_result(folder.fresh_run(plan.id), result))
        yield result


def _check_same(
    folder: CampaignFolder, journal: Journal, intents: dict[str, str], decomposition_sha256: str
) -> None:
    """A folder accepts more realizations of its campaign, but never different ones under the same names."""
    entries = journal.entries()
    faults = []
    measured_with = journal.fact("decomposition_sha256")
    if entries and measured_with not in (None, decomposition_sha256):
        faults.append(
            Fault(
                str(folder.path),
                "was measured with another decomposition",
                "apply a new one with `rebar score`, or name another folder",
            )
        )
    different = [entry.id for entry in entries if intents.get(entry.id) != entry.intent_sha256]
    if different:
        shown = ", ".join(different[:3]) + (f" and {len(different) - 3} more" if len(different) > 3 else "")
        faults.append(
            Fault(
                str(folder.path),
                f"holds realizations that are not in this campaign: {shown}",
                "name another folder; docs/designs.md says what can be added to a design",
            )
        )
    if faults:
        raise SetupError(faults)


def _check_rated(plans: Iterable[RealizationPlan], decomposition: Decomposition) -> None:
    # Imported here: scoring brings its arrays along, and the rest of planning does without.
    from bench.scoring import difficulty_of_values

    rated: set[tuple[tuple[str, float], ...]] = set()
    for plan in plans:
        values = factor_values(plan.simspec)
        situation = tuple(values.items())
        # Replicates and agents share their factor values, so most situations were rated already.
        if situation not in rated:
            rated.add(situation)
            difficulty_of_values(decomposition, values)


def _restore(
    plans: Sequence[RealizationPlan], folder: CampaignFolder, entries: Mapping[str, JournalEntry]
) -> None:
    """Write SimSpecs that were lost or damaged again, from their seeds."""
    digests = write_scenes(plans, folder, with_infeasible=True).digests
    faults = [
        Fault(
            str(folder.simspec(name)),
            "differs from what the journal noted, and cannot be restored",
            "name another folder",
        )
        for name, digest in digests.items()
        if digest != entries[name].simspec_sha256
    ]
    if faults:
        raise SetupError(faults)
