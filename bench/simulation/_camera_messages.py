"""What the air network says of one camera: its transform, and the CameraInfo of each frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from bench.contracts import SimTime, VehicleState
from bench.simspec import Camera, SimSpec
from bench.streams import CameraInfo, Header, Quaternion, Time, Transform, TransformStamped, Vector3

from ._camera import PinholeCamera
from ._frames import base_frame, level_frame, optical_frame


@dataclass(frozen=True, slots=True)
class CameraMessages:
    """A camera, its optical frame, and the frame that carries it."""

    camera: PinholeCamera
    optical: str
    carrier: str

    @classmethod
    def of(cls, simspec: SimSpec, camera: Camera) -> Self:
        """The messages of one camera of a SimSpec."""
        # A mount that keeps level does not sit on base_link but on a frame that shares only its place and yaw.
        carrier = level_frame(simspec) if camera.stabilized else base_frame(simspec)
        return cls(PinholeCamera.of(camera), optical_frame(simspec, camera), carrier)

    def mount(self, now: SimTime, state: VehicleState | None = None) -> TransformStamped:
        """The transform from the carrier to the optical frame: fixed, or as the gimbal holds it in `state`."""
        pan_rad, tilt_rad = 0.0, None
        if state is not None:
            pan_rad, tilt_rad = state.camera_pan_rad or 0.0, state.camera_tilt_rad
        x, y, z, w = self.camera.mount_quaternion(pan_rad, tilt_rad)
        transform = Transform(
            translation=Vector3(x=0.0, y=0.0, z=0.0), rotation=Quaternion(x=x, y=y, z=z, w=w)
        )
        header = Header(stamp=Time.of(now.ns), frame_id=self.carrier)
        return TransformStamped(header=header, child_frame_id=self.optical, transform=transform)

    def camera_info(self, exposed: SimTime) -> CameraInfo:
        """The CameraInfo of one exposure."""
        # ROS and OpenCV count from the middle of the first pixel, which would make cx and cy smaller by one half. Recordings
        # of published SimSpecs are compared byte for byte, so they stay (docs/camera.md).
        lens = self.camera.lens
        fx, fy, cx, cy = lens.fx, lens.fy, lens.cx, lens.cy
        return CameraInfo(
            header=Header(stamp=Time.of(exposed.ns), frame_id=self.optical),
            height=lens.height_px,
            width=lens.width_px,
            # sensor_msgs/CameraInfo has no model without distortion: plumb_bob with five zeros.
            distortion_model="plumb_bob",
            d=lens.distortion,
            k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
            r=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
            p=(fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0),
        )
