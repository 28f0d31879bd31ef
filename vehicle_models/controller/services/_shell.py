"""PX4's shell over SERIAL_CONTROL: `ver all`, `param show`, `listener` of the main topics."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

from ..links._radio import Channel
from ..policies._identity import IdentityPolicy
from ..state._parameter_store import REAL32
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ..telemetry._attitude import quaternion

# SERIAL_CONTROL_DEV, SERIAL_CONTROL_FLAG
_DEVICE_SHELL, _REPLY = 10, 1
_CHUNK_BYTES = 70
# A list of all parameters takes some three seconds, and leaves room for telemetry on the link.
_CHUNKS_PER_STEP = 4
_MAX_LINE_BYTES = 256
_PROMPT = "pxh> "
# vehicle_status.arming_state
_DISARMED, _ARMED = 1, 2
_LOCAL_FIELDS = ("x", "y", "z", "vx", "vy", "vz", "heading")


@dataclass(eq=False)
class Shell:
    """Echoes each line, answers it and prompts for the next, to the client that wrote last."""

    _context: ServiceContext
    _policy: IdentityPolicy
    _line: bytes = b""
    _output: deque[bytes] = field(default_factory=deque)
    _channel: Channel | None = None

    def __post_init__(self) -> None:
        self._programs: dict[str, Callable[[list[str]], list[str]]] = {
            "help": self._help,
            "listener": self._listener,
            "param": self._param,
            "ver": self._ver,
        }

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"SERIAL_CONTROL": self._take_input} if self._policy.has_shell else {}

    def tick(self) -> None:
        if not self._output:
            return
        for _ in range(min(_CHUNKS_PER_STEP, len(self._output))):
            chunk = self._output.popleft()
            assert self._channel
            self._channel.send_message(
                "SERIAL_CONTROL",
                device=_DEVICE_SHELL,
                flags=_REPLY,
                timeout=0,
                baudrate=0,
                count=len(chunk),
                data=[*chunk, *bytes(_CHUNK_BYTES - len(chunk))],
            )

    def _take_input(self, m: Any, sender: MessageSender) -> None:
        if m.device != _DEVICE_SHELL or m.flags & _REPLY:
            return
        self._channel = sender.channel
        *lines, rest = (self._line + bytes(m.data[: m.count])).replace(b"\r", b"").split(b"\n")
        # What does not fit is lost, as in any terminal.
        self._line = rest[-_MAX_LINE_BYTES:]
        for line in lines:
            text = line.decode("ascii", "replace").strip()
            self._write("\n".join([text, *self._run(text.split()), _PROMPT]))

    def _write(self, text: str) -> None:
        data = text.encode("ascii", "replace")
        self._output.extend(data[start : start + _CHUNK_BYTES] for start in range(0, len(data), _CHUNK_BYTES))

    def _run(self, words: list[str]) -> list[str]:
        if not words:
            return []
        program = self._programs.get(words[0])
        if program is None:
            return [f"Invalid command: {words[0]}", "type 'help' for a list of commands"]
        return program(words[1:])

    def _help(self, words: list[str]) -> list[str]:
        return ["Available commands:", *(f"  {name}" for name in self._programs)]

    def _ver(self, words: list[str]) -> list[str]:
        version = self._policy.flight_sw_version
        numbers = ".".join(str(version >> shift & 0xFF) for shift in (24, 16, 8))
        entries = {
            "hwtypecmp": [],
            "hw": ["HW arch: PX4_SITL"],
            "git": [f"PX4 git-hash: {self._policy.flight_custom_version.hex()}"],
            "px4": [f"PX4 version: {numbers} 0 ({version})"],
            "os": ["OS: Linux"],
        }
        if words == ["all"]:
            return [line for lines in entries.values() for line in lines]
        if len(words) == 1 and words[0] in entries:
            return entries[words[0]]
        return ["usage: ver {all|hw|git|px4|os}"]

    def _param(self, words: list[str]) -> list[str]:
        store = self._context.parameters
        if not words or words[0] != "show" or len(words) > 2:
            return ["usage: param show [NAME]"]
        pattern = words[1] if len(words) == 2 else "*"
        changed = store.changed()
        lines = [
            f"x {'+' if name in changed else ' '} {name} [{index},{index}] : {self._shown(name)}"
            for index, name in enumerate(store.names)
            if fnmatchcase(name, pattern)
        ]
        counts = f" {len(lines)}/{len(store.names)} parameters used."
        return ["Symbols: x = used, + = saved, * = unsaved", *lines, "", counts]

    def _shown(self, name: str) -> str:
        value = self._context.parameters[name]
        return f"{value:.4f}" if self._context.parameters.kinds[name] == REAL32 else str(int(value))

    def _listener(self, words: list[str]) -> list[str]:
        topics = self._topics()
        if not words or words[0] not in topics:
            return [f"usage: listener {{{'|'.join(topics)}}}"]
        # Options (how often, how many, which instance) change nothing: each topic has one instance, printed once.
        name = words[0]
        stamp = f"timestamp: {self._context.flight.time_us} (0.000000 seconds ago)"
        fields = [f"{field}: {value}" for field, value in topics[name].items()]
        return ["", f"TOPIC: {name}", f" {name}", *(f"    {line}" for line in (stamp, *fields))]

    def _topics(self) -> dict[str, dict[str, object]]:
        """Main topics as the vehicle estimates them, with some fields of each."""
        f = self._context.flight
        local = (f.north_m, f.east_m, f.down_m, f.vn_mps, f.ve_mps, f.vd_mps, f.yaw_rad)
        return {
            **self._position_topics(),
            "vehicle_angular_velocity": {"xyz": _array(f.p_radps, f.q_radps, f.r_radps)},
            "battery_status": {"voltage_v": f"{f.battery_v:.5f}", "remaining": f"{f.battery_fraction:.5f}"},
            "vehicle_attitude": {"q": _array(*quaternion(f))},
            "vehicle_global_position": _place(f.latitude_e7, f.longitude_e7, f.altitude_m),
            "vehicle_land_detected": {"landed": not f.flying},
            "vehicle_local_position": {
                name: f"{value:.5f}" for name, value in zip(_LOCAL_FIELDS, local, strict=True)
            },
            "vehicle_status": {
                "arming_state": _ARMED if f.armed else _DISARMED,
                "failsafe": f.failsafe is not None,
            },
        }

    def _position_topics(self) -> dict[str, dict[str, object]]:
        """Topics about places other than the vehicle's own estimate; home only once it is set."""
        f = self._context.flight
        latitude_e7, longitude_e7 = f.fix_e7
        fix: dict[str, object] = {
            "latitude_deg": f"{latitude_e7 * 1e-7:.7f}",
            "longitude_deg": f"{longitude_e7 * 1e-7:.7f}",
            "altitude_msl_m": f"{f.fix_altitude_m:.5f}",
        }
        topics = {"sensor_gps": fix, "vehicle_gps_position": fix}
        if f.home:
            topics["home_position"] = _place(f.home.latitude_e7, f.home.longitude_e7, f.home.altitude_m)
        return topics


def _place(latitude_e7: int, longitude_e7: int, altitude_m: float) -> dict[str, object]:
    degrees = {"lat": f"{latitude_e7 * 1e-7:.7f}", "lon": f"{longitude_e7 * 1e-7:.7f}"}
    return {**degrees, "alt": f"{altitude_m:.5f}"}


def _array(*values: float) -> str:
    return "[" + ", ".join(f"{value:.5f}" for value in values) + "]"
