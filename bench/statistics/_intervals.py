"""Two-sided 95 % intervals for proportions; all functions take arrays or numbers. No count gives [0, 1]
(docs/rulings.md 18).

Clopper, C. J. and Pearson, E. S. (1934), "The use of confidence or fiducial limits illustrated in the case of
the binomial", Biometrika 26(4), 404-413. Korn, E. L. and
Graubard, B. I. (1998), "Confidence intervals for proportions with small expected number of positive counts
estimated from survey data", Survey Methodology 24(2), 193-201. Gaffke, N. (2005), "Three test statistics for
a nonparametric one-sided hypothesis on the mean of a nonnegative variable", Mathematical Methods of
Statistics 14(4), 451-467; as an interval: Learned-Miller, E. and Thomas, P. S. (2019), "A new confidence
interval for the mean of a bounded random variable", arXiv:1905.06208.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from bench.arrays import Floats

# Ruling 18: every interval of the bench has this level unless its caller asks for another.
CONFIDENCE_LEVEL = 0.95
# Weight of the value that `bounded_mean` adds, in clusters. 1 covers 95 % under every distribution measured,
# and 98.7 % on average; below 0.5 rare crashes among good runs are covered in less than 90 %
# (benchmarks/interval_coverage.py).
ADDED_WEIGHT = 0.5


def clopper_pearson(
    passed: ArrayLike, tried: ArrayLike, level: float = CONFIDENCE_LEVEL
) -> tuple[Floats, Floats]:
    """Exact interval for `passed` of `tried`, which may be fractions of runs (effective counts)."""
    k, n = np.asarray(passed, dtype=np.float64), np.asarray(tried, dtype=np.float64)
    tail = (1.0 - level) / 2.0
    any_passed, any_failed = k > 0.0, n - k > 1e-12
    # Both ends are known exactly at 0 and at n; the inner where keeps the beta distribution away from invalid
    # parameters there.
    low = np.where(
        any_passed,
        stats.beta.ppf(tail, np.where(any_passed, k, 1.0), np.where(any_passed, n - k + 1.0, 1.0)),
        0.0,
    )
    high = np.where(
        any_failed,
        stats.beta.ppf(1.0 - tail, np.where(any_failed, k + 1.0, 1.0), np.where(any_failed, n - k, 1.0)),
        1.0,
    )
    return np.where(n > 0.0, low, 0.0), np.where(n > 0.0, high, 1.0)


def effective_size(
    mean: ArrayLike, runs: ArrayLike, clusters: ArrayLike, squared: ArrayLike, level: float = CONFIDENCE_LEVEL
) -> Floats:
    """Effective number of independent runs behind the share of `runs` that passed, where the runs lie in
    `clusters` design points.

    `squared` is the sum over the clusters of (the cluster's sum of deviations from the mean) squared, from
    which the variance of the mean follows by linearisation. The degrees of freedom are corrected after Korn
    and Graubard, and the result never exceeds the number of runs. It is exactly the number of runs where each
    run is a cluster, and where there is a single cluster (whose replicates have independent seeds). Where all
    runs pass or all fail, it is the number of clusters.
    """
    p, n = np.asarray(mean, dtype=np.float64), np.asarray(runs, dtype=np.float64)
    c, square = np.asarray(clusters, dtype=np.float64), np.asarray(squared, dtype=np.float64)
    spread = p * (1.0 - p)
    clustered, mixed = c > 1.0, spread > 1e-12
    usable = clustered & mixed & (square > 1e-12)
    variance = np.where(usable, c / np.maximum(c - 1.0, 1.0) * square / np.maximum(n, 1.0) ** 2, 1.0)
    # The variance that the same share has in n independent runs, estimated from n - 1 degrees of freedom too:
    # only then do n clusters of one run count as n runs.
    independent = spread * n / np.maximum(n - 1.0, 1.0)
    upper = 1.0 - (1.0 - level) / 2.0
    correction = (
        stats.t.ppf(upper, np.maximum(n - 1.0, 1.0)) / stats.t.ppf(upper, np.maximum(c - 1.0, 1.0))
    ) ** 2
    size = np.where(usable, np.minimum(independent / variance * correction, n), n)
    # Where all agree the data say nothing about how alike replicates are. Taking them for copies of each
    # other is the only choice that still covers when they are (docs/statistics.md has the measurement).
    return np.where(clustered & ~mixed, c, size)


def bounded_mean(
    mean: ArrayLike, runs: ArrayLike, clusters: ArrayLike, squared: ArrayLike, level: float = CONFIDENCE_LEVEL
) -> tuple[Floats, Floats]:
    """Interval for the mean of ratios in [0, 1] that are not only 0 and 1; `squared` as in `effective_size`.

    The means of the clusters get weights from a flat Dirichlet distribution, and the interval is read from
    the weighted mean after adding a value of 0 (lower end) or 1 (upper end), as Gaffke does; the distribution
    of that mean is taken as a beta distribution of equal mean and variance. With an added value of full
    weight it is Clopper-Pearson's interval on counts. Here it has the weight ADDED_WEIGHT; where the mean is
    0 or 1 it has full weight, so the ends are exact there.
    """
    p, n = np.asarray(mean, dtype=np.float64), np.asarray(runs, dtype=np.float64)
    c, square = np.asarray(clusters, dtype=np.float64), np.asarray(squared, dtype=np.float64)
    has_trials = n > 0.0
    # Clusters of unequal size: linearised values, which have the same mean and the same spread.
    sizes = n / np.where(has_trials, c, 1.0)
    squares = c * p**2 + square / np.where(has_trials, sizes, 1.0) ** 2
    weight = np.where(p * (1.0 - p) > 1e-12, ADDED_WEIGHT, 1.0)
    tail = (1.0 - level) / 2.0
    low = _weighted_mean_quantile(c * p, squares, c, weight, tail)
    # The upper end of a mean is the lower end of its complement.
    high = 1.0 - _weighted_mean_quantile(c * (1.0 - p), squares - 2.0 * c * p + c, c, weight, tail)
    return np.where(has_trials, low, 0.0), np.where(has_trials, high, 1.0)


def _weighted_mean_quantile(
    total: Floats, squares: Floats, clusters: Floats, weight: Floats, level: float
) -> Floats:
    """Quantile of a Dirichlet-weighted mean of values with this sum and sum of squares and an added 0."""
    weights = clusters + weight
    middle = total / weights
    variance = np.maximum((squares / weights - middle**2) / (weights + 1.0), 1e-15)
    # A beta distribution cannot vary more than a coin: unequal clusters, linearised, can come close to that.
    precision = np.maximum(middle * (1.0 - middle) / variance - 1.0, 1e-3)
    inside = middle > 1e-12
    ends = stats.beta.ppf(
        level, np.where(inside, middle * precision, 1.0), np.where(inside, (1.0 - middle) * precision, 1.0)
    )
    return np.where(inside, ends, 0.0)
