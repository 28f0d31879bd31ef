"""How actors move: each walks legs of its own seeded plan, and where it is depends on the time alone.

A plan is an iterator of legs, asked for the next one when the present leg is over; how often the crowd is
advanced changes nothing. Movers do not avoid each other; they keep to the ground that is open to them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bench.polygons import is_inside
from bench.simspec import Motion, Polygon

from ._box_intersection import crosses_rectangle

Place = tuple[float, float]

MAX_ATTEMPTS = 8
"""Waypoints drawn for one wandering leg. If none can be reached, the walker rests and tries again later."""

MIN_STAY_S = 0.25
"""Arrivals are at least this far apart, so that a tiny radius or a route of equal points cannot stop time."""

MIN_BLOCKED_REST_S = 1.0
"""Least rest of a walker that found no reachable waypoint."""

INSET_M = 0.5
"""How far beyond the border route points are drawn that lie outside the area."""


@dataclass(frozen=True, slots=True)
class WalkLeg:
    """A stretch at constant velocity that ends at `end_enu_m`, or a rest when that is where it began."""

    duration_s: float
    end_enu_m: Place


Edge = tuple[float, float, float, float]
"""East and north of the one end of an edge of the area, then of the other."""

Solid = tuple[float, float, float, float, float, float]
"""East and north of a solid's middle, its forward axis, and half its length along and across that."""


@dataclass(frozen=True, slots=True)
class WalkableGround:
    """Where movers may go: inside the area, and through no solid box.

    `corners_m` (e, 2) are the area's; `centres_m`, `forward` (s, 2) and `half_m` (s, 2) describe the solids' footprints,
    half lengths along `forward` and across it.
    """

    corners_m: NDArray[np.float64]
    centres_m: NDArray[np.float64]
    forward: NDArray[np.float64]
    half_m: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        area: Polygon,
        centres_m: NDArray[np.float64],
        headings_rad: NDArray[np.float64],
        half_m: NDArray[np.float64],
    ) -> Self:
        """The ground of an area with solid footprints on it."""
        corners = np.array([(corner.east_m, corner.north_m) for corner in area.corners])
        return cls(
            corners, centres_m, np.stack((np.sin(headings_rad), np.cos(headings_rad)), axis=-1), half_m
        )

    def around(self, start: Place, reach_m: float, margin_m: float) -> ReachableGround:
        """The part that matters to one mover. A mover that starts outside the area is not bound by it."""
        distance = np.hypot(*(self.centres_m - start).T)
        # Solids that no leg of this mover can touch are dropped once, instead of being tested for every leg.
        in_reach = distance <= reach_m + margin_m + np.hypot(*self.half_m.T)
        solids = np.concatenate((self.centres_m, self.forward, self.half_m), axis=1)[in_reach]
        # The last edge closes the polygon.
        edges = np.concatenate((self.corners_m, np.roll(self.corners_m, -1, axis=0)), axis=1)
        ground = ReachableGround(
            tuple((e0, n0, e1, n1) for e0, n0, e1, n1 in edges.tolist()),
            tuple((e, n, fe, fn, along, across) for e, n, fe, fn, along, across in solids.tolist()),
            margin_m,
        )
        # Otherwise no leg could ever leave the start, and the actor would stand for the whole session.
        return ground if ground.inside(start) else replace(ground, edges=())


@dataclass(frozen=True, slots=True)
class ReachableGround:
    """The ground of one mover: edges of the area, none where it does not bind, solids, and the room it needs.

    Plain numbers: legs are judged one at a time, and arrays so small cost ten times as much.
    """

    edges: tuple[Edge, ...]
    solids: tuple[Solid, ...]
    margin_m: float

    def open_to(self, start: Place, end: Place) -> bool:
        """Whether the straight leg from `start` to `end` can be walked."""
        return (
            self.inside(end)
            and not any(_crosses_edge(start, end, edge) for edge in self.edges)
            and not any(self._meets(start, end, solid) for solid in self.solids)
        )

    def drawn_inside(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k, 2) the points; those outside are moved to the border and `INSET_M` further."""
        outside = np.array(
            [not self.inside((east, north)) for east, north in points.tolist()], dtype=np.bool_
        )
        if not outside.any():
            return points
        edges = np.array(self.edges)
        first = edges[:, :2]
        along = edges[:, 2:] - first
        offset = points[outside][:, None, :] - first
        share = np.clip(
            (offset * along).sum(axis=-1) / np.maximum((along * along).sum(axis=-1), 1e-12), 0.0, 1.0
        )
        way = share[..., None] * along - offset
        length = np.hypot(way[..., 0], way[..., 1])
        nearest = (np.arange(len(way)), length.argmin(axis=1))
        drawn = points.copy()
        drawn[outside] += way[nearest] * (1.0 + INSET_M / np.maximum(length[nearest], 1e-9))[:, None]
        return drawn

    def inside(self, place: Place) -> bool:
        """Whether a place is in the area; true where nothing binds."""
        return not self.edges or is_inside(place, [edge[:2] for edge in self.edges])

    def _meets(self, start: Place, end: Place, solid: Solid) -> bool:
        *_, half_along_m, half_across_m = solid
        begin, finish = _beside(start, solid), _beside(end, solid)
        along_m, across_m = half_along_m + self.margin_m, half_across_m + self.margin_m
        # A mover that was placed closer than its margin may walk away, though never through the solid itself.
        if abs(begin[0]) <= along_m and abs(begin[1]) <= across_m:
            along_m, across_m = half_along_m, half_across_m
        return crosses_rectangle(begin, finish, (along_m, across_m))


def _crosses_edge(start: Place, end: Place, edge: Edge) -> bool:
    """Whether a leg properly crosses an edge: the ends of each lie strictly on both sides of the other."""
    first, second = edge[:2], edge[2:]
    return (
        _side(start, end, first) * _side(start, end, second) < 0.0
        and _side(first, second, start) * _side(first, second, end) < 0.0
    )


def _beside(place: Place, solid: Solid) -> Place:
    """Along and across a solid, from its middle."""
    east, north = place[0] - solid[0], place[1] - solid[1]
    return east * solid[2] + north * solid[3], east * solid[3] - north * solid[2]


def _side(a: Place, b: Place, p: Place) -> float:
    """Positive when p lies left of the line from a to b."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def wander(
    start: Place, motion: Motion, ground: ReachableGround, rng: np.random.Generator
) -> Iterator[WalkLeg]:
    """Walks to points uniform in a disc round `start`, with exponential pauses of mean `pause_s`.

    Every leg takes the same number of draws, whether or not a way was found.
    """
    position = start
    while True:
        # All attempts are drawn at once: how many fail must not shift the draws of the legs that follow.
        draws = rng.random((MAX_ATTEMPTS, 2))
        pause_s = motion.pause_s * float(rng.standard_exponential())
        # The square root makes the points uniform over the disc; without it they would crowd at its centre.
        distance = motion.radius_m * np.sqrt(draws[:, 0])
        bearing = 2.0 * math.pi * draws[:, 1]
        points = np.array(start) + np.stack((distance * np.sin(bearing), distance * np.cos(bearing)), axis=-1)
        places = ((east, north) for east, north in points.tolist())
        target = next((place for place in places if ground.open_to(position, place)), None)
        if target is not None:
            yield from _walk(position, target, motion.speed_mps, pause_s)
            position = target
        else:
            yield WalkLeg(max(pause_s, MIN_BLOCKED_REST_S), position)


def patrol(
    start: Place, motion: Motion, ground: ReachableGround, rng: np.random.Generator
) -> Iterator[WalkLeg]:
    """Walks the route in a loop from its point nearest to `start`; skips points out of reach.

    Stands still for the rest of the session when it can reach none, because the ground does not change.
    """
    points = ground.drawn_inside(np.array([(point.east_m, point.north_m) for point in motion.route]))
    route = [(east, north) for east, north in points.tolist()]
    count = len(route)
    next_index = int(np.argmin(np.hypot(*(points - start).T)))
    position = start
    while True:
        pause_s = motion.pause_s * float(rng.standard_exponential())
        # A point that is out of reach is skipped for this leg only: from the next place it may be reachable.
        order = (next_index + skipped for skipped in range(count))
        reachable = next(
            (index % count for index in order if ground.open_to(position, route[index % count])),
            None,
        )
        if reachable is None:
            return
        target = route[reachable]
        yield from _walk(position, target, motion.speed_mps, pause_s)
        position, next_index = target, reachable + 1


def between(plan: Iterator[WalkLeg], start: Place, depart_s: float, halt_s: float) -> Iterator[WalkLeg]:
    """The plan begun at `depart_s` and cut off at `halt_s`; the draws of the plan stay what they were."""
    if depart_s > 0.0:
        yield WalkLeg(depart_s, start)
    now_s, position = depart_s, start
    for leg in plan:
        left_s = halt_s - now_s
        if leg.duration_s >= left_s:
            share = left_s / leg.duration_s
            end = tuple(a + share * (b - a) for a, b in zip(position, leg.end_enu_m, strict=True))
            yield WalkLeg(left_s, (end[0], end[1]))
            return
        yield leg
        now_s, position = now_s + leg.duration_s, leg.end_enu_m


def _walk(start: Place, end: Place, speed_mps: float, pause_s: float) -> Iterator[WalkLeg]:
    walk_s = math.dist(start, end) / speed_mps
    if walk_s > 0.0:
        yield WalkLeg(walk_s, end)
    rest_s = max(pause_s, MIN_STAY_S - walk_s)
    if rest_s > 0.0:
        yield WalkLeg(rest_s, end)


class ActorMotion:
    """Positions and headings of all actors at one moment, as arrays. Actors without a plan stand still."""

    def __init__(
        self,
        starts_enu_m: NDArray[np.float64],
        headings_rad: NDArray[np.float64],
        plans: Mapping[int, Iterator[WalkLeg]],
    ) -> None:
        self._plans = plans
        self._leg_start = starts_enu_m.copy()
        self._leg_vector = np.zeros_like(starts_enu_m)
        self._begin_s = np.zeros(len(starts_enu_m))
        self._end_s = np.full(len(starts_enu_m), np.inf)
        self._heading = headings_rad.copy()
        self._end_s[list(plans)] = 0.0
        self.advance(0.0)

    def advance(self, to_s: float) -> None:
        """Move all actors to `to_s` seconds, which is never before the present moment."""
        # Within a leg a position is linear in time and computed for all at once; only arrivals need Python.
        for index in np.flatnonzero(self._end_s <= to_s):
            self._catch_up(int(index), to_s)
        progress = (to_s - self._begin_s) / (self._end_s - self._begin_s)
        self._positions = self._leg_start + progress[:, None] * self._leg_vector
        self._headings = self._heading.copy()
        # Callers keep these arrays, so the next moment gets new ones instead of changing them.
        self._positions.flags.writeable = self._headings.flags.writeable = False

    def positions_m(self) -> NDArray[np.float64]:
        """(n, 2) east, north at the present moment; read only, and never changed afterwards."""
        return self._positions

    def headings_rad(self) -> NDArray[np.float64]:
        """(n,) clockwise from north. A resting actor keeps the heading of its last leg."""
        return self._headings

    def _catch_up(self, index: int, to_s: float) -> None:
        begin_s = self._begin_s[index]
        end_s = self._end_s[index]
        position = self._leg_start[index] + self._leg_vector[index]
        heading = self._heading[index]
        along = np.zeros(2)
        while end_s <= to_s:
            position, begin_s = position + along, end_s
            leg = next(self._plans[index], None)
            if leg is None:
                along, end_s = np.zeros(2), math.inf
                break
            along, end_s = leg.end_enu_m - position, begin_s + leg.duration_s
            if along[0] or along[1]:
                heading = math.atan2(along[0], along[1]) % (2.0 * math.pi)
        self._leg_start[index], self._leg_vector[index], self._heading[index] = position, along, heading
        self._begin_s[index], self._end_s[index] = begin_s, end_s
