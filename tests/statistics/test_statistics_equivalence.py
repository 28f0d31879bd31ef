"""Differences that runs do not rule out, against effects that are known."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import t

from bench.statistics import FactorColumn, difference_bounds


def runs(replicates: int) -> tuple[list[FactorColumn], list[str]]:
    """A two-level factor crossed with a straight line of eight values, each point repeated."""
    points = [(side, value) for side in "ab" for value in range(8)]
    every = [point for point in points for _ in range(replicates)]
    columns = [
        FactorColumn(name, tuple(level[place] for level in every))
        for place, name in enumerate(("side", "line"))
    ]
    return columns, [f"{side}{value}" for side, value in every]


def test_the_bound_holds_as_often_as_it_says() -> None:
    """Over 300 seeds with a difference of 0.3 between the sides, and of 0.4 from end to end, at most 7 % of
    bounds lie below.
    """
    factors, points = runs(4)
    chance = np.array([0.5 + (0.15 if side == "a" else -0.15) for side in factors[0].values])
    sloped = np.array([0.3 + 0.4 * float(value or 0) / 7 for value in factors[1].values])
    draws = np.random.default_rng(5)
    below = {"side": 0, "line": 0}
    for _ in range(300):
        for name, truth, rate in (("side", 0.3, chance), ("line", 0.4, sloped)):
            bound = difference_bounds(
                (draws.random(len(rate)) < rate).astype(float).tolist(), factors, points
            )[name]
            assert bound is not None
            below[name] += bound < truth

    assert max(below.values()) <= 21


def test_more_runs_rule_out_more() -> None:
    """Without any effect the bound falls, and straight passes leave open what an exact bound on their number does."""
    draws = np.random.default_rng(6)
    bounds = []
    for replicates in (2, 8, 32):
        factors, points = runs(replicates)
        bounds.append(
            difference_bounds((draws.random(len(points)) < 0.5).astype(float).tolist(), factors, points)[
                "side"
            ]
            or 1.0
        )

    assert bounds[0] > 0.3 > bounds[1] > bounds[2]
    factors, points = runs(4)
    passed = difference_bounds([1.0] * len(points), factors, points)
    assert passed["side"] == pytest.approx(1 - 0.05 ** (1 / 32))
    assert passed["line"] == pytest.approx(1 - 0.05 ** (1 / 21))


def test_what_the_points_do_not_carry_has_no_bound() -> None:
    """Two factors that go together, one level only, as many effects as points, and no run."""
    both = [FactorColumn(name, ("x", "y") * 6) for name in ("one", "other")]
    single = FactorColumn("single", ("z",) * 12)
    points = [f"p{run % 4}" for run in range(12)]

    assert difference_bounds([0.0, 1.0, 1.0] * 4, [*both, single], points) == {
        "one": None,
        "other": None,
        "single": None,
    }
    assert difference_bounds([0.0, 1.0], [FactorColumn("one", ("x", "y"))], ["p1", "p2"]) == {"one": None}
    assert difference_bounds([], [], []) == {}


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_of_two_levels_is_that_of_two_means(seed: int) -> None:
    """Each run is a design point of its own: the difference of the means, plus t times the larger of Welch's and
    the pooled standard error, with two degrees of freedom less than runs.
    """
    draws = np.random.default_rng(seed)
    low, high = draws.uniform(0.0, 0.6, 16), draws.uniform(0.3, 0.9, 9)
    factor = FactorColumn("side", ("a",) * 16 + ("b",) * 9)
    points = [f"p{number}" for number in range(25)]
    pooled = ((low.var(ddof=1) * 15 + high.var(ddof=1) * 8) / 23) * (1 / 16 + 1 / 9)
    welch = low.var(ddof=1) / 16 + high.var(ddof=1) / 9
    expected = abs(low.mean() - high.mean()) + float(t.ppf(0.8, 23)) * np.sqrt(max(pooled, welch))
    bound = difference_bounds([*low, *high], [factor], points, confidence=0.8)["side"]
    assert bound == pytest.approx(expected)


@pytest.mark.parametrize("seed", range(3))
def test_the_bound_of_three_levels_is_that_of_the_worst_pair(seed: int) -> None:
    """As above, over every two of three levels, of 16, 9 and 12 runs."""
    draws = np.random.default_rng(seed)
    groups = [draws.uniform(0.0, 0.4, 16), draws.uniform(0.3, 0.7, 9), draws.uniform(0.5, 0.9, 12)]
    factor = FactorColumn("side", ("a",) * 16 + ("b",) * 9 + ("c",) * 12)
    pooled = sum(float(group.var(ddof=1)) * (len(group) - 1) for group in groups) / 34
    expected = max(
        abs(one.mean() - other.mean())
        + float(t.ppf(0.8, 34))
        * np.sqrt(
            max(
                one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other),
                pooled * (1 / len(one) + 1 / len(other)),
            )
        )
        for one, other in itertools.combinations(groups, 2)
    )
    points = [f"p{number}" for number in range(37)]
    bound = difference_bounds(np.concatenate(groups).tolist(), [factor], points, confidence=0.8)["side"]
    assert bound == pytest.approx(expected)
