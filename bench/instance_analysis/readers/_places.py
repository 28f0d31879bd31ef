"""Places: the origin, the vehicle's home, and coordinates in metres east and north of the origin."""

from __future__ import annotations

import math
from collections.abc import Iterable

from bench.simspec import Origin

from .._draft import Draft
from ..language._coordinates import Coordinates, local_m
from ..language._grammar import Part
from ..language._tokens import Span
from ._not_read import NotReadError

Point = dict[str, float]
Box = tuple[float, float, float, float]
"""West, south, east and north, in metres."""
FARTHEST_M = 20_000.0
"""Degrees further than this from an origin that is not said are taken for another origin."""


class PlaceReader:
    """Turns places into points, and reads where home and the origin are."""

    def __init__(self, draft: Draft) -> None:
        self._draft = draft

    @property
    def origin(self) -> Origin:
        """The origin of metres east and north: as stated, or the SimSpec's default."""
        given = {
            name: entry.value
            for name in ("latitude_deg", "longitude_deg", "altitude_m")
            if (entry := self._draft.entries.get(("world", "origin", name)))
        }
        return Origin.model_construct(**(Origin().model_dump() | given))

    @property
    def home(self) -> Point:
        fields = [self._draft.entries.get(("vehicle", "home", name)) for name in ("east_m", "north_m")]
        east, north = (field.value if field else 0.0 for field in fields)
        return {"east_m": east, "north_m": north}

    def point(self, place: Coordinates) -> Point:
        """The place in metres east and north of the origin."""
        east, north = local_m(place, self.origin)
        home = self.home if place.from_home else {"east_m": 0.0, "north_m": 0.0}
        return {"east_m": round(east + home["east_m"], 6), "north_m": round(north + home["north_m"], 6)}

    def set_origin(self, part: Part) -> None:
        """Read where the map's origin is."""
        place = part.first("place")
        if not place.degrees:
            raise NotReadError("an origin is given in degrees of latitude and longitude")
        self._put_origin(place, part.span, "")

    def _put_origin(self, place: Coordinates, span: Span, note: str) -> None:
        self._draft.put(("world", "origin", "latitude_deg"), round(place.first, 7), span, note)
        self._draft.put(("world", "origin", "longitude_deg"), round(place.second, 7), span, note)

    def origin_of(self, parts: Iterable[Part]) -> None:
        """Use the first place in degrees as origin when the text states none and the default is far away."""
        if ("world", "origin", "latitude_deg") in self._draft.entries:
            return
        for place, span in _degrees_in(parts):
            if math.hypot(*local_m(place, Origin())) > FARTHEST_M:
                note = "no origin is said: the first place in degrees"
                self._draft.remark(span, f"{note} is the origin")
                self._put_origin(place, span, note)
            return

    def set_home(self, part: Part) -> None:
        """Read where the drone starts."""
        place = part.first("place")
        if place.from_home and (place.first, place.second) == (0.0, 0.0):
            raise NotReadError("home is at home: say where it is on the map")
        note = "from the origin of the map" if place.degrees else ""
        # Steps from home are steps from the origin here: there is no other place yet.
        place = Coordinates(place.first, place.second, place.degrees)
        for name, value in self.point(place).items():
            self._draft.put(("vehicle", "home", name), value, part.span, note)
        if (heading := part.first("direction")) is not None:
            self._draft.put(("vehicle", "home", "heading_deg"), heading, part.span)


def _degrees_in(parts: Iterable[Part]) -> Iterable[tuple[Coordinates, Span]]:
    for part in parts:
        for capture, span in zip(part.captures, part.spans, strict=True):
            values = capture.value if isinstance(capture.value, tuple) else (capture.value,)
            for value in values:
                if isinstance(value, Coordinates) and value.degrees:
                    yield value, span


def box_of(corners: list[Point]) -> Box:
    """West, south, east and north of some corners."""
    east, north = ([corner[axis] for corner in corners] for axis in ("east_m", "north_m"))
    return min(east), min(north), max(east), max(north)


def rectangle(west: float, south: float, east: float, north: float) -> list[Point]:
    """The corners of a box."""
    corners = ((west, south), (east, south), (east, north), (west, north))
    return [{"east_m": round(e, 3), "north_m": round(n, 3)} for e, n in corners]


def moved(place: Point, east_m: float, north_m: float) -> Point:
    return {"east_m": round(place["east_m"] + east_m, 3), "north_m": round(place["north_m"] + north_m, 3)}


def across(box: Box, heading_deg: float) -> list[Point]:
    """A straight line from edge to edge through the middle of a box, in a direction."""
    west, south, east, north = box
    middle = {"east_m": (west + east) / 2, "north_m": (south + north) / 2}
    radians = math.radians(heading_deg)
    to_e, to_n = round(math.sin(radians), 9), round(math.cos(radians), 9)
    halves = (((east - west) / 2, to_e), ((north - south) / 2, to_n))
    reach = min((half / abs(to) for half, to in halves if to), default=0.0)
    return [moved(middle, end * reach * to_e, end * reach * to_n) for end in (-1.0, 1.0)]


def halves(direction: float) -> tuple[int, int]:
    """Signs of east and north of the half, or quarter, of an area that lies in a direction."""
    east = 0 if direction in (0, 180) else 1 if direction < 180 else -1
    north = 0 if direction in (90, 270) else 1 if direction < 90 or direction > 270 else -1
    return east, north
