"""The magnetic field of a place at a date, from the World Magnetic Model of NOAA and the British Geological Survey."""

from __future__ import annotations

import datetime as dt

from pygeomag import GeoMag

from bench.contracts import Vector

_GAUSS_PER_NT = 1e-5
# First year and coefficients of each edition. An edition holds for five years.
_EDITIONS = (
    (2025.0, "wmm/WMM_2025.COF"),
    (2020.0, "wmm/WMM_2020.COF"),
    (2015.0, "wmm/WMM_2015v2.COF"),
    (2010.0, "wmm/WMM_2010.COF"),
)
_VALID_YEARS = 5.0


def magnetic_field_ned_gauss(
    latitude_deg: float, longitude_deg: float, altitude_m: float, date: dt.datetime
) -> Vector:
    """The field, north, east, down, in gauss. A date outside 2010 to 2030 gets the field of the nearest year of those.

    Declination changes by 0.1 to 0.2 degrees a year at most places, so the nearest year is closer than what autopilots
    correct from their own tables.
    """
    year = _decimal_year(date)
    first_year, coefficients = next((edition for edition in _EDITIONS if year >= edition[0]), _EDITIONS[-1])
    year = min(max(year, first_year), first_year + _VALID_YEARS)
    field = GeoMag(coefficients_file=coefficients).calculate(
        glat=latitude_deg, glon=longitude_deg, alt=altitude_m / 1000.0, time=year
    )
    return field.x * _GAUSS_PER_NT, field.y * _GAUSS_PER_NT, field.z * _GAUSS_PER_NT


def _decimal_year(date: dt.datetime) -> float:
    start = dt.datetime(date.year, 1, 1, tzinfo=dt.UTC)
    end = dt.datetime(date.year + 1, 1, 1, tzinfo=dt.UTC)
    return date.year + (date - start) / (end - start)
