"""Detections matched with the actors that they are of."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.optimize import linear_sum_assignment

from bench.arrays import Floats
from bench.contracts import Detection, DetectionFrame, Sighting, SimTime, Tape, detections_by_frame
from bench.perception import TRACK_GAP_S
from bench.simspec import Camera, SimSpec

T = TypeVar("T")

WIDE_GATE = (20.0, 0.4)
"""Edges farther than these pixels from those of an actor, and than this share of its sides, on average, are not a detection
of it, in the first pass. Chosen."""

LEAST_GATE_PX = 3.0
DEVIATIONS_IN_GATE = 4.0
"""Of the mean displacement of four edges, in the second pass: beyond lies less than one right match in 10,000."""

MIN_MATCHES_BY_SIZE = 40
"""With fewer matches, one gate holds for all sizes. Chosen."""


@dataclass(frozen=True, slots=True)
class MatchedFrame:
    """One frame with its result: each actor with the detection of it, None when it was missed."""

    exposed: SimTime
    published: SimTime
    sightings: tuple[tuple[Sighting, Detection | None], ...]
    false: tuple[Detection, ...]


@dataclass(frozen=True, slots=True)
class MatchedRun:
    """The frames of one camera of a recording that have a result, in order of time; `unanswered` have none."""

    simspec: SimSpec
    tape: Tape
    camera: Camera
    frames: tuple[MatchedFrame, ...]
    unanswered: int


def successive(values: Iterable[tuple[Hashable, float, T]]) -> Iterator[tuple[float, T, T]]:
    """Seconds between two successive values of one key, and both. Values come as key, time, value."""
    last: dict[Hashable, tuple[float, T]] = {}
    for key, time_s, value in values:
        previous = last.get(key)
        # After a longer absence nothing of a process is left to see, and a track has ended.
        if previous is not None and time_s - previous[0] <= TRACK_GAP_S:
            yield time_s - previous[0], previous[1], value
        last[key] = (time_s, value)


def match_runs(runs: Sequence[tuple[SimSpec, Tape]]) -> list[MatchedRun]:
    """Match all runs twice: with a wide gate, and with one from the displacements that the first pass found."""
    cameras = [(simspec, tape, camera) for simspec, tape in runs for camera in simspec.perceiving_cameras]
    wide = [_matched(simspec, tape, camera, WIDE_GATE) for simspec, tape, camera in cameras]
    pairs = [pair for run in wide for frame in run.frames for pair in frame.sightings]
    boxes = [(sighting.box, detection.box) for sighting, detection in pairs if detection is not None]
    if not boxes:
        return wide
    actual, reported = np.array(boxes).swapaxes(0, 1)
    gate = _gate(np.abs(actual - reported).mean(axis=1), _mean_side_px(actual))
    return [_matched(simspec, tape, camera, gate) for simspec, tape, camera in cameras]


def _gate(apart_px: Floats, side_px: Floats) -> tuple[float, float]:
    """From the medians, because a few wrong matches lie far off."""
    least_px, share = float(np.median(apart_px)), 0.0
    large = side_px > np.median(side_px)
    if len(apart_px) >= MIN_MATCHES_BY_SIZE and large.any():
        # Boxes of a network err by a share of their size: the smaller half says what is left of it, the larger half the share.
        least_px = float(np.median(apart_px[~large]))
        share = float(np.median(apart_px[large] / side_px[large]))
    return (
        min(WIDE_GATE[0], max(LEAST_GATE_PX, DEVIATIONS_IN_GATE * least_px)),
        min(WIDE_GATE[1], DEVIATIONS_IN_GATE * share),
    )


def _mean_side_px(boxes: Floats) -> Floats:
    """(n,) of (n, 4) boxes."""
    sides: Floats = (boxes[:, 2] - boxes[:, 0] + boxes[:, 3] - boxes[:, 1]) / 2.0
    return sides


def _matched(simspec: SimSpec, tape: Tape, camera: Camera, gate: tuple[float, float]) -> MatchedRun:
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
    return any(
        outage.kind != "operator_link" and outage.at_s <= moment.s < outage.until_s
        for outage in simspec.outages
        for moment in (answer.exposed, answer.published)
    )


def _matched_frame(
    sightings: Sequence[Sighting], answer: DetectionFrame, gate: tuple[float, float], last: dict[int, str]
) -> MatchedFrame:
    """`last` has the track that each actor was matched with before; it is updated."""
    detections = answer.detections
    chosen = _pairs(sightings, detections, gate, last) if sightings and detections else {}
    for row, column in chosen.items():
        last[sightings[row].actor] = detections[column].track
    return MatchedFrame(
        answer.exposed,
        answer.published,
        tuple(
            (sighting, detections[chosen[row]] if row in chosen else None)
            for row, sighting in enumerate(sightings)
        ),
        tuple(item for column, item in enumerate(detections) if column not in chosen.values()),
    )


def _pairs(
    sightings: Sequence[Sighting],
    detections: Sequence[Detection],
    gate: tuple[float, float],
    last: dict[int, str],
) -> dict[int, int]:
    """Rows of sightings with the columns of detections that belong to them: the assignment of the least distance."""
    actual: Floats = np.array([sighting.box for sighting in sightings], dtype=np.float64)
    reported: Floats = np.array([detection.box for detection in detections], dtype=np.float64)
    apart_px = np.abs(actual[:, None, :] - reported[None, :, :]).mean(axis=2)
    least_px, share = gate
    gate_px = np.maximum(least_px, share * _mean_side_px(actual))[:, None]
    possible = apart_px <= gate_px
    # As in the CLEAR MOT metrics (Bernardin and Stiefelhagen 2008), a correspondence that still holds is kept before a
    # nearer one is made, so that two actors who pass each other do not look like a switch.
    former = np.array([last.get(item.actor, "") for item in sightings])[:, None]
    continued = (former == np.array([item.track for item in detections])) & (former != "")
    # In shares of the gate: a large object must not take a small one's detection for being nearer to it in pixels.
    cost = np.where(possible, apart_px / gate_px - np.where(continued, 1.0, 0.0), 1e3)
    rows, columns = linear_sum_assignment(cost)
    return {int(row): int(column) for row, column in zip(rows, columns, strict=True) if possible[row, column]}
