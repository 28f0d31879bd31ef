"""Vehicle, scene, cameras and operator of a session: what they say at a moment, and how they come to the next."""

from __future__ import annotations

from bench.contracts import (
    DETECTOR_OPENED,
    FIRMWARE_BOOTED,
    FirmwareBuild,
    Outcome,
    PixelDetectorBuild,
    SimTime,
    fact_of,
)

from ._mission_information import MissionInformation
from ._session_cameras import SessionCameras
from ._session_parts import SessionParts
from ._stop_session import StopSession


class World:
    """The side of a session that is not its agent's. All of it reaches the recording."""

    def __init__(self, parts: SessionParts) -> None:
        spec = parts.plan.simspec
        self._parts, self._progress, self._truth = parts, parts.progress, parts.truth
        self.information = MissionInformation(spec, parts.air, parts.scene)
        self._cameras = SessionCameras(
            spec, parts.air, parts.detectors, parts.truth, parts.plan.open_renderer
        )

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
        self.information.publish(now, self._parts.vehicle)
        self._cameras.publish(now)
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
            self._cameras.capture(vehicle, scene, now)
            self._write_due(now)

    def _write_due(self, now: SimTime) -> None:
        self._truth.write_due(now, self._parts.vehicle, self._parts.scene)
