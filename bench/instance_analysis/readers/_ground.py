"""Reads the ground: the area of interest, named areas, no-fly areas, the geofence."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from .._draft import Draft, FieldPath
from ..language._coordinates import Coordinates
from ..language._grammar import Part
from ..language._phrases import HOME_PLACE, Ground, NounPhrase, step_of
from ..language._tokens import Span
from ..language._vocabulary import Defaults
from ._not_read import NotReadError
from ._places import Box, PlaceReader, Point, box_of, halves, moved, rectangle

AREA: FieldPath = ("world", "area", "corners")
CORNERS_OF_A_CIRCLE = 16
MIDDLE_SHARE = 1 / 3
DEFAULT_PLACE = "a square of {:g} m in the middle of the area"


@dataclass(frozen=True, slots=True)
class Shape:
    """The extent of ground: corners, or a size or radius around a middle."""

    span: Span
    corners: tuple[Coordinates, ...] = ()
    size_m: tuple[float, ...] = ()
    radius_m: float = 0.0
    middle: Coordinates | None = None


def shape_of(part: Part) -> Shape | None:
    """The shape that a part states; None where it states none."""
    middle, corners, radius = part.first("middle"), _corners_of(part), part.first("radius")
    size = _size_of(part)
    if isinstance(middle, NounPhrase):
        raise NotReadError("ground lies around a place, and no group")
    if not (size or radius or corners):
        return None
    return Shape(part.span, corners, size, radius.low if radius else 0.0, middle)


def _size_of(part: Part) -> tuple[float, ...]:
    """Extent east and north; of a surface only the size is told, so it is a square too."""
    side, surface = part.first("side"), part.first("surface")
    if surface is not None:
        return (round(surface.low**0.5, 3),) * 2
    size: tuple[float, ...] = part.first("size") or ((side.low,) * 2 if side is not None else ())
    if len(size) == 3:
        raise NotReadError("ground has two sides")
    return size


def _corners_of(part: Part) -> tuple[Coordinates, ...]:
    if part.first("opposite") is not None:
        return _rectangle(part.first("corner"), part.first("opposite"))
    return _box(part) if part.first("across") is not None else part.first("corners") or ()


def _box(part: Part) -> tuple[Coordinates, ...]:
    """`60 to 120 m west and 20 to 80 m south of home`."""
    across, along = part.first("across"), part.first("along")
    if across.single or along.single:
        raise NotReadError("a box has a range to each side")
    ends = []
    for end in ("low", "high"):
        east, north = step_of(getattr(across, end), part.first("sideways"))
        more_east, more_north = step_of(getattr(along, end), part.first("lengthways"))
        ends.append(HOME_PLACE.moved(east + more_east, north + more_north))
    return _rectangle(*ends)


def _rectangle(first: Coordinates, second: Coordinates) -> tuple[Coordinates, ...]:
    """The corners of the rectangle between two opposite ones, which are given alike."""
    west, east = sorted((first.first, second.first))
    south, north = sorted((first.second, second.second))
    corners = ((west, south), (east, south), (east, north), (west, north))
    return tuple(replace(first, first=e, second=n) for e, n in corners)


@dataclass(slots=True)
class Piece:
    """Named ground under construction; without a shape it gets a default one."""

    id: str
    span: Span
    shape: Shape | None = None
    groups: list[tuple[str, str, Span]] = field(default_factory=list)
    """Groups with a relation to it: `inside` or `avoid`, and where the text says so."""


class GroundReader:
    """The ground of a text. `finish` lays it out, once the area of interest is known."""

    def __init__(self, draft: Draft, defaults: Defaults, places: PlaceReader) -> None:
        self._draft, self._defaults, self._places = draft, defaults, places
        self.pieces: dict[str, Piece] = {}
        self._parts: list[tuple[str, float | None, Span]] = []
        self._bans: list[tuple[str, Part]] = []
        self._fences: list[Part] = []

    def area(self, part: Part) -> None:
        """Read the area of interest, which is laid out at the end."""
        shape = shape_of(part)
        assert shape is not None
        self._draft.put(AREA, self._outline(shape), part.span)

    def kind(self, part: Part) -> None:
        """Read what the ground is made of."""
        self._draft.put(("world", "ground"), part.words[-1], part.span)

    def ground(self, part: Part) -> None:
        """Read a piece of named ground, with its shape where it has one."""
        piece, shape = self.piece(part.first("ground")), shape_of(part)
        if piece.shape is not None and shape is not None:
            raise NotReadError(f"the text has told where {piece.id} is")
        piece.shape = shape or piece.shape
        self._draft.acknowledge(part.span)

    def piece(self, ground: Ground) -> Piece:
        """The piece that a phrase names."""
        return self.pieces.setdefault(ground.id, Piece(ground.id, ground.span))

    def relate(self, group: str, part: Part, relation: str) -> None:
        """Put a group inside a piece of ground, or keep it out."""
        self.piece(part.first("ground")).groups.append((group, relation, part.span))
        self._draft.acknowledge(part.span)

    def part_of_area(self, group: str, direction: float | None, span: Span) -> None:
        """Put a group into a part of the area; without a direction into the middle."""
        self._parts.append((group, direction, span))
        self._draft.acknowledge(span)

    def no_fly(self, part: Part) -> None:
        """Read an area that must not be flown over."""
        ground = part.first("ground")
        shape_of(part)
        name = "no-fly" if ground is None else self.piece(ground).id
        taken = [other for other, _ in self._bans if other.startswith(name)]
        self._bans.append((name if not taken else f"{name}-{len(taken) + 1}", part))
        self._draft.acknowledge(part.span)

    def fence(self, part: Part) -> None:
        """Read the geofence."""
        shape_of(part)
        self._fences.append(part)
        if part.first("ground") is not None:
            self.piece(part.first("ground"))
        self._draft.acknowledge(part.span)

    # At the end.

    @property
    def box(self) -> Box:
        """West, south, east and north of the area of interest."""
        return box_of(self._draft.entries[AREA].value)

    def finish(self) -> None:
        """Lay out everything that depends on the area of interest."""
        self._settle_the_area()
        # A statement that was not read in full has left its group out.
        known = {path[1] for path in self._draft.entries if path[0] == "actors"}
        for group, direction, span in self._parts:
            if group in known:
                note = "the middle third, each way" if direction is None else ""
                path = ("actors", group, "placement", "region", "corners")
                self._draft.put(path, rectangle(*_part_of(self.box, direction)), span, note)
        for piece in self.pieces.values():
            piece.groups = [relation for relation in piece.groups if relation[0] in known]
            self._lay_out(piece)
        for name, part in self._bans:
            self._put_ban(name, part)
        for part in self._fences:
            self._put_fence(part)

    def _settle_the_area(self) -> None:
        """The area of interest: as stated, or the only ground of a size, or the usual one."""
        ground = None if AREA in self._draft.entries else self._may_be_the_area()
        if ground is not None:
            readings = ["yes", "no, it is a place in the usual area"]
            if self._draft.ask(ground.span, "is this the area of interest?", readings) == 0:
                self._draft.put(AREA, self._outline(ground), ground.span)
        if AREA not in self._draft.entries:
            east, north = self._defaults.area_east_m / 2, self._defaults.area_north_m / 2
            self._draft.put(AREA, rectangle(-east, -north, east, north), None)

    def _may_be_the_area(self) -> Shape | None:
        """The shape of the only named ground, if it has a size and no place, and nothing is told from it."""
        shapes = [piece.shape for piece in self.pieces.values() if not piece.groups]
        banned = any(part.first("ground") is not None for _, part in self._bans)
        shape = shapes[0] if len(shapes) == len(self.pieces) == 1 and not banned else None
        return shape if shape is not None and shape.size_m and shape.middle is None else None

    def _lay_out(self, piece: Piece) -> None:
        base: FieldPath = ("world", "areas", piece.id)
        self._draft.put((*base, "id"), piece.id, piece.span)
        shape = piece.shape or Shape(piece.span)
        self._draft.reading = piece.span
        self._draft.put(
            (*base, "corners"), self._corners(shape), shape.span if piece.shape else None, self._note(shape)
        )
        for group, relation, span in piece.groups:
            rows: FieldPath = ("actors", group, "placement", relation)
            if relation == "avoid":
                rows = (*rows, len({path[4] for path in self._draft.entries if path[:4] == rows}))
            self._draft.put((*rows, "area"), piece.id, span)

    def _note(self, shape: Shape) -> str:
        notes = [f"a circle, by {CORNERS_OF_A_CIRCLE} corners around it"] if shape.radius_m else []
        if not shape.corners and shape.middle is None:
            has_size = shape.size_m or shape.radius_m
            where = "in the middle of the area" if has_size else DEFAULT_PLACE.format(self._defaults.ground_m)
            notes.insert(0, f"{where}: the text does not say where it is")
        return "; ".join(notes)

    def _corners(self, shape: Shape) -> list[Point]:
        """The corners of ground in the area; without a size it is a square."""
        if shape.corners or shape.size_m or shape.radius_m:
            return self._outline(shape)
        side = self._defaults.ground_m
        return self._outline(Shape(shape.span, size_m=(side, side), middle=shape.middle))

    def _outline(self, shape: Shape) -> list[Point]:
        if shape.corners:
            return [self._places.point(corner) for corner in shape.corners]
        middle = self._middle(shape.middle)
        if shape.radius_m:
            # Around the circle, so that all of it lies inside.
            step = 2 * math.pi / CORNERS_OF_A_CIRCLE
            far = shape.radius_m / math.cos(step / 2)
            angles = [(number + 0.5) * step for number in range(CORNERS_OF_A_CIRCLE)]
            return [moved(middle, far * math.sin(angle), far * math.cos(angle)) for angle in angles]
        east, north = shape.size_m[0] / 2, shape.size_m[1] / 2
        return rectangle(
            middle["east_m"] - east,
            middle["north_m"] - north,
            middle["east_m"] + east,
            middle["north_m"] + north,
        )

    def _middle(self, middle: Any) -> Point:
        if isinstance(middle, Coordinates):
            return self._places.home if middle == HOME_PLACE else self._places.point(middle)
        if AREA not in self._draft.entries:
            return {"east_m": 0.0, "north_m": 0.0}
        west, south, east, north = self.box
        return {"east_m": (west + east) / 2, "north_m": (south + north) / 2}

    def _put_ban(self, name: str, part: Part) -> None:
        base: FieldPath = ("rules", "no_fly", name)
        shape, ground = shape_of(part), part.first("ground")
        self._draft.put((*base, "id"), name, part.span)
        corners = (
            self._outline(shape)
            if shape
            else self._draft.entries["world", "areas", ground.id, "corners"].value
        )
        note = self._note(shape) if shape else ""
        self._draft.put((*base, "area", "corners"), corners, part.span, note)
        for field_name, slot in (("from_s", "from"), ("until_s", "until")):
            if (moment := part.first(slot)) is not None:
                self._draft.put((*base, field_name), moment, part.span)

    def _put_fence(self, part: Part) -> None:
        shape, ground, length = shape_of(part), part.first("ground"), part.first("length")
        if length is not None:
            corners = self._outline(Shape(part.span, radius_m=length.high, middle=HOME_PLACE))
        elif shape is not None:
            corners = self._outline(shape)
        elif ground is not None:
            corners = self._draft.entries["world", "areas", ground.id, "corners"].value
        else:
            corners = self._draft.entries[AREA].value
        self._draft.put(("rules", "geofence", "corners"), corners, part.span)


def _part_of(box: Box, direction: float | None) -> Box:
    """West, south, east and north of the half, quarter, or middle of a box."""
    west, south, east, north = box
    across, up = (west + east) / 2, (south + north) / 2
    if direction is None:
        half_e, half_n = (east - west) * MIDDLE_SHARE / 2, (north - south) * MIDDLE_SHARE / 2
        return across - half_e, up - half_n, across + half_e, up + half_n
    to_east, to_north = halves(direction)
    return (
        across if to_east > 0 else west,
        up if to_north > 0 else south,
        across if to_east < 0 else east,
        up if to_north < 0 else north,
    )
