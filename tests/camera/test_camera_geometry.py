"""Pictures, masks and depth agree with geometry: with OpenCV's own projection, with ray casting, and by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from camera_stages import Placement, cast_rays, lens, pose, stage
from gl_renderer import needs_gl, open_moderngl_renderer
from scipy.ndimage import binary_erosion

from bench.arrays import Floats
from bench.camera import Conditions, actors_in, open_opencv_renderer, pose_of
from bench.clock import START
from bench.contracts import CameraPose, Lens, OpenRenderer, VehicleState
from bench.errors import SetupError
from bench.simspec import Camera
from bench.simulation import PinholeCamera

Distortion = tuple[float, float, float, float, float]
BARREL: Distortion = (-0.21, 0.06, 0.0012, -0.0009, -0.004)
PINCUSHION: Distortion = (0.11, 0.03, -0.001, 0.0015, 0.002)
each_lens = pytest.mark.parametrize("distortion", [(0.0,) * 5, BARREL, PINCUSHION])


def by_opencv(camera: Lens, view: CameraPose, points_enu_m: Floats) -> Floats:
    """(n, 2) pixels of world points by cv2.projectPoints, moved from its pixel centres to corners."""
    matrix = np.array(((camera.fx, 0, camera.cx - 0.5), (0, camera.fy, camera.cy - 0.5), (0, 0, 1.0)))
    turn, _ = cv2.Rodrigues(view.axes_enu)
    shift = -view.axes_enu @ view.position_enu_m
    pixels, _ = cv2.projectPoints(points_enu_m, turn, shift, matrix, np.array(camera.distortion))
    return np.asarray(pixels[:, 0] + 0.5, np.float64)


def random_pose(random: np.random.Generator) -> CameraPose:
    return pose(
        random.uniform((-20, -20, 8), (20, 20, 60)).tolist(),
        float(random.uniform(0, 360)),
        float(random.uniform(20, 90)),
        float(random.uniform(-25, 25)),
    )


@each_lens
def test_points_project_as_opencv_projects_them(distortion: Distortion) -> None:
    random = np.random.default_rng(1)
    camera = replace(lens(), distortion=distortion)
    for _ in range(20):
        view = random_pose(random)
        optical = random.uniform((-0.6, -0.5, 1), (0.6, 0.5, 1), (50, 3)) * random.uniform(1, 80, (50, 1))
        points = optical @ view.axes_enu + view.position_enu_m

        assert camera.project(view.to_optical(points)) == pytest.approx(
            by_opencv(camera, view, points), abs=1e-6
        )


@each_lens
def test_undistortion_is_the_inverse_of_distortion(distortion: Distortion) -> None:
    camera = replace(lens(), distortion=distortion)
    rays = np.random.default_rng(2).uniform(-0.5, 0.5, (200, 2))

    assert camera.undistort(camera.distort(rays)) == pytest.approx(rays, abs=1e-6)


def test_a_distortion_that_folds_over_is_refused() -> None:
    camera = replace(lens(focal_px=120.0), distortion=(-0.9, 0.0, 0.0, 0.0, 0.0))
    scene, _, _ = stage([], camera=camera)
    with pytest.raises(SetupError, match=r"camera test: distortion.*folds over"):
        open_opencv_renderer(scene)


def test_axes_are_those_of_the_session_camera() -> None:
    """The pose of a vehicle with the pinhole camera's axes projects as the pinhole camera does."""
    state = VehicleState(START, (3.0, -4.0, 50.0), (5.0, 1.0, 0.0), 0.2, -0.1, 1.1, (0.1, 0.3, -0.2))
    pinhole = PinholeCamera.of(Camera(stabilized=False))
    view = pose_of(state, pinhole.axes_enu(state))
    camera = pinhole.lens
    points = np.random.default_rng(3).uniform((-30, -30, 0), (30, 30, 5), (40, 3))
    ahead = view.to_optical(points)[:, 2] > 0

    assert ahead.sum() > 10
    assert camera.project(view.to_optical(points))[ahead] == pytest.approx(
        pinhole.project(points, state)[ahead]
    )


@each_lens
def test_a_box_of_pixels_is_the_projection_of_the_actor(distortion: Distortion) -> None:
    """On random poses, the box around a crate's or a car's mask is that of its corners by OpenCV, to a pixel."""
    random = np.random.default_rng(4)
    camera = replace(lens(), distortion=distortion)
    checked = 0
    for trial in range(9):
        view = random_pose(random)
        ahead = view.axes_enu[2] / max(0.2, -view.axes_enu[2, 2]) * view.position_enu_m[2]
        east, north = (view.position_enu_m + ahead)[:2] + random.uniform(-4, 4, 2)
        heading = float(random.uniform(0, 360))
        asset = ("crate", "civilian-car")[trial % 2]
        scene, positions, headings = stage([(asset, east, north, heading)], camera=camera)
        sine, cosine = math.sin(headings[0]), math.cos(headings[0])
        axes = np.array(((sine, cosine, 0), (-cosine, sine, 0), (0, 0, 1)))
        corners = scene.looks[0].geometry.corners_m.reshape(-1, 3) @ axes + positions[0]
        pixels = by_opencv(camera, view, corners)
        if not ((pixels > 3) & (pixels < (camera.width_px - 3, camera.height_px - 3))).all():
            continue
        checked += 1
        (actor,) = actors_in(open_opencv_renderer(scene).render(view, positions, headings))

        assert actor.actor == 0
        assert actor.visible == 1.0
        assert actor.box == pytest.approx((*pixels.min(axis=0), *pixels.max(axis=0)), abs=1.3)
    assert checked >= 4


def test_a_picture_shows_the_actor_where_the_mask_has_it() -> None:
    """Pixels inside the mask differ from the empty picture, pixels away from actor and shadow do not."""
    camera, view = lens(), pose((0, 0, 30), 0.0, 90.0)
    scene, positions, headings = stage([("van", 3.0, -2.0, 30.0)], camera=camera)
    picture = open_opencv_renderer(scene).render(view, positions, headings)
    empty = open_opencv_renderer(replace(scene, looks=())).render(view, positions[:0], headings[:0])
    change = np.abs(picture.bgr.astype(int) - empty.bgr).max(axis=-1)
    inside = binary_erosion(picture.instances() == 1, iterations=2)
    # The sun is in the south at 60 degrees: the shadow falls north and reaches half as far as the van is high.
    box = actors_in(picture)[0].box
    around = np.ones(change.shape, bool)
    reach = math.ceil(camera.fy / (30.0 - 2.5) * 2.5) + 3
    around[box[1] - reach : box[3] + reach, box[0] - 3 : box[2] + 3] = False

    assert inside.sum() > 200
    assert (change[inside] > 8).mean() > 0.98
    assert change[around].max() <= 1


VILLAGE: list[Placement] = [
    ("house", 0.0, 14.0, 20.0),
    ("apartment-block", -22.0, 26.0, 100.0),
    ("civilian-car", 4.0, 3.0, 70.0),
    ("radar-vehicle", -9.0, 0.0, 10.0),
    ("tree", 9.0, 6.0, 0.0),
    ("bus", 12.0, -8.0, 160.0),
    ("man", -1.0, 6.5, 0.0),
    ("soldier", 1.0, -4.0, 45.0),
    ("crate-stack", -4.0, -9.0, 30.0),
    ("cow", 8.0, -2.0, 200.0),
    ("tent", -13.0, -11.0, 120.0),
    ("conifer", 16.0, 12.0, 0.0),
]


@pytest.mark.parametrize(
    ("place", "yaw_deg", "tilt_deg", "roll_deg"),
    [
        ((-3.0, -40.0, 20.0), 4.0, 28.0, 0.0),
        ((35.0, 25.0, 14.0), 240.0, 22.0, 12.0),
        ((2.0, -16.0, 3.0), 350.0, 5.0, -8.0),
        ((-30.0, 5.0, 30.0), 95.0, 45.0, 0.0),
        ((1.0, 1.0, 40.0), 30.0, 90.0, 0.0),
    ],
)
def test_masks_and_depths_are_those_of_ray_casting(
    place: tuple[float, float, float], yaw_deg: float, tilt_deg: float, roll_deg: float
) -> None:
    """Who hides whom is right: beside edges, nearly every pixel shows the actor that its ray meets first."""
    view = pose(place, yaw_deg, tilt_deg, roll_deg)
    scene, positions, headings = stage(VILLAGE, camera=lens(200, 150, 190.0))
    picture = open_opencv_renderer(scene).render(view, positions, headings)
    labels, depths = cast_rays(scene, view, positions, headings)
    # A pixel on an outline may count for either side: polygons are filled up to and including their edge.
    edges = np.zeros(labels.shape, bool)
    for axis in (0, 1):
        for step in (-1, 1):
            edges |= labels != np.roll(labels, step, axis)
    inner = ~edges
    same = picture.instances() == labels
    close = inner & same & np.isfinite(depths) & (depths < 500.0)
    wrong_m = np.abs(picture.depth_m()[close] - depths[close])

    assert len(np.unique(labels)) >= 8
    assert same[inner].mean() > 0.999
    # Between two solids of one actor an edge lies inside the mask, so a few depths are those of the neighbour.
    assert (wrong_m < 0.02 * depths[close]).mean() > 0.97
    sky = np.isinf(depths) & (labels == 0) & (picture.instances() == 0)
    assert np.isinf(picture.depth_m()[sky]).all()


def test_a_long_wall_hides_only_who_is_behind_it() -> None:
    """The middle of a block is nearer than a person beside its end, who stands before its front all the same."""
    block: Placement = ("apartment-block", 0.0, 20.0, 90.0)
    view = pose((-30.0, 0.0, 6.0), 45.0, 4.0)
    for north, visible in ((12.6, True), (27.5, False)):
        scene, positions, headings = stage([block, ("man", 6.0, north, 0.0)])
        picture = open_opencv_renderer(scene).render(view, positions, headings)
        actors = {actor.actor: actor for actor in actors_in(picture)}
        assert (1 in actors) is visible
    assert actors[0].visible == 1.0


# How far a share may be off: `opencv` counts pixels on an outline for either side.
RENDERERS = [
    pytest.param(open_opencv_renderer, 0.03, id="opencv"),
    pytest.param(open_moderngl_renderer, 0.01, id="moderngl", marks=needs_gl),
]


@pytest.mark.parametrize(("open_renderer", "off"), RENDERERS)
def test_the_visible_share_is_that_of_the_silhouette(open_renderer: OpenRenderer, off: float) -> None:
    """Of two equal crates one behind the other, the farther shows the share that ray casting shows."""
    view = pose((0.0, -20.0, 6.0), 0.0, 15.0)
    # The third one is behind the camera.
    crates: list[Placement] = [("crate", 0.8, 3.0, 0.0), ("crate", 0.0, 0.0, 0.0), ("crate", 0.0, -40.0, 0.0)]
    scene, positions, headings = stage(crates)
    alone, alone_at, alone_heading = stage(crates[:1])
    both, _ = cast_rays(scene, view, positions, headings)
    single, _ = cast_rays(alone, view, alone_at, alone_heading)
    picture = open_renderer(scene).render(view, positions, headings)
    farther, nearer = actors_in(picture)

    assert picture.silhouette_px(0) == pytest.approx((single == 1).sum(), rel=5 * off)
    assert picture.silhouette_px(1) == (picture.instances() == 2).sum()
    assert picture.silhouette_px(2) == 0
    assert farther.visible == pytest.approx((both == 1).sum() / (single == 1).sum(), abs=off)
    assert 0.1 < farther.visible < 0.9
    assert nearer.visible == 1.0


def test_depth_on_the_ground_is_that_of_the_plane() -> None:
    view = pose((0, 0, 50), 20.0, 35.0, 10.0)
    scene, positions, headings = stage([])
    depth = open_opencv_renderer(scene).render(view, positions, headings).depth_m()
    _, expected = cast_rays(scene, view, positions, headings)
    below = np.isfinite(expected) & (expected < 1e4)

    assert below.mean() > 0.5
    assert np.allclose(depth[below], expected[below], rtol=1e-3, atol=0.0)


@pytest.mark.parametrize("east_m", [0.0, 40_000.0])
@pytest.mark.parametrize(("open_renderer", "_"), RENDERERS)
def test_the_ground_texture_lies_where_the_world_has_it(
    open_renderer: OpenRenderer, _: float, east_m: float
) -> None:
    """A white square of the texture appears where its corners project, also far from the world's origin."""
    camera, view = lens(), pose((east_m + 2.0, -6.0, 40.0), 25.0, 70.0, 5.0)
    scene, positions, headings = stage([], camera=camera)
    texture = np.zeros((400, 400, 3), np.uint8)
    texture[190:210, 210:220] = 255  # 0.1 m texels from (-20, 20): east 1 to 2, north -1 to 1
    ground = replace(scene.ground, texture=texture, texel_m=0.1, west_m=east_m - 20.0, north_m=20.0)
    picture = open_renderer(replace(scene, ground=ground)).render(view, positions, headings)
    rows, columns = np.nonzero(picture.bgr.max(axis=-1) > 100)
    corners = np.array(((1, -1, 0), (2, -1, 0), (2, 1, 0), (1, 1, 0)), float)
    corners[:, 0] += east_m
    pixels = by_opencv(camera, view, corners)

    assert len(rows) > 40
    assert columns.mean() + 0.5 == pytest.approx(pixels[:, 0].mean(), abs=0.3)
    assert rows.mean() + 0.5 == pytest.approx(pixels[:, 1].mean(), abs=0.3)
    assert columns.max() - columns.min() == pytest.approx(np.ptp(pixels[:, 0]), abs=2.5)


def test_the_shadow_falls_away_from_the_sun_as_far_as_it_must() -> None:
    """Under a sun at 45 degrees in the south-west, a mast's shadow ends its height away in the north-east."""
    sun = Conditions(math.radians(45.0), math.radians(225.0))
    camera, view = lens(), pose((0, 0, 40), 0.0, 90.0)
    scene, positions, headings = stage([("man", 0.0, 0.0, 0.0)], sun, camera)
    picture = open_opencv_renderer(scene).render(view, positions, headings)
    empty = open_opencv_renderer(replace(scene, looks=())).render(view, positions[:0], headings[:0])
    dark = (empty.bgr.astype(int) - picture.bgr).min(axis=-1) > 25
    dark &= picture.instances() == 0
    rows, columns = np.nonzero(dark)
    height_m = float(scene.looks[0].geometry.corners_m[..., 2].max())
    tip = camera.project(view.to_optical(np.array((height_m, height_m, 0.0)) / math.sqrt(2.0)))

    assert columns.max() == pytest.approx(tip[0], abs=2.5)
    assert rows.min() == pytest.approx(tip[1], abs=2.5)
    assert columns.min() > camera.cx - 5


def test_a_picture_is_the_same_whatever_was_drawn_before() -> None:
    """Two kinds of actors, headings and views in turn: orders of faces and shadows that are kept belong to each."""
    scene, positions, headings = stage([("crate", 0.0, 0.0, 0.0), ("civilian-car", 6.0, 4.0, 90.0)])
    used = open_opencv_renderer(scene)
    for turn_rad in (0.0, 1.0, 2.5):
        for view in (pose((0.0, -20.0, 12.0), 0.0, 30.0), pose((25.0, 5.0, 9.0), -90.0, 20.0)):
            shown, fresh = (
                renderer.render(view, positions, headings + turn_rad).bgr
                for renderer in (used, open_opencv_renderer(scene))
            )
            assert np.array_equal(shown, fresh)
