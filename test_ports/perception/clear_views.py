"""Clear views: frames in which truth has an actor well in sight, and what was detected of it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._declaration import Finding, nothing_shown, shown
from ..ground_truth import GroundTruth
from .answers import Answers
from .sightings import ViewCriteria

ANY_CLASS = "any"


@dataclass(frozen=True, slots=True)
class ActorViews:
    """Views (v) of one actor in one frame, in order of time, and the credit (v,) for each, from 0 to 1: whether it was
    detected there, or how far the message is believed that holds it.
    """

    actor: Counts
    time_s: Floats
    credit: Floats

    def __len__(self) -> int:
        return len(self.actor)

    def where(self, rows: Bools | slice) -> ActorViews:
        """Some of the views."""
        return ActorViews(self.actor[rows], self.time_s[rows], self.credit[rows])

    @property
    def share(self) -> float:
        """Mean credit; 0 without views."""
        # The sum of a list adds in order of time: an array's differs in the last digit.
        return float(sum(self.credit.tolist()) / len(self)) if len(self) else 0.0

    def finding(self, truth: GroundTruth, subject: str, end_s: float, verb: str) -> Finding:
        """The share of the views, with the actors of the least shares first in evidence; 0 without views."""
        if not len(self):
            return nothing_shown(end_s, f"no actor of {subject} ever came into such a view")
        of_actors = [self.where(self.actor == actor) for actor in np.unique(self.actor).tolist()]
        evidence = []
        for views in sorted(of_actors, key=lambda views: (views.share, views.actor[0])):
            member, least_s = truth.cast[views.actor[0]], float(views.time_s[views.credit.argmin()])
            text = f"{member.id} ({member.class_label}): {verb} in {views.share:.0%} of {len(views)} views, least here"
            evidence.append(Evidence(time_s=least_s, text=text))
        return Finding(self.share, tuple(evidence))

    def steadiness(self, role: str, end_s: float, verb: str) -> Finding:
        """Share of the worse half of the views over the better half's; 0 for two of 0, and below two views."""
        if len(self) < 2:
            return nothing_shown(end_s, f"role {role} was in clear view {len(self)} times")
        # Halves by count and not by time: an aircraft may see most of the actors in a few seconds.
        middle = len(self) // 2
        early, late = self.where(slice(middle)).share, self.where(slice(middle, None)).share
        smaller, greater = sorted((early, late))
        text = f"{verb} in {early:.0%} of the clear views before this moment, in {late:.0%} from it on"
        # Both 0 is even, but an agent that perceived nothing has shown nothing.
        return shown(smaller / greater if greater else 0.0, float(self.time_s[middle]), text)


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
) -> ActorViews:
    """Every clear view of these actors in the answered frames."""
    truth, answers = GroundTruth.of(tape, simspec), Answers.of(tape, simspec)
    sightings = answers.sightings
    detected = tape.cached((clear_views, detection), lambda: detection.are_detected(answers, truth), simspec)
    rows = sightings.are_of(actors) & answers.answered[sightings.frame] & criteria.are_clear(sightings)
    return ActorViews(sightings.actor[rows], sightings.time_s[rows], detected[rows].astype(np.float64))


NO_DETECTIONS = (
    "perception.source is agent: the bench makes no detections, and the agent's tracks show its perception"
)


def actors_by_kind(
    truth: GroundTruth, actors: Iterable[int], by: Literal["group", "asset"]
) -> dict[str, list[int]]:
    """Actors by their group or asset, in the order of the cast."""
    kinds: dict[str, list[int]] = {}
    for actor in actors:
        member = truth.cast[actor]
        kinds.setdefault(member.group if by == "group" else member.asset, []).append(actor)
    return kinds
