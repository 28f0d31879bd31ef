"""What came of a batch of missions, by the truth of the ground plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Counts, Floats

from ...perception._drift import SHIFT_M, WINDOW_S
from ...perception._tracks import MOST_LOOKS
from ..batch._batch import STANDING_S, STANDING_SPANS, Batch
from ..batch._draws import normal
from ._bystanders import KnownBystanders
from ._views import Stretch, Views

_STREAM_PLACE = 4000


@dataclass(frozen=True, slots=True)
class FlownMissions:
    """What came of a batch.

    Times are inf where something never happened; tasks are in the order of the SimSpec.
    """

    reported_s: Floats  # (n, k)
    marked_s: Floats  # (n, k)
    found_s: Floats  # (n, k)
    known: KnownBystanders  # (n, k) bystanders near the target, as known when it was reported
    clear_mark: Bools  # (n, k) marked while no bystander was within the no-mark distance
    near_at_report_m: Floats  # (n, k) true distance of the nearest bystander to the target
    near_at_report: Counts  # (n, k) how many were within the no-mark distance
    error_m: Floats  # (n, k)
    exposure_s: Floats  # (n, k)
    entered: Bools  # (n, a) inside a sub-area at some moment
    reached: Bools  # (n,) some sub-area was flown to
    took_off_s: Floats  # (n,)
    place_m: Floats  # (n, 2) at the end
    away_m: Floats  # (n,) from home, then
    end_s: Floats  # (n,)
    everybody_m: Floats  # (EPOCHS, n, a, 2)
    course: Sequence[Stretch]
    views: Views


def outcome(
    batch: Batch,
    everybody_m: Floats,
    course: Sequence[Stretch],
    views: Views,
    *,
    reported_s: Floats,
    marked_s: Floats,
    found_s: Floats,
    known: KnownBystanders,
    reached: Bools,
    took_off_s: Floats,
    end_s: Floats,
    place_m: Floats,
) -> FlownMissions:
    """Put what was done beside where everybody was."""
    rows, task = np.nonzero(batch.is_target)
    shape = reported_s.shape
    near_m, exposure_s = np.full(shape, np.inf), np.zeros(shape)
    within, clear = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.bool_)
    limit_m = batch.no_mark_m[rows]
    apart_m2 = [_apart_m2(batch, rows, batch.task_actor[rows, task], places_m) for places_m in everybody_m]
    nearest_m = np.sqrt(np.stack([each.min(axis=1, initial=np.inf) for each in apart_m2]))
    counts = np.stack([(each < (limit_m**2)[:, None]).sum(axis=1) for each in apart_m2])
    exposure_s[rows, task] = (nearest_m < limit_m).mean(axis=0) * batch.limit_s[rows]
    span_at_report, here = standing_span_of(reported_s[rows, task]), np.arange(len(rows))
    near_m[rows, task], within[rows, task] = nearest_m[span_at_report, here], counts[span_at_report, here]
    clear[rows, task] = nearest_m[standing_span_of(marked_s[rows, task]), here] >= limit_m
    return FlownMissions(
        reported_s=reported_s,
        marked_s=marked_s,
        found_s=found_s,
        known=known,
        clear_mark=clear & np.isfinite(marked_s),
        near_at_report_m=near_m,
        near_at_report=within,
        error_m=_errors_m(batch, reported_s),
        exposure_s=exposure_s,
        entered=_entered(batch, everybody_m),
        reached=reached,
        took_off_s=took_off_s,
        place_m=place_m,
        away_m=np.hypot(*(place_m - batch.home_m).T),
        end_s=end_s,
        everybody_m=everybody_m,
        course=course,
        views=views,
    )


def standing_span_of(time_s: Floats) -> Counts:
    """The epoch of each moment; the first for what never was."""
    epoch: Counts = (np.where(np.isfinite(time_s), time_s, 0.0) // STANDING_S).astype(
        np.int64
    ) % STANDING_SPANS
    return epoch


def _errors_m(batch: Batch, reported_s: Floats) -> Floats:
    """How far a reported place is off: wander and drift of satellite navigation, and the box's jitter over
    several looks.
    """
    tasks = reported_s.shape[1]
    pixel_m = batch.jitter_px / batch.focal_px * batch.height_m / np.sin(batch.tilt_rad)
    sigma_m = np.sqrt(batch.gps_m**2 + pixel_m**2 / MOST_LOOKS)
    off_m = sigma_m[:, None, None] * normal(batch.seeds, _STREAM_PLACE, 2 * tasks).reshape(
        len(batch), tasks, 2
    )
    for drift in range(batch.drifts.shape[1]):
        since_s, until_s, *rates_mps = batch.drifts[:, drift].T
        during = (reported_s >= since_s[:, None]) & (reported_s < until_s[:, None])
        # A drift that the agent has noticed no longer moves its places.
        speed_mps = np.hypot(*rates_mps)
        noticed_s = np.where(
            speed_mps > SHIFT_M / WINDOW_S, since_s + SHIFT_M / np.maximum(speed_mps, 1e-9), np.inf
        )
        during &= reported_s < noticed_s[:, None]
        for axis, rate_mps in enumerate(rates_mps):
            gone_s = np.where(during, reported_s, 0.0) - np.where(during, since_s[:, None], 0.0)
            off_m[:, :, axis] += gone_s * np.where(np.isfinite(rate_mps), rate_mps, 0.0)[:, None]
    error_m: Floats = np.hypot(off_m[:, :, 0], off_m[:, :, 1])
    return error_m


def _entered(batch: Batch, everybody_m: Floats) -> Bools:
    inside = np.zeros(batch.role.shape, dtype=np.bool_)
    reach_m2 = np.where(batch.task_radius_m > 0.0, batch.task_radius_m**2, -1.0)
    for task in range(reach_m2.shape[1]):
        away_m = batch.start_m - batch.task_m[:, task][:, None, :]
        apart_m2 = away_m[:, :, 0] ** 2 + away_m[:, :, 1] ** 2
        inside |= apart_m2 <= reach_m2[:, task, None]
        may = (
            (batch.roam_m > 0.0)
            & (apart_m2 <= (batch.task_radius_m[:, task, None] + batch.roam_m) ** 2)
            & ~inside
        )
        row, actor = np.nonzero(may)
        for places_m in everybody_m:
            away_m = places_m[row, actor] - batch.task_m[row, task]
            inside[row, actor] |= away_m[:, 0] ** 2 + away_m[:, 1] ** 2 <= reach_m2[row, task]
    return inside


def _apart_m2(batch: Batch, rows: Counts, actor: Counts, places_m: Floats) -> Floats:
    """(r, a) squared distances from targets to bystanders; inf for everybody else."""
    away_m = places_m[rows] - places_m[rows, actor][:, None, :]
    apart_m2: Floats = np.where(batch.role[rows] == 0, away_m[:, :, 0] ** 2 + away_m[:, :, 1] ** 2, np.inf)
    return apart_m2
