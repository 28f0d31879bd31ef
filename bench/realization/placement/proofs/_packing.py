"""Upper bounds on how many members fit on given ground."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, cos, floor, inf, radians, sin, sqrt

import numpy as np
import shapely
import shapely.affinity

from .._geometry import Geometry, areal_parts

_TOLERANCE = 1e-6

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


MAX_PIECES = 200


def areas_can_be_allocated(zones: dict[str, Geometry], needs: dict[str, float]) -> bool:
    """Whether the pieces into which the zones cut each other can be shared out as the groups need.

    In square decimetres, needs rounded down and pieces up; True when undecided.
    """
    pieces = _overlay_pieces(list(zones.values()))
    if pieces is None:
        return True
    # Imported here: ortools takes half a second.
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    names = list(zones)
    taken: dict[str, list[cp_model.IntVar]] = {name: [] for name in names}
    for piece, owners in pieces:
        # CP-SAT takes whole numbers; this rounding can only make a scene look easier, never infeasible.
        room = ceil(100.0 * piece.area) + 1
        shares = [model.new_int_var(0, room, "") for _ in owners]
        model.add(sum(shares) <= room)
        for owner, share in zip(owners, shares, strict=True):
            taken[names[owner]].append(share)
    for name in names:
        model.add(sum(taken[name]) >= floor(100.0 * needs[name]))
    solver = cp_model.CpSolver()
    # One worker and a deterministic limit: the same scene is refused on every run.
    solver.parameters.num_workers = 1
    solver.parameters.max_deterministic_time = 0.5
    return bool(solver.solve(model) != cp_model.INFEASIBLE)


def _overlay_pieces(zones: Sequence[Geometry]) -> list[tuple[Geometry, tuple[int, ...]]] | None:
    """The ground cut along the zones' edges, with the zones of each piece; None for too many pieces."""
    pieces: list[tuple[Geometry, tuple[int, ...]]] = []
    for index, zone in enumerate(zones):
        rest, cut = zone, []
        for piece, owners in pieces:
            both = areal_parts(shapely.intersection(piece, zone))
            if both.area > 0.0:
                cut.append((both, (*owners, index)))
                rest = areal_parts(rest.difference(both))
                piece = areal_parts(piece.difference(both))
            if piece.area > 0.0:
                cut.append((piece, owners))
        pieces = [*cut, (rest, (index,))] if rest.area > 0.0 else cut
        if len(pieces) > MAX_PIECES:
            return None
    return pieces
