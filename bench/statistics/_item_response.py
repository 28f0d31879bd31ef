"""An explanatory item-response model: failure from an agent's ability and a situation's features.

The linear logistic test model with a residual of each situation: log odds of failure = ability of the agent +
weights x features + residual. Fischer, G. H. (1973), "The linear logistic test model as an instrument in
educational research", Acta Psychologica 37, 359-374; De Boeck, P. and Wilson, M. (2004), "Explanatory Item
Response Models", Springer. Abilities and residuals have normal priors, weights have Laplace's, which leaves most of
them near 0: Tibshirani, R. (1996), "Regression shrinkage and selection via the lasso", JRSS B 58, 267-288.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from bench.arrays import Counts, Floats

# Of an ability round their common mean, in log odds: agents that fail or pass every trial stay finite. Chosen: it holds
# 95 % of agents within failure shares of 2 and 98 %.
ABILITY_SD = 2.0
# Of what features do not tell of a situation, and of the weights (Laplace's scale, for one deviation of a feature), in log
# odds. From six folds over the 36 scenes of campaigns/panel.yaml, 34 key attributes: log loss of scenes left out 0.487 a run;
# 0.491 with a residual of 1; 0.510 and 0.496 with a scale of 0.03 and 0.2; 0.512 without features. Normal priors: 0.510 at
# their best.
RESIDUAL_SD = 0.6
WEIGHT_SCALE = 0.1
# Laplace's prior is reached by normal ones whose variance follows the weights. Steps from the start, its deviation, and the
# least one, which keeps a weight of 0 from staying there.
REWEIGHTED, FIRST_SD, LEAST_SD = 6, 0.4, 0.01


@dataclass(frozen=True, slots=True)
class ItemResponse:
    """A fit: `abilities` are log odds of failure where all features are 0, by agent; `weights` by feature."""

    abilities: Floats
    weights: Floats


def fit_item_response(
    failed: ArrayLike, agents: ArrayLike, scenes: ArrayLike, features: Floats
) -> ItemResponse:
    """Fit trials to agents and to the features of their scenes.

    `agents` and `scenes` are codes from 0; `features` is (scenes, features), each of mean 0 and deviation 1.
    """
    fails = np.asarray(failed, dtype=np.float64)
    agent, scene = np.asarray(agents, dtype=np.int64), np.asarray(scenes, dtype=np.int64)
    agent_count, feature_count = int(agent.max()) + 1, features.shape[1]
    flown, residual = np.unique(scene, return_inverse=True)
    columns = [
        np.ones((len(fails), 1)),
        agent[:, None] == np.arange(agent_count),
        features[scene],
        residual[:, None] == np.arange(len(flown)),
    ]
    x = np.hstack(columns).astype(np.float64)
    weights = slice(1 + agent_count, 1 + agent_count + feature_count)
    precision = np.r_[
        0.0,
        np.full(agent_count, ABILITY_SD**-2),
        np.full(feature_count, FIRST_SD**-2),
        np.full(len(flown), RESIDUAL_SD**-2),
    ]
    for _ in range(REWEIGHTED):
        beta = _newton(fails, x, precision, np.zeros(len(fails)))
        precision[weights] = 1.0 / np.maximum(LEAST_SD**2, np.abs(beta[weights]) * WEIGHT_SCALE)
    return ItemResponse(beta[0] + beta[1 : 1 + agent_count], beta[weights])


def fit_abilities(failed: Floats, agents: Counts, offset: Floats) -> Floats:
    """Log odds of failure of each agent beside the offsets of its trials."""
    count = int(agents.max()) + 1
    x = np.column_stack([np.ones(len(failed)), agents[:, None] == np.arange(count)]).astype(np.float64)
    beta = _newton(failed, x, np.r_[0.0, np.full(count, ABILITY_SD**-2)], offset)
    abilities: Floats = beta[0] + beta[1:]
    return abilities


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
