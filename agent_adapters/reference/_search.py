"""Paths: the lawnmower over a circle, the ring round a place, and walking along either."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

Place = tuple[float, float]  # east, north in metres


def lawnmower(
    center: Place, radius_m: float, spacing_m: float, heading_rad: float, near_m: float, middle_m: float
) -> list[Place]:
    """Waypoints of parallel legs over a circle, the first along `heading_rad` (clockwise from north).

    `spacing_m` is the widest allowed distance between legs. The camera sees from `near_m` to beyond `middle_m` ahead, so a
    leg begins `near_m` before the circle and ends when the middle of the image has reached the circle's far edge.
    """
    count = max(1, math.ceil(2.0 * radius_m / spacing_m))
    between_m = 2.0 * radius_m / count
    waypoints: list[Place] = []
    for leg in range(count):
        across_m = -radius_m + (leg + 0.5) * between_m
        half_m = math.sqrt(max(radius_m**2 - max(abs(across_m) - between_m / 2.0, 0.0) ** 2, 0.0))
        begin_m = -half_m - near_m
        end_m = max(half_m - middle_m, begin_m + 10.0)
        along = (begin_m, end_m) if leg % 2 == 0 else (-begin_m, -end_m)
        waypoints += [_placed(center, heading_rad, one, across_m) for one in along]
    return waypoints


def ring(center: Place, radius_m: float, begin_rad: float, corners: int = 24) -> list[Place]:
    """Once round a place, clockwise, from the direction `begin_rad` (clockwise from north) back to it."""
    angles = (begin_rad + 2.0 * math.pi * k / corners for k in range(corners + 1))
    return [(center[0] + radius_m * math.sin(a), center[1] + radius_m * math.cos(a)) for a in angles]


def bearing_rad(origin: Place, to: Place) -> float:
    """Direction clockwise from north."""
    return math.atan2(to[0] - origin[0], to[1] - origin[1])


def length_m(path: Sequence[Place]) -> float:
    """Length of a polyline."""
    return sum(math.dist(a, b) for a, b in pairwise(path))


class Walk:
    """Progress along a polyline, and the point to aim at some way ahead of it."""

    def __init__(self, path: Sequence[Place]) -> None:
        self._path = list(path)
        self._lengths = [math.dist(a, b) for a, b in pairwise(path)]
        self.left_m = sum(self._lengths)
        self._segment = 0
        self._along_m = 0.0

    def go(self, position: Place) -> None:
        """Move on to the point of the present segment (or the next ones) that lies nearest; never back."""
        while self._segment < len(self._lengths):
            length = self._lengths[self._segment]
            self._along_m = max(self._along_m, self._projection_m(position))
            if self._along_m < length - 1e-9 and math.dist(position, self._path[self._segment + 1]) > 2.0:
                break
            if self._segment + 1 == len(self._lengths):
                self._along_m = min(self._along_m, length)
                break
            self._segment += 1
            self._along_m = 0.0
        self.left_m = sum(self._lengths[self._segment :]) - self._along_m if self._lengths else 0.0

    def aim(self, ahead_m: float) -> Place:
        """The point of the path `ahead_m` beyond the progress; its end when it is nearer."""
        if not self._lengths:
            return self._path[-1]
        wanted_m = self._along_m + ahead_m
        for index in range(self._segment, len(self._lengths)):
            length = self._lengths[index]
            if wanted_m <= length and length > 0.0:
                return _between(self._path[index], self._path[index + 1], wanted_m / length)
            wanted_m -= length
        return self._path[-1]

    def _projection_m(self, position: Place) -> float:
        a, b = self._path[self._segment], self._path[self._segment + 1]
        length = self._lengths[self._segment]
        if length <= 0.0:
            return 0.0
        return ((position[0] - a[0]) * (b[0] - a[0]) + (position[1] - a[1]) * (b[1] - a[1])) / length


def _between(a: Place, b: Place, share: float) -> Place:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def _placed(center: Place, heading_rad: float, along_m: float, across_m: float) -> Place:
    """A point given along and to the right of a heading."""
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    return center[0] + along_m * sine + across_m * cosine, center[1] + along_m * cosine - across_m * sine
