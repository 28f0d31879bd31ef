"""Vehicle, scene, cameras and operator of a session: what they say at a moment, and how they come to the next."""

from __future__ import annotations

from bench.contracts import (
    DETECTOR_OPENED,
    FIRMWARE_BOOTED,
    CarriesCamera,
    FirmwareBuild,
    Outcome,
    PixelDetectorBuild,
    SimTime,
    fact_of,
)

from ._further_cameras import FurtherCameras
from ._mission_information import MissionInformation
from ._pictures import camera_pictures
from ._session_parts import SessionParts
from ._stop_session import StopSession


class World:
    """The side of a session that is not its agent's. All of it reaches the recording."""

    def __init__(self, parts: SessionParts) -> None:
        spec = parts.plan.simspec
        self._parts, self._progress, self._truth = parts, parts.progress, parts.truth
        self.information = MissionInformation(spec, parts.air, parts.scene)
        self._detector, *detectors = parts.detectors
        self._pictures, *pictures = camera_pictures(spec, parts.air, parts.truth, parts.plan.open_renderer)
        names = [camera.name for camera in spec.perceiving_cameras[1:]]
        self._further_cameras = FurtherCameras(
            spec, parts.air, tuple(pictures), dict(zip(names, detectors, strict=True)), parts.truth
        )
        self._carries_camera = parts.vehicle if isinstance(parts.vehicle, CarriesCamera) else None
        self._frame = 0
        self._frame_period_ns = round(1e9 / spec.vehicle.camera.rate_hz)
        self._next_frame_ns = 0

    def begin(self) -> None:
        """Write what stands at the head of the recording."""
        now, facts = self._progress.now, self._progress.facts
        self._truth.write_event(now, "started", self._parts.plan.simspec.name)
        if detector := fact_of(facts, PixelDetectorBuild):
            self._truth.write_event(now, DETECTOR_OPENED, detector.description)
        if firmware := fact_of(facts, FirmwareBuild):
            self._truth.write_event(now, FIRMWARE_BOOTED, firmware.description)
        if self._parts.plan.manifest.truth:
            self._truth.write_event(now, "truth given", self._parts.plan.manifest.name)
        self._truth.write_cast(now, self._parts.scene)
        self._write_due(now)

    def end(self, outcome: Outcome) -> None:
        """Write what stands at the end of the recording."""
        self._write_due(self._progress.now)
        self._truth.write_event(self._progress.now, "ended", f"{outcome}")

    def publish(self, now: SimTime) -> None:
        """Publish what the agent may know, and let the operator do what is due while the vehicle is handed over."""
        self.information.publish(now, self._parts.vehicle, self._detector)
        self._pictures.publish(now)
        self._further_cameras.publish(now)
        operator = self._parts.operator
        if operator is None:
            return
        actions = [operator.receive(order, now) for order in self.information.take_delivered()]
        for action in (*actions, operator.act(now, self._parts.vehicle)):
            if action is not None:
                self._truth.write_event(now, action.name, action.text)

    def advance(self, span_s: float) -> None:
        """Let `span_s` simulated seconds pass."""
        vehicle, scene = self._parts.vehicle, self._parts.scene
        until = self._progress.now.after(span_s)
        while self._progress.now < until:
            previous = self._progress.now
            vehicle.step()
            self._progress.now = now = vehicle.time
            self._truth.write_mavlink(previous, now)
            if (link := self._truth.flooded_link(now)) is not None:
                raise StopSession(
                    Outcome.AGENT_FLOODED,
                    f"the agent floods link {link!r}: more than is recorded of a link (docs/streams.md)",
                )
            if now.ns >= self._next_frame_ns:
                self._capture_frame(now)
            if self._further_cameras.due(now):
                scene.advance(now)
                self._further_cameras.capture(vehicle, scene, now)
            self._write_due(now)

    def _write_due(self, now: SimTime) -> None:
        self._truth.write_due(now, self._parts.vehicle, self._parts.scene)

    def _capture_frame(self, now: SimTime) -> None:
        # One frame a step at most: a camera that is faster than the controller has the controller's rate.
        vehicle, scene = self._parts.vehicle, self._parts.scene
        self._next_frame_ns += self._frame_period_ns
        scene.advance(now)
        frame = scene.observe(vehicle.truth(), self._frame)
        self._frame += 1
        self._truth.write_frame(frame)
        picture = None
        if self._pictures.wanted:
            picture = self._pictures.capture_with_pose(vehicle, scene, frame.number, now)
        if self._carries_camera is not None:
            self._carries_camera.record_exposure(frame.number, now)
        self.information.record_exposure(now)
        self._detector.process(frame, picture)
