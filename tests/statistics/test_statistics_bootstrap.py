"""Bootstrap of mean scores: what it covers, that it is the same every time, and what design points mean to
it.
"""

from __future__ import annotations

import numpy as np
import pytest

from bench.statistics import bootstrap_means
from bench.statistics._bootstrap import MAX_CLUSTERS


def names(count: int) -> list[str]:
    return [f"p{i:05d}" for i in range(count)]


def skewed(rng: np.random.Generator, points: int, campaigns: int) -> tuple[np.ndarray, np.ndarray]:
    """Sums and counts of exponential scores of mean 1 by design point, three replicates each, half of the
    variance shared.
    """
    point_means = rng.exponential(1.0, (points, 1, campaigns)) * np.sqrt(0.5)
    each = rng.exponential(1.0, (points, 3, campaigns)) * np.sqrt(0.5)
    scores = point_means + each + 1.0 - 2.0 * np.sqrt(0.5)
    return scores.sum(axis=1), np.full((points, campaigns), 3)


@pytest.mark.parametrize(("points", "least"), [(5, 0.88), (10, 0.90), (30, 0.92), (100, 0.93)])
def test_coverage_on_skewed_scores(points: int, least: float) -> None:
    """On skewed clustered scores it covers somewhat less than 95 %, and more so the fewer the design
    points.
    """
    total, count = skewed(np.random.default_rng(8), points, 4000)
    low, high = bootstrap_means(total, count, names(points))
    assert least <= ((low <= 1.0) & (high >= 1.0)).mean() <= 0.97


def test_coverage_where_scores_are_even() -> None:
    """On normal scores of eight design points it covers 95 % within two points: short samples are mended by
    Student's t.
    """
    scores = np.random.default_rng(9).normal(50.0, 10.0, (8, 4000))
    low, high = bootstrap_means(scores, np.ones_like(scores, dtype=np.int64), names(8))
    assert 0.93 <= ((low <= 50.0) & (high >= 50.0)).mean() <= 0.97


def test_coverage_where_points_are_drawn_in_groups() -> None:
    """Above 500 design points they are bound into groups, which costs no coverage."""
    total, count = skewed(np.random.default_rng(10), MAX_CLUSTERS + 137, 1000)
    low, high = bootstrap_means(total, count, names(MAX_CLUSTERS + 137))
    assert 0.93 <= ((low <= 1.0) & (high >= 1.0)).mean() <= 0.97


def test_the_same_table_has_the_same_interval() -> None:
    """To the bit, whichever way its rows lie; other design points draw otherwise."""
    total, count = skewed(np.random.default_rng(1), 12, 4)
    first = bootstrap_means(total, count, names(12))
    order = np.random.default_rng(2).permutation(12)
    again = bootstrap_means(total[order], count[order], [names(12)[i] for i in order])
    assert np.array_equal(first, again)
    other = bootstrap_means(total, count, [f"other {name}" for name in names(12)])
    assert not np.array_equal(first, other)


def test_replicates_that_agree_widen_it() -> None:
    """Thirty runs in ten design points of three equal runs are worth ten, not thirty."""
    scores = np.random.default_rng(3).normal(50.0, 10.0, 10)
    low, high = bootstrap_means(3.0 * scores[:, None], np.full((10, 1), 3), names(10))
    spread = np.repeat(scores, 3)[:, None]
    apart = bootstrap_means(spread, np.ones((30, 1), dtype=np.int64), names(30))
    assert high[0] - low[0] > 1.5 * (apart[1][0] - apart[0][0])


def test_too_little_has_no_interval() -> None:
    """Fewer than five design points with a score: none; runs without a score weigh nothing."""
    total = np.array([[50.0, 50.0]] * 5 + [[0.0, 0.0]] * 3)
    count = np.array([[1, 1]] * 4 + [[0, 1]] + [[0, 0]] * 3)
    low, high = bootstrap_means(np.where(count > 0, total, 0.0), count, names(8))
    assert np.isnan(low[0])
    assert np.isnan(high[0])
    assert (low[1], high[1]) == (50.0, 50.0)
