"""Phrases of the ground to fields: the area of interest, its halves, the road through it."""

from __future__ import annotations

from typing import Any

from ._draft import Draft, Path
from ._phrases import Phrase, Quantity
from ._tokens import Span
from ._vocabulary import Defaults


class Ground:
    """The area and what lies in it. Halves and the road are taken up as they are spoken of, and laid out by `finish`."""

    def __init__(self, draft: Draft, defaults: Defaults) -> None:
        self._draft, self._defaults = draft, defaults
        self.parts: list[tuple[str, float, Span]] = []
        """Group, direction in degrees, and span of each `in the north of the area`."""
        self.road: Span | None = None
        """Where a road was first spoken of."""

    def area(self, phrase: Phrase) -> None:
        part = phrase.first("DIM") or phrase.first("AREA") or phrase.first("LENGTH")
        assert part is not None
        assert isinstance(part.value, Quantity)
        quantity = part.value
        if quantity.kind != "DIM" and not quantity.single:
            self._draft.fault(phrase.span, "the area is one, not a range", "give one size")
        east = north = quantity.low
        if quantity.kind == "DIM":
            north = quantity.high
        elif quantity.kind == "AREA":
            east = north = quantity.low**0.5
        self._draft.put(("world", "area", "corners"), _corners(east, north), phrase.span)

    def finish(self) -> None:
        """The area, the halves of it that groups stand in, and the road through its middle."""
        path: Path = ("world", "area", "corners")
        usual = self._defaults
        if path not in self._draft.entries:
            self._draft.put(path, _corners(usual.area_east_m, usual.area_north_m), None)
        corners = self._draft.entries[path].value
        east, north = corners[2]["east_m"], corners[2]["north_m"]
        for group, direction, span in self.parts:
            across, up = _halves(direction)
            region = [
                {"east_m": e, "north_m": n}
                for e, n in (
                    (-east if across <= 0 else 0.0, -north if up <= 0 else 0.0),
                    (east if across >= 0 else 0.0, -north if up <= 0 else 0.0),
                    (east if across >= 0 else 0.0, north if up >= 0 else 0.0),
                    (-east if across <= 0 else 0.0, north if up >= 0 else 0.0),
                )
            ]
            self._draft.put(("actors", group, "placement", "region", "corners"), region, span)
        if self.road:
            ends = [{"east_m": -east, "north_m": 0.0}, {"east_m": east, "north_m": 0.0}]
            self._draft.put(("world", "roads", "road", "id"), "road", self.road)
            self._draft.put(("world", "roads", "road", "points"), ends, None, "through the middle of the area, west to east")
            self._draft.put(("world", "roads", "road", "width_m"), usual.road_width_m, None)


def _halves(direction: float) -> tuple[int, int]:
    """Signs of east and north of the half, or quarter, of the area that lies in a direction."""
    across = 0 if direction in (0, 180) else 1 if direction < 180 else -1
    up = 0 if direction in (90, 270) else 1 if direction < 90 or direction > 270 else -1
    return across, up


def _corners(east_m: float, north_m: float) -> list[dict[str, Any]]:
    east, north = round(east_m / 2, 3), round(north_m / 2, 3)
    return [{"east_m": e, "north_m": n} for e, n in ((-east, -north), (east, -north), (east, north), (-east, north))]
