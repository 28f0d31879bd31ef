"""A camera that a SimSpec describes, on the vehicle.

Pixels are continuous: the picture spans [0, width] x [0, height] from its top left corner, and the axis meets
its middle. Camera coordinates are ROS's optical frame (REP 103): x right, y down, z forward. The camera sits
at the vehicle's position, without a lever arm. A stabilized mount takes roll and pitch out, so that only yaw
turns the camera; on the gimbal the state's pan and tilt turn it further.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bench.arrays import product
from bench.contracts import NO_DISTORTION, Lens, VehicleState, body_axes_enu, distortion_faults, lens_of
from bench.errors import SetupError
from bench.simspec import Camera


@dataclass(frozen=True, slots=True)
class PinholeCamera:
    """Lens, tilt of the axis below the horizon in radians, and mount of a camera.

    `half_view` are the largest x/z and y/z of the rays that the picture shows.
    """

    lens: Lens
    tilt_rad: float
    stabilized: bool
    gimbal: bool
    half_view: tuple[float, float]

    @classmethod
    def of(cls, camera: Camera) -> Self:
        """The camera of a SimSpec: square pixels, axis through the middle.

        Raises SetupError for a distortion that folds over inside the picture.
        """
        lens = lens_of(camera)
        if faults := distortion_faults(lens):
            raise SetupError(faults)
        half_view = (lens.width_px / (2.0 * lens.fx), lens.height_px / (2.0 * lens.fy))
        if lens.distortion != NO_DISTORTION:
            across, down = np.abs(lens.border_rays()).max(axis=0).tolist()
            half_view = (across, down)
        return cls(lens, math.radians(camera.tilt_deg), camera.stabilized, camera.gimbal, half_view)

    @property
    def name(self) -> str:
        """The camera's name in the SimSpec."""
        return self.lens.name

    def axes_enu(self, state: VehicleState) -> NDArray[np.float64]:
        """(3, 3) the camera's right, down and forward axes as rows: takes ENU differences to them."""
        # A level mount cancels roll and pitch alone; the vehicle's heading still turns the camera.
        roll, pitch = (0.0, 0.0) if self.stabilized else (state.roll_rad, state.pitch_rad)
        # A fixed camera beside one on the gimbal keeps its direction.
        yaw = state.yaw_rad + ((state.camera_pan_rad or 0.0) if self.gimbal else 0.0)
        ahead, right, below = body_axes_enu(roll, pitch, yaw)
        turned = self.gimbal and state.camera_tilt_rad is not None
        tilt = state.camera_tilt_rad if turned and state.camera_tilt_rad is not None else self.tilt_rad
        st, ct = math.sin(tilt), math.cos(tilt)
        down = [ct * b - st * a for a, b in zip(ahead, below, strict=True)]
        forward = [ct * a + st * b for a, b in zip(ahead, below, strict=True)]
        return np.array((right, down, forward))

    def project(self, points_enu_m: NDArray[np.float64], state: VehicleState) -> NDArray[np.float64]:
        """(..., 2) pixels of (..., 3) ENU points; NaN for what does not lie in front of the camera."""
        in_camera = product(
            np.asarray(points_enu_m, dtype=np.float64) - state.position_enu_m, self.axes_enu(state).T
        )
        # A point behind the camera would have a mirrored pixel; NaN makes every comparison false.
        depth = np.where(in_camera[..., 2] > 0.0, in_camera[..., 2], np.nan)
        return self.lens.pixels(in_camera[..., :2] / depth[..., None])

    def mount_quaternion(
        self, pan_rad: float = 0.0, tilt_rad: float | None = None
    ) -> tuple[float, float, float, float]:
        """x, y, z, w of the optical frame in its parent (x forward, y left, z up), for /tf_static or /tf.

        Panned about the vertical, tilted down about the left axis, then turned from body to optical axes. The
        parent is base_level for a stabilized camera, which roll and pitch do not move, and base_link
        otherwise.
        """
        tilt_rad = self.tilt_rad if tilt_rad is None else tilt_rad
        s, c = math.sin(tilt_rad / 2.0) / 2.0, math.cos(tilt_rad / 2.0) / 2.0
        if not pan_rad:
            return (-c - s, c + s, s - c, c - s)
        sp, cp = math.sin(-pan_rad / 2.0), math.cos(pan_rad / 2.0)
        x, y, z, w = -c - s, c + s, s - c, c - s
        return (cp * x - sp * y, cp * y + sp * x, cp * z + sp * w, cp * w - sp * z)
