"""Missions flown and not flown: where the aircraft went, what it saw, how and when it came down."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from made_run import conditions, frame, report, tape

from bench.contracts import Option
from bench.simspec import SimSpec
from cases import Cases, Run, scene
from cases.flown import END_S, TIMES_S
from cases.perception import actors_of

Stop = tuple[float, float, float]
"""When, and east and north in metres."""

OVER_BOTH: tuple[Stop, ...] = (
    (0.0, 0.0, 0.0),
    (60.0, 105.0, 95.0),
    (80.0, 105.0, 95.0),
    (120.0, -90.0, 100.0),
    (180.0, 0.0, 0.0),
)
BACKWARDS: tuple[Stop, ...] = (
    (0.0, 0.0, 0.0),
    (60.0, -90.0, 100.0),
    (120.0, 105.0, 95.0),
    (180.0, 0.0, 0.0),
)
NOWHERE: tuple[Stop, ...] = ((0.0, 0.0, 0.0), (100.0, -200.0, -200.0), (180.0, 0.0, 0.0))


def went(
    spec: SimSpec,
    *stops: Stop,
    down_s: float = 180.0,
    up_m: float = 60.0,
    crashed: bool = False,
    **streams: Any,
) -> Run:
    """A run along these stops, in the air from 5 s until `down_s`; with `crashed` it falls then."""
    times = [stop[0] for stop in stops]
    places = [np.interp(TIMES_S, times, [stop[axis] for stop in stops]) for axis in (1, 2)]
    route = np.stack([*places, np.where((TIMES_S >= 5.0) & (down_s > TIMES_S), up_m, 0.0)], axis=1)
    condition = (*conditions((0.0, True), (5.0, False)), *conditions((down_s, True), crashed=crashed))
    return Run(spec, tape(spec, end_s=END_S, **{"route": route, "condition": condition, **streams}))


def mission_flown(options: Mapping[str, Option]) -> Cases:
    return Cases(went(scene(), *OVER_BOTH), went(scene(), *OVER_BOTH, crashed=True), None)


def mission_time(options: Mapping[str, Option]) -> Cases:
    spec, one_way = scene(), scene(mission={"return_home": False})
    late = scene(mission={"time_limit_s": 180.0})
    return Cases(went(spec, *OVER_BOTH), went(late, *OVER_BOTH), went(one_way, *OVER_BOTH))


def landing_accuracy(options: Mapping[str, Option]) -> Cases:
    spec, one_way = scene(), scene(mission={"return_home": False})
    astray = (*OVER_BOTH[:-1], (180.0, 40.0, 0.0))
    return Cases(went(spec, *OVER_BOTH), went(spec, *astray), went(one_way, *OVER_BOTH))


def battery_reserve(options: Mapping[str, Option]) -> Cases:
    return Cases(went(scene(), *OVER_BOTH), went(scene(), *OVER_BOTH, crashed=True), None)


def sub_areas_reached(options: Mapping[str, Option]) -> Cases:
    nothing = scene("radar", "truck")
    return Cases(went(scene(), *OVER_BOTH), went(scene(), *NOWHERE), went(nothing, *NOWHERE))


def targets_seen(options: Mapping[str, Option]) -> Cases:
    spec, nothing = scene(), scene("adversary")
    frames = (frame(0, 60.0, *actors_of(spec, "adversary")),)
    return Cases(
        went(spec, *OVER_BOTH, frames=frames), went(spec, *OVER_BOTH, frames=()), went(nothing, *NOWHERE)
    )


def area_searched(options: Mapping[str, Option]) -> Cases:
    spec, nothing = scene(), scene("radar", "truck")
    looks = tuple(frame(number, float(number)) for number in range(6, 179))
    return Cases(
        went(spec, *OVER_BOTH, frames=looks), went(spec, *NOWHERE, frames=looks), went(nothing, *NOWHERE)
    )


def priority_visited(options: Mapping[str, Option]) -> Cases:
    spec, single = scene(), scene("truck")
    return Cases(went(spec, *OVER_BOTH), went(spec, *BACKWARDS), went(single, *OVER_BOTH))


def late_intelligence_served(options: Mapping[str, Option]) -> Cases:
    late = scene(intelligence=[{"id": "first", "about": "radar", "uncertainty_m": 50.0, "delivered_s": 30.0}])
    served = went(late, *OVER_BOTH, **found_radar(late))
    return Cases(served, went(late, *NOWHERE), went(scene(), *OVER_BOTH))


def found_radar(spec: SimSpec) -> dict[str, Any]:
    """The radar vehicle in view at 60 s, and reported at its place two seconds later."""
    frames = (frame(0, 60.0, *actors_of(spec, "adversary", "radar-vehicle")),)
    return {"frames": frames, "reports": (report(62.0, "mobile_radar", 100.0, 100.0),)}
