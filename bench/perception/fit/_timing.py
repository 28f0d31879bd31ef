"""Delays of results, and detections where there is nothing."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from bench.contracts import Detection
from bench.simspec import FALSE_SCORE_MEAN

from .._labels import false_labels
from ._matching import MatchedRun

MIN_FALSE = 50
"""Fewer false detections show neither labels nor scores; chosen."""

MAX_LATENCY_S = 5.0
"""The most that a model can state."""


@dataclass(frozen=True, slots=True)
class LatencyFit:
    """Least delay, and the greatest that is added to it, over so many frames."""

    latency_s: float
    jitter_s: float
    frames: int


def fit_latency(runs: Sequence[MatchedRun]) -> LatencyFit:
    """From the delay of each frame; a recording of a session shows them rounded up to the next tick."""
    delays_ns = [frame.published.ns - frame.exposed.ns for run in runs for frame in run.frames]
    if not delays_ns:
        return LatencyFit(0.0, 0.0, 0)
    least_s, most_s = min(delays_ns) / 1e9, max(delays_ns) / 1e9
    spread_s = most_s - least_s
    tick_s = max(run.simspec.pace.tick_s for run in runs)
    if _on_ticks(runs, tick_s):
        # Less than a tick comes from the rounding alone; with more, the least delay was rounded up too.
        if spread_s >= 0.999 * tick_s:
            least_s = max(0.0, least_s - tick_s)
        spread_s = most_s - least_s if spread_s >= 0.999 * tick_s else 0.0
    elif len(delays_ns) > 1:
        # The range of n uniform draws falls short of the whole by (n - 1) / (n + 1).
        spread_s *= (len(delays_ns) + 1) / (len(delays_ns) - 1)
    return LatencyFit(min(least_s, MAX_LATENCY_S), min(spread_s, MAX_LATENCY_S), len(delays_ns))


def _on_ticks(runs: Sequence[MatchedRun], tick_s: float) -> bool:
    """Whether all results were published at ticks, as a session's recording has them."""
    tick_ns = round(tick_s * 1e9)
    return all(frame.published.ns % tick_ns == 0 for run in runs for frame in run.frames)


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
    detections = frames = continued = followed = 0
    span_s = 0.0
    for run in runs:
        frames += len(run.frames)
        detections += sum(len(frame.false) for frame in run.frames)
        for before, after in pairwise(run.frames):
            followed += len(before.false)
            continued += sum(_is_again(detection, after.false) for detection in before.false)
            span_s += len(before.false) * (after.exposed.s - before.exposed.s)
    per_frame = detections / frames if frames else 0.0
    labels, score = _labels_and_score(runs)
    if not continued:
        return FalseFit(per_frame, 0.0, labels, score, detections, 0, followed)
    # All that stayed to the end: as if half of one had not, so that the time stays finite.
    share = min(continued / followed, 1.0 - 0.5 / followed)
    return FalseFit(
        per_frame, -span_s / followed / math.log(share), labels, score, detections, continued, followed
    )


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
    scores = [item.score for item in known]
    mean = math.fsum(scores) / len(scores)
    # The deviation of Beta(2, 5) is 0.16; detections of one persistent alarm are alike, so five standard errors.
    score = mean if abs(mean - FALSE_SCORE_MEAN) > 5.0 * 0.16 / math.sqrt(len(scores)) else FALSE_SCORE_MEAN
    counts = Counter(item.class_label for item in known)
    stated = sorted({label for run in runs for label in false_labels(run.simspec)})
    expected = len(known) / len(stated)
    alike = set(counts) <= set(stated) and all(
        abs(counts[label] - expected) <= 6.0 * math.sqrt(expected) for label in stated
    )
    labels = {} if alike else {label: round(count / len(known), 5) for label, count in sorted(counts.items())}
    return labels, round(min(0.99, max(0.01, score)), 4) if score != FALSE_SCORE_MEAN else score


def _is_again(detection: Detection, later: Sequence[Detection]) -> bool:
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
