"""Places given by numbers: metres east and north of the origin, or degrees of latitude and longitude."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.simspec import Origin

# WGS84: semi-major axis in metres, and the square of the first eccentricity.
_A, _E2 = 6378137.0, 6.69437999014e-3


@dataclass(frozen=True, slots=True)
class Coordinates:
    """A place as stated: metres east and north of the origin, or of home when `from_home`; degrees of latitude
    and longitude (WGS84) when `degrees` is true.
    """

    first: float
    second: float
    degrees: bool = False
    from_home: bool = False

    def moved(self, east_m: float, north_m: float) -> Coordinates:
        """The place so many metres further east and north."""
        return Coordinates(self.first + east_m, self.second + north_m, self.degrees, self.from_home)


def local_m(place: Coordinates, origin: Origin) -> tuple[float, float]:
    """Metres east and north of the origin in its tangent plane (WGS84), rounded to the centimetre."""
    if not place.degrees:
        return place.first, place.second
    latitude, longitude = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    # Through earth-centred coordinates: exact at any distance and latitude.
    there = _earth_centred_m(math.radians(place.first), math.radians(place.second), origin.altitude_m)
    here = _earth_centred_m(latitude, longitude, origin.altitude_m)
    x, y, z = (a - b for a, b in zip(there, here, strict=True))
    east = -math.sin(longitude) * x + math.cos(longitude) * y
    outwards = math.cos(longitude) * x + math.sin(longitude) * y
    return round(east, 2), round(math.cos(latitude) * z - math.sin(latitude) * outwards, 2)


def _earth_centred_m(latitude: float, longitude: float, altitude_m: float) -> tuple[float, float, float]:
    across = _A / math.sqrt(1.0 - _E2 * math.sin(latitude) ** 2)
    flat = (across + altitude_m) * math.cos(latitude)
    return (
        flat * math.cos(longitude),
        flat * math.sin(longitude),
        (across * (1 - _E2) + altitude_m) * math.sin(latitude),
    )
