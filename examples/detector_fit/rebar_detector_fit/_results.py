"""Delays of results, detections where there is nothing, and scores."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import stats

from bench.arrays import Bools, Floats
from bench.contracts import FALSE_SCORE, Detection
from bench.perception import false_labels, posterior_score
from bench.simspec import FALSE_SCORE_MEAN, ScoreQuantiles

from ._matching import MatchedRun

MIN_FALSE = 50
"""Fewer false detections show neither labels nor scores; chosen."""

MAX_LATENCY_S = 5.0
"""The most that a model can state."""

MIN_SCORES = 200
"""Fewer scores show no quantiles; chosen."""

STEPS = 20
"""Between two quantiles lies a twentieth of the scores; chosen, so that a least score of a detector is kept sharply."""

SIGNIFICANT = 3.0
"""Least statistic of the two-sample Kolmogorov-Smirnov test, in units of sqrt((n + m) / nm), at which the stated scores do not
fit. Independent scores exceed 1.63 by chance once in a hundred (Smirnov 1948). Chosen higher, because a detector on pictures
gives one object similar scores in many frames."""


def fit_latency(runs: Sequence[MatchedRun]) -> tuple[float, float]:
    """Least delay, and the greatest that is added to it; a recording of a session shows them rounded up to the next tick."""
    frames = [frame for run in runs for frame in run.frames]
    delays_s = [(frame.published.ns - frame.exposed.ns) / 1e9 for frame in frames]
    least_s, most_s = min(delays_s), max(delays_s)
    spread_s = most_s - least_s
    tick_ns = max(round(run.simspec.pace.tick_s * 1e9) for run in runs)
    if all(frame.published.ns % tick_ns == 0 for frame in frames):
        # Less than a tick comes from the rounding alone; with more, the least delay was rounded up too.
        varies = spread_s >= 0.999e-9 * tick_ns
        least_s = max(0.0, least_s - tick_ns / 1e9) if varies else least_s
        spread_s = most_s - least_s if varies else 0.0
    elif len(frames) > 1:
        # The range of n uniform draws falls short of the whole by (n - 1) / (n + 1).
        spread_s *= (len(frames) + 1) / (len(frames) - 1)
    return min(least_s, MAX_LATENCY_S), min(spread_s, MAX_LATENCY_S)


@dataclass(frozen=True, slots=True)
class FalseFit:
    """Mean number in a frame, mean time that they stay, share of each label and mean score; of `followed` ones, `continued`
    stayed. No labels, and the stated score, where the detections do not show other ones.
    """

    per_frame: float
    persistence_s: float
    labels: dict[str, float]
    score: float
    detections: int
    continued: int
    followed: int


def fit_false(runs: Sequence[MatchedRun]) -> FalseFit:
    """From the detections that lie on nobody, and those of them that the next frame has again."""
    detections = sum(len(frame.false) for run in runs for frame in run.frames)
    continued = followed = 0
    span_s = persistence_s = 0.0
    for before, after in (pair for run in runs for pair in pairwise(run.frames)):
        followed += len(before.false)
        continued += sum(_is_again(detection, after.false) for detection in before.false)
        span_s += len(before.false) * (after.exposed.s - before.exposed.s)
    if continued:
        # All that stayed to the end: as if half of one had not, so that the time stays finite.
        share = min(continued / followed, 1.0 - 0.5 / followed)
        persistence_s = -span_s / followed / math.log(share)
    per_frame = detections / sum(len(run.frames) for run in runs)
    return FalseFit(per_frame, persistence_s, *_labels_and_score(runs), detections, continued, followed)


def _labels_and_score(runs: Sequence[MatchedRun]) -> tuple[dict[str, float], float]:
    """The share of each label, and the mean score, where they differ from the stated ones by more than chance."""
    known = [
        item
        for run in runs
        for frame in run.frames
        for item in frame.false
        if item.class_label in run.simspec.class_labels
    ]
    if len(known) < MIN_FALSE:
        return {}, FALSE_SCORE_MEAN
    mean = math.fsum(item.score for item in known) / len(known)
    # The deviation of Beta(2, 5) is 0.16; detections of one persistent alarm are alike, so five standard errors.
    alike = abs(mean - FALSE_SCORE_MEAN) <= 5.0 * 0.16 / math.sqrt(len(known))
    score = FALSE_SCORE_MEAN if alike else round(min(0.99, max(0.01, mean)), 4)
    counts = Counter(item.class_label for item in known)
    stated = {label for run in runs for label in false_labels(run.simspec)}
    expected = len(known) / len(stated)
    if set(counts) <= stated and all(
        abs(counts[label] - expected) <= 6.0 * math.sqrt(expected) for label in stated
    ):
        return {}, score
    return {label: round(count / len(known), 5) for label, count in sorted(counts.items())}, score


def _is_again(detection: Detection, later: Iterable[Detection]) -> bool:
    """Whether one of the later detections is the same: by its track, else by an overlapping box of its class."""
    if detection.track:
        return any(other.track == detection.track for other in later)
    return any(
        other.class_label == detection.class_label
        and other.box[0] < detection.box[2]
        and detection.box[0] < other.box[2]
        and other.box[1] < detection.box[3]
        and detection.box[1] < other.box[3]
        for other in later
    )


def fit_scores(
    scores: Floats, wrong: Bools, mislabel: Floats, false: Floats, false_mean: float
) -> ScoreQuantiles:
    """Of (n,) detections of actors: their scores, whether the label is wrong, and the stated probability that it is.

    `false` are the scores of false detections, `false_mean` their mean that the model states.
    """
    # Not of the recordings' seeds: it only says what the stated form expects.
    rng = np.random.default_rng(0)
    rows = zip(mislabel, wrong, rng.standard_normal(len(mislabel)), strict=True)
    stated = np.array([posterior_score(share, bool(is_wrong), noise) for share, is_wrong, noise in rows])
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
    return tuple(round(float(quantile), 4) for quantile in np.clip(quantiles, 0.0, 1.0))
