"""Intervals of mean scores by resampling design points: a cluster bootstrap, for all nodes at once.

Percentile intervals of a bootstrap are too short by the factor sqrt(n / (n - 1)) and by the normal's quantiles in place of
Student's; both are mended in the levels at which they are read, which is Hesterberg's "expanded percentile" interval.
Hesterberg, T. C. (2015), "What teachers should know about the bootstrap", The American Statistician 69(4), 371-386. Cameron,
A. C., Gelbach, J. B. and Miller, D. L. (2008), "Bootstrap-based improvements for inference with clustered errors", Review of
Economics and Statistics 90(3), 414-427.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from scipy import stats

from bench.arrays import Counts, Floats

LEVEL = 0.95
RESAMPLES = 1000
MIN_DESIGN_POINTS = 5
"""Design points with a score below which a mean has no interval: so few say too little of how they spread."""

MAX_CLUSTERS = 500
"""Design points above which they are drawn in this many groups, made at random: groups of clusters are clusters too."""

_QUANTUM = 2.0**20  # sums are rounded to millionths of a point, so that products are exact in any order of adding


def bootstrap_means(total: Floats, count: Counts, design_points: Sequence[str], level: float = LEVEL) -> tuple[Floats, Floats]:
    """Two-sided interval for each node's mean over runs; NaN where fewer than five design points have a value.

    `total` and `count` are the sums and numbers of the values of each design point (rows) and node (columns). The draws are seeded by
    the names of the design points: the same table has the same interval, and what is compared over the same points is
    drawn alike.
    """
    ends = np.full((2, total.shape[1]), np.nan)
    points = (count > 0).sum(axis=0)
    able = np.flatnonzero(points >= MIN_DESIGN_POINTS)
    if not able.size:
        return ends[0], ends[1]
    order = sorted(range(len(design_points)), key=lambda number: design_points[number])
    rng = np.random.default_rng(_seed([design_points[number] for number in order]))
    sums, counts = _grouped(np.rint(total[order][:, able] * _QUANTUM), count[order][:, able].astype(np.float64), rng)
    weights = _draw_counts(sums.shape[0], rng)
    drawn = weights @ counts
    with np.errstate(invalid="ignore"):  # a draw without any value has no mean, and sorts last
        means = np.sort(np.where(drawn > 0.0, weights @ sums / _QUANTUM / np.maximum(drawn, 1.0), np.nan).T, axis=1)
    known = np.isfinite(means).sum(axis=1)
    tail = _tail(points[able], level)
    ends[0, able] = _quantile(means, known, tail)
    ends[1, able] = _quantile(means, known, 1.0 - tail)
    return ends[0], ends[1]


def _seed(names: Sequence[str]) -> int:
    return int.from_bytes(hashlib.sha256("\n".join(names).encode()).digest()[:8], "big")


def _grouped(total: Floats, count: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Design points as they are, or bound into MOST groups at random."""
    points = total.shape[0]
    if points <= MAX_CLUSTERS:
        return total, count
    order = rng.permutation(points)
    first = np.arange(MAX_CLUSTERS) * points // MAX_CLUSTERS
    return np.add.reduceat(total[order], first), np.add.reduceat(count[order], first)


def _draw_counts(points: int, rng: np.random.Generator) -> Floats:
    """How often each point is drawn in each resample, (resamples, points)."""
    drawn = rng.integers(0, points, size=(RESAMPLES, points)) + np.arange(RESAMPLES)[:, None] * points
    return np.bincount(drawn.ravel(), minlength=RESAMPLES * points).reshape(RESAMPLES, points).astype(np.float64)


def _tail(points: Counts, level: float) -> Floats:
    student = stats.t.ppf((1.0 - level) / 2.0, points - 1)
    tail: Floats = stats.norm.cdf(np.sqrt(points / (points - 1.0)) * student)
    return tail


def _quantile(ordered: Floats, known: Counts, share: Floats) -> Floats:
    """Quantile of each row's first `known` entries, between neighbours by a line."""
    at = share * (known - 1)
    low = np.floor(at).astype(np.int64)
    high = np.minimum(low + 1, known - 1)
    row = np.arange(ordered.shape[0])
    return ordered[row, low] + (at - low) * (ordered[row, high] - ordered[row, low])
