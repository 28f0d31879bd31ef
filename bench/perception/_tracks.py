"""A simulated tracker: identities that are kept over frames."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from bench.contracts import Detection, SimTime

from ._boxes import Box

TRACK_GAP_S = 2.0
"""An object out of the detections for longer than this comes back under a new track id."""


@dataclass(frozen=True, slots=True)
class UntrackedDetection:
    """A detection without a track, and what it is of: an actor's number, or minus a false detection's."""

    detection: Detection
    subject: int


class TrackNames:
    """Names tracks in the order of the reports, so that they reveal nothing about the cast."""

    def __init__(self, switches_per_s: float = 0.0, prefix: str = "") -> None:
        self._switches_per_s = switches_per_s
        self._last: dict[int, SimTime] = {}
        self._name: dict[int, str] = {}
        self._count = 0
        self._prefix = prefix

    def name(
        self,
        detections: list[UntrackedDetection],
        exposed: SimTime,
        uniform_of_actor: Callable[[int], float] | None = None,
    ) -> tuple[Detection, ...]:
        """The detections, surest first, each with its track. `uniform_of_actor` has a draw for the switches."""
        # By score and box, never by actor: the order of the list must not reveal the order of the cast.
        detections.sort(key=lambda untracked: (-untracked.detection.score, untracked.detection.box))
        spans_s: dict[int, float] = {}
        for untracked in detections:
            self._take(untracked.subject, exposed, spans_s)
        if uniform_of_actor is not None and self._switches_per_s > 0.0:
            self._switch([row for row in detections if row.subject in spans_s], spans_s, uniform_of_actor)
        found = [(untracked.detection, self._name[untracked.subject]) for untracked in detections]
        # Not `dataclasses.replace`: it takes three times as long, and this runs for every detection.
        return tuple(Detection(seen.class_label, seen.score, seen.box, track) for seen, track in found)

    def _take(self, subject: int, exposed: SimTime, spans_s: dict[int, float]) -> None:
        """Continue the subject's track, or begin one; note the time since its last detection in `spans_s`."""
        last = self._last.get(subject)
        if last is None or exposed.since(last) > TRACK_GAP_S:
            self._name[subject] = self._next()
        elif subject >= 0:
            spans_s[subject] = exposed.since(last)
        self._last[subject] = exposed

    def _switch(
        self,
        continued: list[UntrackedDetection],
        spans_s: dict[int, float],
        uniform_of_actor: Callable[[int], float],
    ) -> None:
        switched: set[int] = set()
        for untracked in continued:
            subject = untracked.subject
            if subject in switched:
                continue
            others = [
                other
                for other in continued
                if other.subject != subject
                and other.subject not in switched
                and other.detection.class_label == untracked.detection.class_label
            ]
            probability = 1.0 - math.exp(-self._switches_per_s * spans_s[subject])
            # An exchange changes two identities, so it occurs half as often: the rate for each object is the stated one.
            if uniform_of_actor(subject) >= (probability / 2.0 if others else probability):
                continue
            if others:
                place = untracked.detection.box
                partner = min(
                    others, key=lambda other: (_distance_px(other.detection.box, place), other.detection.box)
                )
                self._name[subject], self._name[partner.subject] = (
                    self._name[partner.subject],
                    self._name[subject],
                )
                switched |= {subject, partner.subject}
            else:
                self._name[subject] = self._next()
                switched.add(subject)

    def _next(self) -> str:
        self._count += 1
        return f"{self._prefix}t{self._count}"


def _distance_px(box: Box, other: Box) -> float:
    """Between the middles of two boxes."""
    return math.hypot(
        (box[0] + box[2] - other[0] - other[2]) / 2.0, (box[1] + box[3] - other[1] - other[3]) / 2.0
    )
