"""Places given by numbers: metres east and north of the origin, or degrees of latitude and longitude."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from bench.simspec import Origin

_NUMBER = r"[-+−]?\d{1,9}(?:\.\d{1,9})?"
# Bounded, so that no text takes more than a few steps at each of its characters.
_S, _SS = r"\s{0,3}", r"\s{1,3}"
_MINUTES = rf"{_S}\d{{1,2}}(?:\.\d{{1,9}})?{_S}['′](?:{_S}\d{{1,2}}(?:\.\d{{1,9}})?{_S}(?:\"|″|''))?"
_DEGREES = rf"\d{{1,3}}(?:\.\d{{1,9}})?(?:{_S}°(?:{_MINUTES})?)?"
_M = rf"(?:{_S}m\b|{_S}met(?:re|er)s?\b)?"
_TO = rf"{_S}[,;]?{_S}(?:and{_SS})?"
PLACE = rf"""\({_S}{_NUMBER}{_M}{_S}[,;/]{_S}{_NUMBER}{_M}{_S}\)
    |\b(?:coordinates|coords){_SS}{_NUMBER}{_M}{_S}[,;/]{_S}{_NUMBER}\b
    |\b(?:position|grid|point){_SS}{_NUMBER}{_M}{_S}[,;/]{_S}{_NUMBER}(?![\d.,]*\s?[a-z%°])
    |(?<![\d/.]){_NUMBER}{_S}(?:east|west){_S},?{_S}{_NUMBER}{_S}(?:north|south)\b
    |(?<![\w/.])[-−]?\d{{2,5}}(?:\.\d{{1,3}})?/[-−]?\d{{2,5}}(?:\.\d{{1,3}})?(?![\w/]|\s?(?:%|km|m\b|kn|kt|m/s|mps))
    |\bx{_S}[=:]?{_S}{_NUMBER}{_M}{_TO}y{_S}[=:]?{_S}{_NUMBER}{_M}
    |\beast(?:ing)?{_S}[=:]?{_S}{_NUMBER}{_M}{_TO}north(?:ing)?{_S}[=:]?{_S}{_NUMBER}{_M}
    |\be{_S}=?{_S}{_NUMBER}{_M}{_S}[,;/]?{_S}n{_S}=?{_S}{_NUMBER}{_M}
    |(?:\({_S})?{_DEGREES}{_S}(?:n|s|north|south)\b{_TO}{_DEGREES}{_S}(?:e|w|east|west)\b(?:{_S}\))?
    |\blat(?:itude)?{_S}[=:]?{_S}{_NUMBER}{_S}°?{_TO}lon(?:g|gitude)?{_S}[=:]?{_S}{_NUMBER}{_S}°?"""
"""A place, as a regular expression with white space and case set aside."""
NAMED = (
    r"\b(?:sector|zone|area|box|field|compound|district|block|objective|site|village)\s{1,3}"
    r"(?:alpha|alfa|bravo|charlie|delta|echo|foxtrot|golf|hotel|red|blue|green|yellow|(?-i:[A-Z](?![A-Za-z'’]))"
    r"|\d{1,2}(?![\d.,]*\s?(?:[a-z%°×²/-]|\d)))\b"
)
"""A piece of ground with a name of its own, as `sector Alpha`."""
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


def coordinates_of(text: str) -> Coordinates:
    """The place stated by text of the form PLACE."""
    lower = text.lower().replace("−", "-")
    if lower.lstrip().startswith("lat"):
        latitude, longitude = (float(figure) for figure in re.findall(r"-?\d+(?:\.\d+)?", lower))
        return Coordinates(latitude, longitude, degrees=True)
    # `120 east 40 north` has no unit and no sign: the words give both axes and signs.
    if flat := re.fullmatch(r"(\S+?)\s*(east|west)[\s,]*(\S+?)\s*(north|south)", lower):
        east, north = (
            float(flat[1]) * (-1 if flat[2] == "west" else 1),
            float(flat[3]) * (-1 if flat[4] == "south" else 1),
        )
        return Coordinates(east, north)
    sides = re.findall(r"([\d.°'\"′″\s]+)(n|s|e|w)(?:orth|outh|ast|est)?\b", lower)
    if len(sides) == 2:
        latitude, longitude = (_degrees(figures) * (-1 if side in "sw" else 1) for figures, side in sides)
        return Coordinates(latitude, longitude, degrees=True)
    first, second = (float(figure) for figure in re.findall(r"[-+]?\d+(?:\.\d+)?", lower))
    return Coordinates(first, second)


def _degrees(figures: str) -> float:
    return float(
        sum(float(figure) / 60.0**index for index, figure in enumerate(re.findall(r"\d+(?:\.\d+)?", figures)))
    )


def name_of(text: str) -> str:
    """The id of a piece of ground that the prose names."""
    return re.sub(r"\s+", "-", text.strip().lower())


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
