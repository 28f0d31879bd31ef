"""Where the rules let the vehicle fly, and ways round what they forbid. Pure: places in, places out.

Every forbidden thing is a convex block with its margin already on it: a no-fly area is the hull of its
corners, and the geofence is one thin block along each of its edges. The shortest way goes from corner to
corner of blocks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Protocol, Self

from bench.contracts import MissionOrder
from bench.polygons import is_inside
from bench.values import value_class

from ._paths import Place
from ._routes import shortest_route

# For errors of place and for corners that are cut in a turn. Chosen, not measured.
NO_FLY_MARGIN_M = 25.0
# Less than round no-fly areas: home may be near the fence. Chosen, not measured.
FENCE_MARGIN_M = 15.0
# An area is kept free this long before it comes into force: it has to be left by then. Chosen, not measured.
LEAD_S = 45.0
# Of the ring round a corner: eight sides exceed the margin by 8 % at most.
SIDES = 8
# The border itself may be flown along; below this a crossing is rounding.
TOUCH_M = 1e-6


TimedArea = tuple[float, float | None, Sequence[Place]]


class Corner(Protocol):
    """A point of a mission order, or of a SimSpec."""

    @property
    def east_m(self) -> float: ...
    @property
    def north_m(self) -> float: ...


@value_class(frozen=True, slots=True)
class Block:
    """A convex polygon, counterclockwise, that no way may lead through. Its border may be flown along."""

    corners: tuple[Place, ...]

    def holds(self, place: Place) -> bool:
        """Whether a place lies inside, the border left out."""
        return all(_side_m(a, b, place) > TOUCH_M for a, b in _edges(self.corners))

    def cuts(self, a: Place, b: Place) -> bool:
        """Whether the straight way from a to b leads through the inside (Cyrus and Beck's clipping)."""
        enter, leave = 0.0, 1.0
        for corner, following in _edges(self.corners):
            at_a, at_b = _side_m(corner, following, a) - TOUCH_M, _side_m(corner, following, b) - TOUCH_M
            if at_a <= 0.0 and at_b <= 0.0:
                return False
            if at_a < 0.0:
                enter = max(enter, at_a / (at_a - at_b))
            elif at_b < 0.0:
                leave = min(leave, at_a / (at_a - at_b))
        return leave - enter > 1e-9

    def nearest_border(self, place: Place) -> list[Place]:
        """The foot on each edge, for finding the way out."""
        return [_foot(a, b, place) for a, b in _edges(self.corners)]


def block_round(corners: Sequence[Place], margin_m: float) -> Block:
    """The convex hull of these corners, wider by at least `margin_m` on every side."""
    reach_m = margin_m / math.cos(math.pi / SIDES)
    turns = [2.0 * math.pi * (k + 0.5) / SIDES for k in range(SIDES)]
    return Block(
        _hull([(e + reach_m * math.cos(t), n + reach_m * math.sin(t)) for e, n in corners for t in turns])
    )


@dataclass(frozen=True)
class Airspace:
    """What is forbidden at one time. `fence` is None, or the corners of the area to keep inside."""

    blocks: tuple[Block, ...] = ()
    fence: tuple[Place, ...] | None = None

    def allows(self, place: Place) -> bool:
        """Whether a place may be flown over, margins included."""
        return (self.fence is None or is_inside(place, self.fence)) and not any(
            block.holds(place) for block in self.blocks
        )

    def clear(self, a: Place, b: Place) -> bool:
        """Whether the straight way between two places is free."""
        return not any(block.cuts(a, b) for block in self.blocks)

    def nearest(self, place: Place) -> Place:
        """The nearest place that is allowed; the place itself where it is, or where nothing is."""
        if self.allows(place):
            return place
        feet = [foot for block in self.blocks for foot in block.nearest_border(place)]
        allowed = [candidate for candidate in [*feet, *self.nodes] if self.allows(candidate)]
        return min(allowed, key=lambda candidate: (math.dist(candidate, place), candidate), default=place)

    def route(self, a: Place, b: Place) -> list[Place]:
        """The shortest way from a to b by straight legs, both ends included.

        An end that is forbidden is reached from, or left to, the nearest allowed place. Without any way:
        straight on.
        """
        if not self.blocks or (self.allows(a) and self.allows(b) and self.clear(a, b)):
            return [a, b]
        begin, end = self.nearest(a), self.nearest(b)
        way = [*([a] if begin != a else []), *self._shortest(begin, end), *([b] if end != b else [])]
        return way if len(way) > 1 else [a, b]

    def path(self, waypoints: Sequence[Place]) -> list[Place]:
        """The same path with every forbidden waypoint moved to the nearest allowed place, and the ways
        between them routed.

        The first waypoint is where the vehicle is, and stays.
        """
        if not self.blocks and self.fence is None:
            return list(waypoints)
        moved = [waypoints[0], *(self.nearest(waypoint) for waypoint in waypoints[1:])]
        path = [moved[0]]
        for a, b in pairwise(moved):
            path += self.route(a, b)[1:] if math.dist(a, b) > TOUCH_M else []
        return path if len(path) > 1 else [*path, moved[-1]]

    def length_m(self, a: Place, b: Place) -> float:
        """Length of the way from a to b."""
        return sum(math.dist(leg_begin, leg_end) for leg_begin, leg_end in pairwise(self.route(a, b)))

    @cached_property
    def _clear_pairs(self) -> dict[tuple[int, int], bool]:
        return {}

    @cached_property
    def nodes(self) -> tuple[Place, ...]:
        """Corners of blocks that may be flown over: ways bend there."""
        return tuple(corner for block in self.blocks for corner in block.corners if self.allows(corner))

    def _shortest(self, begin: Place, end: Place) -> list[Place]:
        nodes = [begin, end, *self.nodes]

        def clear(a: int, b: int) -> bool:
            # Corners stay: whether two of them see each other is worked out once, ends anew for each way.
            if min(a, b) < 2:
                return self.clear(nodes[a], nodes[b])
            pair = (min(a, b), max(a, b))
            if pair not in self._clear_pairs:
                self._clear_pairs[pair] = self.clear(nodes[pair[0]], nodes[pair[1]])
            return self._clear_pairs[pair]

        return shortest_route(begin, end, self.nodes, clear)


class Airspaces:
    """The airspace as it changes with time: no-fly areas come into force and go out of it."""

    def __init__(self, areas: Sequence[TimedArea], fence: Sequence[Place] | None) -> None:
        """`areas` have when they come into force and go out of it (None: never), and their corners."""
        self._areas = [
            (from_s - LEAD_S, until_s, block_round(corners, NO_FLY_MARGIN_M))
            for from_s, until_s, corners in areas
        ]
        self._fence = None if fence is None else tuple(fence)
        self._edges = [block_round(edge, FENCE_MARGIN_M) for edge in _edges(fence or ())]
        self._known: dict[tuple[bool, ...], Airspace] = {}

    @classmethod
    def of(cls, order: MissionOrder) -> Self:
        """The airspace that a mission order allows."""
        areas = [(area.from_s, area.until_s, places_of(area.corners)) for area in order.no_fly]
        return cls(areas, None if order.geofence is None else places_of(order.geofence))

    def at(self, now_s: float) -> Airspace:
        """The airspace of a moment; the same object as long as nothing changes."""
        in_force = tuple(
            from_s <= now_s and (until_s is None or now_s < until_s) for from_s, until_s, _ in self._areas
        )
        if in_force not in self._known:
            blocks = [block for (_, _, block), holds in zip(self._areas, in_force, strict=True) if holds]
            self._known[in_force] = Airspace((*blocks, *self._edges), self._fence)
        return self._known[in_force]


def places_of(corners: Sequence[Corner]) -> list[Place]:
    """Corners of a document as places."""
    return [(corner.east_m, corner.north_m) for corner in corners]


def _edges(corners: Sequence[Place]) -> list[tuple[Place, Place]]:
    return list(zip(corners, [*corners[1:], *corners[:1]], strict=True))


def _side_m(a: Place, b: Place, place: Place) -> float:
    """How far left of the line from a to b a place lies."""
    length_m = math.dist(a, b)
    if length_m < TOUCH_M:
        return math.inf
    return ((b[0] - a[0]) * (place[1] - a[1]) - (b[1] - a[1]) * (place[0] - a[0])) / length_m


def _foot(a: Place, b: Place, place: Place) -> Place:
    """The nearest point of the stretch from a to b."""
    along = (b[0] - a[0], b[1] - a[1])
    square = along[0] ** 2 + along[1] ** 2
    share = ((place[0] - a[0]) * along[0] + (place[1] - a[1]) * along[1]) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return a[0] + share * along[0], a[1] + share * along[1]


def _hull(places: Sequence[Place]) -> tuple[Place, ...]:
    """Convex hull, counterclockwise (Andrew's monotone chain)."""
    ordered = sorted(set(places))

    def chain(points: Sequence[Place]) -> list[Place]:
        hull: list[Place] = []
        for point in points:
            while len(hull) > 1 and _turn(hull[-2], hull[-1], point) <= 1e-9:
                hull.pop()
            hull.append(point)
        return hull[:-1]

    return (*chain(ordered), *chain(ordered[::-1]))


def _turn(a: Place, b: Place, c: Place) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
