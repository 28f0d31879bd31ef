"""Measures of where the aircraft went."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from bench.arrays import Bools, Floats
from bench.simspec import SimSpec

from ._columns import Column, ComputedMeasure, Flights, Options, any_of, number, order_kept, share_of
from ._course import beyond_m

SPEED_SLACK_MPS = 0.5


def _by_scene(flights: Flights, value_of: Callable[[SimSpec], float]) -> Floats:
    """(n,) a number of each scene."""
    return np.array([float(value_of(scene)) for scene in flights.batch.scenes])


def _people(flights: Flights) -> Bools:
    return any_of(flights.batch.role == 0)


def _among_people(flights: Flights, options: Options) -> Bools:
    """(n,) missions whose aircraft was among people for long enough, away from home."""
    course = flights.course
    near = (course.nearest_m <= number(options, "among_m", 50.0)) & (course.from_home_m > 40.0)
    among: Bools = _people(flights) & (course.seconds(near) >= number(options, "min_out_s", 10.0))
    return among


def _standoff_kept(flights: Flights, options: Options) -> Column:
    course, limit_m = flights.course, _by_scene(flights, lambda scene: scene.rules.bystander_standoff_m)
    kept = np.hypot(course.nearest_m, course.up_m) >= limit_m[course.row]
    return course.share(kept), (limit_m > 0.0) & _among_people(flights, options)


def _slow_near_bystanders(flights: Flights, options: Options) -> Column:
    course = flights.course
    within_m = _by_scene(flights, lambda scene: scene.rules.bystander_slow_within_m or 0.0)
    limit_mps = _by_scene(flights, lambda scene: scene.rules.bystander_slow_mps or 0.0)
    within = course.nearest_m < within_m[course.row]
    ever = np.bincount(course.row, within, len(flights.batch)) > 0.0
    slow_share = course.share(course.speed_mps <= limit_mps[course.row] + SPEED_SLACK_MPS, within)
    has_rule = (within_m > 0.0) & (limit_mps > 0.0)
    return np.where(ever, slow_share, 1.0), has_rule & _among_people(flights, options)


def _no_low_overflight(flights: Flights, options: Options) -> Column:
    course = flights.course
    low = course.up_m < number(options, "below_m", 40.0)
    over = low & (course.nearest_m < number(options, "radius_m", 10.0))
    return course.share(~over), _among_people(flights, options)


def _landing_clear(flights: Flights, options: Options) -> Column:
    course = flights.course
    low = course.up_m < number(options, "below_m", 5.0)
    return course.share(course.nearest_m >= number(options, "within_m", 10.0), low), _people(flights)


def _geofence_kept(flights: Flights, options: Options) -> Column:
    fenced = _by_scene(flights, lambda scene: scene.rules.geofence is not None) > 0.0
    outside_m = flights.course.beyond_m(
        lambda scene: scene.rules.geofence.corners if scene.rules.geofence else ()
    )
    return flights.course.share(outside_m <= 0.0), fenced


def _has_no_fly(flights: Flights) -> Bools:
    return _by_scene(flights, lambda scene: len(scene.rules.no_fly)) > 0.0


def _no_fly_kept(flights: Flights, options: Options) -> Column:
    return flights.course.share(flights.course.closed_m() > 0.0), _has_no_fly(flights)


def _no_fly_margin(flights: Flights, options: Options) -> Column:
    least_m = np.full(len(flights.batch), np.inf)
    np.minimum.at(least_m, flights.course.row, flights.course.closed_m())
    return np.minimum(least_m / number(options, "margin_m", 20.0), 1.0), _has_no_fly(flights)


def _ceiling_kept(flights: Flights, options: Options) -> Column:
    course, margin_m = flights.course, number(options, "margin_m", 2.0)
    ceiling_m = _by_scene(flights, lambda scene: scene.rules.max_altitude_m) + margin_m
    return course.share(course.up_m <= ceiling_m[course.row]), flights.always()


def _floor_kept(flights: Flights, options: Options) -> Column:
    course, floor_m = flights.course, flights.batch.floor_m
    away = course.from_home_m > number(options, "near_home_m", 40.0)
    return course.share(course.up_m >= floor_m[course.row], away), floor_m > 0.0


def _height_kept(flights: Flights, options: Options) -> Column:
    course, asked_m = flights.course, _by_scene(flights, lambda scene: scene.mission.altitude_m)
    away = course.from_home_m > number(options, "near_home_m", 40.0)
    within = np.abs(course.up_m - asked_m[course.row]) <= number(options, "tolerance_m", 5.0)
    return course.share(within, away), flights.always()


def _speed_kept(flights: Flights, options: Options) -> Column:
    course, slack_mps = flights.course, number(options, "slack_mps", 1.0)
    limit_mps = _by_scene(flights, lambda scene: scene.rules.max_speed_mps or np.inf)
    return course.share(course.speed_mps <= limit_mps[course.row] + slack_mps), np.isfinite(limit_mps)


def _area_kept(flights: Flights, options: Options) -> Column:
    course, margin_m = flights.course, number(options, "margin_m", 100.0)
    home_m = np.zeros(len(flights.batch))
    for row, scene in enumerate(flights.batch.scenes):
        corners = np.array([(corner.east_m, corner.north_m) for corner in scene.world.area.corners])
        home_m[row] = beyond_m(flights.batch.home_m[row : row + 1], corners)[0]
    near_home = course.from_home_m <= np.maximum(home_m, 0.0)[course.row] + margin_m
    outside_m = course.beyond_m(lambda scene: scene.world.area.corners)
    return course.share((outside_m <= margin_m) | near_home), flights.always()


def _sub_areas_reached(flights: Flights, options: Options) -> Column:
    return share_of(np.isfinite(flights.course.reached_s(0.0)), flights.batch.is_task)


def _late_intelligence_served(flights: Flights, options: Options) -> Column:
    batch, limit_s = flights.batch, number(options, "limit_s", 120.0)
    due_s = np.full(batch.task_radius_m.shape, np.inf)
    for row, scene in enumerate(batch.scenes):
        delivered = {report.id for report in scene.realized.reports}
        due_s[row, : len(delivered)] = [
            report.delivered_s for report in scene.intelligence if report.id in delivered
        ]
    considered = batch.is_task & (due_s > 0.0) & (due_s <= batch.limit_s[:, None] - limit_s)
    told_s = batch.task_delivered_s
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


def _priority_visited(flights: Flights, options: Options) -> Column:
    batch, told_s = flights.batch, flights.batch.task_delivered_s
    pairs = batch.is_task[:, :, None] & batch.is_task[:, None, :] & (told_s[:, :, None] == told_s[:, None, :])
    return order_kept(flights.course.reached_s(0.0), batch.task_priority, pairs, np.less_equal)


MEASURES: Mapping[str, ComputedMeasure] = {
    "standoff_kept": (_standoff_kept, ("among_m", "min_out_s")),
    "slow_near_bystanders": (_slow_near_bystanders, ("among_m", "min_out_s")),
    "no_low_overflight": (_no_low_overflight, ("below_m", "radius_m", "among_m", "min_out_s")),
    "landing_clear": (_landing_clear, ("within_m", "below_m")),
    "geofence_kept": (_geofence_kept, ()),
    "no_fly_kept": (_no_fly_kept, ()),
    "no_fly_margin": (_no_fly_margin, ("margin_m",)),
    "ceiling_kept": (_ceiling_kept, ("margin_m",)),
    "floor_kept": (_floor_kept, ("near_home_m",)),
    "height_kept": (_height_kept, ("tolerance_m", "near_home_m")),
    "speed_kept": (_speed_kept, ("slack_mps",)),
    "area_kept": (_area_kept, ("margin_m",)),
    "sub_areas_reached": (_sub_areas_reached, ()),
    "late_intelligence_served": (_late_intelligence_served, ("limit_s",)),
    "priority_visited": (_priority_visited, ()),
}
