"""Where people are when it counts, as their seeded walks have them: round the landing, and when a target is searched.

Walks depend on the realized SimSpec alone: nobody in a scene reacts to the vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Floats
from bench.contracts import START
from bench.simspec import TARGET_ROLES, Role, SimSpec
from bench.simulation import open_plain_scene

from ._course import Course

LANDING_M = 10.0  # within which nobody may be at a touchdown: the measure of clear landings has as much
LANDING_S, LANDING_STEP_S = 40.0, 4.0  # before and after the landing as the course has it; chosen
SEARCH_S, SEARCH_STEP_S = 30.0, 10.0  # before and after the end of a search; chosen
CALLED_HOME_S = 60.0  # from an order that ends the mission to the landing; chosen
FAR_SHARE = 20.0  # of the no-mark distance: where nobody is there; chosen


@dataclass(frozen=True, slots=True)
class Walks:
    """What people do to a landing and to marks: shares of the time, and `margin`, at most 0.

    `margin` is 0 where somebody crosses the no-mark distance of each target while it is searched, and minus the logarithm of how
    far the nearest stays on either side of it.
    """

    at_landing: float
    within_standoff: float
    margin: float

    @classmethod
    def of(cls, simspec: SimSpec, course: Course) -> Walks:
        """From a realized SimSpec."""
        end_s = min(course.home_s, simspec.mission.time_limit_s, course.called_home_s + CALLED_HOME_S)
        limit_s = simspec.mission.time_limit_s
        landing_s = _times_s(end_s, LANDING_S, LANDING_STEP_S)
        searches = [
            (stop.about, _times_s(min(stop.searched_s, limit_s), SEARCH_S, SEARCH_STEP_S))
            for stop in course.stops
        ]
        places = _places(simspec, {*landing_s, *(time_s for _, times in searches for time_s in times)})
        people = _members(simspec, {Role.BYSTANDER})
        home = np.array([(simspec.vehicle.home.east_m, simspec.vehicle.home.north_m)])
        nearest_m = np.array([_nearest_m(places[time_s][people], home) for time_s in landing_s])
        margins = [
            _margin(
                [_nearest_m(places[time_s][people], places[time_s][targets]) for time_s in times_s],
                simspec.rules.no_mark_within_m,
            )
            for group, times_s in searches
            if (targets := _members(simspec, TARGET_ROLES, group)).any()
        ]
        return cls(
            float((nearest_m < LANDING_M).mean()),
            float((nearest_m < simspec.rules.bystander_standoff_m).mean()),
            float(np.mean(margins)) if margins else -math.log(FAR_SHARE),
        )


def _members(simspec: SimSpec, roles: Collection[Role], group: str | None = None) -> Bools:
    """Which of the placed actors have one of the roles, and are of that group."""
    assert simspec.realized is not None  # features_of
    wanted = {member.id for member in simspec.actors if member.role in roles and group in (None, member.id)}
    return np.array([actor.group in wanted for actor in simspec.realized.actors], dtype=np.bool_)


def _times_s(middle_s: float, around_s: float, step_s: float) -> list[float]:
    return [
        max(0.0, float(time_s))
        for time_s in np.arange(middle_s - around_s, middle_s + around_s + 1e-9, step_s)
    ]


def _places(simspec: SimSpec, times_s: Collection[float]) -> Mapping[float, Floats]:
    """(actors, 2) east and north at each time."""
    scene = open_plain_scene(simspec)
    places = {}
    for time_s in sorted(times_s):
        scene.advance(START.after(time_s))
        places[time_s] = scene.positions()[:, :2].copy()
    return places


def _nearest_m(people_m: Floats, points_m: Floats) -> float:
    return float(np.linalg.norm(people_m[:, None] - points_m[None], axis=2).min(initial=math.inf))


def _margin(nearest_m: list[float], mark_m: float) -> float:
    if mark_m <= 0.0:
        return -math.log(FAR_SHARE)
    if min(nearest_m) <= mark_m < max(nearest_m):
        return 0.0
    return max(-math.log(min(FAR_SHARE, max(d / mark_m, mark_m / max(d, 1.0)))) for d in nearest_m)
