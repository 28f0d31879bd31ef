"""Bounds by area alone that refuse a scene before anything is tried."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from math import hypot, pi

from bench.errors import PlacementInfeasible
from bench.simspec import ASSETS, ActorGroup, Near, Polygon, SimSpec

from .._area_counts import named_area
from .._fitting import REMEMBERED_ANSWERS, may_fit
from .._geometry import grown_at_least, polygon_ground, road_ground
from .._groups import hosts_of, is_home, member_count, region_of
from .._infeasible import fewest_groups
from ..relations._relation import field_path

# Areas that differ by less are equal, so that the rounding of sums refuses nothing that fits exactly.
AREA_TOLERANCE_M2 = 1e-3


def check_areas(simspec: SimSpec) -> None:
    """Refuse at once what cannot fit: footprints grown by half their gap do not overlap, so their areas add
    up.

    Raises PlacementInfeasible.
    """
    for group in simspec.actors:
        if group.placement.at is None and member_count(simspec, group):
            _check_footprint(simspec, group)
    needs: dict[Polygon, list[ActorGroup]] = {}
    for group in simspec.actors:
        if group.placement.at is None and member_count(simspec, group) and not hosts_of(simspec, group):
            needs.setdefault(region_of(simspec, group), []).append(group)
    for region, groups in needs.items():
        if _overfull(simspec, region, groups):
            _refuse_overfull(simspec, region, fewest_groups(groups, partial(_overfull, simspec, region)))
    for group in simspec.actors:
        if group.placement.near:
            _check_area_near(simspec, group, group.placement.near)
        _check_area_inside(simspec, group)


def _check_footprint(simspec: SimSpec, group: ActorGroup) -> None:
    """Refuse a member that is larger than the ground on which it must stand."""
    place, asset = group.placement, ASSETS[group.asset]
    region = polygon_ground(region_of(simspec, group))
    grounds = [
        (
            field_path(group, "region") if place.region else "world.area",
            f"{'its region' if place.region else 'the area of interest'} of {region.area:.0f} m2",
            region,
        )
    ]
    if place.inside and place.inside.area:
        area = named_area(simspec, place.inside.area)
        text = f"area {place.inside.area!r} of {area.area:.0f} m2"
        grounds.append((field_path(group, "inside"), text, area))
    for number, count in enumerate(place.counts):
        if count.low:
            area = named_area(simspec, count.area)
            text = f"area {count.area!r} of {area.area:.0f} m2"
            grounds.append((field_path(group, f"counts[{number}]"), text, area))
    if place.along and place.along.where == "on":
        road = next(road for road in simspec.world.roads if road.id == place.along.road)
        text = f"road {road.id!r} of {road.width_m:g} m width"
        grounds.append((field_path(group, "along"), text, road_ground(road)))
    for path, text, ground in grounds:
        if not may_fit(ground, asset):
            raise PlacementInfeasible(
                f"impossible, and proved so: a {group.asset} of {asset.length_m:g} by {asset.width_m:g} m does not fit into "
                f"{text} ({path}) at any heading: give {group.id!r} more ground, or a smaller asset",
                clash=(path,),
            )


def _area_needs(
    simspec: SimSpec, region: Polygon, groups: Sequence[ActorGroup]
) -> tuple[float, float, float]:
    """The least gap of the groups, the area that all members need with it, and the area that the region
    offers.
    """
    gap = min(group.placement.separation_m for group in groups)
    need = sum(member_count(simspec, group) * grown_area_m2(group, gap) for group in groups)
    return gap, need, _offered_m2(region, gap)


@lru_cache(REMEMBERED_ANSWERS)
def _offered_m2(region: Polygon, gap_m: float) -> float:
    return float(grown_at_least(polygon_ground(region), gap_m / 2.0).area)


def _overfull(simspec: SimSpec, region: Polygon, groups: Sequence[ActorGroup]) -> bool:
    _, need, room = _area_needs(simspec, region, groups)
    return need > room + AREA_TOLERANCE_M2


def _refuse_overfull(simspec: SimSpec, region: Polygon, groups: Sequence[ActorGroup]) -> None:
    gap, need, room = _area_needs(simspec, region, groups)
    names = ", ".join(f"{member_count(simspec, group)} of {group.id!r}" for group in groups)
    regions = [field_path(group, "region") if group.placement.region else "world.area" for group in groups]
    raise PlacementInfeasible(
        f"{names} need at least {need:.0f} m2 with {gap:g} m between them, but their region of {region.area_m2:.0f} m2 "
        f"offers {room:.0f} m2: lower the counts, lower separation_m or widen the region",
        clash=(*(f"actors[{group.id}].{count_field(group)}" for group in groups), *dict.fromkeys(regions)),
    )


def _check_area_near(simspec: SimSpec, group: ActorGroup, relation: Near) -> None:
    """The same for members near others: a grown footprint reaches no further than its band, its own radius
    and half its gap.
    """
    asset, gap = ASSETS[group.asset], group.placement.separation_m
    # The centre lies in the band; a footprint reaches half its diagonal, and its margin half its gap further.
    reach_m = (hypot(asset.length_m, asset.width_m) + gap) / 2.0
    hole_m = max(0.0, relation.min_m - reach_m)
    others = 1 if is_home(simspec, relation.of) else member_count(simspec, simspec.group(relation.of))
    room = others * pi * ((relation.max_m + reach_m) ** 2 - hole_m**2)
    need = member_count(simspec, group) * grown_area_m2(group, gap)
    if need > room + AREA_TOLERANCE_M2:
        raise PlacementInfeasible(
            f"{member_count(simspec, group)} of {group.id!r} need at least {need:.0f} m2 with {gap:g} m between them, but within "
            f"{relation.min_m:g} to {relation.max_m:g} m of {relation.of!r} there are {room:.0f} m2: lower the count or separation_m, or raise max_m",
            clash=(f"actors[{group.id}].{count_field(group)}", field_path(group, "near")),
        )


def _check_area_inside(simspec: SimSpec, host: ActorGroup) -> None:
    """The same for guests inside hosts: guests grown by half their gap lie inside hosts grown as much."""
    guests = [
        guest for guest in simspec.actors if guest.placement.inside and guest.placement.inside.of == host.id
    ]
    guests = [guest for guest in guests if member_count(simspec, guest)]
    gap = min((guest.placement.separation_m for guest in guests), default=0.0)
    need = sum(member_count(simspec, guest) * grown_area_m2(guest, gap) for guest in guests)
    room = member_count(simspec, host) * grown_area_m2(host, gap)
    if need > room + AREA_TOLERANCE_M2:
        names = ", ".join(f"{member_count(simspec, guest)} of {guest.id!r}" for guest in guests)
        raise PlacementInfeasible(
            f"{names} need at least {need:.0f} m2 with {gap:g} m between them, but inside the {member_count(simspec, host)} of "
            f"{host.id!r} there are {room:.0f} m2: lower the counts or separation_m, or raise the number of {host.id!r}",
            clash=tuple(
                path
                for guest in guests
                for path in (f"actors[{guest.id}].{count_field(guest)}", field_path(guest, "inside"))
            ),
        )


def count_field(group: ActorGroup) -> str:
    return "count" if group.count is not None else "density_per_km2"


def grown_area_m2(group: ActorGroup, gap_m: float) -> float:
    asset = ASSETS[group.asset]
    return asset.length_m * asset.width_m + (asset.length_m + asset.width_m) * gap_m + pi * gap_m**2 / 4.0
