"""Whether the mission was flown and the vehicle brought home."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from ._measured import Finding, Measured
from ._truth import Truth

LOST, OUT, HOME = 0.0, 0.5, 1.0


@dataclass(frozen=True, slots=True)
class MissionFlownOptions:
    home_m: float = 10.0


def _mission_flown(tape: Tape, simspec: SimSpec, options: MissionFlownOptions) -> Finding:
    """1 when the vehicle went where it was sent and ended whole and, if so ordered, landed near home within the time limit.

    0.5 when it went and stayed whole but was not brought home in time. 0 when it crashed, never left the ground, or
    came over none of the reported sub-areas: standing at home is not a mission.
    """
    crashed = next((said for said in tape.condition if said.value.crashed), None)
    if crashed is not None:
        return Finding(LOST, (Evidence(time_s=crashed.time.s, text="the vehicle crashed"),))
    if not any(not said.value.landed for said in tape.condition):
        return Finding(LOST, (Evidence(time_s=tape.end_s, text="the vehicle never left the ground"),))
    went_s = _first_over_a_sub_area(tape, simspec)
    if went_s is None:
        return Finding(LOST, (Evidence(time_s=tape.end_s, text="the vehicle came over none of the reported sub-areas"),))
    went = Evidence(time_s=went_s, text="the vehicle came over a reported sub-area")
    if not simspec.mission.return_home:
        return Finding(HOME, (went,))
    return _brought_home(tape, simspec, options, went)


def _brought_home(tape: Tape, simspec: SimSpec, options: MissionFlownOptions, went: Evidence) -> Finding:
    down_s = _down_since(tape)
    if down_s is None:
        return Finding(OUT, (went, Evidence(time_s=tape.end_s, text="the vehicle was still in the air at the end")))
    if down_s > simspec.mission.time_limit_s:
        return Finding(OUT, (went, Evidence(time_s=down_s, text="the vehicle landed after the time limit")))
    home = simspec.vehicle.home
    away_m = float(np.hypot(*(tape.vehicle_position_enu_m[-1, :2] - (home.east_m, home.north_m))))
    landed = Evidence(time_s=down_s, text=f"the vehicle landed {away_m:.1f} m from home")
    return Finding(HOME if away_m <= options.home_m else OUT, (went, landed))


def _first_over_a_sub_area(tape: Tape, simspec: SimSpec) -> float | None:
    """When the vehicle first was over a reported sub-area; the moment of its first motion when none was reported."""
    if not len(tape.vehicle_time_s):
        return None
    areas = Truth.of(tape, simspec).sub_areas()
    over = np.full(len(tape.vehicle_time_s), not areas)
    for area in areas:
        over |= np.hypot(*(tape.vehicle_position_enu_m[:, :2] - area.place).T) <= area.radius_m
    return float(tape.vehicle_time_s[over.argmax()]) if over.any() else None


def _down_since(tape: Tape) -> float | None:
    """Since when it has been on the ground for good; None when it is not."""
    since = None
    for said in tape.condition:
        if not said.value.landed:
            since = None
        elif since is None:
            since = said.time.s
    return since


mission_flown = Measured("mission_flown", MissionFlownOptions, _mission_flown)
