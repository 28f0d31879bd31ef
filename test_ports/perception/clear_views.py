"""Clear views: frames in which truth has an actor well in sight, and what was detected of it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.contracts import Tape
from bench.simspec import SimSpec

from ..ground_truth import GroundTruth
from .answers import Answers
from .sightings import ViewCriteria

ANY_CLASS = "any"


@dataclass(frozen=True, slots=True)
class ClearViews:
    """Views (v) of one actor in one frame with it in clear view, in order of time, and whether detected."""

    actor: Counts
    time_s: Floats
    detected: Bools

    def __len__(self) -> int:
        return len(self.actor)

    def where(self, rows: Bools | slice) -> ClearViews:
        """Some of the views."""
        return ClearViews(self.actor[rows], self.time_s[rows], self.detected[rows])

    @property
    def detected_share(self) -> float | None:
        """Share of the views in which the actor was detected; None without views."""
        return int(self.detected.sum()) / len(self) if len(self) else None


@dataclass(frozen=True, slots=True)
class DetectionCriteria:
    """Which detections are right: of at least `min_confidence`, with boxes that overlap by `min_iou`.

    `label` is the class that they must have: an actor's own when empty, each one with `ANY_CLASS`.
    """

    min_confidence: float = 0.35
    min_iou: float = 0.2
    label: str = ""

    def are_detected(self, answers: Answers, truth: GroundTruth) -> Bools:
        """(s,) whether one of the detections is right for the actor of a sighting."""
        pairs = answers.overlaps(self.min_iou)
        right = answers.score[pairs.detection] >= self.min_confidence
        if self.label != ANY_CLASS:
            actors = answers.sightings.actor[pairs.sighting]
            right &= answers.label[pairs.detection] == (self.label or truth.labels[actors])
        detected = np.zeros(len(answers.sightings.actor), dtype=np.bool_)
        detected[pairs.sighting[right]] = True
        return detected


def clear_views(
    tape: Tape,
    simspec: SimSpec,
    actors: Collection[int],
    criteria: ViewCriteria,
    detection: DetectionCriteria,
) -> ClearViews:
    """Every clear view of these actors in the answered frames."""
    truth, answers = GroundTruth.of(tape, simspec), Answers.of(tape, simspec)
    sightings = answers.sightings
    detected = tape.cached((clear_views, detection), lambda: detection.are_detected(answers, truth), simspec)
    rows = sightings.are_of(actors) & answers.answered[sightings.frame] & criteria.are_clear(sightings)
    return ClearViews(sightings.actor[rows], sightings.time_s[rows], detected[rows])


def no_detections(simspec: SimSpec) -> str | None:
    """Why nothing can be said about detections in this scenario; None where the bench makes some."""
    if simspec.perception.by_bench:
        return None
    return "perception.source is agent: the bench makes no detections, and the agent's tracks show its perception"


def actors_by_kind(
    truth: GroundTruth, actors: Iterable[int], by: Literal["group", "asset"]
) -> dict[str, list[int]]:
    """Actors by their group or asset, in the order of the cast."""
    kinds: dict[str, list[int]] = {}
    for actor in actors:
        member = truth.cast[actor]
        kinds.setdefault(member.group if by == "group" else member.asset, []).append(actor)
    return kinds


def evenness(first: float, second: float) -> float:
    """The smaller of two shares over the greater; 0 where both are 0."""
    smaller, greater = sorted((first, second))
    # Both 0 is even, but an agent that perceived nothing has shown nothing.
    return smaller / greater if greater else 0.0
