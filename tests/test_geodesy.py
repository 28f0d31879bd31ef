"""Differences of longitudes and metres of degrees, against a geodesy library on random places."""

from __future__ import annotations

import math

import numpy as np
import pymap3d
import pytest

from bench.geodesy import metres_of_degree, wrapped

ROUNDS = 2000


def test_a_difference_of_longitudes_is_the_short_way_round() -> None:
    """Against the angle between two directions in the plane, which knows no date line."""
    random = np.random.default_rng(3)
    for one, other in random.uniform(-180.0, 180.0, (ROUNDS, 2)):
        turn = math.radians(one) - math.radians(other)
        expected = math.degrees(math.atan2(math.sin(turn), math.cos(turn)))
        assert wrapped(one - other) == pytest.approx(expected, abs=1e-9)
        assert math.degrees(wrapped(turn, math.pi)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "expected"), [(180.0, 180.0), (-180.0, -180.0), (180.5, -179.5), (-180.5, 179.5), (360.0, 0.0)]
)
def test_both_sides_of_half_a_turn(angle: float, expected: float) -> None:
    assert wrapped(angle) == expected


def test_what_is_within_half_a_turn_keeps_its_bits() -> None:
    random = np.random.default_rng(4)
    for angle in random.uniform(-180.0, 180.0, ROUNDS):
        assert wrapped(angle) == angle


def test_metres_from_an_origin_agree_with_the_library_everywhere() -> None:
    """Points up to 300 m away, origins up to 85 degrees north and south and around the date line."""
    random = np.random.default_rng(5)
    for _ in range(ROUNDS):
        latitude = random.uniform(-85.0, 85.0)
        longitude = random.choice([random.uniform(-180.0, 180.0), 180.0, -180.0, 179.9999, -179.9999, 0.0])
        altitude = random.uniform(-400.0, 5000.0)
        east, north = random.uniform(-300.0, 300.0, 2)
        there_latitude, there_longitude, there_altitude = pymap3d.enu2geodetic(
            east, north, 0.0, latitude, longitude, altitude
        )
        assert there_altitude == pytest.approx(altitude, abs=0.02)
        east_m, north_m = metres_of_degree(latitude, altitude)
        flat = (
            wrapped(float(there_longitude) - longitude) * east_m,
            (float(there_latitude) - latitude) * north_m,
        )
        # The parallels' bend and the meridians' convergence, which a flat map leaves out.
        bend = 300.0**2 * abs(math.tan(math.radians(latitude))) / 6356752.0
        assert math.dist(flat, (east, north)) < 0.005 + 1.2 * bend
