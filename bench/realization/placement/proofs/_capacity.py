"""Bounds by area alone that refuse a scene before anything is tried."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import pi

import numpy as np

from bench.arrays import Floats
from bench.errors import PlacementInfeasible
from bench.simspec import ActorGroup, Near, Polygon, SimSpec

from .._area_counts import named_area
from .._fitting import REMEMBERED_ANSWERS, may_fit
from .._geometry import grown_at_least, polygon_ground, road_ground
from .._groups import hosts_of, is_home, member_count, outer_radius_m, region_of, smallest_failing
from ..relations._relation import field_path

# Areas that differ by less are equal, so that the rounding of sums refuses nothing that fits exactly.
AREA_TOLERANCE_M2 = 1e-3


def check_areas(simspec: SimSpec) -> None:
    """Refuse at once what cannot fit: footprints grown by half their gap do not overlap.

    Raises PlacementInfeasible.
    """
    free = [group for group in simspec.actors if group.placement.at is None and member_count(simspec, group)]
    regions: dict[Polygon, list[ActorGroup]] = {}
    for group in free:
        _check_footprint(simspec, group)
        if not hosts_of(simspec, group):
            regions.setdefault(region_of(simspec, group), []).append(group)
    for region, groups in regions.items():
        _check_region(simspec, region, groups)
    for group in simspec.actors:
        if group.placement.near:
            _check_near(simspec, group, group.placement.near)
        _check_inside(simspec, group)


def _check_footprint(simspec: SimSpec, group: ActorGroup) -> None:
    """Refuse a member that is larger than the ground on which it must stand."""
    place, asset = group.placement, group.definition
    region = polygon_ground(region_of(simspec, group))
    what = "its region" if place.region else "the area of interest"
    grounds = [(_region_path(group), f"{what} of {region.area:.0f} m2", region)]
    areas = [(field_path(group, "inside"), place.inside.area)] if place.inside and place.inside.area else []
    areas += [
        (field_path(group, f"counts[{number}]"), count.area)
        for number, count in enumerate(place.counts)
        if count.low
    ]
    for path, name in areas:
        area = named_area(simspec, name)
        grounds.append((path, f"area {name!r} of {area.area:.0f} m2", area))
    if place.along and place.along.where == "on":
        road = simspec.world.road(place.along.road)
        text = f"road {road.id!r} of {road.width_m:g} m width"
        grounds.append((field_path(group, "along"), text, road_ground(road)))
    for path, text, ground in grounds:
        if not may_fit(ground, asset):
            raise PlacementInfeasible(
                f"impossible, and proved so: a {group.asset} of {asset.length_m:g} by {asset.width_m:g} m does not fit into "
                f"{text} ({path}) at any heading: give {group.id!r} more ground, or a smaller asset",
                clash=(path,),
            )


def _need(simspec: SimSpec, groups: Sequence[ActorGroup]) -> tuple[float, float]:
    """The least gap of the groups, and the area that all members need with it."""
    gap = min((group.placement.separation_m for group in groups), default=0.0)
    return gap, sum(member_count(simspec, group) * grown_area_m2(group, gap) for group in groups)


def _require_room(
    simspec: SimSpec,
    groups: Sequence[ActorGroup],
    room_m2: float,
    where: str,
    remedy: str,
    clash: Sequence[str],
) -> None:
    """Refuse groups that need more area than there is."""
    gap, need = _need(simspec, groups)
    if need > room_m2 + AREA_TOLERANCE_M2:
        names = ", ".join(f"{member_count(simspec, group)} of {group.id!r}" for group in groups)
        raise PlacementInfeasible(
            f"{names} need at least {need:.0f} m2 with {gap:g} m between them, but {where} {room_m2:.0f} m2: {remedy}",
            clash=tuple(clash),
        )


def _check_region(simspec: SimSpec, region: Polygon, groups: Sequence[ActorGroup]) -> None:
    def room_m2(members: Sequence[ActorGroup]) -> float:
        return _offered_m2(region, _need(simspec, members)[0])

    def fails(members: Sequence[ActorGroup]) -> bool:
        return _need(simspec, members)[1] > room_m2(members) + AREA_TOLERANCE_M2

    if fails(groups):
        core = smallest_failing(groups, fails)
        where = f"their region of {region.area_m2:.0f} m2 offers"
        remedy = "lower the counts, lower separation_m or widen the region"
        clash = [count_path(group) for group in core] + list(dict.fromkeys(map(_region_path, core)))
        _require_room(simspec, core, room_m2(core), where, remedy, clash)


@lru_cache(REMEMBERED_ANSWERS)
def _offered_m2(region: Polygon, gap_m: float) -> float:
    return float(grown_at_least(polygon_ground(region), gap_m / 2.0).area)


def _check_near(simspec: SimSpec, group: ActorGroup, relation: Near) -> None:
    """The same near others: a grown footprint reaches half its gap and its radius beyond the band."""
    # The centre lies in the band; a footprint reaches half its diagonal, and its margin half its gap further.
    reach_m = outer_radius_m(group) + group.placement.separation_m / 2.0
    hole_m = max(0.0, relation.min_m - reach_m)
    others = 1 if is_home(simspec, relation.of) else member_count(simspec, simspec.group(relation.of))
    room = others * pi * ((relation.max_m + reach_m) ** 2 - hole_m**2)
    where = f"within {relation.min_m:g} to {relation.max_m:g} m of {relation.of!r} there are"
    remedy = "lower the count or separation_m, or raise max_m"
    _require_room(simspec, [group], room, where, remedy, (count_path(group), field_path(group, "near")))


def _check_inside(simspec: SimSpec, host: ActorGroup) -> None:
    """The same for guests inside hosts: guests grown by half their gap lie inside hosts grown as much."""
    guests = [
        guest
        for guest in simspec.actors
        if guest.placement.inside and guest.placement.inside.of == host.id and member_count(simspec, guest)
    ]
    count = member_count(simspec, host)
    room = count * grown_area_m2(host, _need(simspec, guests)[0])
    where = f"inside the {count} of {host.id!r} there are"
    remedy = f"lower the counts or separation_m, or raise the number of {host.id!r}"
    clash = [path for guest in guests for path in (count_path(guest), field_path(guest, "inside"))]
    _require_room(simspec, guests, room, where, remedy, clash)


def _region_path(group: ActorGroup) -> str:
    return field_path(group, "region") if group.placement.region else "world.area"


def count_path(group: ActorGroup) -> str:
    return f"actors[{group.id}].{'count' if group.count is not None else 'density_per_km2'}"


def grown_area_m2(group: ActorGroup, gap_m: float) -> float:
    """The area of a member's footprint grown by half a gap, corners round."""
    asset = group.definition
    return asset.length_m * asset.width_m + (asset.length_m + asset.width_m) * gap_m + pi * gap_m**2 / 4.0


def crowded_distances_m(group: ActorGroup, count: int) -> Floats:
    """(count,) least distances from any point to the nearest, second nearest ... member: k grown footprints
    that reach no further than the k-th centre and their own outer radius must fit into that circle.
    """
    gap = group.placement.separation_m
    area = grown_area_m2(group, gap)
    least: Floats = np.sqrt(np.arange(1, count + 1) * area / pi) - outer_radius_m(group) - gap / 2.0
    return np.maximum(least, 0.0)
