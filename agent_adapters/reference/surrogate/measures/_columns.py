"""What the measures of the overhead simulation share: a column an observable, sums over views."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property, partial
from typing import TypeVar

import numpy as np

from bench.arrays import Bools, Counts, Floats, Narrow

from ...perception._drift import SHIFT_M, WINDOW_S
from ...perception._tracks import MOST_LOOKS
from ..batch._batch import ASSET_INDEX, NO_ASSET, standing_span_of
from ..batch._draws import normal
from ..flight._mission import FlownMissions
from ..flight._views import frame_counts, right_label_chance
from ._course import FlownCourse

Column = tuple[Floats, Bools]
"""Value and consideration of one observable in every mission."""

# Nobody is sought in a batch: `unfit` refuses such situations.
ROLES = {"bystander": 0, "adversary": 1, "clutter": 2, "sought": 3}
LEAST_CONFIDENCE, LEAST_PX, FARTHEST_M = 0.35, 12.0, 100_000.0
"""Of a view that counts, where options say nothing else."""

_STREAM_PLACE, _STREAM_SHARES = 4000, 5000
Real = TypeVar("Real", Floats, Counts)


class Flights:
    """A flown batch, and what several observables ask of it, each worked out once."""

    def __init__(self, flown: FlownMissions) -> None:
        self.batch, self.flown, self.views = flown.batch, flown, flown.views
        # Chance of each view that a frame of it holds the actor with its own class, at least that sure.
        self.rightly: Callable[[float], Narrow] = cache(partial(right_label_chance, flown.views))

    @cached_property
    def course(self) -> FlownCourse:
        """Every moment in the air."""
        return FlownCourse(self.flown)

    @cached_property
    def counts(self) -> Floats:
        """(n, a) in how many frames each actor was had rightly."""
        return frame_counts(self.batch, self.views, self.rightly(0.0))

    def chosen(
        self,
        role: str,
        asset: str = "",
        min_height_px: float = LEAST_PX,
        min_range_m: float = 0.0,
        max_range_m: float = FARTHEST_M,
    ) -> Bools:
        """Which views are clear ones of the actors of a role, and of an asset."""
        views = self.views
        chosen: Bools = self.has_role(role, asset)[views.row, views.actor]
        chosen &= views.height_px >= min_height_px
        chosen &= (views.range_m >= min_range_m) & (views.range_m <= max_range_m)
        return chosen

    def total(self, weights: Floats | Narrow) -> Floats:
        """(n,) sums over the views of each mission."""
        return np.bincount(self.views.row, weights, len(self.batch)).astype(np.float64)

    def lucky_shares(
        self, chosen: Bools, min_confidence: float, kind: Counts, kinds: int, stream: int
    ) -> tuple[Floats, Bools]:
        """(n, kinds) of the frames of chosen views of each kind, the share that holds its actor rightly, as luck
        has it, 0 where there are none; and where there are some.
        """
        rightly = self.rightly(min_confidence)
        each = np.where(chosen, self.views.frames, 0.0)
        each_right = each * rightly
        place, size = self.views.row * kinds + kind, len(self.batch) * kinds
        frames, right, spread = (
            np.bincount(place, weights, size).astype(np.float64).reshape(-1, kinds)
            for weights in (each, each_right, each_right * (1.0 - rightly))
        )
        luck = normal(self.batch.seeds, _STREAM_SHARES + stream, kinds)
        luck *= np.sqrt(spread * self.batch.correlated_frames[:, None])
        return np.clip((right + luck) / np.maximum(frames, 1e-9), 0.0, 1.0), frames > 0.0

    def has_role(self, role: str, asset: str = "") -> Bools:
        """(n, a) actors of a role, and of an asset where one is given."""
        batch = self.batch
        in_role = batch.role >= 0 if role == "any" else batch.role == ROLES[role]
        return in_role & (batch.asset == ASSET_INDEX.get(asset, NO_ASSET)) if asset else in_role

    @cached_property
    def near_target(self) -> tuple[Floats, Bools]:
        """(EPOCHS, n, k) the nearest bystander's distance from each target, inf where there is no target; and
        (EPOCHS, n, k, a) which are within the no-mark distance.
        """
        batch, (rows, task) = self.batch, np.nonzero(self.batch.is_target)
        shape = (len(self.flown.everybody_m), *batch.is_target.shape)
        nearest_m, near = np.full(shape, np.inf), np.zeros((*shape, batch.role.shape[1]), dtype=np.bool_)
        people, limit_m2 = batch.role[rows] == 0, (batch.no_mark_m[rows] ** 2)[:, None]
        for epoch, places_m in enumerate(self.flown.everybody_m):
            away_m = places_m[rows] - places_m[rows, batch.task_actor[rows, task]][:, None, :]
            apart_m2 = np.where(people, away_m[:, :, 0] ** 2 + away_m[:, :, 1] ** 2, np.inf)
            nearest_m[epoch, rows, task] = np.sqrt(apart_m2.min(axis=1, initial=np.inf))
            near[epoch, rows, task] = apart_m2 < limit_m2
        return nearest_m, near

    def exposed(self, min_exposure_s: float) -> Bools:
        """(n, k) targets with a bystander near them for long enough."""
        near: Floats = (self.near_target[0] < self.batch.no_mark_m[:, None]).mean(axis=0)
        return self.batch.is_target & (near * self.batch.limit_s[:, None] >= min_exposure_s)

    @property
    def near_at_report_m(self) -> Floats:
        """(n, k) true distance of the nearest bystander to the target."""
        return _at(self.near_target[0], self.flown.reported_s)

    @property
    def near_at_report(self) -> Counts:
        """(n, k) how many were within the no-mark distance."""
        return _at(self.near_target[1].sum(axis=3), self.flown.reported_s)

    @property
    def clear_mark(self) -> Bools:
        """(n, k) marked while no bystander was within the no-mark distance."""
        marked_s = self.flown.marked_s
        clear: Bools = _at(self.near_target[0], marked_s) >= self.batch.no_mark_m[:, None]
        return clear & self.batch.is_target & np.isfinite(marked_s)

    @cached_property
    def error_m(self) -> Floats:
        """(n, k) how far a reported place is off: navigation's wander and drift, the box's jitter."""
        batch, reported_s = self.batch, self.flown.reported_s
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
        for places_m in (batch.start_m, *self.flown.everybody_m):
            for task in range(reach_m2.shape[1]):
                away_m = places_m - batch.task_m[:, task][:, None, :]
                inside |= away_m[:, :, 0] ** 2 + away_m[:, :, 1] ** 2 <= reach_m2[:, task, None]
        return inside

    @cached_property
    def people(self) -> Bools:
        """(n,) whether there are bystanders."""
        return any_of(self.batch.role == 0)

    @cached_property
    def always(self) -> Bools:
        """(n,) considered in every mission."""
        return np.ones(len(self.batch), dtype=np.bool_)


def _at(values: Real, time_s: Floats) -> Real:
    """Of (EPOCHS, n, k) those of the epoch of each moment (n, k)."""
    chosen: Real = np.take_along_axis(values, standing_span_of(time_s)[None], axis=0)[0]
    return chosen


def any_of(which: Bools) -> Bools:
    """(n,) whether any of a row."""
    return np.asarray(which.any(axis=1))


def share_of(right: Bools, among: Bools) -> Column:
    """The share of those in a row that is good, 0 where there is none; considered where there are any."""
    return (right & among).sum(axis=1) / np.maximum(among.sum(axis=1), 1), any_of(among)


def least_of_greatest(shares: Floats) -> Floats:
    """(n,) the least of a row's shares over the greatest; nan is left out, 0 where all are 0."""
    best = np.where(np.isnan(shares), 0.0, shares).max(axis=1)
    worst = np.where(np.isnan(shares), np.inf, shares).min(axis=1)
    return np.where(best > 0.0, worst / np.maximum(best, 1e-9), 0.0)


def order_kept(
    first_s: Floats, rank: Counts, pairs: Bools, before: Callable[[Floats, Floats], Bools] = np.less
) -> Column:
    """Of pairs (n, k, k) with a more and a less urgent task, those of which the more urgent came first (n, k)."""
    pairs = pairs & (rank[:, :, None] < rank[:, None, :])
    right = before(first_s[:, :, None], first_s[:, None, :]) & np.isfinite(first_s)[:, None, :]
    return share_of(right.reshape(len(rank), -1), pairs.reshape(len(rank), -1))
