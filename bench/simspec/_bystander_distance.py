"""How near to a target a configuration keeps its bystanders."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ._actors import ActorGroup, CountRange, Role
from ._document import SimSpec


def bystander_proximity_m(simspec: SimSpec) -> float | None:
    """Mean distance of the bystanders to the target as far as the configuration says it; None without one or the other.

    It is the least `mean_distance` to an adversary that a group states. Where none states one it is the most that the mean over
    all bystanders can be: for each group the upper end of a relation to an adversary, and never more than the ground of the
    two allows. A run so certifies an agent to what any placement of the situation holds (docs/rulings.md 2 and 5), and no more.
    """
    area_m2 = simspec.world.area.area_m2
    groups = [one for one in simspec.actors if one.role is Role.BYSTANDER and one.member_count(area_m2)]
    targets = [one for one in simspec.actors if one.role is Role.ADVERSARY and one.member_count(area_m2)]
    if not groups or not targets:
        return None
    named = {one.id for one in targets}
    means = [mean.mean_m for one in groups if (mean := one.placement.mean_distance) and mean.of in named]
    if means:
        return min(means)
    members = [one.member_count(area_m2) for one in groups]
    bounds = [min(_most_m(simspec, one, target) for target in targets) for one in groups]
    return math.fsum(many * most_m for many, most_m in zip(members, bounds, strict=True)) / sum(members)


def nearest_bystander_m(simspec: SimSpec) -> float | None:
    """The least distance to a target that the configuration grants its bystanders; None where it sets none of them in relation to one.

    Every group whose place is stated in relation to an adversary counts, with the greatest lower end that it keeps towards the
    nearest member; to be near some of several grants nothing, since another may stand nearer. Relations to anything else, and to
    the vehicle's home, grant none.
    """
    area_m2 = simspec.world.area.area_m2
    groups = [one for one in simspec.actors if one.role is Role.BYSTANDER and one.member_count(area_m2)]
    targets = [one for one in simspec.actors if one.role is Role.ADVERSARY and one.member_count(area_m2)]
    granted = ([*_granted_m(simspec, group, target)] for group in groups for target in targets)
    return min((max(lower) for lower in granted if lower), default=None)


def _granted_m(simspec: SimSpec, group: ActorGroup, target: ActorGroup) -> Iterator[float]:
    """The lower end of each relation to the target, 0 where it leaves some member of it out."""
    place = group.placement
    alone = not isinstance(target.count, CountRange) and target.member_count(simspec.world.area.area_m2) == 1
    names = _names(simspec, target)
    if place.near and place.near.of == target.id:
        yield place.near.min_m if alone else 0.0
    if place.away and place.away.of == target.id:
        yield place.away.min_m
    for one in place.distances:
        if one.of in names:
            yield one.min_m if one.whom == "every" or (alone and one.of == target.id) else 0.0
    if place.at and target.placement.at:
        yield math.hypot(place.at.east_m - target.placement.at.east_m, place.at.north_m - target.placement.at.north_m)


def _names(simspec: SimSpec, target: ActorGroup) -> set[str]:
    """What a distance may call the target: its id, or its role where no group is called so."""
    return {target.id} | ({str(target.role)} - {one.id for one in simspec.actors})


def _most_m(simspec: SimSpec, group: ActorGroup, target: ActorGroup) -> float:
    """The farthest that a member of the group may stand from the target."""
    return min([*_said(simspec, group, target), _across(_ground(simspec, group), _ground(simspec, target))])


def _said(simspec: SimSpec, group: ActorGroup, target: ActorGroup) -> Iterator[float]:
    place, names = group.placement, _names(simspec, target)
    yield from (one.max_m for one in (place.near, place.away) if one and one.of == target.id)
    yield from (one.max_m for one in place.distances if one.of in names and one.max_m is not None)


def _ground(simspec: SimSpec, group: ActorGroup) -> list[tuple[float, float]]:
    """Corners of the ground on which a group may stand, or the one place that is fixed."""
    place = group.placement
    named = next((one for one in simspec.world.areas if place.inside and one.id == place.inside.area), None)
    corners = (place.at,) if place.at else (named or place.region or simspec.world.area).corners
    return [(one.east_m, one.north_m) for one in corners]


def _across(one: list[tuple[float, float]], other: list[tuple[float, float]]) -> float:
    # Of two polygons the points farthest apart are corners.
    return max(math.dist(a, b) for a in one for b in other)
