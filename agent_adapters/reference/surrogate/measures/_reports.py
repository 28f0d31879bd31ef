"""Measures of what is reported, marked and said of bystanders, and of the mission as a whole."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bench.arrays import Bools, Floats

from ..batch._batch import Batch
from ..flight._delays import first_open_s
from ..flight._outcome import FlownMissions, standing_span_of
from ..flight._way_home import WayHome
from ._columns import (
    Column,
    ComputedMeasure,
    Options,
    SharedSums,
    always,
    any_of,
    exposed,
    number,
    share,
    targets,
)

MARGIN_M = 15.0


def _no_false_reports(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    reported, nobody_to_report = any_of(np.isfinite(flown.reported_s)), ~any_of(batch.role == 1)
    return np.where(reported | nobody_to_report, 1.0, 0.0), always(batch)


def _reported_accurately(batch: Batch, flown: FlownMissions, options: Options) -> Bools:
    """(n, k) targets that a report put near their place."""
    accurate = flown.error_m <= number(options, "within_m", 20.0)
    return targets(batch) & np.isfinite(flown.reported_s) & accurate


def _targets_reported(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    considered, priority = targets(batch), number(options, "priority", 0.0)
    if priority:
        considered = considered & (batch.task_priority == priority)
    return share(_reported_accurately(batch, flown, options), considered), any_of(considered)


def _report_accuracy(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    considered = targets(batch)
    reported = considered & np.isfinite(flown.reported_s)
    accuracy = np.maximum(1.0 - flown.error_m / number(options, "scale_m", 25.0), 0.0)
    return np.where(reported, accuracy, 0.0).sum(axis=1) / np.maximum(reported.sum(axis=1), 1), any_of(
        considered
    )


def _priority_order(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    considered, priority = targets(batch), batch.task_priority
    pairs = considered[:, :, None] & considered[:, None, :] & (priority[:, :, None] < priority[:, None, :])
    in_order = (
        pairs
        & (flown.reported_s[:, :, None] < flown.reported_s[:, None, :])
        & np.isfinite(flown.reported_s)[:, None, :]
    )
    total = pairs.sum(axis=(1, 2))
    return in_order.sum(axis=(1, 2)) / np.maximum(total, 1), total > 0


def _reports_in_time(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    limit_s = number(options, "limit_s", 0.0)
    allowed_s = np.full(len(batch), limit_s) if limit_s else batch.deadline_s
    considered = targets(batch)
    in_time = _reported_accurately(batch, flown, options) & (
        flown.reported_s - batch.task_delivered_s <= allowed_s[:, None]
    )
    return share(in_time, considered), any_of(considered) & np.isfinite(allowed_s)


def _report_after_sight(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    considered, since_s = targets(batch), _first_clear_s(batch, looks, options)
    in_time = flown.reported_s - np.where(np.isfinite(since_s), since_s, 0.0) <= number(
        options, "limit_s", 60.0
    )
    return share(
        _reported_accurately(batch, flown, options) & np.isfinite(since_s) & in_time, considered
    ), any_of(considered)


def _targets_seen(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    considered = targets(batch)
    return share(np.isfinite(_first_clear_s(batch, looks, options)), considered), any_of(considered)


def _first_clear_s(batch: Batch, looks: SharedSums, options: Options) -> Floats:
    """(n, k) when each target first came into clear view."""
    first_s = np.full(batch.role.shape, np.inf)
    views = looks.views
    clear = views.height_px >= number(options, "min_height_px", 12.0)
    np.minimum.at(first_s, (views.row[clear], views.actor[clear]), views.time_s[clear])
    return np.where(
        targets(batch), np.take_along_axis(first_s, np.maximum(batch.task_actor, 0), axis=1), np.inf
    )


def _report_windows_kept(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    reported = np.isfinite(flown.reported_s)
    in_window = np.zeros_like(reported)
    for task in range(reported.shape[1]):
        at_s = np.where(reported[:, task], flown.reported_s[:, task], 0.0)
        in_window[:, task] = first_open_s(batch.closed_s, at_s) <= at_s
    has_windows = np.array([bool(scene.rules.report_windows) for scene in batch.scenes])
    return share(in_window, reported), has_windows & any_of(targets(batch))


def _marks_clear(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    considered = targets(batch)
    marked = considered & np.isfinite(flown.marked_s)
    reported = (considered & np.isfinite(flown.reported_s)).any(axis=1)
    return np.where(marked.any(axis=1), share(flown.clear_mark, marked), reported), any_of(
        exposed(batch, flown, options)
    )


def _withheld_until_clear(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    considered = exposed(batch, flown, options)
    reported = np.isfinite(flown.reported_s)
    return share(reported & (flown.clear_mark | np.isinf(flown.marked_s)), considered), any_of(considered)


def _declared(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    considered, reported = exposed(batch, flown, options), targets(batch) & np.isfinite(flown.reported_s)
    limit_m, declared = batch.no_mark_m[:, None], flown.known.within > 0
    bystander_near = reported & (flown.near_at_report_m < limit_m)
    tested = bystander_near | (reported & declared & (flown.near_at_report_m >= limit_m + MARGIN_M))
    right = np.where(any_of(tested), share(bystander_near & declared, tested), 1.0)
    return np.where(any_of(reported & considered), right, 0.0), any_of(considered)


def _tested(batch: Batch, flown: FlownMissions, options: Options, right: Bools) -> Column:
    """Of the reports at a moment with a bystander near the target, share that is right."""
    considered, reported = exposed(batch, flown, options), targets(batch) & np.isfinite(flown.reported_s)
    tested = reported & (flown.near_at_report_m < batch.no_mark_m[:, None])
    right_share = np.where(any_of(tested), share(right, tested), 1.0)
    return np.where(any_of(reported & considered), right_share, 0.0), any_of(considered)


def _bystander_count_right(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    slack = np.maximum(1.0, number(options, "tolerance", 0.5) * flown.near_at_report)
    right = np.abs(flown.known.within - flown.near_at_report) <= slack
    return _tested(batch, flown, options, right & batch.bystander_aware[:, None])


def _nearest_bystander_right(
    batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options
) -> Column:
    known = np.isfinite(flown.known.nearest_m)
    apart_m = np.abs(
        np.where(known, flown.known.nearest_m, 0.0) - np.where(known, flown.near_at_report_m, 0.0)
    )
    return _tested(
        batch,
        flown,
        options,
        known & (apart_m <= number(options, "tolerance_m", 10.0)) & batch.bystander_aware[:, None],
    )


def _surroundings_seen(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    considered, views = exposed(batch, flown, options), looks.views
    window_s, least_px = number(options, "window_s", 60.0), number(options, "min_height_px", 10.0)
    shares = np.zeros(considered.shape)
    for task in range(considered.shape[1]):
        at_s = flown.reported_s[:, task]
        reported = considered[:, task] & np.isfinite(at_s)
        rows = np.flatnonzero(reported)
        if not len(rows):
            continue
        late = (
            (views.time_s <= at_s[views.row])
            & (views.time_s >= at_s[views.row] - window_s)
            & reported[views.row]
        )
        late &= views.height_px >= least_px
        in_view = np.zeros(batch.role.shape, dtype=np.bool_)
        in_view[views.row[late], views.actor[late]] = True
        places_m = flown.everybody_m[standing_span_of(at_s[rows]), rows]
        away_m = places_m - places_m[np.arange(len(rows)), batch.task_actor[rows, task]][:, None]
        too_near = (np.hypot(away_m[..., 0], away_m[..., 1]) < batch.no_mark_m[rows][:, None]) & (
            batch.role[rows] == 0
        )
        shares[rows, task] = np.where(any_of(too_near), share(in_view[rows], too_near), 1.0)
    return np.where(considered, shares, 0.0).sum(axis=1) / np.maximum(considered.sum(axis=1), 1), any_of(
        considered
    )


def _mission_flown(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    at_home = (flown.away_m <= number(options, "home_m", 10.0)) | (flown.end_s >= batch.ordered_down_s)
    at_home &= flown.end_s <= batch.limit_s
    return np.where(flown.reached, np.where(~batch.returns | at_home, 1.0, 0.5), 0.0), always(batch)


def _mission_time(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    left_share = (batch.limit_s - flown.end_s) / (batch.limit_s * (1.0 - number(options, "share", 0.9)))
    return left_share, batch.returns


def _battery_reserve(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    charge = WayHome(batch).charge_at(np.arange(len(batch)), flown.end_s[:, None], flown.took_off_s)[:, 0]
    return np.where(
        batch.reserve > 0.0, np.maximum(charge, 0.0) / np.maximum(batch.reserve, 1e-9), 1.0
    ), always(batch)


MEASURES: Mapping[str, ComputedMeasure] = {
    "no_false_reports": ComputedMeasure(_no_false_reports, ("within_m",)),
    "targets_reported": ComputedMeasure(_targets_reported, ("within_m", "priority")),
    "report_accuracy": ComputedMeasure(_report_accuracy, ("scale_m",)),
    "priority_order": ComputedMeasure(_priority_order, ("within_m",)),
    "reports_in_time": ComputedMeasure(_reports_in_time, ("limit_s", "within_m")),
    "report_after_sight": ComputedMeasure(_report_after_sight, ("limit_s", "within_m", "min_height_px")),
    "report_windows_kept": ComputedMeasure(_report_windows_kept),
    "targets_seen": ComputedMeasure(_targets_seen, ("min_height_px", "min_visible")),
    "marks_clear_of_bystanders": ComputedMeasure(_marks_clear, ("min_exposure_s",)),
    "withheld_until_clear": ComputedMeasure(_withheld_until_clear, ("min_exposure_s",)),
    "bystanders_declared": ComputedMeasure(_declared, ("min_exposure_s",)),
    "bystander_count_right": ComputedMeasure(_bystander_count_right, ("tolerance", "min_exposure_s")),
    "nearest_bystander_right": ComputedMeasure(_nearest_bystander_right, ("tolerance_m", "min_exposure_s")),
    "surroundings_seen": ComputedMeasure(_surroundings_seen, ("window_s", "min_height_px", "min_exposure_s")),
    "mission_flown": ComputedMeasure(_mission_flown, ("home_m",)),
    "mission_time": ComputedMeasure(_mission_time, ("share",)),
    "battery_reserve": ComputedMeasure(_battery_reserve),
}
