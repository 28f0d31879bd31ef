"""Geometry of the judge of placements, which shares no code with the search."""

from __future__ import annotations

import math
from functools import lru_cache

import shapely

from bench.simspec import Distance, Near, PlacedActor, PlacedReport, Point, Polygon, Realized, SimSpec

# Slacks absorb rounding alone: places are millimetres, headings microdegrees, so real faults are far larger.
SLACK_M = 1e-6

Spot = Point | PlacedActor | PlacedReport


def footprint_outlines(simspec: SimSpec, realized: Realized) -> dict[str, shapely.Polygon]:
    assets = {group.id: group.definition for group in simspec.actors if group.is_known}
    known = [(actor, assets[actor.group]) for actor in realized.actors if actor.group in assets]
    # All at once and by hand: shapely's own turning of a box takes far longer, and every scene is judged.
    rings = []
    for actor, asset in known:
        heading = math.radians(actor.heading_deg)
        ahead, aside = asset.length_m / 2, asset.width_m / 2
        east, north = ahead * math.sin(heading), ahead * math.cos(heading)
        right_east, right_north = aside * math.cos(heading), -aside * math.sin(heading)
        rings.append(
            [
                (
                    actor.east_m + fore * east + side * right_east,
                    actor.north_m + fore * north + side * right_north,
                )
                for fore, side in ((1, 1), (1, -1), (-1, -1), (-1, 1))
            ]
        )
    outlines = shapely.polygons(rings) if rings else []
    return {actor.id: outline for (actor, _), outline in zip(known, outlines, strict=True)}


def point_of(place: Spot) -> shapely.Point:
    return shapely.Point(place.east_m, place.north_m)


def apart_m(first: Spot, second: Spot) -> float:
    return math.hypot(first.east_m - second.east_m, first.north_m - second.north_m)


def bearing_deg(start: Spot, end: Spot) -> float:
    return math.degrees(math.atan2(end.east_m - start.east_m, end.north_m - start.north_m)) % 360.0


def turn_deg(one_deg: float, other_deg: float) -> float:
    return abs((one_deg - other_deg + 180.0) % 360.0 - 180.0)


def slant_deg(one_deg: float, other_deg: float) -> float:
    return min(turn_deg(one_deg, other_deg), turn_deg(one_deg + 180.0, other_deg))


def walked_point(area: shapely.Polygon, point: shapely.Point, held: bool) -> shapely.Point:
    """A route point as the simulation walks it: moved half a metre inside the border when it lies beyond."""
    if not held or area.contains(point):
        return point
    nearest = area.exterior.interpolate(area.exterior.project(point))
    share = 1.0 + 0.5 / max(nearest.distance(point), 1e-9)
    return shapely.Point(point.x + share * (nearest.x - point.x), point.y + share * (nearest.y - point.y))


def ground_of(polygon: Polygon) -> shapely.Polygon:
    return shapely.Polygon([(corner.east_m, corner.north_m) for corner in polygon.corners])


@lru_cache(64)
def grown_polygon(polygon: Polygon) -> shapely.Polygon:
    return ground_of(polygon).buffer(SLACK_M)


def is_in_band(band: Near | Distance, distance_m: float) -> bool:
    """Whether a distance keeps a relation."""
    most_m = math.inf if band.max_m is None else band.max_m
    return band.min_m - SLACK_M <= distance_m <= most_m + SLACK_M
