"""The ground as geometry: what lies within a distance of it, on a road, and places drawn from it."""

from __future__ import annotations

from itertools import pairwise
from math import cos, pi
from typing import Any

import numpy as np
import shapely
import shapely.affinity

from bench.arrays import Floats
from bench.simspec import Polygon, Road

Geometry = Any
"""A shapely geometry; shapely ships no types."""


QUARTER_SEGMENTS = 16


_CIRCUMSCRIBED = 1.0 / cos(pi / (4 * QUARTER_SEGMENTS))
"""By how much a polygon of `ARC` edges for a quarter must be wider than the circle that it is to hold."""


EVERYWHERE = shapely.box(-3e5, -3e5, 3e5, 3e5)
"""More ground than any document can name."""


MARGIN_M = 1e-3
"""By how much ground is left too wide, so that what fits exactly is not lost: slivers thinner than some 5e-5 of the distance by
which a polygon is shrunk are, in GEOS."""


SHALLOW_CORNER = 0.01
"""GEOS leaves out corners that are shallower than this share of the distance by which it grows or shrinks a geometry."""


MAX_COORDINATES = 64


SIMPLIFY_M = 0.1


def polygon_ground(polygon: Polygon) -> Geometry:
    """The polygon as a shapely one."""
    return shapely.Polygon([(corner.east_m, corner.north_m) for corner in polygon.corners])


def grown_at_least(geometry: Geometry, distance_m: float) -> Geometry:
    """Everything within a distance, rather too much than too little."""
    return shapely.buffer(geometry, distance_m * _CIRCUMSCRIBED + 1e-6, quad_segs=QUARTER_SEGMENTS)


def shrunk_at_most(geometry: Geometry, distance_m: float) -> Geometry:
    """Everything further than a distance from whatever is outside, rather too much than too little."""
    return shapely.buffer(geometry, MARGIN_M - _reliable_distance_m(geometry, distance_m), quad_segs=QUARTER_SEGMENTS)


def grown_at_most(geometry: Geometry, distance_m: float) -> Geometry:
    """Everything within a distance, rather too little than too much."""
    return shapely.buffer(geometry, max(_reliable_distance_m(geometry, distance_m) - MARGIN_M, 0.0), quad_segs=QUARTER_SEGMENTS)


def _reliable_distance_m(geometry: Geometry, distance_m: float) -> float:
    """The distance, or less where GEOS would leave out corners."""
    for ring in shapely.get_rings(geometry):
        east, north = shapely.get_coordinates(ring).T
        # From the corner before to this one, and to the one behind it.
        step_e, step_n = np.diff(east[:-1], prepend=east[-2]), np.diff(north[:-1], prepend=north[-2])
        chord_e, chord_n = east[1:] - east[:-1] + step_e, north[1:] - north[:-1] + step_n
        off = np.abs(chord_e * step_n - chord_n * step_e)
        if (off <= 1.1 * SHALLOW_CORNER * distance_m * np.hypot(chord_e, chord_n)).any():
            return (1.0 - 2.0 * SHALLOW_CORNER) * distance_m
    return distance_m


def areal_parts(geometry: Geometry) -> Geometry:
    """The parts that have an area: overlays leave points and lines beside them, on which the next overlay may founder."""
    if shapely.get_type_id(geometry) != shapely.GeometryType.GEOMETRYCOLLECTION:
        return geometry
    parts = shapely.get_parts(geometry)
    return shapely.union_all(parts[shapely.area(parts) > 0.0])


def thickened(geometry: Geometry) -> Geometry:
    """The geometry, of one dimension: points and lines beside areas become areas a hair wide."""
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
    """The geometry's hull, or something with at most eight corners that holds it."""
    hull = shapely.convex_hull(geometry)
    if shapely.get_num_coordinates(hull) <= 9:
        return hull
    turned = shapely.affinity.rotate(hull, 45.0, origin=(0.0, 0.0)).envelope
    return shapely.intersection(
        hull.envelope.buffer(1e-6, join_style="mitre"),
        shapely.affinity.rotate(turned, -45.0, origin=(0.0, 0.0)).buffer(1e-6, join_style="mitre"),
    )


def simplified(geometry: Geometry) -> Geometry:
    """The geometry, or something with fewer corners that holds it: the time of a proof goes by them."""
    if shapely.get_num_coordinates(geometry) <= MAX_COORDINATES:
        return geometry
    return shapely.buffer(shapely.simplify(geometry, SIMPLIFY_M), SIMPLIFY_M * 1.1, quad_segs=2)


def uniform_places(room: Geometry, count: int, rng: np.random.Generator) -> Floats:
    """(count, 2) places, uniform over a polygon or several."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(room))
    area = shapely.area(triangles)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    chosen = corners[rng.choice(len(area), size=count, p=area / area.sum())]
    one, other = np.sqrt(rng.uniform(size=(count, 1))), rng.uniform(size=(count, 1))
    places: Floats = (1 - one) * chosen[:, 0] + one * (1 - other) * chosen[:, 1] + one * other * chosen[:, 2]
    return places
