"""Odds: right where there is a closed form, honest where factors separate passes from failures."""

from __future__ import annotations

import numpy as np
import pytest
from known_values import known
from scipy import optimize, stats
from statsmodels.discrete.discrete_model import Logit

from bench.arrays import Floats
from bench.statistics import FactorColumn, logistic
from bench.statistics._firth import MAX_HAT_ROWS, DistinctRows
from bench.statistics._regression import (
    CLUSTERED_LIKELIHOOD,
    FIRTH,
    LIKELIHOOD,
    FirthFit,
    LikelihoodFit,
    fit_logistic,
    separated,
)


def table(passed: dict[str, int], failed: dict[str, int]) -> tuple[list[bool], FactorColumn, list[str]]:
    """Runs with so many passes and failures at each level of one factor."""
    runs = [
        (level, won)
        for level in passed
        for won, count in ((True, passed[level]), (False, failed[level]))
        for _ in range(count)
    ]
    return (
        [won for _, won in runs],
        FactorColumn("place", tuple(level for level, _ in runs)),
        [str(run) for run in range(len(runs))],
    )


def test_a_two_by_two_table_has_its_own_odds_ratio() -> None:
    """The odds ratio is the table's, with Woolf's interval and Wald's test."""
    y, factor, points = table({"near": 12, "far": 24}, {"near": 18, "far": 6})
    fit = logistic(y, [factor], points)
    (odds,) = fit.odds
    error = np.sqrt(1 / 12 + 1 / 18 + 1 / 24 + 1 / 6)
    assert (fit.method, odds.base, odds.level) == (LIKELIHOOD, "near", "far")
    assert odds.estimate == pytest.approx(24 * 18 / (6 * 12), rel=1e-4)
    assert odds.low == pytest.approx(6 * np.exp(-1.959964 * error), rel=1e-3)
    assert fit.tests[0].p == pytest.approx(2 * stats.norm.sf(np.log(6) / error), rel=1e-3)
    assert fit.note == ""


def test_no_p_value_is_a_riddle() -> None:
    """A steep factor over many runs that nearly separates: the p value is a number, and small, if timid as
    Wald's test there is.
    """
    draws = np.random.default_rng(5)
    x = draws.uniform(0.0, 1.0, 128)
    for steep in (5.0, 40.0, 400.0):
        won = (draws.uniform(0.0, 1.0, 128) < 1.0 / (1.0 + np.exp(-steep * (x - 0.5)))).tolist()
        fit = logistic(won, [FactorColumn("x", tuple(x))], [str(run) for run in range(128)])
        assert 0.0 <= known(fit.tests[0].p) < 0.01


def test_separation_is_found_said_and_told_in_sober_numbers() -> None:
    """Firth's estimate of a 2 x 2 table is the table with a half added to each cell; the unbounded end of the
    interval is not told.
    """
    y, factor, points = table({"near": 10, "far": 15}, {"near": 5, "far": 0})
    fit = logistic(y, [factor], points)
    (odds,) = fit.odds
    assert fit.method == FIRTH
    assert "separate" in fit.note
    assert odds.estimate == pytest.approx((15.5 / 0.5) / (10.5 / 5.5), rel=1e-6)
    assert odds.low is not None
    assert 1.0 < odds.low < known(odds.estimate)
    assert odds.high is None or odds.high <= 1000.0
    assert 0.001 < known(fit.tests[0].p) < 0.05


def penalized(y: Floats, x: Floats, beta: Floats, design_effect: float) -> float:
    """Firth's penalised likelihood, one run at a time."""
    value, information = 0.0, np.zeros((x.shape[1], x.shape[1]))
    for result, row in zip(y, x, strict=True):
        chance = 1.0 / (1.0 + np.exp(-float(row @ beta)))
        value += float(np.log(chance if result else 1.0 - chance))
        information += chance * (1.0 - chance) * np.outer(row, row)
    return value + design_effect / 2 * float(np.log(np.linalg.det(information)))


def reference_maximum(
    y: Floats, x: Floats, starts: list[Floats], design_effect: float, fixed: dict[int, float]
) -> float:
    """The maximum with some coefficients fixed, by scipy's quasi-Newton search from each of the starts."""
    free = [column for column in range(x.shape[1]) if column not in fixed]

    def loss(values: Floats) -> float:
        beta = np.zeros(x.shape[1])
        beta[free], beta[list(fixed)] = values, list(fixed.values())
        return -penalized(y, x, beta, design_effect)

    return max(-float(optimize.minimize(loss, start[free]).fun) for start in starts)


def random_factors(seed: int, runs: int, levels: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Passes, and the columns of factors with so many levels, each level as often as another."""
    rng = np.random.default_rng(seed)
    columns = [np.ones(runs)]
    for count in levels:
        codes = rng.permutation(np.arange(runs) % count)
        columns += [(codes == level).astype(np.float64) for level in range(1, count)]
    x = np.column_stack(columns)
    line = x @ np.r_[rng.normal(0.0, 0.5), rng.normal(0.0, 2.0, x.shape[1] - 1)]
    return (rng.random(runs) < 1.0 / (1.0 + np.exp(-line))).astype(np.float64), x


@pytest.mark.parametrize(("seed", "design_effect"), [(1, 1.0), (2, 2.5), (4, 1.0)])
def test_penalised_estimates_tests_and_bounds_are_those_of_a_general_search(
    seed: int, design_effect: float
) -> None:
    """The maximum, the test of a factor and both bounds against scipy's search of a likelihood written anew."""
    y, x = random_factors(seed, 24, (2, 3))
    fit = fit_logistic(y, x, np.arange(24), is_separated=True, design_effect=design_effect)
    assert isinstance(fit, FirthFit)
    zero = [np.zeros(x.shape[1])]
    best = reference_maximum(y, x, zero, design_effect, {})
    assert fit.likelihood == pytest.approx(best, abs=1e-7)
    assert penalized(y, x, fit.beta, design_effect) == pytest.approx(best, abs=1e-7)
    without = reference_maximum(y, x, zero, design_effect, {2: 0.0, 3: 0.0})
    assert fit.p(slice(2, 4)) == pytest.approx(
        float(stats.chi2.sf(2 * (best - without) / design_effect, 2)), rel=1e-5
    )
    drop = design_effect * float(stats.norm.ppf(0.975)) ** 2 / 2
    bounds = [(column, bound) for column in (1, 2) for bound in fit.interval(column) if np.isfinite(bound)]
    assert len(bounds) >= 2
    for column, bound in bounds:
        profile = reference_maximum(y, x, [fit.beta], design_effect, {column: bound})
        assert best - profile == pytest.approx(drop, abs=1e-6)


def test_a_bound_lies_where_the_highest_of_several_maxima_falls_below_the_edge() -> None:
    """With eight parameters for 24 runs a search from the estimate ends at a lower maximum, well below the edge."""
    y, x = random_factors(14, 24, (3, 3, 3, 2))
    fit = fit_logistic(y, x, np.arange(24), is_separated=True)
    assert isinstance(fit, FirthFit)
    _, high = fit.interval(5)
    drop = float(stats.norm.ppf(0.975)) ** 2 / 2
    other = fit.beta + np.random.default_rng(1).normal(0.0, 2.0, len(fit.beta))
    assert fit.likelihood - reference_maximum(y, x, [other], 1.0, {5: high}) == pytest.approx(drop, abs=1e-5)
    assert fit.likelihood - reference_maximum(y, x, [fit.beta], 1.0, {5: high}) > drop + 0.1


def test_runs_beyond_the_exact_curvature_change_no_estimate() -> None:
    """Every run MAX_HAT_ROWS times over, each weighing so much less, is the fit of the runs once."""
    y, x = random_factors(2, 24, (2, 3))
    once = fit_logistic(y, x, np.arange(24), is_separated=True)
    copies = MAX_HAT_ROWS // 24 + 1
    many = fit_logistic(
        np.tile(y, copies),
        np.tile(x, (copies, 1)),
        np.arange(24 * copies),
        is_separated=True,
        design_effect=copies,
    )
    assert many.beta == pytest.approx(once.beta, abs=1e-6)
    assert many.interval(1) == pytest.approx(once.interval(1), abs=1e-6)


@pytest.mark.parametrize("reach", [1.0, 1e3])
def test_a_number_that_separates_entirely_gives_no_silly_odds(reach: float) -> None:
    """A threshold in a numeric factor: every number that is told lies within what can be told."""
    x = reach * np.arange(24.0)
    fit = logistic((x > x[11]).tolist(), [FactorColumn("x", tuple(x))], [str(run) for run in range(24)])
    assert fit.method == FIRTH
    assert all(
        value is None or 1e-3 <= value <= 1e3
        for odds in fit.odds
        for value in (odds.estimate, odds.low, odds.high)
    )
    assert known(fit.tests[0].p) < 0.001


def test_the_search_for_separation_tells_overlap_from_it() -> None:
    """Quasi-complete separation counts; one run on the wrong side ends it."""
    x = np.column_stack([np.ones(6), [0, 0, 1, 1, 2, 2]])
    assert separated(np.array([0.0, 0, 0, 1, 1, 1]), x)
    assert not separated(np.array([0.0, 1, 0, 1, 1, 0]), x)


def test_a_planted_effect_is_found_and_the_others_are_not() -> None:
    """Passes that depend on fog alone, three runs a design point."""
    draw = np.random.default_rng(8)
    fog, light = np.repeat(draw.uniform(0, 2, size=80), 3), np.repeat(draw.integers(0, 2, size=80), 3)
    y = (draw.random(240) < 1 / (1 + np.exp(2.0 * (fog - 1)))).tolist()
    points = [f"p{run // 3}" for run in range(240)]
    factors = [
        FactorColumn("fog", tuple(fog)),
        FactorColumn("light", tuple("night" if result else "day" for result in light)),
    ]
    fit = logistic(y, factors, points)
    p = {result.factor: result.p for result in fit.tests}
    assert fit.method == CLUSTERED_LIKELIHOOD
    assert p["fog"] is not None
    assert p["fog"] < 1e-6
    assert p["light"] is not None
    assert p["light"] > 0.05
    slope = np.log(fit.odds[0].estimate or np.nan) / np.ptp(fog)
    assert slope == pytest.approx(-2.0, abs=0.6)


@pytest.mark.parametrize(("y", "note"), [([True] * 9, "every run passed"), ([False] * 9, "no run passed")])
def test_all_alike_is_said(y: list[bool], note: str) -> None:
    """Where nothing varies there is no regression, and no odds."""
    fit = logistic(y, [FactorColumn("a", (0, 1, 2) * 3)], [str(run) for run in range(9)])
    assert (fit.note, fit.odds, fit.tests) == (note, (), ())


def test_few_failures_for_many_parameters_are_said() -> None:
    """Three failures cannot carry three parameters."""
    draw = np.random.default_rng(0)
    factors = [FactorColumn(name, tuple(draw.normal(size=60))) for name in "abc"]
    y = [run not in (3, 30, 50) for run in range(60)]
    assert "only 3 failures for 3 parameters" in logistic(y, factors, [str(run) for run in range(60)]).note


def test_constant_and_aliased_factors_are_left_out() -> None:
    """They are named, and the rest is fitted."""
    y, factor, points = table({"near": 12, "far": 24}, {"near": 18, "far": 6})
    copy = FactorColumn("copy", tuple(result == "far" for result in factor.values))
    fit = logistic(y, [FactorColumn("same", (1,) * 60), factor, copy], points)
    assert {result.term: result.reason for result in fit.left_out} == {
        "same": "has one level only",
        "copy": "aliased with place",
    }
    assert [result.factor for result in fit.tests] == ["place"]
    assert fit.tests[0].note == "cannot be told from copy"


def test_replicates_add_no_rows_to_a_fit() -> None:
    """Twelve design points with 2,000 runs are twelve rows; the passes are all there."""
    rng = np.random.default_rng(5)
    points = rng.normal(size=(12, 4))
    place = rng.integers(0, 12, 2000)
    y = np.where(rng.random(2000) < 0.4, 1.0, 0.0)
    rows = DistinctRows.of(y, points[place])
    assert rows.x.shape == (12, 4)
    for row, count, passes in zip(rows.x, rows.count, rows.passes, strict=True):
        same = (points[place] == row).all(axis=1)
        assert (count, passes) == (same.sum(), y[same].sum())


@pytest.mark.parametrize("replicates", [1, 3])
def test_likelihood_fits_and_their_covariances_are_statsmodels(replicates: int) -> None:
    """On random designs, with independent runs and with errors by design point."""
    rng = np.random.default_rng(replicates)
    for _ in range(20):
        points, columns = int(rng.integers(30, 60)), int(rng.integers(1, 4))
        x = np.column_stack([np.ones(points), rng.normal(size=(points, columns))]).repeat(replicates, axis=0)
        y = (rng.random(len(x)) < 1 / (1 + np.exp(-0.7 * x[:, 1]))).astype(float)
        clusters = np.arange(points).repeat(replicates)
        if separated(y, x):
            continue
        options = {"cov_type": "cluster", "cov_kwds": {"groups": clusters}} if replicates > 1 else {}
        expected = Logit(y, x).fit(disp=0, **options)
        fit = fit_logistic(y, x, clusters, is_separated=False)
        assert isinstance(fit, LikelihoodFit)
        np.testing.assert_allclose(fit.beta, expected.params, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(fit.covariance, expected.cov_params(), rtol=1e-5, atol=1e-9)
        assert fit.method == (CLUSTERED_LIKELIHOOD if replicates > 1 else LIKELIHOOD)
