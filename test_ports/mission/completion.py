"""Measures of whether the mission was flown and the vehicle brought home.

A vehicle that never went out, or that crashed, gets 0: it went out when it was in the air and farther than 40 m
from home for at least 10 s in all. A landing at home after a hop there is no return. `mission_time` and
`landing_accuracy` are considered when the mission asks for a return; the others always are.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._declaration import Finding, Limit, Positive, measure, not_considered, nothing_shown, shown
from ..ground_truth import FlownTrack, GroundTruth
from .search import first_reached_s

FLOWN, BROUGHT_HOME = 0.5, 1.0
NEVER_OUT = "the vehicle was never out: it stayed on the ground or near home"

LessThanOne = Annotated[float, Limit(lambda value: value < 1.0, "a number less than 1")]


@measure
def mission_flown(tape: Tape, simspec: SimSpec, *, home_m: float = 10.0) -> Finding:
    """1 when the vehicle flew over a reported sub-area, did not crash, and came home if the mission asks for
    it.

    The vehicle came home when it is on the ground for good, within `home_m` of home and within the time
    limit. After an order to deactivate, being on the ground within the time limit is enough: it is to land where
    it is. 0.5 when it flew over a sub-area and did not crash, but did not come home. 0 when it flew over no
    sub-area. Without reported sub-areas, any flight counts.
    """
    if (failure := _no_flight(tape, simspec)) is not None:
        return failure
    over_area_s = _first_over_a_sub_area(tape, simspec)
    if math.isinf(over_area_s):
        return nothing_shown(tape.end_s, "the vehicle came over none of the reported sub-areas")
    arrival = Evidence(time_s=over_area_s, text="the vehicle came over a reported sub-area")
    if not simspec.mission.return_home:
        return Finding(BROUGHT_HOME, (arrival,))
    x, landing = _return_home(tape, simspec, home_m)
    return Finding(x, (arrival, landing))


def _return_home(tape: Tape, simspec: SimSpec, home_m: float) -> tuple[float, Evidence]:
    down_s = _down_since(tape)
    if down_s is None:
        return FLOWN, Evidence(time_s=tape.end_s, text="the vehicle was still in the air at the end")
    if down_s > simspec.mission.time_limit_s:
        return FLOWN, Evidence(time_s=down_s, text="the vehicle landed after the time limit")
    distance_m = float(FlownTrack.of(tape, simspec).from_home_m[-1])
    landing = Evidence(time_s=down_s, text=f"the vehicle landed {distance_m:.1f} m from home")
    right_place = distance_m <= home_m or _ordered_down_by(tape, simspec, down_s)
    return (BROUGHT_HOME if right_place else FLOWN), landing


def _ordered_down_by(tape: Tape, simspec: SimSpec, down_s: float) -> bool:
    """Whether the operator had ordered it to land where it is before it was down for good."""
    track = FlownTrack.of(tape, simspec)
    return bool((track.ordered_down & (track.time_s <= down_s)).any())


@measure
def mission_time(tape: Tape, simspec: SimSpec, *, share: LessThanOne = 0.9) -> Finding:
    """1 when the vehicle was down for good within `share` of the time limit, falling to 0 at the limit."""
    down = _down_whole(tape, simspec)
    if isinstance(down, Finding):
        return down
    limit_s = simspec.mission.time_limit_s
    # Linear from 1 at `share` of the limit to 0 at the limit; the share is less than 1.
    x = (limit_s - down) / (limit_s * (1.0 - share))
    return shown(min(1.0, max(0.0, x)), down, f"down after {down:.1f} s of {limit_s:g} s")


@measure
def landing_accuracy(tape: Tape, simspec: SimSpec, *, scale_m: Positive = 10.0) -> Finding:
    """1 - (distance of the last landing from home) / `scale_m`, at least 0.

    Not considered after an order to deactivate, which asks to land where it is.
    """
    down = _down_whole(tape, simspec)
    if isinstance(down, Finding):
        return down
    if _ordered_down_by(tape, simspec, down):
        return not_considered("the operator ordered it to land where it is")
    # The truth of the motion may end before the last condition: the last sample then stands for the landing.
    row = int(np.clip(np.searchsorted(tape.vehicle_time_s, down), 0, len(tape.vehicle_time_s) - 1))
    distance_m = float(FlownTrack.of(tape, simspec).from_home_m[row])
    return shown(max(0.0, 1.0 - distance_m / scale_m), down, f"landed {distance_m:.1f} m from home")


def _down_whole(tape: Tape, simspec: SimSpec) -> float | Finding:
    """Since when it has been down for good and whole, after it had been out; the finding where it is not, or need not be."""
    if not simspec.mission.return_home:
        return not_considered("the mission does not ask for a return")
    down_s = _down_since(tape)
    # A vehicle that was out has samples of its motion.
    if down_s is None or _no_flight(tape, simspec) is not None:
        return nothing_shown(tape.end_s, "it was not down and whole after it had been out")
    return down_s


@measure
def battery_reserve(tape: Tape, simspec: SimSpec) -> Finding:
    """Charge at the end divided by `rules.battery_reserve_fraction`, at most 1."""
    if (failure := _no_flight(tape, simspec)) is not None:
        return failure
    last, reserve = tape.condition[-1], simspec.rules.battery_reserve_fraction
    charge = last.value.battery_fraction
    text = f"{charge:.0%} of the charge at the end; the rules ask for {reserve:.0%}"
    return shown(min(1.0, charge / reserve) if reserve > 0.0 else 1.0, last.time.s, text)


def _no_flight(tape: Tape, simspec: SimSpec) -> Finding | None:
    """The finding for a vehicle that crashed or never went out; None for any other."""
    crashed = next((state for state in tape.condition if state.value.crashed), None)
    if crashed is not None:
        return nothing_shown(crashed.time.s, "the vehicle crashed")
    return None if FlownTrack.of(tape, simspec).went_out else nothing_shown(tape.end_s, NEVER_OUT)


def _first_over_a_sub_area(tape: Tape, simspec: SimSpec) -> float:
    """When the vehicle first was over a reported sub-area; out at all when none was reported; infinite when never."""
    track, areas = FlownTrack.of(tape, simspec), GroundTruth.of(tape, simspec).sub_areas()
    if not areas:
        return track.first_s(track.out())
    return min(first_reached_s(tape, simspec, area) for area in areas)


def _down_since(tape: Tape) -> float | None:
    """Since when it has been on the ground for good; None when it is in the air at the end."""
    since_s = None
    for state in tape.condition:
        if not state.value.landed:
            since_s = None
        elif since_s is None:
            since_s = state.time.s
    return since_s
