"""Detections matched with the actors that they are of."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.optimize import linear_sum_assignment

from bench.arrays import Floats
from bench.contracts import Detection, DetectionFrame, Sighting, SimTime, Tape, detections_by_frame
from bench.simspec import Camera, SimSpec

from .._boxes import Box

T = TypeVar("T")

WIDE_GATE_PX = 20.0
WIDE_GATE_SHARE = 0.4
"""Edges farther than this from those of an actor, or than this share of its sides, on average, are not a detection of it,
in the first pass. Chosen."""

LEAST_GATE_PX = 3.0
DEVIATIONS_IN_GATE = 4.0
"""Of the mean displacement of four edges, in the second pass: beyond lies less than one right match in 10,000."""

MIN_MATCHES_BY_SIZE = 40
"""With fewer matches, one gate holds for all sizes. Chosen."""


@dataclass(frozen=True, slots=True)
class Gate:
    """How far the edges of a detection may be from those of an actor, on average, by the mean of the actor's sides."""

    least_px: float
    share: float

    def at(self, side_px: Floats) -> Floats:
        """In pixels, for each side."""
        return np.maximum(self.least_px, self.share * side_px)


WIDE_GATE = Gate(WIDE_GATE_PX, WIDE_GATE_SHARE)


@dataclass(frozen=True, slots=True)
class MatchedSighting:
    """An actor in a frame, and the detection of it; None when it was missed."""

    sighting: Sighting
    detection: Detection | None


@dataclass(frozen=True, slots=True)
class MatchedFrame:
    """One frame with its result."""

    exposed: SimTime
    published: SimTime
    sightings: tuple[MatchedSighting, ...]
    false: tuple[Detection, ...]


@dataclass(frozen=True, slots=True)
class MatchedRun:
    """The frames of one camera of a recording that have a result, in order of time; `unanswered` have none."""

    simspec: SimSpec
    tape: Tape
    camera: Camera
    frames: tuple[MatchedFrame, ...]
    unanswered: int


def successive(
    values: Iterable[tuple[Hashable, float, T]], longest_gap_s: float
) -> Iterator[tuple[float, T, T]]:
    """Seconds between two successive values of one key, and both; not over longer gaps. Values come as key, time, value."""
    last: dict[Hashable, tuple[float, T]] = {}
    for key, time_s, value in values:
        previous = last.get(key)
        if previous is not None and time_s - previous[0] <= longest_gap_s:
            yield time_s - previous[0], previous[1], value
        last[key] = (time_s, value)


def match_runs(runs: Sequence[tuple[SimSpec, Tape]]) -> list[MatchedRun]:
    """Match all runs twice: with a wide gate, and with one from the displacements that the first pass found."""
    cameras = [(simspec, tape, camera) for simspec, tape in runs for camera in simspec.perceiving_cameras]
    wide = [_matched(simspec, tape, camera, WIDE_GATE) for simspec, tape, camera in cameras]
    table: Floats = np.array([row for run in wide for row in _apart(run)]).reshape(-1, 2)
    if not len(table):
        return wide
    gate = _gate(*table.T)
    return [_matched(simspec, tape, camera, gate) for simspec, tape, camera in cameras]


def _gate(apart_px: Floats, side_px: Floats) -> Gate:
    """From the medians, because a few wrong matches lie far off."""
    least_px = DEVIATIONS_IN_GATE * float(np.median(apart_px))
    share = 0.0
    if len(apart_px) >= MIN_MATCHES_BY_SIZE:
        # Boxes of a network err by a share of their size: the smaller half says what is left of it, the larger half the share.
        large = side_px > np.median(side_px)
        if large.any():
            least_px = DEVIATIONS_IN_GATE * float(np.median(apart_px[~large]))
            share = DEVIATIONS_IN_GATE * float(np.median(apart_px[large] / side_px[large]))
    return Gate(min(WIDE_GATE_PX, max(LEAST_GATE_PX, least_px)), min(WIDE_GATE_SHARE, share))


def _apart(run: MatchedRun) -> Iterator[tuple[float, float]]:
    """Mean distance of the edges, and mean side, of each match."""
    for frame in run.frames:
        for matched in frame.sightings:
            if matched.detection is not None:
                box = matched.sighting.box
                apart_px = float(np.mean(np.abs(np.subtract(matched.detection.box, box))))
                yield apart_px, _mean_side_px(box)


def _mean_side_px(box: Box) -> float:
    return (box[2] - box[0] + box[3] - box[1]) / 2.0


def _matched(simspec: SimSpec, tape: Tape, camera: Camera, gate: Gate) -> MatchedRun:
    answers = detections_by_frame(tape, simspec.vehicle.camera.name)
    last: dict[int, str] = {}
    frames = []
    unanswered = 0
    for frame in tape.frames:
        if frame.camera != camera.name:
            continue
        answer = answers.get((frame.camera, frame.exposed.ns))
        if answer is None:
            unanswered += 1
        elif not _in_outage(simspec, answer):
            frames.append(_matched_frame(frame.sightings, answer, gate, last))
    return MatchedRun(simspec, tape, camera, tuple(frames), unanswered)


def _in_outage(simspec: SimSpec, answer: DetectionFrame) -> bool:
    """Whether a result came while the service lost detections: that is not how the detector is."""
    moments = (answer.exposed, answer.published)
    return any(
        outage.kind != "operator_link" and outage.at_s <= moment.s < outage.until_s
        for outage in simspec.outages
        for moment in moments
    )


def _matched_frame(
    sightings: Sequence[Sighting], answer: DetectionFrame, gate: Gate, last: dict[int, str]
) -> MatchedFrame:
    """`last` has the track that each actor was matched with before; it is updated."""
    chosen = dict(_pairs(sightings, answer.detections, gate, last))
    matched = tuple(
        MatchedSighting(sighting, answer.detections[chosen[row]] if row in chosen else None)
        for row, sighting in enumerate(sightings)
    )
    for item in matched:
        if item.detection is not None:
            last[item.sighting.actor] = item.detection.track
    of_actors = set(chosen.values())
    false = tuple(item for column, item in enumerate(answer.detections) if column not in of_actors)
    return MatchedFrame(answer.exposed, answer.published, matched, false)


def _pairs(
    sightings: Sequence[Sighting], detections: Sequence[Detection], gate: Gate, last: dict[int, str]
) -> Iterable[tuple[int, int]]:
    """Rows of sightings and columns of detections that belong together: the assignment of the least distance."""
    if not sightings or not detections:
        return ()
    actual: Floats = np.array([sighting.box for sighting in sightings], dtype=np.float64)
    reported: Floats = np.array([detection.box for detection in detections], dtype=np.float64)
    apart_px = np.abs(actual[:, None, :] - reported[None, :, :]).mean(axis=2)
    gate_px = gate.at(np.array([_mean_side_px(sighting.box) for sighting in sightings]))[:, None]
    possible = apart_px <= gate_px
    # As in the CLEAR MOT metrics (Bernardin and Stiefelhagen 2008), a correspondence that still holds is kept before a
    # nearer one is made, so that two actors who pass each other do not look like a switch.
    continued = np.array(
        [
            [bool(item.track) and last.get(sighting.actor) == item.track for item in detections]
            for sighting in sightings
        ]
    )
    # In shares of the gate: a large object must not take a small one's detection for being nearer to it in pixels.
    cost = np.where(possible, apart_px / gate_px - np.where(continued, 1.0, 0.0), 1e3)
    rows, columns = linear_sum_assignment(cost)
    return [
        (int(row), int(column)) for row, column in zip(rows, columns, strict=True) if possible[row, column]
    ]
