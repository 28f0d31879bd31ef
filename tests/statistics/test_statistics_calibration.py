"""Rated difficulty against outcomes: slopes and shuffles, with independent references."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest
from known_values import known
from scipy import optimize

from bench.arrays import Floats
from bench.statistics import (
    DifficultySlope,
    Direction,
    SlopeState,
    difficulty_slope,
)
from bench.statistics._regression import separated as separated_by_programme
from bench.statistics._shuffles import shuffled_p

DIFFICULTIES = np.array([20.0, 35.0, 50.0, 65.0, 80.0])


def simulated_slope(
    seed: int, points: int, slope: float, abilities: tuple[float, ...] = (-1.0, 0.5), spread: float = 0.7
) -> DifficultySlope:
    """A fit to three runs of each agent at each design point; design points have a normal effect of their own."""
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
    assert -1.0 < known(falling.high) < 0.0


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


def separated(
    points: int, replicates: int, limits: tuple[float, ...] = (40.0, 60.0), *, falls: bool = False
) -> DifficultySlope:
    """Agents that fail above a difficulty and never below, or below and never above."""
    difficulty = np.repeat(np.linspace(10.0, 90.0, points), replicates)
    failed = np.concatenate([(difficulty > limit) != falls for limit in limits])
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
    # A slope that falls has an upper end and no lower one.
    falling = separated(20, 1, falls=True)
    assert (falling.state, falling.direction) == (SlopeState.SEPARATED, Direction.FALLS)
    assert falling.low is None
    assert falling.high is not None


@pytest.mark.parametrize("seed", range(2))
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
    ("difficulty", "failed", "agents", "points", "state"),
    [
        ([40.0] * 8, [True, False] * 4, "a" * 8, 8, SlopeState.ONE_DIFFICULTY),
        # Each agent at one: their difference can be one of ability as well as of difficulty.
        ([20.0] * 10 + [80.0] * 10, [True, False] * 10, "a" * 10 + "b" * 10, 20, SlopeState.ONE_DIFFICULTY),
        ([20.0, 40.0] * 4, [False] * 8, "a" * 8, 8, SlopeState.NO_MIXED_AGENT),
        ([20.0, 40.0] * 4, [True, True, False, False] * 2, "a" * 8, 3, SlopeState.TOO_FEW),
        ([], [], "", 1, SlopeState.NEVER_CONSIDERED),
    ],
)
def test_data_without_a_slope(
    difficulty: list[float], failed: list[bool], agents: str, points: int, state: SlopeState
) -> None:
    """The state says why there is none, and nothing is claimed."""
    names = [f"p{number % points}" for number in range(len(failed))]
    fit = difficulty_slope(difficulty, failed, [*agents], names)
    assert (fit.state, fit.slope, fit.direction) == (state, None, Direction.OPEN)
    assert fit.difficulties == len({*difficulty})


@pytest.mark.parametrize("seed", range(2))
def test_the_p_of_shuffles_is_that_of_all_permutations(seed: int) -> None:
    """Six design points that two agents flew twice each: every order of difficulties, pairs counted one by one."""
    random = np.random.default_rng(seed)
    point, agent = np.tile(np.repeat(np.arange(6), 2), 2), np.repeat(np.arange(2), 12)
    hard = random.integers(0, 4, 6).astype(float)
    failed = random.random(24) < 0.2 + 0.2 * hard[point]

    def concordance(order: tuple[int, ...]) -> int:
        value = hard[list(order)][point]
        return sum(
            int(np.sign(value[i] - value[j])) * (int(failed[i]) - int(failed[j]))
            for i, j in combinations(range(24), 2)
            if agent[i] == agent[j]
        )

    observed = abs(concordance(tuple(range(6))))
    exact = np.mean([abs(concordance(order)) >= observed - 0.5 for order in permutations(range(6))])
    assert shuffled_p(hard[point], failed, agent, point) == pytest.approx(exact, abs=0.05)
    assert shuffled_p(hard[point], failed, agent, point) == shuffled_p(hard[point], failed, agent, point)


def test_few_design_points_in_perfect_order_claim_nothing() -> None:
    """Six points whose order is perfect could be chance (2 of 20 orders); sixteen could not (2 of 12,870)."""
    for points, p in ((6, 0.1), (16, 0.001)):
        hard, one = np.repeat([10.0, 60.0], points // 2), np.zeros(points, dtype=np.int64)
        assert shuffled_p(hard, hard < 30.0, one, np.arange(points)) == pytest.approx(p, abs=0.03)


def test_agents_of_different_ability_are_not_taken_for_difficulty() -> None:
    """A poor agent flies easy scenes and a good one hard scenes: pooled, the order would look reversed."""
    hard = np.array([10.0, 20.0] * 10 + [80.0, 90.0] * 10)
    failed = np.array([True] * 15 + [False] * 5 + [False] * 15 + [True] * 5)
    agents, points = np.repeat([0, 1], 20), np.arange(40)
    assert shuffled_p(hard, failed, np.zeros(40, dtype=np.int64), points) <= 0.05
    assert shuffled_p(hard, failed, agents, points) > 0.2
