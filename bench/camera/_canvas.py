"""The picture before distortion: a pinhole picture large enough for the lens, and the way from one to the other."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.contracts import NO_DISTORTION, Lens, distortion_faults
from bench.errors import SetupError

P = TypeVar("P", np.uint8, np.uint16, np.float32)

MAX_ENLARGEMENT = 2.5
"""A canvas this many times wider or higher than the picture costs its square: a fisheye lens needs another renderer."""


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """A lens without distortion, and for each pixel of the real one the place on the canvas that it shows."""

    lens: Lens
    maps: tuple[NDArray[np.int16], NDArray[np.uint16]] | None
    nearest: NDArray[np.int16] | None

    @classmethod
    def of(cls, lens: Lens) -> Self:
        """The canvas of a lens. Raises SetupError for a distortion that folds over or needs too large a canvas."""
        if lens.distortion == NO_DISTORTION:
            return cls(lens, None, None)
        if faults := distortion_faults(lens):
            raise SetupError(faults)
        columns, rows = np.meshgrid(np.arange(lens.width_px) + 0.5, np.arange(lens.height_px) + 0.5)
        distorted = np.stack(((columns - lens.cx) / lens.fx, (rows - lens.cy) / lens.fy), axis=-1)
        rays = lens.undistort(distorted)
        # A margin of two pixels lets interpolation at the border find neighbours.
        left = max(0, math.ceil(float((-rays[..., 0]).max()) * lens.fx - lens.cx) + 2)
        right = max(0, math.ceil(float(rays[..., 0].max()) * lens.fx + lens.cx - lens.width_px) + 2)
        above = max(0, math.ceil(float((-rays[..., 1]).max()) * lens.fy - lens.cy) + 2)
        below = max(0, math.ceil(float(rays[..., 1].max()) * lens.fy + lens.cy - lens.height_px) + 2)
        width, height = lens.width_px + left + right, lens.height_px + above + below
        if width > MAX_ENLARGEMENT * lens.width_px or height > MAX_ENLARGEMENT * lens.height_px:
            raise SetupError(
                f"camera {lens.name}: distortion",
                f"the picture before distortion would have {width} x {height} pixels",
                f"at most {MAX_ENLARGEMENT:g} times the picture's size is drawn; lower the coefficients",
            )
        canvas = replace(
            lens,
            width_px=width,
            height_px=height,
            cx=lens.cx + left,
            cy=lens.cy + above,
            distortion=NO_DISTORTION,
        )
        # OpenCV counts from the middle of the first pixel.
        x = (rays[..., 0] * canvas.fx + canvas.cx - 0.5).astype(np.float32)
        y = (rays[..., 1] * canvas.fy + canvas.cy - 0.5).astype(np.float32)
        whole, fraction = cv2.convertMaps(x, y, cv2.CV_16SC2)
        nearest = np.stack((np.rint(x), np.rint(y)), axis=-1).astype(np.int16)
        return cls(canvas, (np.asarray(whole, np.int16), np.asarray(fraction, np.uint16)), nearest)

    def smooth(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The image through the lens, interpolated."""
        if self.maps is None:
            return image
        return np.asarray(cv2.remap(image, self.maps[0], self.maps[1], cv2.INTER_LINEAR), np.uint8)

    def exact(self, image: NDArray[P]) -> NDArray[P]:
        """The image through the lens, every pixel with a value that the image has: for masks and depth."""
        if self.nearest is None:
            return image
        taken: NDArray[P] = image[self.nearest[..., 1], self.nearest[..., 0]]
        return taken
