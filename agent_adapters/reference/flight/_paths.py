"""Paths: the lawnmower over a circle, the ring round a place, and walking along either."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

# Speed at which sharp corners are taken. Chosen, not measured.
CORNER_MPS = 4.0
# Chosen, not measured.
BRAKING_MPS2 = 2.5
# Turns below this are flown without braking. Chosen, not measured.
SHARP_RAD = math.radians(30.0)

Place = tuple[float, float]  # east, north in metres


def lawnmower(
    center: Place, radius_m: float, spacing_m: float, heading_rad: float, near_m: float, middle_m: float
) -> list[Place]:
    """Waypoints of parallel legs over a circle, the first along `heading_rad` (clockwise from north).

    `spacing_m` is the widest allowed distance between legs. The camera sees from `near_m` to beyond
    `middle_m` ahead, so a leg begins `near_m` before the circle and ends when the middle of the image has
    reached the circle's far edge.
    """
    count = max(1, math.ceil(2.0 * radius_m / spacing_m))
    between_m = 2.0 * radius_m / count
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    waypoints: list[Place] = []
    for leg in range(count):
        across_m = -radius_m + (leg + 0.5) * between_m
        half_m = math.sqrt(max(radius_m**2 - max(abs(across_m) - between_m / 2.0, 0.0) ** 2, 0.0))
        begin_m = -half_m - near_m
        end_m = max(half_m - middle_m, begin_m + 10.0)
        along = (begin_m, end_m) if leg % 2 == 0 else (-begin_m, -end_m)
        waypoints += [
            (
                center[0] + leg_m * sine + across_m * cosine,
                center[1] + leg_m * cosine - across_m * sine,
            )
            for leg_m in along
        ]
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
    """Progress along a polyline: where on it the vehicle is, where to aim, and how fast it may be there."""

    def __init__(self, path: Sequence[Place]) -> None:
        self._path = [path[0], *(b for a, b in pairwise(path) if math.dist(a, b) > 1e-6)]
        self._starts_m = list(accumulate((math.dist(a, b) for a, b in pairwise(self._path)), initial=0.0))
        bearings_rad = [bearing_rad(a, b) for a, b in pairwise(self._path)]
        turns_rad = [
            math.remainder(after - before, 2.0 * math.pi) for before, after in pairwise(bearings_rad)
        ]
        self._corners = list(zip(self._starts_m[1:], turns_rad, strict=False))
        self.done_m = 0.0

    @property
    def left_m(self) -> float:
        """Length of path still ahead."""
        return self._starts_m[-1] - self.done_m

    def rest(self) -> list[Place]:
        """The waypoints still ahead."""
        return [
            place for place, at_m in zip(self._path, self._starts_m, strict=True) if at_m > self.done_m
        ] or [self._path[-1]]

    def go(self, position: Place, window_m: float) -> None:
        """Move on to the nearest point within a window ahead; never back, nor past what was not aimed at."""
        best = (math.dist(position, self.at(self.done_m)), self.done_m)
        for index, (a, b) in enumerate(pairwise(self._path)):
            begin_m, end_m = self._starts_m[index], self._starts_m[index + 1]
            if end_m < self.done_m or begin_m > self.done_m + window_m:
                continue
            along_m = begin_m + _projection_m(position, a, b)
            along_m = min(max(along_m, begin_m, self.done_m), end_m, self.done_m + window_m)
            best = min(best, (math.dist(position, self.at(along_m)), along_m))
        self.done_m = best[1]

    def at(self, along_m: float) -> Place:
        """The point of the path at a length; its end beyond that."""
        for index, (a, b) in enumerate(pairwise(self._path)):
            if along_m <= self._starts_m[index + 1]:
                length_m = self._starts_m[index + 1] - self._starts_m[index]
                share = max(along_m - self._starts_m[index], 0.0) / length_m
                return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
        return self._path[-1]

    def direction(self, along_m: float) -> Place:
        """Unit vector of the path at a length; zero for a path that is only a point."""
        for index, (a, b) in enumerate(pairwise(self._path)):
            if along_m < self._starts_m[index + 1] or index + 2 == len(self._path):
                length_m = self._starts_m[index + 1] - self._starts_m[index]
                return (b[0] - a[0]) / length_m, (b[1] - a[1]) / length_m
        return 0.0, 0.0

    def speed_mps(self, limit_mps: float) -> float:
        """How fast to be here, so that the next sharp corner and the end are reached at `CORNER_MPS`."""
        slow_m = [
            corner_m
            for corner_m, turn_rad in self._corners
            if corner_m > self.done_m and abs(turn_rad) > SHARP_RAD
        ]
        ahead_m = min([*slow_m, self._starts_m[-1]]) - self.done_m
        return min(limit_mps, math.sqrt(CORNER_MPS**2 + 2.0 * BRAKING_MPS2 * max(ahead_m, 0.0)))


def _projection_m(position: Place, a: Place, b: Place) -> float:
    """How far along the line from a to b the position lies."""
    return ((position[0] - a[0]) * (b[0] - a[0]) + (position[1] - a[1]) * (b[1] - a[1])) / math.dist(a, b)
