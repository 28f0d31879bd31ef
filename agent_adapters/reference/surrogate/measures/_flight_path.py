"""Measures of where the aircraft went: moments of the whole flight, takeoff and landing with it, each with
its span.

Standing still counts for nothing here: what a mission waits has no span.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.simspec import Point, SimSpec

from ..batch._batch import Batch
from ..flight._outcome import FlownMissions, standing_span_of
from ..flight._views import Stretch
from ._columns import Column, ComputedMeasure, Options, SharedSums, always, any_of, number

# Straight up and down over one place, which no stretch of the flight holds. Chosen, not measured.
TAKEOFF_S, LANDING_COLUMN_S, LANDING_COLUMN_M = 4.0, 13.0, 15.0
SPEED_SLACK_MPS = 0.5
_MOMENTS = 6


class _FlightPath:
    """Every moment in the air of every mission, flat."""

    def __init__(self, batch: Batch, flown: FlownMissions) -> None:
        self.batch = batch
        parts = [_flat(part) for part in flown.course]
        parts += [
            _column(flown.took_off_s, batch.home_m, 6.0, TAKEOFF_S),
            _column(flown.end_s - 3.0, flown.place_m, LANDING_COLUMN_M, -LANDING_COLUMN_S),
        ]
        joined = [np.concatenate(part) for part in zip(*parts, strict=True)]
        # What it flies after an order to land where it is, it has not chosen (FlownTrack.free).
        moves = (joined[3] > 0.0) & (joined[1] < batch.ordered_down_s[joined[0].astype(np.int64)])
        self.row: Counts = joined[0][moves].astype(np.int64)
        self.time_s, self.place_m, self.span_s, self.up_m, self.speed_mps = (
            part[moves] for part in joined[1:]
        )
        self._everybody_m = flown.everybody_m
        self._nearest_m: Floats | None = None

    def share(self, right: Bools, among: Bools | None = None) -> Floats:
        """(n,) of the time, or of that among some of the moments, the share that is good; 0 where there is
        none.
        """
        span_s = self.span_s if among is None else np.where(among, self.span_s, 0.0)
        whole_s, right_s = (
            np.bincount(self.row, weights, len(self.batch))
            for weights in (span_s, np.where(right, span_s, 0.0))
        )
        return right_s / np.maximum(whole_s, 1e-9)

    def nearest_m(self) -> Floats:
        """How far away the nearest bystander is, on the ground."""
        if self._nearest_m is None:
            self._nearest_m = np.full(len(self.row), np.inf)
            epochs = standing_span_of(self.time_s)
            for epoch in range(len(self._everybody_m)):
                people_m = np.where((self.batch.role == 0)[..., None], self._everybody_m[epoch], 1e9).astype(
                    np.float32
                )
                for begin in range(0, len(self.row), 4096):
                    at = begin + np.flatnonzero(epochs[begin : begin + 4096] == epoch)
                    away_m = people_m[self.row[at]] - self.place_m[at, None].astype(np.float32)
                    apart_m2 = away_m[..., 0] ** 2 + away_m[..., 1] ** 2
                    self._nearest_m[at] = np.sqrt(apart_m2.min(axis=1, initial=np.inf))
        return self._nearest_m

    def from_home_m(self) -> Floats:
        away_m = self.place_m - self.batch.home_m[self.row]
        distance_m: Floats = np.hypot(away_m[:, 0], away_m[:, 1])
        return distance_m

    def beyond_m(self, corners_of: Callable[[SimSpec], Sequence[Point]]) -> Floats:
        """How far outside a polygon of each scene, negative inside; inf where a scene has ncorner."""
        distance_m = np.full(len(self.row), np.inf)
        polygons: dict[tuple[tuple[float, float], ...], list[int]] = {}
        for row, scene in enumerate(self.batch.scenes):
            polygons.setdefault(
                tuple((corner.east_m, corner.north_m) for corner in corners_of(scene)), []
            ).append(row)
        for corners, rows in polygons.items():
            if corners:
                at = np.flatnonzero(np.isin(self.row, rows))
                distance_m[at] = _beyond_m(self.place_m[at], np.array(corners))
        return distance_m


def _flat(stretch: Stretch) -> tuple[np.ndarray, ...]:
    rows, time_s, place_m, span_s = stretch.rows, stretch.time_s, stretch.place_m, stretch.span_s
    moments = time_s.shape[1]
    flown_m = np.hypot(*np.moveaxis(np.diff(place_m, axis=1, prepend=place_m[:, :1]), -1, 0))
    speed_mps = flown_m / np.maximum(span_s, 1e-9)
    up_m = stretch.height_m.ravel()
    return (
        rows.repeat(moments),
        time_s.ravel(),
        place_m.reshape(-1, 2),
        span_s.ravel(),
        up_m,
        speed_mps.ravel(),
    )


def _column(begin_s: Floats, place_m: Floats, high_m: float, span_s: float) -> tuple[np.ndarray, ...]:
    """Straight up from a moment on, or, with a negative span, down up to it."""
    since = (np.arange(_MOMENTS) + 0.5) / _MOMENTS
    count = len(begin_s)
    time_s = begin_s[:, None] + (since * span_s)[None, :]
    up_m = np.repeat((since * high_m)[None, :], count, axis=0)
    return (
        np.arange(count).repeat(_MOMENTS),
        time_s.ravel(),
        place_m.repeat(_MOMENTS, axis=0),
        np.full(count * _MOMENTS, abs(span_s) / _MOMENTS),
        up_m.ravel(),
        np.zeros(count * _MOMENTS),
    )


def _beyond_m(places_m: Floats, points: Floats) -> Floats:
    """Distances of places from a polygon's edge, positive outside and negative inside."""
    following = np.roll(points, -1, axis=0)
    along = following - points
    offset = places_m[:, None] - points[None]
    share = np.clip((offset * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12), 0.0, 1.0)
    apart_m = np.linalg.norm(offset - share[..., None] * along, axis=2).min(axis=1)
    north = places_m[:, None, 1]
    crosses = (points[None, :, 1] > north) != (following[None, :, 1] > north)
    rise = np.where(following[:, 1] == points[:, 1], 1.0, following[:, 1] - points[:, 1])
    at_east = points[:, 0] + (north - points[None, :, 1]) * (following[:, 0] - points[:, 0]) / rise
    inside = (crosses & (places_m[:, None, 0] < at_east)).sum(axis=1) % 2 == 1
    beyond_m: Floats = np.where(inside, -apart_m, apart_m)
    return beyond_m


def _flight_path_of(batch: Batch, flown: FlownMissions, looks: SharedSums) -> _FlightPath:
    if looks.flight_path is None:
        looks.flight_path = _FlightPath(batch, flown)
    assert isinstance(looks.flight_path, _FlightPath)
    return looks.flight_path


def _has_rule(batch: Batch, rule_of: Callable[[SimSpec], object]) -> Bools:
    """(n,) scenes whose rules ask for something."""
    return np.array([bool(rule_of(scene)) for scene in batch.scenes])


def _people(batch: Batch) -> Bools:
    return any_of(batch.role == 0)


def _among_people(batch: Batch, course: _FlightPath, options: Options) -> Bools:
    """(n,) missions whose aircraft was among people for long enough, away from home."""
    near = (course.nearest_m() <= number(options, "among_m", 50.0)) & (course.from_home_m() > 40.0)
    among_s = np.bincount(course.row, np.where(near, course.span_s, 0.0), len(batch))
    among: Bools = _people(batch) & (among_s >= number(options, "min_out_s", 10.0))
    return among


def _standoff_kept(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    limit_m = np.array([scene.rules.bystander_standoff_m for scene in batch.scenes])
    return course.share(np.hypot(course.nearest_m(), course.up_m) >= limit_m[course.row]), (
        limit_m > 0.0
    ) & _among_people(batch, course, options)


def _slow_near_bystanders(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    within_m = np.array([scene.rules.bystander_slow_within_m or 0.0 for scene in batch.scenes])
    limit_mps = np.array([scene.rules.bystander_slow_mps or 0.0 for scene in batch.scenes])
    within = course.nearest_m() < within_m[course.row]
    ever = np.bincount(course.row, within, len(batch)) > 0.0
    slow_share = course.share(course.speed_mps <= limit_mps[course.row] + SPEED_SLACK_MPS, within)
    return np.where(ever, slow_share, 1.0), (within_m > 0.0) & (limit_mps > 0.0) & _among_people(
        batch, course, options
    )


def _no_low_overflight(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    low = course.up_m < number(options, "below_m", 40.0)
    return course.share(~(low & (course.nearest_m() < number(options, "radius_m", 10.0)))), _among_people(
        batch, course, options
    )


def _landing_clear(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    low = course.up_m < number(options, "below_m", 5.0)
    return course.share(course.nearest_m() >= number(options, "within_m", 10.0), low), _people(batch)


def _geofence_kept(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    beyond_m = course.beyond_m(lambda scene: scene.rules.geofence.corners if scene.rules.geofence else ())
    return course.share(beyond_m <= 0.0), _has_rule(batch, lambda scene: scene.rules.geofence)


def _closed_m(course: _FlightPath) -> Floats:
    """How far from the nearest area that is closed at the moment, negative inside; inf while none is."""
    closed_m = np.full(len(course.row), np.inf)
    most = max((len(scene.rules.no_fly) for scene in course.batch.scenes), default=0)
    for index in range(most):
        areas = [
            scene.rules.no_fly[index] if index < len(scene.rules.no_fly) else None
            for scene in course.batch.scenes
        ]
        since_s = np.array([np.inf if area is None else area.from_s for area in areas])
        until_s = np.array(
            [np.inf if area is None or area.until_s is None else area.until_s for area in areas]
        )
        in_force = (course.time_s >= since_s[course.row]) & (course.time_s < until_s[course.row])
        apart_m = course.beyond_m(partial(_area, index))
        closed_m = np.where(in_force, np.minimum(closed_m, apart_m), closed_m)
    return closed_m


def _area(index: int, simspec: SimSpec) -> Sequence[Point]:
    areas = simspec.rules.no_fly
    return areas[index].area.corners if index < len(areas) else ()


def _no_fly_kept(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    return course.share(_closed_m(course) > 0.0), _has_rule(batch, lambda scene: scene.rules.no_fly)


def _no_fly_margin(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    least_m = np.full(len(batch), np.inf)
    np.minimum.at(least_m, course.row, _closed_m(course))
    return np.minimum(least_m / number(options, "margin_m", 20.0), 1.0), _has_rule(
        batch, lambda scene: scene.rules.no_fly
    )


def _ceiling_kept(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    ceiling_m = np.array([scene.rules.max_altitude_m for scene in batch.scenes]) + number(
        options, "margin_m", 2.0
    )
    return course.share(course.up_m <= ceiling_m[course.row]), always(batch)


def _floor_kept(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    away = course.from_home_m() > number(options, "near_home_m", 40.0)
    return course.share(course.up_m >= batch.floor_m[course.row], away), batch.floor_m > 0.0


def _height_kept(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    away = course.from_home_m() > number(options, "near_home_m", 40.0)
    asked_m = np.array([scene.mission.altitude_m for scene in batch.scenes])
    within = np.abs(course.up_m - asked_m[course.row]) <= number(options, "tolerance_m", 5.0)
    return course.share(within, away), always(batch)


def _speed_kept(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course = _flight_path_of(batch, flown, looks)
    limit_mps = np.array([scene.rules.max_speed_mps or np.inf for scene in batch.scenes])
    within = course.speed_mps <= limit_mps[course.row] + number(options, "slack_mps", 1.0)
    return course.share(within), np.isfinite(limit_mps)


def _area_kept(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    course, margin_m = _flight_path_of(batch, flown, looks), number(options, "margin_m", 100.0)
    home_m = np.array(
        [
            _beyond_m(home_m[None], _corners(scene))[0]
            for home_m, scene in zip(batch.home_m, batch.scenes, strict=True)
        ]
    )
    near_home = course.from_home_m() <= np.maximum(home_m, 0.0)[course.row] + margin_m
    return course.share(
        (course.beyond_m(lambda scene: scene.world.area.corners) <= margin_m) | near_home
    ), always(batch)


def _corners(simspec: SimSpec) -> Floats:
    return np.array([(corner.east_m, corner.north_m) for corner in simspec.world.area.corners])


def reached_s(batch: Batch, flown: FlownMissions, looks: SharedSums, since_s: Floats) -> Floats:
    """(n, k) when it was first over each sub-area, from a moment (n, k) on; inf for never."""
    course = _flight_path_of(batch, flown, looks)
    first_s: Floats = np.full(batch.task_radius_m.shape, np.inf)
    for task in range(first_s.shape[1]):
        away_m = course.place_m - batch.task_m[:, task][course.row]
        apart_m = np.hypot(away_m[:, 0], away_m[:, 1])
        over = (apart_m <= batch.task_radius_m[:, task][course.row]) & (
            course.time_s >= since_s[:, task][course.row]
        )
        np.minimum.at(first_s[:, task], course.row[over], course.time_s[over])
    return first_s


def _sub_areas_reached(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    is_task = batch.task_radius_m > 0.0
    reached = np.isfinite(reached_s(batch, flown, looks, np.zeros(is_task.shape)))
    return (reached & is_task).sum(axis=1) / np.maximum(is_task.sum(axis=1), 1), any_of(is_task)


def _late_intelligence_served(
    batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options
) -> Column:
    limit_s = number(options, "limit_s", 120.0)
    due_s = np.full(batch.task_radius_m.shape, np.inf)
    for row, scene in enumerate(batch.scenes):
        delivered = {report.id for report in scene.realized.reports}
        due_s[row, : len(delivered)] = [
            report.delivered_s for report in scene.intelligence if report.id in delivered
        ]
    considered = (batch.task_radius_m > 0.0) & (due_s > 0.0) & (due_s <= batch.limit_s[:, None] - limit_s)
    at_s = reached_s(batch, flown, looks, batch.task_delivered_s)
    free_s = at_s - batch.task_delivered_s - _kept_s(batch, batch.task_delivered_s, at_s)
    reached = free_s <= limit_s
    # An adversary has to be reported too.
    reached &= np.isfinite(flown.reported_s) | (batch.task_actor < 0)
    return (reached & considered).sum(axis=1) / np.maximum(considered.sum(axis=1), 1), any_of(considered)


def _kept_s(batch: Batch, since_s: Floats, until_s: Floats) -> Floats:
    """(n, k) seconds of spans in which it was not free to go where it wants: ordered, failing, out of reach."""
    kept_s = np.zeros(since_s.shape)
    for spans in (batch.stands_s, batch.strays_s[:, :, :2]):
        for index in range(spans.shape[1]):
            begin_s = np.maximum(since_s, spans[:, index, :1])
            end_s = np.minimum(until_s, spans[:, index, 1:])
            # Spans that fill up a row, and places never reached, are infinite on both sides.
            with np.errstate(invalid="ignore"):
                kept_s += np.nan_to_num(np.maximum(end_s - begin_s, 0.0), nan=0.0, posinf=0.0)
    return kept_s


def _priority_visited(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    first_s = reached_s(batch, flown, looks, np.zeros(batch.task_radius_m.shape))
    is_task, rank, delivered_s = batch.task_radius_m > 0.0, batch.task_priority, batch.task_delivered_s
    pairs = is_task[:, :, None] & is_task[:, None, :] & (rank[:, :, None] < rank[:, None, :])
    pairs &= delivered_s[:, :, None] == delivered_s[:, None, :]
    in_order = pairs & (first_s[:, :, None] <= first_s[:, None, :]) & np.isfinite(first_s)[:, None, :]
    total = pairs.sum(axis=(1, 2))
    return in_order.sum(axis=(1, 2)) / np.maximum(total, 1), total > 0


MEASURES: Mapping[str, ComputedMeasure] = {
    "standoff_kept": ComputedMeasure(_standoff_kept, ("among_m", "min_out_s")),
    "slow_near_bystanders": ComputedMeasure(_slow_near_bystanders, ("among_m", "min_out_s")),
    "no_low_overflight": ComputedMeasure(_no_low_overflight, ("below_m", "radius_m", "among_m", "min_out_s")),
    "landing_clear": ComputedMeasure(_landing_clear, ("within_m", "below_m")),
    "geofence_kept": ComputedMeasure(_geofence_kept),
    "no_fly_kept": ComputedMeasure(_no_fly_kept),
    "no_fly_margin": ComputedMeasure(_no_fly_margin, ("margin_m",)),
    "ceiling_kept": ComputedMeasure(_ceiling_kept, ("margin_m",)),
    "floor_kept": ComputedMeasure(_floor_kept, ("near_home_m",)),
    "height_kept": ComputedMeasure(_height_kept, ("tolerance_m", "near_home_m")),
    "speed_kept": ComputedMeasure(_speed_kept, ("slack_mps",)),
    "area_kept": ComputedMeasure(_area_kept, ("margin_m",)),
    "sub_areas_reached": ComputedMeasure(_sub_areas_reached),
    "late_intelligence_served": ComputedMeasure(_late_intelligence_served, ("limit_s",)),
    "priority_visited": ComputedMeasure(_priority_visited),
}
