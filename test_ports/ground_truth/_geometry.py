"""Distances on flat ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.arrays import Floats
from bench.polygons import are_inside
from bench.simspec import Point


def distance_beyond(places_m: Floats, corners: Sequence[Point]) -> Floats:
    """(n,) distances of places (n, 2) from the edge of a simple polygon, positive outside."""
    starts = np.array([(corner.east_m, corner.north_m) for corner in corners])
    ends = np.roll(starts, -1, axis=0)
    along = ends - starts
    # Two corners at one place make an edge without length; the floor keeps its division defined.
    squared_length = np.maximum((along**2).sum(axis=1), 1e-12)
    offset = places_m[:, None] - starts[None]
    share = np.clip((offset * along).sum(axis=2) / squared_length, 0.0, 1.0)
    distance: Floats = np.linalg.norm(offset - share[..., None] * along, axis=2).min(axis=1)
    return np.where(are_inside(places_m, starts), -distance, distance)
