"""The picture of the ground from above: a ground type's colours, patches, tufts, and the roads of the world."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from bench.arrays import Floats, Narrow
from bench.contracts import Ground, Pixels
from bench.simspec import Polygon, Road

_MARGIN_M = 150.0
"""Ground around the area of interest with a texture of its own; beyond it the texture is mirrored."""

_LEAST_TEXEL_M = 0.12
_MAX_TEXELS = 3072  # 28 MB; a larger area gets coarser texels, and the fine structure hides that
_DETAIL_TEXELS, _DETAIL_TEXEL_M = 512, 0.05


class GroundType(StrEnum):
    """What the ground is made of."""

    GRASS = "grass"
    FARMLAND = "farmland"
    DESERT = "desert"
    GRAVEL = "gravel"
    URBAN = "urban"
    SNOW = "snow"


@dataclass(frozen=True, slots=True)
class _Palette:
    """Colours (blue, green, red) of the ground and of the patches in it, the contrast of its structure, and the
    number of tufts or stones on a hectare with their colour.
    """

    base: tuple[int, int, int]
    patch: tuple[int, int, int]
    contrast: float
    tufts_per_ha: float
    tuft: tuple[int, int, int]


# Chosen by eye on the sheet of docs/camera.md.
_PALETTES = {
    GroundType.GRASS: _Palette((58, 112, 96), (82, 124, 140), 1.0, 90.0, (38, 78, 58)),
    GroundType.FARMLAND: _Palette((62, 118, 110), (88, 138, 158), 0.8, 15.0, (40, 84, 62)),
    GroundType.DESERT: _Palette((132, 168, 196), (112, 146, 176), 0.7, 25.0, (88, 128, 130)),
    GroundType.GRAVEL: _Palette((122, 130, 136), (104, 114, 122), 0.9, 60.0, (92, 98, 104)),
    GroundType.URBAN: _Palette((116, 120, 122), (96, 118, 108), 0.5, 6.0, (48, 90, 66)),
    GroundType.SNOW: _Palette((236, 232, 228), (214, 214, 212), 0.35, 12.0, (96, 108, 104)),
}
_ASPHALT, _MARKING, _SHOULDER = (84, 82, 80), (214, 216, 218), (112, 126, 136)


def ground_of(
    area: Polygon, roads: tuple[Road, ...], kind: GroundType, random: np.random.Generator
) -> Ground:
    """The ground around an area of interest, in world coordinates."""
    corners = np.array([(corner.east_m, corner.north_m) for corner in area.corners])
    points = np.array([(point.east_m, point.north_m) for road in roads for point in road.points]).reshape(
        -1, 2
    )
    # A road may lead far away; its texels are worth having only near the area.
    low, high = corners.min(axis=0) - _MARGIN_M, corners.max(axis=0) + _MARGIN_M
    texel_m = max(_LEAST_TEXEL_M, float((high - low).max()) / _MAX_TEXELS)
    columns, rows = (math.ceil(side / texel_m / 64.0) * 64 for side in (high - low).tolist())
    texture = _textured(columns, rows, texel_m, _PALETTES[kind], random)
    if kind is GroundType.FARMLAND:
        _plough(texture, texel_m, random)
    if len(points):
        for road in roads:
            line = (np.array([(p.east_m, p.north_m) for p in road.points]) - (low[0], high[1])) / (
                texel_m,
                -texel_m,
            )
            _pave(texture, line, road.width_m / texel_m, texel_m, random)
    return Ground(texture, texel_m, float(low[0]), float(high[1]), _fine_structure(random), _DETAIL_TEXEL_M)


def _cloud(columns: int, rows: int, cell: float, random: np.random.Generator) -> Narrow:
    """(rows, columns) smooth noise of unit deviation at its nodes, which are `cell` texels apart."""
    nodes = random.standard_normal((math.ceil(rows / cell) + 3, math.ceil(columns / cell) + 3))
    return np.asarray(
        cv2.resize(nodes.astype(np.float32), (columns, rows), interpolation=cv2.INTER_CUBIC), np.float32
    )


def _textured(
    columns: int, rows: int, texel_m: float, palette: _Palette, random: np.random.Generator
) -> Pixels:
    # The coarse noise is made at a quarter of the resolution: four times four texels look alike in it anyway.
    small = (columns // 4, rows // 4)
    tone = 9.0 * _cloud(*small, 40.0 / texel_m / 4.0, random) + 7.0 * _cloud(
        *small, 9.0 / texel_m / 4.0, random
    )
    share = np.clip(
        (
            _cloud(*small, 35.0 / texel_m / 4.0, random)
            + 0.5 * _cloud(*small, 7.0 / texel_m / 4.0, random)
            - 0.5
        )
        * 1.5,
        0.0,
        1.0,
    )
    tone *= palette.contrast
    coarse = np.empty((small[1], small[0], 3), np.float32)
    for channel in range(3):
        coarse[..., channel] = (
            palette.base[channel] * (1.0 - share)
            + palette.patch[channel] * share
            + tone * (0.7, 1.0, 0.9)[channel]
        )
    texture = cv2.resize(
        np.clip(coarse, 0, 255).astype(np.uint8), (columns, rows), interpolation=cv2.INTER_LINEAR
    )
    # Fine noise repeats every 512 texels; the patches above hide that.
    grain = random.standard_normal((512, 512)) * 6.0 + _cloud(512, 512, 4.0, random) * 5.0
    tile = np.clip(128.0 + grain * palette.contrast, 0, 255).astype(np.uint8)
    grain_map = np.tile(tile, (-(-rows // 512), -(-columns // 512)))[:rows, :columns]
    texture = cv2.multiply(texture, cv2.merge((grain_map, grain_map, grain_map)), scale=1.0 / 128.0)
    hectares = columns * rows * texel_m * texel_m / 1e4
    count = min(20000, int(palette.tufts_per_ha * hectares))
    places = (random.random((count, 2)) * (columns, rows) * 16.0).astype(np.int64).tolist()
    radii = (random.uniform(0.15, 0.7, count) / texel_m * 16.0).astype(np.int64).tolist()
    shades = random.uniform(0.75, 1.2, count).tolist()
    for (x, y), radius, shade in zip(places, radii, shades, strict=True):
        colour = tuple(value * shade for value in palette.tuft)
        cv2.circle(texture, (x, y), max(radius, 8), colour, -1, cv2.LINE_8, 4)
    return np.asarray(texture, np.uint8)


def _plough(texture: Pixels, texel_m: float, random: np.random.Generator) -> None:
    """Fields of crops with furrows in different directions."""
    rows, columns = texture.shape[:2]
    side = int(70.0 / texel_m)
    for top in range(0, rows, side):
        for left in range(0, columns, side):
            colour = random.choice(((60, 128, 118), (96, 150, 176), (50, 96, 74), (84, 116, 132)))
            field = texture[top : top + side - int(2.0 / texel_m), left : left + side - int(2.0 / texel_m)]
            if not field.size:
                continue
            angle = float(random.uniform(0.0, math.pi))
            y, x = np.mgrid[0 : field.shape[0], 0 : field.shape[1]].astype(np.float32)
            phase = (x * math.cos(angle) + y * math.sin(angle)) * np.float32(texel_m * 2.0 * math.pi / 1.6)
            furrows = 1.0 + 0.1 * np.sin(phase)
            field[:] = np.clip(0.45 * field + 0.55 * colour * furrows[..., None], 0, 255).astype(np.uint8)


def _pave(texture: Pixels, line: Floats, width: float, texel_m: float, random: np.random.Generator) -> None:
    """One road in texels: shoulders, asphalt, and markings on what is wide enough for two lanes."""
    points = np.rint(line * 16.0).astype(np.int32).reshape(-1, 1, 2)
    rows, columns = texture.shape[:2]
    mask = np.zeros((rows, columns), np.uint8)
    for extra, colour in ((0.6 / texel_m, _SHOULDER), (0.0, _ASPHALT)):
        mask[:] = 0
        cv2.polylines(mask, [points], False, (255,), max(1, round(width + extra * 2.0)), cv2.LINE_8, 4)
        # The grain of the ground shows through, so that asphalt is not a flat colour.
        table = 0.12 * np.arange(256)[:, None] + 0.88 * np.array(colour)
        cv2.copyTo(cv2.LUT(texture, table.astype(np.uint8)[None]), mask, texture)
    if width * texel_m < 5.0:
        return
    thickness = max(1, round(0.18 / texel_m))
    for start, end in itertools.pairwise(line):
        length = float(np.hypot(*(end - start)))
        along = (end - start) / length
        across = np.array((-along[1], along[0]))
        for side in (-1.0, 1.0):
            edge = side * (width / 2.0 - 0.3 / texel_m) * across
            _stroke(texture, start + edge, end + edge, thickness)
        dash, gap = 3.0 / texel_m, 6.0 / texel_m
        for offset in np.arange(0.0, length - dash, dash + gap).tolist():
            _stroke(texture, start + along * offset, start + along * (offset + dash), thickness)


def _stroke(texture: Pixels, start: Floats, end: Floats, thickness: int) -> None:
    ends = np.rint(np.stack((start, end)) * 16.0).astype(np.int64).tolist()
    cv2.line(texture, ends[0], ends[1], _MARKING, thickness, cv2.LINE_8, 4)


def _fine_structure(random: np.random.Generator) -> Pixels:
    """(n, n) factors in 128ths that continue over their border: blades and grains for a camera near the ground."""
    size = _DETAIL_TEXELS
    noise = random.standard_normal((size, size)).astype(np.float32)
    structure = np.zeros((size, size), np.float32)
    for sigma, weight in ((0.7, 9.0), (2.0, 8.0), (6.0, 7.0)):
        blurred = cv2.GaussianBlur(np.pad(noise, 24, mode="wrap"), (0, 0), sigma)[24:-24, 24:-24]
        structure += weight * blurred / float(blurred.std())
    return np.asarray(np.clip(128.0 + structure, 40, 230), np.uint8)
