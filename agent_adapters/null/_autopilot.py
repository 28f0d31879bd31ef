"""The least of a MAVLink client that takes an aircraft up, sends it to a place, and brings it down.

It uses the autopilot's own modes, so nothing has to be streamed: PX4's takeoff ends in Hold, ArduPilot's stays in GUIDED,
and DO_REPOSITION flies.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import PX4, AutopilotKind, MavlinkLink, Moment, kind_of
from bench.geodesy import metres_of_degree, wrapped

LINK = "onboard"
_OWN_SYSTEM = 246
_STREAMS_HZ = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 2.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
}
_READ = {mavlink.MAVLINK_MSG_ID_HEARTBEAT, *_STREAMS_HZ}
# MAV_SYS_STATUS_PREARM_CHECK in SYS_STATUS.onboard_control_sensors_health.
_READY = 0x10000000
# Between two attempts at the same command: an answer, and the heartbeat that shows its effect, take 1.2 s.
_AGAIN_S = 3.0


class Autopilot:
    """One vehicle behind one link. `receive` each moment before anything is sent."""

    def __init__(self, link: MavlinkLink) -> None:
        self.armed = False
        self.landed = True
        self.height_m = 0.0
        self._link = link
        self._mav = mavlink.MAVLink(None, srcSystem=_OWN_SYSTEM)
        self._target = (1, 1)
        self._kind: AutopilotKind = PX4
        self._now_s = 0.0
        self._beat_s = -math.inf
        self._connected = False
        self._ready = False
        self._latitude_longitude_deg = (0.0, 0.0)
        self._ground_amsl_m: float | None = None

    def receive(self, moment: Moment) -> None:
        """Take in what came by this moment, and send the heartbeat that is due."""
        self._now_s = moment.time.s
        for frame in moment.frames[LINK]:
            if frame.message_id in _READ:
                self._read(self._mav.decode(bytearray(frame.data)), (frame.system, frame.component))
        if self._now_s - self._beat_s >= 1.0 - 1e-6:
            self._beat_s = self._now_s
            kind, autopilot = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID
            self._send(mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, mavlink.MAV_STATE_ACTIVE, 3))

    def _read(self, message: Any, sender: tuple[int, int]) -> None:
        match message.get_msgId():
            case mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self._target = sender
                if message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                    self._kind = kind_of(message.autopilot)
                self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                if not self._connected:
                    self._connected = True
                    self._ask_for_streams()
            case mavlink.MAVLINK_MSG_ID_SYS_STATUS:
                self._ready = bool(message.onboard_control_sensors_health & _READY)
            case mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
                self.landed = message.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
            case mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
                self._latitude_longitude_deg = (message.lat * 1e-7, message.lon * 1e-7)
                self.height_m = message.relative_alt * 1e-3
                if not self.armed:
                    self._ground_amsl_m = message.alt * 1e-3

    def _ask_for_streams(self) -> None:
        for message_id, rate_hz in _STREAMS_HZ.items():
            self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)

    def _send(self, message: Any) -> None:
        if self._link.send(bytes(message.pack(self._mav))):
            self._mav.seq = (self._mav.seq + 1) % 256

    def _command(self, command: int, *parameters: float) -> None:
        filled = (*parameters, *(0.0,) * (7 - len(parameters)))
        self._send(mavlink.MAVLink_command_long_message(*self._target, command, 0, *filled))

    def place(self, origin: dict[str, float]) -> tuple[float, float]:
        """East and north of the mission's origin, in metres."""
        east_m, north_m = metres_of_degree(origin["latitude_deg"], origin["altitude_m"])
        latitude_deg, longitude_deg = self._latitude_longitude_deg
        return (
            wrapped(longitude_deg - origin["longitude_deg"]) * east_m,
            (latitude_deg - origin["latitude_deg"]) * north_m,
        )

    # Behaviours: an iteration for each moment. None of them gives up: the session has its own end.

    def take_off(self, height_m: float) -> Iterator[None]:
        """Arm as soon as the autopilot is ready, and climb to a height above the ground."""
        asked_s = -math.inf
        while self.height_m < 0.8 * height_m:
            if self._now_s - asked_s >= _AGAIN_S and self._ready and self._ground_amsl_m is not None:
                asked_s = self._now_s
                if not self.armed:
                    if self._kind.arms_offboard:
                        mode = (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, *self._kind.offboard)
                        self._command(mavlink.MAV_CMD_DO_SET_MODE, *mode)
                    self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
                elif self.landed and self._kind.takes_off_above_home:
                    self._command(mavlink.MAV_CMD_NAV_TAKEOFF, *(0.0,) * 6, height_m)
                elif self.landed:
                    nan = math.nan
                    amsl_m = self._ground_amsl_m + height_m
                    self._command(mavlink.MAV_CMD_NAV_TAKEOFF, nan, 0.0, 0.0, nan, nan, nan, amsl_m)
            yield

    def go_to(
        self, place: tuple[float, float], height_m: float, speed_mps: float, origin: dict[str, float]
    ) -> None:
        """Send the vehicle to a place in the map, at a height above the ground it started from."""
        assert self._ground_amsl_m is not None
        east_m, north_m = metres_of_degree(origin["latitude_deg"], origin["altitude_m"])
        latitude_deg = origin["latitude_deg"] + place[1] / north_m
        longitude_deg = wrapped(origin["longitude_deg"] + place[0] / east_m)
        self._send(
            mavlink.MAVLink_command_int_message(
                *self._target,
                mavlink.MAV_FRAME_GLOBAL,
                mavlink.MAV_CMD_DO_REPOSITION,
                0,
                0,
                speed_mps,
                mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE,
                0.0,
                math.nan,
                round(latitude_deg * 1e7),
                round(longitude_deg * 1e7),
                self._ground_amsl_m + height_m,
            )
        )

    def land(self) -> Iterator[None]:
        """Come down where it is, until the autopilot has disarmed."""
        asked_s = -math.inf
        while self.armed:
            # The autopilot may be deaf for a while, or fly by itself; it lands where it is asked again.
            if self._now_s - asked_s >= 10.0:
                asked_s = self._now_s
                self._command(mavlink.MAV_CMD_NAV_LAND, 0.0, 0.0, 0.0, math.nan, math.nan, math.nan)
            yield
