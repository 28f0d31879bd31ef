"""Reads phrases about roads: how many, their direction, and the groups on, beside or off them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from .._draft import Draft, FieldPath
from ..language._coordinates import Coordinates
from ..language._phrases import Part, Phrase, Quantity, stepped
from ..language._tokens import Span
from ..language._vocabulary import Defaults
from ._ground import GroundReader
from ._places import PlaceReader, Point, across, places_in
from ._traits import DIRECTIONS, IMMOVABLE, length_of

WEST_TO_EAST, NORTH_TO_SOUTH = 90.0, 0.0


@dataclass(slots=True)
class RoadDraft:
    """A road under construction: its direction or its points."""

    id: str
    span: Span
    axis: float | None = None
    axis_span: Span | None = None
    points: list[Point] = field(default_factory=list)
    points_span: Span | None = None
    width: tuple[float, Span] | None = None
    length: tuple[float, Span] | None = None


class RoadReader:
    """The roads of a text. `finish` lays them out. `current` are the roads mentioned last."""

    RULES = frozenset(["road", "roadgap", "parallel"])
    """What is said of a group."""

    def __init__(self, draft: Draft, defaults: Defaults, ground: GroundReader, places: PlaceReader) -> None:
        self._draft, self._defaults, self._ground, self._places = draft, defaults, ground, places
        self.roads: list[RoadDraft] = []
        self.current: list[RoadDraft] = []
        self._resolve: dict[Span, RoadDraft] = {}
        self._hinted: Phrase | None = None
        """`the road` before anything is said of it."""
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
        return not phrase.has("COUNT", "AXIS", "LENGTH")

    def _definite(self, phrase: Phrase) -> bool:
        kinds = ("COUNT", "LENGTH", "AXIS", "NTH", "ROAD", "THEM")
        begin = min(
            (part.span.start for kind in kinds for part in phrase.every(kind)), default=phrase.span.start
        )
        before = self._draft.text[:begin].lower().split()
        return bool(before) and before[-1] in ("the", "this", "that")

    def _roads_named(self, phrase: Phrase) -> list[RoadDraft]:
        number = _count(phrase)
        described = phrase.has("AXIS") and not self._fitting(phrase)
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
        if phrase.rule in ("exact", "within", "atleast"):
            return Phrase(
                "roadgap", tuple(part for part in phrase.parts if isinstance(part, Part)), phrase.span
            )
        side = phrase.first("ALONG") or Part("BESIDE", None, phrase.span)
        return Phrase("road", (side,), phrase.span)

    def _fitting(self, phrase: Phrase) -> list[RoadDraft]:
        """The known roads that a phrase describes."""
        candidates = self.roads
        if nth := phrase.first("NTH"):
            assert isinstance(nth.value, int | float)
            return candidates[int(nth.value) - 1 : int(nth.value)]
        if axis := phrase.first("AXIS"):
            return [road for road in candidates if road.axis == axis.value]
        return []

    def _new(self, phrase: Phrase) -> RoadDraft:
        road = RoadDraft("road" if not self.roads else f"road-{len(self.roads) + 1}", phrase.span)
        self.roads.append(road)
        self._describe(road, phrase)
        return road

    def _describe(self, road: RoadDraft, phrase: Phrase) -> None:
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
        free = [road for road in self.current if road.axis is None and not road.points]
        free = free or [road for road in self.roads if road.axis is None and not road.points]
        if not free:
            self._draft.unread(phrase.span, "the text does not say which road", expressible=True)
            return
        part = phrase.first("AXIS") or phrase.every("DIR")[-1]
        assert isinstance(part.value, float | int)
        free[0].axis, free[0].axis_span = float(part.value) % 180, phrase.span

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
        if free and direction is None and start is None and length.single:
            free[0].length = (length.low, phrase.span)
            return
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
        beside = phrase.first("BESIDE") or phrase.first("BESIDEIT") or self._lines_it(group, phrase)
        self._along(group, self._roads_named(phrase)[0], "beside" if beside else "on", phrase.span)

    def _lines_it(self, group: str, phrase: Phrase) -> bool:
        """Whether `along the road` means beside it: what does not move stands at its side."""
        part = phrase.first("ALONG")
        if part is None or self._draft.quote(part.span).lower() not in ("along", "lining"):
            return False
        asset = self._draft.entries["actors", group, "asset"].value
        kind = self._draft.entries.get(("actors", group, "motion", "kind"))
        return asset in IMMOVABLE or (kind is not None and kind.value == "still")

    def _along(self, group: str, road: RoadDraft, where: str, span: Span) -> None:
        base: FieldPath = ("actors", group, "placement", "along")
        self._draft.put((*base, "road"), road.id, span)
        self._draft.put((*base, "where"), where, span)

    def roadgap(self, group: str, phrase: Phrase) -> None:
        of_the_last = phrase.has("EDGE") or not phrase.has("ROAD")
        roads = self.current or self.roads if of_the_last else self._roads_named(phrase)
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

    # At the end.

    def finish(self, travels: Mapping[str, tuple[float, Span]]) -> None:
        """Lay out the roads in the finished area, and place the groups that depend on them."""
        self._follow(travels)
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
        self._defaults_of_axes()
        for road in self.roads:
            self._lay_out(road)

    @property
    def laid_out(self) -> dict[str, list[Point]]:
        """Points of every road, once `finish` has laid them out."""
        return {
            road.id: self._draft.entries[("world", "roads", road.id, "points")].value for road in self.roads
        }

    def _follow(self, travels: Mapping[str, tuple[float, Span]]) -> None:
        """Let a road without a course run the way in which a group moves on it."""
        for group, (heading_deg, span) in travels.items():
            along = self._draft.entries.get(("actors", group, "placement", "along", "road"))
            for road in self.roads:
                if along is not None and along.value == road.id and road.axis is None and not road.points:
                    road.axis, road.axis_span = heading_deg % 180, span

    def _defaults_of_axes(self) -> None:
        free = [road for road in self.roads if road.axis is None and not road.points]
        taken = [road.axis for road in self.roads if road.axis is not None]
        for road in free:
            road.axis = next((axis for axis in (WEST_TO_EAST, NORTH_TO_SOUTH) if axis not in taken), None)
            taken += [road.axis] if road.axis is not None else []

    def _lay_out(self, road: RoadDraft) -> None:
        base: FieldPath = ("world", "roads", road.id)
        self._draft.put((*base, "id"), road.id, road.span)
        through = "" if road.points else "through the middle of the area"
        note = through if road.points or road.axis_span else f"{through}, {_named(road.axis)}"
        self._draft.put(
            (*base, "points"),
            road.points or self._line(road),
            road.points_span or road.axis_span or (road.length[1] if road.length else None),
            note,
        )
        width, span = road.width or (self._defaults.road_width_m, None)
        self._draft.put((*base, "width_m"), width, span)

    def _line(self, road: RoadDraft) -> list[Point]:
        """A straight line from edge to edge through the centre of the area."""
        degrees = WEST_TO_EAST if road.axis is None else road.axis
        # A road runs from west to east, and one without a side to either from north to south.
        line = across(self._ground.box, degrees or 180.0)
        if road.length is None:
            return line
        length_m, span = road.length
        self._draft.acknowledge(span)
        self._draft.remark(
            span, "its middle is the middle of the area: the text does not say where it begins"
        )
        whole_m = math.dist(line[0].values(), line[1].values())
        middle = {axis: (line[0][axis] + line[1][axis]) / 2 for axis in line[0]}
        share = length_m / whole_m
        return [
            {axis: round(middle[axis] + (end[axis] - middle[axis]) * share, 3) for axis in end}
            for end in line
        ]


def _named(axis: float | None) -> str:
    return "north to south" if axis == NORTH_TO_SOUTH else "west to east"


def _count(phrase: Phrase) -> int | None:
    part = phrase.first("COUNT")
    return int(part.value.low) if part is not None and isinstance(part.value, Quantity) else None
