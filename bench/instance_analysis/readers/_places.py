"""Reads coordinates: the origin, the vehicle's home, groups at fixed places, and patrol routes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.simspec import Origin

from .._draft import Draft, FieldPath
from ..language._coordinates import Coordinates, local_m
from ..language._phrases import Part, Phrase, Quantity, stepped
from ..language._tokens import Span
from ..language._vocabulary import Defaults

Point = dict[str, float]
Box = tuple[float, float, float, float]
"""West, south, east and north, in metres."""
FARTHEST_M = 20_000.0
"""Degrees further than this from an origin that is not said are taken for another origin."""


class PlaceReader:
    """Reads coordinates into a draft.

    `finish` reconciles fixed places with the other relations of a group.
    """

    def __init__(self, draft: Draft, defaults: Defaults) -> None:
        self._draft, self._defaults = draft, defaults
        self._fixed: dict[str, tuple[Coordinates, Span]] = {}
        self._patrols: dict[str, Span] = {}
        self.travels: dict[str, tuple[float, Span]] = {}
        """Groups that move in a direction: where to, in degrees, and where the text says so."""

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

    def set_origin(self, phrase: Phrase) -> None:
        part = phrase.first("POINT")
        if part is None or not isinstance(part.value, Coordinates) or not part.value.degrees:
            self._draft.unread(phrase.span, "an origin is given in degrees of latitude and longitude")
            return
        self._put_origin(part.value, phrase.span, "")

    def _put_origin(self, place: Coordinates, span: Span, note: str) -> None:
        self._draft.put(("world", "origin", "latitude_deg"), round(place.first, 7), span, note)
        self._draft.put(("world", "origin", "longitude_deg"), round(place.second, 7), span, note)

    def origin_of(self, phrases: Sequence[Phrase]) -> None:
        """Use the first place in degrees as origin when the text states none and the default is far away."""
        if ("world", "origin", "latitude_deg") in self._draft.entries:
            return
        for phrase in phrases:
            for part in phrase.leaves:
                if part.kind == "POINT" and isinstance(part.value, Coordinates) and part.value.degrees:
                    if math.hypot(*local_m(part.value, Origin())) > FARTHEST_M:
                        note = "no origin is said: the first place in degrees"
                        self._draft.remark(part.span, f"{note} is the origin")
                        self._put_origin(part.value, part.span, note)
                    return

    def set_home(self, phrase: Phrase) -> None:
        place = self.place_of(phrase)
        if place is None:
            return
        for name, value in self.point(place).items():
            self._draft.put(("vehicle", "home", name), value, phrase.span, self._converted(place))

    def home_heading(self, phrase: Phrase) -> None:
        if direction := phrase.first("DIR"):
            self._draft.put(("vehicle", "home", "heading_deg"), direction.value, phrase.span)

    def _converted(self, place: Coordinates) -> str:
        if not place.degrees:
            return ""
        at = self.origin
        return f"from the origin at {at.latitude_deg:g}, {at.longitude_deg:g} degrees"

    def place_of(self, phrase: Phrase) -> Coordinates | None:
        """The first place that a phrase states; None when it is relative to a group, whose place is not known
        yet.
        """
        part = phrase.first("POINT")
        if part is not None and isinstance(part.value, Coordinates):
            return part.value
        if phrase.refs and not (phrase.refs[0].first("HOME") or phrase.refs[0].first("ORIGIN")):
            return None
        at_home = bool(phrase.refs) and not phrase.refs[0].first("ORIGIN")
        return Coordinates(*self.steps(phrase), from_home=at_home)

    def steps(self, phrase: Phrase) -> tuple[float, float]:
        """Metres east and north of `120 m east and 40 m south`."""
        east = north = 0.0
        for length, direction in zip(phrase.every("LENGTH"), phrase.every("DIR"), strict=True):
            assert isinstance(length.value, Quantity)
            assert isinstance(direction.value, float | int)
            if not length.value.single:
                self._draft.fault(phrase.span, "a place is one, not a range", "give one number of each")
            east, north = stepped(east, north, length.value, float(direction.value))
        return east, north

    def box(self, phrase: Phrase) -> list[Point] | None:
        """Two opposite corners of `60 to 120 m west and 20 to 80 m south of home`; None for any other phrase."""
        lengths = [part for part in phrase.parts if isinstance(part, Part) and part.kind == "LENGTH"]
        ranges = [length.value for length in lengths if isinstance(length.value, Quantity)]
        of_home = all(ref.has("HOME", "ORIGIN") for ref in phrase.refs)
        if len(ranges) != 2 or any(length.single for length in ranges) or not of_home:
            return None
        corners: list[Point] = []
        for end in ("low", "high"):
            east = north = 0.0
            for length, direction in zip(ranges, phrase.every("DIR"), strict=True):
                step = Quantity("LENGTH", getattr(length, end), getattr(length, end))
                assert isinstance(direction.value, float | int)
                east, north = stepped(east, north, step, float(direction.value))
            from_home = bool(phrase.refs) and phrase.refs[0].first("HOME") is not None
            corners.append(self.point(Coordinates(east, north, from_home=from_home)))
        return corners

    def stand(self, group: str, place: Coordinates, span: Span) -> None:
        """Fix the place of a group with one member."""
        if group in self._fixed and self._fixed[group][0] != place:
            self._draft.unread(span, "another place was given before", expressible=True)
            return
        self._fixed[group] = (place, span)

    def fixed(self, group: str) -> Point | None:
        """The stated coordinates of a group, or None."""
        return self.point(self._fixed[group][0]) if group in self._fixed else None

    # Ways.

    def patrol(self, group: str, span: Span) -> None:
        """Note that a group patrols; the route may follow elsewhere in the text."""
        self._patrols.setdefault(group, span)

    def patrols(self, group: str) -> bool:
        """Whether the text says that a group goes from somewhere to somewhere."""
        return group in self._patrols

    def travel(self, group: str, heading_deg: float, span: Span) -> None:
        """Note that a group moves in a direction; its road or the area may follow elsewhere in the text."""
        self.travels[group] = (heading_deg, span)

    def walk(self, group: str, places: Sequence[Coordinates], span: Span) -> None:
        self._route(group, [self.point(place) for place in places], span)

    def _route(self, group: str, points: list[Point], span: Span, note: str = "") -> None:
        base: FieldPath = ("actors", group, "motion")
        self._draft.forget((*base, "kind"))
        self._draft.put((*base, "kind"), "patrol", span)
        self._draft.put((*base, "route"), points, span, note)

    # At the end.

    def finish(self, roads: dict[str, list[Point]], box: Box) -> None:
        """Complete patrols along roads, journeys in a direction, and the relations of groups at fixed
        places.
        """
        for group, (heading_deg, span) in self.travels.items():
            self._journey(group, heading_deg, span, roads, box)
        for group, span in self._patrols.items():
            if ("actors", group, "motion", "route") in self._draft.entries:
                continue
            along = self._draft.entries.get(("actors", group, "placement", "along", "road"))
            if along is not None and along.value in roads:
                self._route(group, roads[along.value], span, "to the end of the road and back")
            elif ("actors", group, "motion", "kind") in self._draft.entries:
                self._draft.remark(
                    span, "a patrol without points: walks about, within 25 m of where it starts"
                )
        for group, (place, span) in self._fixed.items():
            self._stand(group, place, span)

    def _journey(
        self, group: str, heading_deg: float, span: Span, roads: dict[str, list[Point]], box: Box
    ) -> None:
        """Lay out the way of a group that moves in a direction: along its road, or else through the area."""
        kind = self._draft.entries.get(("actors", group, "motion", "kind"))
        if (
            kind is None
            or kind.value == "still"
            or ("actors", group, "motion", "route") in self._draft.entries
        ):
            return
        along = self._draft.entries.get(("actors", group, "placement", "along", "road"))
        if along is None or along.value not in roads:
            self._draft.remark(span, "through the middle of the area: the text does not say where")
            self._route(group, across(box, heading_deg), span, "through the middle of the area")
            return
        points = roads[along.value]
        east, north = (points[-1][axis] - points[0][axis] for axis in ("east_m", "north_m"))
        radians = math.radians(heading_deg)
        forwards = east * math.sin(radians) + north * math.cos(radians) >= 0.0
        self._route(group, points if forwards else points[::-1], span, "along its road")

    def _stand(self, group: str, place: Coordinates, span: Span) -> None:
        base: FieldPath = ("actors", group, "placement")
        count = self._draft.entries.get(("actors", group, "count"))
        point, note = self.point(place), self._converted(place)
        if (
            count is None
            or count.value != 1
            or any(f"actors[{group}].count" in varied.paths for varied in self._draft.ranges)
        ):
            # A SimSpec has coordinates only for a group of one.
            self._draft.remark(span, "several members cannot stand at one point: they stand near it")
            number = len({path[4] for path in self._draft.entries if path[:4] == (*base, "distances")})
            self._draft.put((*base, "distances", number, "point"), point, span, note)
            self._draft.put(
                (*base, "distances", number, "max_m"), self._defaults.near_m, None, "the default for `near`"
            )
            return
        facing: FieldPath = (*base, "facing", "heading_deg")
        heading = self._draft.entries.get(facing)
        self._draft.forget(facing)
        self._list_relations(group)
        for name, value in point.items():
            self._draft.put((*base, "at", name), value, span, note)
        if heading is not None:
            self._draft.put((*base, "at", "heading_deg"), heading.value, heading.span)

    def _list_relations(self, group: str) -> None:
        """List the other relations of a fixed group as unread."""
        base: FieldPath = ("actors", group, "placement")
        placed = {
            path[:4]
            for path in self._draft.entries
            if path[:3] == base and len(path) > 3 and path[3] not in ("at", "separation_m")
        }
        for relation in sorted(placed, key=str):
            span = next(
                (
                    entry.span
                    for path, entry in self._draft.entries.items()
                    if path[:4] == relation and entry.span
                ),
                Span(0, 0),
            )
            self._draft.forget(relation)
            if relation[3] in ("region", "along", "inside"):
                self._draft.remark(span, "its place is fixed by coordinates, which says this")
            else:
                self._draft.unread(span, "the place of this group is fixed by coordinates")


def across(box: Box, heading_deg: float) -> list[Point]:
    """A straight line from edge to edge through the middle of a box, in a direction."""
    west, south, east, north = box
    middle_e, middle_n = (west + east) / 2, (south + north) / 2
    radians = math.radians(heading_deg)
    to_e, to_n = round(math.sin(radians), 9), round(math.cos(radians), 9)
    reach = min(
        (half / abs(to) for half, to in (((east - west) / 2, to_e), ((north - south) / 2, to_n)) if to),
        default=0.0,
    )
    return [
        {
            "east_m": round(middle_e + end * reach * to_e, 3),
            "north_m": round(middle_n + end * reach * to_n, 3),
        }
        for end in (-1.0, 1.0)
    ]


def places_in(phrase: Phrase) -> list[Coordinates]:
    """Every place that a phrase states, in order."""
    points = [part for part in phrase.leaves if part.kind == "POINT"]
    return [part.value for part in points if isinstance(part.value, Coordinates)]


def count_places(phrase: Phrase) -> int:
    """How many places a phrase states. They do not count as used."""
    return sum(part.kind == "POINT" for part in phrase.leaves)
