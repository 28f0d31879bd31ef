"""Terrain as an autopilot without a map sees it: it requests the grid below it again and again, and has no
data.

TERRAIN_DATA is ignored; the ground of the bench is flat.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..state._service import Stream, Values
from ..state._service_context import ServiceContext

# Metres of 1e-7 degree, as ArduPilot has them.
_METRES_PER_E7 = 0.011131884502145034
# Spacings between the corners of neighbouring grids.
_BLOCK_NORTH, _BLOCK_EAST = 24, 28
# 4 by 4 points each, in a grid.
_PARTS = 56


class Terrain:
    """TERRAIN_REQUEST and TERRAIN_REPORT, in wire order; None until home is known."""

    def __init__(self, context: ServiceContext) -> None:
        self._flight = context.flight
        self._parameters = context.parameters

    def streams(self) -> Mapping[str, Stream]:
        return {"TERRAIN_REQUEST": self._request, "TERRAIN_REPORT": self._report}

    def _request(self) -> Values | None:
        """A request of all parts of the grid below the vehicle."""
        spacing = self._spacing_m()
        if self._flight.home is None or not spacing:
            return None
        return (2**_PARTS - 1, *self._corner_e7(spacing), spacing)

    def _report(self) -> Values | None:
        """A report of parts that are pending, and none that is loaded."""
        f = self._flight
        if f.home is None or not self._spacing_m():
            return None
        return (f.latitude_e7, f.longitude_e7, 0.0, 0.0, 0, _PARTS, 0)

    def _spacing_m(self) -> int:
        return max(int(self._parameters["TERRAIN_SPACING"]), 1) if self._parameters["TERRAIN_ENABLE"] else 0

    def _corner_e7(self, spacing_m: int) -> tuple[int, int]:
        """South-west corner of the grid: grids are counted from whole degrees."""
        f = self._flight
        latitude, longitude = (angle // 10_000_000 * 10_000_000 for angle in (f.latitude_e7, f.longitude_e7))
        # ArduPilot takes the mean latitude between the point and the corner of its degree.
        narrowing = math.cos(math.radians((latitude + f.latitude_e7) / 2e7))
        north_m = (f.latitude_e7 - latitude) * _METRES_PER_E7
        east_m = (f.longitude_e7 - longitude) * _METRES_PER_E7 * narrowing
        north = int(north_m / spacing_m) // _BLOCK_NORTH * _BLOCK_NORTH * spacing_m / _METRES_PER_E7
        east = int(east_m / spacing_m) // _BLOCK_EAST * _BLOCK_EAST * spacing_m / _METRES_PER_E7
        east /= math.cos(math.radians((latitude + north / 2.0) / 1e7))
        return latitude + int(north), longitude + int(east)
