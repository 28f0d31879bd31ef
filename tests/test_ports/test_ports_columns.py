"""Columns of a run against its objects, one at a time: sightings, overlaps of boxes, tracks that hold actors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from random_run import random_simspec, random_tape
from references.held_tracks import holder, message_credibility

from bench.contracts import CameraFrame, Sighting, SimTime, Tape
from test_ports.ground_truth import GroundTruth
from test_ports.perception.answers import Answers, intersection_over_union
from test_ports.perception.sightings import Sightings, ViewCriteria
from test_ports.perception.track_messages import TrackMessages

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


@pytest.mark.parametrize("seed", [19, 28])
def test_holdings_are_those_of_each_message(seed: int) -> None:
    spec = random_simspec(seed)
    tape = random_tape(spec, seed)
    messages = TrackMessages.of(tape, spec)
    for min_frames in (3, 5):
        holdings = messages.holdings(min_frames)
        held = holdings.held(range(len(tape.cast)), 10.0)
        for row, message in enumerate(tape.tracks):
            arguments = (tape, message.value)
            assert holdings.credibility[row] == message_credibility(*arguments, message.time.s, min_frames)
            for actor in range(len(tape.cast)):
                track = holder(*arguments, actor, message.time.s, 10.0, min_frames)
                assert held[row, actor] == (track is not None)
                assert track is None or messages.tracks[holdings.track[row, actor]] is track
        assert 0 < held.sum() < held.size


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
