"""Reads phrases about the ground: the area of interest and its parts, named areas, no-fly areas, the
geofence.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Literal

from bench.simspec import HOME

from .._draft import Draft, FieldPath
from ..language._coordinates import Coordinates, name_of
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span
from ..language._vocabulary import Defaults
from ._places import PlaceReader, Point, places_in

KINDS = ("NOFLY", "FENCE", "AREAWORD", "GROUND", "NAMED")
"""Kinds of words for ground; of `no-fly zone over the school` the first one holds."""
_APPOSITION = re.compile(r"^[^.;\n]{0,12}(?:[,(]\s*(?:an|a|its)|:(?:\s*(?:an|a))?)$")
"""What stands between an area and the word that says of which shape it is."""
_STILL_OF_IT = re.compile(
    r"(?:[^.;!?]|[.](?=\d))*(?:[.;]\s+(?:it|this|that|they)\b[^.;!?\n]*)?$", re.IGNORECASE
)
"""What may stand between an area and its times: its own sentence, or one about `it`."""
_OF_GROUND = re.compile(r"\s+of\s+(?:an?|the|this|that|our)\s+", re.IGNORECASE)
EAST_WEST = 90.0
"""The value of an axis from east to west."""
CORNERS_OF_A_CIRCLE = 16
MIDDLE_SHARE = 1 / 3
MIN_AREA_M = 100.0
"""Ground with a shorter side is a place in the area of interest, unless the text says so. Chosen."""


@dataclass(slots=True)
class GroundPiece:
    """An area under construction: its kind, its extent by corners or by size and centre, and the groups
    inside.
    """

    kind: str
    id: str
    span: Span
    corners: list[Point] = field(default_factory=list)
    size_m: tuple[float, float] | None = None
    radius_m: float | None = None
    middle: Coordinates | str | None = None
    extent: Span | None = None
    times: dict[Literal["from_s", "until_s"], tuple[float, Span]] = field(default_factory=dict)
    within: list[tuple[str, Span]] = field(default_factory=list)
    outside: list[tuple[str, Span]] = field(default_factory=list)
    mentioned: bool = False
    """Whether something is told from it: then it is not the area of interest."""


class GroundReader:
    """The areas of a text. `finish` lays them out. `current` is the area mentioned last."""

    def __init__(self, draft: Draft, defaults: Defaults, places: PlaceReader) -> None:
        self._draft, self._defaults, self._places = draft, defaults, places
        self.parts: list[tuple[str, float | None, Span]] = []
        """Group, direction in degrees (None for the middle), and span of each `in the north of the area`."""
        self.world = GroundPiece("AREAWORD", "area", Span(0, 0))
        self.pieces: dict[str, GroundPiece] = {}
        self.current: GroundPiece | None = None
        self._mentions: list[tuple[int, GroundPiece]] = []
        """Where the text has named a piece of ground."""
        self._mentioned_until = 0
        """Where the text has named the current area."""
        self._over: list[tuple[str, Span]] = []
        self._fence: tuple[GroundPiece, Span] | None = None

    def mention(self, phrase: Phrase) -> GroundPiece:
        """The area that a phrase names. It becomes the current one."""
        part = next((name_part for kind in KINDS for name_part in phrase.every(kind)), None)
        # `inside it` names no area.
        if part is None:
            return self.current or self.world
        if part.kind == "AREAWORD" and self.current is not None and self._is_the_current(part.span):
            piece = self.current
        elif part.kind == "AREAWORD":
            piece = self.world
        else:
            text = self._draft.quote(part.span).lower()
            name = name_of(text) if part.kind == "NAMED" else re.sub(r"[^a-z]+", "-", text).strip("-")
            name = {"NOFLY": "no-fly", "FENCE": "geofence"}.get(part.kind, name)
            if part.kind == "NOFLY" and name in self.pieces and not self._is_definite(part.span):
                name = f"{name}-{sum(1 for name_part in self.pieces if name_part.startswith(name)) + 1}"
            elif part.kind == "NOFLY":
                name = next(
                    (name_part for name_part in reversed(self.pieces) if name_part.startswith(name)), name
                )
            piece = self.pieces.setdefault(name, GroundPiece(part.kind, name, part.span))
        self.current, self._mentioned_until = piece, part.span.end
        self._mentions.append((part.span.start, piece))
        return piece

    def _is_the_current(self, span: Span) -> bool:
        """Whether a word means the current area: `the yard is the named area from ...`, `a no-fly zone; the
        zone goes ...`.
        """
        assert self.current is not None
        before, word = self._draft.text[: span.start].lower().rstrip(), self._draft.quote(span).lower()
        if self.current is not self.world and _APPOSITION.search(before, self._mentioned_until):
            # `no-fly zone: box ...`, `the village, an area from ...`.
            return True
        named = re.search(r"\bis (the|a|an)( named)?$", before) is not None and self.current is not self.world
        return named or (self.current.kind == "NOFLY" and word == "zone" and before.endswith("the"))

    def _is_definite(self, span: Span) -> bool:
        before = self._draft.text[: span.start].lower().split()
        return bool(before) and before[-1] in ("the", "this", "that")

    def is_known(self, phrase: Phrase) -> bool:
        """Whether a phrase only names ground that is laid out elsewhere, or the area where everything is."""
        if not phrase.has(*KINDS):
            return False
        names = [
            self._draft.quote(part.span).lower() for part in phrase.leaves if part.kind in ("GROUND", "NAMED")
        ]
        return all(
            (piece := self.pieces.get(name_of(name))) is None or piece.extent is not None for name in names
        )

    def area(self, phrase: Phrase) -> None:
        """Read an area with its size."""
        if phrase.has(*KINDS):
            self.mention(phrase)
        else:
            self.current = self.world
        self.extent(phrase)

    def extent(self, phrase: Phrase) -> None:
        """Set the size of the current area."""
        part = next(filter(None, map(phrase.first, ("DIM", "AREA", "LENGTH", "PAIR"))), None)
        piece = self.current or self.world
        if phrase.every("AXIS"):
            part = _by_axes(phrase)
        elif len(sides := phrase.every("LENGTH")) == 2:
            # `900 m long and 350 m wide`.
            east_m, north_m = (side.value.low for side in sides if isinstance(side.value, Quantity))
            part = Part("DIM", Quantity("DIM", east_m, north_m), phrase.span)
        assert part is not None
        assert isinstance(part.value, Quantity)
        quantity = part.value
        if quantity.kind not in ("DIM", "PAIR") and not quantity.single:
            self._draft.fault(phrase.span, "the area is one, not a range", "give one size")
        east = north = quantity.low
        if quantity.kind == "PAIR":
            self._draft.remark(phrase.span, "no unit is given: read in metres")
        if quantity.kind in ("DIM", "PAIR"):
            north = quantity.high
        elif quantity.kind == "AREA":
            east = north = round(quantity.low**0.5, 3)
        piece.size_m, piece.extent = (
            (east, north),
            piece.extent.joined(phrase.span) if piece.extent else phrase.span,
        )
        if piece is self.world:
            self._draft.put(("world", "area", "corners"), _corners(east, north), phrase.span)

    def round(self, quantity: Quantity, span: Span) -> None:
        """Set the radius of the current area."""
        piece = self.current or self.world
        piece.radius_m, piece.extent = quantity.low, span

    def corners(self, phrase: Phrase) -> None:
        """Set the corners of the current area, or its centre when only one place is given."""
        piece, places = self.current or self.world, places_in(phrase)
        if box := self._places.box(phrase):
            self._set_corners(piece, _between(*box), phrase.span)
        elif len(places) == 1:
            self.middle(places[0], phrase.span)
        elif len(places) == 2:
            self._set_corners(piece, _between(*(self._places.point(place) for place in places)), phrase.span)
        else:
            self._set_corners(piece, [self._places.point(place) for place in places], phrase.span)

    def _set_corners(self, piece: GroundPiece, corners: list[Point], span: Span) -> None:
        piece.corners, piece.extent = corners, span
        if piece is self.world:
            self._draft.put(("world", "area", "corners"), corners, span)

    def middle(self, place: Coordinates | str, span: Span) -> None:
        piece = self.current or self.world
        piece.middle = place
        piece.extent = piece.extent.joined(span) if piece.extent else span

    def named_since(self, start: int) -> bool:
        """Whether the text has named a piece of ground from this character on."""
        return self.current is not None and self._mentioned_until > start

    def when(self, phrase: Phrase, *, of_ground: bool) -> None:
        """Set the times at which a no-fly area is active."""
        time = phrase.first("TIME")
        if (
            self.current is None
            or self.current.kind != "NOFLY"
            or time is None
            or not isinstance(time.value, Quantity)
            or not (
                of_ground or _STILL_OF_IT.match(self._draft.text[self._mentioned_until : phrase.span.start])
            )
        ):
            self._draft.unread(phrase.span, "stands by itself", expressible=True)
            return
        if not time.value.single:
            self.current.times["from_s"] = (time.value.low, phrase.span)
            self.current.times["until_s"] = (time.value.high, phrase.span)
        elif phrase.first("UNTIL") or phrase.first("BEFORE") or phrase.first("NTH"):
            self.current.times["until_s"] = (time.value.low, phrase.span)
        else:
            self.current.times["from_s"] = (time.value.low, phrase.span)

    def put_inside(self, group: str, phrase: Phrase) -> None:
        """Put a group inside the area that a phrase names."""
        piece = self.mention(phrase)
        if piece is not self.world:
            piece.within.append((group, phrase.span))

    def put_outside(self, group: str, phrase: Phrase) -> None:
        """Keep a group out of the area that a phrase names."""
        self.mention(phrase).outside.append((group, phrase.span))

    def overfly(self, phrase: Phrase) -> None:
        """Read an area that must not be flown over."""
        if phrase.has("GROUND", "NAMED"):
            self._over.append((self.mention(phrase).id, phrase.span))
        else:
            self._draft.unread(
                phrase.span, "a no-fly area is a piece of ground, with its corners or its size and place"
            )

    def stayin(self, phrase: Phrase) -> None:
        if phrase.has(*KINDS):
            self._fence = (self.mention(phrase), phrase.span)
        else:
            self.current = self.pieces.setdefault("geofence", GroundPiece("FENCE", "geofence", phrase.span))
        if phrase.has("DIM", "AREA", "LENGTH"):
            self.extent(phrase)

    def anchor(self, direction: float | None, span: Span) -> None:
        """Lay the area of interest out so that home is at its middle, at a corner, or in the middle of a side."""
        assert self.world.size_m
        east, north = self.world.size_m
        to_east, to_north = (0, 0) if direction is None else _halves(direction)
        home = self._places.home
        middle = _moved(home, -to_east * east / 2, -to_north * north / 2)
        self.current = self.world
        self.middle(Coordinates(middle["east_m"], middle["north_m"]), span)

    def fence_around_home(self, radius: Quantity, span: Span) -> None:
        """Let the drone stay within a distance of home."""
        fence = GroundPiece("FENCE", "geofence", span, radius_m=radius.high, middle=HOME, extent=span)
        self.pieces.setdefault("geofence", fence)

    # At the end.

    @property
    def outline(self) -> list[Point]:
        """Corners of the area of interest."""
        corners: list[Point] = self._draft.entries[("world", "area", "corners")].value
        return corners

    @property
    def box(self) -> tuple[float, float, float, float]:
        """West, south, east and north of the area of interest, or of the usual one where none could be read."""
        return _box(self.outline or _corners(self._defaults.area_east_m, self._defaults.area_north_m))

    def _part_is_of(self, part: Span) -> GroundPiece | None:
        """The named ground in `the middle of the field`; None for the area of interest."""
        after = _OF_GROUND.match(self._draft.text, part.end)
        at = after.end() if after else -1
        return next(
            (piece for start, piece in self._mentions if start == at and piece is not self.world), None
        )

    def finish(self) -> None:
        """Put the area of interest, its parts with groups, and all other areas into the draft."""
        path: FieldPath = ("world", "area", "corners")
        if path not in self._draft.entries and (ground := self._is_the_area()) is not None:
            assert ground.size_m
            self._draft.put(path, _corners(*ground.size_m), ground.extent)
        elif path not in self._draft.entries:
            piece, usual = self.world, self._defaults
            if piece.radius_m or piece.middle is not None:
                piece.size_m = piece.size_m or (usual.area_east_m, usual.area_north_m)
                self._draft.put(path, self._laid_out(piece), piece.extent)
            else:
                self._draft.put(path, _corners(usual.area_east_m, usual.area_north_m), None)
        elif self.world.size_m and self.world.middle is not None:
            self._draft.forget(path)
            self._draft.put(path, self._laid_out(self.world), self.world.extent)
        for group, direction, span in self.parts:
            whole = self._part_is_of(span)
            if whole is not None and not (whole.corners or whole.size_m or whole.radius_m):
                self._draft.remark(span, "no place and no size are given: read as the whole area")
                whole = None
            box = self.box if whole is None else _box(self._laid_out(whole))
            west, south, east, north = _part_of(box, direction)
            region = _between({"east_m": west, "north_m": south}, {"east_m": east, "north_m": north})
            note = "the middle third, each way" if direction is None else ""
            self._draft.put(("actors", group, "placement", "region", "corners"), region, span, note)
        for piece in self.pieces.values():
            self._lay_out(piece)
        self._rules()

    def _is_the_area(self) -> GroundPiece | None:
        """The only ground with a size, where it is to be the area of interest.

        It reaches beyond the usual area, or the text names it once, and puts nothing there: what else would it be for?
        """
        sized = [piece for piece in self.pieces.values() if piece.size_m or piece.corners or piece.radius_m]
        if len(sized) != 1 or self.world.radius_m or self.world.middle is not None:
            return None
        [piece] = sized
        free = piece.kind in ("GROUND", "NAMED") and piece.middle is None and not piece.corners
        if not free or piece.size_m is None or piece.extent is None:
            return None
        usual = (self._defaults.area_east_m, self._defaults.area_north_m)
        small = all(side <= most for side, most in zip(piece.size_m, usual, strict=True))
        told_of = piece.within or piece.outside or piece.mentioned or self._fence is not None
        again = sum(1 for _, named in self._mentions if named is piece) > 1
        if small and (told_of or again or min(piece.size_m) < MIN_AREA_M):
            return None
        readings = ["yes", f"no, the area is the usual one, {usual[0]:g} m by {usual[1]:g} m"]
        return (
            piece if self._draft.ask(piece.extent, "is this the area of interest?", readings) == 0 else None
        )

    def _laid_out(self, piece: GroundPiece) -> list[Point]:
        if piece.corners:
            return piece.corners
        middle = self._middle_of(piece)
        if piece.radius_m:
            # Around the circle, so that all of it lies inside.
            far, step = (
                piece.radius_m / math.cos(math.pi / CORNERS_OF_A_CIRCLE),
                2 * math.pi / CORNERS_OF_A_CIRCLE,
            )
            return [
                _moved(middle, far * math.sin((n + 0.5) * step), far * math.cos((n + 0.5) * step))
                for n in range(CORNERS_OF_A_CIRCLE)
            ]
        assert piece.size_m
        east, north = piece.size_m
        return _between(_moved(middle, -east / 2, -north / 2), _moved(middle, east / 2, north / 2))

    def _middle_of(self, piece: GroundPiece) -> Point:
        if isinstance(piece.middle, Coordinates):
            return self._places.point(piece.middle)
        if piece.middle == HOME:
            return self._places.home
        if piece.middle is not None and (fixed := self._places.fixed(piece.middle)):
            return fixed
        box = self.box if ("world", "area", "corners") in self._draft.entries else (0.0, 0.0, 0.0, 0.0)
        west, south, east, north = box
        return {"east_m": (west + east) / 2, "north_m": (south + north) / 2}

    def _lay_out(self, piece: GroundPiece) -> None:
        at = piece.middle
        if isinstance(at, str) and at != HOME and self._places.fixed(at) is None:
            self._draft.unread(piece.extent or piece.span, "the place at its centre has no coordinates")
        elif not (piece.corners or piece.size_m or piece.radius_m):
            self._list_without_size(piece)
        else:
            self._put(piece)

    def _list_without_size(self, piece: GroundPiece) -> None:
        """List ground that has neither corners nor size, where something needs them."""
        missing = "its corners or size are missing"
        for _, span in piece.outside:
            self._draft.unread(span, missing, expressible=True)
        if piece.kind in ("NOFLY", "FENCE") or (piece.within and piece.kind == "NAMED"):
            self._draft.unread(piece.span, missing, expressible=True)
        if piece.middle is not None and piece.extent is not None:
            self._draft.unread(piece.extent, missing, expressible=True)
        for _, span in piece.within if piece.kind == "GROUND" else ():
            self._draft.remark(span, "no place and no size are given: read as the whole area")

    def _put(self, piece: GroundPiece) -> None:
        base: dict[str, FieldPath] = {
            "NOFLY": ("rules", "no_fly", piece.id, "area"),
            "FENCE": ("rules", "geofence"),
        }
        where = base.get(piece.kind, ("world", "areas", piece.id))
        if piece.kind != "FENCE":
            self._draft.put((*where[:3], "id"), piece.id, piece.span)
        notes = [f"a circle, by {CORNERS_OF_A_CIRCLE} corners around it"] if piece.radius_m else []
        if not piece.corners and piece.middle is None:
            notes.insert(0, "in the middle of the area: the text does not say where")
        self._draft.put((*where, "corners"), self._laid_out(piece), piece.extent, "; ".join(notes))
        for name, (value, span) in piece.times.items():
            self._draft.put((*where[:3], name), value, span)
        for group, span in piece.within:
            self._draft.put(("actors", group, "placement", "inside", "area"), piece.id, span)
        for group, span in piece.outside:
            rows = ("actors", group, "placement", "avoid")
            number = len({path[4] for path in self._draft.entries if path[:4] == rows})
            self._draft.put((*rows, number, "area"), piece.id, span)

    def _rules(self) -> None:
        for name, span in self._over:
            area_corners = self._draft.entries.get(("world", "areas", name, "corners"))
            if area_corners is None:
                self._draft.unread(span, "its corners or size are missing", expressible=True)
                continue
            self._draft.put(("rules", "no_fly", name, "id"), name, span)
            self._draft.put(("rules", "no_fly", name, "area", "corners"), area_corners.value, span)
        if self._fence is not None:
            piece, span = self._fence
            fence_corners = (
                self.outline
                if piece is self.world
                else self._draft.entries.get(("world", "areas", piece.id, "corners"))
            )
            if fence_corners is None:
                self._draft.unread(span, "its corners or size are missing", expressible=True)
            elif piece.kind != "FENCE":
                self._draft.put(
                    ("rules", "geofence", "corners"),
                    fence_corners if isinstance(fence_corners, list) else fence_corners.value,
                    span,
                )


def _box(outline: list[Point]) -> tuple[float, float, float, float]:
    """West, south, east and north of some corners."""
    east, north = ([corner[axis] for corner in outline] for axis in ("east_m", "north_m"))
    return min(east), min(north), max(east), max(north)


def _by_axes(phrase: Phrase) -> Part:
    """The size of `700 m from west to east and 500 m from south to north`."""
    sides: dict[object, float] = {}
    axes = [axis.value for axis in phrase.every("AXIS")]
    # `120 m long east-west and 90 m deep`: the other side runs across.
    axes += [0.0 if axes[0] == EAST_WEST else EAST_WEST] if len(axes) == 1 else []
    for length, axis in zip(phrase.every("LENGTH"), axes, strict=True):
        assert isinstance(length.value, Quantity)
        sides[axis] = length.value.low
    east = sides.get(EAST_WEST, 0.0)
    return Part(
        "DIM",
        Quantity("DIM", east, next((m for axis, m in sides.items() if axis != EAST_WEST), east)),
        phrase.span,
    )


def _part_of(
    box: tuple[float, float, float, float], direction: float | None
) -> tuple[float, float, float, float]:
    """West, south, east and north of the half, quarter, or middle of a box."""
    west, south, east, north = box
    across, up = (west + east) / 2, (south + north) / 2
    if direction is None:
        half_e, half_n = (east - west) * MIDDLE_SHARE / 2, (north - south) * MIDDLE_SHARE / 2
        return (
            round(across - half_e, 3),
            round(up - half_n, 3),
            round(across + half_e, 3),
            round(up + half_n, 3),
        )
    to_east, to_north = _halves(direction)
    return (
        across if to_east > 0 else west,
        up if to_north > 0 else south,
        across if to_east < 0 else east,
        up if to_north < 0 else north,
    )


def _halves(direction: float) -> tuple[int, int]:
    """Signs of east and north of the half, or quarter, of the area that lies in a direction."""
    across = 0 if direction in (0, 180) else 1 if direction < 180 else -1
    up = 0 if direction in (90, 270) else 1 if direction < 90 or direction > 270 else -1
    return across, up


def _moved(place: Point, east_m: float, north_m: float) -> Point:
    return {"east_m": round(place["east_m"] + east_m, 3), "north_m": round(place["north_m"] + north_m, 3)}


def _between(a: Point, b: Point) -> list[Point]:
    """Corners of the rectangle between two opposite ones."""
    west, east = sorted((a["east_m"], b["east_m"]))
    south, north = sorted((a["north_m"], b["north_m"]))
    return [
        {"east_m": e, "north_m": n} for e, n in ((west, south), (east, south), (east, north), (west, north))
    ]


def _corners(east_m: float, north_m: float) -> list[Point]:
    east, north = round(east_m / 2, 3), round(north_m / 2, 3)
    return _between({"east_m": -east, "north_m": -north}, {"east_m": east, "north_m": north})
