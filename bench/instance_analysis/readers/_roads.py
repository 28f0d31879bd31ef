"""Reads phrases about roads: how many, their direction, and the groups on, beside or off them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from .._draft import Draft, FieldPath
from ..language._coordinates import Coordinates
from ..language._phrases import Part, Phrase, Quantity, stepped
from ..language._tokens import Span
from ..language._vocabulary import Defaults
from ._ground import GroundReader
from ._places import PlaceReader, Point, places_in
from ._traits import DIRECTIONS, length_of

WEST_TO_EAST, NORTH_TO_SOUTH = 90.0, 0.0


@dataclass(slots=True)
class RoadDraft:
    """A road under construction: its direction, the part of the area in which it lies, or its points."""

    id: str
    span: Span
    axis: float | None = None
    axis_span: Span | None = None
    part: float | None = None
    points: list[Point] = field(default_factory=list)
    points_span: Span | None = None
    width: tuple[float, Span] | None = None


class RoadReader:
    """The roads of a text. `finish` lays them out. `current` are the roads mentioned last."""

    RULES = frozenset(["road", "roadgap", "roadside", "crossroads", "parallel"])
    """What is said of a group."""

    def __init__(self, draft: Draft, defaults: Defaults, ground: GroundReader, places: PlaceReader) -> None:
        self._draft, self._defaults, self._ground, self._places = draft, defaults, ground, places
        self.roads: list[RoadDraft] = []
        self.current: list[RoadDraft] = []
        self._resolve: dict[Span, RoadDraft] = {}
        self._sides: list[tuple[str, RoadDraft, float, Span]] = []
        self._hinted: Phrase | None = None
        """`the road` before anything is said of it."""
        self._crossings: list[tuple[str, Span]] = []
        self._unbounded: list[tuple[str, float]] = []
        """Groups with a least distance from a road alone."""

    def mention(self, phrase: Phrase) -> None:
        """Read a mention of roads. `the road` without any description creates none yet."""
        word = phrase.first("ROAD")
        assert word is not None
        if not self.roads and self._is_bare(phrase) and self._definite(phrase):
            self._hinted = self._hinted or phrase
            return
        self._roads_named(phrase)

    def _is_bare(self, phrase: Phrase) -> bool:
        return not phrase.has("COUNT", "DIR", "AXIS", "LENGTH")

    def _definite(self, phrase: Phrase) -> bool:
        kinds = ("COUNT", "LENGTH", "DIR", "AXIS", "NTH", "ROAD", "THEM")
        begin = min(
            (part.span.start for kind in kinds for part in phrase.every(kind)), default=phrase.span.start
        )
        before = self._draft.text[:begin].lower().split()
        return bool(before) and before[-1] in ("the", "this", "that")

    def _roads_named(self, phrase: Phrase) -> list[RoadDraft]:
        number = _count(phrase)
        described = bool(_part(phrase) or phrase.every("AXIS")) and not self._fitting(phrase)
        if not self.roads or (number or 1) > 1 or (described and (number or not self._definite(phrase))):
            self.current = [self._new(phrase) for _ in range(max(1, min(number or 1, 8)))]
            return self.current
        fitting = (
            self._fitting(phrase) or (self.roads if phrase.first("ROAD") else self.current) or self.roads
        )
        if phrase.first("LENGTH") and len(fitting) > 1:
            fitting = [road for road in fitting if road.width is None] or fitting
        if len(fitting) > 1 and phrase.rule != "roads" and phrase.span not in self._resolve:
            chosen = self._draft.ask(
                phrase.span, "which road is meant?", [self._described(road) for road in fitting]
            )
            self._resolve[phrase.span] = fitting[chosen]
        self.current = [self._resolve.get(phrase.span, fitting[0])] if phrase.rule != "roads" else fitting
        for road in self.current:
            self._describe(road, phrase)
        return self.current

    def _described(self, road: RoadDraft) -> str:
        return f"{road.id}, {self._draft.quote(road.axis_span or road.points_span or road.span)!r}"

    def _create_hinted(self) -> None:
        if not self.roads and self._hinted is not None:
            self.current = [self._new(self._hinted)]

    def as_road_phrase(self, phrase: Phrase) -> Phrase:
        """`on it`, `beside it`, `30 m north of it` as a phrase about a road."""
        if phrase.rule in ("exact", "within", "atleast", "bearing"):
            rule = "roadside" if phrase.rule == "bearing" else "roadgap"
            return Phrase(rule, tuple(part for part in phrase.parts if isinstance(part, Part)), phrase.span)
        side = phrase.first("ALONG") or Part("BESIDE", None, phrase.span)
        return Phrase("road", (side,), phrase.span)

    def _fitting(self, phrase: Phrase) -> list[RoadDraft]:
        """The known roads that a phrase describes."""
        candidates = self.roads
        if nth := phrase.first("NTH"):
            assert isinstance(nth.value, int | float)
            return candidates[int(nth.value) - 1 : int(nth.value)]
        if part := _part(phrase):
            return [road for road in candidates if road.part == part.value]
        if axis := phrase.first("AXIS"):
            return [road for road in candidates if road.axis == axis.value]
        return []

    def _new(self, phrase: Phrase) -> RoadDraft:
        road = RoadDraft("road" if not self.roads else f"road-{len(self.roads) + 1}", phrase.span)
        self.roads.append(road)
        self._describe(road, phrase)
        return road

    def _describe(self, road: RoadDraft, phrase: Phrase) -> None:
        if (part := _part(phrase)) and isinstance(part.value, float | int):
            road.part = float(part.value)
        if (axis := phrase.first("AXIS")) and isinstance(axis.value, float | int):
            road.axis, road.axis_span = float(axis.value), phrase.span
        if (
            phrase.rule in ("roads", "road")
            and (width := phrase.first("LENGTH"))
            and isinstance(width.value, Quantity)
        ):
            road.width = (width.value.low, phrase.span)

    def axis(self, phrase: Phrase) -> None:
        """Set the direction of the first road mentioned that has none."""
        self._create_hinted()
        if phrase.first("CROSSING"):
            for road in self.current[1:2] or self.roads[1:2]:
                road.axis, road.axis_span = self._across(self.roads[0]), phrase.span
            return
        free = [road for road in self.current if road.axis is None and not road.points]
        free = free or [road for road in self.roads if road.axis is None and not road.points]
        if not free:
            self._draft.unread(phrase.span, "the text does not say which road", expressible=True)
            return
        part = phrase.first("AXIS") or phrase.every("DIR")[-1]
        assert isinstance(part.value, float | int)
        free[0].axis, free[0].axis_span = float(part.value) % 180, phrase.span

    def _across(self, road: RoadDraft) -> float:
        return ((WEST_TO_EAST if road.axis is None else road.axis) + 90) % 180

    def width(self, phrase: Phrase) -> None:
        self._create_hinted()
        length = length_of(self._draft, phrase)
        for road in self.current:
            road.width = (length.low, phrase.span)
        if not self.current:
            self._draft.unread(phrase.span, "the text does not say of what", expressible=True)

    def through(self, phrase: Phrase) -> None:
        """Set the points of a road."""
        self._create_hinted()
        points = [self._places.point(place) for place in places_in(phrase)]
        free = [place for place in self.current if not place.points] or self.current
        if not free or len(points) < 2:
            self._draft.unread(phrase.span, "a road has two points at least", expressible=True)
            return
        free[0].points, free[0].points_span = points, phrase.span

    def course(self, phrase: Phrase) -> None:
        """Lay a road out from a place, so many metres in a direction."""
        self._create_hinted()
        length, start = length_of(self._draft, phrase), phrase.first("POINT")
        direction = phrase.first("DIR") or phrase.first("DUE")
        free = [road for road in self.current if not road.points]
        if not free or direction is None or start is None or not isinstance(start.value, Coordinates):
            self._draft.unread(
                phrase.span, "a road is given by two points, or by one, a length and a direction"
            )
            return
        # `to the north` has no value of its own.
        degrees = (
            direction.value
            if isinstance(direction.value, float | int)
            else DIRECTIONS[self._draft.quote(direction.span).lower().split()[-1]]
        )
        begin = self._places.point(start.value)
        end = stepped(begin["east_m"], begin["north_m"], length, float(degrees))
        free[0].points, free[0].points_span = (
            [begin, dict(zip(("east_m", "north_m"), end, strict=True))],
            phrase.span,
        )

    @property
    def known(self) -> bool:
        """Whether the text has spoken of a road; one that was only mentioned is created."""
        self._create_hinted()
        return bool(self.roads)

    # Of a group.

    def road(self, group: str, phrase: Phrase) -> None:
        self._along(
            group, self._roads_named(phrase)[0], "beside" if phrase.first("BESIDE") else "on", phrase.span
        )

    def _along(self, group: str, road: RoadDraft, where: str, span: Span) -> None:
        base: FieldPath = ("actors", group, "placement", "along")
        self._draft.put((*base, "road"), road.id, span)
        self._draft.put((*base, "where"), where, span)

    def roadgap(self, group: str, phrase: Phrase) -> None:
        roads = self.current or self.roads if phrase.has("EDGE") else self._roads_named(phrase)
        if not roads:
            self._draft.unread(phrase.span, "the text does not say of which road", expressible=True)
            return
        road, length = roads[0], length_of(self._draft, phrase)
        low, high = (0.0 if length.single else length.low), length.high
        if length.single and not phrase.first("WITHIN"):
            share = self._defaults.exact_share
            low, high = length.low * (1 - share), length.high * (1 + share)
        base: FieldPath = ("actors", group, "placement", "along")
        self._along(group, road, "beside", phrase.span)
        if phrase.first("ATLEAST"):
            self._draft.put((*base, "at_least_m"), length.low, phrase.span)
            self._unbounded.append((group, length.low))
            return
        self._draft.put((*base, "within_m"), round(high, 6), phrase.span)
        if low > 0:
            self._draft.put((*base, "at_least_m"), round(low, 6), phrase.span)

    def parallel(self, group: str, phrase: Phrase) -> None:
        """Turn a group along its road."""
        base: FieldPath = ("actors", group, "placement", "along")
        angle = phrase.first("ANGLE")
        if (
            (*base, "road") not in self._draft.entries
            or angle is None
            or not isinstance(angle.value, Quantity)
        ):
            self._draft.unread(phrase.span, "it takes a road, and `within` so many degrees", expressible=True)
            return
        self._draft.put((*base, "parallel_deg"), angle.value.high, phrase.span)

    def roadside(self, group: str, phrase: Phrase) -> None:
        """Put a group into the part of the area on one side of a road."""
        road, direction = self._roads_named(phrase)[0], phrase.first("DIR")
        assert direction is not None
        assert isinstance(direction.value, float | int)
        self._sides.append((group, road, float(direction.value), phrase.span))
        if phrase.first("LENGTH"):
            self.roadgap(group, phrase)

    def crossroads(self, group: str, phrase: Phrase) -> None:
        self._crossings.append((group, phrase.span))

    # At the end.

    def finish(self) -> None:
        """Lay out the roads in the finished area, and place the groups that depend on them."""
        if self._hinted is not None and not self.roads:
            self._draft.unread(self._hinted.span, "stands by itself", expressible=True)
        west, south, east, north = self._ground.box
        for group, low in self._unbounded:
            path: FieldPath = ("actors", group, "placement", "along", "within_m")
            self._draft.put(
                path,
                math.ceil(low + math.hypot(east - west, north - south)),
                None,
                "farther than the area goes",
            )
        if self._crossings:
            for _ in range(2 - len(self.roads)):
                self._new(Phrase("road", (), self._crossings[0][1]))
        self._defaults_of_axes()
        laid = {road.id: self._lay_out(road) for road in self.roads}
        for group, road, direction, span in self._sides:
            region = self._ground.beside_line((laid[road.id][0], laid[road.id][-1]), direction)
            if region is None:
                self._draft.unread(span, "the road runs that way")
                continue
            self._draft.put(
                ("actors", group, "placement", "region", "corners"),
                region,
                span,
                f"the area on that side of {road.id}",
            )
        for group, span in self._crossings:
            middle = _crossing(laid[self.roads[0].id], laid[self.roads[1].id])
            if middle is None:
                self._draft.unread(span, "these roads do not cross")
                continue
            base: FieldPath = ("actors", group, "placement", "distances")
            row = len({path[4] for path in self._draft.entries if path[:4] == base})
            self._draft.put((*base, row, "point"), middle, span)
            self._draft.put((*base, row, "max_m"), self._defaults.near_m, None, "the default for `near`")

    @property
    def laid_out(self) -> dict[str, list[Point]]:
        """Points of every road, once `finish` has laid them out."""
        return {
            road.id: self._draft.entries[("world", "roads", road.id, "points")].value for road in self.roads
        }

    def _defaults_of_axes(self) -> None:
        free = [road for road in self.roads if road.axis is None and not road.points and road.part is None]
        taken = [road.axis for road in self.roads if road.axis is not None]
        for road in free:
            road.axis = next((axis for axis in (WEST_TO_EAST, NORTH_TO_SOUTH) if axis not in taken), None)
            taken += [road.axis] if road.axis is not None else []

    def _lay_out(self, road: RoadDraft) -> list[Point]:
        base: FieldPath = ("world", "roads", road.id)
        self._draft.put((*base, "id"), road.id, road.span)
        points = road.points or self._line(road)
        span_of_line = road.points_span or road.axis_span or (road.span if road.part is not None else None)
        note = "" if road.points else self._note(road)
        self._draft.put((*base, "points"), points, span_of_line, note)
        width, span = road.width or (self._defaults.road_width_m, None)
        self._draft.put((*base, "width_m"), width, span)
        return points

    def _note(self, road: RoadDraft) -> str:
        through = (
            "through the middle of the area"
            if road.part is None
            else "through the middle of that part of the area"
        )
        return through if road.axis_span or road.part is not None else f"{through}, {_named(road.axis)}"

    def _line(self, road: RoadDraft) -> list[Point]:
        """A straight line from edge to edge through the centre of the area, or of the part in which the road
        lies.
        """
        west, south, east, north = self._ground.box
        middle_e, middle_n = (west + east) / 2, (south + north) / 2
        axis = road.axis
        if road.part is not None:
            radians = math.radians(road.part)
            middle_e += round(math.sin(radians), 6) * (east - west) / 4
            middle_n += round(math.cos(radians), 6) * (north - south) / 4
            axis = (NORTH_TO_SOUTH if road.part in (90, 270) else WEST_TO_EAST) if axis is None else axis
        radians = math.radians(WEST_TO_EAST if axis is None else axis)
        to_e, to_n = round(math.sin(radians), 9), round(math.cos(radians), 9)
        reach = min(
            (span / abs(to) for span, to in (((east - west) / 2, to_e), ((north - south) / 2, to_n)) if to),
            default=0.0,
        )
        if road.part is not None and road.axis is not None:
            reach = min(reach, *(abs(edge) for edge in (east - west, north - south)))
        sign = 1.0 if to_e > 0 or (to_e == 0 and to_n < 0) else -1.0
        return [
            {
                "east_m": round(middle_e + end * sign * reach * to_e, 3),
                "north_m": round(middle_n + end * sign * reach * to_n, 3),
            }
            for end in (-1.0, 1.0)
        ]


def _part(phrase: Phrase) -> Part | None:
    """The part of the area in which a road lies.

    In `north of the road` the first direction means something else.
    """
    candidates = phrase.every("DIR")[1 if phrase.rule == "roadside" else 0 :]
    return candidates[0] if candidates else None


def _named(axis: float | None) -> str:
    return "north to south" if axis == NORTH_TO_SOUTH else "west to east"


def _count(phrase: Phrase) -> int | None:
    part = phrase.first("COUNT")
    return int(part.value.low) if part is not None and isinstance(part.value, Quantity) else None


def _crossing(first: Sequence[Point], second: Sequence[Point]) -> Point | None:
    """Where two straight roads cross; None where they do not."""
    a, b, c, d = first[0], first[-1], second[0], second[-1]
    r = (b["east_m"] - a["east_m"], b["north_m"] - a["north_m"])
    s = (d["east_m"] - c["east_m"], d["north_m"] - c["north_m"])
    cross = r[0] * s[1] - r[1] * s[0]
    # Parallel roads.
    if abs(cross) < 1e-9:
        return None
    share = ((c["east_m"] - a["east_m"]) * s[1] - (c["north_m"] - a["north_m"]) * s[0]) / cross
    if not 0.0 <= share <= 1.0:
        return None
    return {"east_m": round(a["east_m"] + share * r[0], 3), "north_m": round(a["north_m"] + share * r[1], 3)}
