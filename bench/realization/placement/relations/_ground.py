"""Relations of single places: region, area, road, heading, and clearance from what is placed already."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import shapely

from bench.arrays import Bools, Floats
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
from ._headings import RequiredHeading, facing_heading, road_heading
from ._relation import HOME_CLEARANCE_M, Relation, field_path


def ground_relations(simspec: SimSpec, group: ActorGroup) -> list[Relation]:
    """The relations of the group that depend on no other group."""
    place = group.placement
    region = prepared_ground(region_of(simspec, group))
    path = field_path(group, "region") if place.region else "world.area"
    relations = [_within(path, f"stand inside its region of {region.area:.0f} m2", group, region)]
    if place.inside and place.inside.area:
        area = prepared_area(simspec, place.inside.area)
        text = f"stand inside area {place.inside.area!r} of {area.area:.0f} m2"
        relations.append(_within(field_path(group, "inside"), text, group, area))
    for number, avoid in enumerate(place.avoid):
        if avoid.area is not None:
            relations.append(_outside(simspec, group, number, avoid.area, avoid.at_least_m))
    for number, count in enumerate(place.counts):
        relations.append(_off_the_border(simspec, group, number, count))
    facing, parallel = facing_heading(group), road_heading(simspec, group)
    if facing and place.facing and (course_deg := place.facing.heading_deg) is not None:
        # Modulo 360 degrees, so that 359 and 1 are 2 degrees apart.
        relations.append(_heading_relation(facing, lambda places_m: course_deg, 360.0))
    if place.along:
        road = simspec.world.road(place.along.road)
        relations.append(_road_relation(group, place.along, road))
        if parallel:
            # Modulo 180 degrees: either direction of the road is parallel to it.
            relations.append(
                _heading_relation(parallel, lambda places_m: road_heading_deg(road, places_m), 180.0)
            )
    return relations


def _outside(simspec: SimSpec, group: ActorGroup, number: int, name: str, gap_m: float) -> Relation:
    """No part of the footprint in an area, nor nearer to it than a gap."""
    area = prepared_area(simspec, name)
    gap_text = f", at least {gap_m:g} m off it" if gap_m else ""

    def keeps(candidates: Footprints) -> Bools:
        distance_m = shapely.distance(area, shapely.polygons(candidates.corners()))
        return np.asarray((distance_m > 0.0) & (distance_m >= gap_m))

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


def _heading_relation(
    required: RequiredHeading, course_deg: Callable[[Floats], Floats | float], period_deg: float
) -> Relation:
    def keeps(candidates: Footprints) -> Bools:
        off_deg = np.degrees(candidates.heading_rad) - course_deg(candidates.centre_m)
        turn_deg = np.abs((off_deg + period_deg / 2.0) % period_deg - period_deg / 2.0)
        return np.asarray(turn_deg <= required.within_deg + 1e-9)

    return Relation(required.path, required.text, keeps)


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


def _road_relation(group: ActorGroup, along: Along, road: Road) -> Relation:
    ground_m2 = road_ground(road)
    shapely.prepare(ground_m2)
    path = field_path(group, "along")

    def on(candidates: Footprints) -> Bools:
        return np.asarray(shapely.covers(ground_m2, shapely.polygons(candidates.corners())))

    def beside(candidates: Footprints) -> Bools:
        gap = shapely.distance(ground_m2, shapely.polygons(candidates.corners()))
        return np.asarray((gap > 0.0) & (gap >= along.at_least_m) & (gap <= along.within_m))

    def verge() -> Geometry:
        # Errs to too little covered ground, since this part is taken away.
        covered = grown_at_most(ground_m2, along.at_least_m + inner_radius_m(group))
        return grown_at_least(ground_m2, along.within_m + outer_radius_m(group)).difference(covered)

    if along.where == "on":
        text = f"stand on road {road.id!r} of {road.width_m:g} m width"
        return Relation(path, text, on, lambda: centre_ground(ground_m2, group))
    return Relation(path, f"stand beside road {road.id!r}, {along.gap_text} off it", beside, verge)
