"""Groups of actors: their numbers, sizes and regions, and the groups that they relate to."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from math import hypot
from typing import TypeVar

from bench.simspec import HOME, ActorGroup, CountRange, Polygon, SimSpec, generator

from ._geometry import Geometry, shrunk_at_most

Item = TypeVar("Item")


def is_home(simspec: SimSpec, name: str | None) -> bool:
    """Whether the name means the vehicle's home. A group called `home` takes precedence."""
    return name == HOME and all(group.id != HOME for group in simspec.actors)


def member_count(simspec: SimSpec, group: ActorGroup) -> int:
    """How many members the group has in this scene: drawn from the placement seed where a range is given."""
    if isinstance(group.count, int):
        return group.count
    if not isinstance(group.count, CountRange):
        return group.member_count(simspec.world.area.area_m2)
    # A separate random stream: a drawn count gives the same places as the same count written as a number.
    rng = generator(simspec.seeds, "placement", zlib.crc32(group.id.encode()), zlib.crc32(b"count"))
    return int(rng.integers(group.count.low, group.count.high + 1))


def region_of(simspec: SimSpec, group: ActorGroup) -> Polygon:
    """The polygon in which members must stand: the group's region, else the world's area."""
    return group.placement.region or simspec.world.area


def names_in_relations(group: ActorGroup) -> set[str]:
    """Whom the group's relations name: groups, roles, and the vehicle's home."""
    place = group.placement
    relations = (place.near, place.away, place.mean_distance, place.inside, *place.distances, *place.avoid)
    names = {relation.of for relation in relations if relation}
    names |= {reference.of for reference in place.place_references.values()}
    names |= {place.between.first, place.between.second} if place.between else set()
    return {name for name in names if name}


def prerequisite_groups(simspec: SimSpec, group: ActorGroup) -> set[str]:
    """The groups to place before this one: those that it relates to and, for sight, every solid group."""
    place = group.placement
    names = {other for name in names_in_relations(group) for other in groups_named(simspec, group, name)}
    if place.hidden_from or place.visible_from:
        names |= {
            other.id
            for other in simspec.actors
            if other is not group and other.is_known and other.definition.solid
        }
    return names


def hosts_of(simspec: SimSpec, group: ActorGroup) -> tuple[str, ...]:
    """The group that members stand inside, the group that this one stands inside, and so on."""
    hosts: list[str] = []
    inside = group.placement.inside
    while inside and inside.of and inside.of not in hosts:
        hosts.append(inside.of)
        inside = simspec.group(inside.of).placement.inside
    return tuple(hosts)


def groups_named(simspec: SimSpec, group: ActorGroup, name: str) -> tuple[str, ...]:
    """The group of that name, or all other groups of that role; none for the vehicle's home."""
    # A group takes precedence over a role of the same name, as in the documents.
    if any(other.id == name for other in simspec.actors):
        return (name,)
    return tuple(other.id for other in simspec.actors if other.role == name and other.id != group.id)


def inner_radius_m(group: ActorGroup) -> float:
    """Radius of the circle inside a member's footprint."""
    asset = group.definition
    # Inside at any heading: a bound that needs no heading.
    return min(asset.length_m, asset.width_m) / 2.0


def outer_radius_m(group: ActorGroup) -> float:
    """Radius of the circle around a member's footprint."""
    asset = group.definition
    return hypot(asset.length_m, asset.width_m) / 2.0


def centre_distance_m(group: ActorGroup) -> float:
    """Least distance between centres of two members, or of members of groups with no smaller gap."""
    return 2.0 * inner_radius_m(group) + group.placement.separation_m


def centre_ground(geometry: Geometry, group: ActorGroup) -> Geometry:
    """The ground of centres whose footprints lie inside the geometry; errs to too much."""
    return shrunk_at_most(geometry, inner_radius_m(group))


def smallest_failing(items: Sequence[Item], fails: Callable[[list[Item]], bool], run: int = 1) -> list[Item]:
    """A smallest set of items that fail together: none can be left out.

    Runs of `run` items are left out first, then ever smaller ones, while the rest still fails.
    """
    core = list(items)
    while True:
        start = 0
        while start < len(core):
            rest = core[:start] + core[start + run :]
            if rest and fails(rest):
                core = rest
            else:
                start += run
        if run == 1:
            return core
        run //= 2
