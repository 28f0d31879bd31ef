"""Detections against the truth of each camera frame."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

from bench.contracts import Detection, DetectionFrame, Evidence, Frame, Sighting, Tape
from bench.simspec import SimSpec

from ._measured import Finding, Measured, not_considered
from ._truth import RoleName, Truth

ANY_CLASS = "any"
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class DetectionShareOptions:
    """`class_` is the label that counts as right: the actor's own when empty, whatever it says when `any`."""

    role: RoleName
    class_: str = ""
    min_confidence: float = 0.35
    min_height_px: float = 12.0
    min_visible: float = 0.5
    min_iou: float = 0.2


def _detection_share(tape: Tape, simspec: SimSpec, options: DetectionShareOptions) -> Finding:
    """Share of (frame, actor in clear view) pairs that have a right detection in the result of the same exposure."""
    truth = Truth(tape, simspec)
    wanted = set(truth.of_role(options.role))
    if not wanted:
        return not_considered(f"the scenario has no actor of role {options.role}")
    views: dict[int, list[tuple[float, bool]]] = defaultdict(list)
    for frame, answer in _answered(tape, simspec):
        for sighting in frame.sightings:
            if sighting.actor in wanted and _is_clear(sighting, options):
                label = options.class_ or truth.cast[sighting.actor].class_label
                found = any(_is_right(one, label, sighting.box, options) for one in answer.detections) if answer else False
                views[sighting.actor].append((frame.exposed.s, found))
    pairs = sum(map(len, views.values()))
    if not pairs:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"no actor of role {options.role} ever came into clear view"),))
    hits = sum(found for seen in views.values() for _, found in seen)
    return Finding(hits / pairs, _worst_first(truth, views))


def _answered(tape: Tape, simspec: SimSpec) -> list[tuple[Frame, DetectionFrame | None]]:
    """Every frame with its detections; those whose detections were still under way when the session ended are left out."""
    answers = {one.exposed.ns: one for one in tape.detections}
    end_s = max(tape.end_s, tape.frames[-1].exposed.s if tape.frames else 0.0)
    slack_s = simspec.perception.model.latency_s + simspec.pace.tick_s
    pairs = [(frame, answers.get(frame.exposed.ns)) for frame in tape.frames]
    return [(frame, answer) for frame, answer in pairs if answer is not None or frame.exposed.s + slack_s < end_s]


def _is_clear(sighting: Sighting, options: DetectionShareOptions) -> bool:
    return sighting.height_px >= options.min_height_px and sighting.visible >= options.min_visible


def _is_right(detection: Detection, label: str, box: Box, options: DetectionShareOptions) -> bool:
    if detection.score < options.min_confidence or label not in (ANY_CLASS, detection.class_label):
        return False
    return _iou(detection.box, box) >= options.min_iou


def _iou(a: Box, b: Box) -> float:
    """Intersection over union of two boxes (left, top, right, bottom); 0 when both are empty."""
    width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    common = max(width, 0.0) * max(height, 0.0)
    union = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - common
    return common / union if union > 0.0 else 0.0


def _worst_first(truth: Truth, views: dict[int, list[tuple[float, bool]]]) -> tuple[Evidence, ...]:
    def share(actor: int) -> float:
        return sum(found for _, found in views[actor]) / len(views[actor])

    evidence = []
    for actor in sorted(views, key=lambda actor: (share(actor), actor)):
        seen = views[actor]
        missed = [time_s for time_s, found in seen if not found]
        member = truth.cast[actor]
        text = f"{member.id} ({member.class_label}): detected in {len(seen) - len(missed)} of {len(seen)} clear frames"
        evidence.append(
            Evidence(time_s=missed[0] if missed else seen[0][0], text=f"{text}, first missed here" if missed else text)
        )
    return tuple(evidence)


detection_share = Measured("detection_share", DetectionShareOptions, _detection_share)
