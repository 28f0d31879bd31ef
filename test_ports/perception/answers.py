"""What the bench's detector reported about each frame, beside what truth had in sight."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from bench.arrays import Bools, Counts, Floats, Objects
from bench.contracts import Tape, detections_by_frame
from bench.simspec import SimSpec

from .sightings import Sightings

BATCH_PAIRS = 200_000
"""Pairs of a detection and a sighting whose boxes are compared at once: some 20 MB."""


@dataclass(frozen=True, slots=True)
class Overlaps:
    """Pairs (p,) of a detection and a sighting of one frame, as rows of both, and the intersection over union of their
    boxes. In order of the detections, then of the sightings.
    """

    detection: Counts
    sighting: Counts
    iou: Floats

    def where(self, condition: Bools | Counts) -> Overlaps:
        """The pairs for which `condition` (p,) holds, or those of the given rows."""
        return Overlaps(self.detection[condition], self.sighting[condition], self.iou[condition])

    def largest(self) -> Overlaps:
        """The largest overlap of each detection, the first of equal ones."""
        order = np.lexsort((-self.iou, self.detection))
        _, first = np.unique(self.detection[order], return_index=True)
        return self.where(order[first])

    @classmethod
    def joined(cls, parts: Iterable[Overlaps]) -> Self:
        """All pairs of some parts, in their order."""
        columns = ((part.detection, part.sighting, part.iou) for part in parts)
        return cls(*(np.concatenate(column) for column in zip(*columns, strict=True)))


class Answers:
    """The detections (d of them) of a run, one after another in the order of their frames (f) on the tape.

    `results` are the results by frame, None where there is none. `answered` (f,) says which frames count: all but those
    whose result was still under way when the session ended. `frame` (d,) is the row of a detection's frame, `box` (d, 4)
    left, top, right, bottom in pixels.
    """

    def __init__(self, tape: Tape, simspec: SimSpec) -> None:
        by_frame = detections_by_frame(tape, simspec.vehicle.camera.name)
        self.results = [by_frame.get((frame.camera, frame.exposed.ns)) for frame in tape.frames]
        exposed_s = np.array([frame.exposed.s for frame in tape.frames])
        # The last frame can be later than the last truth sample.
        end_s = max(tape.end_s, tape.frames[-1].exposed.s if tape.frames else 0.0)
        # A result takes the detector's latency, and the session records it at the next tick.
        slack_s = simspec.perception.model.longest_latency_s + simspec.pace.tick_s
        has_result = np.array([result is not None for result in self.results], dtype=np.bool_)
        self.answered: Bools = has_result | (exposed_s + slack_s < end_s)

        self.sightings = Sightings.of(tape)
        lists = [result.detections if result else () for result in self.results]
        detections = [detection for listed in lists for detection in listed]
        self.frame: Counts = np.repeat(np.arange(len(lists)), [len(listed) for listed in lists])
        self.time_s: Floats = exposed_s[self.frame]
        self.score: Floats = np.array([detection.score for detection in detections])
        self.label: Objects = np.array([detection.class_label for detection in detections], dtype=np.object_)
        self.box: Floats = np.array([detection.box for detection in detections]).reshape(-1, 4)
        self._touching: Overlaps | None = None

    @classmethod
    def of(cls, tape: Tape, simspec: SimSpec) -> Self:
        """The answers of a tape, worked out once."""
        return tape.cached((cls,), lambda: cls(tape, simspec), simspec)

    def overlaps(self, min_iou: float) -> Overlaps:
        """The pairs that overlap by at least so much; all pairs when no overlap is required."""
        if min_iou <= 0.0:
            return Overlaps.joined(self._pairs())
        if self._touching is None:
            # Kept, because many observables ask; most boxes of a frame do not touch.
            self._touching = Overlaps.joined(pairs.where(pairs.iou > 0.0) for pairs in self._pairs())
        return self._touching.where(self._touching.iou >= min_iou)

    def _pairs(self) -> Iterator[Overlaps]:
        """All pairs of a detection and a sighting of one frame, in batches."""
        sightings = np.bincount(self.sightings.frame, minlength=len(self.results))[self.frame]
        first = np.searchsorted(self.sightings.frame, self.frame)
        batch = (np.cumsum(sightings) - sightings) // BATCH_PAIRS
        for detections in np.split(np.arange(len(self.frame)), np.flatnonzero(np.diff(batch)) + 1):
            counts = sightings[detections]
            # Counted anew for each detection, from the first sighting of its frame.
            place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
            detection, sighting = np.repeat(detections, counts), np.repeat(first[detections], counts) + place
            iou = intersection_over_union(self.box[detection], self.sightings.box[sighting])
            yield Overlaps(detection, sighting, iou)


def intersection_over_union(a: Floats, b: Floats) -> Floats:
    """(p,) intersection over union of boxes (p, 4), as left, top, right, bottom; 0 where both are empty."""
    width, height = (
        np.minimum(a[:, end], b[:, end]) - np.maximum(a[:, begin], b[:, begin])
        for begin, end in ((0, 2), (1, 3))
    )
    common = np.where((width > 0.0) & (height > 0.0), width * height, 0.0)
    union = _area(a) + _area(b) - common
    return np.divide(common, union, out=np.zeros(len(common)), where=union > 0.0)


def _area(box: Floats) -> Floats:
    return np.asarray((box[:, 2] - box[:, 0]) * (box[:, 3] - box[:, 1]))
