"""Every moment in the air of a flown batch: the whole flight, takeoff and landing with it, each with its span.

Standing still counts for nothing here: what a mission waits has no span.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import zip_longest

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.polygons import distance_beyond
from bench.simspec import Point

from ..batch._batch import standing_span_of
from ..flight._mission import FlownMissions
from ..flight._views import Stretch

# Straight up and down over one place, which no stretch of the flight holds. Chosen, not measured.
TAKEOFF_S, LANDING_COLUMN_S, LANDING_COLUMN_M = 4.0, 13.0, 15.0
_MOMENTS = 6


class FlownCourse:
    """Every moment in the air of every mission, flat."""

    def __init__(self, flown: FlownMissions) -> None:
        self.batch = batch = flown.batch
        parts = [_flat(part) for part in flown.course]
        parts += [
            _column(flown.took_off_s, batch.home_m, 6.0, TAKEOFF_S),
            _column(flown.end_s - 3.0, flown.place_m, LANDING_COLUMN_M, -LANDING_COLUMN_S),
        ]
        joined = [np.concatenate(part) for part in zip(*parts, strict=True)]
        # What it flies after an order to land where it is, it has not chosen (FlownTrack.free).
        moves = (joined[3] > 0.0) & (joined[1] < batch.ordered_down_s[joined[0].astype(np.int64)])
        self.row: Counts = joined[0][moves].astype(np.int64)
        self.time_s, self.place_m, self.span_s, self.up_m, self.speed_mps = (
            part[moves] for part in joined[1:]
        )
        self._everybody_m = flown.everybody_m

    def share(self, right: Bools, among: Bools | None = None) -> Floats:
        """(n,) of the time, or of that among some moments, the share that is good; 0 where there is none."""
        whole_s = self.seconds(np.ones(len(self.row), dtype=np.bool_) if among is None else among)
        return self.seconds(right if among is None else among & right) / np.maximum(whole_s, 1e-9)

    def seconds(self, moments: Bools) -> Floats:
        """(n,) how long these moments last."""
        span_s = np.where(moments, self.span_s, 0.0)
        return np.bincount(self.row, span_s, len(self.batch)).astype(np.float64)

    @cached_property
    def nearest_m(self) -> Floats:
        """How far away the nearest bystander is, on the ground."""
        nearest_m = np.full(len(self.row), np.inf)
        epochs = standing_span_of(self.time_s)
        for epoch, everybody_m in enumerate(self._everybody_m):
            people_m = np.where((self.batch.role == 0)[..., None], everybody_m, 1e9).astype(np.float32)
            for begin in range(0, len(self.row), 4096):
                at = begin + np.flatnonzero(epochs[begin : begin + 4096] == epoch)
                away_m = people_m[self.row[at]] - self.place_m[at, None].astype(np.float32)
                apart_m2 = away_m[..., 0] ** 2 + away_m[..., 1] ** 2
                nearest_m[at] = np.sqrt(apart_m2.min(axis=1, initial=np.inf))
        return nearest_m

    @cached_property
    def from_home_m(self) -> Floats:
        """How far from home it is, on the ground."""
        away_m = self.place_m - self.batch.home_m[self.row]
        return np.asarray(np.hypot(away_m[:, 0], away_m[:, 1]))

    def beyond_m(self, polygons: Sequence[Sequence[Point]]) -> Floats:
        """How far outside the polygon of its scene (n of them), negative inside; inf where a scene has no corner."""
        distance_m = np.full(len(self.row), np.inf)
        rows_of: dict[tuple[tuple[float, float], ...], list[int]] = {}
        for row, polygon in enumerate(polygons):
            corners = tuple((corner.east_m, corner.north_m) for corner in polygon)
            rows_of.setdefault(corners, []).append(row)
        for corners, rows in rows_of.items():
            if corners:
                at = np.flatnonzero(np.isin(self.row, rows))
                distance_m[at] = distance_beyond(self.place_m[at], np.array(corners))
        return distance_m

    @cached_property
    def closed_m(self) -> Floats:
        """How far from the nearest area that is closed at the moment, negative inside; inf while none is."""
        closed_m = np.full(len(self.row), np.inf)
        for areas in zip_longest(*(scene.rules.no_fly for scene in self.batch.scenes)):
            spans_s = [
                (np.inf, np.inf) if area is None else (area.from_s, area.until_s or np.inf) for area in areas
            ]
            since_s, until_s = np.array(spans_s)[self.row].T
            apart_m = self.beyond_m([() if area is None else area.area.corners for area in areas])
            in_force = (self.time_s >= since_s) & (self.time_s < until_s)
            closed_m = np.where(in_force, np.minimum(closed_m, apart_m), closed_m)
        return closed_m

    def reached_s(self, since_s: Floats | float) -> Floats:
        """(n, k) when it was first over each sub-area, from a moment (n, k) on; inf for never."""
        batch = self.batch
        first_s: Floats = np.full(batch.task_radius_m.shape, np.inf)
        since_s = np.broadcast_to(since_s, first_s.shape)
        for task in range(first_s.shape[1]):
            away_m = self.place_m - batch.task_m[:, task][self.row]
            over = np.hypot(away_m[:, 0], away_m[:, 1]) <= batch.task_radius_m[:, task][self.row]
            over &= self.time_s >= since_s[:, task][self.row]
            np.minimum.at(first_s[:, task], self.row[over], self.time_s[over])
        return first_s


def _flat(stretch: Stretch) -> tuple[np.ndarray, ...]:
    moments = stretch.time_s.shape[1]
    return (
        stretch.rows.repeat(moments),
        stretch.time_s.ravel(),
        stretch.place_m.reshape(-1, 2),
        stretch.span_s.ravel(),
        stretch.height_m.ravel(),
        (stretch.flown_m() / np.maximum(stretch.span_s, 1e-9)).ravel(),
    )


def _column(begin_s: Floats, place_m: Floats, high_m: float, span_s: float) -> tuple[np.ndarray, ...]:
    """Straight up from a moment on, or, with a negative span, down up to it."""
    since, count = (np.arange(_MOMENTS) + 0.5) / _MOMENTS, len(begin_s)
    return (
        np.arange(count).repeat(_MOMENTS),
        (begin_s[:, None] + (since * span_s)[None, :]).ravel(),
        place_m.repeat(_MOMENTS, axis=0),
        np.full(count * _MOMENTS, abs(span_s) / _MOMENTS),
        np.tile(since * high_m, count),
        np.zeros(count * _MOMENTS),
    )
