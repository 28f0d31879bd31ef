"""An explanatory item-response model: failure from an agent's ability and a situation's features.

The linear logistic test model with a residual of each situation: log odds of failure = ability of the agent +
weights x features + residual. Fischer, G. H. (1973), "The linear logistic test model as an instrument in
educational research", Acta Psychologica 37, 359-374; De Boeck, P. and Wilson, M. (2004), "Explanatory Item
Response Models", Springer. Weights and residuals are penalised by their squares (normal priors).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

from bench.arrays import Floats

# Of an ability round their common mean, in log odds: agents that fail or pass every trial stay finite. Chosen: it holds
# 95 % of agents within failure shares of 2 and 98 %.
ABILITY_SD = 2.0
# Of what features do not tell of a situation, in log odds. Chosen, as the spread of the features' own part.
RESIDUAL_SD = 1.0
# Standard deviations of a weight that are tried, in log odds for one standard deviation of its feature.
WEIGHT_SDS = (0.05, 0.1, 0.2, 0.4, 0.8)
FOLDS = 6


@dataclass(frozen=True, slots=True)
class ItemResponse:
    """A fit: `abilities` are log odds of failure where all features are 0, by agent; `weights` by feature."""

    abilities: Floats
    weights: Floats
    weight_sd: float


def fit_item_response(
    failed: ArrayLike, agents: ArrayLike, scenes: ArrayLike, features: Floats, *, seed: int = 0
) -> ItemResponse:
    """Fit trials to agents and to the features of their scenes.

    `agents` and `scenes` are codes from 0; `features` is (scenes, features), each of mean 0 and deviation 1.
    The spread of the weights is that of WEIGHT_SDS that predicts scenes left out of the fit best, by log loss.
    """
    fails = np.asarray(failed, dtype=np.float64)
    agent, scene = np.asarray(agents, dtype=np.int64), np.asarray(scenes, dtype=np.int64)
    fold = np.random.default_rng(seed).permutation(len(features)) % FOLDS
    losses = dict.fromkeys(WEIGHT_SDS, 0.0)
    for left_out in range(FOLDS):
        kept = fold[scene] != left_out
        for sd in WEIGHT_SDS:
            fit = _fit(fails[kept], agent[kept], scene[kept], features, sd, int(agent.max()) + 1)
            log_odds = fit.abilities[agent[~kept]] + features[scene[~kept]] @ fit.weights
            losses[sd] += log_loss(fails[~kept], expit(log_odds))
    best = min(WEIGHT_SDS, key=lambda sd: losses[sd])
    return _fit(fails, agent, scene, features, best, int(agent.max()) + 1)


def log_loss(failed: Floats, chance: Floats) -> float:
    """Minus the log likelihood of outcomes, of which none was impossible."""
    chance = np.clip(chance, 1e-6, 1.0 - 1e-6)
    return -float((failed * np.log(chance) + (1.0 - failed) * np.log1p(-chance)).sum())


def fit_abilities(failed: Floats, agents: NDArray[np.int64], offset: Floats) -> Floats:
    """Log odds of failure of each agent beside the offsets of its trials."""
    count = int(agents.max()) + 1
    x = np.column_stack([np.ones(len(failed)), agents[:, None] == np.arange(count)]).astype(np.float64)
    beta = _newton(failed, x, np.r_[0.0, np.full(count, ABILITY_SD**-2)], offset)
    abilities: Floats = beta[0] + beta[1:]
    return abilities


def _fit(
    failed: Floats,
    agents: NDArray[np.int64],
    scenes: NDArray[np.int64],
    features: Floats,
    weight_sd: float,
    agent_count: int,
) -> ItemResponse:
    flown, residual = np.unique(scenes, return_inverse=True)
    columns = [
        np.ones((len(failed), 1)),
        agents[:, None] == np.arange(agent_count),
        features[scenes],
        residual[:, None] == np.arange(len(flown)),
    ]
    precision = np.r_[
        0.0,
        np.full(agent_count, ABILITY_SD**-2),
        np.full(features.shape[1], weight_sd**-2),
        np.full(len(flown), RESIDUAL_SD**-2),
    ]
    beta = _newton(failed, np.hstack(columns).astype(np.float64), precision, np.zeros(len(failed)))
    return ItemResponse(
        beta[0] + beta[1 : agent_count + 1],
        beta[agent_count + 1 : agent_count + 1 + features.shape[1]],
        weight_sd,
    )


def _newton(failed: Floats, x: Floats, precision: Floats, offset: Floats) -> Floats:
    """The mode of a penalised logistic regression; the penalty makes it finite and unique."""
    beta = np.zeros(x.shape[1])
    # An unpenalised intercept of outcomes that are all alike would run away.
    penalty = np.where(precision > 0.0, precision, 1e-4)
    for _ in range(100):
        chance = expit(x @ beta + offset)
        slope = x.T @ (failed - chance) - penalty * beta
        curvature = (x.T * (chance * (1.0 - chance))) @ x + np.diag(penalty)
        step = np.linalg.solve(curvature, slope)
        # Far from the mode a full step of Newton's overshoots; two units of log odds never do.
        step *= min(1.0, 2.0 / float(np.abs(step).max()))
        beta += step
        if float(np.abs(step).max()) < 1e-9:
            break
    return beta
