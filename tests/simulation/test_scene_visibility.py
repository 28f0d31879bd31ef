"""Sightings, compared with boxes that are projected corner by corner and with occlusions arranged by hand."""

from __future__ import annotations

import itertools
import math
import time

import numpy as np
import pytest
from scene_simspecs import Placement, hovering, scene_simspec, square

from bench.contracts import Sighting, VehicleState
from bench.simspec import ASSETS, Camera
from bench.simulation import PinholeCamera, open_plain_scene

LEVEL = Camera(tilt_deg=0.0)
LOW = hovering(0.0, 0.0, 1.5)
# A high and steep view.
ABOVE, STEEP = hovering(0.0, 50.0, 60.0), Camera(tilt_deg=80.0)


def sightings_by_actor(
    placements: list[Placement], state: VehicleState = LOW, camera: Camera = LEVEL
) -> dict[int, Sighting]:
    scene = open_plain_scene(scene_simspec(placements, camera=camera))
    return {sighting.actor: sighting for sighting in scene.observe(state, 0).sightings}


def corner_box(placements: Placement, state: VehicleState, camera: Camera) -> list[float]:
    """Left, top, right, bottom of a cuboid's projected corners, in pixels; NaN with one behind."""
    asset, east, north, heading_deg = placements
    size, heading = ASSETS[asset], math.radians(heading_deg)
    corners = [
        (
            east + a * size.length_m / 2 * math.sin(heading) + b * size.width_m / 2 * math.cos(heading),
            north + a * size.length_m / 2 * math.cos(heading) - b * size.width_m / 2 * math.sin(heading),
            up,
        )
        for a, b, up in itertools.product((-1, 1), (-1, 1), (0.0, size.height_m))
    ]
    pixels = PinholeCamera.of(camera).project(np.array(corners), state)
    return [*pixels.min(axis=0).tolist(), *pixels.max(axis=0).tolist()]


@pytest.mark.parametrize("tilt_deg", [20.0, 60.0, 90.0])
def test_sightings_are_the_projected_boxes_of_exactly_the_actors_in_the_image(tilt_deg: float) -> None:
    """Culling drops no visible actor, and each box bounds the projected corners."""
    rng = np.random.default_rng(5)
    placements: list[Placement] = [
        (
            str(rng.choice(["civilian", "radar-vehicle", "crate"])),
            *rng.uniform(-100, 100, 2).tolist(),
            float(rng.uniform(0, 360)),
        )
        for _ in range(300)
    ]
    camera = Camera(tilt_deg=tilt_deg, stabilized=False)
    compared = 0
    for _ in range(10):
        east, north, yaw, roll, pitch = (rng.uniform(-1, 1, 5) * (80, 80, math.pi, 0.2, 0.2)).tolist()
        state = hovering(east, north, 40.0, yaw, roll, pitch)
        sightings = sightings_by_actor(placements, state, camera)
        for index, placement in enumerate(placements):
            left_px, top_px, right_px, bottom_px = box = corner_box(placement, state, camera)
            if math.isnan(left_px):
                continue
            clipped = np.clip(box, 0.0, [1280, 720, 1280, 720])
            share = (
                (clipped[2] - clipped[0])
                * (clipped[3] - clipped[1])
                / ((right_px - left_px) * (bottom_px - top_px))
            )
            assert (index in sightings) == (share >= 0.05)
            if index in sightings:
                compared += 1
                assert sightings[index].box == pytest.approx(clipped.tolist(), abs=1e-6)
                assert sightings[index].visible == pytest.approx(share)
                assert sightings[index].height_px == pytest.approx(
                    max(right_px - left_px, bottom_px - top_px)
                )
    assert compared > 100


def test_range_is_from_the_camera_to_the_centre_of_the_body() -> None:
    """A civilian 1.75 m tall, standing 60 m straight below, is 59.125 m away."""
    below = sightings_by_actor([("civilian", 0.0, 0.0, 0.0)], hovering(0, 0, 60), Camera(tilt_deg=90.0))
    assert below[0].range_m == pytest.approx(59.125)


def test_actors_outside_the_frustum_or_beyond_two_kilometres_are_not_sighted() -> None:
    placements: list[Placement] = [
        ("house", 0.0, 100.0, 0.0),
        ("house", 0.0, -100.0, 0.0),
        ("house", 100.0, 0.0, 0.0),
        ("house", 0.0, 2100.0, 0.0),
        ("civilian", 20.0, 1990.0, 0.0),
    ]
    assert set(sightings_by_actor(placements)) == {0}


# The car's centre is at the house's edge: about half of its sample points are free.
EDGE_M = 6.0 * 70.0 / 41.0


@pytest.mark.parametrize(
    ("solid", "other", "state", "camera", "visible"),
    [
        (("house", 0.0, 50.0, 90.0), ("soldier", 0.0, 70.0, 0.0), LOW, LEVEL, 0.0),
        (("house", 0.0, 50.0, 90.0), ("soldier", 0.0, 30.0, 0.0), LOW, LEVEL, 1.0),
        (("house", 0.0, 50.0, 90.0), ("soldier", 15.0, 60.0, 0.0), LOW, LEVEL, 1.0),
        (("house", 0.0, 45.5, 90.0), ("civilian-car", EDGE_M, 70.0, 90.0), LOW, LEVEL, 0.5),
        (("house", 0.0, 50.0, 90.0), ("soldier", 0.0, 62.0, 0.0), LOW, LEVEL, 0.0),
        (("house", 0.0, 50.0, 90.0), ("soldier", 0.0, 62.0, 0.0), ABOVE, STEEP, 1.0),
        (("military-truck", 0.0, 20.0, 90.0), ("soldier", 0.0, 40.0, 0.0), LOW, LEVEL, 1.0),
        (("tree", 0.0, 0.0, 0.0), ("soldier", 0.0, 30.0, 0.0), LOW, LEVEL, 0.0),
    ],
    ids=[
        "behind",
        "before",
        "beside",
        "half behind",
        "close behind",
        "over the roof",
        "a truck",
        "in a crown",
    ],
)
def test_solid_assets_hide_what_is_behind_them(
    solid: Placement, other: Placement, state: VehicleState, camera: Camera, visible: float
) -> None:
    """A house or a tree, and no vehicle; what hides others does not hide itself."""
    sightings = sightings_by_actor([solid, other], state, camera)
    found = sightings[1].visible if 1 in sightings else 0.0
    assert found == pytest.approx(visible, abs=0.2 if visible == 0.5 else 1e-6)
    assert 0 not in sightings or sightings[0].visible == pytest.approx(1.0)


def test_actors_inside_a_house_are_never_sighted() -> None:
    placements: list[Placement] = [
        ("house", 0.0, 40.0, 30.0),
        ("civilian", 0.0, 40.0, 0.0),
        ("civilian", 3.0, 42.0, 0.0),
        ("shed", 0.0, 37.0, 30.0),
    ]
    for camera, state in [
        (Camera(tilt_deg=90.0), hovering(0.0, 40.0, 60.0)),
        (Camera(tilt_deg=60.0), hovering(0.0, 15.0, 50.0)),
        (LEVEL, LOW),
        (Camera(tilt_deg=90.0, horizontal_fov_deg=120.0), hovering(2.0, 41.0, 8.0)),
    ]:
        assert set(sightings_by_actor(placements, state, camera)) == {0}


def test_an_empty_world_gives_empty_frames() -> None:
    scene = open_plain_scene(scene_simspec([]))
    assert scene.positions().shape == (0, 3)
    assert scene.observe(LOW, 3).sightings == ()


def test_observing_does_not_change_the_scene() -> None:
    scene = open_plain_scene(scene_simspec([("soldier", 0.0, 40.0, 0.0)], camera=LEVEL))
    first = scene.observe(LOW, 7)

    assert first == scene.observe(LOW, 7)
    assert (first.number, first.camera, first.exposed.ns) == (7, "front", 0)


def test_five_thousand_trees_in_one_image_take_seconds_at_most() -> None:
    """A hostile SimSpec (a wood that fills the frame, each tree hiding others) takes bounded time."""
    rng = np.random.default_rng(1)
    wood: list[Placement] = [("tree", *rng.uniform(-500, 500, 2).tolist(), 0.0) for _ in range(5000)]
    scene = open_plain_scene(scene_simspec(wood, area=square(1000.0), camera=LEVEL))
    began = time.process_time()
    frame = scene.observe(hovering(0, -600, 20), 0)

    assert len(frame.sightings) > 100
    assert time.process_time() - began < 10.0
