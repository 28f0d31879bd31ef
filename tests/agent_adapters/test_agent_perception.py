# mypy: disable-error-code=unreachable
# `take_mount` sets an attribute that the type checker takes to be None still.
"""From pixels to places, and from places to tracks."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pymap3d
import pytest
from agent_fakes import (
    FOCAL_PX,
    HEIGHT_PX,
    NAME,
    WIDTH_PX,
    Multicopter,
    camera_info,
    mount,
    mount_quaternion,
    pixel_of,
)

from agent_adapters.reference import GroundCamera, VehiclePose
from agent_adapters.reference._agent import kept_detections
from agent_adapters.reference.perception import _perception
from agent_adapters.reference.perception._camera import View
from agent_adapters.reference.perception._perception import ObjectPerception
from agent_adapters.reference.perception._pose import PoseHistory, east_north_of, wrapped
from agent_adapters.reference.perception._quality import DetectionQuality
from agent_adapters.reference.perception._tracks import PlacedDetection, Track, Tracks
from bench.contracts import Origin
from bench.streams import BoundingBox2D, Detection2D, Detection2DArray, Header, TFMessage, Time


def camera(*, level: bool = True) -> GroundCamera:
    return GroundCamera.of(camera_info(), mount_quaternion(), level=level)


def pose(**changes: float) -> VehiclePose:
    """60 m above the origin, looking north."""
    at = {"time_s": 0.0, "east_m": 0.0, "north_m": 0.0, "height_m": 60.0}
    turn = {"roll_rad": 0.0, "pitch_rad": 0.0, "yaw_rad": 0.0}
    return VehiclePose(**{**at, **turn, **changes})


def middle(*, level: bool = True, **changes: float) -> tuple[float, float] | None:
    """The place on the ground in the middle of the image."""
    return camera(level=level).ground_point(WIDTH_PX / 2, HEIGHT_PX / 2, pose(**changes))


def test_edges_by_hand() -> None:
    """The axis looks 60 degrees down, 69.28 m far, so half of the swath is 69.28 tan 35 = 48.51 m. The lower edge lies
    atan(360 / f) below the axis, f = 914.03 px: 9.0 m ahead.
    """
    below = math.degrees(math.atan(HEIGHT_PX / 2 / FOCAL_PX))
    assert camera().ahead_m(60.0)[0] == pytest.approx(60.0 / math.tan(math.radians(60.0 + below)), abs=1e-6)
    assert camera().swath_m(60.0) == pytest.approx(2 * 48.511, abs=1e-2)


def test_a_body_mount_turns_with_the_body() -> None:
    """Pitched 10 degrees nose down, a fixed camera looks 70 degrees down; rolled right wing down by 10 degrees it sees to
    the left. A level one notices neither.
    """
    tilt_rad = math.radians(10.0)
    down = middle(level=False, pitch_rad=-tilt_rad)
    assert down == pytest.approx((0.0, 60.0 / math.tan(math.radians(70.0))), abs=1e-3)
    rolled = middle(level=False, roll_rad=tilt_rad)
    assert rolled is not None
    assert rolled[0] == pytest.approx(-60.0 * math.tan(tilt_rad), abs=1e-3)
    assert middle(pitch_rad=-tilt_rad, roll_rad=tilt_rad) == pytest.approx((0.0, 34.641), abs=1e-3)


def test_the_sky_is_nowhere() -> None:
    """A pixel at or above the horizon, or on ground too far to trust, has no place."""
    assert camera().ground_point(WIDTH_PX / 2, -2000.0, pose()) is None
    assert middle(height_m=2000.0) is None


@pytest.mark.parametrize("place", [(20.0, 55.0), (-30.0, 40.0), (0.0, 12.0)])
@pytest.mark.parametrize("yaw_deg", [0.0, 100.0, -60.0])
def test_projection_and_its_inverse_agree(place: tuple[float, float], yaw_deg: float) -> None:
    """What an independent projection puts into the image comes back to its place on the ground."""
    vehicle = Multicopter(3.0, -8.0)
    vehicle.height_m, vehicle.yaw_rad = 60.0, math.radians(yaw_deg)
    sine, cosine = math.sin(vehicle.yaw_rad), math.cos(vehicle.yaw_rad)
    east, north = 3.0 + place[1] * sine + place[0] * cosine, -8.0 + place[1] * cosine - place[0] * sine
    pixel = pixel_of(east, north, 0.9, vehicle)
    assert pixel is not None
    at = pose(east_m=3.0, north_m=-8.0, yaw_rad=vehicle.yaw_rad)
    assert camera().ground_point(*pixel, at, 0.9) == pytest.approx((east, north), abs=1e-6)


def test_a_distorting_lens_is_taken_into_account() -> None:
    """Pixels by cv2.projectPoints lead back to the ground they show, and what the picture shows is in view."""
    d = (-0.22, 0.06, 0.0012, -0.0009, -0.004)
    bent = GroundCamera.of(replace(camera_info(), d=d), mount_quaternion(), level=True)
    axes, lens = np.array(bent.axes).T, bent.lens
    matrix = np.array(((lens.fx, 0.0, lens.cx), (0.0, lens.fy, lens.cy), (0.0, 0.0, 1.0)))
    places = np.array(
        [(east, north) for east in (-45.0, -20.0, 0.0, 30.0, 50.0) for north in (8.0, 35.0, 80.0)]
    )
    # The body looks north: x is north, y is west, z is up.
    offsets = np.stack((places[:, 1], -places[:, 0], np.full(len(places), -60.0)), axis=-1)
    projected, _ = cv2.projectPoints(offsets @ axes.T, np.zeros(3), np.zeros(3), matrix, np.array(d))
    pixels = projected[:, 0]
    inside = ((pixels >= 0.0) & (pixels < (WIDTH_PX, HEIGHT_PX))).all(axis=1)
    assert 4 <= inside.sum() < len(places)
    for place, (u_px, v_px) in zip(places[inside], pixels[inside].tolist(), strict=True):
        assert bent.ground_point(u_px, v_px, pose()) == pytest.approx(tuple(place), abs=1e-2)
    assert bent.in_view(places, np.array(((0.0, 0.0, 60.0, 0.0),)))[0].tolist() == inside.tolist()


@pytest.mark.parametrize("d", [(0.0,) * 5, (-0.22, 0.06, 0.0012, -0.0009, -0.004)])
@pytest.mark.parametrize("level", [True, False])
def test_one_place_is_judged_as_many_are(d: tuple[float, ...], level: bool) -> None:
    """Random places and views: some are in the picture, some beside it, some behind the camera."""
    rng = np.random.default_rng(17)
    eye = GroundCamera.of(replace(camera_info(), d=d), mount_quaternion(), level=level)
    places = rng.uniform(-150.0, 150.0, (60, 2))
    poses = np.column_stack(
        (rng.uniform(-80.0, 80.0, (40, 2)), rng.uniform(1.0, 120.0, 40), rng.uniform(-7.0, 7.0, 40))
    )
    views = [View(0.0, *row) for row in poses.tolist()]

    shown = [[eye.shows(east_m, north_m, view) for east_m, north_m in places.tolist()] for view in views]

    assert 100 < np.sum(shown) < len(places) * len(views) / 2
    assert shown == eye.in_view(places, poses).tolist()


def test_pose_between_samples() -> None:
    """Between two samples the pose is linear, yaw the short way; beyond the last the velocity counts."""
    history = PoseHistory()
    for time_s, north in ((1.0, 0.0), (1.1, 1.2)):
        history.place(time_s, 0.0, north, 60.0, (0.0, 12.0, 0.0))
    history.turn(1.0, 0.0, 0.0, math.radians(179.0))
    history.turn(1.1, 0.0, 0.0, math.radians(-179.0))
    between, beyond = history.at(1.05), history.at(1.2)
    assert between is not None
    assert beyond is not None
    assert between.north_m == pytest.approx(0.6)
    assert abs(wrapped(between.yaw_rad)) == pytest.approx(math.pi)
    assert beyond.north_m == pytest.approx(2.4)
    assert history.at(0.9) is None
    assert history.at(1.7) is None


def test_east_and_north_agree_with_a_geodesy_library() -> None:
    """Random places up to 300 m from origins on all the earth and at the date line, as far as a flat map reaches."""
    random = np.random.default_rng(7)
    for _ in range(500):
        longitude = random.choice([random.uniform(-180.0, 180.0), 180.0, -180.0, 179.9999, -179.9999])
        origin = Origin(
            latitude_deg=random.uniform(-85.0, 85.0),
            longitude_deg=float(longitude),
            altitude_m=random.uniform(-400.0, 5000.0),
        )
        place = random.uniform(-300.0, 300.0, 2)
        latitude_deg, longitude_deg, _ = pymap3d.enu2geodetic(
            *place, 0.0, origin.latitude_deg, origin.longitude_deg, origin.altitude_m
        )
        bend_m = 300.0**2 * math.tan(math.radians(abs(origin.latitude_deg))) / 6356752.0
        found = east_north_of(float(latitude_deg), float(longitude_deg), origin)
        assert math.dist(found, place) < 0.005 + 1.2 * bend_m


def sight(
    time_s: float,
    east_m: float,
    north_m: float,
    label: str = "civilian",
    score: float = 0.9,
    bearing_deg: float = 0.0,
) -> PlacedDetection:
    return PlacedDetection(time_s, east_m, north_m, label, score, math.radians(bearing_deg), 70.0)


def test_a_walker_stays_one_track() -> None:
    """Someone who walks at 1.5 m/s and is missed for a second is still the same object."""
    tracks = Tracks()
    for frame in [*range(10), *range(15, 25)]:
        tracks.take(frame * 0.2, [sight(frame * 0.2, 1.5 * frame * 0.2, 0.0)])
    assert [track.frames for track in tracks] == [20]


def test_neighbours_stay_apart() -> None:
    """Two people ten metres apart are two tracks, each fed by the detection nearer to it."""
    tracks = Tracks()
    for frame in range(5):
        tracks.take(frame * 0.2, [sight(frame * 0.2, 0.3, 0.0), sight(frame * 0.2, 10.2, 0.0)])
    assert [(track.frames, round(track.east_m)) for track in tracks] == [(5, 0), (5, 10)]


def test_a_single_false_detection_is_forgotten() -> None:
    """What was seen once and never again is gone after a few seconds, and its place is free."""
    tracks = Tracks()
    tracks.take(0.0, [sight(0.0, 0.0, 0.0)])
    tracks.take(4.0, [sight(4.0, 50.0, 50.0)])
    assert [(track.east_m, track.north_m) for track in tracks] == [(50.0, 50.0)]
    assert tracks.within(0.0, 0.0, 5.0) == []


def track_of(*labels: str, score: float = 0.9, bearings_deg: tuple[float, ...] = ()) -> Track:
    tracks = Tracks()
    bearings_deg = bearings_deg or (0.0,) * len(labels)
    for index, (label, bearing) in enumerate(zip(labels, bearings_deg, strict=True)):
        tracks.take(index * 0.2, [sight(index * 0.2, 0.0, 0.0, label, score, bearing)])
    (track,) = tracks
    return track


def test_votes_decide_the_class() -> None:
    """The class with more weight wins; confidence falls with dissent and grows with looks."""
    mixed = track_of("combatant", "civilian", "civilian", "civilian")
    assert mixed.label == "civilian"
    assert mixed.streak == 3
    assert mixed.share("combatant") == pytest.approx(0.25)
    assert mixed.confidence == pytest.approx(0.75 * 0.9)
    assert track_of(*["civilian"] * 8, score=0.6).confidence == pytest.approx(1 - 0.4**2)
    assert track_of("civilian", score=0.6).confidence == pytest.approx(0.6)


def test_viewpoints_are_the_circle_less_the_widest_gap() -> None:
    """Directions of 350, 10 and 40 degrees span 50, whichever way north lies."""
    spread = track_of("tree", "tree", "tree", bearings_deg=(350.0, 10.0, 40.0)).viewpoint_deg
    assert spread == pytest.approx(50.0)
    assert track_of("tree", "tree", bearings_deg=(90.0, 91.0)).viewpoint_deg == 0.0


def perception_over(*places: tuple[float, float]) -> ObjectPerception:
    """Eyes that hovered 60 m over each place for three frames, looking north."""
    history = PoseHistory()
    perception = ObjectPerception(history, "auto")
    perception.take_info(camera_info())
    perception.take_mount(mount())
    for index, (east, north) in enumerate(places):
        for frame in range(3):
            time_s = index + frame * 0.2
            history.place(time_s, east, north, 60.0, (0.0, 0.0, 0.0))
            history.turn(time_s, 0.0, 0.0, 0.0)
            assert perception.see(Detection2DArray(Header(Time.of(round(time_s * 1e9)))))
    return perception


def test_what_was_looked_at_is_known() -> None:
    """A disc in the middle of the image is seen; one behind the vehicle is not; old looks do not count."""
    perception = perception_over((0.0, 0.0))
    assert perception.unseen_share(0.0, 35.0, 15.0, 0.0) == 0.0
    assert perception.unseen_share(0.0, -40.0, 15.0, 0.0) == 1.0
    assert 0.2 < perception.unseen_share(0.0, 35.0, 56.0, 0.0) < 0.8
    assert perception.unseen_share(0.0, 35.0, 15.0, 10.0) == 1.0


def test_few_places_are_judged_as_many_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """The share of a disc does not depend on whether its places are judged one by one or as arrays."""
    rng = np.random.default_rng(5)
    perception = perception_over(*rng.uniform(-60.0, 60.0, (6, 2)).tolist())
    discs = [
        (float(east_m), float(north_m), radius_m)
        for east_m, north_m in rng.uniform(-90.0, 90.0, (20, 2))
        for radius_m in (8.0, 13.0, 40.0)
    ]
    shares = []
    # Several arrays for one place: the views are more.
    monkeypatch.setattr(_perception, "VIEWS_AT_ONCE", 3)
    for few in (10**9, 0):
        monkeypatch.setattr(_perception, "FEW_PAIRS", few)
        shares.append([perception.unseen_share(*disc, 1.3) for disc in discs])

    assert shares[0] == shares[1]
    assert len(set(shares[0])) > 10


def test_a_disc_is_checked_on_a_grid_of_8_m() -> None:
    """By hand: from -radius in steps of 8 m; the corners are beyond the radius."""
    assert [len(_perception._disc(radius_m)) for radius_m in (12.0, 13.0)] == [4, 8]
    assert _perception._disc(8.0) == [(0.0, -8.0), (-8.0, 0.0), (0.0, 0.0), (8.0, 0.0), (0.0, 8.0)]


def test_people_who_are_no_longer_there_are_forgotten() -> None:
    """Twenty frames of a place without the person who stood there end the belief; others do not."""
    perception = perception_over((0.0, 0.0))
    perception.tracks.take(
        0.5, [sight(0.5, 0.0, 35.0), sight(0.5, 0.0, -40.0), sight(0.5, 10.0, 45.0, "tree")]
    )
    for track in perception.tracks:
        track.frames = 5  # long believed in
    history = perception._poses
    for frame in range(20):
        assert len(perception.tracks) == 3
        time_s = 1.0 + frame * 0.2
        history.place(time_s, 0.0, 0.0, 60.0, (0.0, 0.0, 0.0))
        history.turn(time_s, 0.0, 0.0, 0.0)
        perception.see(Detection2DArray(Header(Time.of(round(time_s * 1e9)))))
    assert [(track.label, track.north_m) for track in perception.tracks] == [
        ("civilian", -40.0),
        ("tree", 45.0),
    ]


def test_frames_that_cannot_be_placed_are_counted() -> None:
    """Before the camera is known, or at a moment without a pose, a frame is passed over."""
    perception = ObjectPerception(PoseHistory(), "auto")
    assert not perception.see(Detection2DArray())
    assert (perception.frames, perception.unplaced) == (0, 1)


@pytest.mark.parametrize(
    ("setting", "parent", "level"),
    [
        ("auto", "base_level", True),
        ("auto", "base_link", False),
        ("level", "base_link", True),
        ("body", "base_level", False),
    ],
)
def test_the_mount_is_what_the_transform_says_unless_set(setting: str, parent: str, level: bool) -> None:
    """A parent frame that keeps level makes a level camera; the option `mount` overrules it."""
    perception = ObjectPerception(PoseHistory(), setting)
    perception.take_info(camera_info())
    perception.take_mount(TFMessage())
    assert perception.camera is None
    perception.take_mount(mount(f"{NAME}/{parent}"))
    assert perception.camera is not None
    assert perception.camera.level is level


def test_worse_scores_than_usual_are_noticed_and_good_ones_again() -> None:
    """A fall of the best scores is noticed within its window, and so is their return; few scores say nothing."""
    quality, states = DetectionQuality(), {}
    for tick in range(600):
        time_s = tick * 0.2
        factor = 0.8 if 40.0 <= time_s < 80.0 else 1.0
        quality.take(time_s, [factor * score for score in (0.99, 0.97, 0.6)])
        states[round(time_s, 1)] = quality.degraded
    assert not any(state for time_s, state in states.items() if time_s < 40.0)
    assert all(state for time_s, state in states.items() if 45.0 < time_s < 80.0)
    assert not any(state for time_s, state in states.items() if time_s > 85.0)
    for tick in range(600, 700):
        quality.take(tick * 0.2, [0.3] if tick % 5 == 0 else [])
    assert not quality.degraded


def frame(second: float, *names: str) -> Detection2DArray:
    """A frame with objects of these ids."""
    header = Header(stamp=Time.of(round(second * 1e9)))
    return Detection2DArray(header, tuple(Detection2D(header, (), BoundingBox2D(), name) for name in names))


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.8, 1.0])
def test_the_share_of_objects_is_kept_over_time(share: float) -> None:
    """Over many objects and moments the share is the stated one; what is kept is unchanged and in its order."""
    names = [f"t{number}" for number in range(40)]
    kept = [kept_detections(frame(3.0 * k, *names), share).detections for k in range(200)]
    assert sum(map(len, kept)) / 8000 == pytest.approx(share, abs=0.02 if 0.0 < share < 1.0 else 0.0)
    for k, detections in enumerate(kept):
        everything = frame(3.0 * k, *names).detections
        assert list(detections) == [detection for detection in everything if detection in detections]


def test_an_object_stays_or_is_lost_for_three_seconds() -> None:
    """Within a window all frames agree; over windows each object comes and goes."""
    seen = dict[int, set[frozenset[str]]]()
    for tenth in range(900):
        ids = {detection.id for detection in kept_detections(frame(tenth / 10, "t1", "t2"), 0.5).detections}
        seen.setdefault(tenth // 30, set()).add(frozenset(ids))
    assert all(len(views) == 1 for views in seen.values())
    for name in ("t1", "t2"):
        assert {name in next(iter(views)) for views in seen.values()} == {True, False}
