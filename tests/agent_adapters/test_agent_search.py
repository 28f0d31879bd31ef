"""Paths of the reference agent: legs, rings, and walking along them."""

from __future__ import annotations

import math

import pytest

from agent_adapters.reference._search import Walk, bearing_rad, lawnmower, length_m, ring


def test_legs_by_hand() -> None:
    """A circle of 60 m at (100, 0) entered eastwards with legs at most 70 m apart: two legs, 60 m apart, out and back."""
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
    """Every place of the circle lies within half the spacing of a leg's line, on the stretch that the camera sees along it."""
    near_m, middle_m = 9.0, 35.0
    path = lawnmower((5.0, -7.0), radius_m, spacing_m, math.radians(heading_deg), near_m, middle_m)
    legs = list(zip(path[::2], path[1::2], strict=True))
    for step in range(0, 360, 15):
        for share in (0.0, 0.5, 0.98):
            east = 5.0 + share * radius_m * math.sin(math.radians(step))
            north = -7.0 + share * radius_m * math.cos(math.radians(step))
            assert any(_seen(a, b, east, north, spacing_m / 2, near_m, middle_m) for a, b in legs)


def _seen(
    a: tuple[float, float], b: tuple[float, float], east: float, north: float, aside: float, near: float, middle: float
) -> bool:
    length = math.dist(a, b)
    forward = ((b[0] - a[0]) / length, (b[1] - a[1]) / length)
    along = (east - a[0]) * forward[0] + (north - a[1]) * forward[1]
    across = (east - a[0]) * forward[1] - (north - a[1]) * forward[0]
    return abs(across) <= aside + 1e-6 and near - 1e-6 <= along <= length + middle + 1e-6


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


def test_walk_aims_ahead_and_ends() -> None:
    """The aim lies a stretch ahead along the path, round the corner too, and progress never goes back."""
    walk = Walk([(0.0, 0.0), (0.0, 50.0), (50.0, 50.0)])
    assert walk.aim(20.0) == (0.0, 20.0)
    walk.go((3.0, 40.0))
    assert walk.left_m == pytest.approx(60.0)
    assert walk.aim(20.0) == pytest.approx((10.0, 50.0))
    walk.go((0.0, 30.0))
    assert walk.left_m == pytest.approx(60.0)
    walk.go((0.0, 51.0))
    walk.go((49.0, 50.0))
    assert walk.left_m == pytest.approx(1.0)
    assert walk.aim(20.0) == (50.0, 50.0)


def test_walk_passes_over_a_stretch_of_no_length() -> None:
    """Two equal points in a row, as when the way begins where the vehicle stands, stop nobody."""
    walk = Walk([(0.0, 0.0), (0.0, 0.0), (0.0, 30.0)])
    walk.go((0.0, 10.0))
    walk.go((0.0, 12.0))
    assert walk.left_m == pytest.approx(18.0)
    assert walk.aim(5.0) == pytest.approx((0.0, 17.0))
