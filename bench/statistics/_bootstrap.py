"""Intervals of mean scores by resampling design points: a cluster bootstrap, for all nodes at once.

Percentile intervals of a bootstrap are too short by the factor sqrt(n / (n - 1)) and by the normal's
quantiles in place of Student's. Hesterberg's "expanded percentile" interval corrects both in the levels at
which the percentiles are read. Hesterberg, T. C. (2015), "What teachers should know about the bootstrap", The
American Statistician 69(4), 371-386. Cameron, A. C., Gelbach, J. B. and Miller, D. L. (2008),
"Bootstrap-based improvements for inference with clustered errors", Review of Economics and Statistics 90(3),
414-427.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from scipy import stats

from bench.arrays import Counts, Floats

from ._intervals import CONFIDENCE_LEVEL

# Chosen, not measured.
RESAMPLES = 1000
# Below so many design points with a score a mean has no interval. With 5 of them 90 % of the intervals cover
# (docs/statistics.md).
MIN_DESIGN_POINTS = 5

# More design points are drawn in this many random groups: a group of clusters is a cluster too, and the work
# stays bounded.
MAX_CLUSTERS = 500

# Sums are rounded to millionths of a point, so that products are exact whatever order BLAS adds them in.
_QUANTUM = 2.0**20


def bootstrap_means(
    total: Floats, count: Counts, design_points: Sequence[str], level: float = CONFIDENCE_LEVEL
) -> tuple[Floats, Floats]:
    """Two-sided interval of each node's mean over runs; NaN where fewer than five design points have a value.

    `total` and `count` are the sums and numbers of the values of each design point (rows) and node (columns).
    The names of the design points seed the draws: the same table has the same interval, and nodes over the
    same points have the same draws.
    """
    ends = np.full((2, total.shape[1]), np.nan)
    points = (count > 0).sum(axis=0)
    able = np.flatnonzero(points >= MIN_DESIGN_POINTS)
    if not able.size:
        return ends[0], ends[1]
    order = sorted(range(len(design_points)), key=lambda number: design_points[number])
    rng = np.random.default_rng(_seed([design_points[number] for number in order]))
    sums, counts = _grouped(
        np.rint(total[order][:, able] * _QUANTUM), count[order][:, able].astype(np.float64), rng
    )
    weights = _draw_counts(sums.shape[0], rng)
    drawn = weights @ counts
    # A draw without any value has no mean; its NaN sorts last.
    with np.errstate(invalid="ignore"):
        means = np.sort(
            np.where(drawn > 0.0, weights @ sums / _QUANTUM / np.maximum(drawn, 1.0), np.nan).T, axis=1
        )
    finite_counts = np.isfinite(means).sum(axis=1)
    tail = _tail(points[able], level)
    ends[0, able] = _quantile(means, finite_counts, tail)
    ends[1, able] = _quantile(means, finite_counts, 1.0 - tail)
    return ends[0], ends[1]


def _seed(names: Sequence[str]) -> int:
    return int.from_bytes(hashlib.sha256("\n".join(names).encode()).digest()[:8], "big")


def _grouped(total: Floats, count: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """The design points themselves, or MAX_CLUSTERS random groups of them."""
    points = total.shape[0]
    if points <= MAX_CLUSTERS:
        return total, count
    order = rng.permutation(points)
    first = np.arange(MAX_CLUSTERS) * points // MAX_CLUSTERS
    return np.add.reduceat(total[order], first), np.add.reduceat(count[order], first)


def _draw_counts(points: int, rng: np.random.Generator) -> Floats:
    """How often each point is drawn in each resample, as (resamples, points)."""
    drawn = rng.integers(0, points, size=(RESAMPLES, points)) + np.arange(RESAMPLES)[:, None] * points
    return (
        np.bincount(drawn.ravel(), minlength=RESAMPLES * points).reshape(RESAMPLES, points).astype(np.float64)
    )


def _tail(points: Counts, level: float) -> Floats:
    student = stats.t.ppf((1.0 - level) / 2.0, points - 1)
    tail: Floats = stats.norm.cdf(np.sqrt(points / (points - 1.0)) * student)
    return tail


def _quantile(ordered: Floats, counts: Counts, share: Floats) -> Floats:
    """Quantile of the first `known` entries of each row, interpolated linearly."""
    at = share * (counts - 1)
    low = np.floor(at).astype(np.int64)
    high = np.minimum(low + 1, counts - 1)
    row = np.arange(ordered.shape[0])
    return ordered[row, low] + (at - low) * (ordered[row, high] - ordered[row, low])
