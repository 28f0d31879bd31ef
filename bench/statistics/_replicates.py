"""Interval of a mean score for the same design flown again with new seeds (docs/rulings.md 31).

The design points are fixed: only replicates vary. The mean is a ratio of two sums, over the runs that have a score, so its
variance is that of its linearized residuals within design points: Cochran, W. G. (1977), Sampling Techniques, 3rd edition,
sections 5A.1 and 6.4.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from bench.arrays import Counts, Floats

from ._intervals import CONFIDENCE_LEVEL

# With fewer, Student's quantile is above 2.6 and an interval says little. Chosen, not measured.
MIN_DEGREES_OF_FREEDOM = 5


def replicate_interval(
    total: Floats, squared: Floats, scored: Counts, runs: Counts, level: float = CONFIDENCE_LEVEL
) -> tuple[Floats, Floats]:
    """Two-sided interval of each node's mean over the runs that have a score.

    All arguments are (design points, nodes): sum and sum of squares of the scores, number of runs with a score, number of
    considered runs. NaN where too few design points have a score more than once. Design points with a single run are taken to
    vary as the others do.
    """
    all_runs, all_scored = runs.sum(axis=0), np.maximum(scored.sum(axis=0), 1)
    mean = total.sum(axis=0) / all_scored
    residual, residuals_squared = total - mean * scored, squared - 2.0 * mean * total + mean**2 * scored
    replicated = runs >= 2
    within = np.maximum(residuals_squared - residual**2 / np.maximum(runs, 1), 0.0)
    variance = np.where(replicated, runs / np.maximum(runs - 1, 1) * within, 0.0).sum(axis=0)
    replicated_runs = np.where(replicated, runs, 0).sum(axis=0)
    # Of runs with a score: the others have no residual, so they tell nothing about how scores vary.
    free = np.maximum(scored - 1, 0).sum(axis=0)
    spread = np.sqrt(variance * all_runs / np.maximum(replicated_runs, 1)) / all_scored
    known = free >= MIN_DEGREES_OF_FREEDOM
    half_width = np.where(known, stats.t.ppf(0.5 + level / 2.0, np.maximum(free, 1)) * spread, np.nan)
    # Rounded, because sums over rows in another order differ in their last bits.
    return np.round(mean - half_width, 9), np.round(mean + half_width, 9)
