"""Whether failure goes with difficulty beyond chance, by shuffles of difficulties among design points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Bools, Counts, Floats

from . import DIFFICULTY_DECIMALS

# With fewer design points no slope is tested: by chance alone all would agree. Chosen, not measured.
MIN_DESIGN_POINTS = 5

# The least p is one in a thousand. Chosen, not measured.
SHUFFLES = 999


def shuffled_p(
    difficulty: Floats,
    failed: Bools,
    agents: Counts,
    points: Counts,
    *,
    seed: int = 0,
) -> float:
    """The two-sided p of the pairs of trials of an agent in which the harder one failed, less those in which the easier
    one did.

    `agents` and `points` are codes from 0. Difficulties are exchanged among the design points that the same agents
    flew: campaigns of different agents may differ in design. A design point whose trials differ in difficulty is moved
    as a whole, at its mean. The same arguments give the same p.
    """
    cells = np.unique(np.column_stack([points, difficulty.round(DIFFICULTY_DECIMALS)]), axis=0)
    count = int(points.max()) + 1
    mean = np.bincount(cells[:, 0].astype(np.int64), weights=cells[:, 1]) / np.bincount(
        cells[:, 0].astype(np.int64)
    )
    levels, level = np.unique(mean.round(DIFFICULTY_DECIMALS), return_inverse=True)
    failures, passes = np.zeros((2, int(agents.max()) + 1, count))
    np.add.at(failures, (agents, points), failed)
    np.add.at(passes, (agents, points), ~failed)
    at_level = np.eye(len(levels))

    def concordance(level_of_point: NDArray[np.intp]) -> float:
        failed, passed = failures @ at_level[level_of_point], passes @ at_level[level_of_point]
        passed_below, failed_below = (np.cumsum(counts, axis=1) - counts for counts in (passed, failed))
        return float((failed * passed_below - passed * failed_below).sum())

    # Counts are whole numbers: half of one is a slack that no rounding crosses.
    observed = abs(concordance(level)) - 0.5
    blocks = _blocks(failures + passes > 0.0)
    rng = np.random.default_rng(seed)
    reached = 0
    for _ in range(SHUFFLES):
        shuffled = level.copy()
        for block in blocks:
            shuffled[block] = level[rng.permutation(block)]
        reached += abs(concordance(shuffled)) >= observed
    return (1 + reached) / (1 + SHUFFLES)


def _blocks(flown: Bools) -> list[Counts]:
    """The design points that the same agents flew; `flown` is (agents, points)."""
    blocks: dict[bytes, list[int]] = {}
    for point, agents in enumerate(flown.T):
        blocks.setdefault(agents.tobytes(), []).append(point)
    return [np.array(points, dtype=np.int64) for points in blocks.values()]
