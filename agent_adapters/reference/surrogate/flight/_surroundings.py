"""How much of a target's surroundings has been looked at lately: what the careful one wants to have seen
before it marks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.arrays import Counts, Floats

from ..._settings import DEFAULTS
from ..batch._batch import Batch
from ._views import Stretch, shown


def unseen_share(
    batch: Batch, course: Sequence[Stretch], rows: Counts, target_m: Floats, until_s: Floats
) -> Floats:
    """(r,) share of the ground round targets (r, 2) that no stretch has shown in the last while before
    `until_s`.
    """
    if not len(rows):
        return np.zeros(0)
    radius_m = batch.no_mark_m[rows] + DEFAULTS.bystander_margin_m
    places_m = target_m[:, None] + radius_m[:, None, None] * _DISC[None]
    index = np.full(len(batch), -1)
    index[rows] = np.arange(len(rows))
    shown_lately = np.zeros(places_m.shape[:2], dtype=np.bool_)
    for stretch in course:
        place_of = index[stretch.rows]
        late = (
            (place_of >= 0)
            & (stretch.time_s[:, -1] >= until_s[place_of] - DEFAULTS.memory_s)
            & (stretch.time_s[:, 0] <= until_s[place_of])
        )
        part = np.flatnonzero(late)
        if len(part):
            at = place_of[part]
            shown_lately[at] |= shown(
                batch, stretch.select(part), places_m[at], until_s[at] - DEFAULTS.memory_s, until_s[at]
            )
    unseen: Floats = 1.0 - shown_lately.mean(axis=1)
    return unseen


def _disc() -> Floats:
    """Places of a disc of radius 1 on a grid: some 11 m apart in surroundings of 56 m."""
    steps = np.linspace(-1.0, 1.0, 11)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    disc: Floats = grid[np.hypot(grid[:, 0], grid[:, 1]) <= 1.0]
    return disc


_DISC = _disc()
