"""Whether the mission was flown and the vehicle brought home."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._measure import Finding, Measured, NoOptions, not_considered
from ..ground_truth._truth import Truth

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


@dataclass(frozen=True, slots=True)
class MissionTimeOptions:
    share: float = 0.9

    def __post_init__(self) -> None:
        if self.share >= 1.0:
            raise ValueError(f"option 'share' is {self.share:g}; it must be less than 1")


def _mission_time(tape: Tape, simspec: SimSpec, options: MissionTimeOptions) -> Finding:
    """1 when it was down for good within `share` of the time limit, after flying; falling to 0 at the limit itself."""
    if not simspec.mission.return_home:
        return not_considered("the mission does not ask for a return")
    down_s = _down_since(tape)
    flew = any(not said.value.landed for said in tape.condition)
    if down_s is None or not flew or any(said.value.crashed for said in tape.condition):
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="it was not down and whole after a flight"),))
    limit_s = simspec.mission.time_limit_s
    x = (limit_s - down_s) / (limit_s * (1.0 - options.share))
    return Finding(min(1.0, max(0.0, x)), (Evidence(time_s=down_s, text=f"down after {down_s:.1f} s of {limit_s:g} s"),))


@dataclass(frozen=True, slots=True)
class LandingAccuracyOptions:
    scale_m: float = 10.0

    def __post_init__(self) -> None:
        if self.scale_m == 0.0:
            raise ValueError("option 'scale_m' is 0; it must be more")


def _landing_accuracy(tape: Tape, simspec: SimSpec, options: LandingAccuracyOptions) -> Finding:
    """1 - distance from home of the last landing / `scale_m`, not below 0; 0 when it did not land whole after a flight."""
    if not simspec.mission.return_home:
        return not_considered("the mission does not ask for a return")
    down_s = _down_since(tape)
    flew = any(not said.value.landed for said in tape.condition)
    if down_s is None or not flew or any(said.value.crashed for said in tape.condition) or not len(tape.vehicle_time_s):
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="it was not down and whole after a flight"),))
    row = int(np.clip(np.searchsorted(tape.vehicle_time_s, down_s), 0, len(tape.vehicle_time_s) - 1))
    home = simspec.vehicle.home
    east_m, north_m = tape.vehicle_position_enu_m[row, :2]
    apart_m = float(np.hypot(east_m - home.east_m, north_m - home.north_m))
    return Finding(
        max(0.0, 1.0 - apart_m / options.scale_m), (Evidence(time_s=down_s, text=f"landed {apart_m:.1f} m from home"),)
    )


def _battery_reserve(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """Charge at the end of the run over the rules' reserve, at most 1; 0 for one that crashed, never flew, or was not seen."""
    crashed = next((said for said in tape.condition if said.value.crashed), None)
    flew = any(not said.value.landed for said in tape.condition)
    if crashed is not None or not flew:
        time_s, text = (crashed.time.s, "the vehicle crashed") if crashed else (tape.end_s, "it never flew")
        return Finding(0.0, (Evidence(time_s=time_s, text=text),))
    left, reserve = tape.condition[-1].value.battery_fraction, simspec.rules.battery_reserve_fraction
    text = f"{left:.0%} of the charge left; {reserve:.0%} was to be"
    return Finding(min(1.0, left / reserve) if reserve > 0.0 else 1.0, (Evidence(time_s=tape.condition[-1].time.s, text=text),))


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
mission_time = Measured("mission_time", MissionTimeOptions, _mission_time)
landing_accuracy = Measured("landing_accuracy", LandingAccuracyOptions, _landing_accuracy)
battery_reserve = Measured("battery_reserve", NoOptions, _battery_reserve)
