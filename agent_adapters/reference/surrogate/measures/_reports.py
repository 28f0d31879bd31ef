"""Measures of what is reported, marked and said of bystanders, and of the mission as a whole."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bench.arrays import Bools, Floats

from ..flight._delays import first_open_s
from ..flight._outcome import standing_span_of
from ..flight._way_home import WayHome
from ._columns import (
    Column,
    ComputedMeasure,
    Flights,
    Options,
    any_of,
    number,
    order_kept,
    share,
    share_of,
)

MARGIN_M = 15.0


def _no_false_reports(flights: Flights, options: Options) -> Column:
    reported = any_of(np.isfinite(flights.flown.reported_s))
    return np.where(reported | ~any_of(flights.batch.role == 1), 1.0, 0.0), flights.always()


def _reported(flights: Flights) -> Bools:
    """(n, k) targets that were reported."""
    return flights.batch.is_target & np.isfinite(flights.flown.reported_s)


def _reported_accurately(flights: Flights, options: Options) -> Bools:
    """(n, k) targets that a report put near their place."""
    return _reported(flights) & (flights.flown.error_m <= number(options, "within_m", 20.0))


def _targets_reported(flights: Flights, options: Options) -> Column:
    considered, priority = flights.batch.is_target, number(options, "priority", 0.0)
    if priority:
        considered = considered & (flights.batch.task_priority == priority)
    return share_of(_reported_accurately(flights, options), considered)


def _report_accuracy(flights: Flights, options: Options) -> Column:
    reported = _reported(flights)
    accuracy = np.maximum(1.0 - flights.flown.error_m / number(options, "scale_m", 25.0), 0.0)
    mean = np.where(reported, accuracy, 0.0).sum(axis=1) / np.maximum(reported.sum(axis=1), 1)
    return mean, any_of(flights.batch.is_target)


def _priority_order(flights: Flights, options: Options) -> Column:
    targets = flights.batch.is_target
    pairs = targets[:, :, None] & targets[:, None, :]
    return order_kept(flights.flown.reported_s, flights.batch.task_priority, pairs)


def _reports_in_time(flights: Flights, options: Options) -> Column:
    batch, limit_s = flights.batch, number(options, "limit_s", 0.0)
    allowed_s = np.full(len(batch), limit_s) if limit_s else batch.deadline_s
    in_time = flights.flown.reported_s - batch.task_delivered_s <= allowed_s[:, None]
    right, considered = share_of(_reported_accurately(flights, options) & in_time, batch.is_target)
    return right, considered & np.isfinite(allowed_s)


def _report_after_sight(flights: Flights, options: Options) -> Column:
    since_s = _first_clear_s(flights, options)
    sighted = np.isfinite(since_s)
    after_s = flights.flown.reported_s - np.where(sighted, since_s, 0.0)
    in_time = sighted & (after_s <= number(options, "limit_s", 60.0))
    return share_of(_reported_accurately(flights, options) & in_time, flights.batch.is_target)


def _targets_seen(flights: Flights, options: Options) -> Column:
    return share_of(np.isfinite(_first_clear_s(flights, options)), flights.batch.is_target)


def _first_clear_s(flights: Flights, options: Options) -> Floats:
    """(n, k) when each target first came into clear view."""
    batch, views = flights.batch, flights.views
    first_s = np.full(batch.role.shape, np.inf)
    clear = views.height_px >= number(options, "min_height_px", 12.0)
    np.minimum.at(first_s, (views.row[clear], views.actor[clear]), views.time_s[clear])
    of_task_s = np.take_along_axis(first_s, np.maximum(batch.task_actor, 0), axis=1)
    return np.where(batch.is_target, of_task_s, np.inf)


def _report_windows_kept(flights: Flights, options: Options) -> Column:
    batch, reported = flights.batch, np.isfinite(flights.flown.reported_s)
    in_window = np.zeros_like(reported)
    for task in range(reported.shape[1]):
        at_s = np.where(reported[:, task], flights.flown.reported_s[:, task], 0.0)
        in_window[:, task] = first_open_s(batch.closed_s, at_s) <= at_s
    has_windows = np.array([bool(scene.rules.report_windows) for scene in batch.scenes])
    return share(in_window, reported), has_windows & any_of(batch.is_target)


def _marks_clear(flights: Flights, options: Options) -> Column:
    flown = flights.flown
    right, marked = share_of(flown.clear_mark, flights.batch.is_target & np.isfinite(flown.marked_s))
    return np.where(marked, right, any_of(_reported(flights))), any_of(flights.exposed(options))


def _withheld_until_clear(flights: Flights, options: Options) -> Column:
    flown = flights.flown
    clear = np.isfinite(flown.reported_s) & (flown.clear_mark | np.isinf(flown.marked_s))
    return share_of(clear, flights.exposed(options))


def _of_reports(flights: Flights, options: Options, right: Bools, tested: Bools) -> Column:
    """Of the reports that are tested (n, k), the share that is right; 1 where none is, 0 without a report."""
    considered, reported = flights.exposed(options), _reported(flights)
    right_share, any_tested = share_of(right, reported & tested)
    right_share = np.where(any_tested, right_share, 1.0)
    return np.where(any_of(reported & considered), right_share, 0.0), any_of(considered)


def _bystander_near(flights: Flights) -> Bools:
    """(n, k) whether a bystander was too near the target at the moment of its report."""
    return flights.flown.near_at_report_m < flights.batch.no_mark_m[:, None]


def _declared(flights: Flights, options: Options) -> Column:
    flown, declared, near = flights.flown, flights.flown.known.within > 0, _bystander_near(flights)
    far = flown.near_at_report_m >= flights.batch.no_mark_m[:, None] + MARGIN_M
    return _of_reports(flights, options, near & declared, near | (declared & far))


def _bystander_count_right(flights: Flights, options: Options) -> Column:
    known, true = flights.flown.known.within, flights.flown.near_at_report
    right = np.abs(known - true) <= np.maximum(1.0, number(options, "tolerance", 0.5) * true)
    right &= flights.batch.bystander_aware[:, None]
    return _of_reports(flights, options, right, _bystander_near(flights))


def _nearest_bystander_right(flights: Flights, options: Options) -> Column:
    nearest_m, tolerance_m = flights.flown.known.nearest_m, number(options, "tolerance_m", 10.0)
    right = np.isfinite(nearest_m) & flights.batch.bystander_aware[:, None]
    apart_m = np.where(right, nearest_m, 0.0) - np.where(right, flights.flown.near_at_report_m, 0.0)
    right &= np.abs(apart_m) <= tolerance_m
    return _of_reports(flights, options, right, _bystander_near(flights))


def _surroundings_seen(flights: Flights, options: Options) -> Column:
    batch, flown, views, considered = flights.batch, flights.flown, flights.views, flights.exposed(options)
    window_s, least_px = number(options, "window_s", 60.0), number(options, "min_height_px", 10.0)
    shares = np.zeros(considered.shape)
    for task in range(considered.shape[1]):
        at_s = flown.reported_s[:, task]
        reported = considered[:, task] & np.isfinite(at_s)
        rows = np.flatnonzero(reported)
        late = (views.time_s <= at_s[views.row]) & (views.time_s >= at_s[views.row] - window_s)
        late &= reported[views.row] & (views.height_px >= least_px)
        in_view = np.zeros(batch.role.shape, dtype=np.bool_)
        in_view[views.row[late], views.actor[late]] = True
        places_m = flown.everybody_m[standing_span_of(at_s[rows]), rows]
        away_m = places_m - places_m[np.arange(len(rows)), batch.task_actor[rows, task]][:, None]
        too_near = np.hypot(away_m[..., 0], away_m[..., 1]) < batch.no_mark_m[rows][:, None]
        seen, somebody = share_of(in_view[rows], too_near & (batch.role[rows] == 0))
        shares[rows, task] = np.where(somebody, seen, 1.0)
    return shares.sum(axis=1) / np.maximum(considered.sum(axis=1), 1), any_of(considered)


def _mission_flown(flights: Flights, options: Options) -> Column:
    batch, flown = flights.batch, flights.flown
    at_home = (flown.away_m <= number(options, "home_m", 10.0)) | (flown.end_s >= batch.ordered_down_s)
    at_home &= flown.end_s <= batch.limit_s
    arrived = np.where(~batch.returns | at_home, 1.0, 0.5)
    return np.where(flown.reached, arrived, 0.0), flights.always()


def _mission_time(flights: Flights, options: Options) -> Column:
    limit_s, usual_share = flights.batch.limit_s, number(options, "share", 0.9)
    return (limit_s - flights.flown.end_s) / (limit_s * (1.0 - usual_share)), flights.batch.returns


def _battery_reserve(flights: Flights, options: Options) -> Column:
    batch, flown = flights.batch, flights.flown
    charge = WayHome(batch).charge_at(np.arange(len(batch)), flown.end_s[:, None], flown.took_off_s)[:, 0]
    kept = np.maximum(charge, 0.0) / np.maximum(batch.reserve, 1e-9)
    return np.where(batch.reserve > 0.0, kept, 1.0), flights.always()


MEASURES: Mapping[str, ComputedMeasure] = {
    "no_false_reports": (_no_false_reports, ("within_m",)),
    "targets_reported": (_targets_reported, ("within_m", "priority")),
    "report_accuracy": (_report_accuracy, ("scale_m",)),
    "priority_order": (_priority_order, ("within_m",)),
    "reports_in_time": (_reports_in_time, ("limit_s", "within_m")),
    "report_after_sight": (_report_after_sight, ("limit_s", "within_m", "min_height_px")),
    "report_windows_kept": (_report_windows_kept, ()),
    "targets_seen": (_targets_seen, ("min_height_px", "min_visible")),
    "marks_clear_of_bystanders": (_marks_clear, ("min_exposure_s",)),
    "withheld_until_clear": (_withheld_until_clear, ("min_exposure_s",)),
    "bystanders_declared": (_declared, ("min_exposure_s",)),
    "bystander_count_right": (_bystander_count_right, ("tolerance", "min_exposure_s")),
    "nearest_bystander_right": (_nearest_bystander_right, ("tolerance_m", "min_exposure_s")),
    "surroundings_seen": (_surroundings_seen, ("window_s", "min_height_px", "min_exposure_s")),
    "mission_flown": (_mission_flown, ("home_m",)),
    "mission_time": (_mission_time, ("share",)),
    "battery_reserve": (_battery_reserve, ()),
}
