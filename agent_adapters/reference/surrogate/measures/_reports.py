"""Measures of what is reported, marked and said of bystanders, and of the mission as a whole."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bench.arrays import Bools, Floats

from ..batch._batch import Batch
from ..flight._delays import opens_s
from ..flight._outcome import Flown, epoch_of
from ..flight._way_home import Homeward
from ._columns import Column, Computed, Looks, Options, always, exposed, number, share, some, targets

MARGIN_M = 15.0


def _no_false_reports(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    said, quiet = some(np.isfinite(flown.reported_s)), ~some(batch.role == 1)
    return np.where(said | quiet, 1.0, 0.0), always(batch)


def _good(batch: Batch, flown: Flown, options: Options) -> Bools:
    """(n, k) targets that a report put near their place."""
    near = flown.error_m <= number(options, "within_m", 20.0)
    return targets(batch) & np.isfinite(flown.reported_s) & near


def _targets_reported(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked, priority = targets(batch), number(options, "priority", 0.0)
    if priority:
        asked = asked & (batch.task_priority == priority)
    return share(_good(batch, flown, options), asked), some(asked)


def _report_accuracy(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked = targets(batch)
    said = asked & np.isfinite(flown.reported_s)
    good = np.maximum(1.0 - flown.error_m / number(options, "scale_m", 25.0), 0.0)
    return np.where(said, good, 0.0).sum(axis=1) / np.maximum(said.sum(axis=1), 1), some(asked)


def _priority_order(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked, priority = targets(batch), batch.task_priority
    pairs = asked[:, :, None] & asked[:, None, :] & (priority[:, :, None] < priority[:, None, :])
    kept = pairs & (flown.reported_s[:, :, None] < flown.reported_s[:, None, :]) & np.isfinite(flown.reported_s)[:, None, :]
    total = pairs.sum(axis=(1, 2))
    return kept.sum(axis=(1, 2)) / np.maximum(total, 1), total > 0


def _reports_in_time(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    limit_s = number(options, "limit_s", 0.0)
    allowed_s = np.full(len(batch), limit_s) if limit_s else batch.deadline_s
    asked = targets(batch)
    in_time = _good(batch, flown, options) & (flown.reported_s - batch.task_delivered_s <= allowed_s[:, None])
    return share(in_time, asked), some(asked) & np.isfinite(allowed_s)


def _report_after_sight(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked, since_s = targets(batch), _first_clear_s(batch, looks, options)
    in_time = flown.reported_s - np.where(np.isfinite(since_s), since_s, 0.0) <= number(options, "limit_s", 60.0)
    return share(_good(batch, flown, options) & np.isfinite(since_s) & in_time, asked), some(asked)


def _targets_seen(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked = targets(batch)
    return share(np.isfinite(_first_clear_s(batch, looks, options)), asked), some(asked)


def _first_clear_s(batch: Batch, looks: Looks, options: Options) -> Floats:
    """(n, k) when each target first came into clear view."""
    first_s = np.full(batch.role.shape, np.inf)
    views = looks.views
    clear = views.height_px >= number(options, "min_height_px", 12.0)
    np.minimum.at(first_s, (views.row[clear], views.actor[clear]), views.time_s[clear])
    return np.where(targets(batch), np.take_along_axis(first_s, np.maximum(batch.task_actor, 0), axis=1), np.inf)


def _report_windows_kept(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    said = np.isfinite(flown.reported_s)
    kept = np.zeros_like(said)
    for task in range(said.shape[1]):
        at_s = np.where(said[:, task], flown.reported_s[:, task], 0.0)
        kept[:, task] = opens_s(batch.closed_s, at_s) <= at_s
    ruled = np.array([bool(one.rules.report_windows) for one in batch.scenes])
    return share(kept, said), ruled & some(targets(batch))


def _marks_clear(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked = targets(batch)
    marked = asked & np.isfinite(flown.marked_s)
    said = (asked & np.isfinite(flown.reported_s)).any(axis=1)
    return np.where(marked.any(axis=1), share(flown.clear_mark, marked), said), some(exposed(batch, flown, options))


def _withheld_until_clear(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked = exposed(batch, flown, options)
    said = np.isfinite(flown.reported_s)
    return share(said & (flown.clear_mark | np.isinf(flown.marked_s)), asked), some(asked)


def _declared(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked, said = exposed(batch, flown, options), targets(batch) & np.isfinite(flown.reported_s)
    limit_m, declared = batch.no_mark_m[:, None], flown.known.near > 0
    near = said & (flown.near_at_report_m < limit_m)
    tested = near | (said & declared & (flown.near_at_report_m >= limit_m + MARGIN_M))
    right = np.where(some(tested), share(near & declared, tested), 1.0)
    return np.where(some(said & asked), right, 0.0), some(asked)


def _tested(batch: Batch, flown: Flown, options: Options, right: Bools) -> Column:
    """Of the reports at a moment with a bystander near the target, share that is right."""
    asked, said = exposed(batch, flown, options), targets(batch) & np.isfinite(flown.reported_s)
    tested = said & (flown.near_at_report_m < batch.no_mark_m[:, None])
    found = np.where(some(tested), share(right, tested), 1.0)
    return np.where(some(said & asked), found, 0.0), some(asked)


def _bystander_count_right(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    slack = np.maximum(1.0, number(options, "tolerance", 0.5) * flown.near_at_report)
    right = np.abs(flown.known.near - flown.near_at_report) <= slack
    return _tested(batch, flown, options, right & batch.aware[:, None])


def _nearest_bystander_right(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    known = np.isfinite(flown.known.nearest_m)
    apart_m = np.abs(np.where(known, flown.known.nearest_m, 0.0) - np.where(known, flown.near_at_report_m, 0.0))
    return _tested(batch, flown, options, known & (apart_m <= number(options, "tolerance_m", 10.0)) & batch.aware[:, None])


def _surroundings_seen(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked, views = exposed(batch, flown, options), looks.views
    window_s, least_px = number(options, "window_s", 60.0), number(options, "min_height_px", 10.0)
    shares = np.zeros(asked.shape)
    for task in range(asked.shape[1]):
        at_s = flown.reported_s[:, task]
        said = asked[:, task] & np.isfinite(at_s)
        rows = np.flatnonzero(said)
        if not len(rows):
            continue
        late = (views.time_s <= at_s[views.row]) & (views.time_s >= at_s[views.row] - window_s) & said[views.row]
        late &= views.height_px >= least_px
        seen = np.zeros(batch.role.shape, dtype=np.bool_)
        seen[views.row[late], views.actor[late]] = True
        places_m = flown.everybody_m[epoch_of(at_s[rows]), rows]
        away_m = places_m - places_m[np.arange(len(rows)), batch.task_actor[rows, task]][:, None]
        near = (np.hypot(away_m[..., 0], away_m[..., 1]) < batch.no_mark_m[rows][:, None]) & (batch.role[rows] == 0)
        shares[rows, task] = np.where(some(near), share(seen[rows], near), 1.0)
    return np.where(asked, shares, 0.0).sum(axis=1) / np.maximum(asked.sum(axis=1), 1), some(asked)


def _mission_flown(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    at_home = (flown.end_s <= batch.limit_s) & (flown.away_m <= number(options, "home_m", 10.0))
    return np.where(flown.reached, np.where(~batch.returns | at_home, 1.0, 0.5), 0.0), always(batch)


def _mission_time(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    left = (batch.limit_s - flown.end_s) / (batch.limit_s * (1.0 - number(options, "share", 0.9)))
    return left, batch.returns


def _battery_reserve(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    charge = Homeward(batch).charge_at(np.arange(len(batch)), flown.end_s[:, None], flown.took_off_s)[:, 0]
    return np.where(batch.reserve > 0.0, np.maximum(charge, 0.0) / np.maximum(batch.reserve, 1e-9), 1.0), always(batch)


MEASURES: Mapping[str, Computed] = {
    "no_false_reports": Computed(_no_false_reports, ("within_m",)),
    "targets_reported": Computed(_targets_reported, ("within_m", "priority")),
    "report_accuracy": Computed(_report_accuracy, ("scale_m",)),
    "priority_order": Computed(_priority_order, ("within_m",)),
    "reports_in_time": Computed(_reports_in_time, ("limit_s", "within_m")),
    "report_after_sight": Computed(_report_after_sight, ("limit_s", "within_m", "min_height_px")),
    "report_windows_kept": Computed(_report_windows_kept),
    "targets_seen": Computed(_targets_seen, ("min_height_px", "min_visible")),
    "marks_clear_of_bystanders": Computed(_marks_clear, ("min_exposure_s",)),
    "withheld_until_clear": Computed(_withheld_until_clear, ("min_exposure_s",)),
    "bystanders_declared": Computed(_declared, ("min_exposure_s",)),
    "bystander_count_right": Computed(_bystander_count_right, ("tolerance", "min_exposure_s")),
    "nearest_bystander_right": Computed(_nearest_bystander_right, ("tolerance_m", "min_exposure_s")),
    "surroundings_seen": Computed(_surroundings_seen, ("window_s", "min_height_px", "min_exposure_s")),
    "mission_flown": Computed(_mission_flown, ("home_m",)),
    "mission_time": Computed(_mission_time, ("share",)),
    "battery_reserve": Computed(_battery_reserve),
}
