"""The constraints of a scene, each with the field that states it, for proofs and for the messages about
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from bench.arrays import Floats
from bench.simspec import ASSETS, ActorGroup, AreaCount, MeanDistance, Sight, SimSpec

from .._geometry import Geometry
from .._groups import member_count
from ..relations._between import BetweenRelation, between_relations
from ..relations._distance_bands import DistanceBand, distance_bands
from ..relations._ground import ground_relations
from ..relations._headings import RequiredHeading, facing_heading, road_heading
from ..relations._other_groups import group_relations
from ..relations._patrol_routes import patrols, route_points
from ..relations._relation import HOME_CLEARANCE_M, GroupRelation, field_path
from ._capacity import count_field, grown_area_m2


@dataclass(frozen=True, slots=True)
class Constraint:
    """One constraint of a group, with the path of its field and its words for messages.

    One of the last ten is given: ground for centres, a relation to other groups, a between relation, a mean
    distance, the area that members need with their gaps, their spread, a heading, the points of a route of
    which one must be reached, a count inside an area, or their extent.
    """

    path: str
    text: str
    group: str
    ground: Geometry | None = None
    group_relation: GroupRelation | None = None
    between: BetweenRelation | None = None
    mean: MeanDistance | None = None
    need_m2: float | None = None
    spread_m: float | None = None
    band: DistanceBand | None = None
    heading: RequiredHeading | None = None
    route_m: Floats | None = None
    count: AreaCount | None = None
    extent_m: float | None = None


def scene_constraints(simspec: SimSpec, order: Sequence[ActorGroup]) -> list[Constraint]:
    """Every constraint of the scene, in the order in which an explanation tries to leave them out."""
    # A group without members constrains nothing.
    peopled = [group for group in order if member_count(simspec, group)]
    fixed = [group for group in peopled if group.placement.at]
    free = [group for group in peopled if not group.placement.at]
    terms = [_fixed_constraint(group) for group in fixed]
    home = simspec.vehicle.home
    terms += [
        Constraint(
            "vehicle.home",
            f"actors keep {HOME_CLEARANCE_M:g} m from the vehicle's home",
            HOME_FIELD,
            ground=shapely_point(home),
        )
    ]
    for group in free:
        terms += _group_constraints(simspec, group)
    return terms


HOME_FIELD = "vehicle.home"


def shapely_point(place: object) -> Geometry:
    return shapely.Point(place.east_m, place.north_m)  # type: ignore[attr-defined]


def _fixed_constraint(group: ActorGroup) -> Constraint:
    at = group.placement.at
    assert at is not None
    return Constraint(
        field_path(group, "at"),
        f"{group.id!r} stands at {at.east_m:g} east, {at.north_m:g} north",
        group.id,
        ground=shapely_point(at),
    )


def _group_constraints(simspec: SimSpec, group: ActorGroup) -> list[Constraint]:
    count, asset, gap = member_count(simspec, group), ASSETS[group.asset], group.placement.separation_m
    size = f"of {asset.length_m:g} by {asset.width_m:g} m, with {gap:g} m between them"
    constraints = [
        Constraint(
            f"actors[{group.id}].{count_field(group)}",
            f"{group.id!r} has {count} members {size}",
            group.id,
            need_m2=count * grown_area_m2(group, gap),
        )
    ]
    if spread_m := group.placement.spread_m:
        text = f"the {count} members of {group.id!r} are to stand {spread_m:g} m from each other"
        constraints.append(Constraint(field_path(group, "spread_m"), text, group.id, spread_m=spread_m))
    if extent_m := group.placement.extent_m:
        text = f"no two of the {count} members of {group.id!r} are to stand farther apart than {extent_m:g} m"
        constraints.append(Constraint(field_path(group, "extent_m"), text, group.id, extent_m=extent_m))
    for number, item in enumerate(group.placement.counts):
        text = f"{item.text} of the {count} members of {group.id!r} are to stand inside area {item.area!r}, none across its border"
        constraints.append(Constraint(field_path(group, f"counts[{number}]"), text, group.id, count=item))
    for relation in ground_relations(simspec, group):
        if (room := relation.ground()) is not None:
            constraints.append(
                Constraint(relation.path, f"{group.id!r} is to {relation.text}", group.id, ground=room)
            )
    bands = distance_bands(simspec, group)
    for group_relation in group_relations(simspec, group):
        text = f"{group.id!r} is to {group_relation.text}"
        # A relation to fixed points is known ground. One to a group stays a relation until its members are
        # placed.
        if group_relation.points is None:
            constraints.append(
                Constraint(
                    group_relation.path,
                    text,
                    group.id,
                    group_relation=group_relation,
                    band=bands.get(group_relation.path),
                )
            )
        elif (room := group_relation.bound(group_relation.points).ground()) is not None:
            constraints.append(Constraint(group_relation.path, text, group.id, ground=room))
    for between in between_relations(simspec, group):
        constraints.append(
            Constraint(between.path, f"{group.id!r} is to {between.text}", group.id, between=between)
        )
    if isinstance(group.placement.hidden_from, Sight) and not _anything_solid(simspec, group):
        # An empty ground: nothing can hide the members, so they may stand nowhere.
        text = f"{group.id!r} is to stand out of sight, and no other group has a solid asset"
        constraints.append(
            Constraint(field_path(group, "hidden_from"), text, group.id, ground=shapely.Polygon())
        )
    for heading in (road_heading(simspec, group), facing_heading(group)):
        if heading:
            constraints.append(
                Constraint(heading.path, f"{group.id!r} is to {heading.text}", group.id, heading=heading)
            )
    if patrols(simspec, group):
        route_m = np.concatenate(list(route_points(simspec, group).values()))
        text = f"{group.id!r} is to walk straight from its place to some point of its patrol route"
        constraints.append(Constraint(f"actors[{group.id}].motion.route", text, group.id, route_m=route_m))
    if mean := group.placement.mean_distance:
        text = f"the mean distance of {group.id!r} to {mean.of!r} is to be {mean.mean_m:g} m"
        path = field_path(group, "mean_distance")
        constraints.append(Constraint(path, text, group.id, mean=mean, band=bands[path]))
    return constraints


def _anything_solid(simspec: SimSpec, group: ActorGroup) -> bool:
    return any(
        ASSETS[other.asset].solid and member_count(simspec, other)
        for other in simspec.actors
        if other.id != group.id
    )
