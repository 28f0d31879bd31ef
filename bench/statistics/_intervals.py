"""Two-sided 95 % intervals for proportions; all functions take arrays or numbers. No count gives [0, 1]
(docs/rulings.md 18).

Clopper, C. J. and Pearson, E. S. (1934), "The use of confidence or fiducial limits illustrated in the case of
the binomial", Biometrika 26(4), 404-413. Wilson, E. B. (1927), JASA 22(158), 209-212. Korn, E. L. and
Graubard, B. I. (1998), "Confidence intervals for proportions with small expected number of positive counts
estimated from survey data", Survey Methodology 24(2), 193-201.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from bench.arrays import Floats

# Ruling 18: every interval of the bench has this level unless its caller asks for another.
CONFIDENCE_LEVEL = 0.95


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


def wilson(passed: ArrayLike, tried: ArrayLike, level: float = CONFIDENCE_LEVEL) -> tuple[Floats, Floats]:
    """Score interval for `passed` of `tried`; shorter than the exact one, and with the right coverage on
    average only.
    """
    k, n = np.asarray(passed, dtype=np.float64), np.asarray(tried, dtype=np.float64)
    z = float(stats.norm.ppf(1.0 - (1.0 - level) / 2.0))
    count = np.where(n > 0.0, n, 1.0)
    share = k / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * np.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    low, high = np.maximum(middle - half, 0.0), np.minimum(middle + half, 1.0)
    return np.where((n > 0) & (k > 0), low, 0.0), np.where((n > 0) & (k < n), high, 1.0)


def effective_size(
    mean: ArrayLike, runs: ArrayLike, clusters: ArrayLike, squared: ArrayLike, level: float = CONFIDENCE_LEVEL
) -> Floats:
    """Effective number of independent runs behind the mean of `runs` ratios that lie in `clusters` design
    points.

    `squared` is the sum over the clusters of (the cluster's sum of deviations from the mean) squared, from
    which the variance of the mean follows by linearisation. The degrees of freedom are corrected after Korn
    and Graubard, and the result never exceeds the number of runs. It is the number of runs where all runs
    agree on 0 or 1, where all ratios are equal, and where there is a single design point (whose replicates
    have independent seeds).
    """
    p, n = np.asarray(mean, dtype=np.float64), np.asarray(runs, dtype=np.float64)
    c, square = np.asarray(clusters, dtype=np.float64), np.asarray(squared, dtype=np.float64)
    spread = p * (1.0 - p)
    usable = (c > 1.0) & (spread > 1e-12) & (square > 1e-12)
    variance = np.where(usable, c / np.maximum(c - 1.0, 1.0) * square / np.maximum(n, 1.0) ** 2, 1.0)
    upper = 1.0 - (1.0 - level) / 2.0
    correction = (
        stats.t.ppf(upper, np.maximum(n - 1.0, 1.0)) / stats.t.ppf(upper, np.maximum(c - 1.0, 1.0))
    ) ** 2
    return np.where(usable, np.minimum(spread / variance * correction, n), n)
