"""What hides an actor: a camouflage net over a vehicle, foliage around a person. Both grow with the concealment asked."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np

from ._solids import Face, circle, loft, rectangle


@dataclass(frozen=True, slots=True)
class ConcealedSolid:
    """One solid of the cover, and its colour."""

    faces: list[Face]
    paint: str


_NET = ("#6b7047", "#565b3a", "#7d7a55", "#4a5334")
_LEAVES = ("#4e6b34", "#3f5a2c", "#5d7a3c", "#4a6030")


def concealed(
    cover: str, level: float, size_m: tuple[float, float, float], asset: str
) -> list[ConcealedSolid]:
    """The solids that hide an asset of that size. Level 0: none; 1: as much as a camera from above can be kept from
    seeing without a roof, about four fifths.
    """
    if level <= 0.0 or cover == "none":
        return []
    # Each asset has its own fixed pattern: actors of one kind share a geometry.
    random = np.random.Generator(np.random.PCG64(zlib.crc32(asset.encode())))
    return _net(level, size_m, random) if cover == "net" else _foliage(level, size_m, random)


def _net(
    level: float, size_m: tuple[float, float, float], random: np.random.Generator
) -> list[ConcealedSolid]:
    """Pieces of a net that hangs over the asset like a tent, some of them missing."""
    length, width, height = size_m
    lower = rectangle(-0.62 * length, 0.62 * length, -0.85 * width, 0.85 * width, 0.05)
    upper = rectangle(-0.5 * length, 0.5 * length, -0.5 * width, 0.5 * width, 1.04 * height)
    solids = []
    sides = [(np.array((lower[i], lower[(i + 1) % 4], upper[(i + 1) % 4], upper[i]))) for i in range(4)] + [
        upper
    ]
    for quad in sides:
        across = max(2, min(8, round(math.dist(quad[1], quad[0]) / 1.2)))
        up = max(2, min(5, round(math.dist(quad[3], quad[0]) / 1.2)))
        for column in range(across):
            for row in range(up):
                if random.random() > 0.25 + 0.6 * level:
                    continue
                corners = []
                for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    u, v = (column + a) / across, (row + b) / up
                    corners.append(
                        (quad[0] * (1 - u) + quad[1] * u) * (1 - v) + (quad[3] * (1 - u) + quad[2] * u) * v
                    )
                solids.append(
                    ConcealedSolid([Face(np.array(corners))], _NET[int(random.random() * len(_NET))])
                )
    return solids


def _foliage(
    level: float, size_m: tuple[float, float, float], random: np.random.Generator
) -> list[ConcealedSolid]:
    """Shrubs around the asset and branches over it."""
    length, width, height = size_m
    solids = []
    count = 3 + round(5 * level)
    for number in range(count):
        angle = 2.0 * math.pi * (number + 0.4 * float(random.random())) / count
        radius = 0.22 * max(length, width) + 0.16 * height * level
        at = np.array((math.cos(angle) * (length / 2 + radius), math.sin(angle) * (width / 2 + radius), 0.0))
        tall = height * (0.35 + 0.5 * level * float(random.random()))
        rings = [
            circle(radius * share, tall * up, 5) + at for share, up in ((0.7, 0.0), (1.0, 0.5), (0.45, 1.0))
        ]
        solids.append(ConcealedSolid(loft(rings), _LEAVES[number % len(_LEAVES)]))
    if level >= 0.5:
        over = np.array((0.1 * length, 0.0, height))
        rings = [
            circle(0.55 * width * share, up * height, 5) + over
            for share, up in ((0.8, 0.02), (1.0, 0.05), (0.5, 0.1))
        ]
        solids.append(ConcealedSolid(loft(rings), _LEAVES[0]))
    return solids
