"""The ground as geometry: what lies within a distance of it, on a road, and places drawn from it."""

from __future__ import annotations

from itertools import pairwise
from math import cos, pi
from typing import Any

import numpy as np
import shapely
import shapely.affinity

from bench.simspec import Polygon, Road

from ._footprint import Array

Geometry = Any
"""A shapely geometry; shapely ships no types."""
ARC = 16
_OUTWARD = 1.0 / cos(pi / (4 * ARC))
"""By how much a polygon of `ARC` edges for a quarter must be wider than the circle that it is to hold."""
EVERYWHERE = shapely.box(-3e5, -3e5, 3e5, 3e5)
"""More ground than any document can name."""
FINE = 64
COARSE_M = 0.1


def ground(polygon: Polygon) -> Geometry:
    """The polygon as a shapely one."""
    return shapely.Polygon([(corner.east_m, corner.north_m) for corner in polygon.corners])


def wide(geometry: Geometry, distance_m: float) -> Geometry:
    """Everything within a distance, rather too much than too little."""
    return shapely.buffer(geometry, distance_m * _OUTWARD + 1e-6, quad_segs=ARC)


def strip(road: Road) -> Geometry:
    """The ground that a road covers."""
    line = shapely.LineString([(point.east_m, point.north_m) for point in road.points])
    return shapely.buffer(line, road.width_m / 2.0, cap_style="flat", join_style="mitre", mitre_limit=2.0)


def road_heading_deg(road: Road, places_m: Array) -> Array:
    """(n,) heading of the stretch of the road nearest to each of (n, 2) places."""
    points = np.array([(point.east_m, point.north_m) for point in road.points])
    lines = np.array([shapely.LineString(pair) for pair in pairwise(points)])
    step = np.diff(points, axis=0)
    heading: Array = np.degrees(np.arctan2(step[:, 0], step[:, 1]))
    nearest = shapely.distance(shapely.points(places_m)[:, None], lines[None, :]).argmin(axis=1)
    return np.asarray(heading[nearest], dtype=np.float64)


def octagon(geometry: Geometry) -> Geometry:
    """The geometry's hull, or something with at most eight corners that holds it."""
    hull = shapely.convex_hull(geometry)
    if shapely.get_num_coordinates(hull) <= 9:
        return hull
    turned = shapely.affinity.rotate(hull, 45.0, origin=(0.0, 0.0)).envelope
    return shapely.intersection(
        hull.envelope.buffer(1e-6, join_style="mitre"),
        shapely.affinity.rotate(turned, -45.0, origin=(0.0, 0.0)).buffer(1e-6, join_style="mitre"),
    )


def coarse(geometry: Geometry) -> Geometry:
    """The geometry, or something with fewer corners that holds it: the time of a proof goes by them."""
    if shapely.get_num_coordinates(geometry) <= FINE:
        return geometry
    return shapely.buffer(shapely.simplify(geometry, COARSE_M), COARSE_M * 1.1, quad_segs=2)


def drawn_from(room: Geometry, count: int, rng: np.random.Generator) -> Array:
    """(count, 2) places, uniform over a polygon or several."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(room))
    area = shapely.area(triangles)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    chosen = corners[rng.choice(len(area), size=count, p=area / area.sum())]
    one, other = np.sqrt(rng.uniform(size=(count, 1))), rng.uniform(size=(count, 1))
    places: Array = (1 - one) * chosen[:, 0] + one * (1 - other) * chosen[:, 1] + one * other * chosen[:, 2]
    return places
