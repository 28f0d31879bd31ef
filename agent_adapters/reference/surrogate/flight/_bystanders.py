"""Which bystanders near a target a surrogate knows of, and in how many frames anybody was had."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from bench.arrays import Counts, Floats, Narrow

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


def known_near(
    batch: Batch, seen: Sequence[Views], rows: Counts, task: Counts, until_s: Floats, places_m: Floats
) -> KnownBystanders:
    """Which of the bystanders at `places_m` (r, a, 2) were seen often enough on some stretches by `until_s` (r,)."""
    if not len(rows):
        return KnownBystanders.nobody((0,))
    limit_s = np.full(len(batch), -np.inf)
    limit_s[rows] = until_s
    early = Views.joined([views.where(views.time_s <= limit_s[views.row]) for views in seen])
    counts = frame_counts(batch, early, right_label_chance(early))[rows]
    target_m = places_m[np.arange(len(rows)), np.maximum(batch.task_actor[rows, task], 0)]
    apart_m = np.linalg.norm(places_m - target_m[:, None], axis=2)
    apart_m[(counts < BYSTANDER_FRAMES) | (batch.role[rows] != 0)] = np.inf
    within = (apart_m <= (batch.no_mark_m[rows] + DEFAULTS.bystander_margin_m)[:, None]).sum(axis=1)
    return KnownBystanders(within, apart_m.min(axis=1, initial=np.inf))


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
