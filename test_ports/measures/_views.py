"""Clear views: each camera frame in which truth has an actor well in sight, and what the detector said of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from bench.contracts import CastMember, Detection, DetectionFrame, Frame, Sighting, Tape
from bench.simspec import SimSpec

from ._truth import Truth

ANY_CLASS = "any"
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class View:
    """One actor in one frame: when, whether it was detected rightly, and where it stood in the picture."""

    actor: int
    time_s: float
    detected: bool


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which views are clear and which detections right; sizes in pixels, ranges in metres, `min_iou` of the boxes."""

    min_confidence: float = 0.35
    min_height_px: float = 12.0
    min_visible: float = 0.5
    max_visible: float = 1.0
    min_range_m: float = 0.0
    max_range_m: float = 100_000.0
    min_iou: float = 0.2
    label: str = ""

    def clear(self, sighting: Sighting) -> bool:
        """Whether truth has the actor well enough in sight."""
        return (
            sighting.height_px >= self.min_height_px
            and self.min_visible <= sighting.visible <= self.max_visible
            and self.min_range_m <= sighting.range_m <= self.max_range_m
        )

    def right(self, detection: Detection, member: CastMember, box: Box) -> bool:
        """Whether a detection is one of this member of the cast."""
        label = self.label or member.class_label
        if detection.score < self.min_confidence or label not in (ANY_CLASS, detection.class_label):
            return False
        return iou(detection.box, box) >= self.min_iou


def views(tape: Tape, simspec: SimSpec, actors: Iterable[int], wanted: Wanted) -> list[View]:
    """Every clear view of these actors, in order of time."""
    truth, among = Truth.of(tape, simspec), set(actors)
    found = []
    for frame, answer in answered(tape, simspec):
        said = answer.detections if answer else ()
        for sighting in frame.sightings:
            if sighting.actor in among and wanted.clear(sighting):
                member = truth.cast[sighting.actor]
                seen = any(wanted.right(one, member, sighting.box) for one in said)
                found.append(View(sighting.actor, frame.exposed.s, seen))
    return found


def answered(tape: Tape, simspec: SimSpec) -> list[tuple[Frame, DetectionFrame | None]]:
    """Every frame with its detections; those whose detections were still under way when the session ended are left out."""

    def work_out() -> list[tuple[Frame, DetectionFrame | None]]:
        answers = {one.exposed.ns: one for one in tape.detections}
        end_s = max(tape.end_s, tape.frames[-1].exposed.s if tape.frames else 0.0)
        slack_s = simspec.perception.model.latency_s + simspec.pace.tick_s
        pairs = [(frame, answers.get(frame.exposed.ns)) for frame in tape.frames]
        return [(frame, answer) for frame, answer in pairs if answer is not None or frame.exposed.s + slack_s < end_s]

    return tape.once((answered, id(simspec)), work_out)


def share(seen: Iterable[View]) -> float | None:
    """Share of the views that were detected; None without views."""
    verdicts = [view.detected for view in seen]
    return sum(verdicts) / len(verdicts) if verdicts else None


def iou(a: Box, b: Box) -> float:
    """Intersection over union of two boxes (left, top, right, bottom); 0 when both are empty."""
    width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0.0 or height <= 0.0:
        return 0.0
    common = width * height
    union = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - common
    return common / union if union > 0.0 else 0.0


def kinds_of(truth: Truth, actors: Iterable[int], by: str) -> dict[str, list[int]]:
    """Actors by their group or asset, in the order of the cast."""
    name: Callable[[CastMember], str] = (lambda one: one.group) if by == "group" else (lambda one: one.asset)
    kinds: dict[str, list[int]] = {}
    for actor in actors:
        kinds.setdefault(name(truth.cast[actor]), []).append(actor)
    return kinds
