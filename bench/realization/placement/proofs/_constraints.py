"""The constraints of a scene, each with its field, for proofs and for messages about them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import shapely

from bench.simspec import ActorGroup, Point, SimSpec

from .._geometry import Geometry
from .._groups import member_count
from .._targets import fixed_footprint
from ..relations._between import between_relations
from ..relations._ground import ground_relations
from ..relations._headings import facing_heading, road_heading
from ..relations._other_groups import group_relations
from ..relations._patrol_routes import patrols, route_points
from ..relations._relation import HOME_CLEARANCE_M, field_path
from ._capacity import count_path, grown_area_m2

HOME_FIELD = "vehicle.home"

Kind = Literal[
    "home",  # the point that actors keep clear of
    "at",  # the point at which the group is fixed
    "ground",  # ground for centres
    "relation",  # a GroupRelation
    "between",  # a BetweenRelation
    "mean",  # a MeanDistance
    "heading",  # a RequiredHeading
    "count",  # an AreaCount
    "route",  # (n, 2) points of a route of which one must be reached
    "need_m2",  # the area that members need with their gaps
    "spread_m",
    "extent_m",
]


@dataclass(frozen=True, slots=True)
class Constraint:
    """One constraint of a group, with the path of its field and its words for messages."""

    path: str
    text: str
    group: str
    kind: Kind
    fact: Any


def scene_constraints(simspec: SimSpec, order: Sequence[ActorGroup]) -> list[Constraint]:
    """Every constraint of the scene, in the order in which an explanation tries to leave them out."""
    # A group without members constrains nothing.
    peopled = [group for group in order if member_count(simspec, group)]
    free = [group for group in peopled if not group.placement.at]
    home_text = f"actors keep {HOME_CLEARANCE_M:g} m from the vehicle's home"
    return [
        *(
            Constraint(
                field_path(group, "at"),
                f"{group.id!r} stands at {at.east_m:g} east, {at.north_m:g} north",
                group.id,
                "at",
                shapely_point(at),
            )
            for group in peopled
            if (at := group.placement.at)
        ),
        Constraint(HOME_FIELD, home_text, HOME_FIELD, "home", shapely_point(simspec.vehicle.home)),
        *(term for group in free for term in _member_constraints(simspec, group)),
    ]


def shapely_point(place: Point) -> Geometry:
    return shapely.Point(place.east_m, place.north_m)


def fixed_outline(group: ActorGroup) -> Geometry:
    return shapely.polygons(fixed_footprint(group).corners())[0]


def _member_constraints(simspec: SimSpec, group: ActorGroup) -> Iterator[Constraint]:
    place, asset, count = group.placement, group.definition, member_count(simspec, group)
    gap, members = place.separation_m, f"the {count} members of {group.id!r}"
    size = f"of {asset.length_m:g} by {asset.width_m:g} m, with {gap:g} m between them"
    text = f"{group.id!r} has {count} members {size}"
    yield Constraint(count_path(group), text, group.id, "need_m2", count * grown_area_m2(group, gap))
    if spread_m := place.spread_m:
        text = f"{members} are to stand {spread_m:g} m from each other"
        yield Constraint(field_path(group, "spread_m"), text, group.id, "spread_m", spread_m)
    if extent_m := place.extent_m:
        text = f"no two of {members} are to stand farther apart than {extent_m:g} m"
        yield Constraint(field_path(group, "extent_m"), text, group.id, "extent_m", extent_m)
    for number, item in enumerate(place.counts):
        text = f"{item.text} of {members} are to stand inside area {item.area!r}, none across its border"
        yield Constraint(field_path(group, f"counts[{number}]"), text, group.id, "count", item)
    for path, text, kind, fact in _wishes(simspec, group):
        yield Constraint(path, f"{group.id!r} is to {text}", group.id, kind, fact)
    if mean := place.mean_distance:
        text = f"the mean distance of {group.id!r} to {mean.of!r} is to be {mean.mean_m:g} m"
        yield Constraint(field_path(group, "mean_distance"), text, group.id, "mean", mean)


def _wishes(simspec: SimSpec, group: ActorGroup) -> Iterator[tuple[str, str, Kind, Any]]:
    """Path, words, kind and fact of what each member of a group is to do."""
    for relation in ground_relations(simspec, group):
        if (room := relation.ground()) is not None:
            yield relation.path, relation.text, "ground", room
    for tie in group_relations(simspec, group):
        # A relation to fixed points is known ground; one to a group waits for its members.
        if tie.points is None:
            yield tie.path, tie.text, "relation", tie
        elif (room := tie.bound(tie.points).ground()) is not None:
            yield tie.path, tie.text, "ground", room
    for between in between_relations(simspec, group):
        yield between.path, between.text, "between", between
    others = [other for other in simspec.actors if other.id != group.id and member_count(simspec, other)]
    if group.placement.hidden_from and not any(other.definition.solid for other in others):
        # An empty ground: nothing can hide the members, so they may stand nowhere.
        text = "stand out of sight, and no other group has a solid asset"
        yield field_path(group, "hidden_from"), text, "ground", shapely.Polygon()
    for heading in (road_heading(simspec, group), facing_heading(group)):
        if heading:
            yield heading.path, heading.text, "heading", heading
    if patrols(simspec, group):
        route_m = np.concatenate(list(route_points(simspec, group).values()))
        text = "walk straight from its place to some point of its patrol route"
        yield f"actors[{group.id}].motion.route", text, "route", route_m
