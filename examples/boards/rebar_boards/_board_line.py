"""MAVLink with a board before and after the flight: it answers, restarts, and gets its parameters."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from bench.errors import Fault, FirmwareFault, SetupError
from vehicle_models.firmware import (
    MAV_CMD,
    Packer,
    SequenceReader,
    SerialDevice,
    message_id,
    parameter_text,
    payload_of,
    sender,
)

from ._real_time import LineClock

_HEARTBEAT, _PARAM_REQUEST_READ, PARAM_VALUE, PARAM_SET, _COMMAND_LONG = 0, 20, 22, 23, 76
_AUTOPILOT_COMPONENT, _MAV_AUTOPILOT_PX4 = 1, 12
_MAV_TYPE_GENERIC, _MAV_AUTOPILOT_INVALID, _MAV_STATE_ACTIVE = 0, 8, 4
_HIL_FLAG, _ARMED_FLAG = 0x20, 0x80
_REAL32, _INTEGER_KINDS = 9, frozenset(range(1, 7))
# Neither a ground station (255), whose loss is a failsafe, nor the vehicle.
_SYSTEM, _COMPONENT = 254, 191
_HEARTBEAT_EVERY_S = 1.0
_POLL_S = 0.005
# On a line that loses bytes a parser may wait for the rest of a frame of 280 bytes that never began: seven requests.
_PARAMETER_TRIES, _PARAMETER_ANSWER_S = 20, 0.25
# For all that is put back: a board that is dead would hold the session up for minutes.
_RESTORE_S = 10.0
# A board that restarts says nothing for some seconds; between two of its heartbeats there is one.
_SILENT_RESTART_S = 1.5
_READ_BYTES = 4096
_MOST_READS = 16
_VALUE = struct.Struct("<fHH16sB")
_BEAT = struct.Struct("<IBBBBB")


@dataclass(frozen=True, slots=True)
class BoardParameter:
    """A value as the board holds it. `kind` is its MAV_PARAM_TYPE."""

    value: float
    kind: int


@dataclass(slots=True)
class BoardState:
    """What the last heartbeat of the board's autopilot says."""

    heard_s: float | None = None
    system: int = 1
    autopilot: int = 0
    in_simulation: bool = False
    armed: bool = False
    parameters: dict[str, BoardParameter] = field(default_factory=dict)


class BoardLine:
    """One serial line with a PX4 board. `device_field` names the device in errors."""

    def __init__(self, device: SerialDevice, clock: LineClock, connect_s: float) -> None:
        self.device, self.clock = device, clock
        self.reader = SequenceReader()
        self.state = BoardState()
        self._connect_s = connect_s
        self._pack = Packer(_SYSTEM, _COMPONENT).pack_next
        self._next_beat_s = 0.0

    def read(self) -> list[bytes]:
        """Whole frames that have come. Raises OSError for nothing: a device that is away brings none."""
        frames: list[bytes] = []
        for _ in range(_MOST_READS):
            resets = self.device.resets
            data = self.device.read(_READ_BYTES)
            if self.device.resets > resets:
                self.reader.forget()
            if not data:
                break
            frames += self.reader.feed(data)
        for frame in frames:
            self._note(frame)
        return frames

    def beat(self) -> None:
        """Send a heartbeat once a second. PX4 starts MAVLink on USB when it hears one."""
        now_s = self.clock.now()
        if now_s >= self._next_beat_s:
            self._next_beat_s = now_s + _HEARTBEAT_EVERY_S
            values = (0, _MAV_TYPE_GENERIC, _MAV_AUTOPILOT_INVALID, 0, _MAV_STATE_ACTIVE, 3)
            self.device.send(self._pack(_HEARTBEAT, values))

    def connect(self) -> None:
        """Wait for PX4's heartbeat. Raises FirmwareFault with what came instead."""
        self.state.heard_s = None
        if not self._wait(lambda: self.state.heard_s is not None, self._connect_s):
            garbage, heard = self.reader.garbage_bytes, "nothing came"
            if garbage:
                heard = f"{garbage} bytes that are no MAVLink came: is the speed right?"
            raise FirmwareFault(
                f"no heartbeat of a flight controller on {self.device.path} within {self._connect_s:g} s; {heard}"
            )
        if self.state.autopilot != _MAV_AUTOPILOT_PX4:
            raise FirmwareFault(
                f"the board on {self.device.path} is no PX4 (MAV_AUTOPILOT {self.state.autopilot}); others have no "
                "hardware-in-the-loop mode that takes sensors from outside"
            )

    def restart(self) -> None:
        """Restart the board, so that its estimator begins anew where the vehicle stands. Raises FirmwareFault."""
        resets = self.device.resets
        self.command(MAV_CMD.PREFLIGHT_REBOOT_SHUTDOWN, 1.0)
        asked_s = self.clock.now()

        def gone() -> bool:
            heard_s = self.state.heard_s or asked_s
            return self.device.resets > resets or self.clock.now() - max(heard_s, asked_s) > _SILENT_RESTART_S

        if not self._wait(gone, self._connect_s):
            raise FirmwareFault(
                f"the board on {self.device.path} did not restart within {self._connect_s:g} s (is it armed?)"
            )
        self.connect()

    def command(self, number: int, *params: float) -> None:
        """Send a COMMAND_LONG to the autopilot."""
        values = (*params, *[0.0] * (7 - len(params)), number, self.state.system, _AUTOPILOT_COMPONENT, 0)
        self.device.send(self._pack(_COMMAND_LONG, values))

    def parameter(self, name: str) -> BoardParameter | None:
        """Ask for a parameter; None where the board does not have it."""
        for _ in range(_PARAMETER_TRIES):
            self.state.parameters.pop(name, None)
            self.device.send(self.read_request(name))
            if self._wait(lambda: name in self.state.parameters, _PARAMETER_ANSWER_S):
                return self.state.parameters[name]
        return None

    def read_request(self, name: str) -> bytes:
        """A PARAM_REQUEST_READ to the autopilot."""
        values = (-1, self.state.system, _AUTOPILOT_COMPONENT, name.encode())
        return self._pack(_PARAM_REQUEST_READ, values)

    def set_parameter(self, name: str, value: float, kind: int) -> bool:
        """Set a parameter; whether the board confirms the value."""
        for _ in range(_PARAMETER_TRIES):
            self.state.parameters.pop(name, None)
            sent = (_on_wire(value, kind), self.state.system, _AUTOPILOT_COMPONENT, name.encode(), kind)
            self.device.send(self._pack(PARAM_SET, sent))
            if self._wait(lambda: self._holds(name, value), _PARAMETER_ANSWER_S):
                return True
        return False

    def differing(self, wanted: Mapping[str, float]) -> dict[str, BoardParameter]:
        """What the board holds of these where it is something else. Raises SetupError for those that it does not have."""
        held = {name: self.parameter(name) for name in wanted}
        what, remedy = f"the board on {self.device.path} does not have it", "remove it, or check its airframe"
        faults = [
            Fault(f"parameter {name}", what, remedy) for name, parameter in held.items() if parameter is None
        ]
        if faults:
            raise SetupError(faults)
        return {
            name: parameter
            for name, parameter in held.items()
            if parameter is not None and not _same(parameter.value, wanted[name])
        }

    def set_parameters(self, wanted: Mapping[str, float], former: Mapping[str, BoardParameter]) -> None:
        """Set those of `former` to what is wanted. Raises SetupError for one that the board does not take."""
        for name, held in former.items():
            if not self.set_parameter(name, wanted[name], held.kind):
                what = f"the board on {self.device.path} does not take {parameter_text(wanted[name])}"
                raise SetupError(f"parameter {name}", what, "give a value that it takes")

    def restore(self, former: Mapping[str, BoardParameter]) -> list[str]:
        """Put former values back; the names of those that the board did not confirm, or that came too late."""
        deadline_s = self.clock.now() + _RESTORE_S
        return [
            name
            for name, held in former.items()
            if self.clock.now() > deadline_s or not self.set_parameter(name, held.value, held.kind)
        ]

    def _holds(self, name: str, value: float) -> bool:
        held = self.state.parameters.get(name)
        return held is not None and _same(held.value, value)

    def _wait(self, done: Callable[[], bool], limit_s: float) -> bool:
        deadline_s = self.clock.now() + limit_s
        while self.clock.now() < deadline_s:
            self.beat()
            self.read()
            if done():
                return True
            self.clock.sleep(_POLL_S)
        return False

    def _note(self, frame: bytes) -> None:
        if frame[0] != 0xFD or sender(frame)[1] != _AUTOPILOT_COMPONENT:
            return
        number = message_id(frame)
        if number == _HEARTBEAT:
            _, _, autopilot, base_mode, _, _ = _BEAT.unpack(payload_of(frame, _BEAT.size))
            state = self.state
            state.heard_s, state.system, state.autopilot = self.clock.now(), sender(frame)[0], autopilot
            state.in_simulation, state.armed = bool(base_mode & _HIL_FLAG), bool(base_mode & _ARMED_FLAG)
        elif number == PARAM_VALUE:
            value, _, _, _, kind = _VALUE.unpack(payload_of(frame, _VALUE.size))
            self.state.parameters[value_name(frame)] = BoardParameter(_off_wire(value, kind), kind)


def value_name(frame: bytes) -> str:
    """The name in a PARAM_VALUE."""
    _, _, _, name, _ = _VALUE.unpack(payload_of(frame, _VALUE.size))
    return str(name.rstrip(b"\0").decode("ascii", "replace"))


def _on_wire(value: float, kind: int) -> float:
    """PX4 sends an integer in the bytes of the float (MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE)."""
    if kind not in _INTEGER_KINDS:
        return value
    bits = round(value) & 0xFFFFFFFF
    number: float = struct.unpack("<f", struct.pack("<I", bits))[0]
    return number


def _off_wire(value: float, kind: int) -> float:
    if kind not in _INTEGER_KINDS:
        return value
    number: int = struct.unpack("<i", struct.pack("<f", value))[0]
    return float(number)


def _same(first: float, second: float) -> bool:
    # Values on the wire have single precision.
    return abs(first - second) <= 1e-6 * max(1.0, abs(first), abs(second))
