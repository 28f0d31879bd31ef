"""What a renderer gets and what it gives: a stage once, then a picture for each camera pose.

Frames are those of ROS (REP 103 and 105): the world is `map`, east-north-up; the camera's optical frame is x right,
y down, z forward; an actor's own frame is x ahead, y left, z up, with its origin at the foot point. Colours are
blue, green, red, from 0 to 255 as a display shows them (not linear), the order of OpenCV and of ROS's `bgr8`.

Pixels are continuous: the picture spans [0, width] x [0, height] from its top left corner, so the pixel in column
i and row j covers [i, i + 1] x [j, j + 1].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Bools, Counts, Floats, Narrow, product
from bench.clock import SimTime
from bench.errors import Fault
from bench.values import value_class

if TYPE_CHECKING:
    from bench.simspec import Camera

Pixels = NDArray[np.uint8]
Labels = NDArray[np.uint16]

NO_DISTORTION = (0.0, 0.0, 0.0, 0.0, 0.0)

_UNDISTORTION_STEPS = 30
_UNDISTORTION_TOLERANCE = 1e-6
_BORDER_POINTS = 33
"""On each side of the picture: a side of a distorted picture bends at most a few times."""


@value_class(frozen=True, slots=True)
class Lens:
    """Size of the picture, focal lengths and principal point in pixels, and distortion.

    `distortion` is ROS's `plumb_bob`: k1, k2, p1, p2, k3 of Brown's model as OpenCV writes it.
    """

    name: str
    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = NO_DISTORTION

    def distort(self, rays: Floats) -> Floats:
        """(..., 2) where the lens puts rays (x/z, y/z): both in units of the focal length.

        Source: D. C. Brown (1966), "Decentering distortion of lenses"; the order of terms is OpenCV's.
        """
        k1, k2, p1, p2, k3 = self.distortion
        x, y = rays[..., 0], rays[..., 1]
        square = x * x + y * y
        radial = 1.0 + square * (k1 + square * (k2 + square * k3))
        return np.stack(
            (
                x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
                y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
            ),
            axis=-1,
        )

    def undistort(self, rays: Floats) -> Floats:
        """(..., 2) the rays (x/z, y/z) that the lens puts at `rays`; NaN where the model has no inverse."""
        undistorted = np.array(rays, dtype=np.float64)
        if self.distortion == NO_DISTORTION:
            return undistorted
        for _ in range(_UNDISTORTION_STEPS):
            # Fixed point: what distortion adds changes slowly over the picture.
            undistorted -= self.distort(undistorted) - rays
            # Where there is no inverse the steps grow without bound; ten focal lengths are beyond any lens.
            np.clip(undistorted, -10.0, 10.0, out=undistorted)
        wrong = np.abs(self.distort(undistorted) - rays).max(axis=-1) >= _UNDISTORTION_TOLERANCE
        undistorted[wrong] = np.nan
        return undistorted

    def straight_pixels(self, pixels: Floats) -> Floats:
        """(..., 2) where this lens would show what it shows at (..., 2) pixels if it had no distortion; NaN where the model
        has no inverse.
        """
        centre, focal = (self.cx, self.cy), (self.fx, self.fy)
        straight: Floats = self.undistort((pixels - centre) / focal) * focal + centre
        return straight

    def border_rays(self) -> Floats:
        """(n, 2) rays (x/z, y/z) around the border of the picture; NaN where the distortion has no inverse."""
        share = np.linspace(0.0, 1.0, _BORDER_POINTS)
        low, high = np.zeros_like(share), np.ones_like(share)
        along = np.stack(
            (np.concatenate((share, share, low, high)), np.concatenate((low, high, share, share)))
        )
        pixels = along.T * (self.width_px, self.height_px)
        return self.undistort((pixels - (self.cx, self.cy)) / (self.fx, self.fy))

    def pixels(self, rays: Floats) -> Floats:
        """(..., 2) pixels of rays (x/z, y/z).

        Beyond what the picture shows, the distortion at its border goes on: the model would fold over there, and bring
        what is far outside back into the picture.
        """
        if self.distortion != NO_DISTORTION:
            radius = np.sqrt((rays * rays).sum(axis=-1, keepdims=True))
            stretch = np.maximum(1.0, radius / _view_radius(self))
            rays = self.distort(rays / stretch) * stretch
        pixels: Floats = rays * (self.fx, self.fy) + (self.cx, self.cy)
        return pixels

    def project(self, points_optical_m: Floats) -> Floats:
        """(..., 2) pixels of (..., 3) points in the optical frame; NaN for what is not in front of the camera."""
        points = np.asarray(points_optical_m, dtype=np.float64)
        # A point behind the camera would give a mirrored pixel that looks valid.
        depth = np.where(points[..., 2] > 0.0, points[..., 2], np.nan)
        rays = self.distort(points[..., :2] / depth[..., None])
        return np.stack((self.cx + self.fx * rays[..., 0], self.cy + self.fy * rays[..., 1]), axis=-1)


# Undistorting the border takes a millisecond, and a session has few lenses.
@lru_cache(maxsize=64)
def _view_radius(lens: Lens) -> float:
    """The largest root of (x/z)^2 + (y/z)^2 that the picture shows."""
    return float(np.sqrt((lens.border_rays() ** 2).sum(axis=1)).max())


def lens_of(camera: Camera) -> Lens:
    """The lens of a SimSpec's camera: square pixels, axis through the middle."""
    focal_px = camera.width_px / 2.0 / math.tan(math.radians(camera.horizontal_fov_deg) / 2.0)
    return Lens(
        camera.name,
        camera.width_px,
        camera.height_px,
        focal_px,
        focal_px,
        camera.width_px / 2.0,
        camera.height_px / 2.0,
        camera.distortion.coefficients,
    )


def distortion_faults(lens: Lens) -> list[Fault]:
    """A fault if the distortion folds over inside the picture, so that two points of the world share a pixel."""
    if not np.isnan(lens.border_rays()).any():
        return []
    return [
        Fault(
            f"camera {lens.name}: distortion",
            f"the model folds over inside the picture (k1, k2, p1, p2, k3 = {lens.distortion})",
            "give coefficients that were calibrated for this field of view, or a narrower one",
        )
    ]


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Where a camera is at the middle of an exposure, and how it moves.

    `axes_enu` (3, 3) has the optical right, down and forward axes as rows, so it takes ENU differences to the
    optical frame. `rates_optical_radps` (3,) turns the camera about those axes.
    """

    time: SimTime
    position_enu_m: Floats
    axes_enu: Floats
    velocity_enu_mps: Floats
    rates_optical_radps: Floats

    def to_optical(self, points_enu_m: Floats) -> Floats:
        """(..., 3) points of the world in the optical frame, in metres."""
        return product(np.asarray(points_enu_m, dtype=np.float64) - self.position_enu_m, self.axes_enu.T)


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """Convex faces of convex solids, in the actor's frame; actors of one look and posture share one object.

    corners_m (f, c, 3): corners in order, the last one repeated up to c.
    corner_counts (f,); normals (f, 3) of length 1, outwards; solids (f,) the number of the solid.
    details (f,): faces that lie on another face of their solid, such as windows, and are seen over it.
    """

    corners_m: Floats
    corner_counts: Counts
    normals: Floats
    solids: Counts
    details: Bools


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Geometry and colour of one actor: colours_bgr (f, 3) in white light; glows (f,) for faces that shine at night."""

    geometry: Geometry
    colours_bgr: Floats
    glows: Bools


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The flat ground z = 0: a picture of it from above, north up, and fine structure for close views.

    texture (h, w, 3): its top left corner lies at (`west_m`, `north_m`), a texel is `texel_m` wide.
    detail (n, n): a factor of 128ths that repeats over the ground with texels of `detail_texel_m`.
    """

    texture: Pixels
    texel_m: float
    west_m: float
    north_m: float
    detail: Pixels
    detail_texel_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Light and air, after exposure: factors on colours as displayed.

    `sunward_enu` (3,) points to the sun. A face with normal n shows its colour times
    (`ambient_bgr` + `direct_bgr` max(0, n . sunward)) ** (1 / 2.2), both linear. What is R metres away keeps the share
    exp(-extinction_per_m R) of that and takes the rest from `haze_bgr`. `zenith_bgr` colours the sky overhead.
    Faces that shine show at least `glow_bgr`; it is black by day.
    """

    sunward_enu: Floats
    ambient_bgr: Floats
    direct_bgr: Floats
    haze_bgr: Floats
    zenith_bgr: Floats
    extinction_per_m: float
    glow_bgr: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """All that does not change during a session. `looks` follow the order of the cast."""

    lens: Lens
    ground: Ground
    light: Light
    looks: tuple[Look, ...]


class Picture(Protocol):
    """One rendered picture, before rain, blur, noise and dirt. The truth costs nothing until it is asked for."""

    @property
    def bgr(self) -> Pixels:
        """(h, w, 3) the picture, with the lens's distortion."""

    def instances(self) -> Labels:
        """(h, w) 1 + the actor's place in the cast where the pixel shows it, else 0."""

    def depth_m(self) -> Narrow:
        """(h, w) distance along the optical axis; infinite where the pixel shows the sky."""

    def silhouette_px(self, actor: int) -> int:
        """The number of pixels that the actor would cover if nothing hid it."""


class Renderer(Protocol):
    """Draws one stage. Equal arguments give equal pixels, whatever was drawn before: frames may be skipped."""

    def render(self, pose: CameraPose, positions_enu_m: Floats, headings_rad: Floats) -> Picture:
        """The picture from `pose`.

        positions_enu_m (n, 3): foot points; headings_rad (n,): clockwise from north; both in the order of the cast.
        """


@runtime_checkable
class NamesBuild(Protocol):
    """What a renderer offers beside `Renderer` when its pixels depend on more than its package's version."""

    @property
    def build(self) -> str:
        """On what the pixels rest, such as a driver and its version: equal only where this is equal."""


class OpenRenderer(Protocol):
    """The entry point of group `rebar.renderers`."""

    def __call__(self, stage: Stage) -> Renderer:
        """The renderer of a stage. Raises SetupError for a stage or on a host where it cannot draw."""


@runtime_checkable
class ChecksHost(Protocol):
    """What an entry point offers beside `OpenRenderer` when it cannot draw on every host."""

    def host_faults(self) -> Sequence[Fault]:
        """Why it cannot draw on this one; asked before a session or campaign starts. `where` is left empty."""
