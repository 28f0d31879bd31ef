"""Columns of a run against its objects, one at a time: sightings, overlaps of boxes, places, the flight."""

from __future__ import annotations

import math
from dataclasses import replace

import made_run
import numpy as np
import pytest
from made_run import simspec, tape
from random_run import random_simspec, random_tape

from bench.contracts import CameraFrame, Sighting, SimTime, Tape
from test_ports.ground_truth import FlownTrack, GroundTruth
from test_ports.perception.answers import Answers, intersection_over_union
from test_ports.perception.sightings import Sightings, ViewCriteria

Box = tuple[float, float, float, float]


def iou(a: Box, b: Box) -> float:
    """By counting whole pixels: the boxes have whole corners."""
    inside = [
        {(x, y) for x in range(int(left), int(right)) for y in range(int(top), int(bottom))}
        for left, top, right, bottom in (a, b)
    ]
    return len(inside[0] & inside[1]) / len(inside[0] | inside[1]) if inside[0] | inside[1] else 0.0


def test_overlaps_of_boxes_that_touch_lie_apart_or_are_empty() -> None:
    random = np.random.default_rng(3)
    corners = random.integers(0, 7, (400, 2, 4))
    boxes = np.concatenate(
        [np.minimum(corners[..., :2], corners[..., 2:]), np.maximum(corners[..., :2], corners[..., 2:])],
        axis=2,
    )
    shares = intersection_over_union(boxes[:, 0].astype(float), boxes[:, 1].astype(float))
    assert shares.tolist() == pytest.approx([iou(tuple(a), tuple(b)) for a, b in boxes.tolist()])
    assert (shares == 0.0).any()
    assert (shares == 1.0).any()


@pytest.mark.parametrize("seed", [19, 28])
@pytest.mark.parametrize("min_iou", [0.0, 0.2])
def test_overlaps_are_those_of_every_pair_in_a_frame(seed: int, min_iou: float) -> None:
    spec = random_simspec(seed)
    tape = random_tape(spec, seed)
    answers = Answers.of(tape, spec)
    results = {result.exposed.ns: result for result in tape.detections}
    pairs = [
        (detection.box, sighting.box, share)
        for frame in tape.frames
        for detection in (results[frame.exposed.ns].detections if frame.exposed.ns in results else ())
        for sighting in frame.sightings
        if (share := iou(detection.box, sighting.box)) >= min_iou
    ]
    overlaps = answers.overlaps(min_iou)
    assert [tuple(box) for box in answers.box[overlaps.detection].tolist()] == [box for box, _, _ in pairs]
    assert [tuple(box) for box in answers.sightings.box[overlaps.sighting].tolist()] == [
        box for _, box, _ in pairs
    ]
    assert overlaps.iou.tolist() == pytest.approx([share for _, _, share in pairs])
    largest = overlaps.largest()
    assert len(largest.detection) == len(set(overlaps.detection.tolist())) < len(pairs)
    for detection, sighting, share in zip(largest.detection, largest.sighting, largest.iou, strict=True):
        rows = overlaps.detection == detection
        assert share == overlaps.iou[rows].max()
        assert sighting == overlaps.sighting[rows][overlaps.iou[rows] == share].min()


def test_places_at_many_moments_are_those_at_each() -> None:
    """Before, at, between and after the samples, and without any."""
    spec = random_simspec(19)
    tape = random_tape(spec, 19)
    moments_s = np.array([-1.0, 0.0, 0.3, *tape.actor_time_s[3:5], 41.9, tape.end_s, tape.end_s + 9.0])
    times, positions = np.zeros(0), np.zeros((0, len(tape.cast), 3))
    unsampled = replace(tape, actor_time_s=times, actor_position_enu_m=positions)
    for run in (tape, unsampled):
        truth = GroundTruth(run, spec)
        places = truth.at_each(moments_s, [4, 0])
        assert (places == [truth.at(time_s)[[4, 0]] for time_s in moments_s.tolist()]).all()


def test_sightings_keep_their_order_and_first_moments() -> None:
    def sighting(actor: int, visible: float) -> Sighting:
        return Sighting(actor, 30.0, 20.0, visible, (1.0, 2.0, 3.0, 4.0))

    frames = (
        CameraFrame(0, "front", SimTime(0), ()),
        CameraFrame(1, "front", SimTime(10**9), (sighting(5, 0.3), sighting(2, 0.9))),
        CameraFrame(0, "down", SimTime(10**9), (sighting(1, 0.5),)),
        CameraFrame(2, "front", SimTime(2 * 10**9), (sighting(5, 0.8), sighting(2, 1.0))),
    )
    empty = np.zeros(0)
    tape = Tape((), empty, empty, empty, empty, empty, frames=frames)
    sightings = Sightings.of(tape)
    assert sightings.frame.tolist() == [1, 1, 2, 3, 3]
    assert list(sightings.first_s().items()) == [(5, 1.0), (2, 1.0), (1, 1.0)]
    clear = ViewCriteria().are_clear(sightings)
    assert clear.tolist() == [False, True, True, True, True]
    assert list(sightings.first_s(clear).items()) == [(2, 1.0), (1, 1.0), (5, 2.0)]
    assert sightings.are_of([1, 5]).tolist() == [True, False, True, True, False]
    assert math.isclose(sightings.box[3, 3], 4.0)
    assert Sightings.of(Tape((), empty, empty, empty, empty, empty)).first_s() == {}


def test_flight_of_a_made_run() -> None:
    """In the air from 5 s until 5 s before the end; distances follow people who walk."""
    spec = simspec()
    made = tape(spec, end_s=100.0)
    made.actor_position_enu_m[:, made_run.FAR, 0] = made.actor_time_s  # walks east at 1 m/s
    flight = FlownTrack(made, spec)
    assert flight.time_s[flight.airborne][[0, -1]].tolist() == [5.0, 94.5]
    row = int(np.searchsorted(flight.time_s, 50.0))
    apart = flight.distance_m([made_run.FAR])[row, 0]
    east, north = flight.place_m[row]
    assert apart == np.hypot(50.0 - east, -200.0 - north)
    assert flight.above_m([made_run.FAR])[row, 0] == 60.0
    assert flight.time_share(flight.up_m > 0.0, flight.airborne) == 1.0
    assert flight.time_share(flight.up_m > 0.0, flight.between(200.0, 300.0)) is None


def test_no_flight_after_a_crash() -> None:
    """The time after a crash is not time in the air."""
    spec = simspec()
    fallen = tape(
        spec,
        condition=(
            *made_run.conditions((0.0, True), (5.0, False)),
            *made_run.conditions((50.0, False), crashed=True),
        ),
    )
    assert FlownTrack(fallen, spec).time_s[FlownTrack(fallen, spec).airborne][-1] == 49.5
