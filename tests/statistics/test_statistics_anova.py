# mypy: disable-error-code=arg-type
# Rows of mixed values are typed by what they are, which a Sequence of Mappings of wider values refuses.
"""Variance over factors: planted effects are found, none is found where none is, and what cannot be told
apart is named.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from known_values import known
from scipy.linalg import sqrtm
from statsmodels.regression.linear_model import OLS
from statsmodels.stats.diagnostic import het_breuschpagan
from statsmodels.stats.multitest import multipletests

from bench.statistics import FactorColumn, anova, factor_columns, logistic
from bench.statistics._anova import CLUSTERED, PLAIN, _equal_spread_p, clustered_errors, scaled_residuals
from bench.statistics._multiplicity import benjamini_hochberg
from bench.statistics._terms import cramers_v, independence


def crossed(
    levels: dict[str, Sequence[object]], replicates: int = 1
) -> tuple[tuple[FactorColumn, ...], list[str]]:
    """A full factorial: its factors, and each run's design point."""
    points = [dict(zip(levels, effect, strict=True)) for effect in itertools.product(*levels.values())]
    runs = [(f"p{place}", point) for place, point in enumerate(points) for _ in range(replicates)]
    return factor_columns([point for _, point in runs]), [name for name, _ in runs]  # type: ignore[misc]


def test_a_published_two_way_table_comes_out() -> None:
    """R's own example `warpbreaks` by wool and tension: sums of squares, F and p as R prints them."""
    text = (
        "26 30 54 25 70 52 51 26 67 18 21 29 17 12 18 35 30 36 36 21 24 18 10 43 28 15 26 "
        "27 14 29 19 29 31 41 20 44 42 26 19 16 39 28 21 39 29 20 21 24 17 13 15 15 16 28"
    )
    breaks = [int(word) for word in text.split()]
    factors = factor_columns(
        [{"wool": wool, "tension": tension} for wool in "AB" for tension in "LMH" for _ in range(9)]
    )
    analysis = anova(breaks, factors, [str(run) for run in range(54)])
    wool, tension, interaction = analysis.effects
    assert (analysis.method, wool.df, tension.df, interaction.df) == (PLAIN, 1, 2, 2)
    assert [effect.sum_sq for effect in analysis.effects] == pytest.approx([450.7, 2034.3, 1002.8], abs=0.05)
    assert [effect.f for effect in analysis.effects] == pytest.approx([3.7653, 8.4980, 4.1891], abs=1e-4)
    assert [effect.p for effect in analysis.effects] == pytest.approx(
        [0.0582130, 0.0006926, 0.0210442], abs=1e-6
    )
    total = 450.7 + 2034.3 + 1002.8 + 5745.1
    assert tension.omega2 == pytest.approx((2034.3 - 2 * 119.69) / (total + 119.69), abs=1e-4)


def test_unbalanced_sums_of_squares_are_of_type_two() -> None:
    """Each main effect is what it adds to the other, whatever the order of the factors."""
    draw = np.random.default_rng(5)
    rows = [{"a": str(draw.integers(2)), "b": str(draw.integers(3))} for _ in range(60)]
    y = draw.normal(size=60) + np.array([row["a"] == "1" for row in rows])
    runs = [str(run) for run in range(60)]
    forwards = {effect.term: effect.sum_sq for effect in anova(y, factor_columns(rows), runs).effects}
    backwards = {
        effect.term: effect.sum_sq
        for effect in anova(y, factor_columns([dict(reversed(r.items())) for r in rows]), runs).effects
    }
    assert forwards["a"] == pytest.approx(backwards["a"])
    assert forwards["b"] == pytest.approx(backwards["b"])
    assert forwards["a x b"] == pytest.approx(backwards["b x a"])
    a = np.array([[1.0, row["a"] == "1"] for row in rows])
    ab = np.column_stack([a, [[row["b"] == level for level in "12"] for row in rows]])
    assert forwards["b"] == pytest.approx(OLS(y, a).fit().ssr - OLS(y, ab).fit().ssr)


def test_errors_of_single_runs_are_statsmodels_hc2() -> None:
    """Clusters of one run each give MacKinnon and White's HC2."""
    draw = np.random.default_rng(1)
    x = np.column_stack([np.ones(30), draw.normal(size=(30, 2))])
    y = draw.normal(size=30) * (1 + np.abs(x[:, 1]))
    scaled = known(scaled_residuals(y, x, np.arange(30)))
    errors = clustered_errors(scaled, np.arange(30), np.linalg.pinv(x).T)
    assert errors.T @ errors == pytest.approx(OLS(y, x).fit().cov_HC2)


@pytest.mark.parametrize("size", [20, 130])
@pytest.mark.parametrize("within", [True, False])
def test_residuals_of_small_and_large_clusters_are_scaled_by_the_inverse_root(
    size: int, within: bool
) -> None:
    """Four clusters, whose columns differ within them or only between them, beside scipy's matrix root."""
    draws = np.random.default_rng(size)
    clusters = np.repeat(np.arange(4), size)
    between = np.array([0.0, 1.0, 2.5, 4.0])[clusters]
    x = np.column_stack([np.ones(4 * size), draws.normal(size=4 * size) if within else between])
    y = draws.normal(size=4 * size)
    residual = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    bread = np.linalg.inv(x.T @ x)
    expected = np.concatenate(
        [
            np.linalg.inv(np.real(sqrtm(np.eye(size) - x[part] @ bread @ x[part].T))) @ residual[part]
            for part in (clusters == number for number in range(4))
        ]
    )
    scaled = known(scaled_residuals(y, x, clusters))
    assert scaled == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("replicates", [1, 3])
def test_a_planted_effect_is_found_and_sized(replicates: int) -> None:
    """An effect of one factor and one interaction are found, and nothing else is."""
    factors, points = crossed(
        {"fog": [0.0, 1.0, 2.0], "light": ["day", "dusk"], "wind": [0, 5, 10], "rain": [0, 1]}, replicates
    )
    draw = np.random.default_rng(3)
    fog, light = factors[0].numbers(), factors[1].codes()
    y = 60 - 10 * fog + 6 * (fog - 1) * (2 * light - 1) + draw.normal(0, 3, size=len(points))
    analysis = anova(y, factors, points)
    assert analysis.method == (PLAIN if replicates == 1 else CLUSTERED)
    p = {effect.term: effect.p for effect in analysis.effects}
    adjusted = dict(zip(p, benjamini_hochberg(list(p.values())), strict=True))
    assert {term for term, value in adjusted.items() if value is not None and value < 0.01} == {
        "fog",
        "fog x light",
    }
    sizes = {effect.term: effect.omega2 or 0.0 for effect in analysis.effects}
    assert max(sizes, key=lambda term: sizes[term]) == "fog"
    assert sizes["fog"] > 0.5 > 0.05 > sizes["wind"]


def test_without_effects_few_are_found_though_replicates_agree() -> None:
    """Replicates that share luck at their design point: over seeds, main effects err in about 5 of 100, plain
    errors in many more.
    """
    factors, points = crossed({"a": [0, 1], "b": [0, 1, 2], "c": [0, 1]}, 4)
    runs = [str(run) for run in range(len(points))]
    wrong, naive, families = [], [], []
    for seed in range(120):
        draw = np.random.default_rng(seed)
        y = np.repeat(draw.normal(size=12), 4) + draw.normal(0, 0.7, size=48)
        clustered, plain = (
            [effect.p or 0.0 for effect in anova(y, factors, clusters, interactions=False).effects]
            for clusters in (points, runs)
        )
        wrong += [p < 0.05 for p in clustered]
        naive += [p < 0.05 for p in plain]
        families.append(min(p or 0.0 for p in benjamini_hochberg(clustered)) < 0.05)
    assert np.mean(wrong) < 0.075
    # With no effect anywhere, the false discovery rate is the chance of any finding.
    assert np.mean(families) < 0.09
    assert np.mean(naive) > 0.2


def test_constant_and_aliased_factors_are_named_and_left_out() -> None:
    """A factor with one level, a copy of another, and half of a factorial: said, not crashed on."""
    rows = [
        {"a": a, "b": b, "c": a * b, "same": "x", "copy": f"is {a}"} for a in (-1, 1) for b in (-1, 1)
    ] * 5
    y = np.random.default_rng(0).normal(size=20)
    analysis = anova(y, factor_columns(rows), [str(run) for run in range(20)])
    out = {effect.term: effect.reason for effect in analysis.left_out}
    assert out["same"] == "has one level only"
    assert out["copy"] == "aliased with a"
    assert out["a x b"] == "aliased with c"
    notes = {effect.term: effect.note for effect in analysis.effects}
    assert notes["a"].startswith("cannot be told from copy")
    assert "a x b" in notes["c"]
    assert set(notes) == {"a", "b", "c"}


@pytest.mark.parametrize(
    ("y", "note"),
    [
        ([1.0] * 12, "every value is the same"),
        ([0.0, 3.0] * 6, "the factors determine every value; nothing is left to test against"),
    ],
)
def test_where_there_is_nothing_to_test_no_number_is_made_up(y: list[float], note: str) -> None:
    """No variance, or none left: there is no p, and the note says why."""
    rows = [{"a": run % 2, "b": run % 3} for run in range(12)]
    analysis = anova(y, factor_columns(rows), [str(run) for run in range(12)])
    assert analysis.note == note
    assert all(effect.p is None and effect.f is None for effect in analysis.effects)


def test_a_design_too_small_is_refused_in_words() -> None:
    """As many parameters as design points: nothing is tested."""
    factors, points = crossed({"a": [0, 1, 2], "b": [0]}, 5)
    analysis = anova(np.arange(15.0), factors, points)
    assert analysis.effects == ()
    assert analysis.note == "3 design points are too few for 3 parameters"
    assert anova([1.0, 2.0], (), ["p1", "p2"]).note == "no factor varies"
    assert anova([], (), []).note == "no run has a value"


def test_spread_and_shape_of_residuals_are_checked() -> None:
    """Spread that grows with a factor, and residuals with a long tail, show in the checks; tame ones do not."""
    factors, _ = crossed({"a": list(range(5)), "b": [0, 1]}, 30)
    noise = np.random.default_rng(2).normal(size=300)
    tame, tailed, fanned = (
        anova(values, factors, [str(run) for run in range(300)])
        for values in (noise, np.exp(1.5 * noise), noise * (1 + factors[0].numbers()))
    )
    assert min(tame.normal_p or 0.0, tame.equal_spread_p or 0.0) > 0.05
    assert known(tailed.normal_p) < 1e-6
    assert known(fanned.equal_spread_p) < 0.01


def test_independence_of_a_design() -> None:
    """Nought for a crossed design, one for a copy; names by Cramér's V, numbers by r as well."""
    factors, _ = crossed({"a": [0, 1], "b": [0, 1, 2], "n": ["x", "y"]})
    balanced = independence(factors)
    assert balanced.max_r == pytest.approx(0.0, abs=1e-12)
    assert balanced.max_v == pytest.approx(0.0, abs=1e-12)
    copied = independence((*factors, FactorColumn("copy", tuple(-float(v) for v in factors[0].numbers()))))
    assert copied.max_r == pytest.approx(1.0)
    assert copied.r_pair == ("a", "copy")
    assert copied.max_v == pytest.approx(1.0)
    effect, two = FactorColumn("s", tuple("aabbb")), FactorColumn("t", tuple("xyxyy"))
    assert cramers_v(effect, two) == pytest.approx(1 / 6)  # phi of the table 1 1 / 1 2


def test_adjusted_p_values_are_statsmodels() -> None:
    """Benjamini-Hochberg against another implementation; what was not tested stays so and counts for nothing."""
    p = [0.01, None, 0.04, 0.03, 0.2, 0.005, None, 0.04]
    numbers = [effect for effect in p if effect is not None]
    adjusted = benjamini_hochberg(p)
    assert [effect for effect in adjusted if effect is not None] == pytest.approx(
        list(multipletests(numbers, method="fdr_bh")[1])
    )
    assert adjusted[1] is None
    assert benjamini_hochberg([]) == []


def conditional(level: str = "inactive") -> tuple[list[dict[str, object]], list[float], list[str]]:
    """Sixty runs: GPS drifts in half of them, by a number of its own, and only there costs something; a flag
    plays no part.
    """
    draw = np.random.default_rng(4)
    rows: list[dict[str, object]] = []
    y = []
    for run in range(60):
        drifts = run % 2 == 0
        drift = float(draw.uniform(1.0, 9.0)) if drifts else None
        rows.append(
            {"gps": "drifts" if drifts else "fine", "drift": drift, "beacon": level if run % 3 else "on"}
        )
        y.append(50.0 - (4.0 * drift if drift is not None else 20.0) + float(draw.normal(0.0, 1.0)))
    return rows, y, [str(run) for run in range(60)]


def test_a_range_that_is_active_in_some_runs_is_a_line_there() -> None:
    """Neither thirty names nor a loss of its switch: one degree of freedom, found, and the switch beside it."""
    rows, y, points = conditional()
    analysis = anova(y, factor_columns(rows), points)
    effects = {effect.term: effect for effect in analysis.effects}

    assert effects["drift"].df == 1
    assert effects["drift"].p is not None
    assert effects["drift"].p < 1e-6
    assert not [effect for effect in analysis.left_out if effect.term in ("drift", "gps")]


def test_a_level_that_is_called_inactive_is_a_level() -> None:
    """The word changes nothing: only None stands for a factor that is not there."""
    named, y, points = conditional("inactive")
    other, _, _ = conditional("off")

    assert [(e.term, e.df, e.p) for e in anova(y, factor_columns(named), points).effects] == [
        (e.term, e.df, e.p) for e in anova(y, factor_columns(other), points).effects
    ]
    assert factor_columns(named)[2].levels == ("on", "inactive")


def test_odds_of_conditional_ranges_are_of_their_own_ends() -> None:
    """The base is the lowest level flown, and odds fall with the range."""
    rows, y, points = conditional()
    columns = factor_columns(rows)
    passed = [value + (run % 5) * 4.0 > 34.0 for run, value in enumerate(y)]
    (odds,) = (effect for effect in logistic(passed, columns, points).odds if effect.factor == "drift")
    assert (odds.base, odds.level) == tuple(str(columns[1].levels[end]) for end in (0, -1))
    assert odds.estimate is None or odds.estimate < 1.0


@pytest.mark.parametrize("seed", range(6))
def test_equal_spread_is_tested_as_another_implementation_tests_it(seed: int) -> None:
    """Koenker's form of the Breusch-Pagan test, in statsmodels, on random designs of two to five columns. Runs that all
    came out the same are no error, and no warning.
    """
    draw = np.random.default_rng(seed)
    design = np.column_stack([np.ones(40), draw.normal(size=(40, int(draw.integers(1, 5))))])
    residual = draw.normal(size=40) * (1.0 + np.abs(design[:, 1]))
    assert _equal_spread_p(residual, design) == pytest.approx(het_breuschpagan(residual, design)[1], rel=1e-9)
    two = np.column_stack([np.ones(8), np.tile([0.0, 1.0], 4)])
    assert _equal_spread_p(np.zeros(8), two) is _equal_spread_p(np.tile([1.0, -1.0], 4), two) is None


@pytest.mark.parametrize(
    ("runs", "columns"),
    [
        ([], []),
        ([{"fog": 1.0, "crowd": 2.0}], [("fog", (1.0,)), ("crowd", (2.0,))]),
        (
            [{"fog": 1.0, "crowd": 2.0}, {"crowd": 3.0, "fog": 4.0}],
            [("fog", (1.0, 4.0)), ("crowd", (2.0, 3.0))],
        ),
    ],
)
def test_columns_come_in_the_order_of_the_first_run(
    runs: list[dict[str, float]], columns: list[tuple[str, tuple[float, ...]]]
) -> None:
    assert [(column.name, column.values) for column in factor_columns(runs)] == columns
