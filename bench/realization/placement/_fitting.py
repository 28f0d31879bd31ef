"""Whether a footprint fits into ground at any heading."""

from __future__ import annotations

from functools import lru_cache
from math import cos, pi, sin, sqrt

import numpy as np
import shapely
import shapely.affinity

from bench.simspec import Asset

from ._geometry import Geometry, shrunk_at_most

# Headings that are told apart: narrower spans that may fit count as fitting. Chosen, not measured.
NARROWEST_SPAN_RAD = pi / 1440.0

# Answers that are kept: the groups of a campaign's scenes ask the same ones again and again. Chosen, not measured.
REMEMBERED_ANSWERS = 1024


@lru_cache(REMEMBERED_ANSWERS)
def may_fit(ground: Geometry, asset: Asset) -> bool:
    """Whether the asset's footprint may lie wholly in the ground at some heading; False is a proof that it cannot.

    Wherever a rectangle lies in the ground, its corners do. So the ground, shifted by each corner's offset from the
    centre, has a common point. That is tried for spans of headings with a rectangle that lies inside the footprint at
    every heading of the span; what may fit is halved.
    """
    half_m = (asset.length_m / 2.0, asset.width_m / 2.0)
    # In most ground the circle round the footprint has room.
    if not shrunk_at_most(ground, float(np.hypot(*half_m))).is_empty:
        return True
    spans = [(0.0, pi / 2.0), (pi / 2.0, pi)]
    while spans:
        low_rad, high_rad = spans.pop()
        middle_rad, off_rad = (low_rad + high_rad) / 2.0, (high_rad - low_rad) / 2.0
        if not _has_room(ground, _common_half_m(half_m, off_rad), middle_rad):
            continue
        if high_rad - low_rad < NARROWEST_SPAN_RAD:
            return True
        spans += [(low_rad, middle_rad), (middle_rad, high_rad)]
    return False


def _common_half_m(half_m: tuple[float, float], off_rad: float) -> tuple[float, float]:
    """Half sides of a rectangle that lies inside a rectangle turned by up to `off_rad` to either side."""
    sine, cosine = sin(off_rad), cos(off_rad)
    # Its corners stay inside when along + across sin <= half length and across + along sin <= half width.
    along_m = (half_m[0] - half_m[1] * sine) / cosine**2
    across_m = (half_m[1] - half_m[0] * sine) / cosine**2
    if along_m > 0.0 and across_m > 0.0:
        return along_m, across_m
    # The square in the circle inside the footprint, at any heading.
    side_m = min(half_m) / sqrt(2.0)
    return side_m, side_m


def _has_room(ground: Geometry, half_m: tuple[float, float], heading_rad: float) -> bool:
    ahead = np.array([sin(heading_rad), cos(heading_rad)]) * half_m[0]
    aside = np.array([cos(heading_rad), -sin(heading_rad)]) * half_m[1]
    corners = [ahead + aside, ahead - aside, -ahead - aside, aside - ahead]
    # A hair more ground, so that rounding refuses nothing that fits exactly.
    wide = shapely.buffer(ground, 1e-6, join_style="mitre")
    shifted = [shapely.affinity.translate(wide, -corner[0], -corner[1]) for corner in corners]
    return not shapely.intersection_all(shifted).is_empty
