"""Quantiles of the scores of detections, where the scores that the model states do not fit them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from bench.arrays import Bools, Floats
from bench.contracts import FALSE_SCORE
from bench.simspec import ScoreQuantiles

from .._labels import posterior_score
from ._matching import MatchedRun

MIN_SCORES = 200
"""Fewer scores show no quantiles; chosen."""

STEPS = 20
"""Between two quantiles lies a twentieth of the scores; chosen, so that a least score of a detector is kept sharply."""

SIGNIFICANT = 3.0
"""Least statistic of the two-sample Kolmogorov-Smirnov test, in units of sqrt((n + m) / nm), at which the stated scores do not
fit. Independent scores exceed 1.63 by chance once in a hundred (Smirnov 1948). Chosen higher, because a detector on pictures
gives one object similar scores in many frames."""


def fit_scores(
    runs: Sequence[MatchedRun], scores: Floats, wrong: Bools, mislabel: Floats, false_mean: float
) -> ScoreQuantiles:
    """Of (n,) detections of actors: their scores, whether the label is wrong, and the stated probability that it is.

    `false_mean` is the mean score of false detections that the model states.
    """
    false = np.array(
        [item.score for run in runs for frame in run.frames for item in frame.false], dtype=np.float64
    )
    # Not of the recordings' seeds: it only says what the stated form expects.
    rng = np.random.default_rng(0)
    stated = np.array(
        [
            posterior_score(share, bool(is_wrong), noise)
            for share, is_wrong, noise in zip(
                mislabel, wrong, rng.standard_normal(len(mislabel)), strict=True
            )
        ]
    )
    total = sum(FALSE_SCORE)
    stated_false = rng.beta(total * false_mean, total * (1.0 - false_mean), max(len(false), 1))
    return ScoreQuantiles(
        right=_quantiles(scores[~wrong], stated[~wrong]),
        wrong=_quantiles(scores[wrong], stated[wrong]),
        false=_quantiles(false, stated_false),
    )


def _quantiles(scores: Floats, stated: Floats) -> tuple[float, ...]:
    """The quantiles of scores; empty where the stated ones fit them, or where there are too few."""
    if len(scores) < MIN_SCORES:
        return ()
    apart = float(stats.ks_2samp(scores, stated).statistic)
    if apart <= SIGNIFICANT * math.sqrt(1.0 / len(scores) + 1.0 / len(stated)):
        return ()
    quantiles = np.quantile(scores, np.linspace(0.0, 1.0, STEPS + 1))
    return tuple(round(float(min(1.0, max(0.0, quantile))), 4) for quantile in quantiles)
