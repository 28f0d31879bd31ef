"""The pinhole camera, compared with geometry worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scene_simspecs import hovering
from scipy.spatial.transform import Rotation

from bench.contracts import START, CastMember
from bench.simspec import ActorGroup, Camera, Distortion, Role
from bench.simulation import PinholeCamera
from bench.simulation._camera_messages import CameraMessages
from bench.simulation._visibility import Bodies, sightings

FOCAL_PX = 640.0 / math.tan(math.radians(35.0))


def camera(tilt_deg: float, stabilized: bool = True, gimbal: bool = False) -> PinholeCamera:
    return PinholeCamera.of(Camera(tilt_deg=tilt_deg, stabilized=stabilized, gimbal=gimbal))


@pytest.mark.parametrize(
    ("tilt_deg", "height_m", "point", "pixel"),
    [
        (90.0, 60.0, (5, 7, 0), (640.0, 360.0)),  # below
        (90.0, 60.0, (5, 17, 0), (640.0, 360.0 - FOCAL_PX * 10 / 60)),  # ahead of that
        (90.0, 60.0, (15, 7, 0), (640.0 + FOCAL_PX * 10 / 60, 360.0)),  # right of that
        # 35 degrees to the right of a camera that sees 70.
        (0.0, 2.0, (5 + 10 * math.tan(math.radians(35.0)), 17, 2), (1280.0, 360.0)),
        (0.0, 2.0, (5, -3, 2), (math.nan, math.nan)),  # behind: not mirrored into the image
    ],
)
def test_a_point_is_where_it_is_worked_out_to_be(
    tilt_deg: float, height_m: float, point: tuple[float, ...], pixel: tuple[float, float]
) -> None:
    projected = camera(tilt_deg).project(np.array(point, float), hovering(5, 7, height_m))
    assert projected == pytest.approx(pixel, nan_ok=True)


@pytest.mark.parametrize("tilt_deg", [10.0, 45.0, 60.0, 85.0])
@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, math.pi, 5.0])
def test_the_optical_axis_meets_the_ground_at_height_over_tan_tilt(tilt_deg: float, yaw_rad: float) -> None:
    ahead_m = 40.0 / math.tan(math.radians(tilt_deg))
    point = np.array([3.0 + ahead_m * math.sin(yaw_rad), -4.0 + ahead_m * math.cos(yaw_rad), 0.0])

    assert camera(tilt_deg).project(point, hovering(3, -4, 40, yaw_rad)) == pytest.approx([640.0, 360.0])


def test_a_fixed_camera_turns_with_the_body_and_a_stabilized_one_does_not() -> None:
    """Pitching up by d reduces the tilt by d. Banking right by d swings a nadir camera left, so the point below moves right."""
    point, pitched = np.array([2.0, 30.0, 0.0]), hovering(0, 0, 40, pitch_rad=math.radians(10))
    level = pytest.approx(camera(35.0).project(point, hovering(0, 0, 40)))
    assert camera(45.0, stabilized=False).project(point, pitched) == level
    assert camera(35.0).project(point, hovering(0, 0, 40, roll_rad=0.3, pitch_rad=-0.2)) == level
    banked = camera(90.0, stabilized=False).project(np.zeros(3), hovering(0, 0, 40, roll_rad=0.1))
    assert banked == pytest.approx([640.0 + FOCAL_PX * math.tan(0.1), 360.0])


def test_camera_axes_are_a_right_handed_rotation() -> None:
    """The rows of axes_enu are orthonormal, with right x down = forward, at an arbitrary attitude."""
    axes = camera(30.0, stabilized=False).axes_enu(hovering(0, 0, 0, 2.0, 0.7, -0.4))

    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize("tilt_deg", [0.0, 60.0, 90.0])
def test_the_mount_quaternion_equals_the_rotation_of_the_projection(tilt_deg: float) -> None:
    """When the vehicle faces east, base_link is ENU: columns of the matrix are the camera's axes."""
    pinhole = camera(tilt_deg)
    axes = pinhole.axes_enu(hovering(0, 0, 10, math.pi / 2))
    assert axes == pytest.approx(Rotation.from_quat(pinhole.mount_quaternion()).as_matrix().T, abs=1e-12)


@pytest.mark.parametrize(("pan_rad", "tilt_rad"), [(0.0, 0.3), (0.7, 1.2), (-2.5, 0.0), (3.1, -0.4)])
def test_a_gimbal_turns_the_projection_and_the_mount_quaternion_alike(
    pan_rad: float, tilt_rad: float
) -> None:
    """Pan adds to the heading, tilt replaces the SimSpec's; /tf has the rotation that projects."""
    pinhole, plain = camera(60.0, gimbal=True), hovering(0, 0, 10, math.pi / 2)
    turned = replace(plain, camera_pan_rad=pan_rad, camera_tilt_rad=tilt_rad)
    mount = Rotation.from_quat(pinhole.mount_quaternion(pan_rad, tilt_rad)).as_matrix()
    axes = pinhole.axes_enu(turned)
    assert axes == pytest.approx(mount.T, abs=1e-12)
    # A fixed camera beside it stays where it is.
    assert camera(60.0).axes_enu(turned) == pytest.approx(camera(60.0).axes_enu(plain), abs=1e-12)
    same = camera(0.0, gimbal=True).axes_enu(
        replace(hovering(0, 0, 10, math.pi / 2 + pan_rad), camera_pan_rad=0.0, camera_tilt_rad=tilt_rad)
    )
    assert axes == pytest.approx(same, abs=1e-12)


def test_camera_info_holds_the_intrinsics_of_the_projection() -> None:
    pinhole = camera(90.0)
    info = CameraMessages(pinhole, "", "").camera_info(START)
    u, v, w = np.array(info.k).reshape(3, 3) @ np.array([3.0, -2.0, 50.0])
    projected = pinhole.project(np.array([3.0, 2.0, 0.0]), hovering(0, 0, 50))
    assert (u / w, v / w) == pytest.approx(tuple(projected))
    assert (info.width, info.height, len(info.p)) == (1280, 720, 12)


@pytest.mark.parametrize(
    "distortion",
    [
        Distortion(k1=-0.25, k2=0.07, p1=0.001, p2=-0.0008, k3=-0.006),
        Distortion(k1=0.12, k2=0.02, p1=-0.001, k3=0.003),
    ],
)
def test_sightings_through_a_lens_are_those_of_opencv(distortion: Distortion) -> None:
    """Boxes of random cuboids hold the edges as cv2.projectPoints bends them, clipped to the picture."""
    random = np.random.default_rng(5)
    settings = Camera(horizontal_fov_deg=85.0, tilt_deg=55.0, distortion=distortion)
    pinhole, state = PinholeCamera.of(settings), hovering(2.0, -3.0, 22.0, 0.6)
    lens, axes = pinhole.lens, pinhole.axes_enu(state)
    matrix = np.array(((lens.fx, 0.0, lens.cx), (0.0, lens.fy, lens.cy), (0.0, 0.0, 1.0)))
    edges = np.array([p for p in np.ndindex(21, 21, 21) if sum(c in (0, 20) for c in p) >= 2]) / 10.0 - 1.0
    members = tuple(
        CastMember.of(f"a-{number}", ActorGroup(id="g", asset=asset, role=Role.CLUTTER, count=1))
        for number, asset in enumerate(("bus", "civilian-car", "crate", "van") * 12)
    )
    bodies = Bodies.of(members)
    places = np.concatenate((random.uniform(-20.0, 40.0, (len(members), 2)), np.zeros((48, 1))), axis=1)
    headings = random.uniform(0.0, 6.28, len(members))
    seen = sightings(pinhole, state, bodies, places, headings)
    bent = 0
    for sighting in seen:
        sine, cosine = math.sin(headings[sighting.actor]), math.cos(headings[sighting.actor])
        turn = np.array(((sine, cosine, 0.0), (-cosine, sine, 0.0), (0.0, 0.0, 1.0)))
        half = bodies.half_m[sighting.actor]
        points = (edges * half) @ turn + places[sighting.actor] + (0.0, 0.0, half[2])
        optical = (points - state.position_enu_m) @ axes.T
        # cv2 folds what lies beyond the lens's own field of view back into the picture.
        if (np.abs(optical[:, :2]) > 0.9 * optical[:, 2:]).any():
            continue
        pixels, _ = cv2.projectPoints(optical, np.zeros(3), np.zeros(3), matrix, np.array(lens.distortion))
        left, top = pixels[:, 0].min(axis=0).clip(0.0, (1280.0, 720.0))
        right, bottom = pixels[:, 0].max(axis=0).clip(0.0, (1280.0, 720.0))
        assert sighting.box == pytest.approx((left, top, right, bottom), abs=1.5)
        bent += 1
    assert bent >= 8


def test_what_is_far_outside_stays_outside_of_a_distorted_picture() -> None:
    """The model of a barrel lens folds over beyond the picture; a point there must not come back into it."""
    pinhole = PinholeCamera.of(Camera(horizontal_fov_deg=80.0, distortion=Distortion(k1=-0.28, k2=0.06)))
    rays = np.stack((np.linspace(1.4, 60.0, 400), np.linspace(-0.8, 25.0, 400)), axis=-1)
    border = pinhole.lens.pixels(pinhole.lens.border_rays())

    assert (pinhole.lens.pixels(rays)[:, 0] > pinhole.lens.width_px).all()
    assert border[:, 0].max() == pytest.approx(1280.0, abs=1e-3)
    assert border[:, 1].min() == pytest.approx(0.0, abs=1e-3)
