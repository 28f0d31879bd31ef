"""Clear views: each camera frame in which truth has an actor well in sight, and what the detector said of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from bench.contracts import CameraFrame, CastMember, Detection, DetectionFrame, Sighting, Tape
from bench.simspec import SimSpec

from ..ground_truth._truth import Truth

ANY_CLASS = "any"
Box = tuple[float, float, float, float]

CLEAR_SHARE = 0.5
"""Share of an actor that must show for a view to be clear, where no option says otherwise."""


@dataclass(frozen=True, slots=True)
class View:
    """One actor in one frame: when, whether it was detected rightly, and where it stood in the picture."""

    actor: int
    time_s: float
    detected: bool


@dataclass(frozen=True, slots=True)
class Sighted:
    """One actor in one frame as truth has it, and what was detected in that frame; `over` are the detections whose boxes
    overlap the actor's, each with its intersection over union."""

    time_s: float
    sighting: Sighting
    detections: tuple[Detection, ...]
    over: tuple[tuple[Detection, float], ...]


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

    def detected(self, sighted: Sighted, member: CastMember) -> bool:
        """Whether one of the detections is one of this member of the cast."""
        label = self.label or member.class_label
        # Where no overlap is asked for, a detection anywhere in the frame will do.
        over = sighted.over if self.min_iou > 0.0 else [(one, 0.0) for one in sighted.detections]
        for one, overlap in over:
            if one.score >= self.min_confidence and label in (ANY_CLASS, one.class_label) and overlap >= self.min_iou:
                return True
        return False


def views(tape: Tape, simspec: SimSpec, actors: Iterable[int], wanted: Wanted) -> list[View]:
    """Every clear view of these actors, in order of time."""
    truth, among = Truth.of(tape, simspec), set(actors)
    found = []
    for one in sighted(tape, simspec):
        actor = one.sighting.actor
        if actor in among and wanted.clear(one.sighting):
            found.append(View(actor, one.time_s, wanted.detected(one, truth.cast[actor])))
    return found


def sighted(tape: Tape, simspec: SimSpec) -> list[Sighted]:
    """Every sighting of the frames that were answered, in order of time."""

    def work_out() -> list[Sighted]:
        found = []
        for frame, answer in answered(tape, simspec):
            said = answer.detections if answer else ()
            for sighting in frame.sightings:
                overlaps = [(one, iou(one.box, sighting.box)) for one in said]
                over = tuple(pair for pair in overlaps if pair[1] > 0.0)
                found.append(Sighted(frame.exposed.s, sighting, said, over))
        return found

    return tape.cached((sighted, id(simspec)), work_out)


def answered(tape: Tape, simspec: SimSpec) -> list[tuple[CameraFrame, DetectionFrame | None]]:
    """Every frame with its detections; those whose detections were still under way when the session ended are left out."""

    def work_out() -> list[tuple[CameraFrame, DetectionFrame | None]]:
        answers = {one.exposed.ns: one for one in tape.detections}
        end_s = max(tape.end_s, tape.frames[-1].exposed.s if tape.frames else 0.0)
        slack_s = simspec.perception.model.latency_s + simspec.pace.tick_s
        pairs = [(frame, answers.get(frame.exposed.ns)) for frame in tape.frames]
        return [(frame, answer) for frame, answer in pairs if answer is not None or frame.exposed.s + slack_s < end_s]

    return tape.cached((answered, id(simspec)), work_out)


def share(seen: Iterable[View]) -> float | None:
    """Share of the views that were detected; None without views."""
    verdicts = [view.detected for view in seen]
    return sum(verdicts) / len(verdicts) if verdicts else None


def iou(a: Box, b: Box) -> float:
    """Intersection over union of two boxes (left, top, right, bottom); 0 when both are empty."""
    if a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]:  # most boxes lie apart
        return 0.0
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
