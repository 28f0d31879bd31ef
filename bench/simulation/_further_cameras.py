"""The cameras beside the main one: each has its own rate, pictures and CameraInfo, and no sightings."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from bench.contracts import Scene, SimTime, VehicleState
from bench.simspec import SimSpec

from ._air_network import AirNetwork, CameraPublishers
from ._camera_messages import CameraMessages
from ._pictures import CameraPictures


@dataclass(slots=True)
class _FurtherCamera:
    messages: CameraMessages
    publishers: CameraPublishers
    pictures: CameraPictures
    period_ns: int
    next_ns: int = 0
    frame: int = 0
    exposures: deque[SimTime] = field(default_factory=deque)


class FurtherCameras:
    """Captures and publishes the frames of `vehicle.more_cameras`."""

    def __init__(self, simspec: SimSpec, air: AirNetwork, pictures: tuple[CameraPictures, ...]) -> None:
        self._cameras = [
            _FurtherCamera(
                CameraMessages.of(simspec, camera), publishers, drawn, period_ns=round(1e9 / camera.rate_hz)
            )
            for camera, publishers, drawn in zip(
                simspec.vehicle.more_cameras, air.cameras[1:], pictures, strict=True
            )
        ]

    def due(self, now: SimTime) -> bool:
        """Whether a camera exposes a frame now."""
        return any(now.ns >= camera.next_ns for camera in self._cameras)

    def capture(self, state: VehicleState, scene: Scene, now: SimTime) -> None:
        """Expose a frame of each camera that is due; `scene` stands at `now`."""
        for camera in self._cameras:
            if now.ns < camera.next_ns:
                continue
            # One frame a step at most, as of the main camera.
            camera.next_ns += camera.period_ns
            camera.exposures.append(now)
            if camera.pictures.wanted:
                camera.pictures.capture(state, scene, camera.frame, now)
            camera.frame += 1

    def publish(self, now: SimTime) -> None:
        """Publish the CameraInfo and the pictures exposed since the last call, camera by camera."""
        for camera in self._cameras:
            while camera.exposures:
                camera.publishers.info.publish(now, camera.messages.camera_info(camera.exposures.popleft()))
            camera.pictures.publish(now)
