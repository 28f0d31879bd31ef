"""Whether places lie in simple polygons on flat ground, without the start of a geometry library: agents import it.

A ray along the first axis crosses the outline an odd number of times from inside (even-odd rule). A place on the edge
may count either way.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Bools = NDArray[np.bool_]


def is_inside(place: tuple[float, float], corners: Sequence[tuple[float, float]]) -> bool:
    """Whether a place lies inside the polygon with these corners; both in metres of the same two axes."""
    along, across = place
    inside = False
    before = corners[-1]
    for corner in corners:
        # The two differ across the ray here, so the division is safe.
        if (before[1] > across) != (corner[1] > across):
            share = (across - before[1]) / (corner[1] - before[1])
            inside ^= along < before[0] + share * (corner[0] - before[0])
        before = corner
    return inside


def are_inside(places_m: Floats, corners_m: Floats) -> Bools:
    """(n,) whether each of the places (n, 2) lies inside the polygon with the corners (m, 2)."""
    # Imported here because agents that ask for single places start without it.
    import numpy as np

    following = np.roll(corners_m, -1, axis=0)
    across = places_m[:, None, 1]
    crosses = (corners_m[None, :, 1] > across) != (following[None, :, 1] > across)
    # An edge along the ray never crosses it, so its divisor may be anything but 0.
    rise = np.where(following[:, 1] == corners_m[:, 1], 1.0, following[:, 1] - corners_m[:, 1])
    at = corners_m[:, 0] + (across - corners_m[None, :, 1]) / rise * (following[:, 0] - corners_m[:, 0])
    inside: Bools = (crosses & (places_m[:, None, 0] < at)).sum(axis=1) % 2 == 1
    return inside


def distance_beyond(places_m: Floats, corners_m: Floats) -> Floats:
    """(n,) distances of places (n, 2) from the edge of a polygon with the corners (m, 2), positive outside."""
    import numpy as np

    along = np.roll(corners_m, -1, axis=0) - corners_m
    # Two corners at one place make an edge without length; the floor keeps its division defined.
    squared_length = np.maximum((along**2).sum(axis=1), 1e-12)
    offset = places_m[:, None] - corners_m[None]
    share = np.clip((offset * along).sum(axis=2) / squared_length, 0.0, 1.0)
    distance: Floats = np.linalg.norm(offset - share[..., None] * along, axis=2).min(axis=1)
    return np.where(are_inside(places_m, corners_m), -distance, distance)
