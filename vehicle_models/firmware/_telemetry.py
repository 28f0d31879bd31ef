"""What the bench reads of the autopilot's own MAVLink: its estimate, mode, and version."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

from bench.contracts import Vector

from ..controller.links._frames import Packer, message_id, sender
from ..controller.state._flight_state import Cause

_HEARTBEAT, _SYSTEM_TIME, _ATTITUDE, _GLOBAL_POSITION_INT = 0, 2, 30, 33
_COMMAND_LONG, _COMMAND_ACK, _AUTOPILOT_VERSION = 76, 77, 148
_PARAM_VALUE, _PARAM_SET, _REAL32 = 22, 23, 9
_SET_MESSAGE_INTERVAL, _REQUEST_MESSAGE = 511, 512
_AUTOPILOT_COMPONENT = 1
_ARMED = 0x80
_STATUSTEXT, _MAV_STATE_CRITICAL, _MAV_STATE_FLIGHT_TERMINATION = 253, 5, 8
# How ArduCopter's texts begin when a failsafe acts (the first three observed with 4.6.3, the last read in its source);
# followed by "Cleared" where it ends. PX4's texts name no cause.
_FAILSAFE_TEXTS = {
    "GCS Failsafe": Cause.GROUND_STATION,
    "Battery Failsafe": Cause.BATTERY,
    "Radio Failsafe": Cause.RADIO,
    "EKF Failsafe": Cause.POSITION,
}
_UNKNOWN_CAUSE = "unknown"
_LAYOUTS = {
    _HEARTBEAT: struct.Struct("<IBBBBB"),
    _SYSTEM_TIME: struct.Struct("<QI"),
    _ATTITUDE: struct.Struct("<I6f"),
    _GLOBAL_POSITION_INT: struct.Struct("<IiiiihhhH"),
    _COMMAND_ACK: struct.Struct("<HBBiBB"),
    _AUTOPILOT_VERSION: struct.Struct("<QQIIIIHH8s8s8s"),
    _PARAM_VALUE: struct.Struct("<fHH16sB"),
    _STATUSTEXT: struct.Struct("<B50s"),
}
# The bench as a client: not 255, which both autopilots take for the ground station.
_SYSTEM, _COMPONENT = 254, 191


@dataclass(slots=True)
class Telemetry:
    """The last values heard, None or 0 until the autopilot has said something."""

    custom_mode: int = 0
    armed: bool = False
    terminated: bool = False
    clock_s: float = 0.0
    """Of the autopilot, since its start."""
    system: int = 1
    latitude_e7: int | None = None
    longitude_e7: int = 0
    altitude_m: float = 0.0
    velocity_ned_mps: Vector = (0.0, 0.0, 0.0)
    attitude_rad: Vector | None = None
    rates_radps: Vector = (0.0, 0.0, 0.0)
    version: str = ""
    heartbeats: int = 0
    parameters: dict[str, float] = field(default_factory=dict)
    results: dict[int, int] = field(default_factory=dict)
    """MAV_RESULT of the bench's own commands, by their numbers."""
    _packer: Packer = field(default_factory=lambda: Packer(_SYSTEM, _COMPONENT))
    _sequence: int = 0
    _critical: bool = False
    _cause: str = ""

    def take(self, frames: Sequence[bytes]) -> None:
        """Read what the autopilot says of itself; other messages are passed over."""
        for frame in frames:
            number = message_id(frame)
            layout = _LAYOUTS.get(number)
            if layout is None or frame[0] != 0xFD or sender(frame)[1] != _AUTOPILOT_COMPONENT:
                continue
            values = layout.unpack(frame[10 : 10 + frame[1]][: layout.size].ljust(layout.size, b"\0"))
            if number == _HEARTBEAT:
                self.custom_mode, self.armed = values[0], bool(values[3] & _ARMED)
                self._critical = values[4] == _MAV_STATE_CRITICAL
                self.terminated = values[4] == _MAV_STATE_FLIGHT_TERMINATION
                self.system = sender(frame)[0]
                self.heartbeats += 1
            elif number == _SYSTEM_TIME:
                self.clock_s = values[1] / 1000.0
            elif number == _COMMAND_ACK:
                if values[4:] == (_SYSTEM, _COMPONENT):
                    self.results[values[0]] = values[1]
            elif number == _ATTITUDE:
                self.clock_s = values[0] / 1000.0
                self.attitude_rad, self.rates_radps = values[1:4], values[4:7]
            elif number == _GLOBAL_POSITION_INT:
                self.latitude_e7, self.longitude_e7 = values[1], values[2]
                self.altitude_m = values[3] / 1000.0
                self.velocity_ned_mps = (values[5] / 100.0, values[6] / 100.0, values[7] / 100.0)
            elif number == _STATUSTEXT:
                self._note_text(values[1].rstrip(b"\0").decode("ascii", "replace"))
            elif number == _PARAM_VALUE:
                self.parameters[values[3].rstrip(b"\0").decode("ascii", "replace")] = values[0]
            else:
                self.version = _version_text(values[2], values[8])

    @property
    def failsafe(self) -> str:
        """Why a failsafe acts, as far as the autopilot tells; empty where its heartbeat says that none does."""
        if not (self._critical and self.armed):
            return ""
        return self._cause or _UNKNOWN_CAUSE

    def _note_text(self, text: str) -> None:
        for beginning, cause in _FAILSAFE_TEXTS.items():
            if text.startswith(beginning):
                self._cause = "" if "Cleared" in text else cause

    def requests(self, rate_hz: float | None) -> list[bytes]:
        """Commands that ask for the version, and for the estimate at `rate_hz` where one is given."""
        commands = [(_REQUEST_MESSAGE, float(_AUTOPILOT_VERSION), 0.0)]
        if rate_hz is not None:
            commands += [
                (_SET_MESSAGE_INTERVAL, float(number), 1e6 / rate_hz)
                for number in (_ATTITUDE, _GLOBAL_POSITION_INT)
            ]
        return [self.command(*command) for command in commands]

    def clock_requests(self) -> list[bytes]:
        """Commands that ask for the clock, and for the state of the vehicle."""
        return [self.command(_REQUEST_MESSAGE, float(number), 0.0) for number in (_SYSTEM_TIME, _HEARTBEAT)]

    def parameter(self, name: str, value: float) -> bytes:
        """PARAM_SET of a parameter that is a float: all of ArduPilot are, on MAVLink."""
        values = (value, self.system, _AUTOPILOT_COMPONENT, name.encode(), _REAL32)
        return self._packed(_PARAM_SET, values)

    def command(self, number: int, first: float, second: float) -> bytes:
        """COMMAND_LONG with its first two parameters."""
        values = (first, second, 0.0, 0.0, 0.0, 0.0, 0.0, number, self.system, _AUTOPILOT_COMPONENT, 0)
        return self._packed(_COMMAND_LONG, values)

    def _packed(self, number: int, values: tuple[object, ...]) -> bytes:
        frame = self._packer.pack(number, self._sequence, values)
        self._sequence = (self._sequence + 1) & 0xFF
        return frame


# FIRMWARE_VERSION_TYPE by its least value.
_TYPES = ((255, ""), (192, "rc"), (128, "beta"), (64, "alpha"), (0, "dev"))


def _version_text(packed: int, commit: bytes) -> str:
    """AUTOPILOT_VERSION in words: major, minor, patch and type in four bytes, then the first bytes of the commit."""
    major, minor, patch, kind = packed.to_bytes(4, "big")
    number = f"{major}.{minor}.{patch}{next(text for least, text in _TYPES if kind >= least)}"
    if not any(commit):
        return number
    # ArduPilot sends the text of the commit, PX4 its number with the last byte first.
    is_text = all(chr(byte).isalnum() and byte < 128 for byte in commit.rstrip(b"\0"))
    return f"{number} ({commit.rstrip(bytes(1)).decode() if is_text else commit[::-1].hex()})"
