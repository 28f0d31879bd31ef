"""The vehicle as a MAVLink client meets it: what it says, and commands that count once confirmed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import PX4, AutopilotKind, MavlinkFrame, Mode, kind_of
from bench.contracts import Origin
from bench.values import value_class

from .._steps import Steps
from ..perception._drift import DriftCheck
from ..perception._pose import PoseHistory, VehiclePose, east_north_of

OWN_SYSTEM, OWN_COMPONENT = 245, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
# The rate that MAVLink asks of every component.
HEARTBEAT_S = 1.0
# PX4 gives offboard control up after COM_OF_LOSS_T (1 s) without a setpoint: five fit into it.
SETPOINT_S = 0.2
ANSWER_S = 1.0
# As MAVSDK does: a command that is not answered is sent four times.
TRIES = 4
# Heartbeats come once a second: two are missing.
SILENT_S = 2.5
# A text that is older is about something else. Chosen, not measured.
RECENT_S = 8.0
# The vehicle is at rest on the ground, so the two positions need not be of the same instant.
SAME_MOMENT_MS = 200

# Messages that the agent reads, and how often it asks for them.
STREAMS_HZ = {
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 10.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
}
# Messages that cannot be switched off or come only when there is cause.
UNSTREAMED = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
}
READ = STREAMS_HZ.keys() | {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
}

# type_mask of position with velocity fed forward, and yaw: acceleration and yaw rate are ignored.
FOLLOW = 2496
GPS = mavlink.MAV_SYS_STATUS_SENSOR_GPS
# MAV_SYS_STATUS_PREARM_CHECK in SYS_STATUS.onboard_control_sensors_health.
READY = 0x10000000


@value_class(frozen=True, slots=True)
class PositionSetpoint:
    """Where to be (map frame, metres above home), where to look (clockwise from north), and how fast."""

    east_m: float
    north_m: float
    height_m: float
    yaw_rad: float
    velocity_en_mps: tuple[float, float] = (0.0, 0.0)


class Sender(Protocol):
    """Where frames go out: a MavlinkLink, as far as the vehicle's client needs it."""

    def send(self, frame: bytes) -> bool: ...


class PilotedVehicle:
    """One multicopter behind one link, flown by PX4 or ArduPilot.

    `receive` before acting on a moment, `send_setpoint` after.
    """

    def __init__(self, link: Sender, poses: PoseHistory) -> None:
        self.now_s = 0.0
        self.poses = poses
        self.armed = False
        self.landed = True
        self.ready = False
        self.kind: AutopilotKind = PX4
        self.mode: Mode = (0, 0)
        self.mode_heard_s = -1.0
        self.heard_s = -math.inf
        self.battery_fraction = 1.0
        self.battery_heard = False  # until then the charge is a guess
        self.gps_ok: bool | None = None  # None until the autopilot has spoken of a working GPS
        self.drift = DriftCheck()
        self.failsafe = False  # the autopilot acts by itself, or says that it should
        self.texts: list[str] = []
        self.malformed = 0
        self.setpoint: PositionSetpoint | None = None
        self._text_s = -math.inf
        self._link = link
        self._mav = mavlink.MAVLink(None, srcSystem=OWN_SYSTEM, srcComponent=OWN_COMPONENT)
        self._target = (1, 1)
        self._acks: list[tuple[int, int]] = []
        self._unwanted: set[int] = set()
        self._beat_s = -math.inf
        self._aimed_s = -math.inf
        self._clock_offset_s = math.inf
        self._origin: Origin | None = None
        self._local_enu: tuple[int, float, float] | None = None  # boot time in ms, east, north
        self._local_origin: tuple[float, float] | None = None  # of LOCAL_POSITION_NED, in the map frame
        self._ground_amsl_m: float | None = None

    @property
    def pose(self) -> VehiclePose | None:
        """The latest estimate; None before the vehicle's place in the map is known."""
        return self.poses.latest()

    @property
    def is_offboard(self) -> bool:
        """Whether the autopilot flies the setpoints."""
        return self.mode == self.kind.offboard

    @property
    def silent(self) -> bool:
        """Nothing came from the autopilot for `SILENT_S` seconds."""
        return self.now_s - self.heard_s > SILENT_S

    @property
    def reason(self) -> str:
        """What the autopilot has said lately, in its own words."""
        lately = self.now_s - self._text_s < RECENT_S
        return "; ".join(self.texts[-2:]) if lately and self.texts else "it gives no reason"

    def locate(self, origin: Origin) -> None:
        """Tell where the map's origin lies; positions are known from here on."""
        self._origin = origin

    # What it hears.

    def receive(self, now_s: float, frames: Iterable[MavlinkFrame]) -> None:
        """Take in what came by this moment."""
        self.now_s = now_s
        for frame in frames:
            if frame.message_id in READ:
                # The global position matters on the ground alone (see `_hear_global`), and decoding costs the most.
                if not (self.armed and frame.message_id == mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT):
                    self._read(frame)
                if self.heard_s >= 0.0:
                    self.heard_s = now_s
            elif frame.message_id not in UNSTREAMED:
                self._unwanted.add(frame.message_id)

    def _read(self, frame: MavlinkFrame) -> None:
        try:
            message = self._mav.decode(bytearray(frame.data))
        except mavlink.MAVError:
            self.malformed += 1
            return
        match frame.message_id:
            case mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                self._hear_place(message)
            case mavlink.MAVLINK_MSG_ID_ATTITUDE:
                self.poses.turn(
                    self._moment_s(message.time_boot_ms), message.roll, message.pitch, message.yaw
                )
            case mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
                self._hear_global(message)
            case mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self._hear_heartbeat(message, frame)
            case mavlink.MAVLINK_MSG_ID_SYS_STATUS:
                self.ready = bool(message.onboard_control_sensors_health & READY)
                self._hear_gps(
                    message.onboard_control_sensors_present, message.onboard_control_sensors_health
                )
                if message.battery_remaining >= 0:
                    self.battery_fraction = message.battery_remaining / 100.0
                    self.battery_heard = True
            case mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
                self.landed = message.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
            case mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
                self._acks.append((message.command, message.result))
            case mavlink.MAVLINK_MSG_ID_STATUSTEXT:
                self.texts = [*self.texts[-7:], message.text.rstrip("\t\0")]
                self._text_s = self.now_s

    def _hear_heartbeat(self, message: object, frame: MavlinkFrame) -> None:
        if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:  # type: ignore[attr-defined]
            return  # a ground station or a camera on the same link
        self._target = (frame.system, frame.component)
        self.heard_s = self.mode_heard_s = self.now_s
        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)  # type: ignore[attr-defined]
        self.failsafe = self.armed and message.system_status >= mavlink.MAV_STATE_CRITICAL  # type: ignore[attr-defined]
        self.kind = kind_of(message.autopilot)  # type: ignore[attr-defined]
        self.mode = self.kind.mode(message.custom_mode)  # type: ignore[attr-defined]

    def _hear_gps(self, present: int, health: int) -> None:
        """Its health bit; before it was well for the first time the autopilot is starting."""
        healthy = bool(present & health & GPS)
        if healthy or self.gps_ok is not None:
            self.gps_ok = healthy
        if not healthy:
            self.drift.suspend(self.now_s)

    def _hear_place(self, message: object) -> None:
        boot_ms, x, y, z = message.time_boot_ms, message.x, message.y, message.z  # type: ignore[attr-defined]
        self._local_enu = (boot_ms, y, x)
        if self._local_origin is not None:
            east_m, north_m = self._local_origin
            velocity = (message.vy, message.vx, -message.vz)  # type: ignore[attr-defined]
            self.drift.take(boot_ms * 1e-3, (y, x), velocity[:2])
            away_east_m, away_north_m = self.drift.offset_en_m
            place = (east_m + y - away_east_m, north_m + x - away_north_m)
            self.poses.place(self._moment_s(boot_ms), *place, -z, velocity)

    def _hear_global(self, message: object) -> None:
        """Find where the local frame lies in the map, on the ground: they do not move against each other."""
        if self.armed or self._origin is None or self._local_enu is None:
            return
        boot_ms, east_m, north_m = self._local_enu
        if abs(boot_ms - message.time_boot_ms) <= SAME_MOMENT_MS:  # type: ignore[attr-defined]
            place = east_north_of(message.lat * 1e-7, message.lon * 1e-7, self._origin)  # type: ignore[attr-defined]
            self._local_origin = (place[0] - east_m, place[1] - north_m)
            self._ground_amsl_m = message.alt * 1e-3  # type: ignore[attr-defined]

    def _moment_s(self, boot_ms: int) -> float:
        """Simulated time of a moment on the autopilot's clock, by the least difference seen on arrival."""
        self._clock_offset_s = min(self._clock_offset_s, self.now_s - boot_ms * 1e-3)
        return boot_ms * 1e-3 + self._clock_offset_s

    # What it says.

    def send_setpoint(self) -> None:
        """Send what is due at this moment: heartbeat and setpoint."""
        if self.now_s - self._beat_s >= HEARTBEAT_S - 1e-6:
            self._beat_s = self.now_s
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    # PX4 sends its texts to ground stations alone.
                    mavlink.MAV_TYPE_GCS,
                    mavlink.MAV_AUTOPILOT_INVALID,
                    0,
                    0,
                    mavlink.MAV_STATE_ACTIVE,
                    3,
                )
            )
        if self.setpoint is not None and self.now_s - self._aimed_s >= SETPOINT_S - 1e-6:
            self._aimed_s = self.now_s
            self._send_setpoint(self.setpoint)

    def _send_setpoint(self, at: PositionSetpoint) -> None:
        assert self._local_origin is not None
        # The autopilot steers by the position that it believes in, its drift included.
        east_m = self._local_origin[0] - self.drift.offset_en_m[0]
        north_m = self._local_origin[1] - self.drift.offset_en_m[1]
        self._send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                round(self.now_s * 1000.0) & 0xFFFFFFFF,
                *self._target,
                mavlink.MAV_FRAME_LOCAL_NED,
                FOLLOW,
                at.north_m - north_m,
                at.east_m - east_m,
                -at.height_m,
                at.velocity_en_mps[1],
                at.velocity_en_mps[0],
                *(0.0,) * 4,
                at.yaw_rad,
                0.0,
            )
        )

    def _send(self, message: mavlink.MAVLink_message) -> None:
        if self._link.send(bytes(message.pack(self._mav))):
            self._mav.seq = (self._mav.seq + 1) % 256

    def _send_command(self, command: int, attempt: int, parameters: tuple[float, ...]) -> None:
        filled = (*parameters, *(0.0,) * (7 - len(parameters)))
        self._send(mavlink.MAVLink_command_long_message(*self._target, command, attempt, *filled))

    # Behaviours.

    def command(self, command: int, *parameters: float, tries: int = TRIES) -> Steps[int | None]:
        """Send a command until it is answered. The final result (MAV_RESULT), or None when nobody answers."""
        for attempt in range(tries):
            self._acks.clear()
            self._send_command(command, attempt, parameters)
            until_s = self.now_s + ANSWER_S
            while self.now_s < until_s:
                yield
                results = [result for what, result in self._acks if what == command]
                if results and results[-1] != mavlink.MAV_RESULT_IN_PROGRESS:
                    return results[-1]
        return None

    def change_mode(self, mode: Mode) -> Steps[bool]:
        """Whether the vehicle took the mode on.

        PX4 answers DO_SET_MODE twice, the first time ACCEPTED whatever was asked: only as many answers as prove it or a
        heartbeat that shows the mode are believed.
        """
        for attempt in range(TRIES):
            self._acks.clear()
            asked_s = self.now_s
            self._send_command(
                mavlink.MAV_CMD_DO_SET_MODE, attempt, (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, *mode)
            )
            while self.now_s < asked_s + 1.5:
                yield
                results = [result for what, result in self._acks if what == mavlink.MAV_CMD_DO_SET_MODE]
                if (self.mode == mode and self.mode_heard_s > asked_s) or results.count(
                    mavlink.MAV_RESULT_ACCEPTED
                ) >= self.kind.mode_answers:
                    self.mode = mode
                    return True
                if any(result != mavlink.MAV_RESULT_ACCEPTED for result in results):
                    break
        return False

    def connect(self) -> Steps[None]:
        """Wait for a heartbeat, then ask for the streams that the agent reads and silence all others."""
        while self.heard_s < 0.0:
            yield
        self._unwanted.clear()  # what is still coming shows up again
        for message_id, rate_hz in STREAMS_HZ.items():
            yield from self.command(
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, round(1e6 / rate_hz), tries=2
            )
        yield from self.silence_the_rest()

    def silence_the_rest(self) -> Steps[None]:
        """Switch off every stream that came and is not read; each once, whether or not that is accepted."""
        done: set[int] = set()
        while remaining := sorted(self._unwanted - done):
            done.add(remaining[0])
            yield from self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, remaining[0], -1.0, tries=1)
        self._unwanted.clear()

    def set_parameter(self, name: str, value: float) -> Steps[None]:
        """Set a float parameter, twice in case one is lost; an autopilot without it flies by its own."""
        for _ in range(2):
            self._send(
                mavlink.MAVLink_param_set_message(
                    *self._target, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
                )
            )
            yield

    def limit_speed(self, speed_mps: float) -> Steps[None]:
        """Let the autopilot fly no faster."""
        yield from self.set_parameter(self.kind.speed_parameter, speed_mps / self.kind.speed_unit_mps)

    def arm(self, until_s: float) -> Steps[bool]:
        """Wait until the autopilot says that it is ready, then arm; try again, until a moment."""
        while self.now_s < until_s:
            if self.armed:
                return True
            if self.ready and self.pose is not None:
                if self.kind.arms_offboard and not self.is_offboard:
                    yield from self.change_mode(self.kind.offboard)
                yield from self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
                yield from self.pause(1.2)  # the heartbeat that shows it
            else:
                yield
        return self.armed

    def take_off(self, height_m: float, until_s: float) -> Steps[bool]:
        """Climb to a height above the ground it stands on; False when it did not get there by a moment."""
        assert self._ground_amsl_m is not None
        amsl_m = self._ground_amsl_m + height_m
        while self.now_s < until_s:
            nan = math.nan
            at = (
                (0.0,) * 6 + (height_m,)
                if self.kind.takes_off_above_home
                else (nan, 0.0, 0.0, nan, nan, nan, amsl_m)
            )
            result = yield from self.command(mavlink.MAV_CMD_NAV_TAKEOFF, *at)
            asked_s = self.now_s
            while result == mavlink.MAV_RESULT_ACCEPTED and self.now_s < min(until_s, asked_s + 20.0):
                if self.pose is not None and self.pose.height_m > 0.8 * height_m:
                    return True
                yield
            yield
        return False

    def go_offboard(self, aim: PositionSetpoint) -> Steps[bool]:
        """Stream the setpoint for a while, as PX4 wants to see first, then hand control to the stream."""
        self.setpoint = aim
        yield from self.pause(0.6)
        return (yield from self.change_mode(self.kind.offboard))

    def pause(self, span_s: float) -> Steps[None]:
        """Wait a span of simulated time."""
        until_s = self.now_s + span_s
        while self.now_s < until_s - 1e-6:
            yield
