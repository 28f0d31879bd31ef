"""Degrees and metres on the earth: what agents and bench reckon with around the origin of a map (WGS84)."""

from __future__ import annotations

import math

# Semi-major axis, m.
_EQUATOR_M, _FLATTENING = 6378137.0, 1.0 / 298.257223563


def wrapped(angle: float, half_turn: float = 180.0) -> float:
    """The same angle at most half a turn from zero, to the last bit where it is; in degrees, or in the unit of
    `half_turn`.

    Every difference of two longitudes goes through this, and every longitude that was reckoned from another.
    """
    if -half_turn <= angle <= half_turn:
        return angle
    return math.remainder(angle, 2.0 * half_turn)


def metres_of_degree(latitude_deg: float, altitude_m: float) -> tuple[float, float]:
    """Metres of one degree of longitude and of latitude (Torge, Geodesy, section 4.1)."""
    eccentricity_2 = _FLATTENING * (2.0 - _FLATTENING)
    latitude_rad = math.radians(latitude_deg)
    root = math.sqrt(1.0 - eccentricity_2 * math.sin(latitude_rad) ** 2)
    prime_m = _EQUATOR_M / root
    meridian_m = prime_m * (1.0 - eccentricity_2) / root**2
    return (
        math.radians(prime_m + altitude_m) * math.cos(latitude_rad),
        math.radians(meridian_m + altitude_m),
    )
