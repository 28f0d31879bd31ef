"""A small program in the place of real PX4 or ArduCopter: strict about the physics link, crude as a pilot.

Installed as `bin/px4` or `arducopter`, it speaks the autopilot's protocols with code of its own (standard library alone)
and ends with exit code 3 and a line `VIOLATION: ...` on any deviation: order, units, masks, time, answers. It flies by the
truth that the link gives: arms, takes off, repositions and lands when told over MAVLink. STAND_IN_FAULT makes it fail.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import signal
import socket
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

DIES, HANGS, TALKS_NONSENSE, NEVER_CONNECTS, ENDS_AT_ONCE, IGNORES_SIGTERM, LEAVES_CHILD = range(1, 8)
FAULT_HEIGHT_M = 1.0
# Host seconds without anything from the bench.
PATIENCE_S = 60.0
READY_S = 1.0
GPS_PATIENCE_US = 2_000_000
# ArduPilot opens its further ports while its world moves.
OTHER_PORTS_AT = 100
MAX_THRUST_N, INERTIA, YAW_INERTIA = 8.5486, 0.02167, 0.04
WEIGHT_N = 2.0643 * 9.81
G = 9.80665
EXTRA = {
    0: 50,
    22: 220,
    23: 168,
    30: 39,
    33: 104,
    44: 221,
    47: 153,
    51: 196,
    73: 38,
    75: 158,
    76: 152,
    77: 143,
    93: 47,
    107: 108,
    113: 124,
    115: 4,
    148: 178,
    253: 83,
}
SAMPLE_FIELDS = 0x3F, 0x1C0, 0x1A00
Vector = tuple[float, float, float]


def violation(text: str) -> NoReturn:
    print(f"VIOLATION: {text}", flush=True)
    sys.exit(3)


def require(condition: bool, text: str) -> None:
    if not condition:
        violation(text)


def crc_table() -> list[int]:
    table = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = value >> 1 ^ 0x8408 if value & 1 else value >> 1
        table.append(value)
    return table


CRC_TABLE = crc_table()


def crc_of(data: bytes) -> int:
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc


class Mavlink:
    """MAVLink 2, packed and read strictly."""

    def __init__(self) -> None:
        self.buffer = bytearray()
        self.sequence = 0

    def pack(self, number: int, payload: bytes) -> bytes:
        payload = payload.rstrip(b"\0") or b"\0"
        head = struct.pack("<BBBBBBHB", len(payload), 0, 0, self.sequence, 1, 1, number, 0)
        self.sequence = (self.sequence + 1) & 0xFF
        return b"\xfd" + head + payload + struct.pack("<H", crc_of(head + payload + bytes((EXTRA[number],))))

    def read(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Number and payload of each frame. A message that is not known here is passed over, garbage is a violation."""
        self.buffer += data
        while len(self.buffer) >= 12:
            require(self.buffer[0] == 0xFD, f"byte {self.buffer[0]:#x} where MAVLink 2 begins")
            size = self.buffer[1] + 12
            if len(self.buffer) < size:
                return
            frame = bytes(self.buffer[:size])
            del self.buffer[:size]
            number = frame[7] | frame[8] << 8 | frame[9] << 16
            if number in EXTRA:
                crc = crc_of(frame[1:-2] + bytes((EXTRA[number],)))
                require(struct.pack("<H", crc) == frame[-2:], f"checksum of message {number}")
                yield number, frame[10:-2]


def unpacked(layout: str, payload: bytes) -> tuple[float, ...]:
    size = struct.calcsize(layout)
    require(len(payload) <= size, f"a payload of {len(payload)} bytes, {size} at most")
    return struct.unpack(layout, payload.ljust(size, b"\0"))


class State:
    """Truth: metres north, east, down of the start, m/s, quaternion, rad/s, and geodetic place."""

    def __init__(self) -> None:
        self.time_s = 0.0
        self.position: Vector = (0.0, 0.0, 0.0)
        self.velocity: Vector = (0.0, 0.0, 0.0)
        self.quaternion = (1.0, 0.0, 0.0, 0.0)
        self.rates: Vector = (0.0, 0.0, 0.0)
        self.latitude_deg = self.longitude_deg = self.altitude_m = 0.0

    def euler(self) -> Vector:
        w, x, y, z = self.quaternion
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        return roll, pitch, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def to_ned(self, body: Vector) -> Vector:
        w, x, y, z = self.quaternion
        a, b, c = body
        return (
            (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c,
            2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c,
            2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c,
        )


class Pilot:
    """Arms, takes off, goes to a place and lands, by proportional control of the truth."""

    def __init__(self, arm_m: float, torque_m: float) -> None:
        self.arm_m, self.torque_m = arm_m, torque_m
        self.armed = False
        self.landing = self.returning = False
        self.target: Vector | None = None
        self.highest_m = 0.0
        self.heading_rad = 0.0
        # Places still to pass, and whether it lands at the last one.
        self.route: list[Vector] = []
        self.ends_at_home = False

    def rotors(self, state: State) -> list[float]:
        """Rotor speeds 0 to 1: front right, rear left, front left, rear right."""
        north, east, down = state.position
        self.highest_m = max(self.highest_m, -down)
        if self.route and self.target == self.route[0] and math.dist(self.target, state.position) < 0.5:
            self.route.pop(0)
            if self.route:
                self.target = self.route[0]
            elif self.ends_at_home:
                self.target, self.returning = (0.0, 0.0, down), True
        if not self.armed:
            self.heading_rad = state.euler()[2]
            return [0.0] * 4
        if self.target is None:
            return [0.1] * 4
        if self.returning and math.hypot(north, east) < 0.3:
            self.returning, self.landing = False, True
        if self.landing and -down < 0.03 and abs(state.velocity[2]) < 0.05:
            self.armed, self.landing, self.target = False, False, None
            return [0.0] * 4
        speed_n, speed_e = (
            self._bounded(0.6 * (goal - at), 3.0)
            for goal, at in zip(self.target[:2], (north, east), strict=True)
        )
        sink = 2.0 if down < -3.0 else 0.5
        speed_d = sink if self.landing else self._bounded(1.2 * (self.target[2] - down), 3.0)
        push = [
            self._bounded(1.5 * (want - v), 3.0)
            for want, v in zip((speed_n, speed_e, speed_d), state.velocity, strict=True)
        ]
        roll, pitch, yaw = state.euler()
        forward = push[0] * math.cos(yaw) + push[1] * math.sin(yaw)
        right = -push[0] * math.sin(yaw) + push[1] * math.cos(yaw)
        turn = math.remainder(self.heading_rad - yaw, 2 * math.pi)
        wanted = (7.0 * (right / G - roll), 7.0 * (-forward / G - pitch), 2.5 * turn)
        p, q, r = (want - rate for want, rate in zip(wanted, state.rates, strict=True))
        force = WEIGHT_N * (1.0 - 2.0 * push[2] / G) / max(0.7, math.cos(roll) * math.cos(pitch))
        a, b, c = (
            20 * INERTIA * p / (4 * self.arm_m),
            20 * INERTIA * q / (4 * self.arm_m),
            8 * YAW_INERTIA * r / (4 * self.torque_m),
        )
        c = self._bounded(c, 1.5)
        thrusts = (force / 4 - a + b + c, force / 4 + a - b + c, force / 4 + a + b - c, force / 4 - a - b - c)
        return [math.sqrt(min(max(thrust / MAX_THRUST_N, 0.0), 1.0)) for thrust in thrusts]

    @staticmethod
    def _bounded(value: float, most: float) -> float:
        return min(max(value, -most), most)


class Clients:
    """The MAVLink side: commands in, telemetry out. `takeoff_height_m` reads param7 of the autopilot's kind."""

    def __init__(self, pilot: Pilot, state: State, is_px4: bool, takeoff_m: float) -> None:
        self.pilot, self.state, self.is_px4, self.takeoff_m = pilot, state, is_px4, takeoff_m
        self.mavlink = Mavlink()
        self.readers: dict[object, Mavlink] = {}
        self.stream_clients: set[object] = set()
        self.next_beat_s = self.next_motion_s = 0.0
        self.home: tuple[float, float, float] | None = None
        # Of a version whose simulation has other names.
        self.forgetful = False
        self.gps_off = self.gps_failsafe = False
        self.items: list[tuple[float, ...]] = []
        self.item_count = 0

    def take(self, source: object, data: bytes) -> bytes:
        """Answers to what one client sent."""
        answers = b""
        for number, payload in self.readers.setdefault(source, Mavlink()).read(data):
            if number == 76:
                *params, command, _, _, _ = unpacked("<7fHBBB", payload)
                answers += self._command(source, int(command), params)
            elif number == 23:
                value, _, _, name, _ = struct.unpack("<fBB16sB", payload.ljust(23, b"\0"))
                print(f"{self.state.time_s:.2f} s: {name.rstrip(bytes(1)).decode()} {value:.4g}", flush=True)
                if name.startswith(b"SIM_GPS_DISABLE"):
                    self.gps_off = value == 1.0
                if name.startswith(b"SIM_") and not self.forgetful:
                    answers += self.mavlink.pack(22, struct.pack("<fHH16sB", value, 1, 0, name, 9))
            elif number == 44:
                self.item_count, self.items = struct.unpack("<HBBB", payload.ljust(5, b"\0")[:5])[0], []
                answers += self._request_item()
            elif number == 73:
                item = struct.unpack("<4fiifHHBBBBBB", payload.ljust(38, b"\0")[:38])
                require(item[7] == len(self.items), f"mission item {item[7]} after {len(self.items) - 1}")
                self.items.append(item)
                answers += self._request_item()
            elif number == 75:
                p = unpacked("<4fiifHBBBBB", payload)
                answers += self._command(source, int(p[7]), [*p[:4], p[4] * 1e-7, p[5] * 1e-7, p[6]])
        return answers

    def _request_item(self) -> bytes:
        if len(self.items) < self.item_count:
            return self.mavlink.pack(51, struct.pack("<HBBB", len(self.items), 255, 190, 0))
        return self.mavlink.pack(47, struct.pack("<BBBB", 255, 190, 0, 0))

    def _start_mission(self) -> None:
        """Places of the items that have one; home, which ArduPilot keeps as item 0, is none."""
        latitude, longitude, altitude = self._home()
        self.pilot.route = []
        for item in self.items if self.is_px4 else self.items[1:]:
            command, frame, height_m = int(item[8]), int(item[11]), item[6]
            if frame in (0, 5):
                height_m -= altitude
            if command == 22:
                self.pilot.route.append((*self.state.position[:2], -height_m))
            elif command == 16:
                north = (item[4] * 1e-7 - latitude) * 111194.0
                east = (item[5] * 1e-7 - longitude) * 111194.0 * math.cos(math.radians(latitude))
                self.pilot.route.append((north, east, -height_m))
            else:
                require(command == 20, f"mission item with command {command}")
                self.pilot.ends_at_home = True
        self.pilot.target = self.pilot.route[0]

    def watch_receiver(self) -> bytes:
        """Lands when it has no position, and says so."""
        if not (self.gps_off and self.pilot.armed) or self.gps_failsafe:
            return b""
        self.gps_failsafe = True
        self.pilot.target, self.pilot.landing, self.pilot.route = self.state.position, True, []
        text = b"Failsafe activated" if self.is_px4 else b"EKF Failsafe: changed to LAND Mode"
        return self.mavlink.pack(253, struct.pack("<B50s", 2, text))

    def _command(self, source: object, command: int, params: list[float]) -> bytes:
        pilot, state, accepted = self.pilot, self.state, True
        version = b""
        if command == 400:
            accepted = state.time_s >= READY_S
            if accepted:
                pilot.armed = params[0] == 1.0
        elif command == 22:
            height_m = self.takeoff_m if math.isnan(params[6]) else params[6]
            if self.is_px4 and not math.isnan(params[6]):
                height_m -= self._home()[2]
            pilot.target = (*state.position[:2], -height_m)
        elif command == 21:
            pilot.target, pilot.landing = state.position, True
        elif command == 20:
            pilot.target, pilot.returning = (0.0, 0.0, min(state.position[2], -5.0)), True
        elif command == 176:
            # PX4: main mode auto, sub-mode mission.
            if self.is_px4 and params[1:3] == [4.0, 4.0]:
                self._start_mission()
        elif command == 300:
            self._start_mission()
        elif command == 192:
            latitude, longitude, altitude = self._home()
            north = (params[4] - latitude) * 111194.0
            east = (params[5] - longitude) * 111194.0 * math.cos(math.radians(latitude))
            height_m = params[6] - altitude if self.is_px4 else params[6]
            pilot.target = (north, east, -height_m)
        elif command == 511:
            self.stream_clients.add(source)
        elif command == 512 and params[0] == 148:
            layout = struct.pack("<QQIIIIHH8s", 0, 0, 0x010203FF, 0, 0, 0, 0, 0, b"5tand1n\0")
            version = self.mavlink.pack(148, layout)
        else:
            accepted = False
        return self.mavlink.pack(77, struct.pack("<HB", command, 0 if accepted else 2)) + version

    def _home(self) -> tuple[float, float, float]:
        assert self.home
        return self.home

    def due(self) -> tuple[bytes, bytes]:
        """What every client gets now, and what those get that asked."""
        state, motion = self.state, b""
        text = self.watch_receiver()
        beat = b""
        if self.home is None and state.latitude_deg:
            self.home = (state.latitude_deg, state.longitude_deg, state.altitude_m + state.position[2])
        if state.time_s >= self.next_beat_s:
            self.next_beat_s += 1.0
            base = 81 | (128 if self.pilot.armed else 0)
            mode = 0x03040000 if self.is_px4 else 4
            status = 4 if self.pilot.armed else 3
            if self.gps_failsafe and self.pilot.armed:
                mode, status = 0x06040000 if self.is_px4 else 9, 5
            beat = self.mavlink.pack(
                0,
                struct.pack("<IBBBBB", mode, 2, 12 if self.is_px4 else 3, base, status, 3),
            )
        if state.time_s >= self.next_motion_s:
            self.next_motion_s += 0.02
            ms = round(state.time_s * 1000)
            place = (round(state.latitude_deg * 1e7), round(state.longitude_deg * 1e7))
            heights = (round(state.altitude_m * 1000), round(-state.position[2] * 1000))
            speeds = (round(v * 100) for v in state.velocity)
            motion = self.mavlink.pack(33, struct.pack("<IiiiihhhH", ms, *place, *heights, *speeds, 65535))
            motion += self.mavlink.pack(30, struct.pack("<I6f", ms, *state.euler(), *state.rates))
        return text + beat, motion


class Faults:
    """Fails as STAND_IN_FAULT says, once the vehicle is high enough."""

    def __init__(self, kind: int) -> None:
        self.kind = kind
        if kind == ENDS_AT_ONCE:
            print("no airframe of this name", flush=True)
            sys.exit(7)
        if kind == NEVER_CONNECTS:
            time.sleep(PATIENCE_S)
        if kind == IGNORES_SIGTERM:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if kind == LEAVES_CHILD and os.fork() == 0:
            os.setsid()
            time.sleep(PATIENCE_S)
            os._exit(0)

    def act(self, state: State, say: socket.socket) -> None:
        if -state.position[2] < FAULT_HEIGHT_M:
            return
        if self.kind == DIES:
            print("out of memory in the mixer", flush=True)
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.kind == HANGS:
            time.sleep(PATIENCE_S)
        if self.kind == TALKS_NONSENSE:
            say.send(b"Segmentation fault? No: a web server.\r\n" * 4)


def main() -> None:
    if Path(sys.argv[0]).name == "px4":
        fly_px4()
    else:
        fly_ardupilot()


# ---- PX4


class SampleChecks:
    """What PX4's simulator link must keep, sample by sample."""

    def __init__(self, state: State, rate_hz: float) -> None:
        self.state, self.rate_hz = state, rate_hz
        self.time_us = 0
        self.step_us = 0
        self.gps_us: int | None = None
        self.gps_times: list[int] = []
        self.imu: tuple[float, ...] = ()
        self.equal = 0
        self.field: Vector | None = None
        self.truth_us = -1
        self.start: tuple[float, float, float] | None = None

    def take_truth(self, payload: bytes) -> None:
        p = unpacked("<Q4f3fiii3hHH3h", payload)
        require(self.gps_us in (None, p[0]), "HIL_STATE_QUATERNION has another time than HIL_GPS before it")
        state = self.state
        require(abs(sum(v * v for v in p[1:5]) - 1.0) < 1e-3, f"quaternion {p[1:5]}")
        state.quaternion, state.rates = (p[1], p[2], p[3], p[4]), (p[5], p[6], p[7])
        state.latitude_deg, state.longitude_deg, state.altitude_m = p[8] * 1e-7, p[9] * 1e-7, p[10] * 1e-3
        state.velocity = (p[11] / 100, p[12] / 100, p[13] / 100)
        here = (state.latitude_deg, state.longitude_deg, state.altitude_m)
        self.start = self.start or here
        north = (here[0] - self.start[0]) * 111194.0
        east = (here[1] - self.start[1]) * 111194.0 * math.cos(math.radians(here[0]))
        state.position = (north, east, self.start[2] - here[2])
        self.truth_us = int(p[0])

    def take_gps(self, payload: bytes) -> None:
        p = unpacked("<QiiiHHHhhhHBBBH", payload)
        require(self.gps_us is None, "two HIL_GPS before one HIL_SENSOR")
        self.gps_us = int(p[0])
        self.gps_times.append(self.gps_us)
        require(10 <= p[4] <= 300 and 10 <= p[5] <= 500, f"eph {p[4]} and epv {p[5]} are no cm")
        require(p[11] == 3 and p[12] >= 10, f"fix type {p[11]} with {p[12]} satellites")
        require(p[10] < 36000 or p[10] == 65535, f"course {p[10]}")
        require(abs(p[6] - math.hypot(p[7], p[8])) < 2, "vel is not the length of vn, ve")
        if self.truth_us >= 0:
            state = self.state
            north = (p[1] * 1e-7 - state.latitude_deg) * 111194.0
            east = (p[2] * 1e-7 - state.longitude_deg) * 111194.0 * math.cos(math.radians(state.latitude_deg))
            require(
                math.hypot(north, east) < 30.0,
                f"HIL_GPS is {north:.1f} m north and {east:.1f} m east of the truth",
            )
            require(
                abs(p[3] / 1000 - state.altitude_m) < 5.0,
                f"HIL_GPS altitude {p[3]} mm at {state.altitude_m} m",
            )
            for reported, true in zip(p[7:10], state.velocity, strict=True):
                require(abs(reported / 100 - true) < 0.6, f"HIL_GPS velocity {reported} cm/s at {true} m/s")

    def take_sensor(self, payload: bytes, armed: bool) -> None:
        p = unpacked("<Q13fIB", payload)
        time_us, mask = int(p[0]), int(p[14])
        require(time_us > self.time_us, f"HIL_SENSOR time {time_us} after {self.time_us}")
        step_us = time_us - self.time_us
        require(self.step_us in (0, step_us), f"a step of {step_us} us after {self.step_us} us")
        require(step_us in (4000, 5000), f"a step of {step_us} us")
        self.step_us, self.time_us = step_us, time_us
        self.state.time_s = time_us / 1e6
        require(
            self.gps_us in (None, time_us), f"HIL_GPS of {self.gps_us} us before HIL_SENSOR of {time_us} us"
        )
        self.gps_us = None
        require(p[15] == 0, f"IMU {p[15]}")
        imu, magnetic, slow = SAMPLE_FIELDS
        require(mask & imu == imu, f"mask {mask:#x} lacks accelerometer or gyro")
        require(
            mask & ~(imu | magnetic | slow) == 0, f"mask {mask:#x} has bits of sensors that are not there"
        )
        require(
            mask & magnetic in (0, magnetic) and mask & slow in (0, slow),
            f"mask {mask:#x} has part of a group",
        )
        self._check_imu(p[1:7], armed)
        if mask & magnetic:
            self._check_magnetometer((p[7], p[8], p[9]))
        if mask & slow:
            require(300.0 < p[10] < 1100.0, f"pressure {p[10]} is no hPa")
            height_m = 44330.77 * (1 - (p[10] / 1013.25) ** 0.190263)
            require(
                self.truth_us < 0 or abs(height_m - self.state.altitude_m) < 4.0,
                f"pressure of {height_m:.1f} m",
            )
            require(-60.0 < p[13] < 60.0, f"temperature {p[13]}")
        if self.truth_us >= 0:
            require(self.truth_us == time_us, "asked for HIL_STATE_QUATERNION every 5 ms, one is missing")

    def _check_imu(self, imu: tuple[float, ...], armed: bool) -> None:
        require(all(map(math.isfinite, imu)), f"IMU {imu}")
        self.equal = self.equal + 1 if imu == self.imu else 0
        self.imu = imu
        require(self.equal < 5, "the IMU repeats itself: it has no noise")
        force: Vector = (imu[0], imu[1], imu[2])
        if self.truth_us < 0 and not armed:
            require(
                -10.5 < force[2] < -9.1, f"accelerometer z {force[2]} at rest: specific force is -9.81 there"
            )
        if self.truth_us >= 0:
            for rate, true in zip(imu[3:6], self.state.rates, strict=True):
                require(abs(rate - true) < 0.03, f"gyro {rate} rad/s at {true} rad/s")
            require(max(map(abs, force)) < 157.0, f"accelerometer {force}: more than 16 g")

    def _check_magnetometer(self, magnetic: Vector) -> None:
        strength = math.sqrt(sum(axis * axis for axis in magnetic))
        require(0.2 < strength < 0.7, f"a field of {strength}: not gauss")
        if self.truth_us >= 0:
            field = self.state.to_ned(magnetic)
            self.field = self.field or field
            apart = math.dist(field, self.field)
            require(apart < 0.03, f"the field turns with the body: {field} after {self.field}")


def fly_px4() -> None:
    parameters = {
        name[10:]: float(text) for name, text in os.environ.items() if name.startswith("PX4_PARAM_")
    }
    require(sys.argv[1] == "-d" and sys.argv[2] == "-i", f"arguments {sys.argv[1:]}")
    require(sys.argv[4:] == ["-s", "etc/init.d-posix/rcS"], f"arguments {sys.argv[1:]}")
    require(Path(sys.argv[5]).is_file(), "the start script is not in the working folder")
    require(os.environ.get("PX4_SIM_MODEL") == "none_iris", "PX4_SIM_MODEL")
    require(os.environ["HOME"] == str(Path.cwd()), "HOME is not the working folder")
    instance = int(sys.argv[3])
    places = [
        (parameters[f"CA_ROTOR{n}_PX"], parameters[f"CA_ROTOR{n}_PY"], parameters[f"CA_ROTOR{n}_KM"])
        for n in range(4)
    ]
    signs = [tuple(math.copysign(1, value) for value in place) for place in places]
    require(signs == [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)], f"rotors at {places}")
    require(
        parameters["THR_MDL_FAC"] == 1 and 0.4 < parameters["MPC_THR_HOVER"] < 0.8,
        "THR_MDL_FAC or MPC_THR_HOVER",
    )
    require(parameters["MAV_SYS_ID"] == 1, "MAV_SYS_ID")
    Path(f"/tmp/px4_lock-{instance}").touch()
    faults = Faults(int(parameters.get("STAND_IN_FAULT", 0)))
    link = connected(4560 + instance)
    ports = []
    for local, far in ((14580 + instance, 14540 + instance), (18570 + instance, 14550)):
        port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        port.bind(("127.0.0.1", local))
        port.setblocking(False)
        ports.append((port, ("127.0.0.1", far)))
    state = State()
    pilot = Pilot(places[0][0], places[0][2])
    clients = Clients(pilot, state, is_px4=True, takeoff_m=parameters.get("MIS_TAKEOFF_ALT", 2.5))
    checks = SampleChecks(state, 1e6 / 5000)
    mavlink = Mavlink()
    link.sendall(mavlink.pack(0, struct.pack("<IBBBBB", 0, 2, 12, 0, 0, 3)))
    link.sendall(mavlink.pack(76, struct.pack("<7fHBBB", 115, 5000, 0, 0, 0, 0, 0, 511, 0, 0, 0)))
    samples, reader = 0, Mavlink()
    if parameters.get("SDLOG_BACKEND"):
        folder = Path("log", "2026-01-01")
        folder.mkdir(parents=True)
        (folder / "10_00_00.ulg").write_bytes(b"ULog of the stand-in")
    while True:
        require(bool(select.select([link], [], [], PATIENCE_S)[0]), "silence")
        data = link.recv(65536)
        if not data:
            sys.exit(0)
        answered = False
        for number, payload in reader.read(data):
            require(not answered, "a message came behind HIL_SENSOR, before its answer")
            if number == 113:
                checks.take_gps(payload)
            elif number == 115:
                checks.take_truth(payload)
            else:
                require(number == 107, f"message {number} on the simulator link")
                checks.take_sensor(payload, pilot.armed)
                samples += 1
                # Outputs do not run before the eighth sample.
                answered = samples > 8
                rotors = pilot.rotors(state)
                faults.act(state, link)
                if answered:
                    controls = struct.pack(
                        "<QQ16fB", checks.time_us, 1, *rotors, *[0.0] * 12, 128 if pilot.armed else 0
                    )
                    link.sendall(mavlink.pack(93, controls))
        clients.gps_off = checks.time_us - (checks.gps_times or [0])[-1] > GPS_PATIENCE_US
        serve_datagrams(clients, ports)


def serve_datagrams(clients: Clients, ports: list[tuple[socket.socket, tuple[str, int]]]) -> None:
    beat, motion = clients.due()
    for port, far in ports:
        answers = b""
        while True:
            try:
                data, source = port.recvfrom(65536)
            except (BlockingIOError, ConnectionRefusedError):
                break
            require(source == far, f"a datagram from {source}, not {far}")
            answers += clients.take(port, data)
        if beat or motion or answers:
            try:
                port.sendto(beat + motion + answers, far)
            except ConnectionRefusedError:
                continue


def connected(port: int) -> socket.socket:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            link = socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            require(time.monotonic() < deadline_s, f"nobody listens on TCP {port}")
            time.sleep(0.0005)
        else:
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return link


# ---- ArduPilot


def fly_ardupilot() -> None:
    options = dict(zip(sys.argv[1:-1:2], sys.argv[2:-1:2], strict=True))
    require(sys.argv[-1].startswith("-I"), f"arguments {sys.argv[1:]}")
    instance = int(sys.argv[-1][2:])
    require(options["--model"] == "JSON" and float(options["--speedup"]) >= 1, f"arguments {sys.argv[1:]}")
    latitude, longitude, altitude, heading = map(float, options["--home"].split(","))
    lines = [
        line.split()
        for name in options["--defaults"].split(",")
        for line in Path(name).read_text().splitlines()
    ]
    parameters = {name: float(value) for name, value in lines}
    require(parameters["FRAME_CLASS"] == 1 and parameters["FRAME_TYPE"] == 1, "quad X is class 1, type 1")
    require(
        parameters["MOT_THST_EXPO"] == 1 and 0.125 <= parameters["MOT_THST_HOVER"] <= 0.6875, "MOT_THST_*"
    )
    rate_hz = int(parameters["SIM_RATE_HZ"])
    require(rate_hz >= 720, f"SIM_RATE_HZ {rate_hz}: the gyro is too slow for a main loop of 400 Hz")
    faults = Faults(int(parameters.get("STAND_IN_FAULT", 0)))
    Path("eeprom.bin").write_bytes(bytes(16))
    first = socket.create_server(("127.0.0.1", 5760 + 10 * instance))
    servers: list[socket.socket] = []
    # The world begins with a client on the first port.
    sockets = [first.accept()[0]]
    sockets[0].setblocking(False)
    if parameters["LOG_BACKEND_TYPE"]:
        Path("logs").mkdir()
        Path("logs", "00000001.BIN").write_bytes(b"DataFlash of the stand-in")
    physics = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    physics.connect(("127.0.0.1", 9002 + 10 * instance))
    physics.settimeout(PATIENCE_S)
    state = State()
    pilot = Pilot(0.174, 0.016)
    clients = Clients(pilot, state, is_px4=False, takeoff_m=10.0)
    clients.forgetful = parameters.get("STAND_IN_FORGETS", 0) == 1
    count, answer, pulses = 0, b"", [1000] * 16
    checks = AnswerChecks(state, rate_hz, (latitude, longitude, altitude), math.radians(heading))
    while True:
        packet = struct.pack("<HHI16H", 18458, rate_hz, count, *pulses)
        physics.send(packet)
        if count % 997 == 5:
            # As after a lost answer: the same frame again, which must be answered alike and without a step.
            physics.send(packet)
        answer = physics.recv(4096)
        if count % 997 == 5:
            require(physics.recv(4096) == answer, "a frame that came again got another answer")
        checks.take(answer)
        count += 1
        if count == int(parameters.get("STAND_IN_RESTART", -1)):
            count = 0
        if count == OTHER_PORTS_AT:
            servers = [socket.create_server(("127.0.0.1", port + 10 * instance)) for port in (5762, 5763)]
            for server in servers:
                server.setblocking(False)
        for server in servers:
            try:
                client = server.accept()[0]
            except BlockingIOError:
                continue
            client.setblocking(False)
            sockets.append(client)
        beat, motion = clients.due()
        for client in sockets:
            answers = b""
            with contextlib.suppress(BlockingIOError):
                answers = clients.take(client, client.recv(65536))
            out = beat + (motion if client in clients.stream_clients else b"") + answers
            if out:
                client.sendall(out)
        rotors = pilot.rotors(state)
        faults.act(state, physics)
        pulses = [round(1000 + 1000 * share) for share in rotors] + [1500] * 12


class AnswerChecks:
    """What the answers of the JSON physics must keep."""

    def __init__(
        self, state: State, rate_hz: int, home: tuple[float, float, float], heading_rad: float
    ) -> None:
        self.state, self.rate_hz, self.home, self.heading_rad = state, rate_hz, home, heading_rad
        self.answers = 0

    def take(self, answer: bytes) -> None:
        require(
            answer[:1] == b"\n" and answer[-1:] == b"\n" and answer.count(b"\n") == 2,
            f"line feeds of {answer!r}",
        )
        require(b'": ' not in answer and b" " not in answer, "a blank behind a colon")
        document = json.loads(answer)
        known = {"timestamp", "imu", "position", "quaternion", "velocity"}
        require(
            set(document) == known and set(document["imu"]) == {"gyro", "accel_body"}, f"keys {set(document)}"
        )
        self.answers += 1
        state = self.state
        step_s = document["timestamp"] - state.time_s
        require(abs(step_s - 1 / self.rate_hz) < 1e-8, f"a step of {step_s} s at {self.rate_hz} Hz")
        before, was_at = state.velocity, state.position
        state.time_s = document["timestamp"]
        state.position, state.velocity = tuple(document["position"]), tuple(document["velocity"])
        state.quaternion, state.rates = tuple(document["quaternion"]), tuple(document["imu"]["gyro"])
        require(abs(sum(v * v for v in state.quaternion) - 1) < 1e-6, "quaternion")
        force = tuple(document["imu"]["accel_body"])
        self._check_motion(force, before, was_at, step_s)
        north, east, down = state.position
        state.latitude_deg = self.home[0] + north / 111318.845
        state.longitude_deg = self.home[1] + east / 111318.845 / math.cos(math.radians(self.home[0]))
        state.altitude_m = self.home[2] - down

    def _check_motion(self, force: Vector, before: Vector, was_at: Vector, step_s: float) -> None:
        state = self.state
        if self.answers < 5:
            require(-10.5 < force[2] < -9.1, f"accelerometer z {force[2]} at rest")
            turned = math.remainder(state.euler()[2] - self.heading_rad, 2 * math.pi)
            require(
                abs(turned) < 0.01, f"a heading of {state.euler()[2]} rad, --home says {self.heading_rad}"
            )
        # The receiver's error is in the horizontal position: fixes jump.
        for axis in range(3):
            moved = state.position[axis] - was_at[axis] - state.velocity[axis] * step_s
            require(
                abs(moved) < (3.0 if axis < 2 else 0.01),
                f"axis {axis} moved {moved:.3f} m beside its velocity",
            )
        if -state.position[2] > 0.5:
            # In the air velocity changes by what the accelerometer feels, and gravity.
            felt = state.to_ned(force)
            for axis, gravity in enumerate((0.0, 0.0, G)):
                change = (state.velocity[axis] - before[axis]) / step_s
                require(
                    abs(change - felt[axis] - gravity) < 1.0,
                    f"axis {axis}: {change:.2f} m/s2, felt {felt[axis]:.2f}",
                )


if __name__ == "__main__":
    main()
