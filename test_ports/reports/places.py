"""Look-ups of reported places, whose cost does not grow with the number of reports made before."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np

from bench.arrays import Floats


class Place(Protocol):
    """A class at a place on the ground: a report, a request for consent, or a track of the agent."""

    @property
    def class_label(self) -> str: ...
    @property
    def east_m(self) -> float: ...
    @property
    def north_m(self) -> float: ...


def same_place(place: Place, other: Place, within_m: float) -> bool:
    """Whether two messages name one class at places at most `within_m` apart."""
    distance_m = math.hypot(place.east_m - other.east_m, place.north_m - other.north_m)
    return place.class_label == other.class_label and distance_m <= within_m


class PlaceGrid:
    """Places that are told apart by `within_m`, in cells of about that size: a look-up reads nine cells.

    A cell holds few places as long as those that have a match are not added.
    """

    def __init__(self, within_m: float) -> None:
        self._within_m = within_m
        # Somewhat larger than the distance: rounding in the division must not put a match two cells away.
        self._cell_m = 1.001 * max(within_m, 0.001)
        self._cells: dict[tuple[str, int, int], list[tuple[int, Place]]] = {}
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def first_match(self, place: Place) -> int | None:
        """How many places were added before the first one that is the same as `place`; None without such a place."""
        east, north = self._cell(place)
        matches = [
            number
            for near_east in (east - 1, east, east + 1)
            for near_north in (north - 1, north, north + 1)
            for number, other in self._cells.get((place.class_label, near_east, near_north), ())
            if same_place(place, other, self._within_m)
        ]
        return min(matches, default=None)

    def add(self, place: Place) -> None:
        self._cells.setdefault((place.class_label, *self._cell(place)), []).append((self._count, place))
        self._count += 1

    def _cell(self, place: Place) -> tuple[int, int]:
        return math.floor(place.east_m / self._cell_m), math.floor(place.north_m / self._cell_m)


def has_same_place(places: Sequence[Place], candidates: Iterable[Place], within_m: float) -> list[bool]:
    """For each of the places whether any of the others is the same one.

    The cost is n log n: an agent may report a hundred thousand times, all at one place or all over the area.
    """
    points: dict[str, set[tuple[float, float]]] = {}
    for other in candidates:
        points.setdefault(other.class_label, set()).add((other.east_m, other.north_m))
    rows: dict[str, list[int]] = {}
    for row, place in enumerate(places):
        rows.setdefault(place.class_label, []).append(row)
    answers = [False] * len(places)
    for label in rows.keys() & points.keys():
        wanted = np.array([(places[row].east_m, places[row].north_m) for row in rows[label]])
        for row, distance_m in zip(rows[label], _nearest_m(wanted, points[label]), strict=True):
            answers[row] = distance_m <= within_m
    return answers


def _nearest_m(wanted: Floats, points: set[tuple[float, float]]) -> list[float]:
    """Metres from each place (n, 2) to the nearest of the points."""
    # Imported here: it takes a tenth of a second, and few runs have an outage that asks for it.
    from scipy.spatial import KDTree

    # Distinct points, because a tree cannot divide equal ones; sorted, because a set has no order of its own.
    table = np.array(sorted(points))
    _, nearest = KDTree(table).query(wanted)
    offsets = wanted - table[nearest]
    # By the same function as `same_place`, so that both agree on the last digit.
    return [math.hypot(east_m, north_m) for east_m, north_m in offsets]
