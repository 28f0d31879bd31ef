"""A campaign at the lowest fidelity: surrogates predict the results, in batches, in place of sessions.

An agent's surrogate is a plug-in of group `rebar.surrogates` under the name of the agent's manifest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bench.contracts import (
    Outcome,
    OverheadFidelity,
    Prediction,
    SessionResult,
    Surrogate,
    facts_of,
    load_plugin,
    plugins,
)
from bench.errors import Fault, SetupError
from bench.simspec import SimSpec

from ._document import Campaign
from .planning._realizations import realizations
from .storage._folder import CampaignFolder
from .storage._journal import Journal
from .storage._results import write_result

if TYPE_CHECKING:
    from decompositions import Decomposition

OVERHEAD = "overhead"
AT_ONCE = 500
"""Missions whose results are written before the next are flown."""


def check_fidelity(campaign: Campaign, journal: Journal) -> None:
    """Make sure that a folder holds results of one fidelity, and that surrogates can fly what the campaign asks for.

    Raises SetupError with every fault.
    """
    noted = journal.fact("fidelity") or "full"
    if journal.entries() and noted != campaign.fidelity:
        remedy = f"name another folder, or fidelity: {noted}"
        raise SetupError(
            "fidelity", f"{campaign.fidelity!r} is asked for, and the folder's results are {noted}", remedy
        )
    if campaign.fidelity == OVERHEAD:
        check_surrogates(campaign)
    journal.note("fidelity", campaign.fidelity)


def check_surrogates(campaign: Campaign) -> None:
    """Raises SetupError with everything that no surrogate can fly, in any of a campaign's scenes."""
    faults = [fault for plan in realizations(campaign) for fault in _unfit(plan.simspec)]
    if faults:
        raise SetupError(list({str(fault): fault for fault in faults}.values()))


def _unfit(simspec: SimSpec) -> Sequence[Fault]:
    """Why no surrogate can fly a SimSpec: its agent has none, or the surrogate says why."""
    agents = plugins("rebar.surrogates")
    if simspec.agent.label not in agents:
        remedy = f"fly {' or '.join(sorted(agents)) or 'an agent that has one'}, or fidelity: full"
        return [Fault("agents", f"{simspec.agent.label!r} has no surrogate", remedy)]
    return _surrogate(simspec.agent.label).unfit(simspec)


def _surrogate(agent: str) -> Surrogate:
    surrogate: Surrogate = load_plugin("rebar.surrogates", agent)
    return surrogate


def fly_overhead(
    simspecs: Sequence[SimSpec], names: Sequence[str], decomposition: Decomposition
) -> list[SessionResult]:
    """The results of realized SimSpecs by the surrogates of their agents, in the order given.

    Raises SetupError for everything that no surrogate can fly.
    """
    from .planning._measures import measures_of  # with the decompositions, which a runner does without

    faults = {str(fault): fault for simspec in simspecs for fault in _unfit(simspec)}
    if faults:
        raise SetupError(list(faults.values()))
    measures = measures_of(decomposition)
    results: dict[int, SessionResult] = {}
    for agent in dict.fromkeys(simspec.agent.label for simspec in simspecs):
        rows = [row for row, simspec in enumerate(simspecs) if simspec.agent.label == agent]
        predictions = _surrogate(agent).predict([simspecs[row] for row in rows], measures)
        for row, prediction in zip(rows, predictions, strict=True):
            results[row] = _result(names[row], simspecs[row], prediction)
    return [results[row] for row in range(len(simspecs))]


def _result(name: str, simspec: SimSpec, prediction: Prediction) -> SessionResult:
    limit_s = simspec.mission.time_limit_s
    return SessionResult(
        realization=name,
        outcome=Outcome.COMPLETED if prediction.end_s <= limit_s else Outcome.TIME_LIMIT,
        simulated_s=min(prediction.end_s, limit_s),
        observations=prediction.observations,
        facts=facts_of(OverheadFidelity(not_computed=tuple(prediction.not_computed))),
    )


def fly_one(simspec: SimSpec, decomposition: Decomposition, folder: Path, realization: str) -> SessionResult:
    """One realization by surrogate, as a worker's job."""
    (result,) = fly_overhead([simspec], [realization], decomposition)
    return result


def flown_overhead(
    folder: CampaignFolder, journal: Journal, decomposition: Decomposition
) -> Iterator[SessionResult]:
    """Results, written and noted, of all realizations that wait. Stopped in between, the rest waits on."""
    waiting = [entry.id for entry in journal.entries() if entry.outcome is None]
    for begin in range(0, len(waiting), AT_ONCE):
        names = waiting[begin : begin + AT_ONCE]
        simspecs = [SimSpec.model_validate_json(folder.simspec(name).read_bytes()) for name in names]
        for result in fly_overhead(simspecs, names, decomposition):
            journal.finish(result, write_result(folder.fresh_run(result.realization), result))
            yield result
