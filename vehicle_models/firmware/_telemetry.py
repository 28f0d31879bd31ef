"""What the bench reads of the autopilot's own MAVLink: its estimate, mode, and version."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from bench.contracts import Vector

from ..controller.links._enums import MAV_CMD, MAV_STATE
from ..controller.links._frames import KINDS, Decoder, Packer, message_id, sender
from ..controller.state._flight_state import Cause

# What is read of the autopilot.
_HEARD = (
    *("HEARTBEAT", "SYSTEM_TIME", "ATTITUDE", "GLOBAL_POSITION_INT", "COMMAND_ACK", "AUTOPILOT_VERSION"),
    *("PARAM_VALUE", "STATUSTEXT"),
)
_NUMBERS = {name: KINDS[name].id for name in (*_HEARD, "COMMAND_LONG", "PARAM_SET")}
_HEARD_NUMBERS = frozenset(_NUMBERS[name] for name in _HEARD)
_REAL32, _AUTOPILOT_COMPONENT, _ARMED = 9, 1, 0x80
# How ArduCopter's texts begin when a failsafe acts (the first three observed with 4.6.3, the last read in its source);
# followed by "Cleared" where it ends. PX4's texts name no cause.
_FAILSAFE_TEXTS = {
    "GCS Failsafe": Cause.GROUND_STATION,
    "Battery Failsafe": Cause.BATTERY,
    "Radio Failsafe": Cause.RADIO,
    "EKF Failsafe": Cause.POSITION,
}
_UNKNOWN_CAUSE = "unknown"
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
    _decoder: Decoder = field(default_factory=Decoder)
    _packer: Packer = field(default_factory=lambda: Packer(_SYSTEM, _COMPONENT))
    _critical: bool = False
    _cause: str = ""

    def take(self, frames: Sequence[bytes]) -> None:
        """Read what the autopilot says of itself; other messages are passed over."""
        for frame in frames:
            heard = message_id(frame) in _HEARD_NUMBERS and frame[0] == 0xFD
            if not heard or sender(frame)[1] != _AUTOPILOT_COMPONENT:
                continue
            message = self._decoder.decode(frame)
            if message is not None:
                self._read(message, sender(frame)[0])

    def _read(self, m: Any, system: int) -> None:
        match m.get_type():
            case "HEARTBEAT":
                self.custom_mode, self.armed = m.custom_mode, bool(m.base_mode & _ARMED)
                self._critical = m.system_status == MAV_STATE.CRITICAL
                self.terminated = m.system_status == MAV_STATE.FLIGHT_TERMINATION
                self.system = system
                self.heartbeats += 1
            case "SYSTEM_TIME":
                self.clock_s = m.time_boot_ms / 1000.0
            case "COMMAND_ACK":
                if (m.target_system, m.target_component) == (_SYSTEM, _COMPONENT):
                    self.results[m.command] = m.result
            case "ATTITUDE":
                self.clock_s = m.time_boot_ms / 1000.0
                self.attitude_rad = (m.roll, m.pitch, m.yaw)
                self.rates_radps = (m.rollspeed, m.pitchspeed, m.yawspeed)
            case "GLOBAL_POSITION_INT":
                self.latitude_e7, self.longitude_e7 = m.lat, m.lon
                self.altitude_m = m.alt / 1000.0
                self.velocity_ned_mps = (m.vx / 100.0, m.vy / 100.0, m.vz / 100.0)
            case "STATUSTEXT":
                self._note_text(m.text)
            case "PARAM_VALUE":
                self.parameters[m.param_id] = m.param_value
            case "AUTOPILOT_VERSION":
                self.version = _version_text(m.flight_sw_version, bytes(m.flight_custom_version))

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
        commands = [(MAV_CMD.REQUEST_MESSAGE, float(_NUMBERS["AUTOPILOT_VERSION"]), 0.0)]
        if rate_hz is not None:
            commands += [
                (MAV_CMD.SET_MESSAGE_INTERVAL, float(_NUMBERS[name]), 1e6 / rate_hz)
                for name in ("ATTITUDE", "GLOBAL_POSITION_INT")
            ]
        return [self.command(*command) for command in commands]

    def clock_requests(self) -> list[bytes]:
        """Commands that ask for the clock, and for the state of the vehicle."""
        numbers = (_NUMBERS["SYSTEM_TIME"], _NUMBERS["HEARTBEAT"])
        return [self.command(MAV_CMD.REQUEST_MESSAGE, float(number), 0.0) for number in numbers]

    def parameter(self, name: str, value: float) -> bytes:
        """PARAM_SET of a parameter that is a float: all of ArduPilot are, on MAVLink."""
        values = (value, self.system, _AUTOPILOT_COMPONENT, name.encode(), _REAL32)
        return self._packer.pack_next(_NUMBERS["PARAM_SET"], values)

    def command(self, number: int, first: float, second: float) -> bytes:
        """COMMAND_LONG with its first two parameters."""
        values = (first, second, 0.0, 0.0, 0.0, 0.0, 0.0, number, self.system, _AUTOPILOT_COMPONENT, 0)
        return self._packer.pack_next(_NUMBERS["COMMAND_LONG"], values)


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
