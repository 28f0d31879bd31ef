"""The cameras beside the main one: each has a rate, pictures and CameraInfo, or detections too."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from bench.contracts import Detector, ObservesCameras, Scene, SimTime, Vehicle
from bench.errors import Fault
from bench.simspec import Camera, SimSpec

from ._air_network import AirNetwork
from ._air_topics import CameraPublishers
from ._camera_messages import CameraMessages
from ._detection_messages import DetectionMessages
from ._pictures import CameraPictures
from ._truth import TruthRecorder


@dataclass(slots=True)
class _FurtherCamera:
    settings: Camera
    messages: CameraMessages
    publishers: CameraPublishers
    pictures: CameraPictures
    detector: Detector | None
    detections: DetectionMessages | None
    period_ns: int
    next_ns: int = 0
    frame: int = 0
    exposures: deque[SimTime] = field(default_factory=deque)


class FurtherCameras:
    """Captures and publishes the frames of `vehicle.more_cameras`."""

    def __init__(
        self,
        simspec: SimSpec,
        air: AirNetwork,
        pictures: tuple[CameraPictures, ...],
        detectors: Mapping[str, Detector],
        truth: TruthRecorder,
    ) -> None:
        """`detectors` has one for each camera of `perception.more_cameras`, by name."""
        self._truth = truth
        self._cameras = [
            _FurtherCamera(
                camera,
                CameraMessages.of(simspec, camera),
                publishers,
                drawn,
                detectors.get(camera.name),
                DetectionMessages(simspec, camera, publishers.detections) if publishers.detections else None,
                period_ns=round(1e9 / camera.rate_hz),
            )
            for camera, publishers, drawn in zip(
                simspec.vehicle.more_cameras, air.cameras[1:], pictures, strict=True
            )
        ]

    def due(self, now: SimTime) -> bool:
        """Whether a camera exposes a frame now."""
        return any(now.ns >= camera.next_ns for camera in self._cameras)

    def capture(self, vehicle: Vehicle, scene: Scene, now: SimTime) -> None:
        """Expose a frame of each camera that is due; `scene` stands at `now`."""
        for camera in self._cameras:
            if now.ns < camera.next_ns:
                continue
            # One frame a step at most, as of the main camera.
            camera.next_ns += camera.period_ns
            camera.exposures.append(now)
            self._expose(camera, vehicle, scene, now)
            camera.frame += 1

    def _expose(self, camera: _FurtherCamera, vehicle: Vehicle, scene: Scene, now: SimTime) -> None:
        if camera.detector is None:
            if camera.pictures.wanted:
                camera.pictures.capture(vehicle.truth(), scene, camera.frame, now)
            return
        assert isinstance(scene, ObservesCameras), "scene_faults looks at it before the flight"
        frame = scene.observe_with(camera.settings, vehicle.truth(), camera.frame)
        self._truth.write_frame(frame)
        picture = (
            camera.pictures.capture_with_pose(vehicle, scene, camera.frame, now)
            if camera.pictures.wanted
            else None
        )
        camera.detector.process(frame, picture)

    def publish(self, now: SimTime) -> None:
        """Publish the CameraInfo, detections and pictures since the last call, camera by camera."""
        for camera in self._cameras:
            while camera.exposures:
                camera.publishers.info.publish(now, camera.messages.camera_info(camera.exposures.popleft()))
            if camera.detections is not None and camera.detector is not None:
                camera.detections.publish(now, camera.detector)
            camera.pictures.publish(now)


def scene_faults(simspec: SimSpec, scene: Scene) -> list[Fault]:
    """A fault where perception is to work on further cameras and the scene knows the main one alone."""
    if not simspec.perception.more_cameras or isinstance(scene, ObservesCameras):
        return []
    what = f"the scene {simspec.world.scene!r} does not say what further cameras see"
    return [
        Fault("perception.more_cameras", what, "leave the field out, or name another scene in world.scene")
    ]
