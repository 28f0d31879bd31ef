"""Lattices: places in rows and columns that pack without spare gaps."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.arrays import Floats
from bench.simspec import ActorGroup

from .._footprint import Footprints, footprints
from .._geometry import Geometry

# Extra gap between lattice neighbours, because places are rounded to the millimetre.
ROUNDING_GAP_M = 0.002


def lattices(group: ActorGroup, region: Geometry) -> list[Footprints]:
    """Rows and columns along the region's longest side, from each corner, either way; the largest first."""
    asset, gap_m = group.definition, group.placement.separation_m
    frame = _BoundingFrame.of(region)
    distinct: dict[bytes, Footprints] = {}
    for quarter, corner in product((0, 1), product((0, 1), repeat=2)):
        size = np.array([asset.length_m, asset.width_m] if quarter == 0 else [asset.width_m, asset.length_m])
        pitch = np.maximum(size + gap_m, group.placement.spread_m or 0.0) + ROUNDING_GAP_M
        places = frame.rows(size, pitch, np.array(corner))
        heading = np.full(len(places), _turned_deg(group, frame.heading_deg + 90.0 * quarter))
        distinct.setdefault(places.tobytes(), footprints(asset, places, heading, gap_m))
        # A square footprint turned by a quarter gives the same lattice again.
        if asset.length_m == asset.width_m and quarter:
            break
    return sorted(distinct.values(), key=len, reverse=True)


def _turned_deg(group: ActorGroup, heading_deg: float) -> float:
    """The heading, or its opposite where that is nearer to the one that the group is to have."""
    facing = group.placement.facing
    if facing is None or facing.heading_deg is None:
        return heading_deg % 360.0
    off_deg = abs((heading_deg - facing.heading_deg + 180.0) % 360.0 - 180.0)
    return (heading_deg + (180.0 if off_deg > 90.0 else 0.0)) % 360.0


@dataclass(frozen=True, slots=True)
class _BoundingFrame:
    """The smallest rectangle round a region: corner, unit vectors (2, 2) along its sides, and lengths."""

    corner_m: Floats
    axes: Floats
    size_m: Floats

    @classmethod
    def of(cls, region: Geometry) -> _BoundingFrame:
        corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(region))[:4]
        sides = np.array([corners[1] - corners[0], corners[3] - corners[0]])
        size = np.hypot(sides[:, 0], sides[:, 1])
        return cls(corners[0], sides / size[:, None], size)

    @property
    def heading_deg(self) -> float:
        """Of the first side, to a microdegree as documents keep it."""
        return round(float(np.degrees(np.arctan2(self.axes[0, 0], self.axes[0, 1]))) % 360.0, 6) % 360.0

    def rows(self, member_m: Floats, pitch_m: Floats, corner: NDArray[np.int_]) -> Floats:
        """(n, 2) centres of as many rectangles as fit in rows and columns, pushed into one of the corners."""
        times = np.maximum(
            np.floor((self.size_m - member_m - 2 * ROUNDING_GAP_M) / pitch_m).astype(int) + 1, 0
        )
        ticks = [
            ROUNDING_GAP_M + member_m[side] / 2.0 + pitch_m[side] * np.arange(times[side]) for side in (0, 1)
        ]
        ticks = [self.size_m[side] - tick if corner[side] else tick for side, tick in enumerate(ticks)]
        grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)
        return np.asarray(np.round(self.corner_m + grid @ self.axes, 3))
