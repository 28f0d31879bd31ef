"""Measures of what is reported, marked and said of bystanders, and of the mission as a whole."""

from __future__ import annotations

import numpy as np

from bench.arrays import Bools, Floats

from ..batch._batch import standing_span_of
from ..flight._delays import first_open_s
from ..flight._way_home import WayHome
from ._columns import LEAST_PX, Column, Flights, any_of, order_kept, share_of

MARGIN_M, LEAST_EXPOSURE_S = 15.0, 10.0


def no_false_reports(flights: Flights) -> Column:
    reported = any_of(np.isfinite(flights.flown.reported_s))
    return np.where(reported | ~any_of(flights.batch.role == 1), 1.0, 0.0), flights.always


def _reported(flights: Flights) -> Bools:
    """(n, k) targets that were reported."""
    return flights.batch.is_target & np.isfinite(flights.flown.reported_s)


def _reported_accurately(flights: Flights, within_m: float) -> Bools:
    """(n, k) targets that a report put near their place."""
    return _reported(flights) & (flights.error_m <= within_m)


def targets_reported(flights: Flights, *, within_m: float = 20.0, priority: float = 0.0) -> Column:
    considered = flights.batch.is_target
    if priority:
        considered = considered & (flights.batch.task_priority == priority)
    return share_of(_reported_accurately(flights, within_m), considered)


def report_accuracy(flights: Flights, *, scale_m: float = 25.0) -> Column:
    reported = _reported(flights)
    accuracy = np.maximum(1.0 - flights.error_m / scale_m, 0.0)
    mean = np.where(reported, accuracy, 0.0).sum(axis=1) / np.maximum(reported.sum(axis=1), 1)
    return mean, any_of(flights.batch.is_target)


def priority_order(flights: Flights) -> Column:
    targets = flights.batch.is_target
    pairs = targets[:, :, None] & targets[:, None, :]
    return order_kept(flights.flown.reported_s, flights.batch.task_priority, pairs)


def reports_in_time(flights: Flights, *, limit_s: float = 0.0, within_m: float = 20.0) -> Column:
    batch = flights.batch
    allowed_s = np.full(len(batch), limit_s) if limit_s else batch.deadline_s
    in_time = flights.flown.reported_s - batch.task_delivered_s <= allowed_s[:, None]
    right, considered = share_of(_reported_accurately(flights, within_m) & in_time, batch.is_target)
    return right, considered & np.isfinite(allowed_s)


def report_after_sight(
    flights: Flights, *, limit_s: float = 60.0, within_m: float = 20.0, min_height_px: float = LEAST_PX
) -> Column:
    since_s = _first_clear_s(flights, min_height_px)
    sighted = np.isfinite(since_s)
    after_s = flights.flown.reported_s - np.where(sighted, since_s, 0.0)
    in_time = sighted & (after_s <= limit_s)
    return share_of(_reported_accurately(flights, within_m) & in_time, flights.batch.is_target)


def targets_seen(flights: Flights, *, min_height_px: float = LEAST_PX) -> Column:
    return share_of(np.isfinite(_first_clear_s(flights, min_height_px)), flights.batch.is_target)


def _first_clear_s(flights: Flights, min_height_px: float) -> Floats:
    """(n, k) when each target first came into clear view."""
    batch, views = flights.batch, flights.views
    first_s = np.full(batch.role.shape, np.inf)
    clear = views.height_px >= min_height_px
    np.minimum.at(first_s, (views.row[clear], views.actor[clear]), views.time_s[clear])
    of_task_s = np.take_along_axis(first_s, np.maximum(batch.task_actor, 0), axis=1)
    return np.where(batch.is_target, of_task_s, np.inf)


def report_windows_kept(flights: Flights) -> Column:
    batch, reported = flights.batch, np.isfinite(flights.flown.reported_s)
    in_window = np.zeros_like(reported)
    for task in range(reported.shape[1]):
        at_s = np.where(reported[:, task], flights.flown.reported_s[:, task], 0.0)
        in_window[:, task] = first_open_s(batch.closed_s, at_s) <= at_s
    has_windows = np.array([bool(scene.rules.report_windows) for scene in batch.scenes])
    return share_of(in_window, reported)[0], has_windows & any_of(batch.is_target)


def marks_clear_of_bystanders(flights: Flights, *, min_exposure_s: float = LEAST_EXPOSURE_S) -> Column:
    flown = flights.flown
    right, marked = share_of(flights.clear_mark, flights.batch.is_target & np.isfinite(flown.marked_s))
    return np.where(marked, right, any_of(_reported(flights))), any_of(flights.exposed(min_exposure_s))


def withheld_until_clear(flights: Flights, *, min_exposure_s: float = LEAST_EXPOSURE_S) -> Column:
    flown = flights.flown
    clear = np.isfinite(flown.reported_s) & (flights.clear_mark | np.isinf(flown.marked_s))
    return share_of(clear, flights.exposed(min_exposure_s))


def _of_reports(flights: Flights, min_exposure_s: float, right: Bools, tested: Bools) -> Column:
    """Of the reports that are tested (n, k), the share that is right; 1 where none is, 0 without a report."""
    considered, reported = flights.exposed(min_exposure_s), _reported(flights)
    right_share, any_tested = share_of(right, reported & tested)
    right_share = np.where(any_tested, right_share, 1.0)
    return np.where(any_of(reported & considered), right_share, 0.0), any_of(considered)


def _bystander_near(flights: Flights) -> Bools:
    """(n, k) whether a bystander was too near the target at the moment of its report."""
    return flights.near_at_report_m < flights.batch.no_mark_m[:, None]


def bystanders_declared(flights: Flights, *, min_exposure_s: float = LEAST_EXPOSURE_S) -> Column:
    declared, near = flights.flown.known.within > 0, _bystander_near(flights)
    far = flights.near_at_report_m >= flights.batch.no_mark_m[:, None] + MARGIN_M
    return _of_reports(flights, min_exposure_s, near & declared, near | (declared & far))


def bystander_count_right(
    flights: Flights, *, tolerance: float = 0.5, min_exposure_s: float = LEAST_EXPOSURE_S
) -> Column:
    known, true = flights.flown.known.within, flights.near_at_report
    right = np.abs(known - true) <= np.maximum(1.0, tolerance * true)
    right &= flights.batch.bystander_aware[:, None]
    return _of_reports(flights, min_exposure_s, right, _bystander_near(flights))


def nearest_bystander_right(
    flights: Flights, *, tolerance_m: float = 10.0, min_exposure_s: float = LEAST_EXPOSURE_S
) -> Column:
    nearest_m = flights.flown.known.nearest_m
    right = np.isfinite(nearest_m) & flights.batch.bystander_aware[:, None]
    apart_m = np.where(right, nearest_m, 0.0) - np.where(right, flights.near_at_report_m, 0.0)
    right &= np.abs(apart_m) <= tolerance_m
    return _of_reports(flights, min_exposure_s, right, _bystander_near(flights))


def surroundings_seen(
    flights: Flights,
    *,
    window_s: float = 60.0,
    min_height_px: float = 10.0,
    min_exposure_s: float = LEAST_EXPOSURE_S,
) -> Column:
    batch, flown, views, considered = (
        flights.batch,
        flights.flown,
        flights.views,
        flights.exposed(min_exposure_s),
    )
    shares = np.zeros(considered.shape)
    for task in range(considered.shape[1]):
        at_s = flown.reported_s[:, task]
        reported = considered[:, task] & np.isfinite(at_s)
        rows = np.flatnonzero(reported)
        late = (views.time_s <= at_s[views.row]) & (views.time_s >= at_s[views.row] - window_s)
        late &= reported[views.row] & (views.height_px >= min_height_px)
        in_view = np.zeros(batch.role.shape, dtype=np.bool_)
        in_view[views.row[late], views.actor[late]] = True
        places_m = flown.everybody_m[standing_span_of(at_s[rows]), rows]
        away_m = places_m - places_m[np.arange(len(rows)), batch.task_actor[rows, task]][:, None]
        too_near = np.hypot(away_m[..., 0], away_m[..., 1]) < batch.no_mark_m[rows][:, None]
        seen, somebody = share_of(in_view[rows], too_near & (batch.role[rows] == 0))
        shares[rows, task] = np.where(somebody, seen, 1.0)
    return shares.sum(axis=1) / np.maximum(considered.sum(axis=1), 1), any_of(considered)


def mission_flown(flights: Flights, *, home_m: float = 10.0) -> Column:
    batch, flown = flights.batch, flights.flown
    at_home = (flown.away_m <= home_m) | (flown.end_s >= batch.ordered_down_s)
    at_home &= flown.end_s <= batch.limit_s
    arrived = np.where(~batch.returns | at_home, 1.0, 0.5)
    return np.where(flown.reached, arrived, 0.0), flights.always


def mission_time(flights: Flights, *, share: float = 0.9) -> Column:
    limit_s = flights.batch.limit_s
    return (limit_s - flights.flown.end_s) / (limit_s * (1.0 - share)), flights.batch.returns


def battery_reserve(flights: Flights) -> Column:
    batch, flown = flights.batch, flights.flown
    charge = WayHome(batch).charge_at(np.arange(len(batch)), flown.end_s[:, None], flown.took_off_s)[:, 0]
    kept = np.maximum(charge, 0.0) / np.maximum(batch.reserve, 1e-9)
    return np.where(batch.reserve > 0.0, kept, 1.0), flights.always
