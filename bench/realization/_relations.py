"""What the members of a group must keep, each relation with the field that states it and the words for it.

A *relation* judges places by themselves: the region, a road, what already stands. A *tie* judges places against those of
other members; bound to members that stand, it is a relation too. Beside the judgement each can say in which part of the
ground centres that keep it must lie: never too small a part, often too large a one.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import cos, hypot, pi
from typing import Any, Literal

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray

from bench.simspec import (
    ASSETS,
    HOME,
    ActorGroup,
    Along,
    CountRange,
    Distance,
    Point,
    Polygon,
    Road,
    Seen,
    Sight,
    SimSpec,
    generator,
)

from ._footprint import Array, Footprints, crowded, crowding, joined, lie_within

HOME_CLEARANCE_M = 3.0
Mask = NDArray[np.bool_]
Geometry = Any
"""A shapely geometry; shapely ships no types."""

Whom = Literal["some", "every", "first"]
_ARC = 16
_OUTWARD = 1.0 / cos(pi / (4 * _ARC))
"""By how much a polygon of `_ARC` edges for a quarter must be wider than the circle that it is to hold."""


@dataclass(frozen=True, slots=True)
class Relation:
    """One thing that a place must keep. `room()` holds every centre that keeps it, None where it says nothing of that."""

    path: str
    text: str
    keeps: Callable[[Footprints], Mask]
    room: Callable[[], Geometry | None] = lambda: None


@dataclass(frozen=True, slots=True)
class Tie:
    """A relation to the members of other groups, or to points.

    `pairs` is (k, m): whether a place keeps it towards a member. `room` holds every centre that may keep it towards a member
    that stands somewhere in the ground given; `back` every centre of the member, seen from ours. `points` stand for
    members where no group is meant. `among` is as `room`, for members that stand, where their headings tell more.
    """

    path: str
    text: str
    of: tuple[str, ...]
    whom: Whom
    pairs: Callable[[Footprints, Footprints], Mask]
    room: Callable[[Geometry], Geometry | None]
    back: Callable[[Geometry], Geometry | None]
    points: Footprints | None = None
    among: Callable[[Footprints], Geometry | None] | None = None

    def keeps(self, some: Footprints, others: Footprints) -> Mask:
        """(k,) whether places keep it towards all of the others who count."""
        counted = others[np.arange(1)] if self.whom == "first" else others
        matrix = self.pairs(some, counted)
        kept: Mask = np.any(matrix, axis=1) if self.whom == "some" else np.all(matrix, axis=1)
        return kept

    def bound(self, others: Footprints) -> Relation:
        """The relation to members that stand."""
        return Relation(self.path, self.text, lambda some: self.keeps(some, others), lambda: self._room_of(others))

    def _room_of(self, others: Footprints) -> Geometry | None:
        points = shapely.points(others.centre_m)
        if len(points) == 0:
            return None
        if self.among is not None:
            return self.among(others)
        if self.whom == "some":
            return self.room(shapely.MultiPoint(points))
        rooms = [self.room(point) for point in points[: 1 if self.whom == "first" else 64]]
        return None if rooms[0] is None else shapely.intersection_all(rooms)


def is_home(simspec: SimSpec, name: str | None) -> bool:
    """Whether a relation of that name is to the vehicle's home: the word is a group's where one is called so."""
    return name == HOME and all(one.id != HOME for one in simspec.actors)


def members_of(simspec: SimSpec, group: ActorGroup) -> int:
    """How many members the group has in this scene: drawn from the placement seed where a range is given."""
    if not isinstance(group.count, CountRange):
        return group.members(simspec.world.area.area_m2)
    # A stream of its own, so that a range leaves the places of the same number of members as they were.
    rng = generator(simspec.seeds, "placement", zlib.crc32(group.id.encode()), zlib.crc32(b"count"))
    return int(rng.integers(group.count.low, group.count.high + 1))


def ground(polygon: Polygon) -> Geometry:
    """The polygon as a shapely one."""
    return shapely.Polygon([(corner.east_m, corner.north_m) for corner in polygon.corners])


def region_of(simspec: SimSpec, group: ActorGroup) -> Polygon:
    """Where members must stand whatever else they keep."""
    return group.placement.region or simspec.world.area


def field(group: ActorGroup, name: str) -> str:
    """The path of one of the group's placement fields, as a campaign's factors write it."""
    return f"actors[{group.id}].placement.{name}"


def related(simspec: SimSpec, group: ActorGroup) -> set[str]:
    """The groups that must stand before this one: those that it relates to and, for sight, whatever is solid."""
    place = group.placement
    found = {relation.of for relation in (place.near, place.away, place.mean_distance) if relation}
    found |= {seen.of for seen in place.seen.values() if seen.of}
    found |= {place.between.first, place.between.second} if place.between else set()
    found |= {place.inside.of} if place.inside and place.inside.of else set()
    found -= {name for name in found if is_home(simspec, name)}
    for distance in place.distances:
        found |= set(_called(simspec, group, distance.of))
    if place.hidden_from or place.visible_from:
        found |= {one.id for one in simspec.actors if one is not group and one.asset in ASSETS and ASSETS[one.asset].solid}
    return found


def hosts_of(simspec: SimSpec, group: ActorGroup) -> tuple[str, ...]:
    """The groups that the group's members stand in: the one they are to be inside of, the one that this is inside of, and so on."""
    found: list[str] = []
    inside = group.placement.inside
    while inside and inside.of and inside.of not in found:
        found.append(inside.of)
        inside = simspec.group(inside.of).placement.inside
    return tuple(found)


def _called(simspec: SimSpec, group: ActorGroup, name: str | None) -> tuple[str, ...]:
    """The groups of that name, or all others of that role; none for a point and the vehicle's home."""
    if name is None:
        return ()
    if any(one.id == name for one in simspec.actors):
        return (name,)
    return tuple(one.id for one in simspec.actors if one.role == name and one.id != group.id)


def wide(geometry: Geometry, distance_m: float) -> Geometry:
    """Everything within a distance, rather too much than too little."""
    return shapely.buffer(geometry, distance_m * _OUTWARD + 1e-6, quad_segs=_ARC)


def home_of(simspec: SimSpec) -> Footprints:
    """The vehicle's home as something that wants to be kept clear of."""
    home = simspec.vehicle.home
    return Footprints(np.array([[home.east_m, home.north_m]]), np.zeros(1), np.zeros((1, 2)), np.full(1, HOME_CLEARANCE_M))


def standing(simspec: SimSpec, group: ActorGroup) -> list[Relation]:
    """What places of the group must keep by themselves."""
    region = ground(region_of(simspec, group))
    shapely.prepare(region)
    found = [inside(group, region)]
    if group.placement.inside and group.placement.inside.area:
        found.append(_in_area(simspec, group, group.placement.inside.area))
    if group.placement.facing and group.placement.facing.heading_deg is not None:
        found.append(_heading(group, group.placement.facing.heading_deg, group.placement.facing.within_deg))
    if group.placement.along:
        road = next(one for one in simspec.world.roads if one.id == group.placement.along.road)
        found += _along(group, group.placement.along, road)
    return found


def inner_radius_m(group: ActorGroup) -> float:
    """Of the circle inside a member's footprint."""
    asset = ASSETS[group.asset]
    return min(asset.length_m, asset.width_m) / 2.0


def outer_radius_m(group: ActorGroup) -> float:
    """Of the circle round a member's footprint."""
    asset = ASSETS[group.asset]
    return hypot(asset.length_m, asset.width_m) / 2.0


def inside(group: ActorGroup, region: Geometry) -> Relation:
    """The whole footprint inside a region."""
    path = field(group, "region") if group.placement.region else "world.area"
    return _within(path, f"stand inside its region of {region.area:.0f} m2", group, region)


def _in_area(simspec: SimSpec, group: ActorGroup, name: str) -> Relation:
    area = ground(next(one for one in simspec.world.areas if one.id == name))
    shapely.prepare(area)
    return _within(field(group, "inside"), f"stand inside area {name!r} of {area.area:.0f} m2", group, area)


def _heading(group: ActorGroup, heading_deg: float, within_deg: float) -> Relation:
    def keeps(some: Footprints) -> Mask:
        off = np.abs((np.degrees(some.heading_rad) - heading_deg + 180.0) % 360.0 - 180.0)
        kept: Mask = off <= within_deg + 1e-9
        return kept

    return Relation(field(group, "facing"), f"head {heading_deg:g} degrees within {within_deg:g} degrees", keeps)


def _within(path: str, text: str, group: ActorGroup, region: Geometry) -> Relation:
    convex = region.equals(region.convex_hull)

    def keeps(some: Footprints) -> Mask:
        corners = some.corners()
        kept: Mask = shapely.contains_xy(region, corners[..., 0], corners[..., 1]).all(axis=1)
        if not convex:  # corners alone may reach across a bay
            kept[kept] = shapely.contains(region, shapely.polygons(corners[kept]))
        return kept

    return Relation(path, text, keeps, lambda: _shrunk(region, group))


def _shrunk(geometry: Geometry, group: ActorGroup) -> Geometry:
    """Where centres may be whose footprint lies inside, rather too much than too little."""
    return shapely.buffer(geometry, 1e-6 - inner_radius_m(group), quad_segs=_ARC)


def clear(simspec: SimSpec, group: ActorGroup, placed: Mapping[str, Footprints]) -> Relation:
    """Away from what already stands and from the vehicle's home, but for whom one stands in."""
    around = hosts_of(simspec, group)
    obstacles = joined([home_of(simspec), *(some for name, some in placed.items() if name not in around)])
    hosts = joined([placed[name] for name in around if name in placed])
    text = (
        f"keep {group.placement.separation_m:g} m clear of the {len(obstacles) + len(hosts) - 1} actors already placed, "
        f"and {HOME_CLEARANCE_M:g} m of the vehicle's home"
    )

    def keeps(some: Footprints) -> Mask:
        hit = crowded(some, obstacles)
        if len(hosts):
            one, other = crowding(some, hosts)
            hit[one[~lie_within(some[one], hosts[other])]] = True
        return ~hit

    return Relation(field(group, "separation_m"), text, keeps)


def strip(road: Road) -> Geometry:
    """The ground that a road covers."""
    line = shapely.LineString([(point.east_m, point.north_m) for point in road.points])
    return shapely.buffer(line, road.width_m / 2.0, cap_style="flat", join_style="mitre", mitre_limit=2.0)


def _along(group: ActorGroup, along: Along, road: Road) -> Iterator[Relation]:
    ground_m2 = strip(road)
    shapely.prepare(ground_m2)

    def on(some: Footprints) -> Mask:
        kept: Mask = shapely.covers(ground_m2, shapely.polygons(some.corners()))
        return kept

    def beside(some: Footprints) -> Mask:
        gap = shapely.distance(ground_m2, shapely.polygons(some.corners()))
        kept: Mask = (gap > 0.0) & (gap <= along.within_m)
        return kept

    if along.where == "on":
        text = f"stand on road {road.id!r} of {road.width_m:g} m width"
        yield Relation(field(group, "along"), text, on, lambda: _shrunk(ground_m2, group))
    else:

        def verge() -> Geometry:
            covered = shapely.buffer(ground_m2, inner_radius_m(group) - 1e-6, quad_segs=_ARC)
            return wide(ground_m2, along.within_m + outer_radius_m(group)).difference(covered)

        yield Relation(field(group, "along"), f"stand beside road {road.id!r}, within {along.within_m:g} m of it", beside, verge)
    if along.parallel_deg is not None:
        limit = along.parallel_deg

        def parallel(some: Footprints) -> Mask:
            off = np.abs((np.degrees(some.heading_rad) - road_heading_deg(road, some.centre_m) + 90.0) % 180.0 - 90.0)
            kept: Mask = off <= limit + 1e-9
            return kept

        text = f"head along road {road.id!r} within {limit:g} degrees"
        yield Relation(field(group, "along.parallel_deg"), text, parallel)


def road_heading_deg(road: Road, places_m: Array) -> Array:
    """(n,) heading of the stretch of the road nearest to each of (n, 2) places."""
    points = np.array([(point.east_m, point.north_m) for point in road.points])
    lines = np.array([shapely.LineString(pair) for pair in pairwise(points)])
    step = np.diff(points, axis=0)
    heading: Array = np.degrees(np.arctan2(step[:, 0], step[:, 1]))
    nearest = shapely.distance(shapely.points(places_m)[:, None], lines[None, :]).argmin(axis=1)
    return np.asarray(heading[nearest], dtype=np.float64)


def ties(simspec: SimSpec, group: ActorGroup, solids: Solids | None = None) -> list[Tie]:
    """What places of the group must keep towards other groups and points; sight only where the solids are known."""
    place = group.placement
    found = []
    if place.inside and place.inside.of:
        found.append(_inside_of(group, simspec.group(place.inside.of)))
    for name, near, whom in (("near", place.near, "some"), ("away", place.away, "every")):
        if near:
            target = _Target.named(simspec, near.of)
            text = f"stand {near.min_m:g} to {near.max_m:g} m from {target.some(whom)}"
            found.append(
                _distance(field(group, name), text, target, "some" if whom == "some" else "every", near.min_m, near.max_m)
            )
    for number, one in enumerate(place.distances):
        target = _Target.of_distance(simspec, group, one)
        span = f"at least {one.min_m:g} m" if one.max_m is None else f"{one.min_m:g} to {one.max_m:g} m"
        if target.of or target.points is not None or one.whom == "some":
            text = f"stand {span} from {target.some(one.whom)}"
            found.append(_distance(field(group, f"distances[{number}]"), text, target, one.whom, one.min_m, one.max_m))
    if place.bearing:
        target = _Target.seen(simspec, place.bearing)
        sector = f"{place.bearing.from_deg:g} to {place.bearing.to_deg:g} degrees"
        low, high = place.bearing.from_deg, place.bearing.to_deg
        found.append(_bearing(field(group, "bearing"), f"stand at {sector} from {target.name}", target, low, high))
    if place.facing and place.facing.heading_deg is None:
        target = _Target.seen(simspec, place.facing)
        text = f"head towards {target.name} within {place.facing.within_deg:g} degrees"
        found.append(_facing(field(group, "facing"), text, target, place.facing.within_deg))
    if solids is not None:
        found += _sights(simspec, group, solids)
    return found


@dataclass(frozen=True, slots=True)
class _Target:
    """Whom a relation is about: groups, or a point; and what to call it."""

    name: str
    of: tuple[str, ...] = ()
    points: Footprints | None = None

    @classmethod
    def named(cls, simspec: SimSpec, name: str) -> _Target:
        """A group, or the vehicle's home."""
        if is_home(simspec, name):
            return cls("the vehicle's home", points=point_of(simspec.vehicle.home))
        return cls(repr(name), (name,))

    @classmethod
    def seen(cls, simspec: SimSpec, seen: Seen) -> _Target:
        """What a relation to a point or a first member is about."""
        return cls.named(simspec, seen.of) if seen.of is not None else cls._point(seen.point)

    @classmethod
    def of_distance(cls, simspec: SimSpec, group: ActorGroup, distance: Distance) -> _Target:
        """The same for a distance, which may be to everybody of a role."""
        if distance.of is None:
            return cls._point(distance.point)
        if is_home(simspec, distance.of):
            return cls.named(simspec, distance.of)
        called = _called(simspec, group, distance.of)
        return cls(repr(distance.of), tuple(name for name in called if members_of(simspec, simspec.group(name))))

    @classmethod
    def _point(cls, point: Point | None) -> _Target:
        assert point is not None
        return cls(f"the point {point.east_m:g} east, {point.north_m:g} north", points=point_of(point))

    def some(self, whom: str) -> str:
        """The words for some or every member; a point has but itself."""
        return self.name if self.points is not None else f"{whom} member of {self.name}"


def _inside_of(group: ActorGroup, host: ActorGroup) -> Tie:
    asset, inner_m = ASSETS[host.asset], inner_radius_m(group)
    reach_m = hypot(max(asset.length_m / 2.0 - inner_m, 0.0), max(asset.width_m / 2.0 - inner_m, 0.0))

    def pairs(some: Footprints, others: Footprints) -> Mask:
        kept = distances_m(some, others) <= reach_m + 1e-6
        one, other = np.nonzero(kept)
        kept[one, other] = lie_within(some[one], others[other])
        return kept

    def among(others: Footprints) -> Geometry:
        return shapely.union_all([_shrunk(outline, group) for outline in shapely.polygons(others.corners())])

    def room(others: Geometry) -> Geometry:
        return wide(others, reach_m)

    return Tie(
        field(group, "inside"), f"stand inside a member of {host.id!r}", (host.id,), "some", pairs, room, room, among=among
    )


def point_of(point: Point) -> Footprints:
    """A point as something that stands."""
    return Footprints(np.array([[point.east_m, point.north_m]]), np.zeros(1), np.zeros((1, 2)), np.zeros(1))


def distances_m(some: Footprints, others: Footprints) -> Array:
    """(k, m) distances from centre to centre."""
    offset = some.centre_m[:, None, :] - others.centre_m[None, :, :]
    return np.hypot(offset[..., 0], offset[..., 1])


def _distance(path: str, text: str, target: _Target, whom: Whom, min_m: float, max_m: float | None) -> Tie:
    most_m = np.inf if max_m is None else max_m

    def pairs(some: Footprints, others: Footprints) -> Mask:
        distance = distances_m(some, others)
        kept: Mask = (distance >= min_m) & (distance <= most_m)
        return kept

    def room(others: Geometry) -> Geometry | None:
        """Within reach of some place there, and not so near to all of them that none is far enough."""
        if max_m is None and min_m == 0.0:
            return None
        reach = wide(others, max_m) if max_m is not None else None
        if min_m > 0.0:
            corners = shapely.get_coordinates(_octagon(others))
            near = shapely.intersection_all(shapely.buffer(shapely.points(corners), max(min_m - 1e-6, 0.0), quad_segs=_ARC))
            reach = (EVERYWHERE if reach is None else reach).difference(near)
        return reach

    return Tie(path, text, target.of, whom, pairs, room, room, target.points)


def _octagon(geometry: Geometry) -> Geometry:
    """The geometry's hull, or something with at most eight corners that holds it."""
    hull = shapely.convex_hull(geometry)
    if shapely.get_num_coordinates(hull) <= 9:
        return hull
    turned = shapely.affinity.rotate(hull, 45.0, origin=(0.0, 0.0)).envelope
    return shapely.intersection(
        hull.envelope.buffer(1e-6, join_style="mitre"),
        shapely.affinity.rotate(turned, -45.0, origin=(0.0, 0.0)).buffer(1e-6, join_style="mitre"),
    )


def coarse(geometry: Geometry) -> Geometry:
    """The geometry, or something with fewer corners that holds it: the time of a proof goes by them."""
    if shapely.get_num_coordinates(geometry) <= FINE:
        return geometry
    return shapely.buffer(shapely.simplify(geometry, COARSE_M), COARSE_M * 1.1, quad_segs=2)


FINE = 64
COARSE_M = 0.1
EVERYWHERE = shapely.box(-3e5, -3e5, 3e5, 3e5)
"""More ground than any document can name."""


def bearings_deg(some: Footprints, others: Footprints) -> Array:
    """(k, m) bearings of the places, clockwise from north, seen from the others."""
    offset = some.centre_m[:, None, :] - others.centre_m[None, :, :]
    return np.asarray(np.degrees(np.arctan2(offset[..., 0], offset[..., 1])) % 360.0, dtype=np.float64)


def _bearing(path: str, text: str, target: _Target, from_deg: float, to_deg: float) -> Tie:
    span = (to_deg - from_deg) % 360.0

    def pairs(some: Footprints, others: Footprints) -> Mask:
        kept: Mask = (bearings_deg(some, others) - from_deg) % 360.0 <= span
        return kept

    there, back = _Fan(from_deg, span), _Fan((from_deg + 180.0) % 360.0, span)
    return Tie(path, text, target.of, "first", pairs, there, back, target.points)


@dataclass(frozen=True, slots=True)
class _Fan:
    """Everything that lies in a sector as seen from somewhere in the ground given, out to beyond any document's ground."""

    from_deg: float
    span_deg: float

    def __call__(self, others: Geometry) -> Geometry | None:
        pieces = 1 + int(self.span_deg // 90.0)  # each narrow enough for its sum with a hull to be convex
        corners = shapely.get_coordinates(shapely.convex_hull(others))
        return shapely.union_all([self._piece(corners, number, pieces) for number in range(pieces)])

    def _piece(self, corners: Array, number: int, pieces: int) -> Geometry:
        share = self.span_deg / pieces
        # A hair wider than the sector, for the rounding of sines.
        arc = np.radians(np.linspace(self.from_deg + number * share - 1e-7, self.from_deg + (number + 1) * share + 1e-7, 3))
        rim = 6e5 * np.stack([np.sin(arc), np.cos(arc)], axis=-1)
        swept = np.concatenate([corners, (corners[:, None, :] + rim[None]).reshape(-1, 2)])
        return shapely.convex_hull(shapely.MultiPoint(swept))


def _facing(path: str, text: str, target: _Target, within_deg: float) -> Tie:
    def pairs(some: Footprints, others: Footprints) -> Mask:
        towards = (bearings_deg(some, others) + 180.0) % 360.0
        off = np.abs((np.degrees(some.heading_rad)[:, None] - towards + 180.0) % 360.0 - 180.0)
        kept: Mask = off <= within_deg + 1e-9
        return kept

    return Tie(path, text, target.of, "first", pairs, _anywhere, _anywhere, target.points)


def _anywhere(_: Geometry) -> None:
    return None


@dataclass(frozen=True, slots=True)
class Solids:
    """What stands in the way of sight: footprints, heights (n,) and the group of each."""

    footprints: Footprints
    height_m: Array
    group: tuple[str, ...]

    def without(self, group: str) -> Solids:
        """Those of other groups."""
        kept = np.array([name != group for name in self.group], dtype=np.bool_)
        return Solids(self.footprints[kept], self.height_m[kept], tuple(name for name in self.group if name != group))

    def between(self, eyes_m: Array, eye_height_m: float, places_m: Array, height_m: float) -> Mask:
        """(k, m) whether a solid cuts the line from eye m to the point `height_m` above place k. An eye inside sees out."""
        blocked = np.zeros((len(places_m), len(eyes_m)), dtype=np.bool_)
        axes = self.footprints.axes()
        for index in range(len(self.height_m)):
            centre, half = self.footprints.centre_m[index], self.footprints.half_m[index]
            eye, end = (eyes_m - centre) @ axes[index].T, (places_m - centre) @ axes[index].T
            begins, ends = _crossing(eye, end, half)
            low = eye_height_m + np.where(eye_height_m <= height_m, begins, ends) * (height_m - eye_height_m)
            outside = (np.abs(eye) > half).any(axis=1)
            blocked |= outside[None, :] & (begins < ends) & (low < self.height_m[index])
        return blocked


def _crossing(eye: Array, end: Array, half: Array) -> tuple[Array, Array]:
    """(k, m) shares of the ways from (m, 2) eyes to (k, 2) ends at which they enter and leave a box round the origin."""
    way = end[:, None, :] - eye[None, :, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (-half - eye[None]) / way
        second = (half - eye[None]) / way
    level = way == 0.0
    within = np.abs(eye)[None] <= half
    low = np.where(level, np.where(within, -np.inf, np.inf), np.minimum(first, second))
    high = np.where(level, np.where(within, np.inf, -np.inf), np.maximum(first, second))
    return np.maximum(low.max(axis=-1), 0.0), np.minimum(high.min(axis=-1), 1.0)


def _sights(simspec: SimSpec, group: ActorGroup, solids: Solids) -> Iterator[Tie]:
    for name, whom in (("hidden_from", "every"), ("visible_from", "some")):
        sight = group.placement.seen.get(name)
        if isinstance(sight, Sight):
            target = _Target.seen(simspec, sight)
            yield _sight(group, name, sight, target, "every" if whom == "every" else "some", solids.without(group.id))


def _sight(group: ActorGroup, name: str, sight: Sight, target: _Target, whom: Whom, solids: Solids) -> Tie:
    top_m = ASSETS[group.asset].height_m

    def pairs(some: Footprints, others: Footprints) -> Mask:
        hidden = solids.between(others.centre_m, sight.height_m, some.centre_m, top_m)
        return hidden if name == "hidden_from" else ~hidden

    verb = "out of sight" if name == "hidden_from" else "in sight"
    text = f"stand {verb} of {target.some(whom)} at {sight.height_m:g} m"
    return Tie(field(group, name), text, target.of, whom, pairs, _anywhere, _anywhere, target.points)


def aimed_deg(
    simspec: SimSpec, group: ActorGroup, places_m: Array, targets: Footprints | None, rng: np.random.Generator
) -> Array:
    """(n,) headings that keep the group's relations of heading at (n, 2) places, as far as one draw can."""
    along, facing = group.placement.along, group.placement.facing
    count = len(places_m)
    if facing and facing.heading_deg is not None:
        limit = 0.999 * facing.within_deg
        fixed: Array = np.round(facing.heading_deg + rng.uniform(-limit, limit, count), 3) % 360.0
        return fixed
    if facing and targets is not None:
        offset = targets.centre_m[0] - places_m
        towards = np.degrees(np.arctan2(offset[:, 0], offset[:, 1]))
        limit = 0.999 * facing.within_deg
        turned: Array = np.round(towards + rng.uniform(-limit, limit, count), 3) % 360.0
        return turned
    if along and along.parallel_deg is not None:
        road = next(one for one in simspec.world.roads if one.id == along.road)
        limit = 0.999 * along.parallel_deg
        stretch = road_heading_deg(road, places_m) + 180.0 * rng.integers(2, size=count)
        aimed: Array = np.round(stretch + rng.uniform(-limit, limit, count), 3) % 360.0
        return aimed
    return np.round(rng.uniform(0.0, 360.0, count), 1) % 360.0


def facing_target(simspec: SimSpec, group: ActorGroup, placed: Mapping[str, Footprints]) -> Footprints | None:
    """What the group's members are to head towards; None where nothing or where the compass says it."""
    facing = group.placement.facing
    if facing is None or facing.heading_deg is not None:
        return None
    if facing.of is not None:
        return spots_of(simspec, facing.of, placed)
    assert facing.point is not None
    return point_of(facing.point)


def spots_of(simspec: SimSpec, name: str, placed: Mapping[str, Footprints]) -> Footprints:
    """The members of a group that stand, or the vehicle's home."""
    return point_of(simspec.vehicle.home) if is_home(simspec, name) else placed[name]


def drawn_from(room: Geometry, count: int, rng: np.random.Generator) -> Array:
    """(count, 2) places, uniform over a polygon or several."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(room))
    area = shapely.area(triangles)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    chosen = corners[rng.choice(len(area), size=count, p=area / area.sum())]
    one, other = np.sqrt(rng.uniform(size=(count, 1))), rng.uniform(size=(count, 1))
    places: Array = (1 - one) * chosen[:, 0] + one * (1 - other) * chosen[:, 1] + one * other * chosen[:, 2]
    return places


def common_room(relations: Sequence[Relation]) -> Geometry:
    """Where centres that keep all of them must lie."""
    rooms = [room for relation in relations if (room := relation.room()) is not None]
    return shapely.intersection_all(rooms) if rooms else EVERYWHERE
