"""What a detector got right and wrong in one frame, by the rules of the measures of detections."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from bench.contracts import (
    CameraFrame,
    CastMember,
    Detection,
    DetectionFrame,
    Sighting,
    SimTime,
    Tape,
    detections_by_frame,
)
from bench.simspec import SimSpec

# The defaults of the measures of detections (docs/measures.md), so that the picture shows what they count.
MIN_SCORE = 0.35
MIN_OVERLAP = 0.2
MIN_HEIGHT_PX = 12.0
MIN_VISIBLE = 0.5

Box = tuple[float, float, float, float]
"""left, top, right, bottom in pixels"""


class Verdict(StrEnum):
    """What one box in a frame is."""

    TRUTH = "truth"
    UNCLEAR = "unclear"
    HIT = "hit"
    MISSED = "missed"
    MISLABELLED = "mislabelled"
    FALSE = "false"


ERRORS = frozenset({Verdict.MISSED, Verdict.MISLABELLED, Verdict.FALSE})


@dataclass(frozen=True, slots=True)
class JudgedBox:
    """One box to draw, and a few words about it."""

    box: Box
    verdict: Verdict
    text: str


@dataclass(frozen=True, slots=True)
class JudgedFrame:
    """One frame of a camera with the boxes of truth and detector."""

    camera: str
    number: int
    exposed: SimTime
    boxes: tuple[JudgedBox, ...]

    @property
    def counts(self) -> Counter[Verdict]:
        """How many boxes of each kind there are."""
        return Counter(box.verdict for box in self.boxes)

    @property
    def errors(self) -> int:
        """Actors in clear view that were missed, mislabelled detections and false ones."""
        return sum(box.verdict in ERRORS for box in self.boxes)


def worst_frame(simspec: SimSpec, tape: Tape) -> JudgedFrame | None:
    """The frame with the most errors, the earliest of several; None where no frame has any.

    Frames without a result are left out, and so are those of outages: what was lost there the detector had seen.
    """
    answers = detections_by_frame(tape, simspec.vehicle.camera.name)
    worst: JudgedFrame | None = None
    for frame in tape.frames:
        answer = answers.get((frame.camera, frame.exposed.ns))
        if answer is None or _in_outage(simspec, answer):
            continue
        judged = judge(tape.cast, frame, answer.detections)
        if judged.errors > (worst.errors if worst is not None else 0):
            worst = judged
    return worst


def judge(cast: Sequence[CastMember], frame: CameraFrame, detections: Sequence[Detection]) -> JudgedFrame:
    """Every actor in the frame and every detection that is sure enough, with its verdict."""
    sure = [detection for detection in detections if detection.score >= MIN_SCORE]
    boxes = [_judged_actor(cast[sighting.actor], sighting, sure) for sighting in frame.sightings]
    boxes += [_judged_detection(cast, frame.sightings, detection) for detection in sure]
    return JudgedFrame(frame.camera, frame.number, frame.exposed, tuple(boxes))


def _judged_actor(member: CastMember, sighting: Sighting, detections: Sequence[Detection]) -> JudgedBox:
    text = f"{member.id} ({member.class_label}), {sighting.height_px:.0f} px"
    covered = any(overlap(detection.box, sighting.box) >= MIN_OVERLAP for detection in detections)
    if covered:
        # Right or wrong, the detection's own box says so.
        return JudgedBox(sighting.box, Verdict.TRUTH, text)
    clear = sighting.height_px >= MIN_HEIGHT_PX and sighting.visible >= MIN_VISIBLE
    return JudgedBox(sighting.box, Verdict.MISSED if clear else Verdict.UNCLEAR, text)


def _judged_detection(
    cast: Sequence[CastMember], sightings: Sequence[Sighting], detection: Detection
) -> JudgedBox:
    text = f"{detection.class_label} {detection.score:.2f}"
    actual = [
        cast[sighting.actor].class_label
        for sighting in sightings
        if overlap(detection.box, sighting.box) >= MIN_OVERLAP
    ]
    if not actual:
        return JudgedBox(detection.box, Verdict.FALSE, text)
    if detection.class_label in actual:
        return JudgedBox(detection.box, Verdict.HIT, text)
    return JudgedBox(detection.box, Verdict.MISLABELLED, f"{text}, is {actual[0]}")


def overlap(first: Box, second: Box) -> float:
    """Intersection over union."""
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    if width <= 0.0 or height <= 0.0:
        return 0.0
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (first, second)]
    return width * height / (sum(areas) - width * height)


def _in_outage(simspec: SimSpec, answer: DetectionFrame) -> bool:
    return any(
        outage.kind != "operator_link" and outage.at_s <= answer.published.s < outage.until_s
        for outage in simspec.outages
    )
