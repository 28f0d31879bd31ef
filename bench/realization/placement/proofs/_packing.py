"""Upper bounds on how many members fit on given ground."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, floor, inf, radians, sin, sqrt

import numpy as np
import shapely
import shapely.affinity

from .._geometry import Geometry

_TOLERANCE = 1e-6

# Of each kind of piece; chosen, not measured. And what linprog says of a program without a solution.
ALLOCATION_SLACK_M2, INFEASIBLE = 0.02, 2

# Shares of a footprint's length for the axis-parallel rectangle inside it; every one gives a valid bound.
_LENGTH_SHARES = (0.1, 0.25, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0)


def max_spaced_points(ground: Geometry, apart_m: float) -> float:
    """An upper bound on the number of points on the ground that are `apart_m` or more from each other.

    In a compact convex set of area A and perimeter P there are at most 2 A / (sqrt(3) d^2) + P / (2 d) + 1
    points of mutual distance d or more; here over the hull of the ground, and over the hulls of its parts.

    Source: Oler, N. (1961), "An inequality in the geometry of numbers", Acta Mathematica 105, 19-48.
    """
    if apart_m <= 0.0:
        return inf
    whole = _oler_bound(shapely.convex_hull(ground), apart_m)
    parts = [_oler_bound(shapely.convex_hull(part), apart_m) for part in shapely.get_parts(ground)]
    return min(whole, sum(parts))


def _oler_bound(hull: Geometry, apart_m: float) -> float:
    if hull.is_empty:
        return 0.0
    # There and back along what has no width.
    round_m = hull.length if hull.area > 0.0 else 2.0 * hull.length
    return oler_bound(hull.area, round_m, apart_m)


def oler_bound(area_m2: float, perimeter_m: float, apart_m: float) -> float:
    """Oler's bound on points of a mutual distance in a convex set of an area and a perimeter."""
    return float(
        floor(2.0 * area_m2 / (sqrt(3.0) * apart_m**2) + perimeter_m / (2.0 * apart_m) + 1.0 + _TOLERANCE)
    )


def max_aligned_rectangles(
    ground: Geometry, size_m: tuple[float, float], gap_m: float, course_deg: float, within_deg: float
) -> float:
    """An upper bound on rectangles of one size, a gap apart, with centres on the ground and lengths along one
    course, either way, within so many degrees (less than 45).

    Each holds a rectangle whose sides keep the course and the square to it. Those are a gap apart as well: by
    gap / sqrt(2) at least along or across the course, and by the whole gap along it where the ground is too
    narrow for two side by side. Rectangles of one size and direction that do not overlap hold different
    points of a lattice of their own sides.
    """
    # The course is north now.
    turned = shapely.affinity.rotate(shapely.convex_hull(ground), course_deg, origin=(0.0, 0.0))
    if turned.is_empty:
        return 0.0
    west, south, east, north = shapely.bounds(turned)
    most = inf
    for share in _LENGTH_SHARES:
        long_m, wide_m = _aligned_inner_rectangle(size_m, share, radians(within_deg))
        if wide_m <= 0.0:
            continue
        along = gap_m if east - west < wide_m - _TOLERANCE else gap_m / sqrt(2.0)
        across = gap_m if north - south < long_m - _TOLERANCE else gap_m / sqrt(2.0)
        most = min(
            most,
            _max_lattice_points(north - south, long_m + along)
            * _max_lattice_points(east - west, wide_m + across),
        )
    return most


def _aligned_inner_rectangle(
    size_m: tuple[float, float], share: float, turn_rad: float
) -> tuple[float, float]:
    """Length and width of a rectangle that lies inside one of `size_m` turned by up to `turn_rad`."""
    length_m, width_m = size_m
    long_m = share * length_m
    wide_m = (width_m - long_m * sin(turn_rad)) / cos(turn_rad)
    if wide_m <= 0.0:
        return long_m, wide_m
    turns = [turn for turn in (0.0, float(np.arctan2(wide_m, long_m)), turn_rad) if turn <= turn_rad]
    ahead = max(long_m * cos(turn) + wide_m * sin(turn) for turn in turns)
    turns = [turn for turn in (0.0, float(np.arctan2(long_m, wide_m)), turn_rad) if turn <= turn_rad]
    aside = max(long_m * sin(turn) + wide_m * cos(turn) for turn in turns)
    fit = min(1.0, length_m / ahead, width_m / aside)
    return fit * long_m, fit * wide_m


def _max_lattice_points(span_m: float, pitch_m: float) -> float:
    """Points of a lattice in a half-open span that is one pitch longer, put as few as may be."""
    return inf if pitch_m <= 0.0 else float(floor(span_m / pitch_m + _TOLERANCE) + 1)


def areas_can_be_allocated(zones: Mapping[str, Geometry], needs: Mapping[str, float]) -> bool:
    """Whether the pieces into which the zones cut each other can be shared out as the groups need: a linear program."""
    # Imported here: scipy.optimize takes a third of a second, and most scenes need no proof.
    from scipy.optimize import linprog

    outlines = shapely.union_all([shapely.boundary(zone) for zone in zones.values()])
    pieces = shapely.get_parts(shapely.polygonize(shapely.get_parts(outlines)))
    inside = np.array([shapely.contains(zone, shapely.point_on_surface(pieces)) for zone in zones.values()])
    kinds, kind = np.unique(inside, axis=1, return_inverse=True)
    # Slack for what the overlay rounds: it can only make a scene look easier, never infeasible.
    room_m2 = np.bincount(kind.ravel(), shapely.area(pieces)) + ALLOCATION_SLACK_M2
    need_m2 = np.array([needs[name] for name in zones])
    # A share of each kind of piece for each group: all of a kind are its room at most, all of a group its need at least.
    groups, number = kinds.shape
    of_kinds = np.tile(np.eye(number), groups)
    of_groups = np.repeat(np.eye(groups), number, axis=1)
    result = linprog(
        np.zeros(groups * number),
        A_ub=np.vstack([of_kinds, -of_groups]),
        b_ub=np.concatenate([room_m2, -need_m2]),
        bounds=[(0.0, None if is_inside else 0.0) for is_inside in kinds.ravel()],
    )
    return bool(result.status != INFEASIBLE)
