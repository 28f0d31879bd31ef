"""How close to a target a configuration keeps its bystanders."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

from ._actors import ActorGroup, CountRange
from ._document import SimSpec
from ._roles import TARGET_ROLES, Role

Corners = list[tuple[float, float]]
"""East and north in metres."""


def bystander_proximity_m(simspec: SimSpec) -> float | None:
    """Mean distance of the bystanders to the target in metres, as the configuration states it.

    A target is an adversary, or sought. This is the smallest `mean_distance` to a target that a bystander group states. If no group states
    one, it is an upper bound of the mean over all bystanders: for each group the largest distance that its
    relations to a target and the ground of both allow. None without bystanders or without targets.
    """
    bystanders, targets = (
        populated_groups(simspec, {Role.BYSTANDER}),
        populated_groups(simspec, TARGET_ROLES),
    )
    if not bystanders or not targets:
        return None
    target_ids = {target.id for target in targets}
    stated_means = [
        mean.mean_m
        for group in bystanders
        if (mean := group.placement.mean_distance) and mean.of in target_ids
    ]
    if stated_means:
        return min(stated_means)
    # The upper bound: a run certifies an agent only to what every placement of the situation holds
    # (docs/rulings.md 2 and 5).
    area_m2 = simspec.world.area.area_m2
    counts = [group.member_count(area_m2) for group in bystanders]
    bounds_m = [min(_max_distance_m(simspec, group, target) for target in targets) for group in bystanders]
    return math.fsum(count * bound_m for count, bound_m in zip(counts, bounds_m, strict=True)) / sum(counts)


def nearest_bystander_m(simspec: SimSpec) -> float | None:
    """Smallest distance in metres to a target that the configuration guarantees for its bystanders.

    Every bystander group counts whose place is stated in relation to a target, with the largest lower
    bound that it keeps to the nearest member of it. Relations to other groups, points and the vehicle's home
    guarantee nothing. None where no bystander group has a relation to a target.
    """
    guarantees = (
        list(_guaranteed_distances_m(simspec, group, target))
        for group in populated_groups(simspec, {Role.BYSTANDER})
        for target in populated_groups(simspec, TARGET_ROLES)
    )
    return min((max(distances_m) for distances_m in guarantees if distances_m), default=None)


def populated_groups(simspec: SimSpec, roles: Collection[Role]) -> list[ActorGroup]:
    """The groups of these roles that have at least one member."""
    area_m2 = simspec.world.area.area_m2
    return [group for group in simspec.actors if group.role in roles and group.member_count(area_m2)]


def _guaranteed_distances_m(simspec: SimSpec, group: ActorGroup, target: ActorGroup) -> Iterator[float]:
    """The lower bound of each relation to the target; 0 for a relation that need not hold for every member of
    it.
    """
    placement = group.placement
    single = not isinstance(target.count, CountRange) and target.member_count(simspec.world.area.area_m2) == 1
    names = _names_of(simspec, target)
    # `near` holds for some member only: with several members, another one may be closer.
    for relation, holds_for_all in ((placement.near, single), (placement.away, True)):
        if relation and relation.of == target.id:
            yield relation.min_m * holds_for_all
    for distance in placement.distances:
        if distance.of in names:
            yield distance.min_m * (distance.whom == "every" or (single and distance.of == target.id))
    for avoid in placement.avoid:
        # A gap between edges, so centres are farther apart.
        if avoid.of in names:
            yield avoid.at_least_m
    if placement.at and target.placement.at:
        fixed = target.placement.at
        yield math.hypot(placement.at.east_m - fixed.east_m, placement.at.north_m - fixed.north_m)


def _names_of(simspec: SimSpec, target: ActorGroup) -> set[str]:
    """The names by which a distance may refer to the target: its id, and its role."""
    # A group id takes precedence: where a group is called `adversary`, that word no longer means the role.
    return {target.id} | ({str(target.role)} - {group.id for group in simspec.actors})


def _max_distance_m(simspec: SimSpec, group: ActorGroup, target: ActorGroup) -> float:
    """The largest distance from the target at which a member of the group may stand."""
    corners, target_corners = _ground_corners(simspec, group), _ground_corners(simspec, target)
    # Corners are enough: the two points of two polygons that are farthest apart are always corners.
    ground_bound_m = max(math.dist(corner, other) for corner in corners for other in target_corners)
    return min([*_stated_bounds_m(simspec, group, target), ground_bound_m])


def _stated_bounds_m(simspec: SimSpec, group: ActorGroup, target: ActorGroup) -> Iterator[float]:
    placement, names = group.placement, _names_of(simspec, target)
    yield from (
        relation.max_m
        for relation in (placement.near, placement.away)
        if relation and relation.of == target.id
    )
    yield from (bound.max_m for bound in placement.distances if bound.of in names and bound.max_m is not None)


def _ground_corners(simspec: SimSpec, group: ActorGroup) -> Corners:
    """Corners of the ground on which the group may stand, or its fixed place."""
    placement = group.placement
    areas = {area.id: area for area in simspec.world.areas}
    named_area = areas.get(placement.inside.area) if placement.inside and placement.inside.area else None
    corners = (
        (placement.at,) if placement.at else (named_area or placement.region or simspec.world.area).corners
    )
    return [(corner.east_m, corner.north_m) for corner in corners]
