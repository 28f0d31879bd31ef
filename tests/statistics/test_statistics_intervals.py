"""What intervals and bounds cover: of pass rates and ratios, of mean scores, of the skill of statements, and of differences
that runs do not rule out.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from known_values import known
from scipy.stats import binom, t

from bench.arrays import Floats
from bench.statistics import (
    FactorColumn,
    bounded_mean,
    clopper_pearson,
    confidence_skill,
    difference_bounds,
    effective_size,
    error_skill,
    replicate_interval,
)
from bench.statistics._proper_scores import Skill

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


def effective(passed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    runs = passed.shape[1] * passed.shape[2]
    mean = passed.mean(axis=(1, 2))
    squared = ((passed.sum(axis=2) - passed.shape[2] * mean[:, None]) ** 2).sum(axis=1)
    size = effective_size(mean, np.full(mean.shape, runs), np.full(mean.shape, passed.shape[1]), squared)
    return mean, size


@pytest.mark.parametrize(
    ("p", "points", "correlation"),
    [
        *((p, points, 1 / 3) for p in (0.5, 0.8) for points in (10, 30)),
        # All runs pass in a quarter of the campaigns or more; taking all as independent there covers 71 to 77 %.
        *((0.9, 10, 0.9), (0.8, 5, 0.9), (0.95, 24, 0.9)),
    ],
)
def test_the_clustered_interval_covers_where_replicates_agree(
    p: float, points: int, correlation: float
) -> None:
    """4000 seeded campaigns of four replicates, whose design points have beta-distributed rates; plain Clopper-Pearson on
    the same runs covers far less.
    """
    rng = np.random.default_rng(17)
    spread = (1.0 - correlation) / correlation
    rates = rng.beta(spread * p, spread * (1.0 - p), (4000, points, 1))
    mean, size = effective(rng.random((4000, points, 4)) < rates)
    low, high = clopper_pearson(mean * size, size)
    plain_low, plain_high = clopper_pearson(np.round(mean * points * 4), np.full(4000, points * 4))
    covered = ((low <= p) & (p <= high)).mean()
    assert covered >= 0.94
    assert ((plain_low <= p) & (p <= plain_high)).mean() < min(0.92, covered)
    assert (size[mean == 1.0] == points).all()
    assert (mean == 1.0).mean() > 0.2 or correlation < 0.5


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


def test_rare_scores_have_no_interval() -> None:
    """A design flown once, or where replicates seldom have a score too: nothing shows how scores vary, and the interval
    would cover 60 to 87 %.
    """
    for few in (np.full((40, 1), 30.0), np.full((4, 2), 30.0), np.full((12, 3), np.nan)):
        assert np.isnan(interval(few)).all()
    assert not np.isnan(interval(np.full((5, 2), 30.0))).any()
    scores = np.full((24, 3), np.nan)
    scores[::4, 0] = np.linspace(10.0, 90.0, 6)
    assert np.isnan(interval(scores)).all()
    scores[:4, :2] = 30.0  # four design points with two scores
    assert np.isnan(interval(scores)).all()
    scores[4, :2] = 30.0  # five
    assert not np.isnan(interval(scores)).any()


SCENES = [f"scene {number // 3}" for number in range(120)]
RANDOM = np.random.default_rng(11)
CHANCE = RANDOM.uniform(0.05, 1.0, 120)
RIGHT = (RANDOM.random(120) < CHANCE).astype(float)
SIGMA_M = RANDOM.uniform(0.5, 8.0, 120)
ERROR_M = SIGMA_M * RANDOM.rayleigh(1.0, 120)


def brier(confidence: Floats, right: Floats) -> float:
    total = sum((stated - is_right) ** 2 for stated, is_right in zip(confidence, right, strict=True))
    return float(total / len(right))


def interval_score(sigma_m: Floats, error_m: Floats) -> float:
    """Gneiting and Raftery (2007), formula (43) with the lower end at 0."""
    total = 0.0
    for sigma, error in zip(sigma_m, error_m, strict=True):
        radius = sigma * (2.0 * np.log(20.0)) ** 0.5
        total += radius + (2.0 / 0.1) * max(error - radius, 0.0)
    return total / len(error_m)


def test_scores_agree_with_plain_loops_and_no_constant_is_better_than_the_best() -> None:
    confidence = confidence_skill(CHANCE, RIGHT, SCENES)
    error = error_skill(SIGMA_M, ERROR_M, SCENES)
    assert confidence is not None
    assert error is not None
    assert confidence.score == pytest.approx(brier(CHANCE, RIGHT))
    assert error.score == pytest.approx(interval_score(SIGMA_M, ERROR_M))
    constants = np.linspace(0.0, 1.0, 201)
    least = min(brier(np.full(120, value), RIGHT) for value in constants)
    assert least - 1e-4 <= confidence.constant_score <= least
    least_m = min(interval_score(np.full(120, 20.0 * value), ERROR_M) for value in constants)
    assert least_m - 0.5 <= error.constant_score <= least_m + 1e-9
    for skill in (confidence, error):
        assert skill.skill == pytest.approx(1.0 - skill.score / skill.constant_score)
        assert (skill.statements, skill.scenes) == (120, 40)


def skill_interval(skill: Skill | None) -> tuple[float, float]:
    """Of a skill that has one."""
    assert skill is not None
    assert skill.low is not None
    assert skill.high is not None
    return skill.low, skill.high


def test_who_knows_has_skill_and_a_constant_has_none() -> None:
    """0.9 and 5 m always, and a sigma that is five times too wide: as the loophole had it."""
    for knows in (confidence_skill(CHANCE, RIGHT, SCENES), error_skill(SIGMA_M, ERROR_M, SCENES)):
        assert skill_interval(knows)[0] > 0.0
    always = (
        confidence_skill(np.full(120, 0.9), RIGHT, SCENES),
        error_skill(np.full(120, 5.0), ERROR_M, SCENES),
        error_skill(5.0 * SIGMA_M, ERROR_M, SCENES),
    )
    for skill in always:
        assert skill is not None
        assert known(skill.skill) <= skill_interval(skill)[1] <= 0.0
    best = known(confidence_skill(np.full(120, RIGHT.mean()), RIGHT, SCENES))
    assert best.skill == pytest.approx(0.0)


def test_the_order_of_the_runs_decides_nothing_and_the_scene_decides_the_interval() -> None:
    turned = confidence_skill(CHANCE[::-1], RIGHT[::-1], SCENES[::-1])
    straight = known(confidence_skill(CHANCE, RIGHT, SCENES))
    assert turned is not None
    assert turned.scenes == straight.scenes
    assert turned.skill == pytest.approx(straight.skill)
    alone = confidence_skill(CHANCE, RIGHT, [f"{number}" for number in range(120)])
    # Every statement ten times in its scene is no more knowledge, and every one a scene of its own would be.
    many = np.tile(CHANCE, 10), np.tile(RIGHT, 10)
    tenfold = confidence_skill(*many, [f"{number}" for number in range(120)] * 10)
    separate = confidence_skill(*many, [f"{number}" for number in range(1200)])
    of_alone, of_tenfold, of_separate = (
        np.ptp(skill_interval(skill)) for skill in (alone, tenfold, separate)
    )
    assert of_tenfold == pytest.approx(of_alone, rel=0.05)
    assert of_separate < 0.5 * of_alone


@pytest.mark.parametrize(("scenes", "has_interval"), [(4, False), (5, True)])
def test_too_few_scenes_have_no_interval(scenes: int, *, has_interval: bool) -> None:
    count = 4 * scenes
    skill = confidence_skill(CHANCE[:count], RIGHT[:count], [f"{row % scenes}" for row in range(count)])
    assert (known(skill).low is not None) is has_interval


def test_where_the_best_constant_is_perfect_there_is_no_skill() -> None:
    skill = known(confidence_skill(np.full(20, 0.9), np.ones(20), SCENES[:20]))
    assert (skill.best_constant, skill.constant_score, skill.skill, skill.low) == (1.0, 0.0, None, None)
    assert confidence_skill(np.zeros(0), np.zeros(0), []) is None


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
    """Over 150 seeds with a difference of 0.3 between the sides, and of 0.4 from end to end, at most 7 % of
    bounds lie below.
    """
    factors, points = runs(4)
    chance = np.array([0.5 + (0.15 if side == "a" else -0.15) for side in factors[0].values])
    sloped = np.array([0.3 + 0.4 * float(value or 0) / 7 for value in factors[1].values])
    draws = np.random.default_rng(5)
    below = {"side": 0, "line": 0}
    for _ in range(150):
        for name, truth, rate in (("side", 0.3, chance), ("line", 0.4, sloped)):
            passes = (draws.random(len(rate)) < rate).astype(float).tolist()
            bound = known(difference_bounds(passes, factors, points)[name])
            below[name] += bound < truth

    assert max(below.values()) <= 10


def test_more_runs_rule_out_more() -> None:
    """Without any effect the bound falls, and straight passes leave open what an exact bound on their number does."""
    draws = np.random.default_rng(6)
    bounds = []
    for replicates in (2, 8, 32):
        factors, points = runs(replicates)
        passes = (draws.random(len(points)) < 0.5).astype(float).tolist()
        bounds.append(difference_bounds(passes, factors, points)["side"] or 1.0)

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


@pytest.mark.parametrize("levels", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_the_bound_of_levels_is_that_of_the_worst_pair_of_means(seed: int, levels: int) -> None:
    """Each run is a design point of its own: the difference of the means, plus t times the larger of Welch's and
    the pooled standard error, with as many degrees of freedom less than runs as there are levels.
    """
    draws = np.random.default_rng(seed)
    spans = ((0.0, 0.4, 16), (0.3, 0.9, 9), (0.5, 0.9, 12))[:levels]
    groups = [draws.uniform(low, high, size) for low, high, size in spans]
    factor = FactorColumn("side", tuple("abc"[k] for k, group in enumerate(groups) for _ in group))
    runs = len(factor.values)
    pooled = sum(float(group.var(ddof=1)) * (len(group) - 1) for group in groups) / (runs - levels)
    expected = max(
        abs(one.mean() - other.mean())
        + float(t.ppf(0.8, runs - levels))
        * np.sqrt(
            max(
                one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other),
                pooled * (1 / len(one) + 1 / len(other)),
            )
        )
        for one, other in itertools.combinations(groups, 2)
    )
    points = [f"p{number}" for number in range(runs)]
    bound = difference_bounds(np.concatenate(groups).tolist(), [factor], points, confidence=0.8)["side"]
    assert bound == pytest.approx(expected)
