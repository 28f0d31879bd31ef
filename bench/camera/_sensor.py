"""What happens to a picture between the lens and the stream: rain, motion, dirt, gain noise, lost and frozen frames.

All of it works on the picture that any renderer gives, and all of it is drawn from the seeds and the number of the frame
alone: leaving out frames changes no other frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from bench.arrays import Narrow, product
from bench.contracts import CameraPose, Lens, Pixels
from bench.simspec import Seeds, generator

from ._conditions import Conditions, exposure_of

CAMERA_PATH = 2
"""The camera's path in the random stream `perception`; the detector has 0 and 1."""

# What a generator is for: one frame, the whole session, one stretch of frames. 3 and 4 are the ground and the looks.
_FRAME, _STAGE, _FREEZE = 0, 1, 2
_FURTHER_CAMERA = 5

_SPARE_PX = 128
"""Tiles of noise and rain are larger than the picture by this much, and lie at another offset in each frame."""

# Assumed: read noise of a small sensor by day in display levels, and its growth for each doubling of the gain.
_NOISE_BY_DAY, _NOISE_PER_STOP = 1.2, 0.9

_LONGEST_BLUR_PX = 61


@dataclass(frozen=True, slots=True)
class FrameState:
    """What became of one exposure: `shown` is the number of the frame whose picture is sent, None for none."""

    number: int
    shown: int | None

    @property
    def frozen(self) -> bool:
        """Whether an older picture is sent again."""
        return self.shown is not None and self.shown != self.number


class Sensor:
    """Effects on pictures, from conditions and seeds."""

    def __init__(self, lens: Lens, conditions: Conditions, seeds: Seeds, number: int = 0) -> None:
        """`number`: the place of the camera among those of its vehicle, of which each draws for itself."""
        self._lens, self._conditions, self._seeds = lens, conditions, seeds
        self._path = (CAMERA_PATH,) if number == 0 else (CAMERA_PATH, _FURTHER_CAMERA, number)
        self.exposure = exposure_of(conditions)
        random = self._random(_STAGE)
        size = (lens.height_px + _SPARE_PX, lens.width_px + _SPARE_PX)
        self._noise = self._noise_tiles(size, random)
        self._rain = _rain_tile(size, conditions.rain_level, random) if conditions.rain_level else None
        self._dirt = _dirt_maps(lens, conditions.lens_dirt, random) if conditions.lens_dirt else None

    def state(self, number: int) -> FrameState:
        """Whether frame `number` arrives, and with which picture."""
        conditions = self._conditions
        if conditions.dropped_share and self._random(_FRAME, number).random() < conditions.dropped_share:
            return FrameState(number, None)
        return FrameState(number, self._last_live(number))

    def expose(self, picture: Pixels, pose: CameraPose, distance_m: float, number: int) -> Pixels:
        """The picture as the camera sends it. distance_m: to what the axis meets, for blur by the vehicle's motion."""
        random = self._random(_FRAME, number)
        random.random()  # the draw of `state`
        rain_at, noise_at = random.integers(0, _SPARE_PX, (2, 2)).tolist()
        image = picture
        if self._rain is not None:
            image = np.asarray(cv2.add(image, self._window(self._rain, rain_at)), np.uint8)
        image = self._blurred(image, pose, distance_m)
        if self._dirt is not None:
            factor, veil = self._dirt
            image = np.asarray(cv2.add(cv2.multiply(image, factor, scale=1.0 / 255.0), veil), np.uint8)
        if self._noise is not None:
            brighter, darker = self._noise
            noisy = cv2.subtract(
                cv2.add(image, self._window(brighter, noise_at)), self._window(darker, noise_at)
            )
            image = np.asarray(noisy, np.uint8)
        return image

    def _random(self, *path: int) -> np.random.Generator:
        return generator(self._seeds, "perception", *self._path, *path)

    def _last_live(self, number: int) -> int:
        """The latest frame up to `number` that the camera did not freeze.

        Time is cut into stretches of twice the mean length; a stretch may hold one freeze, anywhere in it, so that a
        frame's state needs no history.
        """
        conditions = self._conditions
        if not conditions.frozen_share:
            return number
        # A stretch holds at most one freeze, so a share of s needs stretches no longer than the freeze over s.
        length = max(2, round(conditions.frozen_frames / max(conditions.frozen_share, 1e-9)))
        stretch = number // length
        random = self._random(_FREEZE, stretch)
        frozen = min(length - 1, max(1, round(float(random.uniform(0.5, 1.5)) * conditions.frozen_frames)))
        # The first frame of a stretch is live, and is what a freeze from the second on repeats.
        start = stretch * length + 1 + int(random.random() * (length - frozen))
        return start - 1 if start <= number < start + frozen else number

    def _window(self, tile: Pixels, at: list[int]) -> Pixels:
        return tile[at[0] : at[0] + self._lens.height_px, at[1] : at[1] + self._lens.width_px]

    def _blurred(self, image: Pixels, pose: CameraPose, distance_m: float) -> Pixels:
        """Blur along the path of the picture's middle during the exposure."""
        lens, shutter_s = self._lens, self.exposure.shutter_s
        across = product(pose.axes_enu, pose.velocity_enu_mps) / max(distance_m, 1.0)
        rates = pose.rates_optical_radps
        # A turn about the down axis moves the picture to the left, one about the right axis moves it down.
        dx = -(rates[1] + across[0]) * lens.fx * shutter_s
        dy = (rates[0] - across[1]) * lens.fy * shutter_s
        length = math.hypot(dx, dy)
        if length < 1.5:
            return image
        size = min(_LONGEST_BLUR_PX, 2 * math.ceil(length / 2.0) + 1)
        shrink = min(1.0, (size - 1) / length)
        kernel = np.zeros((size, size), np.float32)
        middle = (size - 1) * 8  # in sixteenths of a pixel
        half = (round(dx * shrink * 8), round(dy * shrink * 8))
        cv2.line(
            kernel,
            (middle - half[0], middle - half[1]),
            (middle + half[0], middle + half[1]),
            (1.0,),
            1,
            cv2.LINE_8,
            4,
        )
        return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), np.uint8)

    def _noise_tiles(
        self, size: tuple[int, int], random: np.random.Generator
    ) -> tuple[Pixels, Pixels] | None:
        stops = math.log2(self.exposure.gain)
        deviation = self._conditions.noise * (_NOISE_BY_DAY + _NOISE_PER_STOP * stops)
        if deviation <= 0.0:
            return None
        noise = random.standard_normal((*size, 3), dtype=np.float32)
        # Half of it is common to the colours: brightness noise, which survives demosaicing.
        noise = (noise + noise[..., :1]) * np.float32(deviation / math.sqrt(2.0))
        return np.clip(noise, 0, 120).astype(np.uint8), np.clip(-noise, 0, 120).astype(np.uint8)


def _rain_tile(size: tuple[int, int], level: float, random: np.random.Generator) -> Pixels:
    """Streaks, a hundred for each level in 640 x 480 pixels."""
    rows, columns = size
    streaks: Narrow = np.zeros(size, np.float32)
    for _ in range(round(100.0 * level * rows * columns / 307200)):
        x, y, length = (int(v) for v in random.integers((0, 0, 10), (columns, rows, 40)))
        brightness = float(random.uniform(20.0, 70.0))
        cv2.line(streaks, (x, y), (x - length // 7, y + length), (brightness,), 1, cv2.LINE_AA)
    grey = np.clip(cv2.GaussianBlur(streaks, (3, 3), 0), 0, 255).astype(np.uint8)
    return np.asarray(cv2.merge((grey, grey, grey)), np.uint8)


def _dirt_maps(lens: Lens, dirt: float, random: np.random.Generator) -> tuple[Pixels, Pixels]:
    """(h, w, 3) factors in 255ths and veil of a dirty front glass: smears and specks, out of focus, and dark corners."""
    rows, columns = lens.height_px, lens.width_px
    cover: Narrow = np.zeros((rows, columns), np.float32)
    for _ in range(round(90 * dirt)):
        x, y = (int(v) for v in random.integers((0, 0), (columns, rows)))
        radius = float(random.uniform(0.006, 0.05)) * columns
        stretch, angle = float(random.uniform(0.4, 1.0)), float(random.uniform(0.0, 180.0))
        spot = np.zeros_like(cover)
        axes = (max(1, round(radius)), max(1, round(radius * stretch)))
        cv2.ellipse(spot, (x, y), axes, angle, 0.0, 360.0, (float(random.uniform(0.35, 0.95)),), -1)
        cover = np.maximum(cover, spot)
    sigma = columns / 110.0
    cover = np.asarray(cv2.GaussianBlur(cover, (0, 0), sigma), np.float32) * np.float32(
        min(1.0, 0.5 + 0.5 * dirt)
    )
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    corner = ((x / columns - 0.5) ** 2 + (y / rows - 0.5) ** 2) * np.float32(0.9 * dirt)
    factor = np.clip((1.0 - cover) * (1.0 - corner) * 255.0, 0, 255).astype(np.uint8)
    veil = (cover[..., None] * np.array((78.0, 92.0, 104.0), np.float32)).astype(np.uint8)
    return np.asarray(cv2.merge((factor, factor, factor)), np.uint8), veil
