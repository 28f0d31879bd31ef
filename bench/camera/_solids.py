"""Convex solids from rings of corners, and the geometry of a look made of several of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Floats, product
from bench.contracts import Geometry
from bench.simspec import MAX_CORNERS


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """One convex face: corners (k, 3) in order, and whether it lies on another face of its solid."""

    corners_m: Floats
    detail: bool = False


def loft(rings: Sequence[Floats]) -> list[Face]:
    """The faces of the convex solid over rings of equally many corners (k, 3), from the first ring to the last.

    Boxes, prisms, cylinders, cones and balls are all lofts. Faces without area, as at the tip of a cone, are left out.
    """
    faces = [Face(rings[0]), Face(rings[-1])]
    for lower, upper in itertools.pairwise(rings):
        for i in range(len(lower)):
            j = (i + 1) % len(lower)
            faces.append(Face(np.array((lower[i], lower[j], upper[j], upper[i]))))
    areas = [_area_vector(face.corners_m) for face in faces]
    return [face for face, area in zip(faces, areas, strict=True) if product(area, area) > 1e-10]


def rectangle(x0: float, x1: float, y0: float, y1: float, z: float) -> Floats:
    """(4, 3) a level rectangle, counterclockwise from above."""
    return np.array(((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)), dtype=np.float64)


def circle(radius_m: float, height_m: float, sides: int) -> Floats:
    """(sides, 3) a level polygon round the z axis, whose sides face the axes x and y when `sides` is even."""
    angles = (np.arange(sides) + 0.5) * (2.0 * math.pi / sides)
    return np.stack((radius_m * np.cos(angles), radius_m * np.sin(angles), np.full(sides, height_m)), axis=-1)


def geometry_of(solids: Sequence[Sequence[Face]]) -> Geometry:
    """The geometry of several convex solids; normals point away from the middle of each solid."""
    faces = [(number, face) for number, solid in enumerate(solids) for face in solid]
    corners = np.zeros((len(faces), MAX_CORNERS, 3))
    normals = np.zeros((len(faces), 3))
    middles = [np.concatenate([face.corners_m for face in solid]).mean(axis=0) for solid in solids]
    for index, (number, face) in enumerate(faces):
        count = len(face.corners_m)
        corners[index, :count] = face.corners_m
        corners[index, count:] = face.corners_m[-1]
        normal = _area_vector(face.corners_m)
        normal /= np.sqrt(product(normal, normal))
        # A solid without thickness has no outside: its corners were given in order.
        outwards = product(normal, face.corners_m.mean(axis=0) - middles[number]) >= -1e-6
        normals[index] = normal if outwards else -normal
    return Geometry(
        corners,
        np.array([len(face.corners_m) for _, face in faces], dtype=np.int64),
        normals,
        np.array([number for number, _ in faces], dtype=np.int64),
        np.array([face.detail for _, face in faces], dtype=np.bool_),
    )


_NEXT_AXES, _LAST_AXES = (1, 2, 0), (2, 0, 1)


def _area_vector(corners: Floats) -> Floats:
    """Normal of a polygon times twice its area (Newell's method, which bears repeated corners)."""
    # np.cross written out, to the bit: for so few corners it takes four times as long, and a scene has thousands of faces.
    following = np.concatenate((corners[1:], corners[:1]))
    across = corners.take(_NEXT_AXES, 1) * following.take(_LAST_AXES, 1)
    across -= corners.take(_LAST_AXES, 1) * following.take(_NEXT_AXES, 1)
    vector: Floats = across.sum(axis=0)
    return vector
