"""How far its own position is off, by actors whose places are known: what a pilot reads off a map."""

from __future__ import annotations

from collections import deque

import numpy as np

from bench.arrays import Floats

from ..reference.flight._paths import Place

# Looks of so long are taken together: satellite navigation of campaign standard wanders with a time of 60 s, so that
# it moves by some 0.5 m meanwhile.
WINDOW_S = 12.0
# So far off at most: four times what it wanders there. Then the grid of offsets, and how many looks have to agree.
# Chosen, not measured.
REACH_M, GRID_M, LEAST_LOOKS = 8.0, 1.0, 15


class OwnError:
    """Offsets between where actors seem to be and where they are; the commonest one is its own error.

    Who is seen is not known. A wrong pair of two actors has an offset of its own, and the right pairs share one.
    """

    def __init__(self) -> None:
        self._looks: deque[tuple[float, Floats]] = deque()

    def take(self, time_s: float, seen_m: Floats, known_m: Floats) -> None:
        """One frame: places (k, 2) at which something seems to be, and the places (n, 2) of all actors."""
        offsets = (seen_m[:, None] - known_m[None]).reshape(-1, 2)
        self._looks.append((time_s, offsets[np.hypot(offsets[:, 0], offsets[:, 1]) <= REACH_M]))
        while self._looks[0][0] < time_s - WINDOW_S:
            self._looks.popleft()

    def estimate_m(self, now_s: float) -> Place | None:
        """East and north that its own position is off by; None where too few looks agree."""
        recent = [offsets for time_s, offsets in self._looks if time_s >= now_s - WINDOW_S]
        offsets = np.concatenate(recent) if recent else np.zeros((0, 2))
        if len(offsets) < LEAST_LOOKS:
            return None
        steps = round(2.0 * REACH_M / GRID_M)
        bounds = [[-REACH_M, REACH_M]] * 2
        counts, east_m, north_m = np.histogram2d(offsets[:, 0], offsets[:, 1], bins=steps, range=bounds)
        column, row = np.unravel_index(int(counts.argmax()), counts.shape)
        center = np.array([east_m[column], north_m[row]]) + GRID_M / 2.0
        # Twice, because the true offset can lie near the edge of its cell.
        for _ in range(2):
            agreeing = offsets[np.linalg.norm(offsets - center, axis=1) <= GRID_M]
            center = agreeing.mean(axis=0)
        return (float(center[0]), float(center[1])) if len(agreeing) >= LEAST_LOOKS else None
