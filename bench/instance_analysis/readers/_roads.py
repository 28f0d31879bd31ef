"""Reads roads, and the groups on and beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .._draft import Draft, FieldPath
from ..language._grammar import Part
from ..language._tokens import Span
from ..language._vocabulary import Defaults
from ._ground import GroundReader
from ._groups import IMMOVABLE
from ._not_read import NotReadError
from ._places import PlaceReader, Point, across
from ._scene import Scene

WEST_TO_EAST, NORTH_TO_SOUTH = 90.0, 0.0


@dataclass(slots=True)
class Road:
    """A road under construction: its points, or its axis through the middle of the area."""

    id: str
    span: Span
    points: list[Point] = field(default_factory=list)
    axis: float | None = None
    width: tuple[float, Span] | None = None
    described: bool = False


class RoadReader:
    """The roads of a text. `finish` lays them out."""

    def __init__(
        self, draft: Draft, defaults: Defaults, ground: GroundReader, places: PlaceReader, scene: Scene
    ) -> None:
        self._draft, self._defaults, self._ground, self._places, self._scene = (
            draft,
            defaults,
            ground,
            places,
            scene,
        )
        self.roads: list[Road] = []
        self._travels: list[tuple[str, float, Span]] = []
        self._ways: list[tuple[str, Span]] = []

    def road(self, part: Part) -> None:
        """Read a road, or what is said of the one that the text has."""
        way, axis, width = part.first("way"), part.first("axis"), part.first("width")
        known = part.words[0] == "the" and bool(self.roads)
        road = self._only(part.span) if known else self._new(part.span)
        if way:
            road.points = [self._places.point(place) for place in way]
        road.axis = axis if axis is not None else road.axis
        if width is not None:
            road.width = (width.low, part.span)
        road.described = road.described or bool(way) or axis is not None
        self._draft.acknowledge(part.span)

    def _new(self, span: Span) -> Road:
        road = Road("road" if not self.roads else f"road-{len(self.roads) + 1}", span)
        self.roads.append(road)
        return road

    def _only(self, span: Span) -> Road:
        """The road that `the road` means; the text may name it before it tells where it runs."""
        if not self.roads:
            return self._new(span)
        if len(self.roads) == 1:
            return self.roads[0]
        return self.roads[self._draft.ask(span, "which road is meant?", [road.id for road in self.roads])]

    def place(self, group: str, part: Part, where: str) -> None:
        """Put a group on a road or beside it."""
        road = self._new(part.span) if "a" in part.words[:2] and where == "on" else self._only(part.span)
        base: FieldPath = ("actors", group, "placement", "along")
        self._draft.put((*base, "road"), road.id, part.span)
        self._draft.put((*base, "where"), where, part.span)
        length, most, least = part.first("length"), part.first("most"), part.first("least")
        if length is not None:
            share = self._defaults.exact_share if length.single else 0.0
            self._draft.put((*base, "at_least_m"), round(length.low * (1 - share), 6), part.span)
            self._draft.put((*base, "within_m"), round(length.high * (1 + share), 6), part.span)
        if most is not None:
            self._draft.put((*base, "within_m"), most.high, part.span)
        if least is not None:
            self._draft.put((*base, "at_least_m"), least.low, part.span)

    def along(self, group: str, part: Part) -> None:
        """`along the road`: what moves drives on it, what stands lines it."""
        kind = self._draft.entries.get(("actors", group, "motion", "kind"))
        stands = self._scene.asset(group) in IMMOVABLE or (kind is not None and kind.value == "still")
        self.place(group, part, "beside" if stands else "on")
        if kind is not None and not stands:
            self._ways.append((group, part.span))

    def parallel(self, group: str, part: Part) -> None:
        """Turn a group along its road."""
        base: FieldPath = ("actors", group, "placement", "along")
        if (*base, "road") not in self._draft.entries:
            raise NotReadError("the group has no road")
        self._draft.put((*base, "parallel_deg"), part.first("angle").high, part.span)

    def travel(self, group: str, heading_deg: float, span: Span) -> None:
        """Note that a group moves in a direction."""
        self._travels.append((group, heading_deg, span))

    def finish(self) -> None:
        """Lay the roads out, and the ways that follow them."""
        known = self._scene.groups
        self._travels = [travel for travel in self._travels if travel[0] in known]
        self._default_axes()
        for road in self.roads:
            self._lay_out(road)
        for group, heading_deg, span in self._travels:
            self._journey(group, heading_deg, span)
        for group, span in self._ways:
            if group in known and ("actors", group, "motion", "route") not in self._draft.entries:
                self.route(group, self._road_of(group) or [], span, "to the end of the road and back")

    def _default_axes(self) -> None:
        free = [road for road in self.roads if road.axis is None and not road.points]
        taken = [road.axis for road in self.roads if road.axis is not None]
        followed = [heading % 180 for _, heading, _ in self._travels]
        for road, axis in zip(free, [*followed, WEST_TO_EAST, NORTH_TO_SOUTH], strict=False):
            road.axis = (
                axis
                if axis not in taken
                else next((a for a in (WEST_TO_EAST, NORTH_TO_SOUTH) if a not in taken), 45.0)
            )
            taken.append(road.axis)

    def _lay_out(self, road: Road) -> None:
        base: FieldPath = ("world", "roads", road.id)
        self._draft.put((*base, "id"), road.id, road.span)
        # A road runs from west to east, and one without a side to either from north to south.
        points = road.points or across(self._ground.box, road.axis or 180.0)
        note = "" if road.points else "through the middle of the area"
        if not road.points and not road.described:
            note += f", {'north to south' if road.axis == NORTH_TO_SOUTH else 'west to east' if road.axis == WEST_TO_EAST else ''}".rstrip(
                ", "
            )
        self._draft.reading = road.span
        self._draft.put((*base, "points"), points, road.span if road.described else None, note)
        width, span = road.width or (self._defaults.road_width_m, None)
        self._draft.put((*base, "width_m"), width, span)

    def _road_of(self, group: str) -> list[Point] | None:
        along = self._draft.entries.get(("actors", group, "placement", "along", "road"))
        if along is None:
            return None
        points: list[Point] = self._draft.entries["world", "roads", along.value, "points"].value
        return points

    def _journey(self, group: str, heading_deg: float, span: Span) -> None:
        """The way of a group that moves in a direction: along its road, or else through the area."""
        points = self._road_of(group)
        if points is None:
            self._draft.remark(span, "through the middle of the area: the text does not say where")
            self.route(group, across(self._ground.box, heading_deg), span, "through the middle of the area")
            return
        east, north = (points[-1][axis] - points[0][axis] for axis in ("east_m", "north_m"))
        radians = math.radians(heading_deg)
        forwards = east * math.sin(radians) + north * math.cos(radians) >= 0.0
        self.route(group, points if forwards else points[::-1], span, "along its road")

    def route(self, group: str, points: list[Point], span: Span, note: str = "") -> None:
        """Let a group go along points."""
        base: FieldPath = ("actors", group, "motion")
        self._draft.forget((*base, "kind"))
        self._draft.put((*base, "kind"), "patrol", span)
        self._draft.put((*base, "route"), points, span, note)
