"""Geometry of the ground: polygons grown and shrunk with a known direction of error, roads, places."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from math import cos, pi
from threading import get_ident
from typing import Any

import numpy as np
import shapely
import shapely.affinity

from bench.arrays import Floats
from bench.simspec import Polygon, Road

Geometry = Any
"""A shapely geometry; shapely ships no types."""

QUARTER_SEGMENTS = 16

# Factor by which a polygon of `QUARTER_SEGMENTS` edges a quarter must exceed the circle that it contains.
_CIRCUMSCRIBED = 1.0 / cos(pi / (4 * QUARTER_SEGMENTS))

# More ground than any coordinate in a document can reach.
# A finite box, because overlays of unbounded ground do not exist in GEOS.
EVERYWHERE = shapely.box(-3e5, -3e5, 3e5, 3e5)

# Extra width left when ground shrinks, so that what fits exactly survives: GEOS drops slivers thinner than about
# 5e-5 of the distance by which it shrinks a polygon.
MARGIN_M = 1e-3

# GEOS drops corners shallower than this share of the distance by which it grows or shrinks.
SHALLOW_CORNER = 0.01

MAX_COORDINATES = 64

SIMPLIFY_M = 0.1

# Scenes of a campaign share their few polygons. Enough for one campaign; chosen, not measured.
REMEMBERED_POLYGONS = 256

Corners = tuple[tuple[float, float], ...]
"""East and north of each corner: compared sooner than the documents that they come from."""


def polygon_ground(polygon: Polygon) -> Geometry:
    """The polygon as a shapely polygon, which all who ask share: do not prepare it."""
    return _ground(_corners(polygon))


def prepared_ground(polygon: Polygon) -> Geometry:
    """The same, prepared for many questions by one thread."""
    return _prepared_ground(_corners(polygon), get_ident())


def _corners(polygon: Polygon) -> Corners:
    return tuple([(corner.east_m, corner.north_m) for corner in polygon.corners])


@lru_cache(REMEMBERED_POLYGONS)
def _ground(corners: Corners) -> Geometry:
    return shapely.Polygon(corners)


@lru_cache(REMEMBERED_POLYGONS)
def _prepared_ground(corners: Corners, thread: int) -> Geometry:
    # For each thread its own: GEOS builds a prepared polygon's index at the first question, without a lock.
    del thread
    ground = shapely.Polygon(corners)
    shapely.prepare(ground)
    return ground


@lru_cache(REMEMBERED_POLYGONS)
def is_convex(ground: Geometry) -> bool:
    """Whether a polygon has no bays."""
    return bool(ground.equals(ground.convex_hull))


def grown_at_least(geometry: Geometry, distance_m: float) -> Geometry:
    """All ground within a distance; errs to too much."""
    return shapely.buffer(geometry, distance_m * _CIRCUMSCRIBED + 1e-6, quad_segs=QUARTER_SEGMENTS)


def shrunk_at_most(geometry: Geometry, distance_m: float) -> Geometry:
    """All ground further than a distance from the outside; errs to too much."""
    return shapely.buffer(
        geometry, MARGIN_M - _reliable_distance_m(geometry, distance_m), quad_segs=QUARTER_SEGMENTS
    )


def grown_at_most(geometry: Geometry, distance_m: float) -> Geometry:
    """All ground within a distance; errs to too little."""
    return shapely.buffer(
        geometry, max(_reliable_distance_m(geometry, distance_m) - MARGIN_M, 0.0), quad_segs=QUARTER_SEGMENTS
    )


def _reliable_distance_m(geometry: Geometry, distance_m: float) -> float:
    """The distance, or slightly less where GEOS would drop corners."""
    for ring in shapely.get_rings(geometry):
        east, north = shapely.get_coordinates(ring).T
        # `step` leads from the previous corner to this one, `chord` from the previous corner to the next.
        step_e, step_n = np.diff(east[:-1], prepend=east[-2]), np.diff(north[:-1], prepend=north[-2])
        chord_e, chord_n = east[1:] - east[:-1] + step_e, north[1:] - north[:-1] + step_n
        off = np.abs(chord_e * step_n - chord_n * step_e)
        if (off <= 1.1 * SHALLOW_CORNER * distance_m * np.hypot(chord_e, chord_n)).any():
            return (1.0 - 2.0 * SHALLOW_CORNER) * distance_m
    return distance_m


def areal_parts(geometry: Geometry) -> Geometry:
    """The parts with an area: overlays also leave points and lines, on which the next overlay may fail."""
    if shapely.get_type_id(geometry) != shapely.GeometryType.GEOMETRYCOLLECTION:
        return geometry
    parts = shapely.get_parts(geometry)
    return shapely.union_all(parts[shapely.area(parts) > 0.0])


def thickened(geometry: Geometry) -> Geometry:
    """The geometry as areas alone: points and lines beside areas are grown by `MARGIN_M`."""
    if shapely.get_type_id(geometry) != shapely.GeometryType.GEOMETRYCOLLECTION:
        return geometry
    return shapely.union_all(shapely.buffer(shapely.get_parts(geometry), MARGIN_M, quad_segs=2))


def road_ground(road: Road) -> Geometry:
    """The ground that a road covers."""
    line = shapely.LineString([(point.east_m, point.north_m) for point in road.points])
    return shapely.buffer(line, road.width_m / 2.0, cap_style="flat", join_style="mitre", mitre_limit=2.0)


def road_heading_deg(road: Road, places_m: Floats) -> Floats:
    """(n,) heading of the stretch of the road nearest to each of (n, 2) places."""
    points = np.array([(point.east_m, point.north_m) for point in road.points])
    lines = np.array([shapely.LineString(pair) for pair in pairwise(points)])
    step = np.diff(points, axis=0)
    heading: Floats = np.degrees(np.arctan2(step[:, 0], step[:, 1]))
    nearest = shapely.distance(shapely.points(places_m)[:, None], lines[None, :]).argmin(axis=1)
    return np.asarray(heading[nearest], dtype=np.float64)


def bounding_octagon(geometry: Geometry) -> Geometry:
    """The convex hull, or an octagon that contains it."""
    hull = shapely.convex_hull(geometry)
    if shapely.get_num_coordinates(hull) <= 9:
        return hull
    turned = shapely.affinity.rotate(hull, 45.0, origin=(0.0, 0.0)).envelope
    return shapely.intersection(
        hull.envelope.buffer(1e-6, join_style="mitre"),
        shapely.affinity.rotate(turned, -45.0, origin=(0.0, 0.0)).buffer(1e-6, join_style="mitre"),
    )


def hull_ways(start: Geometry, end: Geometry) -> Floats:
    """(n, 2) the ways from each corner of one ground's hull to each corner of another's."""
    starts, ends = (shapely.get_coordinates(shapely.convex_hull(ground)) for ground in (start, end))
    return np.asarray((ends[None, :, :] - starts[:, None, :]).reshape(-1, 2))


def simplified(geometry: Geometry) -> Geometry:
    """The geometry, or a simpler one that contains it: a proof's time grows with the number of corners."""
    if shapely.get_num_coordinates(geometry) <= MAX_COORDINATES:
        return geometry
    return shapely.buffer(shapely.simplify(geometry, SIMPLIFY_M), SIMPLIFY_M * 1.1, quad_segs=2)


def uniform_places(room: Geometry, count: int, rng: np.random.Generator) -> Floats:
    """(count, 2) places, uniform over one or several polygons."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(room))
    area = shapely.area(triangles)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    # Triangles by area, then a uniform point in each: Osada, R. et al. (2002), "Shape distributions", section
    # 4.2.
    # The square root below keeps points from crowding at the first corner.
    chosen = corners[rng.choice(len(area), size=count, p=area / area.sum())]
    first, second = np.sqrt(rng.uniform(size=(count, 1))), rng.uniform(size=(count, 1))
    return np.asarray(
        (1 - first) * chosen[:, 0] + first * (1 - second) * chosen[:, 1] + first * second * chosen[:, 2]
    )
