"""What the intervals of confidence cover: exact ones everywhere, the clustered one on clustered runs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, t

from bench.statistics import bounded_mean, clopper_pearson, effective_size

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


@pytest.mark.parametrize(("p", "points"), [(0.9, 10), (0.8, 5), (0.95, 24)])
def test_replicates_that_are_almost_copies_are_covered_too(p: float, points: int) -> None:
    """Correlation 0.9 in 4 replicates, so that all runs pass in a quarter of the campaigns or more: taking all runs as
    independent there covers 71 to 77 %.
    """
    rng = np.random.default_rng(3)
    rates = rng.beta(p / 9.0, (1.0 - p) / 9.0, (4000, points, 1))
    mean, size = effective(rng.random((4000, points, 4)) < rates)
    low, high = clopper_pearson(mean * size, size)
    assert ((low <= p) & (p <= high)).mean() >= 0.94
    assert (mean == 1.0).mean() > 0.2
    assert (size[mean == 1.0] == points).all()


@pytest.mark.parametrize("runs", [2, 14, 59])
def test_runs_that_share_no_design_point_count_in_full(runs: int) -> None:
    """With one run in each design point the clustered interval is Clopper-Pearson's, whatever the count."""
    for passes in range(runs + 1):
        mean = passes / runs
        squared = passes * (1.0 - mean) ** 2 + (runs - passes) * mean**2
        assert effective_size(mean, runs, runs, squared) == pytest.approx(runs)


def ratio_interval(ratios: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The interval for the mean of (campaigns, runs) ratios, each run its own design point."""
    mean, runs = ratios.mean(axis=1), ratios.shape[1]
    return bounded_mean(mean, runs, runs, ((ratios - mean[:, None]) ** 2).sum(axis=1))


def test_the_interval_of_ratios_covers_without_being_the_interval_of_counts() -> None:
    """24 runs of ten observables each, 4000 seeded campaigns: less than 99 % are covered, and the interval is
    two thirds as wide as that of counts.
    """
    rng = np.random.default_rng(5)
    for p in (0.5, 0.8):
        ratios = rng.binomial(10, rng.beta(4 * p, 4 * (1 - p), (4000, 24))) / 10
        low, high = ratio_interval(ratios)
        mean = ratios.mean(axis=1)
        count_low, count_high = clopper_pearson(mean * 24, np.full(4000, 24))
        assert 0.94 <= ((low <= p) & (p <= high)).mean() <= 0.985
        assert ((count_low <= p) & (p <= count_high)).mean() > 0.99
        assert (high - low).mean() < 0.75 * (count_high - count_low).mean()


def test_rare_crashes_among_good_runs_are_covered() -> None:
    """One run in ten achieves nothing, and 9 of 100 campaigns of 24 runs never show it."""
    rng = np.random.default_rng(6)
    ratios = np.where(rng.random((4000, 24)) < 0.1, 0.0, rng.binomial(10, 0.95, (4000, 24)) / 10)
    low, high = ratio_interval(ratios)
    assert ((low <= 0.855) & (high >= 0.855)).mean() >= 0.90


def test_the_interval_of_ratios_at_its_edges() -> None:
    """Exact where all ratios are 1 or 0, never without width, symmetric, and [0, 1] without a run."""
    low, high = bounded_mean([1.0, 0.0, 0.5, 0.0], [20, 20, 20, 0], [20, 5, 20, 0], [0.0, 0.0, 0.0, 0.0])
    exact_low, exact_high = clopper_pearson([20, 0], [20, 5])
    assert (low[0], high[0]) == (pytest.approx(float(exact_low[0])), 1.0)
    assert (low[1], high[1]) == (0.0, pytest.approx(float(exact_high[1])))
    assert low[2] < 0.5 < high[2]
    assert low[2] == pytest.approx(1.0 - high[2])
    assert (low[3], high[3]) == (0.0, 1.0)


def test_a_full_added_value_gives_the_exact_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    """With weight 1 and ratios of 0 and 1, the interval of ratios is Clopper-Pearson's: an independent check of
    its formula.
    """
    monkeypatch.setattr("bench.statistics._intervals.ADDED_WEIGHT", 1.0)
    k = np.arange(13)
    low, high = bounded_mean(k / 12, 12, 12, k * (1 - k / 12))
    exact_low, exact_high = clopper_pearson(k, np.full(13, 12))
    assert low == pytest.approx(exact_low)
    assert high == pytest.approx(exact_high)


def test_design_points_of_unequal_size_keep_the_interval_around_the_mean() -> None:
    """500 random tables of 2 to 6 design points with 1 to 9 runs: finite ends, in order, within [0, 1]."""
    rng = np.random.default_rng(7)
    for _ in range(500):
        sizes = rng.integers(1, 10, rng.integers(2, 7))
        totals = np.array([rng.beta(0.5, 0.5, size).sum() for size in sizes])
        mean = totals.sum() / sizes.sum()
        low, high = bounded_mean(mean, sizes.sum(), sizes.size, ((totals - sizes * mean) ** 2).sum())
        assert 0.0 <= low <= mean <= high <= 1.0


@pytest.mark.parametrize("points", [2, 3, 7])
def test_the_effective_size_follows_from_the_variance_between_design_points(points: int) -> None:
    """Against the formula worked out run by run: the variance of the share by linearisation, that of
    independent runs, and the correction of the degrees of freedom.
    """
    rng = np.random.default_rng(points)
    for _ in range(20):
        passed = [rng.random(int(rng.integers(2, 6))) < rng.random() for _ in range(points)]
        everything = np.concatenate(passed)
        n, p = len(everything), float(everything.mean())
        deviations = [float((cluster - p).sum()) for cluster in passed]
        squared = sum(deviation**2 for deviation in deviations)
        if not 0.0 < p < 1.0 or squared < 1e-9:
            continue
        clustered = points / (points - 1) * squared / n**2
        independent = float(everything.var(ddof=1)) / n
        correction = (t.ppf(0.975, n - 1) / t.ppf(0.975, points - 1)) ** 2
        expected = min(n, n * independent / clustered * correction)
        assert effective_size(p, n, points, squared) == pytest.approx(expected)
