"""Difficulty-response: a logistic curve of the pass probability over difficulty, to be drawn beside competence.

As in probability-of-detection practice (MIL-HDBK-1823A, 2009), but fitted by Firth's penalised likelihood,
which stays finite where passes and failures are separated: Heinze, G. and Schemper, M. (2002), Statistics in
Medicine 21(16), 2409-2419. Its 50 % point rises when easy runs fail, so it is never used as the number
(docs/rulings.md 17).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from bench.arrays import Floats

from ._firth import DistinctRows, information, maximize, probability, variances
from ._intervals import CONFIDENCE_LEVEL

# With fewer runs no curve is drawn. Chosen, not measured.
MIN_RUNS = 10

_GRID_POINTS = 101


class CurveState(StrEnum):
    """How a fit came out; the first two states have no curve."""

    TOO_FEW = "too few runs"
    ONE_DIFFICULTY = "one difficulty only"
    ALL_PASSED = "all passed"
    NONE_PASSED = "none passed"
    # Every pass lies on one side of every failure: the penalty decides the slope, not the data.
    SEPARATED = "separated"
    FITTED = "fitted"


@dataclass(frozen=True, slots=True)
class Curve:
    """Pass probability over a grid of difficulties from the easiest to the hardest tested, with a pointwise band.

    The arrays are empty where there is no curve. `half_at` is the difficulty with a pass probability of one
    half; None where the curve does not fall through one half within the difficulties tested.
    """

    state: CurveState
    runs: int
    difficulty: Floats
    probability: Floats
    low: Floats
    high: Floats
    half_at: float | None

    @property
    def drawn(self) -> bool:
        """Whether there is a curve."""
        return self.difficulty.size > 0


def difficulty_response(
    difficulty: ArrayLike,
    passed: ArrayLike,
    design_points: Sequence[str] | None = None,
    level: float = CONFIDENCE_LEVEL,
) -> Curve:
    """Fit the curve to trials, which are those of `competence`.

    The band is Wald's on the logit scale. Where design points are given and their counts scatter more than
    independent runs would (Pearson's chi-squared over its degrees of freedom above 1), the variance is
    multiplied by that ratio.
    """
    hard, ok = np.asarray(difficulty, dtype=np.float64), np.asarray(passed, dtype=np.float64)
    state = _state(hard, ok)
    if state in (CurveState.TOO_FEW, CurveState.ONE_DIFFICULTY):
        empty = np.zeros(0)
        return Curve(state, hard.size, empty, empty, empty, empty, None)
    middle, scale = float(hard.mean()), float(hard.std())
    design = np.stack([np.ones_like(hard), (hard - middle) / scale], axis=1)
    beta, _ = maximize(DistinctRows.of(ok, design), np.zeros(2), np.ones(2, dtype=bool))
    spread: Floats = np.linalg.inv(information(design, beta)).astype(np.float64)
    spread *= _dispersion(design, ok, beta, design_points)
    grid = np.linspace(hard.min(), hard.max(), _GRID_POINTS)
    rows = np.stack([np.ones_like(grid), (grid - middle) / scale], axis=1)
    logit = rows @ beta
    half_width = float(stats.norm.ppf(0.5 + level / 2.0)) * np.sqrt(variances(rows, spread))
    ends = (probability(logit - half_width), probability(logit + half_width))
    return Curve(state, hard.size, grid, probability(logit), *ends, _even_chance(beta, middle, scale, grid))


def _state(hard: Floats, ok: Floats) -> CurveState:
    if hard.size < MIN_RUNS:
        return CurveState.TOO_FEW
    if np.ptp(hard) < 1e-6:
        return CurveState.ONE_DIFFICULTY
    if ok.all() or not ok.any():
        return CurveState.ALL_PASSED if ok.all() else CurveState.NONE_PASSED
    passes, fails = hard[ok > 0], hard[ok == 0]
    if passes.max() <= fails.min() or fails.max() <= passes.min():
        return CurveState.SEPARATED
    return CurveState.FITTED


def _dispersion(design: Floats, ok: Floats, beta: Floats, design_points: Sequence[str] | None) -> float:
    """How much more counts of design points scatter than those of independent runs; at least 1, 1 without points."""
    if design_points is None:
        return 1.0
    _, point = np.unique(np.array(list(design_points)), return_inverse=True)
    free = int(point.max()) + 1 - design.shape[1]
    if free < 1:
        return 1.0
    chance = probability(design @ beta)
    excess = np.bincount(point, weights=ok - chance)
    expected = np.bincount(point, weights=chance * (1.0 - chance))
    scatter = float(np.sum(excess**2 / expected)) / free
    return scatter if scatter > 1.0 else 1.0


def _even_chance(beta: Floats, middle: float, scale: float, grid: Floats) -> float | None:
    if beta[1] >= 0.0:
        return None
    at = float(middle - scale * beta[0] / beta[1])
    return at if grid[0] <= at <= grid[-1] else None
