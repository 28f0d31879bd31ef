"""The Kalman tracker: its filter, warp and assignment against independent references, and what becomes of identities."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from bench.arrays import Floats
from bench.contracts import CameraPose, Detection, Lens, SimTime
from bench.perception import KalmanTracker, TrackerSettings, ground_homography, ground_warp
from bench.perception._box_tracks import BoxTracks
from bench.perception._tracker import assign, noise_px2, overlaps, straight_boxes
from bench.perception._tracks import TrackNames, UntrackedDetection

PERIOD_NS = 200_000_000
LENS = Lens("front", 640, 480, 457.0, 457.0, 320.0, 240.0)


def box_at(x_px: float, y_px: float, side_px: float = 20.0) -> tuple[float, float, float, float]:
    return x_px - side_px / 2.0, y_px - side_px / 2.0, x_px + side_px / 2.0, y_px + side_px / 2.0


def names_of(
    tracker: KalmanTracker, frames: Sequence[tuple[float, Sequence[tuple[float, float] | None]]]
) -> list[list[str | None]]:
    """For each frame (seconds, middles of boxes; None for a miss) the tracks, in the order of the middles."""
    rows: list[list[str | None]] = []
    for time_s, middles in frames:
        detections = [Detection("civilian", 0.9, box_at(*middle)) for middle in middles if middle is not None]
        named = tracker.name(detections, SimTime(round(time_s * 1e9)))
        track_at = {detection.box: detection.track for detection in named}
        rows.append([None if middle is None else track_at[box_at(*middle)] for middle in middles])
    return rows


def test_filter_agrees_with_the_matrix_form_on_random_input() -> None:
    """Prediction, white acceleration and update of two tracks against 8 x 8 matrices, over irregular frames."""
    rng = np.random.default_rng(3)
    settings = TrackerSettings()
    focal_px = 500.0
    place, rate = rng.uniform(50.0, 400.0, (2, 4)), rng.normal(0.0, 30.0, (2, 4))
    tracks = BoxTracks(
        np.arange(2), ["civilian", "tree"], np.ones(2, dtype=np.int64), np.zeros(2), place.copy(), rate.copy(),
        np.tile([4.0, 1.0, 900.0], (2, 4, 1)),
    )  # fmt: skip
    states = [np.concatenate([place[row], rate[row]]) for row in range(2)]
    eye = np.eye(4)
    covariances = [np.block([[4.0 * eye, eye], [eye, 900.0 * eye]]) for _ in range(2)]
    observe = np.hstack([eye, np.zeros((4, 4))])
    for span_s in (0.2, 0.05, 0.7, 0.0, 1.3):
        measured = rng.uniform(50.0, 400.0, (2, 4))
        noise = noise_px2(measured, settings, 2.0)
        tracks.predict(span_s, settings, focal_px, uneven=False)
        tracks.update(np.arange(2), measured, noise)
        for row in range(2):
            transition = np.block([[eye, span_s * eye], [np.zeros((4, 4)), eye]])
            states[row] = transition @ states[row]
            states[row][2:4] = np.maximum(states[row][2:4], 1.0)
            sides = states[row][2:4]
            middle = settings.object_rad2_per_s3 * focal_px**2
            density = np.diag([middle, middle, *(settings.size_share2_per_s3 * sides**2)])
            mixed = density * span_s**2 / 2.0
            disturbance = np.block([[density * span_s**3 / 3.0, mixed], [mixed, density * span_s]])
            covariance = transition @ covariances[row] @ transition.T + disturbance
            spread = observe @ covariance @ observe.T + np.diag(noise[row])
            gain = covariance @ observe.T @ np.linalg.inv(spread)
            states[row] = states[row] + gain @ (measured[row] - observe @ states[row])
            covariances[row] = (np.eye(8) - gain @ observe) @ covariance

    for row in range(2):
        np.testing.assert_allclose(tracks.place[row], states[row][:4], rtol=1e-9)
        np.testing.assert_allclose(tracks.rate[row], states[row][4:], rtol=1e-9)
        blocks = (covariances[row][:4, :4], covariances[row][:4, 4:], covariances[row][4:, 4:])
        for part, block in enumerate(blocks):
            np.testing.assert_allclose(np.diag(tracks.covariance[row, :, part]), block, rtol=1e-8, atol=1e-9)


def pose_over(east_m: float, north_m: float, height_m: float, yaw_rad: float, tilt_rad: float) -> CameraPose:
    """A level camera; yaw clockwise from north, tilt below the horizon."""
    level = np.array([math.sin(yaw_rad), math.cos(yaw_rad), 0.0])
    forward = math.cos(tilt_rad) * level - math.sin(tilt_rad) * np.array([0.0, 0.0, 1.0])
    right = np.array([math.cos(yaw_rad), -math.sin(yaw_rad), 0.0])
    axes = np.stack([right, np.cross(forward, right), forward])
    return CameraPose(SimTime(0), np.array([east_m, north_m, height_m]), axes, np.zeros(3), np.zeros(3))


def homography_of(pose: CameraPose) -> Floats:
    return ground_homography((LENS.fx, LENS.fy), (LENS.cx, LENS.cy), pose.axes_enu, pose.position_enu_m)


def test_warp_takes_the_ground_from_picture_to_picture() -> None:
    """Places a metre above the ground, through the camera's own projection; velocities by differences."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        low, high = (-20.0, -20.0, 30.0, 0.0), (20.0, 20.0, 90.0, 0.8)
        drawn = rng.uniform(low, high, (2, 4)).tolist()
        poses = [pose_over(east, north, height, yaw, 1.1) for east, north, height, yaw in drawn]
        warp = ground_warp(*(homography_of(pose) for pose in poses))
        assert warp is not None
        ahead = poses[0].position_enu_m + 60.0 * poses[0].axes_enu[2]
        places = np.column_stack([ahead[:2] + rng.uniform(-15.0, 15.0, (6, 2)), np.ones(6)])
        places = places[poses[1].to_optical(places)[:, 2] > 1.0]
        before, after = (LENS.project(pose.to_optical(places)) for pose in poses)
        count = len(places)
        rate = rng.normal(0.0, 5.0, (count, 4))
        tracks = BoxTracks(
            np.arange(count), ["tree"] * count, np.ones(count, dtype=np.int64), np.zeros(count),
            np.column_stack([before, np.full((count, 2), 10.0)]), rate.copy(), np.ones((count, 4, 3)),
        )  # fmt: skip
        tracks.warp(warp)

        np.testing.assert_allclose(tracks.place[:, :2], after, atol=1e-6)
        step = 1e-5
        nudged = np.column_stack([before + step * rate[:, :2], np.ones(count)]) @ warp.T
        expected = (nudged[:, :2] / nudged[:, 2:] - after) / step
        np.testing.assert_allclose(tracks.rate[:, :2], expected, rtol=1e-3, atol=1e-3)


def test_no_warp_from_a_camera_that_stands_in_the_plane() -> None:
    standing, flying = pose_over(0.0, 0.0, 1.0, 0.0, 0.5), pose_over(0.0, 0.0, 40.0, 0.0, 0.5)
    assert ground_warp(homography_of(standing), homography_of(flying)) is None
    assert ground_warp(homography_of(flying), homography_of(flying)) is not None


def test_assignment_agrees_with_trying_everything() -> None:
    """As many admissible pairs as there can be, at the least cost, beside those that are taken."""
    rng = np.random.default_rng(11)
    inadmissible = 1e9
    for _ in range(60):
        rows, columns = rng.integers(1, 6, 2)
        costs = rng.uniform(-5.0, 20.0, (rows, columns))
        costs[rng.random((rows, columns)) < 0.4] = inadmissible
        open_rows, open_columns = rng.random(rows) < 0.8, rng.random(columns) < 0.8
        assigned = {0: 0} if rng.random() < 0.5 else {}
        free_rows = [row for row in range(rows) if open_rows[row] and row not in assigned.values()]
        free_columns = [
            column for column in range(columns) if open_columns[column] and column not in assigned
        ]
        best = (0, 0.0)
        for count in range(1, min(len(free_rows), len(free_columns)) + 1):
            for chosen in itertools.combinations(free_columns, count):
                for placed in itertools.permutations(free_rows, count):
                    total = sum(costs[row, column] for row, column in zip(placed, chosen, strict=True))
                    if total < inadmissible / 2.0:
                        best = min(best, (-count, total))

        matches = assign(costs, open_rows, open_columns, assigned)

        assert len(set(matches.values())) == len(matches)
        assert -len(matches) == best[0]
        assert sum(costs[row, column] for column, row in matches.items()) == pytest.approx(best[1])


def test_overlaps_agree_with_counted_pixels() -> None:
    rng = np.random.default_rng(2)
    corners = rng.integers(0, 20, (2, 5, 2))
    sides = rng.integers(1, 15, (2, 5, 2))
    masks = np.zeros((2, 5, 40, 40), dtype=bool)
    for kind, number in itertools.product(range(2), range(5)):
        (x, y), (width, height) = corners[kind, number], sides[kind, number]
        masks[kind, number, y : y + height, x : x + width] = True
    boxes = np.concatenate([corners + sides / 2.0, sides], axis=2)
    for first, second in itertools.product(range(5), range(5)):
        overlap = np.count_nonzero(masks[0, first] & masks[1, second])
        either = np.count_nonzero(masks[0, first] | masks[1, second])
        assert overlaps(boxes[0], boxes[1])[first, second] == pytest.approx(overlap / either)


def test_two_objects_that_cross_keep_their_tracks() -> None:
    """They meet in one pixel, where only their motion tells them apart; two more stand by."""
    frames = [
        (0.2 * k, [(100.0 + 8.0 * k, 200.0), (340.0 - 8.0 * k, 200.0), (60.0, 60.0), (500.0, 400.0)])
        for k in range(15)
        if k != 8
    ]
    rows = names_of(KalmanTracker(), frames)
    assert {tuple(row) for row in rows} == {tuple(rows[0])}
    assert len(set(rows[0])) == 4


@pytest.mark.parametrize("seed", [1, 2])
def test_irregular_frames_keep_tracks(seed: int) -> None:
    """Two objects that move evenly, in pictures at random times, a third of the boxes missed."""
    rng = np.random.default_rng(seed)
    tracker, names = KalmanTracker(), [set[str | None](), set[str | None]()]
    for k, time_s in enumerate(np.cumsum(rng.uniform(0.03, 0.4, 60)).tolist()):
        missed = rng.random(2) < (1 / 3 if k > 4 else 0.0)
        boxes = [
            None if gone else (50.0 + 20.0 * time_s, y) for gone, y in zip(missed, (80.0, 300.0), strict=True)
        ]
        for seen, name in zip(names, names_of(tracker, [(time_s, boxes)])[0], strict=True):
            seen.add(name)
    assert [len(seen - {None}) for seen in names] == [1, 1]


def test_names_end_and_never_come_back() -> None:
    """Confirmed: kept over 2 s without a picture, not over 2.2 s. After two detections: over 1 s, not 1.2 s."""
    tracker = KalmanTracker()
    place: tuple[float, float] = (200.0, 200.0)
    started = names_of(tracker, [(0.2 * k, [place]) for k in range(5)])
    assert {name for row in started for name in row} == {"t1"}
    # 2 s after the last one.
    assert names_of(tracker, [(2.8, [place])]) == [["t1"]]
    assert names_of(tracker, [(3.0 + 0.2 * k, [None]) for k in range(10)]) == [[None]] * 10
    assert names_of(tracker, [(5.0, [place])]) == [["t2"]]
    assert names_of(tracker, [(6.0, [place]), (6.5, [None]), (7.2, [place])]) == [["t2"], [None], ["t3"]]
    far = [(10.0 + k, [(float(x), float(y)) for x in (50, 300) for y in (50, 300)]) for k in range(3)]
    later = [name for frame in far for row in names_of(tracker, [frame]) for name in row]
    assert set(later).isdisjoint({"t1", "t2", "t3"})


def test_turns_of_the_camera_move_all_tracks_alike() -> None:
    """Four objects 60 px apart jump twice by 36 px: the shared displacement, not the nearest box, names them."""
    rng = np.random.default_rng(4)
    grid = [(150.0 + 60.0 * k + float(rng.uniform(-8, 8)), 200.0 + 9.0 * k) for k in range(4)]
    offsets = [0.0] * 5 + [36.0] + [72.0] * 3
    frames = [(0.2 * k, [(x + offset, y) for x, y in grid]) for k, offset in enumerate(offsets)]
    rows = names_of(KalmanTracker(), frames)
    assert {tuple(row) for row in rows} == {("t1", "t2", "t3", "t4")}


def test_form_and_order_are_those_of_the_simulated_tracker() -> None:
    """The same boxes, each of another subject: the same result, however they are ordered and named before."""
    detections = [
        Detection("tree", 0.5, box_at(100.0, 100.0)),
        Detection("civilian", 0.9, box_at(300.0, 100.0)),
        Detection("civilian", 0.5, box_at(20.0, 300.0)),
        Detection("tree", 0.7, box_at(500.0, 50.0)),
    ]
    expected = TrackNames().name(
        [UntrackedDetection(detection, subject) for subject, detection in enumerate(detections)], SimTime(0)
    )
    for order in itertools.permutations(detections):
        assert KalmanTracker().name(order, SimTime(0)) == expected
    assert KalmanTracker().name(expected, SimTime(0)) == expected
    assert KalmanTracker().name([], SimTime(0)) == ()


def test_doubtful_boxes_continue_tracks_but_never_take_one_from_a_sure_box() -> None:
    tracker = KalmanTracker()
    for k in range(4):
        tracker.name([Detection("civilian", 0.9, box_at(200.0, 200.0))], SimTime(k * PERIOD_NS))
    doubtful = Detection("civilian", 0.2, box_at(200.0, 200.0))
    sure = Detection("civilian", 0.8, box_at(203.0, 200.0))
    named = tracker.name([doubtful, sure], SimTime(4 * PERIOD_NS))
    assert [(detection.score, detection.track) for detection in named] == [(0.8, "t1"), (0.2, "t2")]
    assert tracker.name([doubtful], SimTime(5 * PERIOD_NS))[0].track == "t1"


def test_floods_are_named_within_bounds() -> None:
    """Thousands of boxes in a frame: each has a name of its own, and the tracker holds no more than it says."""
    rng = np.random.default_rng(8)
    settings = TrackerSettings(max_tracks=40)
    tracker = KalmanTracker(settings=settings)
    for number in range(6):
        middles = rng.uniform(0.0, 600.0, (1500, 2))
        scores = rng.uniform(0.0, 1.0, 1500)
        boxes = zip(scores.tolist(), middles.tolist(), strict=True)
        detections = [Detection("tree", score, box_at(*middle)) for score, middle in boxes]
        named = tracker.name(detections, SimTime(number * PERIOD_NS // 10))
        assert len({detection.track for detection in named}) == 1500
        assert len(tracker._tracks.numbers) <= 2 * settings.max_tracks


@pytest.mark.parametrize(
    ("detection", "reason"),
    [
        (Detection("tree", 0.5, (0.0, 0.0, math.inf, 1.0)), "box"),
        (Detection("tree", 0.5, (0.0, math.nan, 1.0, 1.0)), "box"),
        (Detection("tree", 0.5, (5.0, 0.0, 1.0, 1.0)), "box"),
        (Detection("tree", math.nan, (0.0, 0.0, 1.0, 1.0)), "score"),
    ],
)
def test_what_is_no_detection_is_refused(detection: Detection, reason: str) -> None:
    with pytest.raises(ValueError, match=f"a detection's {reason} is not"):
        KalmanTracker().name([detection], SimTime(0))


def test_time_and_focal_length_must_make_sense() -> None:
    tracker = KalmanTracker()
    tracker.name([], SimTime(PERIOD_NS))
    with pytest.raises(ValueError, match="comes after one"):
        tracker.name([], SimTime(0))
    for focal_px in (0.0, math.nan):
        with pytest.raises(ValueError, match="focal length"):
            KalmanTracker(focal_px)


@dataclass
class Switches:
    """How often an object in two of its successive detections, at most 2 s apart, changed its track."""

    pairs: int = 0
    changes: int = 0


@cache
def flown_switches(
    *, warped: bool, recall: float, seed: int, lens: Lens = LENS, known_lens: Lens | None = None
) -> Switches:
    """Thirty walkers seen from a camera that flies 10 m/s and turns by 60 degrees a second every 5 s."""
    rng = np.random.default_rng(seed)
    walkers_m, velocity_mps = rng.uniform(-90.0, 90.0, (30, 2)), rng.normal(0.0, 0.8, (30, 2))
    tracker = KalmanTracker(LENS.fx, lens=known_lens)
    yaw_rad, place_m, last = 0.0, np.array([-40.0, -40.0]), None
    last_sightings: dict[int, tuple[float, str]] = {}
    switches = Switches()
    for number in range(150):
        time_s = 0.2 * number
        yaw_rad += math.radians(12.0) if number % 25 < 7 else 0.0
        place_m = place_m + 0.2 * 10.0 * np.array([math.sin(yaw_rad), math.cos(yaw_rad)])
        pose = pose_over(place_m[0], place_m[1], 60.0, yaw_rad, math.radians(60.0))
        feet = np.column_stack([walkers_m + time_s * velocity_mps, np.full(30, 0.9)])
        pixels = lens.project(pose.to_optical(feet))
        shown = [
            walker
            for walker, (x, y) in enumerate(LENS.project(pose.to_optical(feet)))
            if 8.0 < x < 632.0 and 8.0 < y < 472.0 and rng.random() < recall
        ]
        boxes = {
            walker: tuple(np.add(box_at(x_px, y_px, 12.0), rng.normal(0.0, 1.0, 4)).tolist())
            for walker, (x_px, y_px) in zip(shown, pixels[shown].tolist(), strict=True)
        }
        homography = homography_of(pose)
        warp = ground_warp(last, homography) if warped and last is not None else None
        last = homography
        named = tracker.name(
            [Detection("civilian", 0.9, box) for box in boxes.values()],
            SimTime(round(time_s * 1e9)),
            warp,
        )
        track_at = {detection.box: detection.track for detection in named}
        for walker, box in boxes.items():
            if walker in last_sightings and time_s - last_sightings[walker][0] <= 2.0:
                switches.pairs += 1
                switches.changes += track_at[box] != last_sightings[walker][1]
            last_sightings[walker] = (time_s, track_at[box])
    return switches


def test_identities_last_over_a_flight_with_turns() -> None:
    """With the warp hardly any identity changes; without it turns cost many, which is why the warp exists."""
    warped = [flown_switches(warped=True, recall=0.8, seed=seed) for seed in (1, 2)]
    blind = [flown_switches(warped=False, recall=0.8, seed=seed) for seed in (1, 2)]
    for with_warp, without in zip(warped, blind, strict=True):
        assert with_warp.pairs > 200
        assert with_warp.changes <= 0.02 * with_warp.pairs
        assert with_warp.changes < without.changes


BENT = replace(LENS, distortion=(-0.3, 0.1, 0.0004, -0.0003, -0.01))
"""A lens that shows what is in the corners 70 pixels from where they would be without distortion."""


def test_identities_last_behind_a_lens_with_distortion() -> None:
    """As well as without one if the tracker knows the lens: its warp has straight lines."""
    straight = flown_switches(warped=True, recall=0.8, seed=2)
    with_lens = flown_switches(warped=True, recall=0.8, seed=2, lens=BENT, known_lens=BENT)
    unknown = flown_switches(warped=True, recall=0.8, seed=2, lens=BENT)

    assert with_lens.pairs == unknown.pairs == straight.pairs
    assert with_lens.changes <= straight.changes + 2
    assert unknown.changes >= 1.5 * with_lens.changes


def test_straight_boxes_are_those_of_a_lens_without_distortion() -> None:
    """The middles of the edges of rectangles, projected by a lens with and by one without distortion."""
    rng = np.random.default_rng(8)
    rays = rng.uniform((-0.5, -0.35), (0.45, 0.3), (40, 2))
    low, high = rays, rays + rng.uniform(0.01, 0.08, (40, 2))
    middle = (low + high) / 2.0

    def boxes_by(lens: Lens) -> Floats:
        edges = [
            lens.project(np.column_stack([points, np.ones(40)]))
            for points in (
                np.column_stack([low[:, 0], middle[:, 1]]),
                np.column_stack([middle[:, 0], low[:, 1]]),
                np.column_stack([high[:, 0], middle[:, 1]]),
                np.column_stack([middle[:, 0], high[:, 1]]),
            )
        ]
        return np.stack([edges[0][:, 0], edges[1][:, 1], edges[2][:, 0], edges[3][:, 1]], axis=1)

    bent, straight = boxes_by(BENT), boxes_by(LENS)
    assert np.abs(bent - straight).max() > 15.0
    # A straight edge is bent by the lens, so its middle is not exactly where the box has it.
    np.testing.assert_allclose(straight_boxes(BENT, bent), straight, atol=1.0)
    assert (straight_boxes(LENS, bent) == bent).all()
    outside = np.array([(5e4, 5e4, 5e4 + 9.0, 5e4 + 9.0)])
    assert (straight_boxes(BENT, outside) == outside).all()
