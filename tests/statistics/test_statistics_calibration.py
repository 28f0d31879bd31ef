"""Rated difficulty against outcomes: slopes and rank correlations, with independent references."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy import optimize, stats

from bench.arrays import Floats
from bench.statistics import (
    DifficultySlope,
    Direction,
    RankAssociation,
    SlopeState,
    difficulty_slope,
    rank_association,
)
from bench.statistics._regression import separated as separated_by_programme

DIFFICULTIES = np.array([20.0, 35.0, 50.0, 65.0, 80.0])


def simulated_slope(
    seed: int, points: int, slope: float, abilities: tuple[float, ...] = (-1.0, 0.5), spread: float = 0.7
) -> DifficultySlope:
    """A fit to three runs of each agent at each design point; design points have a normal effect of their
    own.
    """
    random = np.random.default_rng([seed, points])
    difficulty = np.repeat(random.choice(DIFFICULTIES, points), 3)
    effect = np.repeat(random.normal(0.0, spread, points), 3)
    failed, agents = [], []
    for number, ability in enumerate(abilities):
        log_odds = ability + slope * (difficulty - 50.0) / 10.0 + effect
        failed += list(random.random(3 * points) < 1.0 / (1.0 + np.exp(-log_odds)))
        agents += [f"agent-{number}"] * (3 * points)
    names = [f"p{number}" for number in np.repeat(np.arange(points), 3)] * len(abilities)
    return difficulty_slope(np.tile(difficulty, len(abilities)), failed, agents, names)


@pytest.mark.parametrize(("points", "slope"), [(12, 0.0), (30, 0.5)])
def test_the_interval_of_a_slope_covers_the_true_one(points: int, slope: float) -> None:
    """In 60 simulated campaigns some 57 intervals hold the slope; at no slope few claim one."""
    fits = [simulated_slope(seed, points, slope) for seed in range(60)]
    # The mean curve over design points with normal effects is flatter: Zeger, Liang and Albert (1988).
    marginal = slope / np.sqrt(1.0 + 0.346 * 0.7**2)
    covered = sum(
        fit.low <= marginal <= fit.high for fit in fits if fit.low is not None and fit.high is not None
    )
    assert covered >= 53
    rising = sum(fit.direction is Direction.RISES for fit in fits)
    assert (rising >= 50) if slope else (rising <= 6)


def test_failure_that_falls_with_difficulty_is_told_as_such() -> None:
    """The mirror image of a rising slope has the opposite direction and the opposite interval, a moderate one."""
    rising, falling = simulated_slope(1, 40, 0.5), simulated_slope(1, 40, -0.5)
    assert (rising.direction, falling.direction) == (Direction.RISES, Direction.FALLS)
    assert falling.high is not None
    assert -1.0 < falling.high < 0.0


def test_slope_and_abilities_are_those_of_the_likelihood() -> None:
    """The estimates agree with a general optimizer, and even chances lie where the model has them."""
    random = np.random.default_rng(5)
    difficulty, code = random.choice(DIFFICULTIES, 200), random.integers(0, 2, 200)
    log_odds = np.array([-1.0, 0.6])[code] + 0.4 * (difficulty - 50.0) / 10.0
    failed = random.random(200) < 1.0 / (1.0 + np.exp(-log_odds))
    fit = difficulty_slope(difficulty, failed, [f"a{k}" for k in code], [str(n) for n in range(200)])

    def loss(beta: Floats) -> float:
        line = beta[code] + beta[2] * difficulty / 10.0
        return float(np.logaddexp(0.0, np.where(failed, -line, line)).sum())

    best = optimize.minimize(loss, np.zeros(3), method="BFGS").x
    assert fit.state is SlopeState.FITTED
    assert fit.slope == pytest.approx(best[2], abs=1e-4)
    even = {ability.agent: ability.even_chance_at for ability in fit.agents}
    assert even["a0"] == pytest.approx(-10.0 * best[0] / best[2], abs=1e-2)
    assert even["a1"] == pytest.approx(-10.0 * best[1] / best[2], abs=1e-2)


def separated(points: int, replicates: int, limits: tuple[float, ...] = (40.0, 60.0)) -> DifficultySlope:
    """Agents that fail above a difficulty and never below."""
    difficulty = np.repeat(np.linspace(10.0, 90.0, points), replicates)
    failed = np.concatenate([difficulty > limit for limit in limits])
    names = [f"p{number}" for number in np.repeat(np.arange(points), replicates)] * len(limits)
    agents = [f"a{number}" for number in range(len(limits)) for _ in difficulty]
    return difficulty_slope(np.tile(difficulty, len(limits)), failed, agents, names)


def test_separated_results_have_a_finite_slope_that_replicates_do_not_sharpen() -> None:
    """Firth's likelihood where there is no maximum; ten replicates that agree claim no more than one."""
    single, many = separated(20, 1), separated(20, 10)
    assert single.state is many.state is SlopeState.SEPARATED
    assert "a design point counts as one run" in many.method
    assert single.direction is many.direction is Direction.RISES
    assert (many.slope, many.low, many.p) == pytest.approx((single.slope, single.low, single.p), abs=0.02)
    assert single.high is many.high is None
    # Two or three of five points fail: 1 of 10 orders is as extreme, on either side.
    assert separated(5, 10, (50.0,)).direction is Direction.OPEN


def test_separated_results_may_also_fall() -> None:
    """Agents that fail below a difficulty only: the interval has an upper end and no lower one."""
    difficulty = np.linspace(10.0, 90.0, 20)
    failed = np.concatenate([difficulty < 40.0, difficulty < 60.0])
    names = [f"p{number}" for number in range(20)] * 2
    fit = difficulty_slope(np.tile(difficulty, 2), failed, ["a0"] * 20 + ["a1"] * 20, names)
    assert (fit.state, fit.direction) == (SlopeState.SEPARATED, Direction.FALLS)
    assert fit.low is None
    assert fit.high is not None


@pytest.mark.parametrize("seed", range(8))
def test_separation_is_that_of_the_linear_programme(seed: int) -> None:
    """Few trials at few difficulties, so that some are separated, by either sign of the slope, and some not."""
    random = np.random.default_rng(seed)
    states = set()
    for _ in range(25):
        # Two agents that both pass and fail.
        failed = np.array([True, False, random.random() < 0.5, True, False, random.random() < 0.5])
        difficulty = random.integers(0, 3, 6) * 10.0
        if len(np.unique(difficulty[:3])) < 2 or len(np.unique(difficulty[3:])) < 2:
            continue
        agents = np.repeat(["a", "b"], 3)
        fit = difficulty_slope(
            np.tile(difficulty, 2),
            np.tile(failed, 2),
            [*agents, *agents],
            [str(place) for place in range(12)],
        )
        x = np.column_stack([agents == "a", agents == "b", difficulty]).astype(np.float64)
        assert (fit.state is SlopeState.SEPARATED) == separated_by_programme(failed.astype(np.float64), x)
        states.add(fit.state)
    assert states == {SlopeState.SEPARATED, SlopeState.FITTED}


def test_an_agent_that_passes_everything_does_not_change_the_slope() -> None:
    """It is listed with its trials, without an even chance."""
    two = simulated_slope(1, 20, 0.5)
    three = simulated_slope(1, 20, 0.5, abilities=(-1.0, 0.5, -50.0))
    assert (three.slope, three.low, three.high) == (two.slope, two.low, two.high)
    assert [(ability.trials, ability.failed) for ability in three.agents][2] == (60, 0)
    assert three.agents[2].even_chance_at is None
    assert three.trials == 120


@pytest.mark.parametrize(
    ("difficulty", "failed", "points", "state"),
    [
        ([40.0] * 8, [True, False] * 4, 8, SlopeState.ONE_DIFFICULTY),
        ([20.0, 40.0] * 4, [False] * 8, 8, SlopeState.NO_MIXED_AGENT),
        ([20.0, 40.0] * 4, [True, True, False, False] * 2, 3, SlopeState.TOO_FEW),
        ([], [], 1, SlopeState.NEVER_CONSIDERED),
    ],
)
def test_data_without_a_slope(
    difficulty: list[float], failed: list[bool], points: int, state: SlopeState
) -> None:
    """The state says why there is none, and nothing is claimed."""
    names = [f"p{number % points}" for number in range(len(failed))]
    fit = difficulty_slope(difficulty, failed, ["a"] * len(failed), names)
    assert (fit.state, fit.slope, fit.direction) == (state, None, Direction.OPEN)


def test_agents_at_one_difficulty_each_have_no_slope() -> None:
    """Their difference can be one of ability as well as of difficulty."""
    names = [f"p{number}" for number in range(20)]
    fit = difficulty_slope([20.0] * 10 + [80.0] * 10, [True, False] * 10, ["a"] * 10 + ["b"] * 10, names)
    assert (fit.state, fit.slope, fit.trials, fit.difficulties) == (SlopeState.ONE_DIFFICULTY, None, 0, 2)


def random_trials(seed: int, count: int = 40) -> tuple[Floats, list[bool], list[str], list[str], list[str]]:
    """Ratings, failures, agents, observables and design points; a design point may have several ratings."""
    random = np.random.default_rng(seed)
    rating = random.integers(0, 4, count).astype(float)
    failed = [bool(value) for value in random.random(count) < 0.2 + 0.15 * rating]
    labels = (
        [f"{kind}{code}" for code in random.integers(0, size, count)]
        for kind, size in (("a", 2), ("o", 2), ("p", 8))
    )
    agents, observables, points = labels
    return rating, failed, agents, observables, points


@pytest.mark.parametrize("seed", range(5))
def test_one_stratum_has_the_usual_tau_b(seed: int) -> None:
    """As scipy computes it."""
    rating, failed, _, _, points = random_trials(seed)
    ours = rank_association(rating, failed, ["a"] * 40, ["o"] * 40, points)
    assert ours.tau == pytest.approx(stats.kendalltau(rating, failed).statistic, abs=1e-12)


def pairwise_tau(
    rating: Floats,
    failed: list[bool],
    agents: list[str],
    observables: list[str],
    leave_out: str,
    points: list[str],
) -> float:
    """Tau-b from every pair within a stratum, one by one."""
    concordance = untied_ratings = untied_results = 0
    places = [number for number, point in enumerate(points) if point != leave_out]
    for i, j in combinations(places, 2):
        if (agents[i], observables[i]) == (agents[j], observables[j]):
            concordance += int(np.sign(rating[i] - rating[j])) * (int(failed[i]) - int(failed[j]))
            untied_ratings += rating[i] != rating[j]
            untied_results += failed[i] != failed[j]
    return float(concordance / np.sqrt(untied_ratings * untied_results))


def test_strata_and_jackknife_are_those_of_a_count_of_pairs() -> None:
    """Tau within agents and observables, and its interval on Fisher's z, from pairs counted one by one."""
    trials = random_trials(3, 60)
    ours = rank_association(*trials)
    without = [pairwise_tau(*trials[:4], point, trials[4]) for point in sorted(set(trials[4]))]
    tau = pairwise_tau(*trials[:4], "", trials[4])
    z = np.arctanh(without)
    error = np.sqrt((len(z) - 1) * z.var())
    reach = stats.t.ppf(0.975, len(z) - 1) * error
    assert ours.tau == pytest.approx(tau, abs=1e-12)
    assert (ours.low, ours.high) == pytest.approx(
        (np.tanh(np.arctanh(tau) - reach), np.tanh(np.arctanh(tau) + reach)), abs=1e-9
    )
    assert ours == rank_association(*trials)


def simulated_association(seed: int, points: int, rates: tuple[float, ...]) -> RankAssociation:
    """Two agents fly each design point three times; its own rate scatters about that of its rating."""
    random = np.random.default_rng([seed, points])
    level = random.integers(0, len(rates), points)
    rate = random.beta(3.0 * np.array(rates)[level], 3.0 * (1.0 - np.array(rates)[level]))
    number = np.tile(np.repeat(np.arange(points), 3), 2)
    failed = random.random(6 * points) < rate[number]
    agents = [f"a{place // (3 * points)}" for place in range(6 * points)]
    return rank_association(
        level[number], failed, agents, ["o"] * len(agents), [f"p{place}" for place in number], seed=seed
    )


@pytest.mark.parametrize(("points", "rates"), [(10, (0.4,) * 5), (20, (0.1, 0.3, 0.5, 0.7, 0.9))])
def test_the_interval_of_a_rank_correlation_covers_the_true_one(
    points: int, rates: tuple[float, ...]
) -> None:
    """In 50 simulated campaigns some 47 intervals hold the true tau; without an order hardly one is claimed."""
    share = 1.0 / len(rates)
    concordance = sum(share**2 * (high - low) for low, high in combinations(rates, 2))
    overall = float(np.mean(rates))
    tau = concordance / np.sqrt((1.0 - share) / 2.0 * overall * (1.0 - overall))
    results = [simulated_association(seed, points, rates) for seed in range(50)]
    ends = [
        (result.low, result.high) for result in results if result.low is not None and result.high is not None
    ]
    assert len(ends) == 50
    assert sum(low <= tau <= high for low, high in ends) >= 43
    agreeing = sum(result.agrees() for result in results)
    assert (agreeing <= 5) if concordance < 1e-12 else (agreeing >= 40)
    assert sum(result.contradicts() for result in results) <= 5


def test_few_design_points_in_perfect_order_claim_nothing() -> None:
    """Six points whose order is perfect could be chance (2 of 20 orders); sixteen could not (2 of 12,870)."""
    for points, p, claimed in ((6, 0.1, False), (16, 0.001, True)):
        rating = np.repeat([10.0, 60.0], points // 2)
        names = [f"p{number}" for number in range(points)]
        backwards = rank_association(rating, rating < 30.0, ["a"] * points, ["o"] * points, names)
        assert (backwards.tau, backwards.low, backwards.note) == (-1.0, None, "in perfect order")
        assert backwards.p == pytest.approx(p, abs=0.03)
        assert backwards.contradicts() is claimed
        assert not backwards.agrees()


@pytest.mark.parametrize(
    ("rating", "failed", "points", "note"),
    [
        ([], [], 6, "never considered"),
        ([10.0] * 6, [True, False] * 3, 6, "one rating only"),
        ([10.0, 20.0] * 3, [True] * 6, 6, "no agent both passes and fails"),
        ([10.0, 20.0] * 3, [True, False, False] * 2, 3, "too few design points"),
        ([10.0, 20.0, 30.0] * 2, [True] + [False] * 5, 6, "one design point decides"),
    ],
)
def test_data_without_an_interval(rating: list[float], failed: list[bool], points: int, note: str) -> None:
    """The note says why, and nothing is claimed."""
    names = [f"p{number % points}" for number in range(len(rating))]
    result = rank_association(rating, failed, ["a"] * len(rating), ["o"] * len(rating), names)
    assert (result.note, result.low, result.high) == (note, None, None)
    assert not result.agrees()
    assert not result.contradicts()


def test_agents_of_different_ability_are_not_taken_for_difficulty() -> None:
    """A poor agent flies easy scenes and a good one hard scenes: pooled, the order would look reversed."""
    rating = [10.0, 20.0] * 10 + [80.0, 90.0] * 10
    failed = [True] * 15 + [False] * 5 + [False] * 15 + [True] * 5
    agents = ["poor"] * 20 + ["good"] * 20
    names = [f"p{number}" for number in range(40)]
    pooled = rank_association(rating, failed, ["both"] * 40, ["o"] * 40, names)
    apart = rank_association(rating, failed, agents, ["o"] * 40, names)
    assert pooled.contradicts()
    assert apart.tau is not None
    assert abs(apart.tau) < 0.2
    assert not apart.contradicts()
