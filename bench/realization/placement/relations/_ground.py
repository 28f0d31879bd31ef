"""Relations of single places: region, area, road, heading, and clearance from what is placed already."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import shapely

from bench.arrays import Bools
from bench.simspec import ActorGroup, Along, AreaCount, Road, SimSpec

from .._area_counts import prepared_area
from .._footprint import Footprints, are_inside, joined, too_close, too_close_pairs
from .._geometry import (
    EVERYWHERE,
    Geometry,
    grown_at_least,
    grown_at_most,
    is_convex,
    prepared_ground,
    road_ground,
    road_heading_deg,
)
from .._groups import centre_ground, hosts_of, inner_radius_m, member_count, outer_radius_m, region_of
from .._targets import home_obstacle
from ._relation import HOME_CLEARANCE_M, Relation, field_path


def ground_relations(simspec: SimSpec, group: ActorGroup) -> list[Relation]:
    """The relations of the group that depend on no other group."""
    region = prepared_ground(region_of(simspec, group))
    relations = [_inside_region(group, region)]
    if group.placement.inside and group.placement.inside.area:
        relations.append(_in_area(simspec, group, group.placement.inside.area))
    for number, avoid in enumerate(group.placement.avoid):
        if avoid.area is not None:
            relations.append(_outside(simspec, group, number, avoid.area, avoid.at_least_m))
    for number, count in enumerate(group.placement.counts):
        relations.append(_off_the_border(simspec, group, number, count))
    if group.placement.facing and group.placement.facing.heading_deg is not None:
        relations.append(
            _heading_relation(group, group.placement.facing.heading_deg, group.placement.facing.within_deg)
        )
    if group.placement.along:
        road = simspec.world.road(group.placement.along.road)
        relations += _road_relations(group, group.placement.along, road)
    return relations


def _inside_region(group: ActorGroup, region: Geometry) -> Relation:
    """The whole footprint inside a region."""
    path = field_path(group, "region") if group.placement.region else "world.area"
    return _within(path, f"stand inside its region of {region.area:.0f} m2", group, region)


def _in_area(simspec: SimSpec, group: ActorGroup, name: str) -> Relation:
    area = prepared_area(simspec, name)
    return _within(
        field_path(group, "inside"), f"stand inside area {name!r} of {area.area:.0f} m2", group, area
    )


def _outside(simspec: SimSpec, group: ActorGroup, number: int, name: str, gap_m: float) -> Relation:
    """No part of the footprint in an area, nor nearer to it than a gap."""
    area = prepared_area(simspec, name)
    gap_text = f", at least {gap_m:g} m off it" if gap_m else ""

    def keeps(candidates: Footprints) -> Bools:
        distance_m = shapely.distance(area, shapely.polygons(candidates.corners()))
        valid: Bools = (distance_m > 0.0) & (distance_m >= gap_m)
        return valid

    def ground() -> Geometry:
        # Errs to too little covered ground, since this part is taken away.
        return EVERYWHERE.difference(grown_at_most(area, gap_m + inner_radius_m(group)))

    return Relation(
        field_path(group, f"avoid[{number}]"), f"keep out of area {name!r}{gap_text}", keeps, ground
    )


def _off_the_border(simspec: SimSpec, group: ActorGroup, number: int, count: AreaCount) -> Relation:
    """The whole footprint inside an area, or no part of it; on one side alone where the count says so."""
    area, members = prepared_area(simspec, count.area), member_count(simspec, group)
    text = f"stand with {count.text} of its {members} members inside area {count.area!r}, and none across its border"
    path = field_path(group, f"counts[{number}]")
    inside, outside = _within(path, text, group, area), _outside(simspec, group, number, count.area, 0.0)
    if count.low >= members > 0:
        return inside
    if count.high(members) == 0:
        return Relation(path, text, outside.keeps, outside.ground)
    return Relation(path, text, lambda candidates: inside.keeps(candidates) | outside.keeps(candidates))


def _heading_relation(group: ActorGroup, heading_deg: float, within_deg: float) -> Relation:
    def keeps(candidates: Footprints) -> Bools:
        # Into -180 to 180 degrees, so that 359 and 1 are 2 degrees apart.
        off = np.abs((np.degrees(candidates.heading_rad) - heading_deg + 180.0) % 360.0 - 180.0)
        valid: Bools = off <= within_deg + 1e-9
        return valid

    return Relation(
        field_path(group, "facing"), f"head {heading_deg:g} degrees within {within_deg:g} degrees", keeps
    )


def _within(path: str, text: str, group: ActorGroup, region: Geometry) -> Relation:
    convex = is_convex(region)

    def keeps(candidates: Footprints) -> Bools:
        corners = candidates.corners()
        valid: Bools = shapely.contains_xy(region, corners[..., 0], corners[..., 1]).all(axis=1)
        # In a concave region an edge may cross a bay although both corners are inside.
        if not convex:
            valid[valid] = shapely.contains(region, shapely.polygons(corners[valid]))
        return valid

    return Relation(path, text, keeps, lambda: centre_ground(region, group))


def clearance(simspec: SimSpec, group: ActorGroup, placed: Mapping[str, Footprints]) -> Relation:
    """Clearance from everything placed and from the vehicle's home, except from the group's hosts."""
    around = hosts_of(simspec, group)
    obstacles = joined(
        [home_obstacle(simspec), *(members for name, members in placed.items() if name not in around)]
    )
    hosts = joined([placed[name] for name in around if name in placed])
    text = (
        f"keep {group.placement.separation_m:g} m clear of the {len(obstacles) + len(hosts) - 1} actors already placed, "
        f"and {HOME_CLEARANCE_M:g} m of the vehicle's home"
    )

    def keeps(members: Footprints) -> Bools:
        hit = too_close(members, obstacles)
        if len(hosts):
            rows, host_rows = too_close_pairs(members, hosts)
            hit[rows[~are_inside(members[rows], hosts[host_rows])]] = True
        return ~hit

    return Relation(field_path(group, "separation_m"), text, keeps)


def _road_relations(group: ActorGroup, along: Along, road: Road) -> Iterator[Relation]:
    ground_m2 = road_ground(road)
    shapely.prepare(ground_m2)

    def on(candidates: Footprints) -> Bools:
        valid: Bools = shapely.covers(ground_m2, shapely.polygons(candidates.corners()))
        return valid

    def beside(candidates: Footprints) -> Bools:
        gap = shapely.distance(ground_m2, shapely.polygons(candidates.corners()))
        valid: Bools = (gap > 0.0) & (gap >= along.at_least_m) & (gap <= along.within_m)
        return valid

    if along.where == "on":
        text = f"stand on road {road.id!r} of {road.width_m:g} m width"
        yield Relation(field_path(group, "along"), text, on, lambda: centre_ground(ground_m2, group))
    else:

        def verge() -> Geometry:
            # Errs to too little covered ground, since this part is taken away.
            covered = grown_at_most(ground_m2, along.at_least_m + inner_radius_m(group))
            return grown_at_least(ground_m2, along.within_m + outer_radius_m(group)).difference(covered)

        yield Relation(
            field_path(group, "along"),
            f"stand beside road {road.id!r}, {along.gap_text} off it",
            beside,
            verge,
        )
    if along.parallel_deg is not None:
        limit = along.parallel_deg

        def parallel(candidates: Footprints) -> Bools:
            # Modulo 180 degrees: either direction of the road is parallel to it.
            off = np.abs(
                (np.degrees(candidates.heading_rad) - road_heading_deg(road, candidates.centre_m) + 90.0)
                % 180.0
                - 90.0
            )
            valid: Bools = off <= limit + 1e-9
            return valid

        text = f"head along road {road.id!r} within {limit:g} degrees"
        yield Relation(field_path(group, "along.parallel_deg"), text, parallel)
