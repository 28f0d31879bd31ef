"""From a campaign to the entries of its journal: every SimSpec realized, placed, judged and written, once."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from bench.contracts import Outcome, SessionResult
from bench.documents import dump_json, dump_yaml
from bench.errors import Fault, SetupError
from bench.realization import PlacementInfeasible, RealizationPlan, place
from bench.simspec import SimSpec, factor_values
from decompositions import Decomposition

from .._document import Campaign
from ..storage._folder import CampaignFolder, digest_of, write_result, write_whole
from ..storage._journal import Journal, Planned
from ._realizations import realizations


def plan_campaign(
    campaign: Campaign, folder: CampaignFolder, journal: Journal, decomposition: Decomposition
) -> list[RealizationPlan]:
    """Every realization of the campaign, entered in the journal, its SimSpec in simspecs/.

    What the journal holds already stays as it is. Raises SetupError when that belongs to another campaign, and when the
    decomposition cannot rate one of the situations, which could be flown and never be scored.
    """
    plans = realizations(campaign)
    intents = {plan.id: _digest(dump_json(plan.simspec)) for plan in plans}
    _check_same(folder, journal, intents, decomposition.digest)
    known = {entry.id: entry for entry in journal.entries()}
    _check_rated((plan for plan in plans if plan.id not in known), decomposition)
    folder.path.mkdir(parents=True, exist_ok=True)
    write_whole(folder.campaign, dump_yaml(_at_home(campaign, folder)))
    placer = _Placer()
    new = [plan for plan in plans if plan.id not in known]
    planned = [Planned(plan, intents[plan.id], placer.write(plan, folder)) for plan in new]
    journal.note("decomposition_sha256", decomposition.digest)
    journal.enter(planned)
    for plan in plans:
        entry = known.get(plan.id)
        if entry and not (folder.simspec(plan.id).is_file() and digest_of(folder.simspec(plan.id)) == entry.simspec_sha256):
            _restore(plan, folder, placer, entry.simspec_sha256)
    return plans


def _at_home(campaign: Campaign, folder: CampaignFolder) -> Campaign:
    """The campaign as its folder holds it: a decomposition that was a file of the author's comes along."""
    file = Path(campaign.decomposition)
    if not file.is_file():
        return campaign
    if file.resolve() != folder.decomposition.resolve():
        write_whole(folder.decomposition, file.read_bytes())
    return campaign.model_copy(update={"decomposition": folder.decomposition.name})


def unflyable(plans: Sequence[RealizationPlan], folder: CampaignFolder, journal: Journal) -> Iterator[SessionResult]:
    """Results, written and noted, of the realizations that placement found no room for; they are never flown."""
    waiting = {entry.id for entry in journal.entries() if entry.outcome is None}
    reasons: dict[str, str] = {}
    for plan in plans:
        if plan.id not in waiting or SimSpec.model_validate_json(folder.simspec(plan.id).read_bytes()).realized is not None:
            continue
        scene = f"{plan.design_point}-r{plan.replicate}"
        if scene not in reasons:
            reasons[scene] = _why_not(plan.simspec)
        result = SessionResult(realization=plan.id, outcome=Outcome.PLACEMENT_INFEASIBLE, reason=reasons[scene])
        journal.finish(result, write_result(folder.fresh_run(plan.id), result))
        yield result


def _why_not(simspec: SimSpec) -> str:
    try:
        place(simspec)
    except PlacementInfeasible as error:
        return str(error)
    return "no place was found when the campaign was planned"


def _check_same(folder: CampaignFolder, journal: Journal, intents: dict[str, str], decomposition_sha256: str) -> None:
    """A folder takes more realizations of its campaign, never others under the same names."""
    entries = journal.entries()
    faults = []
    noted = journal.fact("decomposition_sha256")
    if entries and noted not in (None, decomposition_sha256):
        faults.append(
            Fault(
                str(folder.path),
                "was measured with another decomposition",
                "`rebar score` applies a new one, or name another folder",
            )
        )
    other = [entry.id for entry in entries if intents.get(entry.id) != entry.intent_sha256]
    if other:
        shown = ", ".join(other[:3]) + (f" and {len(other) - 3} more" if len(other) > 3 else "")
        faults.append(
            Fault(
                str(folder.path),
                f"holds realizations that this campaign does not ask for: {shown}",
                "name another folder; docs/designs.md says what a design may be added to",
            )
        )
    if faults:
        raise SetupError(faults)


def _check_rated(plans: Iterable[RealizationPlan], decomposition: Decomposition) -> None:
    from bench.scoring import difficulty_of_values  # with all of its arrays, which nothing else here needs

    seen: set[tuple[tuple[str, float], ...]] = set()
    for plan in plans:
        values = factor_values(plan.simspec)
        rated = tuple(values.items())
        if rated not in seen:
            seen.add(rated)
            difficulty_of_values(decomposition, values)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


class _Placer:
    """Places each scene once, whichever agents fly it."""

    def __init__(self) -> None:
        self._scene: tuple[str, int] | None = None
        self._placed: SimSpec | None = None

    def write(self, plan: RealizationPlan, folder: CampaignFolder) -> str:
        """Write the realized SimSpec (without places where there is no room) and return its SHA-256."""
        scene = (plan.design_point, plan.replicate)
        if scene != self._scene:
            self._scene, self._placed = scene, _placed(plan.simspec)
        realized = self._placed.realized if self._placed else None
        return write_whole(folder.simspec(plan.id), dump_json(plan.simspec.model_copy(update={"realized": realized})))


def _placed(simspec: SimSpec) -> SimSpec | None:
    try:
        return place(simspec)
    except PlacementInfeasible:
        return None


def _restore(plan: RealizationPlan, folder: CampaignFolder, placer: _Placer, wanted: str) -> None:
    """A SimSpec that was lost or damaged, made again from its seeds."""
    if placer.write(plan, folder) != wanted:
        raise SetupError(
            Fault(
                str(folder.simspec(plan.id)),
                "is not what the journal knows, and cannot be made again as it was",
                "name another folder",
            )
        )
