"""The cameras of a session: each has a rate, pictures and CameraInfo, and detections where perception works on it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from bench.contracts import (
    CameraFrame,
    CarriesCamera,
    Detector,
    ObservesCameras,
    OpenRenderer,
    Scene,
    SimTime,
    Vehicle,
)
from bench.errors import Fault
from bench.simspec import Camera, SimSpec

from ._air_network import AirNetwork
from ._air_topics import RecordedPublisher
from ._camera_messages import CameraMessages
from ._detection_messages import DetectionMessages
from ._pictures import CameraPictures, camera_pictures
from ._truth import TruthRecorder


@dataclass(slots=True)
class _SessionCamera:
    settings: Camera
    messages: CameraMessages
    info: RecordedPublisher
    pictures: CameraPictures
    detector: Detector | None
    detections: DetectionMessages | None
    is_main: bool
    period_ns: int
    next_ns: int = 0
    frame: int = 0
    exposures: deque[SimTime] = field(default_factory=deque)

    def observed(self, vehicle: Vehicle, scene: Scene) -> CameraFrame:
        """The truth about its next frame."""
        if self.is_main:
            return scene.observe(vehicle.truth(), self.frame)
        assert isinstance(scene, ObservesCameras), "scene_faults looks at it before the flight"
        return scene.observe_with(self.settings, vehicle.truth(), self.frame)


class SessionCameras:
    """Captures and publishes the frames of all cameras, the main one first."""

    def __init__(
        self,
        simspec: SimSpec,
        air: AirNetwork,
        detectors: Sequence[Detector],
        truth: TruthRecorder,
        open_renderer: OpenRenderer | None,
    ) -> None:
        """`detectors` has one for each camera that perception works on, the main one's first."""
        self._truth = truth
        names = [camera.name for camera in simspec.perceiving_cameras]
        by_name = dict(zip(names, detectors, strict=True))
        pictures = camera_pictures(simspec, air, truth, open_renderer)
        self._cameras: list[_SessionCamera] = []
        for camera, publishers, drawn in zip(simspec.vehicle.cameras, air.cameras, pictures, strict=True):
            is_main = not self._cameras
            detections = air.detections if is_main else publishers.detections
            self._cameras.append(
                _SessionCamera(
                    camera,
                    CameraMessages.of(simspec, camera),
                    publishers.info,
                    drawn,
                    by_name.get(camera.name),
                    DetectionMessages(simspec, camera, detections) if detections else None,
                    is_main,
                    period_ns=round(1e9 / camera.rate_hz),
                )
            )

    def capture(self, vehicle: Vehicle, scene: Scene, now: SimTime) -> None:
        """Expose a frame of each camera that is due."""
        for camera in self._cameras:
            if now.ns >= camera.next_ns:
                # One frame a step at most: a camera that is faster than the controller has the controller's rate.
                camera.next_ns += camera.period_ns
                scene.advance(now)
                self._expose(camera, vehicle, scene, now)
                camera.exposures.append(now)
                camera.frame += 1

    def _expose(self, camera: _SessionCamera, vehicle: Vehicle, scene: Scene, now: SimTime) -> None:
        frame = None
        if camera.detector is not None:
            frame = camera.observed(vehicle, scene)
            self._truth.write_frame(frame)
        picture = None
        if camera.pictures.wanted:
            picture = camera.pictures.capture_with_pose(vehicle, scene, camera.frame, now)
        if camera.is_main and isinstance(vehicle, CarriesCamera):
            vehicle.record_exposure(camera.frame, now)
        if camera.detector is not None and frame is not None:
            camera.detector.process(frame, picture)

    def publish(self, now: SimTime) -> None:
        """Publish the CameraInfo, detections and pictures since the last call, camera by camera."""
        for camera in self._cameras:
            while camera.exposures:
                camera.info.publish(now, camera.messages.camera_info(camera.exposures.popleft()))
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
