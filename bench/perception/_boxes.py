"""Boxes in the picture: left, top, right, bottom in pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class PictureSize:
    """Width and height of the picture, in pixels."""

    width_px: float
    height_px: float

    def displaced(self, box: Box, by_px: Sequence[float]) -> Box:
        """The box with each edge displaced, kept inside the picture and at least one pixel wide."""
        left, top, right, bottom = by_px
        return self.fitted(box[0] + left, box[1] + top, box[2] + right, box[3] + bottom)

    def fitted(self, x_min: float, y_min: float, x_max: float, y_max: float) -> Box:
        """The box of these edges, in whatever order, kept inside the picture and at least one pixel wide."""
        left, right = _ordered(x_min, x_max, self.width_px)
        top, bottom = _ordered(y_min, y_max, self.height_px)
        return left, top, right, bottom


def _ordered(first: float, second: float, limit: float) -> tuple[float, float]:
    """Two edges of a box inside [0, limit], at least one pixel apart."""
    low, high = max(0.0, min(first, second)), min(limit, max(first, second))
    # Jitter may swap the edges or push both over the border; docs/detection.md promises one pixel.
    if high - low < 1.0:
        low = min(max(0.0, (low + high) / 2.0 - 0.5), limit - 1.0)
        high = low + 1.0
    return low, high
