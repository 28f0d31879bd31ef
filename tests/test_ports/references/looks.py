"""Looks at actors, one sighting at a time."""

from __future__ import annotations

from bench.contracts import CameraFrame, Sighting, Tape
from bench.simspec import SimSpec

Box = tuple[float, float, float, float]


def overlap(a: Box, b: Box) -> float:
    width, height = max(0.0, min(a[2], b[2]) - max(a[0], b[0])), max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    union = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - width * height
    return width * height / union


def is_look(spec: SimSpec, tape: Tape, frame: CameraFrame, sighting: Sighting, min_px: float) -> bool:
    """As large a part of it shows as a whole one of so many pixels, or a given detection has its class and place."""
    in_sight = sighting.visible * sighting.height_px**2 >= min_px**2
    return in_sight or any(
        detection.class_label == tape.cast[sighting.actor].class_label
        and detection.score >= 0.35
        and overlap(detection.box, sighting.box) >= 0.2
        for answer in (tape.detections if spec.perception.source != "agent" else ())
        if answer.exposed == frame.exposed and (answer.camera or spec.vehicle.camera.name) == frame.camera
        for detection in answer.detections
    )


def looks_s(spec: SimSpec, tape: Tape, actor: int, min_px: float = 12.0) -> list[float]:
    """The moments of the looks at an actor."""
    return [
        frame.exposed.s
        for frame in tape.frames
        for sighting in frame.sightings
        if sighting.actor == actor and is_look(spec, tape, frame, sighting, min_px)
    ]
