"""Competence of one list of trials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from bench.statistics import Trials, competence, count_trials


def competence_of(
    difficulty: ArrayLike,
    passed: ArrayLike,
    design_points: Sequence[str] | None = None,
    share: tuple[int, int] = (1, 2),
) -> tuple[float, float, bool]:
    """Value, lower bound and `at least`; without design points each trial is a design point."""
    hard, ok = np.asarray(difficulty, dtype=np.float64), np.asarray(passed, dtype=np.bool_)
    points = np.unique(design_points or list(map(str, range(hard.size))), return_inverse=True)[1]
    trials = Trials(np.zeros(hard.size, dtype=np.int64), hard, ok, points.astype(np.int64))
    result = competence(count_trials(trials, 1), share)
    return float(result.value[0]), float(result.low[0]), bool(result.at_least[0])
