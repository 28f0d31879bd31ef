"""A gimbal by the gimbal protocol v2: the manager and, built into the autopilot, the device that it manages.

The device keeps itself level and turns in pan and tilt at up to 90 degrees a second, from 90 degrees below to
30 above the horizon, and all the way around. Angles are the protocol's: pitch up, yaw clockwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..links._enums import MAV_CMD, MAV_MOUNT_MODE
from ..policies._commands import CommandPolicy
from ..state._flight_state import FlightState
from ..state._service import (
    Command,
    CommandHandler,
    CommandResult,
    Fields,
    MessageAnswer,
    MessageHandler,
    MessageSender,
    Stream,
    Values,
)
from ..state._service_context import ServiceContext

# Gimbal device ids 1 to 6 are devices that are no components of their own.
DEVICE = 1
MAX_RATE_RADPS = math.radians(90.0)
MIN_PITCH_RAD, MAX_PITCH_RAD = math.radians(-90.0), math.radians(30.0)
# GIMBAL_DEVICE_FLAGS
_RETRACT, NEUTRAL, _ROLL_LOCK, _PITCH_LOCK, _YAW_LOCK, _VEHICLE_FRAME, _EARTH_FRAME = 1, 2, 4, 8, 16, 32, 64
KNOWN_FLAGS = 127
# GIMBAL_MANAGER_CAP_FLAGS: neutral; pitch, locked; endless yaw, following or locked; points at places.
_CAPABILITIES = 2 | 32 | 128 | 256 | 512 | 1024 | 2048 | 4096 | 131072
_DEVICE_CAPABILITIES = 2 | 32 | 128 | 256 | 512 | 1024 | 2048 | 4096
_NO_CONTROLLER = (0, 0)


@dataclass(frozen=True, slots=True)
class _GimbalTarget:
    """Pitch against the horizon; yaw against north when `locked`, else the nose; and the rates of both."""

    pitch_rad: float
    yaw_rad: float
    locked: bool = False
    pitch_radps: float = 0.0
    yaw_radps: float = 0.0


class Gimbal:
    """Turns and keeps the camera's direction in the flight state; the policy says who may control it."""

    def __init__(self, context: ServiceContext, policy: CommandPolicy, tilt_rad: float) -> None:
        self._context = context
        self._policy = policy
        self._pitch_rad, self._pan_rad = -tilt_rad, 0.0
        self._rest = self._aim = _GimbalTarget(-tilt_rad, 0.0)
        self._place: tuple[float, float, float] | None = None  # north, east, down of a region of interest
        self._turning = (0.0, 0.0)  # pitch and pan, radians per second, during the last step
        self._primary = self._secondary = _NO_CONTROLLER
        self._write(context.flight)

    def handlers(self) -> Mapping[str, MessageHandler]:
        old: dict[str, MessageHandler] = {"MOUNT_CONTROL": self._take_mount_message}
        return {
            **(old if MAV_CMD.DO_MOUNT_CONTROL in self._policy.optional else {}),
            "GIMBAL_MANAGER_SET_PITCHYAW": self._set_pitch_yaw,
            "GIMBAL_MANAGER_SET_ATTITUDE": self._set_attitude,
            "GIMBAL_MANAGER_SET_MANUAL_CONTROL": self._set_manual,
        }

    def commands(self) -> Mapping[int, CommandHandler]:
        mount: dict[int, CommandHandler] = {
            MAV_CMD.DO_MOUNT_CONFIGURE: self._mount_mode,
            MAV_CMD.DO_MOUNT_CONTROL: self._mount_control,
        }
        return {
            **{number: handler for number, handler in mount.items() if number in self._policy.optional},
            MAV_CMD.DO_GIMBAL_MANAGER_PITCHYAW: self._pitch_yaw,
            MAV_CMD.DO_GIMBAL_MANAGER_CONFIGURE: self._configure,
            MAV_CMD.DO_SET_ROI_LOCATION: self._look_at_roi,
            MAV_CMD.DO_SET_ROI_NONE: self._release,
            MAV_CMD.DO_SET_ROI: lambda command: (
                self._look_at_roi(command)
                if self._policy.roi_names_place(command)
                else self._release(command)
            ),
        }

    def answers(self) -> Mapping[str, MessageAnswer]:
        return {
            "GIMBAL_MANAGER_INFORMATION": lambda _: self._information(),
            "GIMBAL_DEVICE_INFORMATION": lambda _: self._device_information(),
        }

    def streams(self) -> Mapping[str, Stream]:
        return {"GIMBAL_DEVICE_ATTITUDE_STATUS": self.attitude_status, "GIMBAL_MANAGER_STATUS": self._status}

    def look_at(self, north_m: float, east_m: float, down_m: float) -> None:
        """Keep pointing at a place, however the vehicle moves."""
        self._place = (north_m, east_m, down_m)

    def release(self) -> None:
        """End pointing at a place: back to where the mount rests."""
        self._place, self._aim = None, self._rest

    def tick(self) -> None:
        flight = self._context.flight
        aim = self._towards(flight, self._place) if self._place else self._moved(self._aim, flight.step_s)
        pan_rad = aim.yaw_rad - flight.yaw_rad if aim.locked else aim.yaw_rad
        most = MAX_RATE_RADPS * flight.step_s
        pitch_by = min(max(aim.pitch_rad - self._pitch_rad, -most), most)
        # The shorter way around; the yaw axis has no stop.
        pan_by = min(max(math.remainder(pan_rad - self._pan_rad, 2.0 * math.pi), -most), most)
        self._aim = aim
        self._pitch_rad += pitch_by
        self._pan_rad = math.remainder(self._pan_rad + pan_by, 2.0 * math.pi)
        self._turning = (pitch_by / flight.step_s, pan_by / flight.step_s)
        self._write(flight)

    def _write(self, flight: FlightState) -> None:
        flight.camera_pan_rad, flight.camera_tilt_rad = self._pan_rad, -self._pitch_rad

    def _towards(self, flight: FlightState, place: tuple[float, float, float]) -> _GimbalTarget:
        north, east, down = place[0] - flight.north_m, place[1] - flight.east_m, place[2] - flight.down_m
        pitch_rad = _clipped(math.atan2(-down, math.hypot(north, east)))
        return _GimbalTarget(pitch_rad, math.atan2(east, north), locked=True)

    def _moved(self, aim: _GimbalTarget, span_s: float) -> _GimbalTarget:
        if not aim.pitch_radps and not aim.yaw_radps:
            return aim
        pitch_rad = _clipped(aim.pitch_rad + aim.pitch_radps * span_s)
        yaw_rad = math.remainder(aim.yaw_rad + aim.yaw_radps * span_s, 2.0 * math.pi)
        return _GimbalTarget(pitch_rad, yaw_rad, aim.locked, aim.pitch_radps, aim.yaw_radps)

    def turn(
        self, flags: int, pitch_rad: float, yaw_rad: float, pitch_radps: float, yaw_radps: float
    ) -> None:
        """Angles and rates as the protocol gives them: NaN leaves an angle where it is, and a rate at zero."""
        flight = self._context.flight
        self._place = None
        if flags & NEUTRAL:
            self._aim = _GimbalTarget(0.0, 0.0)
            return
        locked = bool(flags & _YAW_LOCK)
        # A locked yaw is in the earth frame unless the flags name the vehicle frame, as the protocol defines.
        in_earth = bool(flags & _EARTH_FRAME) or (locked and not flags & _VEHICLE_FRAME)
        nose_rad = flight.yaw_rad
        if not math.isfinite(yaw_rad):
            yaw_rad, in_earth = self._pan_rad, False
        if locked and not in_earth:
            yaw_rad += nose_rad
        elif in_earth and not locked:
            yaw_rad -= nose_rad
        self._aim = _GimbalTarget(
            _clipped(pitch_rad) if math.isfinite(pitch_rad) else self._pitch_rad,
            math.remainder(yaw_rad, 2.0 * math.pi),
            locked,
            _rate(pitch_radps),
            _rate(yaw_radps),
        )

    def _pitch_yaw(self, command: Command) -> CommandResult | None:
        pitch, yaw, pitch_rate, yaw_rate, flags = (math.radians(param) for param in command.params[:5])
        flags = command.params[4]
        if not _is_our_device(command.params[6]) or not 0 <= flags <= KNOWN_FLAGS or int(flags) & _RETRACT:
            return CommandResult.DENIED
        if not self._may_control(command.sender):
            return CommandResult.DENIED
        self.turn(int(flags), pitch, yaw, pitch_rate, yaw_rate)
        return CommandResult.ACCEPTED

    def _mount_mode(self, command: Command) -> CommandResult | None:
        mode = command.params[0]
        if mode == MAV_MOUNT_MODE.NEUTRAL:
            self.turn(NEUTRAL, 0.0, 0.0, math.nan, math.nan)
        return CommandResult.ACCEPTED if mode in range(MAV_MOUNT_MODE.WPNEXT_OFFSET) else CommandResult.FAILED

    def _mount_control(self, command: Command) -> CommandResult | None:
        """DO_MOUNT_CONTROL: pitch, roll and yaw in degrees, yaw from the nose; the mode behind them."""
        pitch, _, yaw = command.params[:3]
        if command.params[6] == MAV_MOUNT_MODE.MAVLINK_TARGETING:
            self.turn(0, math.radians(pitch), math.radians(yaw), math.nan, math.nan)
            return CommandResult.ACCEPTED
        return self._mount_mode(replace(command, params=(command.params[6], *command.params[1:])))

    def _take_mount_message(self, m: Any, sender: MessageSender) -> None:
        """MOUNT_CONTROL, in hundredths of degrees."""
        self.turn(0, math.radians(m.input_a / 100.0), math.radians(m.input_c / 100.0), math.nan, math.nan)

    def _configure(self, command: Command) -> CommandResult | None:
        requester = (command.sender.system, command.sender.component)
        p = command.params
        if not _is_our_device(p[6]) or not all(-3 <= param <= 255 for param in p[:4]):
            return CommandResult.DENIED
        self._primary = _controller(p[0], p[1], self._primary, requester)
        self._secondary = _controller(p[2], p[3], self._secondary, requester)
        return CommandResult.ACCEPTED

    def _may_control(self, sender: MessageSender) -> bool:
        requester = (sender.system, sender.component)
        if not self._policy.gimbal_needs_control and self._primary == _NO_CONTROLLER:
            return True
        return requester in (self._primary, self._secondary)

    def _look_at_roi(self, command: Command) -> CommandResult | None:
        latitude, longitude, altitude = command.params[4:7]
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and math.isfinite(altitude)):
            return CommandResult.DENIED
        context, flight = self._context, self._context.flight
        above_sea_m = self._policy.altitude_amsl_m(flight, command.frame, altitude)
        self.look_at(*context.frame.to_local_m(latitude, longitude), flight.origin.altitude_m - above_sea_m)
        return CommandResult.ACCEPTED

    def _release(self, command: Command) -> CommandResult | None:
        self.release()
        return CommandResult.ACCEPTED

    def _set_pitch_yaw(self, m: Any, sender: MessageSender) -> None:
        if self._accepts(m, sender):
            self.turn(m.flags, m.pitch, m.yaw, m.pitch_rate, m.yaw_rate)

    def _set_attitude(self, m: Any, sender: MessageSender) -> None:
        if not self._accepts(m, sender):
            return
        w, x, y, z = m.q
        pitch = yaw = math.nan
        if all(math.isfinite(value) for value in m.q):
            pitch = math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
            yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        self.turn(m.flags, pitch, yaw, m.angular_velocity_y, m.angular_velocity_z)

    def _set_manual(self, m: Any, sender: MessageSender) -> None:
        """Turn by sticks, shares of the highest rate; angles by stick are not offered, and NaN is no rate."""
        if self._accepts(m, sender):
            self.turn(m.flags, math.nan, math.nan, m.pitch_rate * MAX_RATE_RADPS, m.yaw_rate * MAX_RATE_RADPS)

    def _accepts(self, m: Any, sender: MessageSender) -> bool:
        return _is_our_device(m.gimbal_device_id) and not m.flags & _RETRACT and self._may_control(sender)

    def _flags(self) -> int:
        return _ROLL_LOCK | _PITCH_LOCK | (_YAW_LOCK | _EARTH_FRAME if self._aim.locked else _VEHICLE_FRAME)

    def attitude_status(self) -> Values:
        """GIMBAL_DEVICE_ATTITUDE_STATUS; the yaw of `q` is in the frame that its flags name."""
        flight = self._context.flight
        yaw = self._pan_rad + (flight.yaw_rad if self._aim.locked else 0.0)
        pitch_radps, yaw_radps = self._turning
        velocity = (0.0, pitch_radps, yaw_radps)
        return (
            *(flight.time_ms, *level_quaternion(self._pitch_rad, yaw), *velocity, 0, self._flags(), 0, 0),
            *(flight.yaw_rad, flight.r_radps, DEVICE),
        )

    def _status(self) -> Values:
        return (self._context.flight.time_ms, self._flags(), DEVICE, *self._primary, *self._secondary)

    def _information(self) -> Fields:
        limits = {
            "pitch_min": MIN_PITCH_RAD,
            "pitch_max": MAX_PITCH_RAD,
            "yaw_min": -math.pi,
            "yaw_max": math.pi,
        }
        return {
            "time_boot_ms": self._context.flight.time_ms,
            "cap_flags": _CAPABILITIES,
            "gimbal_device_id": DEVICE,
            **limits,
        }

    def _device_information(self) -> Fields:
        names = {"vendor_name": b"REBAR", "model_name": b"level gimbal"}
        return {**self._information(), **names, "cap_flags": _DEVICE_CAPABILITIES}


def level_quaternion(pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """w, x, y, z of a pitch and a yaw without roll."""
    cp, sp = math.cos(pitch_rad / 2.0), math.sin(pitch_rad / 2.0)
    cy, sy = math.cos(yaw_rad / 2.0), math.sin(yaw_rad / 2.0)
    return (cp * cy, -sp * sy, sp * cy, cp * sy)


def _controller(
    system: float, component: float, current: tuple[int, int], requester: tuple[int, int]
) -> tuple[int, int]:
    """The controller after DO_GIMBAL_MANAGER_CONFIGURE: -1 leaves it, -2 takes, -3 gives back, 0 is none."""
    if system == -2 or component == -2:
        return requester
    if system == -3 or component == -3:
        return _NO_CONTROLLER if current == requester else current
    return (current[0] if system == -1 else int(system), current[1] if component == -1 else int(component))


def _is_our_device(device: float) -> bool:
    return device in (0, DEVICE)


def _clipped(pitch_rad: float) -> float:
    return min(max(pitch_rad, MIN_PITCH_RAD), MAX_PITCH_RAD)


def _rate(radps: float) -> float:
    return min(max(radps, -MAX_RATE_RADPS), MAX_RATE_RADPS) if math.isfinite(radps) else 0.0
