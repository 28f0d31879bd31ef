"""Clear views: camera frames in which truth has an actor well in sight, and what the detector reported about
it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from bench.contracts import (
    CameraFrame,
    CastMember,
    Detection,
    DetectionFrame,
    Sighting,
    Tape,
    detections_by_frame,
)
from bench.simspec import SimSpec

from ..ground_truth import GroundTruth

ANY_CLASS = "any"
Box = tuple[float, float, float, float]
"""left, top, right, bottom in pixels"""

CLEAR_SHARE = 0.5
"""Share of an actor that must show for a view to be clear, where no option says otherwise."""


@dataclass(frozen=True, slots=True)
class ClearView:
    """One actor in one frame that has it in clear view, and whether it was rightly detected there."""

    actor: int
    time_s: float
    detected: bool


@dataclass(frozen=True, slots=True)
class AnsweredSighting:
    """One actor in one frame by the truth, with the detections in that frame.

    `overlapping` are the detections whose boxes overlap the actor's, each with its intersection over union.
    """

    time_s: float
    sighting: Sighting
    detections: tuple[Detection, ...]
    overlapping: tuple[tuple[Detection, float], ...]


@dataclass(frozen=True, slots=True)
class ViewCriteria:
    """Which views are clear and which detections right; sizes in pixels, ranges in metres, `min_iou` between
    the boxes.
    """

    min_confidence: float = 0.35
    min_height_px: float = 12.0
    min_visible: float = 0.5
    max_visible: float = 1.0
    min_range_m: float = 0.0
    max_range_m: float = 100_000.0
    min_iou: float = 0.2
    label: str = ""

    def is_clear(self, sighting: Sighting) -> bool:
        """Whether truth has the actor well enough in sight."""
        return (
            sighting.height_px >= self.min_height_px
            and self.min_visible <= sighting.visible <= self.max_visible
            and self.min_range_m <= sighting.range_m <= self.max_range_m
        )

    def is_detected(self, answered: AnsweredSighting, member: CastMember) -> bool:
        """Whether one of the detections is right for this member of the cast."""
        label = self.label or member.class_label
        # Where no overlap is required, a detection anywhere in the frame counts.
        candidates = (
            answered.overlapping
            if self.min_iou > 0.0
            else [(detection, 0.0) for detection in answered.detections]
        )
        return any(
            detection.score >= self.min_confidence
            and label in (ANY_CLASS, detection.class_label)
            and overlap >= self.min_iou
            for detection, overlap in candidates
        )


def clear_views(
    tape: Tape, simspec: SimSpec, actors: Iterable[int], criteria: ViewCriteria
) -> list[ClearView]:
    """Every clear view of these actors, in order of time."""
    truth, wanted = GroundTruth.of(tape, simspec), set(actors)
    views = []
    for answered in answered_sightings(tape, simspec):
        actor = answered.sighting.actor
        if actor in wanted and criteria.is_clear(answered.sighting):
            views.append(ClearView(actor, answered.time_s, criteria.is_detected(answered, truth.cast[actor])))
    return views


def answered_sightings(tape: Tape, simspec: SimSpec) -> list[AnsweredSighting]:
    """Every sighting of the answered frames, in order of time."""

    def pair_with_detections() -> list[AnsweredSighting]:
        sightings = []
        for frame, answer in answered_frames(tape, simspec):
            detections = answer.detections if answer else ()
            for sighting in frame.sightings:
                overlaps = [
                    (detection, intersection_over_union(detection.box, sighting.box))
                    for detection in detections
                ]
                overlapping = tuple(pair for pair in overlaps if pair[1] > 0.0)
                sightings.append(AnsweredSighting(frame.exposed.s, sighting, detections, overlapping))
        return sightings

    # Many observables ask for these pairs with different criteria, so they are made once for each tape.
    return tape.cached((answered_sightings, id(simspec)), pair_with_detections)


def answered_frames(tape: Tape, simspec: SimSpec) -> list[tuple[CameraFrame, DetectionFrame | None]]:
    """Every frame with its detections; those whose detections were still under way when the session ended are
    left out.
    """

    def pair_by_exposure() -> list[tuple[CameraFrame, DetectionFrame | None]]:
        answers = detections_by_frame(tape, simspec.vehicle.camera.name)
        # The last frame can be later than the last truth sample.
        end_s = max(tape.end_s, tape.frames[-1].exposed.s if tape.frames else 0.0)
        # A result takes the detector's latency, and the session records it at the next tick.
        slack_s = simspec.perception.model.longest_latency_s + simspec.pace.tick_s
        pairs = [(frame, answers.get((frame.camera, frame.exposed.ns))) for frame in tape.frames]
        return [
            (frame, answer)
            for frame, answer in pairs
            if answer is not None or frame.exposed.s + slack_s < end_s
        ]

    return tape.cached((answered_frames, id(simspec)), pair_by_exposure)


def no_detections(simspec: SimSpec) -> str | None:
    """Why nothing can be said about detections in this scenario; None where the bench makes some."""
    if simspec.perception.by_bench:
        return None
    return "perception.source is agent: the bench makes no detections, and the agent's tracks show its perception"


def detected_share(views: Iterable[ClearView]) -> float | None:
    """Share of the views in which the actor was detected; None without views."""
    verdicts = [view.detected for view in views]
    return sum(verdicts) / len(verdicts) if verdicts else None


def intersection_over_union(a: Box, b: Box) -> float:
    """Intersection over union of two boxes; 0 when both are empty."""
    # Most boxes of a frame do not touch: this test comes first because it is cheaper than the areas.
    if a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]:
        return 0.0
    width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0.0 or height <= 0.0:
        return 0.0
    common = width * height
    union = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - common
    return common / union if union > 0.0 else 0.0


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
