"""Who is in the picture, against boxes projected one by one and occlusions arranged by hand."""

from __future__ import annotations

import itertools
import math
import time

import numpy as np
import pytest
from scene_situations import Standing, hovering, situation, square

from bench.contracts import Sighting, VehicleState
from bench.simspec import ASSETS, Camera
from bench.simulation import PinholeCamera, open_plain_scene

LEVEL = Camera(tilt_deg=0.0)
LOW = hovering(0.0, 0.0, 1.5)


def look(standing: list[Standing], state: VehicleState, camera: Camera | None = None) -> dict[int, Sighting]:
    """Sightings by actor."""
    scene = open_plain_scene(situation(standing, camera=camera or Camera()))
    return {one.actor: one for one in scene.observe(state, 0).sightings}


def corner_box(standing: Standing, state: VehicleState, camera: Camera) -> list[float]:
    """Left, top, right, bottom of a cuboid's corners, each projected by itself; NaN when one lies behind the camera."""
    asset, east, north, heading_deg = standing
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
def test_sightings_are_the_projected_boxes_of_all_and_only_those_in_the_picture(tilt_deg: float) -> None:
    """Random bystanders, cars and attitudes: the quick culls lose nobody and the boxes are the corners' own."""
    rng = np.random.default_rng(5)
    standing: list[Standing] = [
        (str(rng.choice(["civilian", "radar-vehicle", "crate"])), *rng.uniform(-100, 100, 2).tolist(), float(rng.uniform(0, 360)))
        for _ in range(300)
    ]
    camera = Camera(tilt_deg=tilt_deg, stabilized=False)
    compared = 0
    for _ in range(10):
        east, north, yaw, roll, pitch = (rng.uniform(-1, 1, 5) * (80, 80, math.pi, 0.2, 0.2)).tolist()
        state = hovering(east, north, 40.0, yaw, roll, pitch)
        seen = look(standing, state, camera)
        for index, one in enumerate(standing):
            left, top, right, bottom = box = corner_box(one, state, camera)
            if math.isnan(left):
                continue
            clipped = np.clip(box, 0.0, [1280, 720, 1280, 720])
            share = (clipped[2] - clipped[0]) * (clipped[3] - clipped[1]) / ((right - left) * (bottom - top))
            assert (index in seen) == (share >= 0.05)
            if index in seen:
                compared += 1
                assert seen[index].box == pytest.approx(clipped.tolist(), abs=1e-6)
                assert seen[index].visible == pytest.approx(share)
                assert seen[index].height_px == pytest.approx(max(right - left, bottom - top))
    assert compared > 100


def test_range_is_from_the_camera_to_the_middle_of_the_body() -> None:
    """A civilian of 1.75 m, 60 m straight below, is 59.125 m away."""
    assert look([("civilian", 0.0, 0.0, 0.0)], hovering(0, 0, 60), Camera(tilt_deg=90.0))[0].range_m == pytest.approx(59.125)


def test_behind_beyond_and_beside_are_not_seen() -> None:
    """Out of the frustum, behind the camera, or past two kilometres is no sighting."""
    standing: list[Standing] = [
        ("house", 0.0, 100.0, 0.0),
        ("house", 0.0, -100.0, 0.0),
        ("house", 100.0, 0.0, 0.0),
        ("house", 0.0, 2100.0, 0.0),
        ("civilian", 20.0, 1990.0, 0.0),
    ]
    assert set(look(standing, LOW, LEVEL)) == {0}


def test_a_house_hides_who_stands_behind_it_and_nobody_else() -> None:
    """Behind: gone; before and beside: whole."""
    standing: list[Standing] = [
        ("house", 0.0, 50.0, 90.0),
        ("soldier", 0.0, 70.0, 0.0),
        ("soldier", 0.0, 30.0, 0.0),
        ("soldier", 15.0, 60.0, 0.0),
    ]
    seen = look(standing, LOW, LEVEL)

    assert set(seen) == {0, 2, 3}
    assert seen[2].visible == seen[3].visible == pytest.approx(1.0)


def test_nobody_inside_a_house_is_seen_from_anywhere() -> None:
    """Neither through the roof nor through a wall; its own roof hides the house from nobody."""
    standing: list[Standing] = [
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
        assert set(look(standing, state, camera)) == {0}


def test_a_car_half_behind_a_house_shows_in_part() -> None:
    """Broadside on, its middle at the house's edge: about half of the sample points are free."""
    edge_m = 6.0 * 70.0 / 41.0
    seen = look([("house", 0.0, 45.5, 90.0), ("civilian-car", edge_m, 70.0, 90.0)], LOW, LEVEL)

    assert 0.3 < seen[1].visible < 0.7


def test_people_and_vehicles_hide_nobody() -> None:
    """Only solid assets hide."""
    seen = look([("military-truck", 0.0, 20.0, 90.0), ("soldier", 0.0, 40.0, 0.0)], LOW, LEVEL)

    assert seen[1].visible == pytest.approx(1.0)


def test_from_above_the_roof_no_longer_hides() -> None:
    """The same soldier behind the same house is whole from a high and steep view."""
    standing: list[Standing] = [("house", 0.0, 50.0, 90.0), ("soldier", 0.0, 62.0, 0.0)]

    assert 1 not in look(standing, hovering(0, 0, 1.5), LEVEL)
    assert look(standing, hovering(0, 50, 60), Camera(tilt_deg=80.0))[1].visible == pytest.approx(1.0)


def test_a_body_does_not_hide_itself() -> None:
    """A lone house is seen whole."""
    assert look([("house", 0.0, 60.0, 20.0)], LOW, LEVEL)[0].visible == pytest.approx(1.0)


def test_a_camera_inside_a_solid_sees_nothing_beyond_it() -> None:
    """In a tree's crown the rest of the world is hidden, and nothing divides by zero."""
    assert 1 not in look([("tree", 0.0, 0.0, 0.0), ("soldier", 0.0, 30.0, 0.0)], LOW, LEVEL)


def test_an_empty_world_gives_empty_frames() -> None:
    """No actors at all is a scene like any other."""
    scene = open_plain_scene(situation([]))

    assert scene.positions().shape == (0, 3)
    assert scene.observe(LOW, 3).sightings == ()


def test_asking_changes_nothing() -> None:
    """Two looks from one place are equal; the frame carries its number, camera and moment."""
    scene = open_plain_scene(situation([("soldier", 0.0, 40.0, 0.0)], camera=LEVEL))
    first = scene.observe(LOW, 7)

    assert first == scene.observe(LOW, 7)
    assert (first.number, first.camera, first.exposed.ns) == (7, "front", 0)


def test_five_thousand_trees_in_one_picture_cost_seconds_at_most() -> None:
    """A hostile SimSpec (a wood that fills the frame, everything hiding everything) stays bounded in time."""
    rng = np.random.default_rng(1)
    wood: list[Standing] = [("tree", *rng.uniform(-500, 500, 2).tolist(), 0.0) for _ in range(5000)]
    scene = open_plain_scene(situation(wood, area=square(1000.0), camera=LEVEL))
    began = time.process_time()
    frame = scene.observe(hovering(0, -600, 20), 0)

    assert len(frame.sightings) > 100
    assert time.process_time() - began < 10.0
