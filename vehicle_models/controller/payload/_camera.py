"""A camera on the vehicle's links, a component of its own: its properties, and pictures on command.

A picture is the next frame that the scene exposes; CAMERA_IMAGE_CAPTURED names it in its `file_url`. There
are no pixels, so there is no storage and no video, as the camera reports.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

from bench.simspec import Camera as CameraSpec

from ..links._enums import MAV_AUTOPILOT, MAV_CMD, MAV_STATE, MAV_TYPE
from ..links._frames import MESSAGE_NAMES, Packer, wire_values
from ..links._radio import Channel
from ..state._flight_state import NorthEast
from ..state._service import CommandResult, Fields, MessageSender
from ..state._service_context import ServiceContext
from ..telemetry._attitude import quaternion
from ._gimbal import DEVICE, level_quaternion

# MAV_COMP_ID_CAMERA
COMPONENT = 100
# Storage, zoom, focus and video: known to cameras, and denied by this one.
_DENIED = (
    MAV_CMD.STORAGE_FORMAT,
    MAV_CMD.SET_CAMERA_ZOOM,
    MAV_CMD.SET_CAMERA_FOCUS,
    MAV_CMD.VIDEO_START_CAPTURE,
    MAV_CMD.VIDEO_STOP_CAPTURE,
    MAV_CMD.VIDEO_START_STREAMING,
    MAV_CMD.VIDEO_STOP_STREAMING,
)
# The commands that were replaced by MAV_CMD_REQUEST_MESSAGE, and the messages that they request.
_OLD_REQUESTS: dict[int, str] = {
    MAV_CMD.REQUEST_CAMERA_INFORMATION: "CAMERA_INFORMATION",
    MAV_CMD.REQUEST_CAMERA_SETTINGS: "CAMERA_SETTINGS",
    MAV_CMD.REQUEST_STORAGE_INFORMATION: "STORAGE_INFORMATION",
    MAV_CMD.REQUEST_CAMERA_CAPTURE_STATUS: "CAMERA_CAPTURE_STATUS",
}
# CAMERA_CAP_FLAGS
_CAPTURES_IMAGES = 2
_IMAGE_MODE = 0
# Pictures that can still be requested.
_STORED = 1000
# Single pictures that may wait for their frames. Chosen, not measured.
_MAX_REQUESTED = 100
# STORAGE_STATUS_NOT_SUPPORTED
_NO_STORAGE = 3
_MAX_INTERVAL_S = 3600.0
# Of a 1/2" sensor; only its ratio to the focal length means anything here.
_SENSOR_WIDTH_MM = 6.4
_SECOND_NS = 1_000_000_000


@dataclass(slots=True)
class _Series:
    """Pictures still to be taken: how many (None: until stopped), their interval, when the next is due."""

    remaining: int | None
    interval_ns: int
    due_ns: int | None = None  # at once


class CameraComponent:
    """Answers commands for component 100, acknowledges them itself, and beats once a second."""

    def __init__(self, context: ServiceContext, spec: CameraSpec, system: int) -> None:
        self._context = context
        self._spec = spec
        self._packer = Packer(system, COMPONENT)
        self._sequences = {channel.name: 0 for channel in context.radio.channels}
        self._beat_ns = _SECOND_NS
        self._series: _Series | None = None
        self._triggered = False  # by distance or by a mission: a picture beside those of the series
        self._requested = 0  # single pictures still to be taken, each from a frame of its own
        self._distance_m: float | None = None
        self._last_place: NorthEast = (0.0, 0.0)
        self._last_sequence = 0  # of single pictures, so that a repeated command takes none twice
        self._count = 0
        self._images: deque[Fields] = deque(maxlen=_STORED)
        self._messages = {
            "CAMERA_INFORMATION": self._information,
            "CAMERA_SETTINGS": lambda: self._timed(mode_id=0, zoomLevel=math.nan, focusLevel=math.nan),
            "STORAGE_INFORMATION": lambda: self._timed(storage_id=0, storage_count=0, status=_NO_STORAGE),
            "CAMERA_CAPTURE_STATUS": self._capture_status,
        }

    def is_addressed(self, message: Any, system: int) -> bool:
        """Whether a message is for this component alone."""
        return getattr(message, "target_component", 0) == COMPONENT and message.target_system in (0, system)

    def handle(self, message: Any, sender: MessageSender) -> None:
        """Take a message for this component; anything but a command is ignored."""
        if message.get_type() not in ("COMMAND_LONG", "COMMAND_INT"):
            return
        fields = {"command": message.command, "result": self._run(message, sender)}
        asker = {"target_system": sender.system, "target_component": sender.component}
        self._send(sender.channel, "COMMAND_ACK", **fields, **asker)

    def tick(self) -> None:
        flight = self._context.flight
        if flight.time_ns >= self._beat_ns:
            self._beat_ns += _SECOND_NS
            self._broadcast(
                "HEARTBEAT",
                type=MAV_TYPE.CAMERA,
                autopilot=MAV_AUTOPILOT.INVALID,
                system_status=MAV_STATE.ACTIVE,
                mavlink_version=3,
            )
        if self._distance_m is not None and math.dist(self._place(), self._last_place) >= self._distance_m:
            self._last_place = self._place()
            self.shoot()

    def record_exposure(self, frame: int) -> None:
        """The scene has exposed a frame: a picture, when one is due."""
        series, now = self._series, self._context.flight.time_ns
        due = series is not None and (series.due_ns is None or now >= series.due_ns)
        if series is not None and due:
            series.due_ns = (now if series.due_ns is None else series.due_ns) + series.interval_ns
            if series.remaining is not None:
                series.remaining -= 1
                if series.remaining <= 0:
                    self._series = None
        elif not (self._triggered or self._requested):
            return
        # One frame serves a series, a trigger and one request.
        last_requested = self._requested == 1
        self._triggered, self._requested = False, max(self._requested - 1, 0)
        image = self._image(frame)
        self._images.append(image)
        self._count += 1
        self._broadcast("CAMERA_IMAGE_CAPTURED", **image)
        if (due or last_requested) and self._series is None and not self._requested:
            self._broadcast("CAMERA_CAPTURE_STATUS", **self._capture_status())

    def _run(self, m: Any, sender: MessageSender) -> CommandResult:
        number = m.command
        if number in _OLD_REQUESTS:
            return self._request(_OLD_REQUESTS[number], m.param2, sender.channel)
        if number == MAV_CMD.REQUEST_MESSAGE:
            return self._request(MESSAGE_NAMES.get(m.param1, ""), m.param2, sender.channel)
        if number == MAV_CMD.IMAGE_START_CAPTURE:
            return self.start(m.param2, m.param3, m.param4)
        if number == MAV_CMD.IMAGE_STOP_CAPTURE:
            self.stop()
            return CommandResult.ACCEPTED
        if number == MAV_CMD.SET_CAMERA_MODE:
            return CommandResult.ACCEPTED if m.param2 == _IMAGE_MODE else CommandResult.DENIED
        if number == MAV_CMD.RESET_CAMERA_SETTINGS:
            return CommandResult.ACCEPTED
        return CommandResult.DENIED if number in _DENIED else CommandResult.UNSUPPORTED

    def _request(self, name: str, index: float, channel: Channel) -> CommandResult:
        if name == "CAMERA_IMAGE_CAPTURED":
            image = next((image for image in self._images if image["image_index"] == index), None)
            if image is None:
                return CommandResult.DENIED
            self._send(channel, name, **image)
            return CommandResult.ACCEPTED
        if name not in self._messages:
            return CommandResult.UNSUPPORTED
        self._send(channel, name, **self._messages[name]())
        return CommandResult.ACCEPTED

    def stop(self) -> None:
        """End a series of pictures."""
        self._series = None
        self._broadcast("CAMERA_CAPTURE_STATUS", **self._capture_status())

    def shoot(self) -> None:
        """Take one more picture, beside any series."""
        self._triggered = True

    def every(self, distance_m: float) -> None:
        """Take a picture every so many metres from here on; 0 ends that."""
        self._distance_m = distance_m if 0.0 < distance_m < math.inf else None
        self._last_place = self._place()

    def _place(self) -> NorthEast:
        return self._context.flight.north_m, self._context.flight.east_m

    def start(self, interval_s: float, count: float, sequence: float) -> CommandResult:
        """Take `count` pictures (0: until stopped) at an interval, or one more picture beside those; once for each
        `sequence` above 0.

        A picture that is asked for while another is due takes the frame behind it, as ArduPilot's camera takes one after
        the other (source). A second series is rejected for the time being, as by the camera of PX4's Gazebo (source).
        """
        if not (0.0 <= interval_s <= _MAX_INTERVAL_S and 0 <= count < 2**24):
            return CommandResult.DENIED
        # A command is repeated when its acknowledgement was lost: the number keeps that from two pictures.
        if count == 1 and sequence > 0 and sequence == self._last_sequence:
            return CommandResult.ACCEPTED
        if count == 1:
            if self._requested >= _MAX_REQUESTED:
                return CommandResult.TEMPORARILY_REJECTED
            self._last_sequence = int(sequence) if 0 < sequence < 2**24 else 0
            self._requested += 1
        elif self._series is None:
            self._series = _Series(int(count) or None, round(interval_s * 1e9))
        else:
            return CommandResult.TEMPORARILY_REJECTED
        self._broadcast("CAMERA_CAPTURE_STATUS", **self._capture_status())
        return CommandResult.ACCEPTED

    def _image(self, frame: int) -> Fields:
        """CAMERA_IMAGE_CAPTURED: the estimated position, and the direction of the camera."""
        flight, spec = self._context.flight, self._spec
        if flight.camera_tilt_rad is not None:
            pan_rad = flight.camera_pan_rad or 0.0
            attitude = level_quaternion(-flight.camera_tilt_rad, flight.yaw_rad + pan_rad)
        elif spec.stabilized:
            attitude = level_quaternion(-math.radians(spec.tilt_deg), flight.yaw_rad)
        else:
            attitude = _pitched(quaternion(flight), -math.radians(spec.tilt_deg))
        return {
            "time_boot_ms": flight.time_ms,
            "time_utc": flight.unix_start_us + flight.time_us,
            "lat": flight.latitude_e7,
            "lon": flight.longitude_e7,
            "alt": round(flight.altitude_m * 1000.0),
            "relative_alt": round(flight.height_m * 1000.0),
            "q": attitude,
            "image_index": self._count,
            "camera_id": 0,
            "capture_result": 1,
            "file_url": f"rebar:frame/{frame}".encode(),
        }

    def _information(self) -> Fields:
        spec = self._spec
        focal_mm = _SENSOR_WIDTH_MM / 2.0 / math.tan(math.radians(spec.horizontal_fov_deg) / 2.0)
        return {
            "time_boot_ms": self._context.flight.time_ms,
            "vendor_name": list(b"REBAR"),
            "model_name": list(spec.name.encode()[:31]),
            "firmware_version": 1,
            "focal_length": focal_mm,
            "sensor_size_h": _SENSOR_WIDTH_MM,
            "sensor_size_v": _SENSOR_WIDTH_MM * spec.height_px / spec.width_px,
            "resolution_h": spec.width_px,
            "resolution_v": spec.height_px,
            "flags": _CAPTURES_IMAGES,
            "gimbal_device_id": DEVICE if spec.gimbal else 0,
        }

    def _timed(self, **fields: Any) -> Fields:
        return {"time_boot_ms": self._context.flight.time_ms, **fields}

    def _capture_status(self) -> Fields:
        series = self._series
        repeats = series is not None and series.remaining != 1
        # Bit 0: a picture is being taken; bit 1: an interval is set.
        taking = self._requested > 0 or (series is not None and not repeats)
        return {
            "time_boot_ms": self._context.flight.time_ms,
            "image_status": taking | repeats << 1,
            "image_interval": series.interval_ns * 1e-9 if series is not None and repeats else 0.0,
            "image_count": self._count,
        }

    def _send(self, channel: Channel, name: str, **fields: Any) -> None:
        sequence = self._sequences[channel.name]
        self._sequences[channel.name] = (sequence + 1) & 0xFF
        number, values = wire_values(name, **fields)
        channel.forward(self._packer.pack(number, sequence, values))

    def _broadcast(self, name: str, **fields: Any) -> None:
        for channel in self._context.radio.channels:
            if channel.connected:
                self._send(channel, name, **fields)


def _pitched(body: tuple[float, float, float, float], pitch_rad: float) -> tuple[float, float, float, float]:
    """An attitude, then a pitch about its own right axis."""
    w, x, y, z = body
    c, s = math.cos(pitch_rad / 2.0), math.sin(pitch_rad / 2.0)
    return (w * c - y * s, x * c - z * s, w * s + y * c, x * s + z * c)
