"""Geodesy: from degrees to metres around an origin or around home and back, fast enough for every step.

The two radii of curvature of WGS84 at the origin, the parallel at the point's own latitude, and the
parallel's bend away from the plane's east. Against the rigorous conversion of pymap3d a point 1 km away is
off by less than 2 mm, 5 km away by less than 6 cm. Height stays height: the ground of the bench is flat and
follows the ellipsoid, so `up` is height above the origin's ground everywhere.
"""

from __future__ import annotations

import math

from bench.geodesy import wrapped

# WGS84 semi-major axis, m.
_A = 6378137.0
# First eccentricity squared.
_E2 = 6.69437999014e-3


class TangentPlane:
    """East and north metres around one origin; `latitude_deg`, `longitude_deg` on WGS84."""

    def __init__(self, latitude_deg: float, longitude_deg: float) -> None:
        self.latitude_rad = math.radians(latitude_deg)
        self.longitude_rad = math.radians(longitude_deg)
        # Radii at the origin; their change over a few kilometres is far below the error stated above.
        w2 = 1.0 - _E2 * math.sin(self.latitude_rad) ** 2
        self._meridian_m = _A * (1.0 - _E2) / w2**1.5
        self._normal_m = _A / math.sqrt(w2)
        self._bend_per_m = 0.5 * math.tan(self.latitude_rad) / self._normal_m

    def east_north_m(self, latitude_rad: float, longitude_rad: float) -> tuple[float, float]:
        """Metres east and north of the origin."""
        turn = wrapped(longitude_rad - self.longitude_rad, math.pi)
        east = turn * self._normal_m * math.cos(latitude_rad)
        return east, (latitude_rad - self.latitude_rad) * self._meridian_m + self._bend_per_m * east * east

    def geodetic_rad(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Latitude and longitude in radians; the exact inverse of `east_north_m`."""
        latitude = self.latitude_rad + (north_m - self._bend_per_m * east_m * east_m) / self._meridian_m
        longitude = self.longitude_rad + east_m / (self._normal_m * math.cos(latitude))
        return latitude, wrapped(longitude, math.pi)

    def geodetic_e7(self, east_m: float, north_m: float) -> tuple[int, int]:
        """Latitude and longitude in units of 1e-7 degree, as MAVLink has them."""
        latitude, longitude = self.geodetic_rad(east_m, north_m)
        return round(latitude * _E7), round(longitude * _E7)


class LocalFrame:
    """North and east metres around home, as flight controllers use them; the plane's origin is the scene's."""

    def __init__(self, plane: TangentPlane, home_east_m: float, home_north_m: float) -> None:
        self.home_east_m, self.home_north_m = home_east_m, home_north_m
        self._plane = plane

    def to_geodetic_e7(self, north_m: float, east_m: float) -> tuple[int, int]:
        """Latitude and longitude of a local place, in 1e-7 degree."""
        return self._plane.geodetic_e7(east_m + self.home_east_m, north_m + self.home_north_m)

    def to_local_m(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """North and east of a geodetic place."""
        east, north = self._plane.east_north_m(math.radians(latitude_deg), math.radians(longitude_deg))
        return north - self.home_north_m, east - self.home_east_m


_E7 = 1e7 * 180.0 / math.pi
