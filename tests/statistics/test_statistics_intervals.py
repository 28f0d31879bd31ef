"""What the intervals of confidence cover: exact ones everywhere, Wilson's on average, the clustered one on
clustered runs.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from bench.statistics import clopper_pearson, effective_size, wilson

SHARES = np.linspace(0.001, 0.999, 499)


def coverage(low: np.ndarray, high: np.ndarray, n: int) -> np.ndarray:
    """For each true share, summed over the whole binomial distribution of n runs."""
    k = np.arange(n + 1)
    inside = (low[:, None] <= SHARES) & (high[:, None] >= SHARES)
    return np.asarray((binom.pmf(k[:, None], n, SHARES) * inside).sum(axis=0))


@pytest.mark.parametrize("n", [1, 3, 10, 14, 59, 215])
def test_the_exact_interval_covers_everywhere(n: int) -> None:
    """At least 95 % at every one of 499 true shares."""
    k = np.arange(n + 1)
    assert coverage(*clopper_pearson(k, np.full(n + 1, n)), n).min() >= 0.95 - 1e-12


@pytest.mark.parametrize("n", [10, 14, 30, 100, 215])
def test_wilson_covers_on_average(n: int) -> None:
    """Within a point of 95 % averaged over the true shares from ten runs on; not at each of them."""
    k = np.arange(n + 1)
    covered = coverage(*wilson(k, np.full(n + 1, n)), n)
    assert abs(covered.mean() - 0.95) <= 0.01
    assert covered.min() < 0.95


def clustered(p: float, points: int, replicates: int, campaigns: int, seed: int) -> np.ndarray:
    """Passes (campaigns, points, replicates) whose design points have beta-distributed rates: correlation one
    third within.
    """
    rng = np.random.default_rng(seed)
    rates = rng.beta(2.0 * p, 2.0 * (1.0 - p), (campaigns, points, 1))
    return rng.random((campaigns, points, replicates)) < rates


def effective(passed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    runs = passed.shape[1] * passed.shape[2]
    mean = passed.mean(axis=(1, 2))
    squared = ((passed.sum(axis=2) - passed.shape[2] * mean[:, None]) ** 2).sum(axis=1)
    size = effective_size(mean, np.full(mean.shape, runs), np.full(mean.shape, passed.shape[1]), squared)
    return mean, size


@pytest.mark.parametrize(
    ("p", "points", "least"), [(0.5, 10, 0.94), (0.5, 30, 0.94), (0.8, 10, 0.94), (0.8, 30, 0.94)]
)
def test_the_clustered_interval_covers_where_replicates_agree(p: float, points: int, least: float) -> None:
    """4000 seeded campaigns of four replicates; plain Clopper-Pearson on the same runs covers far less."""
    passed = clustered(p, points, 4, 4000, seed=17)
    mean, size = effective(passed)
    low, high = clopper_pearson(mean * size, size)
    runs = points * 4
    plain_low, plain_high = clopper_pearson(np.round(mean * runs), np.full(mean.shape, runs))
    covered = ((low <= p) & (p <= high)).mean()
    assert covered >= least
    assert ((plain_low <= p) & (p <= plain_high)).mean() < min(0.92, covered)


def test_it_is_too_short_where_all_pass() -> None:
    """What the documentation warns of: where all pass no variance is seen and all runs count, and at a true
    95 % that is often.
    """
    mean, size = effective(clustered(0.95, 30, 4, 4000, seed=17))
    low, high = clopper_pearson(mean * size, size)
    assert 0.90 < ((low <= 0.95) & (high >= 0.95)).mean() < 0.94
    assert (size[mean == 1.0] == 120).all()
