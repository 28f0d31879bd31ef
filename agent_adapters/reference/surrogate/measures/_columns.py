"""What the measures of the overhead simulation share: a column an observable, sums over views."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property, partial

import numpy as np

from bench.arrays import Bools, Counts, Floats, Narrow

from ..batch._batch import ASSET_INDEX, NO_ASSET, Batch
from ..batch._draws import normal
from ..flight._bystanders import frame_counts
from ..flight._outcome import FlownMissions
from ..flight._views import right_label_chance
from ._course import FlownCourse

Column = tuple[Floats, Bools]
"""Value and consideration of one observable in every mission."""

# Nobody is sought in a batch: `unfit` refuses such situations.
ROLES = {"bystander": 0, "adversary": 1, "clutter": 2, "sought": 3}
LEAST_CONFIDENCE, LEAST_PX, FARTHEST_M = 0.35, 12.0, 100_000.0
"""Of a view that counts, where options say nothing else."""

_STREAM_SHARES = 5000


class Flights:
    """A flown batch, and what several observables ask of it, each worked out once."""

    def __init__(self, batch: Batch, flown: FlownMissions) -> None:
        self.batch, self.flown, self.views = batch, flown, flown.views
        # Chance of each view that a frame of it holds the actor with its own class, at least that sure.
        self.rightly: Callable[[float], Narrow] = cache(partial(right_label_chance, flown.views))

    @cached_property
    def course(self) -> FlownCourse:
        """Every moment in the air."""
        return FlownCourse(self.batch, self.flown)

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

    def exposed(self, min_exposure_s: float) -> Bools:
        """(n, k) targets with a bystander near them for long enough."""
        return self.batch.is_target & (self.flown.exposure_s >= min_exposure_s)

    @cached_property
    def people(self) -> Bools:
        """(n,) whether there are bystanders."""
        return any_of(self.batch.role == 0)

    @cached_property
    def always(self) -> Bools:
        """(n,) considered in every mission."""
        return np.ones(len(self.batch), dtype=np.bool_)


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
