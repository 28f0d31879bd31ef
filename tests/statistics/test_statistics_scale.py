"""The explanatory item-response model and the proof of a scale, with independent references."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize
from scipy.special import expit

from bench.arrays import Bools, Counts, Floats
from bench.statistics import fit_item_response, prove_scale
from bench.statistics._item_response import ABILITY_SD, RESIDUAL_SD, WEIGHT_SCALE, fit_abilities
from bench.statistics._scale_proof import within_agent_auc

AGENTS, SCENES = 6, 60
WEIGHTS = np.array([1.5, -0.8, 0.0])


def flown(seed: int, agents: int = AGENTS) -> tuple[Bools, Counts, Counts, Floats]:
    """Failures of agents of graded ability in scenes of three features: failed, agent, scene, features."""
    random = np.random.default_rng(seed)
    features = random.standard_normal((SCENES, 3))
    features = (features - features.mean(axis=0)) / features.std(axis=0)
    agent = np.tile(np.arange(agents, dtype=np.int64), SCENES)
    scene = np.repeat(np.arange(SCENES, dtype=np.int64), agents)
    ability = np.linspace(-1.0, 1.0, agents)
    chance = expit(ability[agent] + features[scene] @ WEIGHTS)
    return np.asarray(random.random(len(chance)) < chance, dtype=np.bool_), agent, scene, features


def test_the_fit_is_the_mode_of_the_penalised_likelihood() -> None:
    """An optimizer that knows no derivative of ours finds the same; the signs of weights, a placebo near 0 and the order
    of agents are those that made the runs.
    """
    failed, agent, scene, features = flown(0)
    fit = fit_item_response(failed, agent, scene, features)
    assert fit.weights[0] > 0.8
    assert fit.weights[1] < -0.2
    assert abs(fit.weights[2]) < 0.45
    assert fit.abilities[:2].mean() < fit.abilities[2:4].mean() < fit.abilities[4:].mean()
    sign = np.where(failed, 1.0, -1.0)

    def loss(beta: Floats) -> float:
        mean, ability, weight, residual = np.split(beta, [1, 1 + AGENTS, 1 + AGENTS + 3])
        log_odds = mean + ability[agent] + features[scene] @ weight + residual[scene]
        penalty = (ability @ ability) / ABILITY_SD**2 + (residual @ residual) / RESIDUAL_SD**2
        # Laplace's prior, smooth at 0.
        laplace = np.sqrt(weight**2 + 1e-8).sum() / WEIGHT_SCALE
        return float(np.logaddexp(0.0, -sign * log_odds).sum() + penalty / 2.0 + laplace)

    mode = optimize.minimize(
        loss, np.zeros(1 + AGENTS + 3 + SCENES), method="L-BFGS-B", options={"maxiter": 5000, "maxfun": 10**6}
    )
    assert fit.abilities == pytest.approx(mode.x[0] + mode.x[1 : 1 + AGENTS], abs=0.05)
    assert fit.weights == pytest.approx(mode.x[1 + AGENTS : 4 + AGENTS], abs=0.08)


def test_features_without_a_meaning_get_small_weights() -> None:
    """Where nothing but ability decides, most weights are next to 0."""
    failed, agent, scene, _ = flown(3)
    noise = np.random.default_rng(4).standard_normal((SCENES, 12))
    shuffled = np.random.default_rng(5).permutation(SCENES)[scene]
    fit = fit_item_response(failed, agent, shuffled, noise)
    assert np.abs(fit.weights).max() < 0.45
    assert np.median(np.abs(fit.weights)) < 0.05


def test_agents_that_fail_or_pass_everything_stay_finite() -> None:
    """With offsets, an ability is what is left: it undoes the mean of the offsets."""
    failed = np.repeat([0.0, 1.0, 1.0, 0.0], 10)
    agent = np.repeat([0, 1, 2, 2], 10)
    ability = fit_abilities(failed, agent, np.zeros(40))
    assert -8.0 < ability[0] < -1.0 < 1.0 < ability[1] < 8.0
    assert fit_abilities(failed, agent, np.full(40, 2.0)) == pytest.approx(ability - 2.0, abs=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_the_auc_is_that_of_a_count_of_pairs(seed: int) -> None:
    """Pairs of one agent alone; ties are a half."""
    random = np.random.default_rng(seed)
    difficulty, failed = random.integers(0, 6, 60).astype(float), random.random(60) < 0.4
    agent = random.integers(0, 3, 60)
    right = [
        1.0 if difficulty[i] > difficulty[j] else 0.5 if difficulty[i] == difficulty[j] else 0.0
        for i in range(60)
        for j in range(60)
        if agent[i] == agent[j] and failed[i] and not failed[j]
    ]
    assert within_agent_auc(difficulty, failed, agent) == pytest.approx(np.mean(right))
    assert within_agent_auc(difficulty, np.ones(60, dtype=np.bool_), agent) is None


def proof_of(slope: float, seed: int = 0, scenes: int = SCENES, shift: float = 1.0):  # type: ignore[no-untyped-def]
    """A proof where the log odds of failure rise by `slope` for each 10 points, and `shift` of that is predicted."""
    random = np.random.default_rng(seed)
    log_odds = np.repeat(random.uniform(-3.0, 3.0, scenes), 4)
    failed = random.random(4 * scenes) < expit(slope * log_odds)
    agents = [f"agent {k % 4}" for k in range(4 * scenes)]
    points = [f"point {k // 4}" for k in range(4 * scenes)]
    return prove_scale(50.0 + 10.0 * log_odds, shift * log_odds, failed, agents, points)


def test_a_scale_that_predicts_is_proved() -> None:
    """Its AUC and slope are high, its bins agree, and the interval of the AUC holds it."""
    proof = proof_of(1.0)
    assert proof.reason == ""
    assert proof.auc_low < proof.auc < proof.auc_high
    assert proof.auc_low > 0.75
    assert proof.slope.low < 1.0 < proof.slope.high
    assert sum(part.trials for part in proof.bins) == 240
    assert [part.predicted for part in proof.bins] == sorted(part.predicted for part in proof.bins)


@pytest.mark.parametrize(
    ("proof", "reason"),
    [
        (proof_of(0.0), "failure was not shown to rise with it"),
        (proof_of(-1.0), "failure was not shown to rise with it"),
        (proof_of(0.35), "AUC below 0.75"),
        (proof_of(1.0, shift=-0.5), "predicted failure is off by more than 10%"),
        (proof_of(1.0, scenes=14), "24 passes in 56 runs"),
    ],
)
def test_a_scale_that_does_not_predict_says_why(proof, reason: str) -> None:  # type: ignore[no-untyped-def]
    """One reason for each way to fail."""
    assert reason in proof.reason


@pytest.mark.parametrize(
    ("failures", "passes", "reason"),
    [(30, 30, ""), (29, 40, "29 failures in 69 runs"), (40, 29, "29 passes in 69 runs")],
)
def test_the_count_of_outcomes_has_both_sides(failures: int, passes: int, reason: str) -> None:
    failed = np.repeat([True, False], [failures, passes])
    log_odds = np.where(failed, 2.0, -2.0)
    # One of ten is the other way round, so that nothing is separated.
    log_odds[::10] *= -1.0
    count = failures + passes
    points = [f"p{k}" for k in range(count)]
    assert prove_scale(50.0 + 10.0 * log_odds, log_odds, failed, ["a"] * count, points).reason == reason
