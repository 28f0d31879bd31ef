"""A camera on the vehicle's links, a component of its own: what it is, and pictures taken when they are asked for.

A picture is the next frame that the scene exposes; CAMERA_IMAGE_CAPTURED says which in its `file_url`. There are no
pixels, so there is no storage, no video and no stream of one, and the camera says so.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

from bench.simspec import Camera as CameraSpec

from .._service import Result, Sender
from .._service_context import ServiceContext
from ..links._frames import Packer, wire_values
from ..links._radio import Channel
from ..telemetry._telemetry import quaternion
from ._gimbal import DEVICE, level_quaternion

COMPONENT = 100
REQUEST_MESSAGE = 512
START_CAPTURE, STOP_CAPTURE = 2000, 2001
SET_MODE, RESET_SETTINGS = 530, 529
REFUSED = (526, 531, 532, 2500, 2501, 2502, 2503)  # storage, zoom, focus, video: known, and not to be had
_OLD_REQUESTS = {521: 259, 522: 260, 525: 261, 527: 262}
_TAKES_IMAGES = 2
_KEPT = 1000  # pictures that can still be asked for
_SENSOR_WIDTH_MM = 6.4  # of a 1/2" sensor; only its ratio to the focal length means anything here
_SECOND_NS = 1_000_000_000


@dataclass(slots=True)
class _Series:
    """Pictures still to be taken: how many (None: until stopped), how far apart, when the next is due."""

    left: int | None
    interval_ns: int
    due_ns: int | None = None  # at once


class CameraComponent:
    """Answers commands for component 100, acknowledges them itself, and beats once a second."""

    def __init__(self, board: ServiceContext, spec: CameraSpec, system: int) -> None:
        self._board = board
        self._spec = spec
        self._packer = Packer(system, COMPONENT)
        self._sequences = {channel.name: 0 for channel in board.radio.channels}
        self._beat_ns = _SECOND_NS
        self._series: _Series | None = None
        self._wanted = False  # a picture beside those of the series
        self._apart_m: float | None = None
        self._taken_at = (0.0, 0.0)
        self._last_sequence = 0  # of single pictures, so that a repeated command takes none twice
        self._count = 0
        self._images: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._messages = {
            259: ("CAMERA_INFORMATION", self._information),
            260: ("CAMERA_SETTINGS", self._settings),
            261: ("STORAGE_INFORMATION", self._storage),
            262: ("CAMERA_CAPTURE_STATUS", self._capture_status),
        }

    def takes(self, message: Any, system: int) -> bool:
        """Whether a message is for this component alone."""
        return getattr(message, "target_component", 0) == COMPONENT and message.target_system in (0, system)

    def hear(self, message: Any, sender: Sender) -> None:
        """A message for this component; anything but a command has no meaning to it."""
        if message.get_type() not in ("COMMAND_LONG", "COMMAND_INT"):
            return
        result = self._run(message, sender)
        fields = {"command": message.command, "result": result}
        self._tell(sender.channel, "COMMAND_ACK", **fields, target_system=sender.system, target_component=sender.component)

    def tick(self) -> None:
        flight = self._board.flight
        if flight.time_ns >= self._beat_ns:
            self._beat_ns += _SECOND_NS
            self._broadcast("HEARTBEAT", type=30, autopilot=8, system_status=4, mavlink_version=3)
        if self._apart_m is not None and math.dist(self._place(), self._taken_at) >= self._apart_m:
            self._taken_at = self._place()
            self.shoot()

    def record_exposure(self, frame: int) -> None:
        """The scene has exposed a frame: a picture, when one is due."""
        series, now = self._series, self._board.flight.time_ns
        due = series is not None and (series.due_ns is None or now >= series.due_ns)
        if series is not None and due:
            series.due_ns = (now if series.due_ns is None else series.due_ns) + series.interval_ns
            if series.left is not None:
                series.left -= 1
                if series.left <= 0:
                    self._series = None
        elif not self._wanted:
            return
        self._wanted = False  # one frame serves all who wait for one
        image = self._image(frame)
        self._images.append(image)
        self._count += 1
        self._broadcast("CAMERA_IMAGE_CAPTURED", **image)
        if due and self._series is None:
            self._broadcast("CAMERA_CAPTURE_STATUS", **self._capture_status())

    def _run(self, m: Any, sender: Sender) -> Result:
        number = m.command
        if number == REQUEST_MESSAGE or number in _OLD_REQUESTS:
            return self._request(_OLD_REQUESTS.get(number, m.param1), m.param2, sender.channel)
        if number == START_CAPTURE:
            return self.start(m.param2, m.param3, m.param4)
        if number == STOP_CAPTURE:
            self.stop()
            return Result.ACCEPTED
        if number == SET_MODE:
            return Result.ACCEPTED if m.param2 == 0 else Result.DENIED  # pictures are the one mode
        if number == RESET_SETTINGS:
            return Result.ACCEPTED
        return Result.DENIED if number in REFUSED else Result.UNSUPPORTED

    def _request(self, number: float, index: float, channel: Channel) -> Result:
        if number == 263:
            found = [one for one in self._images if one["image_index"] == index]
            if not found:
                return Result.DENIED
            self._tell(channel, "CAMERA_IMAGE_CAPTURED", **found[0])
            return Result.ACCEPTED
        if number not in self._messages:
            return Result.UNSUPPORTED
        name, fields = self._messages[int(number)]
        self._tell(channel, name, **fields())
        return Result.ACCEPTED

    def stop(self) -> None:
        """End a series of pictures."""
        self._series = None
        self._broadcast("CAMERA_CAPTURE_STATUS", **self._capture_status())

    def shoot(self) -> None:
        """One picture more, beside any series."""
        self._wanted = True

    def every(self, distance_m: float) -> None:
        """A picture each so many metres from here on; 0 for no more."""
        self._apart_m = distance_m if 0.0 < distance_m < math.inf else None
        self._taken_at = self._place()

    def _place(self) -> tuple[float, float]:
        return self._board.flight.north_m, self._board.flight.east_m

    def start(self, interval_s: float, count: float, sequence: float) -> Result:
        """So many pictures (0: until stopped), so far apart; a single one is taken once for each `sequence` above 0."""
        if not (0.0 <= interval_s <= 3600.0 and 0 <= count < 2**24):
            return Result.DENIED
        if count == 1 and sequence > 0 and sequence == self._last_sequence:
            return Result.ACCEPTED
        if self._series is not None:
            return Result.TEMPORARILY_REJECTED
        if count == 1:
            self._last_sequence = int(sequence) if 0 < sequence < 2**24 else 0
        self._series = _Series(int(count) or None, round(interval_s * 1e9))
        self._broadcast("CAMERA_CAPTURE_STATUS", **self._capture_status())
        return Result.ACCEPTED

    def _image(self, frame: int) -> dict[str, Any]:
        """CAMERA_IMAGE_CAPTURED of the present moment: where the vehicle believes to be, and where the camera looks."""
        flight, spec = self._board.flight, self._spec
        if flight.camera_tilt_rad is not None:
            attitude = level_quaternion(-flight.camera_tilt_rad, flight.yaw_rad + (flight.camera_pan_rad or 0.0))
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

    def _information(self) -> dict[str, Any]:
        spec = self._spec
        focal_mm = _SENSOR_WIDTH_MM / 2.0 / math.tan(math.radians(spec.horizontal_fov_deg) / 2.0)
        return {
            "time_boot_ms": self._board.flight.time_ms,
            "vendor_name": list(b"REBAR"),
            "model_name": list(spec.name.encode()[:31]),
            "firmware_version": 1,
            "focal_length": focal_mm,
            "sensor_size_h": _SENSOR_WIDTH_MM,
            "sensor_size_v": _SENSOR_WIDTH_MM * spec.height_px / spec.width_px,
            "resolution_h": spec.width_px,
            "resolution_v": spec.height_px,
            "flags": _TAKES_IMAGES,
            "gimbal_device_id": DEVICE if spec.gimbal else 0,
        }

    def _settings(self) -> dict[str, Any]:
        return {"time_boot_ms": self._board.flight.time_ms, "mode_id": 0, "zoomLevel": math.nan, "focusLevel": math.nan}

    def _storage(self) -> dict[str, Any]:
        """No storage: status 3, not supported."""
        return {"time_boot_ms": self._board.flight.time_ms, "storage_id": 0, "storage_count": 0, "status": 3}

    def _capture_status(self) -> dict[str, Any]:
        series = self._series
        repeats = series is not None and series.left != 1
        return {
            "time_boot_ms": self._board.flight.time_ms,
            "image_status": 0 if series is None else 2 if repeats else 1,
            "image_interval": series.interval_ns * 1e-9 if series is not None and repeats else 0.0,
            "image_count": self._count,
        }

    def _tell(self, channel: Channel, name: str, **fields: Any) -> None:
        sequence = self._sequences[channel.name]
        self._sequences[channel.name] = (sequence + 1) & 0xFF
        number, values = wire_values(name, **fields)
        channel.forward(self._packer.pack(number, sequence, values))

    def _broadcast(self, name: str, **fields: Any) -> None:
        for channel in self._board.radio.channels:
            if channel.connected:
                self._tell(channel, name, **fields)


def _pitched(body: tuple[float, float, float, float], pitch_rad: float) -> tuple[float, float, float, float]:
    """An attitude, then a pitch about its own right axis."""
    w, x, y, z = body
    c, s = math.cos(pitch_rad / 2.0), math.sin(pitch_rad / 2.0)
    return (w * c - y * s, x * c - z * s, w * s + y * c, x * s + z * c)
