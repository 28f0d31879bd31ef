"""Where the aircraft went and what its camera saw of the task, by the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from bench.arrays import Floats
from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._measure import Finding, Measured, NoOptions, not_considered
from ..ground_truth._flown_track import Flight
from ..ground_truth._truth import SubArea, Truth


@dataclass(frozen=True, slots=True)
class TargetsSeenOptions:
    min_height_px: float = 12.0
    min_visible: float = 0.5


def _targets_seen(tape: Tape, simspec: SimSpec, options: TargetsSeenOptions) -> Finding:
    """Share of the targets that came into clear view at some frame."""
    truth = Truth.of(tape, simspec)
    targets = [target.actor for target in truth.targets()]
    if not targets:
        return not_considered("intelligence names no adversary")
    first: dict[int, float] = {}
    for frame in tape.frames:
        for one in frame.sightings:
            if one.actor in targets and one.height_px >= options.min_height_px and one.visible >= options.min_visible:
                first.setdefault(one.actor, frame.exposed.s)
    missed = [actor for actor in targets if actor not in first]
    evidence = [Evidence(time_s=tape.end_s, text=f"{truth.cast[actor].id} never came into clear view") for actor in missed]
    seen = [
        Evidence(time_s=first[actor], text=f"{truth.cast[actor].id} first in clear view") for actor in targets if actor in first
    ]
    return Finding(len(seen) / len(targets), (*evidence, *seen))


def _sub_areas_reached(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """Share of the reported sub-areas that the aircraft came over."""
    areas = Truth.of(tape, simspec).sub_areas()
    if not areas:
        return not_considered("no intelligence is given")
    reached = {area.id: reached_s(tape, simspec, area) for area in areas}
    missed = [Evidence(time_s=tape.end_s, text=f"{name} was never reached") for name, time_s in reached.items() if time_s is None]
    come = [Evidence(time_s=time_s, text=f"{name} reached") for name, time_s in reached.items() if time_s is not None]
    return Finding(len(come) / len(areas), (*missed, *come))


def reached_s(tape: Tape, simspec: SimSpec, area: SubArea, since_s: float = 0.0) -> float | None:
    """When the aircraft was first over a sub-area, in the air and not before `since_s`; None when it never was."""
    flight = Flight.of(tape, simspec)
    over = flight.airborne & (flight.time_s >= since_s) & (np.hypot(*(flight.place_m - area.place).T) <= area.radius_m)
    return float(flight.time_s[over.argmax()]) if over.any() else None


@dataclass(frozen=True, slots=True)
class AreaSearchedOptions:
    grid_m: float = 10.0

    def __post_init__(self) -> None:
        if self.grid_m < 1.0:
            raise ValueError(f"option 'grid_m' is {self.grid_m:g}; it must be 1 or more")


def _area_searched(tape: Tape, simspec: SimSpec, options: AreaSearchedOptions) -> Finding:
    """Share of the sub-areas' ground, on a grid, that lay inside the camera's footprint at some frame; their mean.

    The footprint is taken as the disc around the aircraft's place that the camera's view reaches when it turns about: from
    below the aircraft to where the middle of the upper edge of its picture meets flat ground (at most 2.5 heights away). So
    it overstates what a camera that looks ahead sees in one frame, and is right for one that flies around what it looks at.
    """
    areas = Truth.of(tape, simspec).sub_areas()
    if not areas:
        return not_considered("no intelligence is given")
    flight = Flight.of(tape, simspec)
    exposed = np.array([frame.exposed.s for frame in tape.frames])
    rows = np.unique(np.clip(np.searchsorted(flight.time_s, exposed), 0, max(len(flight.time_s) - 1, 0)))
    rows = rows[flight.airborne[rows]] if len(flight.time_s) else rows[:0]
    reach_m = flight.up_m[rows] * _reach(simspec)
    shares = {area.id: _covered(area, options.grid_m, flight.place_m[rows], reach_m) for area in areas}
    evidence = [
        Evidence(time_s=tape.end_s, text=f"{name}: {shares[name]:.0%} of its ground seen")
        for name in sorted(shares, key=lambda one: shares[one])
    ]
    return Finding(sum(shares.values()) / len(shares), tuple(evidence))


def _reach(simspec: SimSpec) -> float:
    """Ground distance that the camera sees, in heights."""
    camera = simspec.vehicle.camera
    vertical_deg = math.degrees(
        2.0 * math.atan(math.tan(math.radians(camera.horizontal_fov_deg) / 2.0) * camera.height_px / camera.width_px)
    )
    upper_deg = max(camera.tilt_deg - vertical_deg / 2.0, 0.0)
    return min(1.0 / math.tan(math.radians(upper_deg)), 2.5) if upper_deg > 1.0 else 2.5


def _covered(area: SubArea, grid_m: float, places_m: Floats, reach_m: Floats) -> float:
    steps = np.arange(-area.radius_m + grid_m / 2.0, area.radius_m, grid_m)
    east, north = np.meshgrid(steps, steps)
    inside = np.hypot(east, north) <= area.radius_m
    points = np.stack([east[inside], north[inside]], axis=1) + area.place
    if not len(points) or not len(places_m):
        return 0.0
    seen = np.zeros(len(points), dtype=bool)
    for start in range(0, len(places_m), 256):  # blocks, so that a fine grid does not fill the memory
        block = slice(start, start + 256)
        seen |= (np.linalg.norm(points[:, None] - places_m[None, block], axis=2) <= reach_m[None, block]).any(axis=1)
    return float(seen.mean())


def _priority_visited(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """Of the pairs of sub-areas with unequal priority that were told of at the same time, share reached in that order.

    A pair of which one was never reached is out of order.
    """
    areas = {area.id: area for area in Truth.of(tape, simspec).sub_areas()}
    told = [one for one in simspec.intelligence if one.id in areas]
    pairs = [
        tuple(sorted(pair, key=lambda one: one.priority))
        for pair in combinations(told, 2)
        if pair[0].priority != pair[1].priority and pair[0].delivered_s == pair[1].delivered_s
    ]
    if not pairs:
        return not_considered("no two sub-areas of different priority were told of at the same time")
    first = {one.id: reached_s(tape, simspec, areas[one.id]) for one in told}
    kept: list[Evidence] = []
    broken: list[Evidence] = []
    for urgent, other in pairs:
        early, late = first[urgent.id], first[other.id]
        in_order = early is not None and late is not None and early <= late
        text = f"{urgent.id} (priority {urgent.priority}), {other.id} ({other.priority}): {'in order' if in_order else 'not reached in this order'}"
        made = [time_s for time_s in (early, late) if time_s is not None]
        (kept if in_order else broken).append(Evidence(time_s=min(made, default=tape.end_s), text=text))
    return Finding(len(kept) / len(pairs), (*broken, *kept))


@dataclass(frozen=True, slots=True)
class LateIntelligenceOptions:
    limit_s: float = 120.0


def _late_intelligence_served(tape: Tape, simspec: SimSpec, options: LateIntelligenceOptions) -> Finding:
    """Of the intelligence delivered during the flight, share whose sub-area was reached within `limit_s` of delivery.

    Only what comes `limit_s` or more before the mission's time limit counts.
    """
    areas = {area.id: area for area in Truth.of(tape, simspec).sub_areas()}
    latest_s = simspec.mission.time_limit_s - options.limit_s
    late = [one for one in simspec.intelligence if one.id in areas and 0.0 < one.delivered_s <= latest_s]
    if not late:
        return not_considered(f"no intelligence is delivered during the flight, {options.limit_s:g} s or more before its end")
    delivered = {said.value.id: said.time.s for said in tape.intelligence}
    served: list[Evidence] = []
    missed: list[Evidence] = []
    for one in late:
        since_s = delivered.get(one.id, one.delivered_s)
        at_s = reached_s(tape, simspec, areas[one.id], since_s)
        in_time = at_s is not None and at_s <= since_s + options.limit_s
        text = f"{one.id}, delivered at {since_s:.1f} s: {'never reached' if at_s is None else f'reached after {at_s - since_s:.1f} s'}"
        (served if in_time else missed).append(Evidence(time_s=since_s, text=text))
    return Finding(len(served) / len(late), (*missed, *served))


targets_seen = Measured("targets_seen", TargetsSeenOptions, _targets_seen)
sub_areas_reached = Measured("sub_areas_reached", NoOptions, _sub_areas_reached)
area_searched = Measured("area_searched", AreaSearchedOptions, _area_searched)
priority_visited = Measured("priority_visited", NoOptions, _priority_visited)
late_intelligence_served = Measured("late_intelligence_served", LateIntelligenceOptions, _late_intelligence_served)
