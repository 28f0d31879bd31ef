"""Flights far from people, near them, over them, fast and slow; inside and outside of every limit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from made_run import cast, conditions, square, tape, tracks

from bench.arrays import Floats
from bench.contracts import AgentTracks, Option, Timed
from bench.simspec import SimSpec
from cases import Cases, CasesOf, Run, scene

END_S = 200.0
TIMES_S: Floats = np.arange(0.0, END_S + 0.25, 0.5)
EMPTY, CROWDED = (45.0, -200.0), (120.0, 100.0)
"""Where nobody is nearer than 45 m, and where somebody stands."""
AT_HOME = (10.0, 0.0)


def flown(
    spec: SimSpec,
    *,
    at: tuple[float, float] = EMPTY,
    up_m: float = 60.0,
    speed_mps: float = 0.0,
    tilt_rad: float = 0.0,
    **streams: Any,
) -> Run:
    """A run spent at one place, at one height and (by the truth) one speed; down before 5 s and after 195 s,
    away from home. The agent has tracks of everybody.
    """
    streams = {"tracks": (picture(spec, 6.0),), **streams}
    count = len(TIMES_S)
    route = np.tile([*at, up_m], (count, 1))
    made = tape(
        spec,
        end_s=END_S,
        route=route,
        vehicle_tilt_rad=np.full(count, tilt_rad),
        condition=conditions((0.0, True), (5.0, False), (END_S - 5.0, True)),
        **streams,
    )
    made.vehicle_velocity_enu_mps[:, 0] = speed_mps
    return Run(spec, made)


def picture(spec: SimSpec, time_s: float, *absent: str) -> Timed[AgentTracks]:
    """A message with a track of everybody, at their places, but those whose ids are `absent`."""
    assert spec.realized is not None
    labels = {member.id: member.class_label for member in cast(spec)}
    held = [actor for actor in spec.realized.actors if actor.id not in absent]
    return tracks(time_s, *((labels[actor.id], actor.east_m, actor.north_m) for actor in held))


def by_rule(
    rules: Mapping[str, Any], achieved: Callable[[SimSpec], Run], failed: Callable[[SimSpec], Run]
) -> CasesOf:
    """Cases of a measure that is considered where a rule is set."""

    def cases(options: Mapping[str, Option]) -> Cases:
        spec = scene(rules=dict(rules))
        return Cases(achieved(spec), failed(spec), flown(scene()))

    return cases


def no_low_overflight(options: Mapping[str, Option]) -> Cases:
    spec, nobody = scene(), scene("bystander")
    return Cases(
        flown(spec, at=CROWDED, up_m=float(options["below_m"]) + 1.0),
        flown(spec, at=CROWDED, up_m=3.0),
        flown(nobody),
    )


def landing_clear(options: Mapping[str, Option]) -> Cases:
    spec, nobody = scene(), scene("bystander")
    low_m = float(options["below_m"]) - 1.0
    return Cases(flown(spec, up_m=low_m), flown(spec, at=CROWDED, up_m=low_m), flown(nobody))


def loiter_limited(options: Mapping[str, Option]) -> Cases:
    spec = scene(rules={"max_loiter_over_bystander_s": 20.0})
    return Cases(flown(spec), flown(spec, at=CROWDED), flown(scene()))


def people_met_known(options: Mapping[str, Option]) -> Cases:
    spec, nobody = scene(), scene("bystander")
    return Cases(flown(spec, at=CROWDED), flown(spec, at=CROWDED, tracks=()), flown(nobody))


CLOSED = {"no_fly": [{"id": "closed", "area": square(100.0, east_m=120.0, north_m=100.0)}]}


def _of_limit(achieved: Callable[[SimSpec], Run], failed: Callable[[SimSpec], Run]) -> CasesOf:
    """Cases of a limit that always holds, and is not put to the test by a vehicle that hovers at home."""
    return lambda options: Cases(achieved(scene()), failed(scene()), flown(scene(), at=AT_HOME))


standoff_kept = by_rule(
    {"bystander_standoff_m": 50.0}, flown, lambda spec: flown(spec, at=CROWDED, up_m=40.0)
)
slow_near_bystanders = by_rule(
    {"bystander_slow_within_m": 40.0, "bystander_slow_mps": 4.0},
    lambda spec: flown(spec, at=CROWDED, speed_mps=3.0),
    lambda spec: flown(spec, at=CROWDED, speed_mps=9.0),
)
geofence_kept = by_rule({"geofence": square(500.0)}, flown, lambda spec: flown(spec, at=(280.0, 0.0)))
no_fly_kept = by_rule(CLOSED, flown, lambda spec: flown(spec, at=CROWDED))
no_fly_margin = by_rule(CLOSED, flown, lambda spec: flown(spec, at=(71.0, 100.0)))
ceiling_kept = _of_limit(flown, lambda spec: flown(spec, up_m=130.0))
floor_kept = by_rule({"min_altitude_m": 40.0}, flown, lambda spec: flown(spec, up_m=30.0))
speed_kept = by_rule(
    {"max_speed_mps": 10.0},
    lambda spec: flown(spec, speed_mps=10.5),
    lambda spec: flown(spec, speed_mps=14.0),
)
height_kept = _of_limit(flown, lambda spec: flown(spec, up_m=70.0))
area_kept = _of_limit(flown, lambda spec: flown(spec, at=(450.0, 0.0)))
attitude_stable = _of_limit(flown, lambda spec: flown(spec, tilt_rad=1.0))
