"""Skill of stated confidences and stated errors by proper scores, over the runs of an agent (docs/rulings.md 30).

A proper score is best, on average, for who states what is believed. Skill is 1 - score / score of the best constant: 1 is
perfect, 0 is what one number stated always reaches at best, and below 0 the statements are worth less than that number.

Gneiting, T. and Raftery, A. E. (2007), Strictly proper scoring rules, prediction, and estimation, JASA 102, 359-378: the
Brier score (section 3.1), and the interval score (section 6.2) of an interval that begins at 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Floats

from ._intervals import CONFIDENCE_LEVEL

MISS_SHARE = 0.05
"""The share of errors that may lie outside a stated interval."""

INTERVAL_SIGMAS = math.sqrt(-2.0 * math.log(MISS_SHARE))
"""Radius that holds 95 % of a horizontal error of one sigma on each axis (Rayleigh distribution): 2.45 sigmas."""

RESAMPLES = 1000
MIN_SCENES = 5
"""Scenes drawn again from fewer are too few different samples for an interval."""


@dataclass(frozen=True, slots=True)
class Skill:
    """The mean score of `statements` statements, that of the best constant, and the skill with its interval.

    Lower scores are better. `skill` is None where the best constant is perfect, which leaves nothing to be better at;
    the interval also with fewer than five scenes.
    """

    statements: int
    scenes: int
    score: float
    best_constant: float
    constant_score: float
    skill: float | None
    low: float | None
    high: float | None


def confidence_skill(confidence: Floats, right: Floats, scenes: Sequence[str], seed: int = 0) -> Skill | None:
    """Brier score of confidences (n,) of statements that were right (1) or not (0); None without any.

    `scenes` (n,) names where each was made: the interval draws scenes, because statements of one scene are alike.
    """

    def scores(value: Floats | float, outcome: Floats) -> Floats:
        return np.asarray((value - outcome) ** 2, dtype=np.float64)

    return _skill(confidence, right, scenes, scores, lambda outcome: float(outcome.mean()), seed)


def error_skill(sigma_m: Floats, error_m: Floats, scenes: Sequence[str], seed: int = 0) -> Skill | None:
    """Interval score of stated horizontal errors (n,), one sigma on each axis, against the true ones (n,); in metres.

    The score is the radius that should hold 95 % of the errors, plus twenty times what an error exceeds it by.
    """

    def scores(value: Floats | float, outcome: Floats) -> Floats:
        radius_m = INTERVAL_SIGMAS * np.asarray(value, dtype=np.float64)
        return np.asarray(radius_m + np.maximum(outcome - radius_m, 0.0) / MISS_SHARE, dtype=np.float64)

    def best(outcome: Floats) -> float:
        # The 95 % quantile minimizes the score; of several, one of the sample.
        return float(np.quantile(outcome, 1.0 - MISS_SHARE, method="inverted_cdf")) / INTERVAL_SIGMAS

    return _skill(sigma_m, error_m, scenes, scores, best, seed)


def _skill(
    stated: Floats,
    outcome: Floats,
    scenes: Sequence[str],
    scores: Callable[[Floats | float, Floats], Floats],
    best: Callable[[Floats], float],
    seed: int,
) -> Skill | None:
    if not len(stated):
        return None

    def skill_of(rows: np.ndarray) -> float:
        constant = float(scores(best(outcome[rows]), outcome[rows]).mean())
        return 1.0 - float(scores(stated[rows], outcome[rows]).mean()) / constant if constant else math.nan

    # Sorted, so that the order of the runs decides nothing.
    names, scene = np.unique(np.asarray(scenes), return_inverse=True)
    members = [np.flatnonzero(scene == number) for number in range(len(names))]
    everything = np.concatenate(members)
    draw = np.random.default_rng(seed)
    low = high = math.nan
    skill = skill_of(everything)
    if len(names) >= MIN_SCENES and not math.isnan(skill):
        drawn = [
            skill_of(
                np.concatenate([members[number] for number in draw.integers(len(names), size=len(names))])
            )
            for _ in range(RESAMPLES)
        ]
        tail = (1.0 - CONFIDENCE_LEVEL) / 2.0
        low, high = np.nanquantile(drawn, [tail, 1.0 - tail])
    constant = best(outcome[everything])
    return Skill(
        len(stated),
        len(names),
        float(scores(stated[everything], outcome[everything]).mean()),
        constant,
        float(scores(constant, outcome[everything]).mean()),
        *(None if math.isnan(value) else float(value) for value in (skill, low, high)),
    )
