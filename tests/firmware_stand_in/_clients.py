"""Commands of MAVLink clients, and the telemetry that they get."""

from __future__ import annotations

import math
import os
import struct

from ._battery import ArduPilotBattery, Px4Battery
from ._frames import Mavlink, unpacked
from ._pilot import Pilot, State

# Before it refuses to arm, as an autopilot whose estimator is not ready.
READY_S = 1.0
_TERMINATED = 8
# Custom modes of PX4: main and sub-mode in the upper bytes.
_OFFBOARD, _TERMINATION = 0x00060000, 0x000A0000


class Clients:
    """The MAVLink side: commands in, telemetry out. `takeoff_height_m` reads param7 of the autopilot's kind."""

    def __init__(
        self,
        pilot: Pilot,
        state: State,
        is_px4: bool,
        takeoff_m: float,
        battery: Px4Battery | ArduPilotBattery,
    ) -> None:
        self.pilot, self.state, self.is_px4, self.takeoff_m = pilot, state, is_px4, takeoff_m
        self.battery = battery
        self.told_s = 0.0
        self.low_battery = False
        # Modes of PX4 in which no controller runs.
        self.offboard = self.terminated = False
        self.mavlink = Mavlink()
        self.readers: dict[object, Mavlink] = {}
        self.stream_clients: set[object] = set()
        self.next_beat_s = self.next_motion_s = 0.0
        self.home_altitude_m: float | None = None
        # Of a version whose simulation has other names.
        self.forgetful = False
        # As the SITL of ArduPilot, where a number of a command is none.
        self.aborts_on_nan = False

    def take(self, source: object, data: bytes) -> bytes:
        """Answers to what one client sent."""
        answers = b""
        reader = self.readers.setdefault(source, Mavlink())
        for number, payload in reader.read(data):
            if number == 76:
                *params, command, _, _, _ = unpacked("<7fHBBB", payload)
                answers += self._command(source, reader.sender, int(command), params)
            elif number == 23:
                value, _, _, name, _ = struct.unpack("<fBB16sB", payload.ljust(23, b"\0"))
                print(f"{self.state.time_s:.2f} s: {name.rstrip(bytes(1)).decode()} {value:.4g}", flush=True)
                self.battery.set_parameter(name.rstrip(bytes(1)).decode(), value)
                if name.startswith(b"SIM_") and not self.forgetful:
                    answers += self.mavlink.pack(22, struct.pack("<fHH16sB", value, 1, 0, name, 9))
        return answers

    def failsafe_texts(self) -> bytes:
        """It warns of a low battery."""
        if self.low_battery or not (isinstance(self.battery, ArduPilotBattery) and self.battery.fails):
            return b""
        self.low_battery = True
        return self.mavlink.pack(253, struct.pack("<B50s", 4, b"Battery Failsafe"))

    @property
    def has_outputs(self) -> bool:
        """Whether a controller of PX4 runs."""
        on_ground = -self.state.position[2] < 0.1
        return not (self.terminated or (self.offboard and on_ground))

    def _command(self, source: object, sender: tuple[int, int], command: int, params: list[float]) -> bytes:
        pilot, state, accepted = self.pilot, self.state, True
        version = b""
        # It makes whole numbers of the first ones, and passes over others.
        if self.aborts_on_nan and any(map(math.isnan, params[:2])):
            print("ERROR: Floating point exception - aborting", flush=True)
            os.abort()
        if command == 400:
            accepted = state.time_s >= READY_S
            if accepted:
                pilot.armed = params[0] == 1.0
        elif command == 22:
            height_m = self.takeoff_m if math.isnan(params[6]) else params[6]
            if self.is_px4 and not math.isnan(params[6]):
                assert self.home_altitude_m is not None
                height_m -= self.home_altitude_m
            pilot.target = (*state.position[:2], -height_m)
        elif command == 21:
            pilot.target, pilot.landing = state.position, True
        elif command == 176:
            self.offboard = self.is_px4 and params[1] == 6.0
        elif command == 185 and self.is_px4:
            accepted = self.pilot.armed
            self.terminated = accepted and params[0] > 0.5
        elif command == 511:
            self.stream_clients.add(source)
        elif command == 512 and params[0] == 148:
            layout = struct.pack("<QQIIIIHH8s", 0, 0, 0x010203FF, 0, 0, 0, 0, 0, b"5tand1n\0")
            version = self.mavlink.pack(148, layout)
        elif command == 512 and params[0] == 2:
            version = self.mavlink.pack(2, struct.pack("<QI", 0, round(self.state.time_s * 1000)))
        elif command == 512 and params[0] == 0:
            version = self._heartbeat()
        elif command == 42651:
            accepted = params[0] == 1.0 and self.battery.reset(params[1])
        else:
            accepted = False
        ack = struct.pack("<HBBiBB", command, 0 if accepted else 2, 0, 0, *sender)
        return self.mavlink.pack(77, ack) + version

    def due(self) -> tuple[bytes, bytes]:
        """What every client gets now, and what those get that asked."""
        state, motion = self.state, b""
        self.battery.advance(state.time_s - self.told_s, self.pilot.armed)
        self.told_s = state.time_s
        beat = self.failsafe_texts()
        if self.home_altitude_m is None and state.latitude_deg:
            self.home_altitude_m = state.altitude_m + state.position[2]
        if state.time_s >= self.next_beat_s:
            self.next_beat_s = max(self.next_beat_s + 1.0, state.time_s)
            status = struct.pack("<IIIHHhHHHHHHb", *[0] * 12, self.battery.remaining())
            beat += self._heartbeat() + self.mavlink.pack(1, status)
        if state.time_s >= self.next_motion_s:
            self.next_motion_s = max(self.next_motion_s + 0.02, state.time_s)
            ms = round(state.time_s * 1000)
            place = (round(state.latitude_deg * 1e7), round(state.longitude_deg * 1e7))
            heights = (round(state.altitude_m * 1000), round(-state.position[2] * 1000))
            speeds = (round(v * 100) for v in state.velocity)
            motion = self.mavlink.pack(33, struct.pack("<IiiiihhhH", ms, *place, *heights, *speeds, 65535))
            motion += self.mavlink.pack(30, struct.pack("<I6f", ms, *state.euler(), *state.rates))
        return beat, motion

    def _heartbeat(self) -> bytes:
        base = 81 | (128 if self.pilot.armed else 0)
        mode = 0x03040000 if self.is_px4 else 4
        status = 4 if self.pilot.armed else 3
        if self.offboard:
            mode = _OFFBOARD
        if self.terminated:
            mode, status = _TERMINATION, _TERMINATED
        kind = 12 if self.is_px4 else 3
        return self.mavlink.pack(0, struct.pack("<IBBBBB", mode, 2, kind, base, status, 3))
