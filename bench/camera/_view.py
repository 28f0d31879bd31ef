"""Which actors a picture can show: shared by every renderer of the bench, so that they draw the same ones."""

from __future__ import annotations

import math

import numpy as np

from bench.arrays import Counts, Floats
from bench.contracts import CameraPose, Lens, Light
from bench.simspec import LEAST_CONTRAST_DEPTH

NEAR_M = 0.2
"""Faces are cut this far in front of the camera, which is inside any vehicle's own body."""

LEAST_BODY_PX = 0.8
"""Smaller bodies and solids are not drawn: anti-aliased they would not change a pixel visibly."""

_FARTHEST_M = 4000.0


def reach_m(light: Light) -> float:
    """How far something can be seen through the air."""
    return min(_FARTHEST_M, LEAST_CONTRAST_DEPTH / light.extinction_per_m)


def in_view(lens: Lens, light: Light, pose: CameraPose, centres: Floats, radii: Floats) -> Counts:
    """(k,) indices of the spheres that touch the view and are large and clear enough to be visible."""
    x, y, z = pose.to_optical(centres).T
    distance = np.sqrt(x * x + y * y + z * z)
    visible = (distance - radii < reach_m(light)) & (z + radii > NEAR_M)
    visible &= 2.0 * radii * lens.fx > LEAST_BODY_PX * distance
    # Signed distances to the four sides of the view.
    for along, across, focal, middle, size in (
        (z, x, lens.fx, lens.cx, lens.width_px),
        (z, y, lens.fy, lens.cy, lens.height_px),
    ):
        lower, upper = middle / focal, (size - middle) / focal
        visible &= (across + along * lower) / math.hypot(1.0, lower) > -radii
        visible &= (along * upper - across) / math.hypot(1.0, upper) > -radii
    return np.flatnonzero(visible)


def actor_axes(headings_rad: Floats) -> Floats:
    """(n, 3, 3) the actors' axes ahead, left and up as rows of ENU."""
    sine, cosine = np.sin(headings_rad), np.cos(headings_rad)
    axes = np.zeros((len(headings_rad), 3, 3))
    axes[:, 0, 0], axes[:, 0, 1] = sine, cosine
    axes[:, 1, 0], axes[:, 1, 1] = -cosine, sine
    axes[:, 2, 2] = 1.0
    return axes
