"""The position of the sun, by the low-accuracy formulas of the Astronomical Almanac.

Source: Michalsky, J. J. (1988), "The Astronomical Almanac's algorithm for approximate solar position
(1950-2050)", Solar Energy 40(3), 227-235; better than 0.01 degree, without refraction.
"""

from __future__ import annotations

import datetime as dt
import math
from dataclasses import dataclass

from ._document import SimSpec

_J2000 = dt.datetime(2000, 1, 1, 12, tzinfo=dt.UTC)


@dataclass(frozen=True, slots=True)
class Sun:
    """The sun as seen from a place: elevation above the horizon, azimuth clockwise from north, hours to or
    from solar noon.
    """

    elevation_rad: float
    azimuth_rad: float
    hours_from_noon: float


def sun_at(moment: dt.datetime, latitude_deg: float, longitude_deg: float) -> Sun:
    """Position of the sun at a moment with a time zone, for geodetic latitude and east longitude in
    degrees.
    """
    # UTC in place of terrestrial time: a minute or so, in which the sun moves along the ecliptic by less than
    # 0.001 degree.
    days = (moment - _J2000).total_seconds() / 86400.0
    mean_longitude = math.radians((280.460 + 0.9856474 * days) % 360.0)
    anomaly = math.radians((357.528 + 0.9856003 * days) % 360.0)
    ecliptic = (
        mean_longitude + math.radians(1.915) * math.sin(anomaly) + math.radians(0.020) * math.sin(2 * anomaly)
    )
    obliquity = math.radians(23.439 - 4e-7 * days)
    right_ascension = math.atan2(math.cos(obliquity) * math.sin(ecliptic), math.cos(ecliptic))
    declination = math.asin(math.sin(obliquity) * math.sin(ecliptic))
    utc = moment.astimezone(dt.UTC)
    hour = utc.hour + utc.minute / 60.0 + (utc.second + utc.microsecond * 1e-6) / 3600.0
    # Greenwich mean sidereal time in hours. The formula takes the day count with its fraction, and the hour
    # besides.
    sidereal = (6.697375 + 0.0657098242 * days + hour) % 24.0
    hour_angle = math.radians(sidereal * 15.0 + longitude_deg) - right_ascension
    hour_angle = (hour_angle + math.pi) % (2 * math.pi) - math.pi
    latitude = math.radians(latitude_deg)
    elevation = math.asin(
        math.sin(declination) * math.sin(latitude)
        + math.cos(declination) * math.cos(latitude) * math.cos(hour_angle)
    )
    # Two arguments, because an arcsine could not tell north from south.
    azimuth = math.atan2(
        -math.cos(declination) * math.sin(hour_angle),
        math.sin(declination) * math.cos(latitude)
        - math.cos(declination) * math.sin(latitude) * math.cos(hour_angle),
    )
    return Sun(elevation, azimuth % (2 * math.pi), abs(hour_angle) * 12.0 / math.pi)


def sun_of(simspec: SimSpec) -> Sun:
    """Position of the sun at the start of a SimSpec, over its origin."""
    origin = simspec.world.origin
    return sun_at(simspec.environment.start_utc, origin.latitude_deg, origin.longitude_deg)
