"""Lines of sight and walking legs against boxes: the slab test, for any number of dimensions at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Far below any length that a scene has, and far above the smallest float, so that the division stays finite.
_PARALLEL = 1e-12


def crosses_box(
    start: NDArray[np.float64], end: NDArray[np.float64], half: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether the segment from `start` to `end` (..., axes) touches the box from `-half` to `half`.

    Source: Kay, T. L. and Kajiya, J. T. (1986), "Ray tracing complex scenes", SIGGRAPH '86, 269-278.
    """
    along = end - start
    # A segment parallel to a slab becomes a steep one, whose crossings lie far outside [0, 1].
    along = np.where(np.abs(along) < _PARALLEL, _PARALLEL, along)
    first = (-half - start) / along
    last = (half - start) / along
    entry = np.minimum(first, last).max(axis=-1)
    leave = np.maximum(first, last).min(axis=-1)
    hit: NDArray[np.bool_] = (entry <= leave) & (leave >= 0.0) & (entry <= 1.0)
    return hit


def crosses_rectangle(
    start: tuple[float, float], end: tuple[float, float], half: tuple[float, float]
) -> bool:
    """`crosses_box` for one segment in two dimensions, in plain numbers: arrays so small cost many times as much.

    East and north, or along and across, in metres.
    """
    entry, leave = -math.inf, math.inf
    for begin, finish, extent in zip(start, end, half, strict=True):
        along = finish - begin
        if abs(along) < _PARALLEL:
            along = _PARALLEL
        first, last = (-extent - begin) / along, (extent - begin) / along
        entry, leave = max(entry, min(first, last)), min(leave, max(first, last))
    return entry <= leave and leave >= 0.0 and entry <= 1.0
