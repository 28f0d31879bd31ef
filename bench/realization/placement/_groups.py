"""Groups of actors: their numbers, sizes and regions, and the groups that they relate to."""

from __future__ import annotations

import zlib
from math import hypot

from bench.simspec import ASSETS, HOME, ActorGroup, CountRange, Polygon, SimSpec, generator

from ._geometry import Geometry, shrunk_at_most


def is_home(simspec: SimSpec, name: str | None) -> bool:
    """Whether a relation of that name is to the vehicle's home: the word is a group's where one is called so."""
    return name == HOME and all(one.id != HOME for one in simspec.actors)


def member_count(simspec: SimSpec, group: ActorGroup) -> int:
    """How many members the group has in this scene: drawn from the placement seed where a range is given."""
    if not isinstance(group.count, CountRange):
        return group.member_count(simspec.world.area.area_m2)
    # A stream of its own, so that a range leaves the places of the same number of members as they were.
    rng = generator(simspec.seeds, "placement", zlib.crc32(group.id.encode()), zlib.crc32(b"count"))
    return int(rng.integers(group.count.low, group.count.high + 1))


def region_of(simspec: SimSpec, group: ActorGroup) -> Polygon:
    """Where members must stand whatever else they keep."""
    return group.placement.region or simspec.world.area


def prerequisite_groups(simspec: SimSpec, group: ActorGroup) -> set[str]:
    """The groups that must stand before this one: those that it relates to and, for sight, whatever is solid."""
    place = group.placement
    found = {relation.of for relation in (place.near, place.away, place.mean_distance) if relation}
    found |= {seen.of for seen in place.place_references.values() if seen.of}
    found |= {place.between.first, place.between.second} if place.between else set()
    found |= {place.inside.of} if place.inside and place.inside.of else set()
    found -= {name for name in found if is_home(simspec, name)}
    for distance in place.distances:
        found |= set(groups_named(simspec, group, distance.of))
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


def groups_named(simspec: SimSpec, group: ActorGroup, name: str | None) -> tuple[str, ...]:
    """The groups of that name, or all others of that role; none for a point and the vehicle's home."""
    if name is None:
        return ()
    if any(one.id == name for one in simspec.actors):
        return (name,)
    return tuple(one.id for one in simspec.actors if one.role == name and one.id != group.id)


def inner_radius_m(group: ActorGroup) -> float:
    """Of the circle inside a member's footprint."""
    asset = ASSETS[group.asset]
    return min(asset.length_m, asset.width_m) / 2.0


def outer_radius_m(group: ActorGroup) -> float:
    """Of the circle round a member's footprint."""
    asset = ASSETS[group.asset]
    return hypot(asset.length_m, asset.width_m) / 2.0


def centre_ground(geometry: Geometry, group: ActorGroup) -> Geometry:
    """Where centres may be whose footprint lies inside, rather too much than too little."""
    return shrunk_at_most(geometry, inner_radius_m(group))
