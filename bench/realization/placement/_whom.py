"""Whom relations are about: groups and their numbers, sizes and places, those of a role, points, and the vehicle's home."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot

import numpy as np

from bench.simspec import ASSETS, HOME, ActorGroup, CountRange, Distance, PlaceReference, Point, Polygon, SimSpec, generator

from ._footprint import Footprints
from ._ground import Geometry, shrunk_by
from ._relations import HOME_CLEARANCE_M


def is_home(simspec: SimSpec, name: str | None) -> bool:
    """Whether a relation of that name is to the vehicle's home: the word is a group's where one is called so."""
    return name == HOME and all(one.id != HOME for one in simspec.actors)


def members_of(simspec: SimSpec, group: ActorGroup) -> int:
    """How many members the group has in this scene: drawn from the placement seed where a range is given."""
    if not isinstance(group.count, CountRange):
        return group.member_count(simspec.world.area.area_m2)
    # A stream of its own, so that a range leaves the places of the same number of members as they were.
    rng = generator(simspec.seeds, "placement", zlib.crc32(group.id.encode()), zlib.crc32(b"count"))
    return int(rng.integers(group.count.low, group.count.high + 1))


def region_of(simspec: SimSpec, group: ActorGroup) -> Polygon:
    """Where members must stand whatever else they keep."""
    return group.placement.region or simspec.world.area


def related(simspec: SimSpec, group: ActorGroup) -> set[str]:
    """The groups that must stand before this one: those that it relates to and, for sight, whatever is solid."""
    place = group.placement
    found = {relation.of for relation in (place.near, place.away, place.mean_distance) if relation}
    found |= {seen.of for seen in place.place_references.values() if seen.of}
    found |= {place.between.first, place.between.second} if place.between else set()
    found |= {place.inside.of} if place.inside and place.inside.of else set()
    found -= {name for name in found if is_home(simspec, name)}
    for distance in place.distances:
        found |= set(called(simspec, group, distance.of))
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


def called(simspec: SimSpec, group: ActorGroup, name: str | None) -> tuple[str, ...]:
    """The groups of that name, or all others of that role; none for a point and the vehicle's home."""
    if name is None:
        return ()
    if any(one.id == name for one in simspec.actors):
        return (name,)
    return tuple(one.id for one in simspec.actors if one.role == name and one.id != group.id)


def home_of(simspec: SimSpec) -> Footprints:
    """The vehicle's home as something that wants to be kept clear of."""
    home = simspec.vehicle.home
    return Footprints(np.array([[home.east_m, home.north_m]]), np.zeros(1), np.zeros((1, 2)), np.full(1, HOME_CLEARANCE_M))


def inner_radius_m(group: ActorGroup) -> float:
    """Of the circle inside a member's footprint."""
    asset = ASSETS[group.asset]
    return min(asset.length_m, asset.width_m) / 2.0


def outer_radius_m(group: ActorGroup) -> float:
    """Of the circle round a member's footprint."""
    asset = ASSETS[group.asset]
    return hypot(asset.length_m, asset.width_m) / 2.0


def shrunk(geometry: Geometry, group: ActorGroup) -> Geometry:
    """Where centres may be whose footprint lies inside, rather too much than too little."""
    return shrunk_by(geometry, inner_radius_m(group))


@dataclass(frozen=True, slots=True)
class Target:
    """Whom a relation is about: groups, or a point; and what to call it."""

    name: str
    of: tuple[str, ...] = ()
    points: Footprints | None = None

    @classmethod
    def named(cls, simspec: SimSpec, name: str) -> Target:
        """A group, or the vehicle's home."""
        if is_home(simspec, name):
            return cls("the vehicle's home", points=point_of(simspec.vehicle.home))
        return cls(repr(name), (name,))

    @classmethod
    def seen(cls, simspec: SimSpec, seen: PlaceReference) -> Target:
        """What a relation to a point or a first member is about."""
        return cls.named(simspec, seen.of) if seen.of is not None else cls._point(seen.point)

    @classmethod
    def of_distance(cls, simspec: SimSpec, group: ActorGroup, distance: Distance) -> Target:
        """The same for a distance, which may be to everybody of a role."""
        if distance.of is None:
            return cls._point(distance.point)
        if is_home(simspec, distance.of):
            return cls.named(simspec, distance.of)
        names = called(simspec, group, distance.of)
        return cls(repr(distance.of), tuple(name for name in names if members_of(simspec, simspec.group(name))))

    @classmethod
    def _point(cls, point: Point | None) -> Target:
        assert point is not None
        return cls(f"the point {point.east_m:g} east, {point.north_m:g} north", points=point_of(point))

    def some(self, whom: str) -> str:
        """The words for some or every member; a point has but itself."""
        return self.name if self.points is not None else f"{whom} member of {self.name}"


def point_of(point: Point) -> Footprints:
    """A point as something that stands."""
    return Footprints(np.array([[point.east_m, point.north_m]]), np.zeros(1), np.zeros((1, 2)), np.zeros(1))


def spots_of(simspec: SimSpec, name: str, placed: Mapping[str, Footprints]) -> Footprints:
    """The members of a group that stand, or the vehicle's home."""
    return point_of(simspec.vehicle.home) if is_home(simspec, name) else placed[name]
