"""What came of a batch of missions, by the truth of the ground plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from bench.arrays import Bools, Counts, Floats

from ...perception._drift import SHIFT_M, WINDOW_S
from ...perception._tracks import MOST_LOOKS
from ..batch._batch import STANDING_S, STANDING_SPANS, Batch
from ..batch._draws import normal
from ._bystanders import KnownBystanders
from ._views import Stretch, Views

_STREAM_PLACE = 4000
Real = TypeVar("Real", Floats, Counts)


@dataclass(frozen=True)
class FlownMissions:
    """What came of a batch: what was done, beside where everybody was.

    Times are inf where something never happened; tasks are in the order of the SimSpec.
    """

    batch: Batch
    everybody_m: Floats  # (EPOCHS, n, a, 2)
    course: Sequence[Stretch]
    views: Views
    reported_s: Floats  # (n, k)
    marked_s: Floats  # (n, k)
    found_s: Floats  # (n, k)
    known: KnownBystanders  # (n, k) bystanders near the target, as known when it was reported
    reached: Bools  # (n,) some sub-area was flown to
    took_off_s: Floats  # (n,)
    end_s: Floats  # (n,)
    place_m: Floats  # (n, 2) at the end

    @property
    def away_m(self) -> Floats:
        """(n,) from home, at the end."""
        return np.asarray(np.hypot(*(self.place_m - self.batch.home_m).T))

    @cached_property
    def _near_target(self) -> tuple[Floats, Counts]:
        """(EPOCHS, n, k) the nearest bystander's distance from each target, and how many were within the no-mark
        distance; inf and 0 where there is no target.
        """
        batch, (rows, task) = self.batch, np.nonzero(self.batch.is_target)
        shape = (len(self.everybody_m), *self.reported_s.shape)
        nearest_m, within = np.full(shape, np.inf), np.zeros(shape, dtype=np.int64)
        people, limit_m2 = batch.role[rows] == 0, (batch.no_mark_m[rows] ** 2)[:, None]
        for epoch, places_m in enumerate(self.everybody_m):
            away_m = places_m[rows] - places_m[rows, batch.task_actor[rows, task]][:, None, :]
            apart_m2 = np.where(people, away_m[:, :, 0] ** 2 + away_m[:, :, 1] ** 2, np.inf)
            nearest_m[epoch, rows, task] = np.sqrt(apart_m2.min(axis=1, initial=np.inf))
            within[epoch, rows, task] = (apart_m2 < limit_m2).sum(axis=1)
        return nearest_m, within

    @property
    def exposure_s(self) -> Floats:
        """(n, k) how long a bystander was within the no-mark distance of the target."""
        near: Floats = (self._near_target[0] < self.batch.no_mark_m[:, None]).mean(axis=0)
        return near * self.batch.limit_s[:, None]

    @property
    def near_at_report_m(self) -> Floats:
        """(n, k) true distance of the nearest bystander to the target."""
        return _at(self._near_target[0], self.reported_s)

    @property
    def near_at_report(self) -> Counts:
        """(n, k) how many were within the no-mark distance."""
        return _at(self._near_target[1], self.reported_s)

    @property
    def clear_mark(self) -> Bools:
        """(n, k) marked while no bystander was within the no-mark distance."""
        clear: Bools = _at(self._near_target[0], self.marked_s) >= self.batch.no_mark_m[:, None]
        return clear & self.batch.is_target & np.isfinite(self.marked_s)

    @cached_property
    def error_m(self) -> Floats:
        """(n, k) how far a reported place is off: navigation's wander and drift, the box's jitter."""
        batch, reported_s = self.batch, self.reported_s
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
        return np.asarray(np.hypot(off_m[:, :, 0], off_m[:, :, 1]))

    @cached_property
    def entered(self) -> Bools:
        """(n, a) inside a sub-area at some moment."""
        batch = self.batch
        inside = np.zeros(batch.role.shape, dtype=np.bool_)
        reach_m2 = np.where(batch.task_radius_m > 0.0, batch.task_radius_m**2, -1.0)
        for places_m in (batch.start_m, *self.everybody_m):
            for task in range(reach_m2.shape[1]):
                away_m = places_m - batch.task_m[:, task][:, None, :]
                inside |= away_m[:, :, 0] ** 2 + away_m[:, :, 1] ** 2 <= reach_m2[:, task, None]
        return inside


def standing_span_of(time_s: Floats) -> Counts:
    """The epoch of each moment; the first for what never was."""
    return np.asarray(
        (np.where(np.isfinite(time_s), time_s, 0.0) // STANDING_S).astype(np.int64) % STANDING_SPANS
    )


def _at(values: Real, time_s: Floats) -> Real:
    """Of (EPOCHS, n, k) those of the epoch of each moment (n, k)."""
    chosen: Real = np.take_along_axis(values, standing_span_of(time_s)[None], axis=0)[0]
    return chosen
