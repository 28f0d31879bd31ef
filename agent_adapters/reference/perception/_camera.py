"""The agent's own model of its camera over flat ground, from camera_info and /tf_static."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bench.streams import CameraInfo, Quaternion
from bench.values import value_class

from ._pose import VehiclePose

if TYPE_CHECKING:
    from bench.arrays import Bools, Floats
    from bench.contracts import Lens

# NumPy is imported in the functions that need it: importing it is a third of the agent's start, and an agent whose lens
# does not distort the picture can do without it.

# k1, k2, p1, p2, k3 of a lens that does not distort.
_STRAIGHT = (0.0, 0.0, 0.0, 0.0, 0.0)

# Beyond this, flat ground and the pose are not to be trusted for placing anything. Chosen, not measured.
MAX_RANGE_M = 400.0
# Keeps divisions finite.
_MIN_DEPTH_M = 1e-6
# x, y, z, w: an optical frame that looks straight ahead.
_OPTICAL_IN_FORWARD = (-0.5, 0.5, -0.5, 0.5)


@value_class(frozen=True, slots=True)
class View:
    """Where and when a frame was exposed, as far as it matters for what the frame shows of the ground."""

    time_s: float
    east_m: float
    north_m: float
    height_m: float
    yaw_rad: float


@value_class(frozen=True, slots=True)
class CameraLens:
    """Size of the picture, focal lengths, principal point and distortion, as camera_info states them."""

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float]

    @property
    def distorts(self) -> bool:
        """Whether the picture differs from that of a pinhole."""
        return self.distortion != _STRAIGHT

    def model(self) -> Lens:
        """The same lens for arrays of rays and pixels."""
        from bench.contracts import Lens  # imports NumPy

        return Lens("", self.width_px, self.height_px, self.fx, self.fy, self.cx, self.cy, self.distortion)


@value_class(frozen=True, slots=True)
class GroundCamera:
    """A camera on the vehicle: pixels to places on the ground, and places to pixels.

    `axes` is the rotation from the optical frame (z forward, x right, y down) to the body (x forward, y left,
    z up), row by row. A `level` mount keeps roll and pitch out of the view, so that only yaw turns it.
    """

    lens: CameraLens
    axes: tuple[tuple[float, float, float], ...]
    level: bool

    @staticmethod
    def of(info: CameraInfo, mount: Quaternion, *, level: bool) -> GroundCamera:
        """The camera that these messages describe."""
        axes = _matrix(mount.x, mount.y, mount.z, mount.w)
        fx, fy, cx, cy = info.k[0], info.k[4], info.k[2], info.k[5]
        # Another model than plumb_bob has other numbers of coefficients, and is taken for a lens without distortion.
        k1, k2, p1, p2, k3 = info.d if len(info.d) == len(_STRAIGHT) else _STRAIGHT
        lens = CameraLens(info.width, info.height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))
        return GroundCamera(lens, axes, level)

    def ground_point(
        self, u_px: float, v_px: float, pose: VehiclePose, height_m: float = 0.0
    ) -> tuple[float, float] | None:
        """East and north of what a pixel shows, `height_m` above ground; None above the horizon or too far."""
        lens = self.lens
        ray = ((u_px - lens.cx) / lens.fx, (v_px - lens.cy) / lens.fy, 1.0)
        if lens.distorts:
            import numpy as np

            x, y = lens.model().undistort(np.array(ray[:2])).tolist()
            # Beyond the picture the distortion may have no inverse: nothing is known of what is there.
            if math.isnan(x):
                return None
            ray = (x, y, 1.0)
        forward, leftward, up = (row[0] * ray[0] + row[1] * ray[1] + row[2] for row in self.axes)
        if not self.level:
            forward, leftward, up = _untilted(forward, leftward, up, pose)
        # At or above the horizon: the ray never meets the ground.
        if up >= -1e-6:
            return None
        scale = (pose.height_m - height_m) / -up
        if scale <= 0.0 or scale * math.hypot(forward, leftward) > MAX_RANGE_M:
            return None
        sine, cosine = math.sin(pose.yaw_rad), math.cos(pose.yaw_rad)
        east_m = pose.east_m + scale * (forward * sine - leftward * cosine)
        north_m = pose.north_m + scale * (forward * cosine + leftward * sine)
        return east_m, north_m

    def axes_enu(self, pose: VehiclePose) -> Floats:
        """(3, 3) rows: what is right, down and forward in the image, in east, north and up."""
        import numpy as np

        sine, cosine = math.sin(pose.yaw_rad), math.cos(pose.yaw_rad)
        rows = []
        for axis in zip(*self.axes, strict=True):
            forward, leftward, up = axis if self.level else _untilted(axis[0], axis[1], axis[2], pose)
            rows.append((forward * sine - leftward * cosine, forward * cosine + leftward * sine, up))
        return np.array(rows)

    def shows(self, east_m: float, north_m: float, view: View) -> bool:
        """Whether a place on the ground lies in the image of a view: `in_view` for one place and one pose."""
        if self.lens.distorts:
            import numpy as np

            row = np.array(((view.east_m, view.north_m, view.height_m, view.yaw_rad),))
            return bool(self.in_view(np.array(((east_m, north_m),)), row)[0, 0])
        east_m, north_m = east_m - view.east_m, north_m - view.north_m
        sine, cosine = math.sin(view.yaw_rad), math.cos(view.yaw_rad)
        forward = east_m * sine + north_m * cosine
        leftward = north_m * sine - east_m * cosine
        ahead_axis, left_axis, up_axis = self.axes
        depth = ahead_axis[2] * forward + left_axis[2] * leftward - up_axis[2] * view.height_m
        if depth <= 0.0:
            return False
        depth = max(depth, _MIN_DEPTH_M)
        lens = self.lens
        right = ahead_axis[0] * forward + left_axis[0] * leftward - up_axis[0] * view.height_m
        if not 0.0 <= right / depth * lens.fx + lens.cx < lens.width_px:
            return False
        down = ahead_axis[1] * forward + left_axis[1] * leftward - up_axis[1] * view.height_m
        return 0.0 <= down / depth * lens.fy + lens.cy < lens.height_px

    def in_view(self, places_enu_m: Floats, poses: Floats) -> Bools:
        """(m, n): whether each of n places on the ground (n, 2) lies in the image taken at each of m poses.

        A pose is a row of east, north, height, yaw; roll and pitch are left out, as a level mount does, which
        is good enough for judging what has been looked at.
        """
        import numpy as np

        # One array for each axis: an axis more in all of them takes twice the time.
        east_m, north_m = (places_enu_m[None, :, axis] - poses[:, None, axis] for axis in (0, 1))
        sine, cosine = np.sin(poses[:, 3])[:, None], np.cos(poses[:, 3])[:, None]
        forward = east_m * sine + north_m * cosine
        leftward = north_m * sine - east_m * cosine
        up = -poses[:, 2][:, None]
        a = self.axes
        x, y, z = (a[0][i] * forward + a[1][i] * leftward + a[2][i] * up for i in range(3))
        # Places behind the camera are masked below; the floor only keeps their division finite.
        depth = np.maximum(z, _MIN_DEPTH_M)
        lens = self.lens
        u, v = x / depth, y / depth
        if lens.distorts:
            pixels = lens.model().pixels(np.stack((u, v), axis=-1))
            u, v = pixels[..., 0], pixels[..., 1]
        else:
            u, v = u * lens.fx + lens.cx, v * lens.fy + lens.cy
        return np.asarray((z > 0.0) & (u >= 0) & (u < lens.width_px) & (v >= 0) & (v < lens.height_px))

    def ahead_m(self, height_m: float) -> tuple[float, float, float]:
        """How far ahead the lower edge, the middle and the upper edge of the image meet the ground."""
        pose = VehiclePose(0.0, 0.0, 0.0, height_m, 0.0, 0.0, 0.0)
        lower_edge, middle, far = (
            self.ground_point(self.lens.cx, v, pose) for v in (self.lens.height_px, self.lens.cy, 0.0)
        )
        near_m, middle_m = (point[1] if point else 0.0 for point in (lower_edge, middle))
        return near_m, middle_m, far[1] if far else MAX_RANGE_M

    def swath_m(self, height_m: float) -> float:
        """Width of the ground seen across the middle of the image."""
        pose = VehiclePose(0.0, 0.0, 0.0, height_m, 0.0, 0.0, 0.0)
        left_edge, right_edge = (
            self.ground_point(u, self.lens.cy, pose) for u in (0.0, float(self.lens.width_px))
        )
        return right_edge[0] - left_edge[0] if left_edge and right_edge else height_m


def _matrix(x: float, y: float, z: float, w: float) -> tuple[tuple[float, float, float], ...]:
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if norm < 1e-9:
        x, y, z, w = _OPTICAL_IN_FORWARD
        # A quaternion of zeros states no mount; straight ahead is the camera that needs no rotation but the
        # optical one.
        norm = 1.0
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )


def _untilted(forward: float, leftward: float, up: float, pose: VehiclePose) -> tuple[float, float, float]:
    """A direction in the body (forward, left, up) as seen level: roll and pitch taken out, yaw kept."""
    right, down = -leftward, -up
    sine, cosine = math.sin(pose.roll_rad), math.cos(pose.roll_rad)
    right, down = right * cosine - down * sine, right * sine + down * cosine
    sine, cosine = math.sin(pose.pitch_rad), math.cos(pose.pitch_rad)
    forward, down = forward * cosine + down * sine, -forward * sine + down * cosine
    return forward, -right, -down
