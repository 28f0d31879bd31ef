"""The interval of a mean score, against flights of the same design with new seeds."""

import numpy as np
import pytest

from bench.arrays import Floats
from bench.statistics import replicate_interval

POINTS, REPLICATES = 24, 3


def interval(scores: Floats) -> tuple[Floats, Floats]:
    """Of scores (design points, replicates), NaN where a run has none, as one node."""
    known = ~np.isnan(scores)
    values = np.nan_to_num(scores)
    runs = np.full((len(scores), 1), scores.shape[1])
    return replicate_interval(
        values.sum(axis=1)[:, None], (values**2).sum(axis=1)[:, None], known.sum(axis=1)[:, None], runs
    )


def test_it_covers_the_mean_of_the_same_design_and_not_the_spread_of_the_design() -> None:
    rng = np.random.default_rng(7)
    difficulty = np.linspace(5.0, 95.0, POINTS)[:, None]
    pass_rate = np.linspace(0.95, 0.35, POINTS)[:, None]
    truth = float((difficulty * pass_rate).sum() / pass_rate.sum())
    held, widths = 0, []
    for _ in range(600):
        noise = rng.normal(0.0, 1.0, (POINTS, REPLICATES))
        scores = np.where(rng.random((POINTS, REPLICATES)) < pass_rate, difficulty + noise, np.nan)
        low, high = interval(scores)
        held += bool(low[0] <= truth <= high[0])
        widths.append(high[0] - low[0])
    assert 0.92 <= held / 600 <= 0.98
    assert np.mean(widths) < 14.0  # a bootstrap of design points has 20


def test_runs_that_all_pass_at_fixed_difficulties_leave_nothing_to_vary() -> None:
    low, high = interval(np.repeat(np.linspace(20.0, 80.0, 12)[:, None], 3, axis=1))
    assert low[0] == pytest.approx(50.0)
    assert high[0] == pytest.approx(50.0)


def test_a_design_flown_once_has_no_interval() -> None:
    for scores in (np.full((40, 1), 30.0), np.full((4, 2), 30.0), np.full((12, 3), np.nan)):
        assert np.isnan(interval(scores)).all()
    assert not np.isnan(interval(np.full((5, 2), 30.0))).any()


def test_rare_scores_have_no_interval() -> None:
    """Where replicates seldom have a score too, nothing shows how scores vary: the interval would cover 60 to 87 %."""
    scores = np.full((24, 3), np.nan)
    scores[::4, 0] = np.linspace(10.0, 90.0, 6)
    assert np.isnan(interval(scores)).all()
    scores[:4, :2] = 30.0  # four design points with two scores
    assert np.isnan(interval(scores)).all()
    scores[4, :2] = 30.0  # five
    assert not np.isnan(interval(scores)).any()
