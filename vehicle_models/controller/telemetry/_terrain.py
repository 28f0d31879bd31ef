"""Terrain as an autopilot without a map of it sees it: it asks for the grid under it, again and again, and knows nothing.

TERRAIN_DATA is not taken; the ground of the bench is flat.
"""

from __future__ import annotations

import math

from .._service_context import ServiceContext

_E7_M = 0.011131884502145034  # metres of 1e-7 degree, as ArduPilot reckons
_BLOCK_NORTH, _BLOCK_EAST = 24, 28  # spacings between the corners of neighbouring grids
_PARTS = 56  # 4 by 4 points each, in a grid


class Terrain:
    """TERRAIN_REQUEST and TERRAIN_REPORT, in the order of the wire; None while no place is known."""

    def __init__(self, board: ServiceContext) -> None:
        self._flight = board.flight
        self._parameters = board.parameters

    def request(self) -> tuple[int, ...] | None:
        """All 56 parts of the grid under the vehicle."""
        spacing = self._spacing_m()
        if self._flight.home is None or not spacing:
            return None
        return (2**_PARTS - 1, *self._corner_e7(spacing), spacing)

    def report(self) -> tuple[float, ...] | None:
        """Nothing but what is waited for."""
        f = self._flight
        if f.home is None or not self._spacing_m():
            return None
        return (f.latitude_e7, f.longitude_e7, 0.0, 0.0, 0, _PARTS, 0)

    def _spacing_m(self) -> int:
        return max(int(self._parameters["TERRAIN_SPACING"]), 1) if self._parameters["TERRAIN_ENABLE"] else 0

    def _corner_e7(self, spacing_m: int) -> tuple[int, int]:
        """South-west corner of the grid: grids are counted from whole degrees."""
        f = self._flight
        latitude, longitude = f.latitude_e7 // 10_000_000 * 10_000_000, f.longitude_e7 // 10_000_000 * 10_000_000
        shrinks = math.cos(math.radians((latitude + f.latitude_e7) / 2e7))
        north = int((f.latitude_e7 - latitude) * _E7_M / spacing_m) // _BLOCK_NORTH * _BLOCK_NORTH * spacing_m / _E7_M
        east = int((f.longitude_e7 - longitude) * _E7_M * shrinks / spacing_m) // _BLOCK_EAST * _BLOCK_EAST * spacing_m / _E7_M
        return latitude + int(north), longitude + int(east / math.cos(math.radians((latitude + north / 2.0) / 1e7)))
