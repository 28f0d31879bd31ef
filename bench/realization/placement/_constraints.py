"""The constraints of a scene, each as its author wrote it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from bench.arrays import Floats
from bench.simspec import ASSETS, ActorGroup, MeanDistance, Sight, SimSpec

from ._between import Midway, midways
from ._capacity import _counted, _grown_area_m2
from ._distance_bands import Band, bands_of
from ._geometry import Geometry
from ._ground_relations import standing
from ._group_relations import ties
from ._groups import members_of
from ._headings import Heading, facing_of, parallel_of
from ._patrol_routes import loops, walks
from ._relations import HOME_CLEARANCE_M, Tie, field


@dataclass(frozen=True, slots=True)
class _Term:
    """One constraint as its author wrote it: what it asks of which group, and where it stands.

    Of the last seven, one is there: ground that centres must lie in, a tie, a mean distance, the area that the members' sizes
    and gaps need, how far they are spread, a heading, or the points of a route of which one must be walked to.
    """

    path: str
    text: str
    group: str
    room: Geometry | None = None
    tie: Tie | None = None
    midway: Midway | None = None
    mean: MeanDistance | None = None
    need_m2: float | None = None
    spread_m: float | None = None
    band: Band | None = None
    heading: Heading | None = None
    route_m: Floats | None = None


def _terms(simspec: SimSpec, order: Sequence[ActorGroup]) -> list[_Term]:
    """Every constraint of the scene, those first that an explanation had best do without."""
    peopled = [group for group in order if members_of(simspec, group)]
    fixed = [group for group in peopled if group.placement.at]
    free = [group for group in peopled if not group.placement.at]
    terms = [_fixed_term(group) for group in fixed]
    home = simspec.vehicle.home
    terms += [_Term("vehicle.home", f"nobody within {HOME_CLEARANCE_M:g} m of the vehicle's home", _HOME, room=_point(home))]
    for group in free:
        terms += _own_terms(simspec, group)
    return terms


_HOME = "vehicle.home"


def _point(place: object) -> Geometry:
    return shapely.Point(place.east_m, place.north_m)  # type: ignore[attr-defined]


def _fixed_term(group: ActorGroup) -> _Term:
    at = group.placement.at
    assert at is not None
    return _Term(
        field(group, "at"), f"{group.id!r} stands at {at.east_m:g} east, {at.north_m:g} north", group.id, room=_point(at)
    )


def _own_terms(simspec: SimSpec, group: ActorGroup) -> list[_Term]:
    count, asset, gap = members_of(simspec, group), ASSETS[group.asset], group.placement.separation_m
    size = f"of {asset.length_m:g} by {asset.width_m:g} m, with {gap:g} m between them"
    found = [
        _Term(
            f"actors[{group.id}].{_counted(group)}",
            f"{group.id!r} has {count} members {size}",
            group.id,
            need_m2=count * _grown_area_m2(group, gap),
        )
    ]
    if spread_m := group.placement.spread_m:
        text = f"the {count} members of {group.id!r} are to stand {spread_m:g} m from each other"
        found.append(_Term(field(group, "spread_m"), text, group.id, spread_m=spread_m))
    for relation in standing(simspec, group):
        if (room := relation.room()) is not None:
            found.append(_Term(relation.path, f"{group.id!r} is to {relation.text}", group.id, room=room))
    bands = bands_of(simspec, group)
    for tie in ties(simspec, group):
        text = f"{group.id!r} is to {tie.text}"
        if tie.points is None:
            found.append(_Term(tie.path, text, group.id, tie=tie, band=bands.get(tie.path)))
        elif (room := tie.bound(tie.points).room()) is not None:
            found.append(_Term(tie.path, text, group.id, room=room))
    for way in midways(simspec, group):
        found.append(_Term(way.path, f"{group.id!r} is to {way.text}", group.id, midway=way))
    if isinstance(group.placement.hidden_from, Sight) and not _anything_solid(simspec, group):
        text = f"{group.id!r} is to stand out of sight, and no other group is of anything solid"
        found.append(_Term(field(group, "hidden_from"), text, group.id, room=shapely.Polygon()))
    for heading in (parallel_of(simspec, group), facing_of(group)):
        if heading:
            found.append(_Term(heading.path, f"{group.id!r} is to {heading.text}", group.id, heading=heading))
    if walks(simspec, group):
        route_m = np.concatenate(list(loops(simspec, group).values()))
        text = f"{group.id!r} is to walk straight from its place to some point of its patrol route"
        found.append(_Term(f"actors[{group.id}].motion.route", text, group.id, route_m=route_m))
    if mean := group.placement.mean_distance:
        text = f"the mean distance of {group.id!r} to {mean.of!r} is to be {mean.mean_m:g} m"
        path = field(group, "mean_distance")
        found.append(_Term(path, text, group.id, mean=mean, band=bands[path]))
    return found


def _anything_solid(simspec: SimSpec, group: ActorGroup) -> bool:
    return any(ASSETS[one.asset].solid and members_of(simspec, one) for one in simspec.actors if one.id != group.id)
