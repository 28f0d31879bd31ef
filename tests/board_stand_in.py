"""A small flight controller in the place of a PX4 board in hardware-in-the-loop mode, at the far end of a pseudo terminal.

It speaks MAVLink by pymavlink, so nothing of the bench's own codec checks itself, and is strict: masks, units, rates and
order of what comes are asserted. It estimates its motion from HIL_SENSOR and HIL_GPS alone, arms, takes off and lands. It
can be slow, lose bytes and restart. Time passes for it in the bench's `sleep`, so no test depends on the host.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from boards import LineClock
from firmware_stand_in import Pilot, State, Vector
from pymavlink.dialects.v20 import common
from scipy.spatial.transform import Rotation
from serial_cable import Cable

SLICE_S = 0.0025
G = 9.80665
INT32, REAL32 = 6, 9
IMU, MAGNETOMETER, BAROMETER = 0x3F, 0x1C0, 0x1A00
BITS_PER_BYTE = 10
# Until a board that restarts is there again, and until it has found its MAVLink.
RESTART_S = 2.0


def default_parameters() -> dict[str, tuple[float, int]]:
    """As an airframe of another aircraft leaves them."""
    geometry = {
        f"CA_ROTOR{number}_{name}": (0.5, REAL32) for number in range(4) for name in ("PX", "PY", "KM")
    }
    outputs = {f"HIL_ACT_FUNC{number}": (0, INT32) for number in range(1, 5)}
    return {
        **geometry,
        **outputs,
        "SYS_HITL": (1, INT32),
        "THR_MDL_FAC": (0.0, REAL32),
        "MPC_THR_HOVER": (0.5, REAL32),
        "MPC_XY_CRUISE": (5.0, REAL32),
    }


@dataclass
class Board:
    """`run` lets time pass. `byte_share` of the line's speed is what it really reads; of `lose_every` bytes that come one
    is lost. `silent_from_s`: no motor outputs from then on.
    """

    cable: Cable
    baud: int = 921600
    byte_share: float = 1.0
    lose_every: int = 0
    silent_from_s: float = math.inf
    autopilot: int = 12
    now_s: float = 100.0
    parameters: dict[str, tuple[float, int]] = field(default_factory=default_parameters)
    restarts: int = 0
    heard: list[Any] = field(default_factory=list)
    sensor_times_s: deque[float] = field(default_factory=lambda: deque(maxlen=4000))
    away_until_s: float | None = None
    on_slice: Callable[[], None] | None = None
    refused_parameters: frozenset[str] = frozenset()
    bad_bytes: int = 0
    left_simulation: bool = False

    def __post_init__(self) -> None:
        self.mav: Any = common.MAVLink(None, srcSystem=1, srcComponent=1)
        self._lost = 0
        self._start()

    def _start(self) -> None:
        self.parser: Any = common.MAVLink(None)
        self.parser.robust_parsing = True
        self.parameters_at_start = dict(self.parameters)
        self.state, self.estimate = State(), Estimate()
        geometry = self.parameters
        self.pilot = Pilot(abs(geometry["CA_ROTOR0_PX"][0]), abs(geometry["CA_ROTOR0_KM"][0]))
        self.intervals_s: dict[int, float] = {93: 0.005}
        self.next_s: dict[int, float] = {}
        self.out = bytearray()
        self.in_credit = self._out_credit = 0.0
        self.booted_s = self.now_s

    @property
    def in_simulation(self) -> bool:
        return self.parameters_at_start["SYS_HITL"][0] == 1 and not self.left_simulation

    def clock(self) -> LineClock:
        return LineClock(lambda: self.now_s, self.run)

    def run(self, span_s: float) -> None:
        """Let this much time pass."""
        until_s = self.now_s + span_s
        while self.now_s < until_s - 1e-9:
            step_s = min(SLICE_S, until_s - self.now_s)
            self.now_s += step_s
            if self.on_slice:
                self.on_slice()
            if self.away_until_s is not None:
                if self.now_s < self.away_until_s:
                    continue
                self.away_until_s = None
                self.cable.plug()
                self._start()
            self._listen(step_s)
            if self.away_until_s is None:
                self._speak(step_s)

    def restart(self) -> None:
        """Go away, as on a reset, and come back."""
        self.restarts += 1
        self.cable.unplug()
        self.away_until_s = self.now_s + RESTART_S

    def restart_once(self) -> None:
        """A hook for `on_slice`."""
        self.on_slice = None
        self.restart()

    def _listen(self, step_s: float) -> None:
        self.in_credit += step_s * self.baud / BITS_PER_BYTE * self.byte_share
        data = self.cable.read_most(int(self.in_credit))
        # A line that idles saves up nothing.
        self.in_credit = min(self.in_credit - len(data), 64.0)
        if self.lose_every:
            kept = bytearray()
            for byte in data:
                self._lost += 1
                if self._lost % self.lose_every:
                    kept.append(byte)
            data = bytes(kept)
        for message in self.parser.parse_buffer(data) or []:
            if message.get_type() == "BAD_DATA":
                self.bad_bytes += len(message.data)
                assert self.lose_every, f"{len(message.data)} bytes that are no MAVLink"
                continue
            self._take(message)
            if self.away_until_s is not None:
                return

    def _speak(self, step_s: float) -> None:
        said = {0: self._heartbeat, 93: self._controls, 30: self._attitude, 33: self._position}
        for number, message in {**said, 32: self._local_position}.items():
            interval_s = 1.0 if number == 0 else self.intervals_s.get(number)
            if interval_s is None or interval_s <= 0.0 or self.now_s < self.next_s.get(number, 0.0) - 1e-9:
                continue
            self.next_s[number] = max(
                self.next_s.get(number, self.now_s) + interval_s, self.now_s - interval_s
            )
            self.say(message())
        self._out_credit += step_s * self.baud / BITS_PER_BYTE
        count = min(int(self._out_credit), len(self.out))
        # More waiting is a link that carries less than was asked of it.
        assert len(self.out) - count < 2000, "the board cannot send what it was asked for"
        if count:
            self.cable.write(bytes(self.out[:count]))
            del self.out[:count]
        self._out_credit = min(self._out_credit - count, 64.0)

    def say(self, message: Any) -> None:
        self.out += message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256

    def _heartbeat(self) -> Any:
        mode = 81 | (32 if self.in_simulation else 0) | (128 if self.pilot.armed else 0)
        return common.MAVLink_heartbeat_message(2, self.autopilot, mode, 0x03040000, 4, 3)

    def _controls(self) -> Any:
        outputs = self.pilot.rotors(self.state) if self.estimate.ready else [0.0] * 4
        functions = [self.parameters[f"HIL_ACT_FUNC{number}"][0] for number in range(1, 5)]
        controls = [0.0] * 16
        for place, function in enumerate(functions):
            if 101 <= function <= 104:
                controls[place] = outputs[int(function) - 101]
        if self.now_s >= self.silent_from_s or not self.in_simulation:
            return common.MAVLink_ping_message(0, 1, 0, 0)
        micros = round((self.now_s - self.booted_s) * 1e6)
        return common.MAVLink_hil_actuator_controls_message(
            micros, controls, 128 if self.pilot.armed else 0, 0
        )

    def _attitude(self) -> Any:
        return common.MAVLink_attitude_message(self._ms(), *self.state.euler(), *self.state.rates)

    def _position(self) -> Any:
        state = self.state
        place = (round(state.latitude_deg * 1e7), round(state.longitude_deg * 1e7))
        altitude_mm = round(state.altitude_m * 1e3)
        speeds = [round(speed * 100) for speed in state.velocity]
        heights = (altitude_mm, round(-state.position[2] * 1000))
        return common.MAVLink_global_position_int_message(self._ms(), *place, *heights, *speeds, 65535)

    def _local_position(self) -> Any:
        return common.MAVLink_local_position_ned_message(
            self._ms(), *self.state.position, *self.state.velocity
        )

    def _ms(self) -> int:
        return round((self.now_s - self.booted_s) * 1000)

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        assert kind != "HIL_STATE_QUATERNION", "a board takes the truth for its own estimate"
        if kind.startswith("HIL_") and self.left_simulation:
            return
        if kind == "HIL_SENSOR":
            assert self.in_simulation
            self._take_sensor(message)
        elif kind == "HIL_GPS":
            assert self.in_simulation
            assert 10 <= message.eph <= 300
            assert message.fix_type == 3
            self.estimate.take_gps(message, self.state)
        elif kind == "HEARTBEAT":
            # That of a ground station is a failsafe's.
            assert (message.type, message.autopilot) == (0, 8)
        elif kind == "PARAM_REQUEST_READ":
            self._answer_parameter(message.param_id)
        elif kind == "PARAM_SET":
            self._set_parameter(message)
        elif kind in ("COMMAND_LONG", "COMMAND_INT"):
            self.heard.append(message)
            self._obey(message)
        else:
            self.heard.append(message)

    def _take_sensor(self, message: Any) -> None:
        mask = message.fields_updated
        assert mask & IMU == IMU
        assert mask & MAGNETOMETER in (0, MAGNETOMETER)
        assert mask & BAROMETER in (0, BAROMETER)
        assert mask & ~(IMU | MAGNETOMETER | BAROMETER) == 0
        assert message.id == 0
        assert abs(message.zacc) < 160.0
        if mask & BAROMETER:
            assert 300.0 < message.abs_pressure < 1100.0
        if mask & MAGNETOMETER:
            assert 0.2 < math.hypot(message.xmag, message.ymag, message.zmag) < 0.7
        self.sensor_times_s.append(self.now_s)
        self.estimate.take_sensor(message, self.now_s, self.state)

    def _answer_parameter(self, name: str) -> None:
        if name in self.parameters:
            value, kind = self.parameters[name]
            wire = value if kind == REAL32 else struct.unpack("<f", struct.pack("<i", int(value)))[0]
            count = len(self.parameters)
            self.say(common.MAVLink_param_value_message(name.encode(), wire, kind, count, 65535))

    def _set_parameter(self, message: Any) -> None:
        name = message.param_id
        if name in self.parameters:
            kind = self.parameters[name][1]
            assert message.param_type == kind, f"{name} is of type {kind}, not {message.param_type}"
            value = message.param_value
            if kind == INT32:
                value = struct.unpack("<i", struct.pack("<f", value))[0]
            if name not in self.refused_parameters:
                self.parameters[name] = (value, kind)
            self._answer_parameter(name)

    def _obey(self, message: Any) -> None:
        command, pilot, state = message.command, self.pilot, self.state
        if command == 246:
            assert not pilot.armed
            self.restart()
            return
        if command == 400:
            pilot.armed = message.param1 == 1.0 and self.estimate.ready
        elif command == 22:
            pilot.target = (*state.position[:2], -(message.param7 - self.estimate.home_altitude_m))
        elif command == 21:
            pilot.target, pilot.landing = state.position, True
        elif command == 511:
            self.intervals_s[int(message.param1)] = message.param2 / 1e6
        elif command == 512:
            hashes = [[0] * 8] * 3
            self.say(common.MAVLink_autopilot_version_message(0, 0x011000FF, 0, 0, 0, *hashes, 0, 0, 0))
        self.say(common.MAVLink_command_ack_message(command, 0))


class Estimate:
    """Motion from sensors: gyro and accelerometer integrated, corrected by each fix."""

    def __init__(self) -> None:
        self.ready = False
        self.home_altitude_m = 0.0
        self._home: tuple[float, float] | None = None
        self._last_s: float | None = None
        self._magnetic: Vector | None = None

    def take_sensor(self, message: Any, now_s: float, state: State) -> None:
        force = (message.xacc, message.yacc, message.zacc)
        if message.fields_updated & MAGNETOMETER:
            self._magnetic = (message.xmag, message.ymag, message.zmag)
        if self._last_s is None:
            if self._magnetic is None:
                return
            assert -10.5 < force[2] < -9.1, f"accelerometer z {force[2]} at rest"
            state.quaternion = level(force, self._magnetic)
        else:
            span_s = min(now_s - self._last_s, 0.05)
            rates = (message.xgyro, message.ygyro, message.zgyro)
            state.rates = rates
            turn = Rotation.from_rotvec([rate * span_s for rate in rates])
            state.quaternion = quaternion_of(Rotation.from_quat(state.quaternion, scalar_first=True) * turn)
            north, east, down = state.to_ned(force)
            state.velocity = moved_by(state.velocity, (north, east, down + G), span_s)
            state.position = moved_by(state.position, state.velocity, span_s)
            state.time_s += span_s
        self._last_s = now_s

    def take_gps(self, message: Any, state: State) -> None:
        latitude, longitude, altitude = message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3
        if self._home is None:
            self._home, self.home_altitude_m = (latitude, longitude), altitude
            self.ready = True
        home_latitude, home_longitude = self._home
        state.latitude_deg, state.longitude_deg, state.altitude_m = latitude, longitude, altitude
        north = (latitude - home_latitude) * 111194.0
        east = (longitude - home_longitude) * 111194.0 * math.cos(math.radians(home_latitude))
        fix = (north, east, self.home_altitude_m - altitude)
        speeds = (message.vn / 100, message.ve / 100, message.vd / 100)
        state.position = moved_by(state.position, np.subtract(fix, state.position).tolist(), 0.5)
        state.velocity = moved_by(state.velocity, np.subtract(speeds, state.velocity).tolist(), 0.8)


Quaternion = tuple[float, float, float, float]


def moved_by(start: Vector, speed: Iterable[float], span_s: float) -> Vector:
    a, b, c = (value + rate * span_s for value, rate in zip(start, speed, strict=True))
    return a, b, c


def level(force: Vector, magnetic: Vector) -> Quaternion:
    """Attitude at rest: down by the accelerometer, north by the magnetometer."""
    down = -np.array(force)
    east = np.cross(down, magnetic)
    axes = [np.cross(east, down), east, down]
    body_to_ned = Rotation.from_matrix([axis / np.linalg.norm(axis) for axis in axes])
    return quaternion_of(body_to_ned)


def quaternion_of(attitude: Rotation) -> Quaternion:
    w, x, y, z = attitude.as_quat(scalar_first=True).tolist()
    return w, x, y, z
