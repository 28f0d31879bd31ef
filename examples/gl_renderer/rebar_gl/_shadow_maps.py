"""Where the shadow maps lie: two groups of actors by their distance, each with a map that holds it and no more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.arrays import Counts, Floats

MAP_SIZE = 2048
SPLIT_M = 80.0
"""Actors nearer than this have a map of their own: at this range, a pixel of a 640x480 picture is as wide as its texels."""

_MARGIN_TEXELS = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class ShadowMap:
    """The actors that throw shadows into a map, and the way from the optical frame to the map's clip space (4, 4)."""

    actors: Counts
    from_optical: Floats
    texel_m: float


def shadow_maps(
    actors: Counts, centres_optical_m: Floats, radii_m: Floats, sunward: Floats
) -> list[ShadowMap]:
    """A map of the near actors and one of the far ones, each where there are any.

    centres_optical_m (k, 3) and radii_m (k,) are the spheres around `actors`, sunward (3,) in the optical frame.
    """
    near = (centres_optical_m**2).sum(axis=1) < SPLIT_M**2
    return [
        _fitted(actors[group], centres_optical_m[group], radii_m[group], sunward) for group in (near, ~near)
    ]


def _fitted(actors: Counts, centres: Floats, radii: Floats, sunward: Floats) -> ShadowMap:
    if not len(actors):
        # Everything lies outside of this one.
        return ShadowMap(actors, np.diag((0.0, 0.0, 0.0, 1.0)) + _moved(np.array((9.0, 9.0, 0.0))), 0.0)
    across = np.cross(sunward, np.eye(3)[int(np.abs(sunward).argmin())])
    across /= np.linalg.norm(across)
    axes = np.stack((across, np.cross(sunward, across), -sunward))
    places = centres @ axes.T
    low, high = (places - radii[:, None]).min(axis=0), (places + radii[:, None]).max(axis=0)
    texel_m = float((high - low)[:2].max()) / (MAP_SIZE - 2.0 * _MARGIN_TEXELS)
    half = np.array((texel_m * MAP_SIZE / 2.0, texel_m * MAP_SIZE / 2.0, (high - low)[2] / 2.0 + texel_m))
    scaled = axes / half[:, None]
    matrix = np.eye(4)
    matrix[:3, :3] = scaled
    matrix[:3, 3] = -((low + high) / 2.0) / half
    return ShadowMap(actors, matrix, texel_m)


def _moved(shift: Floats) -> Floats:
    matrix = np.zeros((4, 4))
    matrix[:3, 3] = shift
    return matrix
