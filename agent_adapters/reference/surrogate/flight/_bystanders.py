"""Which bystanders near a target a surrogate knows of, and in how many frames anybody was had."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from bench.arrays import Bools, Counts, Floats, Narrow

from ..._settings import DEFAULTS
from ...perception._tracks import BYSTANDER_FRAMES
from ..batch._batch import Batch
from ..batch._draws import normal
from ._views import Views, right_label_chance

_LUCK_COUNT = 3000


@dataclass(frozen=True, slots=True)
class KnownBystanders:
    """How many bystanders are known near each target, and the nearest one's distance; inf for none."""

    within: Counts
    nearest_m: Floats

    @classmethod
    def nobody(cls, shape: tuple[int, ...]) -> Self:
        """Nothing is known yet."""
        return cls(np.zeros(shape, dtype=np.int64), np.full(shape, np.inf))

    def put(self, rows: Counts, task: Counts, known: KnownBystanders) -> None:
        """Remember what is known of some tasks."""
        self.within[rows, task], self.nearest_m[rows, task] = known.within, known.nearest_m


class SightingMemory:
    """What has been seen of everybody, stretch by stretch."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._luck = normal(batch.seeds, _LUCK_COUNT, batch.role.shape[1])
        self._views: list[Views] = []
        self._sums: list[tuple[Narrow, Narrow]] = []

    def add(self, views: Views) -> None:
        """One more stretch."""
        chance = right_label_chance(views)
        mean = views.frames * chance
        self._views.append(views)
        self._sums.append(
            (mean, mean * self._batch.correlated_frames.astype(np.float32)[views.row] * (1.0 - chance))
        )

    def keep(self, chosen: Bools) -> None:
        """Of the last stretch only some views were."""
        self._views[-1] = self._views[-1].where(chosen)
        mean, spread = self._sums[-1]
        self._sums[-1] = mean[chosen], spread[chosen]

    def known_near(
        self,
        rows: Counts,
        task: Counts,
        until_s: Floats,
        places_m: Floats,
        *,
        last_stretch_only: bool = False,
    ) -> KnownBystanders:
        """Which of the bystanders at `places_m` (r, a, 2) were seen often enough by `until_s` (r,); on the
        last stretch, if `last_stretch_only`.
        """
        if not len(rows):
            return KnownBystanders.nobody((0,))
        batch = self._batch
        enough = self._seen_enough(rows, until_s, since=-1 if last_stretch_only else 0) & (
            batch.role[rows] == 0
        )
        target_m = places_m[np.arange(len(rows)), np.maximum(batch.task_actor[rows, task], 0)]
        east_m, north_m = places_m[:, :, 0] - target_m[:, :1], places_m[:, :, 1] - target_m[:, 1:]
        apart_m = np.where(enough, np.sqrt(east_m * east_m + north_m * north_m), np.inf)
        within = (apart_m <= (batch.no_mark_m[rows] + DEFAULTS.bystander_margin_m)[:, None]).sum(axis=1)
        return KnownBystanders(within, apart_m.min(axis=1, initial=np.inf))

    def _seen_enough(self, rows: Counts, until_s: Floats, *, since: int) -> Bools:
        """(r, a) who was had in enough frames."""
        actors, batch = self._batch.role.shape[1], self._batch
        limit_s = np.full(len(batch), -np.inf)
        limit_s[rows] = until_s
        mean, spread = np.zeros(len(batch) * actors), np.zeros(len(batch) * actors)
        for views, (view_mean, view_spread) in zip(self._views[since:], self._sums[since:], strict=True):
            early = np.flatnonzero(views.time_s <= limit_s[views.row])
            if len(early):
                flat = views.row[early] * actors + views.actor[early]
                mean += np.bincount(flat, view_mean[early], len(mean))
                spread += np.bincount(flat, view_spread[early], len(spread))
        mean, spread = mean.reshape(-1, actors)[rows], spread.reshape(-1, actors)[rows]
        return np.asarray(mean + np.sqrt(spread) * self._luck[rows] >= BYSTANDER_FRAMES)


def frame_counts(batch: Batch, views: Views, chance: Narrow) -> Floats:
    """(n, a) in how many frames each actor was had, where `chance` is that of one frame of each view; with
    its luck.

    Misses hang together for a while, so the spread is that of as many looks as there are such whiles.
    """
    actors = batch.role.shape[1]
    flat = views.row * actors + views.actor
    size = len(batch) * actors
    mean = np.bincount(flat, views.frames * chance, size).reshape(-1, actors)
    spread = np.bincount(
        flat, views.frames * batch.correlated_frames[views.row] * chance * (1.0 - chance), size
    ).reshape(-1, actors)
    return mean + np.sqrt(spread) * normal(batch.seeds, _LUCK_COUNT, actors)
