"""A campaign at the lowest fidelity: results by surrogate, in batches, in place of sessions.

The simulator comes in where something is flown, so that the runner stays light without it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bench.contracts import Outcome, SessionResult
from bench.errors import Fault, SetupError
from bench.simspec import SimSpec

from ._design import realizations
from ._document import Campaign
from ._folder import CampaignFolder, write_result
from ._journal import Journal

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
        mend = f"name another folder, or fidelity: {noted}"
        raise SetupError(Fault("fidelity", f"{campaign.fidelity!r} is asked for, and the folder's results are {noted}", mend))
    if campaign.fidelity == OVERHEAD:
        check_surrogates(campaign)
    journal.note("fidelity", campaign.fidelity)


def check_surrogates(campaign: Campaign) -> None:
    """Raises SetupError with all that no surrogate can fly, in any of a campaign's scenes."""
    from bench.simulation.overhead import unfit

    asked = [fault for plan in realizations(campaign) for fault in unfit(plan.simspec)]
    if asked:
        raise SetupError(list({str(fault): fault for fault in asked}.values()))


def fly_overhead(simspecs: Sequence[SimSpec], names: Sequence[str], decomposition: Decomposition) -> list[SessionResult]:
    """The results of realized SimSpecs by surrogate. Raises SetupError for what no surrogate can fly."""
    from bench.simulation.overhead import observe, pack

    from ._measuring import measures_of

    if not simspecs:
        return []
    observed = observe(pack(simspecs), measures_of(decomposition))
    details = {"fidelity": OVERHEAD, "not_computed": list(observed.missing)}
    return [
        SessionResult(
            realization=name,
            outcome=Outcome.COMPLETED if observed.end_s[row] <= simspec.mission.time_limit_s else Outcome.TIME_LIMIT,
            simulated_s=min(float(observed.end_s[row]), simspec.mission.time_limit_s),
            observations=observed.of(row),
            details=details,
        )
        for row, (name, simspec) in enumerate(zip(names, simspecs, strict=True))
    ]


def job_at(fidelity: str, job: str) -> str:
    """The job of workers that fly what was not flown in batches, because it was taken up again later."""
    return "bench.campaign._overhead:fly_one" if fidelity == OVERHEAD else job


def fly_one(simspec: SimSpec, decomposition: Decomposition, folder: Path, realization: str) -> SessionResult:
    """One realization by surrogate, as a worker's job."""
    (result,) = fly_overhead([simspec], [realization], decomposition)
    return result


def flown_overhead(folder: CampaignFolder, journal: Journal, decomposition: Decomposition) -> Iterator[SessionResult]:
    """Results, written and noted, of all realizations that wait. Stopped in between, the rest waits on."""
    waiting = [entry.id for entry in journal.entries() if entry.outcome is None]
    for begin in range(0, len(waiting), AT_ONCE):
        names = waiting[begin : begin + AT_ONCE]
        simspecs = [SimSpec.model_validate_json(folder.simspec(name).read_bytes()) for name in names]
        for result in fly_overhead(simspecs, names, decomposition):
            journal.finish(result, write_result(folder.fresh_run(result.realization), result))
            yield result
