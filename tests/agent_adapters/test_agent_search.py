"""Paths of the reference agent: legs, rings, and walking along them."""

from __future__ import annotations

import math

import pytest

from agent_adapters.reference.flight._paths import Place, Walk, bearing_rad, lawnmower, length_m, ring


def test_legs_by_hand() -> None:
    """A circle of 60 m at (100, 0) entered eastwards, legs at most 70 m apart: two legs, out and back."""
    path = lawnmower((100.0, 0.0), 60.0, 70.0, math.pi / 2, 9.0, 35.0)
    assert path == [
        pytest.approx((100 - 60 - 9, 30)),
        pytest.approx((100 + 60 - 35, 30)),
        pytest.approx((100 + 60 + 9, -30)),
        pytest.approx((100 - 60 + 35, -30)),
    ]


@pytest.mark.parametrize("heading_deg", [0, 37, 90, 200, 315])
@pytest.mark.parametrize(("radius_m", "spacing_m"), [(60, 68), (20, 68), (150, 40)])
def test_legs_leave_no_gap(heading_deg: int, radius_m: float, spacing_m: float) -> None:
    """Every place of the circle lies within half the spacing of a leg's line, where the camera sees."""
    near_m, middle_m = 9.0, 35.0
    path = lawnmower((5.0, -7.0), radius_m, spacing_m, math.radians(heading_deg), near_m, middle_m)
    legs = list(zip(path[::2], path[1::2], strict=True))

    def is_covered(a: Place, b: Place, place: Place) -> bool:
        length_m, (east, north) = math.dist(a, b), (place[0] - a[0], place[1] - a[1])
        forward = ((b[0] - a[0]) / length_m, (b[1] - a[1]) / length_m)
        along = east * forward[0] + north * forward[1]
        across = east * forward[1] - north * forward[0]
        return abs(across) <= spacing_m / 2 + 1e-6 and near_m - 1e-6 <= along <= length_m + middle_m + 1e-6

    for step in range(0, 360, 15):
        for share in (0.0, 0.5, 0.98):
            turn = math.radians(step)
            east = 5.0 + share * radius_m * math.sin(turn)
            north = -7.0 + share * radius_m * math.cos(turn)
            assert any(is_covered(a, b, (east, north)) for a, b in legs)


def test_ring_goes_once_round() -> None:
    """A ring keeps its distance, begins and ends in the direction asked, and goes clockwise."""
    path = ring((10.0, 20.0), 35.0, math.radians(90.0))
    assert path[0] == pytest.approx((45.0, 20.0))
    assert path[-1] == pytest.approx(path[0])
    assert all(math.dist(point, (10.0, 20.0)) == pytest.approx(35.0) for point in path)
    assert path[1][1] < 20.0  # clockwise from east is south
    assert length_m(path) == pytest.approx(2 * math.pi * 35.0, rel=0.01)


def test_bearings_are_clockwise_from_north() -> None:
    """East of a place is at +90 degrees."""
    assert math.degrees(bearing_rad((0.0, 0.0), (10.0, 0.0))) == pytest.approx(90.0)
    assert math.degrees(bearing_rad((0.0, 0.0), (-10.0, 10.0))) == pytest.approx(-45.0)


ROUND_A_CORNER = [(0.0, 0.0), (0.0, 50.0), (50.0, 50.0)]


@pytest.mark.parametrize(
    ("path", "moves", "left_m"),
    [
        (ROUND_A_CORNER, [(3.0, 20.0), (3.0, 40.0)], 60.0),
        (ROUND_A_CORNER, [(3.0, 20.0), (3.0, 40.0), (0.0, 30.0)], 60.0),
        (ROUND_A_CORNER, [(3.0, 20.0), (3.0, 40.0), (9.0, 52.0)], 41.0),
        # Two equal points in a row, as where the vehicle stands, stop nobody; nor does a lone point.
        ([(0.0, 0.0), (0.0, 0.0), (0.0, 30.0)], [(0.0, 12.0)], 18.0),
        ([(3.0, 4.0), (3.0, 4.0)], [(0.0, 0.0)], 0.0),
    ],
)
def test_walk_goes_on_and_never_back(path: list[Place], moves: list[Place], left_m: float) -> None:
    """Progress is the nearest point ahead, round a corner too; a step back is none."""
    walk = Walk(path)
    for place in moves:
        walk.go(place, 25.0)
    assert walk.left_m == pytest.approx(left_m)


def test_where_a_walk_leads() -> None:
    walk = Walk(ROUND_A_CORNER)
    walk.go((3.0, 40.0), 100.0)
    assert walk.at(walk.done_m + 20.0) == pytest.approx((10.0, 50.0))
    assert walk.direction(walk.done_m + 20.0) == (1.0, 0.0)
    still = Walk([(3.0, 4.0), (3.0, 4.0)])
    assert still.at(5.0) == (3.0, 4.0)
    assert still.direction(0.0) == (0.0, 0.0)


def test_walk_does_not_stop_at_an_acute_corner() -> None:
    """A vehicle that stands where it was told to aim, round a hairpin, has made progress."""
    walk = Walk([(0.0, 0.0), (0.0, 50.0), (10.0, 0.0)])
    walk.go((0.0, 25.0), 25.0)
    walk.go((0.0, 44.0), 25.0)
    for _ in range(10):
        walk.go(walk.at(walk.done_m + 12.0), 25.0)
    assert walk.left_m < 1.0


def test_walk_looks_no_farther_than_its_window() -> None:
    """A path that comes back past its beginning is still flown in full."""
    walk = Walk([(0.0, 0.0), (0.0, 100.0), (5.0, 100.0), (5.0, 0.0)])
    walk.go((5.0, 1.0), 25.0)
    assert walk.done_m <= 25.0


def test_corners_and_ends_are_taken_slowly() -> None:
    """At 4 m/s, braking with 2.5 m/s2: 20 m before a corner sqrt(16 + 100) m/s; 15 degrees do not count."""
    walk = Walk([(0.0, 0.0), (0.0, 100.0), (100.0, 100.0)])
    walk.go((0.0, 80.0), 100.0)
    assert walk.speed_mps(12.0) == pytest.approx(math.sqrt(116.0))
    walk.go((0.0, 100.0), 100.0)
    assert walk.speed_mps(12.0) == 12.0  # the corner is behind, the end far
    walk.go((99.0, 100.0), 100.0)
    assert walk.speed_mps(12.0) == pytest.approx(math.sqrt(16.0 + 5.0))
    assert Walk(ring((0.0, 0.0), 35.0, 0.0)).speed_mps(8.0) == 8.0
