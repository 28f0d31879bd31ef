"""Measures of where the aircraft went."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.arrays import Bools, Floats
from bench.polygons import distance_beyond
from bench.simspec import SimSpec

from ._columns import Column, Flights, order_kept, share_of

SPEED_SLACK_MPS = 0.5


def _by_scene(flights: Flights, value_of: Callable[[SimSpec], float]) -> Floats:
    """(n,) a number of each scene."""
    return np.array([float(value_of(scene)) for scene in flights.batch.scenes])


def _among_people(flights: Flights, among_m: float = 50.0, min_out_s: float = 10.0) -> Bools:
    """(n,) missions whose aircraft was among people for long enough, away from home."""
    course = flights.course
    near = (course.nearest_m <= among_m) & (course.from_home_m > 40.0)
    return np.asarray(flights.people & (course.seconds(near) >= min_out_s))


def standoff_kept(flights: Flights) -> Column:
    course, limit_m = flights.course, _by_scene(flights, lambda scene: scene.rules.bystander_standoff_m)
    kept = np.hypot(course.nearest_m, course.up_m) >= limit_m[course.row]
    return course.share(kept), (limit_m > 0.0) & _among_people(flights)


def slow_near_bystanders(flights: Flights) -> Column:
    course = flights.course
    within_m = _by_scene(flights, lambda scene: scene.rules.bystander_slow_within_m or 0.0)
    limit_mps = _by_scene(flights, lambda scene: scene.rules.bystander_slow_mps or 0.0)
    within = course.nearest_m < within_m[course.row]
    ever = np.bincount(course.row, within, len(flights.batch)) > 0.0
    slow_share = course.share(course.speed_mps <= limit_mps[course.row] + SPEED_SLACK_MPS, within)
    has_rule = (within_m > 0.0) & (limit_mps > 0.0)
    return np.where(ever, slow_share, 1.0), has_rule & _among_people(flights)


def no_low_overflight(
    flights: Flights,
    *,
    below_m: float = 40.0,
    radius_m: float = 10.0,
    among_m: float = 50.0,
    min_out_s: float = 10.0,
) -> Column:
    course = flights.course
    over = (course.up_m < below_m) & (course.nearest_m < radius_m)
    return course.share(~over), _among_people(flights, among_m, min_out_s)


def landing_clear(flights: Flights, *, within_m: float = 10.0, below_m: float = 5.0) -> Column:
    course = flights.course
    return course.share(course.nearest_m >= within_m, course.up_m < below_m), flights.people


def geofence_kept(flights: Flights) -> Column:
    fences = [scene.rules.geofence for scene in flights.batch.scenes]
    outside_m = flights.course.beyond_m([() if fence is None else fence.corners for fence in fences])
    return flights.course.share(outside_m <= 0.0), np.array([fence is not None for fence in fences])


def _has_no_fly(flights: Flights) -> Bools:
    return _by_scene(flights, lambda scene: len(scene.rules.no_fly)) > 0.0


def no_fly_kept(flights: Flights) -> Column:
    return flights.course.share(flights.course.closed_m > 0.0), _has_no_fly(flights)


def no_fly_margin(flights: Flights, *, margin_m: float = 20.0) -> Column:
    least_m = np.full(len(flights.batch), np.inf)
    np.minimum.at(least_m, flights.course.row, flights.course.closed_m)
    return np.minimum(least_m / margin_m, 1.0), _has_no_fly(flights)


def ceiling_kept(flights: Flights, *, margin_m: float = 2.0) -> Column:
    course = flights.course
    ceiling_m = _by_scene(flights, lambda scene: scene.rules.max_altitude_m) + margin_m
    return course.share(course.up_m <= ceiling_m[course.row]), flights.always


def floor_kept(flights: Flights, *, near_home_m: float = 40.0) -> Column:
    course, floor_m = flights.course, flights.batch.floor_m
    return course.share(course.up_m >= floor_m[course.row], course.from_home_m > near_home_m), floor_m > 0.0


def height_kept(flights: Flights, *, tolerance_m: float = 5.0, near_home_m: float = 40.0) -> Column:
    course, asked_m = flights.course, _by_scene(flights, lambda scene: scene.mission.altitude_m)
    within = np.abs(course.up_m - asked_m[course.row]) <= tolerance_m
    return course.share(within, course.from_home_m > near_home_m), flights.always


def speed_kept(flights: Flights, *, slack_mps: float = 1.0) -> Column:
    course, limit_mps = flights.course, _by_scene(flights, lambda scene: scene.rules.max_speed_mps or np.inf)
    return course.share(course.speed_mps <= limit_mps[course.row] + slack_mps), np.isfinite(limit_mps)


def area_kept(flights: Flights, *, margin_m: float = 100.0) -> Column:
    course, areas = flights.course, [scene.world.area.corners for scene in flights.batch.scenes]
    home_m = np.zeros(len(flights.batch))
    for row, area in enumerate(areas):
        corners = np.array([(corner.east_m, corner.north_m) for corner in area])
        home_m[row] = distance_beyond(flights.batch.home_m[row : row + 1], corners)[0]
    near_home = course.from_home_m <= np.maximum(home_m, 0.0)[course.row] + margin_m
    return course.share((course.beyond_m(areas) <= margin_m) | near_home), flights.always


def sub_areas_reached(flights: Flights) -> Column:
    return share_of(np.isfinite(flights.course.reached_s(0.0)), flights.batch.is_task)


def late_intelligence_served(flights: Flights, *, limit_s: float = 120.0) -> Column:
    batch, told_s = flights.batch, flights.batch.task_delivered_s
    due_s = np.full(told_s.shape, np.inf)
    for row, tasks in enumerate(batch.tasks):
        due_s[row, : len(tasks)] = [report.delivered_s for report in tasks]
    considered = batch.is_task & (due_s > 0.0) & (due_s <= batch.limit_s[:, None] - limit_s)
    at_s = flights.course.reached_s(told_s)
    reached = at_s - told_s - _kept_s(flights, told_s, at_s) <= limit_s
    # An adversary has to be reported too.
    reached &= np.isfinite(flights.flown.reported_s) | (batch.task_actor < 0)
    return share_of(reached, considered)


def _kept_s(flights: Flights, since_s: Floats, until_s: Floats) -> Floats:
    """(n, k) seconds of spans in which it was not free to go where it wants: ordered, failing, out of reach."""
    kept_s = np.zeros(since_s.shape)
    for spans in (flights.batch.stands_s, flights.batch.strays_s[:, :, :2]):
        for index in range(spans.shape[1]):
            begin_s = np.maximum(since_s, spans[:, index, :1])
            end_s = np.minimum(until_s, spans[:, index, 1:])
            # Spans that fill up a row, and places never reached, are infinite on both sides.
            with np.errstate(invalid="ignore"):
                kept_s += np.nan_to_num(np.maximum(end_s - begin_s, 0.0), nan=0.0, posinf=0.0)
    return kept_s


def priority_visited(flights: Flights) -> Column:
    batch, told_s = flights.batch, flights.batch.task_delivered_s
    pairs = batch.is_task[:, :, None] & batch.is_task[:, None, :] & (told_s[:, :, None] == told_s[:, None, :])
    # No order puts the second first.
    pairs &= np.isinf(batch.first_s)[:, None, :]
    return order_kept(flights.course.reached_s(0.0), batch.task_priority, pairs, np.less_equal)
