"""The ground under OpenCV's renderer: mip-mapped textures, light, shadows, haze and the sky."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.arrays import Bools, Floats, Narrow, product
from bench.contracts import CameraPose, Lens, Pixels, Stage

from ._view import NEAR_M

_MAP_SCALE = 8
"""Light and haze are smooth, so their maps have an eighth of the resolution (4 ms less for 640x480)."""

_LEVEL_ROLL = 0.1
"""Up to this sine of the roll, rows of the picture look about equally far, and each gets one level of the mip map. Bands
then do not overlap: 640x480 takes 3 ms less."""

_MAP_ONE = 128.0
"""The map value for a factor of 1: leaves room for twice the brightness."""

SHIFT = 4
"""Fractional bits of polygon corners: a sixteenth of a pixel."""

FAR_CORNER_PX = 30000.0  # fillConvexPoly counts sixteenths of pixels in 32 bits, with products of two

GAMMA = 1.0 / 2.2


@dataclass(frozen=True, slots=True, eq=False)
class _Band:
    """One level of the ground's mip map, mirrored beyond its border, with the size of a texel."""

    texture: Pixels
    texel_m: float
    west_m: float
    north_m: float


class GroundPainter:
    """The ground with its light, shadows and haze, and the sky."""

    def __init__(self, stage: Stage, lens: Lens) -> None:
        self._lens, self._light = lens, stage.light
        self._bands = _bands(stage)
        self._details = _details(stage)
        self._outside = cv2.mean(stage.ground.texture)[:3]
        columns = np.arange(0, lens.width_px, _MAP_SCALE) + _MAP_SCALE / 2.0
        rows = np.arange(0, lens.height_px, _MAP_SCALE) + _MAP_SCALE / 2.0
        x, y = np.meshgrid((columns - lens.cx) / lens.fx, (rows - lens.cy) / lens.fy)
        self._rays = np.stack((x, y, np.ones_like(x)), axis=-1).astype(np.float32)
        self._ray_lengths = np.sqrt((self._rays**2).sum(axis=-1))
        light = stage.light
        level = light.ambient_bgr + light.direct_bgr * max(0.0, float(light.sunward_enu[2]))
        self._lit_bgr = (level**GAMMA).astype(np.float32)
        share = float((light.ambient_bgr / np.maximum(level, 1e-12)).mean())
        self._shadow_factor = share**GAMMA

    def paint(self, pose: CameraPose, shadows: Floats) -> Pixels:
        """A new picture (h, w, 3) of ground and sky."""
        lens = self._lens
        height = max(float(pose.position_enu_m[2]), 0.1)
        # How much a ray falls for each metre along the axis.
        fall = -product(self._rays, pose.axes_enu[:, 2].astype(np.float32))
        sky = fall <= 1e-4
        level_camera = abs(float(pose.axes_enu[0, 2])) < _LEVEL_ROLL
        distance: Narrow = np.where(sky, 1e6, height / np.maximum(fall, 1e-4) * self._ray_lengths).astype(
            np.float32
        )
        # The picture of the ground, without what lies behind the camera.
        place = np.array((pose.position_enu_m[0], pose.position_enu_m[1], height))
        to_picture = np.array(((lens.fx, 0.0, lens.cx - 0.5), (0.0, lens.fy, lens.cy - 0.5), (0.0, 0.0, 1.0)))
        homography = product(
            to_picture,
            np.column_stack((pose.axes_enu[:, 0], pose.axes_enu[:, 1], -product(pose.axes_enu, place))),
        )
        image = self._textured(homography, distance, height, sky, level_camera)
        factor = self._fine_structure(homography, pose, distance, sky, level_camera)
        factor = self._shaded(factor, homography, pose, shadows, place)
        clear = np.exp(-self._light.extinction_per_m * distance)
        clear[sky] = 0.0
        size = (lens.width_px, lens.height_px)
        scale = _MAP_ONE * self._lit_bgr
        gain = cv2.resize(np.clip(clear[..., None] * scale, 0, 255).astype(np.uint8), size)
        if factor is not None:
            gain = cv2.multiply(gain, cv2.merge((factor, factor, factor)), scale=1.0 / _MAP_ONE)
        veil = cv2.resize(((1.0 - clear[..., None]) * self._light.haze_bgr).astype(np.uint8), size)
        lit = np.asarray(cv2.add(cv2.multiply(image, gain, scale=1.0 / _MAP_ONE), veil), np.uint8)
        if sky.any():
            self._paint_sky(lit, pose)
        return lit

    def _textured(
        self, homography: Floats, distance: Narrow, height: float, sky: Bools, level_camera: bool
    ) -> Pixels:
        """The ground in white light: each band of distances from the level of the mip map that fits it."""
        lens = self._lens
        # Between the footprint of a pixel across and along the line of sight: isotropic mip maps blur along or
        # alias across, and 0.45 is where the eye minds least (tried on the sheet of docs/camera.md).
        grazing = np.clip(height / distance, 0.12, 1.0)
        texels = distance / lens.fx / self._bands[0].texel_m / grazing * 0.45
        level = np.clip(np.rint(np.log2(np.maximum(texels, 1e-3))), 0, len(self._bands) - 1).astype(np.int8)
        if level_camera:
            level[:] = level[:, level.shape[1] // 2, None]
        image = np.empty((lens.height_px, lens.width_px, 3), np.uint8)
        for number, band in enumerate(self._bands):
            mask = (level == number) & ~sky
            if (part := _pixel_window(mask, lens)) is None:
                continue
            columns, rows, block = part
            window = image[rows, columns]
            whole = bool(block.all())
            warped = cv2.warpPerspective(
                band.texture,
                _from_texture(homography, columns, rows, band.texel_m, band.west_m, band.north_m),
                (columns.stop - columns.start, rows.stop - rows.start),
                # A band that fills its window is warped in place.
                window if whole else None,
                flags=cv2.INTER_LINEAR,
                # BORDER_REFLECT costs 12 ms; the bands are mirrored at set-up instead.
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=self._outside,
            )
            if not whole:
                cv2.copyTo(warped, _enlarged(block, warped.shape), window)
        if sky.any():
            image[_enlarged(sky, image.shape) > 0] = 0
        return image

    def _fine_structure(
        self, homography: Floats, pose: CameraPose, distance: Narrow, sky: Bools, level_camera: bool
    ) -> Pixels | None:
        """(h, w) factors in 128ths where the camera is near enough to see them, else None."""
        lens = self._lens
        size: Narrow = distance / np.float32(lens.fx)
        if float(size.min()) > self._details[-1].texel_m:
            return None
        if level_camera:
            size[:] = size[:, size.shape[1] // 2, None]
        factor = np.full((lens.height_px, lens.width_px), int(_MAP_ONE), np.uint8)
        for number, band in enumerate(self._details):
            lower = 0.0 if number == 0 else self._details[number - 1].texel_m
            part = _pixel_window((size > lower) & (size <= band.texel_m) & ~sky, lens)
            if part is None:
                continue
            columns, rows, block = part
            # The structure repeats, so the piece that is warped moves with the camera by whole periods.
            period = band.west_m
            east = math.floor(pose.position_enu_m[0] / period) * period
            north = math.floor(pose.position_enu_m[1] / period) * period
            extent = band.texture.shape[0] * band.texel_m / 2.0
            warped = cv2.warpPerspective(
                band.texture,
                _from_texture(homography, columns, rows, band.texel_m, east - extent, north + extent),
                (columns.stop - columns.start, rows.stop - rows.start),
                flags=cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(_MAP_ONE,),
            )
            cv2.copyTo(warped, _enlarged(block, warped.shape), factor[rows, columns])
        return factor

    def _shaded(
        self, factor: Pixels | None, homography: Floats, pose: CameraPose, shadows: Floats, place: Floats
    ) -> Pixels | None:
        """The factors with shadows in them."""
        if not len(shadows):
            return factor
        lens = self._lens
        mask = np.full((lens.height_px, lens.width_px), 255, np.uint8)
        dark = (int(255 * self._shadow_factor),)
        ground = np.concatenate((shadows, np.ones((*shadows.shape[:2], 1))), axis=-1)
        points = product(ground, homography.T)
        ahead = points[..., 2] > NEAR_M
        pixels = points[..., :2] / np.maximum(points[..., 2:], NEAR_M)
        tame = ahead.all(axis=1) & (np.abs(pixels).max(axis=(1, 2)) < FAR_CORNER_PX)
        rounded = fixed_point(np.clip(pixels, -1e6, 1e6))
        for index in np.flatnonzero(ahead.any(axis=1)).tolist():
            polygon = rounded[index]
            if not tame[index]:
                corners = np.concatenate((shadows[index], np.zeros((len(shadows[index]), 1))), axis=1)
                cut = cut_to_frame(product(corners - place, pose.axes_enu.T), lens)
                if len(cut) < 3:
                    continue
                polygon = fixed_point(cut)
            cv2.fillConvexPoly(mask, polygon, dark, cv2.LINE_8, SHIFT)
        # The sun is half a degree wide, so no shadow has a hard edge.
        mask = np.asarray(cv2.blur(mask, (3, 3)), np.uint8)
        if factor is None:
            return np.asarray(cv2.convertScaleAbs(mask, alpha=_MAP_ONE / 255.0), np.uint8)
        return np.asarray(cv2.multiply(factor, mask, scale=1.0 / 255.0), np.uint8)

    def _paint_sky(self, image: NDArray[np.uint8], pose: CameraPose) -> None:
        """The sky above the exact horizon: haze there, the colour of the zenith overhead."""
        lens = self._lens
        frame = np.array(
            ((0.0, 0.0), (lens.width_px, 0.0), (lens.width_px, lens.height_px), (0.0, lens.height_px))
        )
        rays = np.concatenate((frame, np.ones((4, 1))), axis=1)
        rays[:, 0] = (rays[:, 0] - lens.cx) / lens.fx
        rays[:, 1] = (rays[:, 1] - lens.cy) / lens.fy
        above = _cut(frame, product(rays, pose.axes_enu[:, 2]))
        if len(above) < 3:
            return
        sine = product(self._rays, pose.axes_enu[:, 2].astype(np.float32)) / self._ray_lengths
        share = np.sqrt(np.clip(sine / 0.8, 0.0, 1.0))[..., None]
        light = self._light
        colours = np.clip(light.haze_bgr * (1.0 - share) + light.zenith_bgr * share, 0, 255).astype(np.uint8)
        mask = np.zeros(image.shape[:2], np.uint8)
        polygon = fixed_point(above - 0.5)
        cv2.fillConvexPoly(mask, polygon, (255,), cv2.LINE_8, SHIFT)
        cv2.copyTo(cv2.resize(colours, (lens.width_px, lens.height_px)), mask, image)


def _bands(stage: Stage) -> list[_Band]:
    """The mip map of the ground. Coarse levels are mirrored at the border, so that the ground goes on."""
    ground = stage.ground
    bands = []
    texture, texel_m = ground.texture, ground.texel_m
    while True:
        rows, columns = texture.shape[:2]
        # Only what is seen from afar shows ground beyond the texture; up to 1024 texels the mirror is small.
        above, beside = (rows, columns) if max(rows, columns) <= 1024 else (0, 0)
        mirrored = cv2.copyMakeBorder(texture, above, above, beside, beside, cv2.BORDER_REFLECT)
        west, north = ground.west_m - beside * texel_m, ground.north_m + above * texel_m
        bands.append(_Band(np.asarray(mirrored, np.uint8), texel_m, west, north))
        if min(rows, columns) < 32:
            return bands
        texture = _halved(texture)
        texel_m = texel_m * 2.0


def _details(stage: Stage) -> list[_Band]:
    """The mip map of the fine structure, each level repeated to 2048 texels; `west_m` holds the period."""
    ground = stage.ground
    period = ground.detail.shape[0] * ground.detail_texel_m
    bands = []
    tile, texel_m = ground.detail, ground.detail_texel_m
    for _ in range(4):
        # An even number of tiles keeps the phase of the structure on the world's origin.
        count = max(2, 2048 // tile.shape[0])
        bands.append(_Band(np.tile(tile, (count, count)), texel_m, period, 0.0))
        tile = _halved(tile)
        texel_m *= 2.0
    return bands


def _halved(texture: Pixels) -> Pixels:
    size = (texture.shape[1] // 2, texture.shape[0] // 2)
    return np.asarray(cv2.resize(texture, size, interpolation=cv2.INTER_AREA), np.uint8)


def _from_texture(
    homography: Floats, columns: slice, rows: slice, texel_m: float, west_m: float, north_m: float
) -> Floats:
    """(3, 3) from the texels of a texture with that north-west corner to a window of the picture."""
    to_window = np.array(((1.0, 0.0, -columns.start), (0.0, 1.0, -rows.start), (0.0, 0.0, 1.0)))
    texels = np.array(
        (
            (texel_m, 0.0, west_m + texel_m / 2.0),
            (0.0, -texel_m, north_m - texel_m / 2.0),
            (0.0, 0.0, 1.0),
        )
    )
    return product(product(to_window, homography), texels)


def _pixel_window(mask: Bools, lens: Lens) -> tuple[slice, slice, Bools] | None:
    """Columns and rows of pixels around the set cells of a map, and the cells in there; None when none is set."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    return (
        slice(int(left) * _MAP_SCALE, min(lens.width_px, int(right) * _MAP_SCALE)),
        slice(int(top) * _MAP_SCALE, min(lens.height_px, int(bottom) * _MAP_SCALE)),
        mask[top:bottom, left:right],
    )


def _enlarged(block: Bools, shape: tuple[int, ...]) -> Pixels:
    """A map of cells as a mask of pixels, cut to a shape."""
    pixels = np.repeat(np.repeat(block.astype(np.uint8), _MAP_SCALE, axis=0), _MAP_SCALE, axis=1)
    return np.ascontiguousarray(pixels[: shape[0], : shape[1]])


def fixed_point(pixels: Floats) -> NDArray[np.int32]:
    """Polygon corners as OpenCV fills them, in sixteenths of pixels."""
    return np.rint(pixels * (1 << SHIFT)).astype(np.int32)


def _cut(points: Floats, signed: Floats) -> Floats:
    """The part of a polygon (k, d) where `signed` (k,) is positive (Sutherland and Hodgman 1974)."""
    corners = []
    for i in range(len(points)):
        j = (i + 1) % len(points)
        if signed[i] > 0.0:
            corners.append(points[i])
        if (signed[i] > 0.0) != (signed[j] > 0.0):
            corners.append(points[i] + (points[j] - points[i]) * (signed[i] / (signed[i] - signed[j])))
    return np.array(corners).reshape(-1, points.shape[1])


def cut_to_frame(corners: Floats, lens: Lens) -> Floats:
    """(k, 2) OpenCV's pixels of a face (k, 3) in optical coordinates, cut near the camera and the picture."""
    margin = 16.0
    left, right = (-margin - lens.cx) / lens.fx, (lens.width_px + margin - lens.cx) / lens.fx
    top, bottom = (-margin - lens.cy) / lens.fy, (lens.height_px + margin - lens.cy) / lens.fy
    for side in (
        np.array((0.0, 0.0, 1.0, -NEAR_M)),
        np.array((1.0, 0.0, -left, 0.0)),
        np.array((-1.0, 0.0, right, 0.0)),
        np.array((0.0, 1.0, -top, 0.0)),
        np.array((0.0, -1.0, bottom, 0.0)),
    ):
        corners = _cut(corners, product(corners, side[:3]) + side[3])
        if len(corners) < 3:
            return np.zeros((0, 2))
    scale = np.array((lens.fx, lens.fy))
    pixels: Floats = corners[:, :2] / corners[:, 2:] * scale + np.array((lens.cx - 0.5, lens.cy - 0.5))
    return pixels
