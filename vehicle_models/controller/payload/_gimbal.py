"""A gimbal by the gimbal protocol v2: the manager and, built into the autopilot, the device that it manages.

The device keeps roll and pitch level by itself and turns in pan and tilt, no faster than 90 degrees a second, between 90
degrees below and 30 above the horizon, without end around. Angles are the protocol's: pitch up, yaw clockwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from .._flight import Flight
from .._personality import Personality
from .._service import Command, CommandHandler, Handler, Result, Sender
from .._service_context import ServiceContext

PITCHYAW, CONFIGURE = 1000, 1001
ROI_LOCATION, ROI_NONE, ROI = 195, 197, 201
MOUNT_CONFIGURE, MOUNT_CONTROL = 204, 205
_NEUTRAL_MODE, _ANGLES_MODE, _MODES = 1, 2, range(7)  # MAV_MOUNT_MODE
_PLACE_KIND = 3  # MAV_ROI_LOCATION
DEVICE = 1  # 1 to 6: a device that is not a component of its own
RATE_RADPS = math.radians(90.0)
LOWEST_RAD, HIGHEST_RAD = math.radians(-90.0), math.radians(30.0)
_RETRACT, NEUTRAL, _ROLL_LOCK, _PITCH_LOCK, _YAW_LOCK, _VEHICLE_FRAME, _EARTH_FRAME = 1, 2, 4, 8, 16, 32, 64
KNOWN_FLAGS = 127
# Neutral; pitch axis, locked; yaw axis, following or locked, without end, in earth frame; points at places.
_CAPABILITIES = 2 | 32 | 128 | 256 | 512 | 1024 | 2048 | 4096 | 131072
_DEVICE_CAPABILITIES = 2 | 32 | 128 | 256 | 512 | 1024 | 2048 | 4096
_NOBODY = (0, 0)


@dataclass(frozen=True, slots=True)
class _Aim:
    """Pitch against the horizon; yaw against north when `locked`, against the nose else; and how both go on changing."""

    pitch_rad: float
    yaw_rad: float
    locked: bool = False
    pitch_radps: float = 0.0
    yaw_radps: float = 0.0


class Gimbal:
    """Writes where the camera looks into the flight. Who is in control is as the personality wants it."""

    def __init__(self, board: ServiceContext, tilt_rad: float) -> None:
        self._board = board
        self._pitch_rad, self._pan_rad = -tilt_rad, 0.0
        self._rest = self._aim = _Aim(-tilt_rad, 0.0)
        self._place: tuple[float, float, float] | None = None  # north, east, down of a region of interest
        self._turning = (0.0, 0.0)  # pitch and pan, radians per second, during the last step
        self._primary = self._secondary = _NOBODY
        self._write(board.flight)

    def handlers(self) -> Mapping[str, Handler]:
        mount = {"MOUNT_CONTROL": self._mount_message} if self._board.personality.mount_commands else {}
        return {
            **mount,
            "GIMBAL_MANAGER_SET_PITCHYAW": self._set_pitch_yaw,
            "GIMBAL_MANAGER_SET_ATTITUDE": self._set_attitude,
            "GIMBAL_MANAGER_SET_MANUAL_CONTROL": self._set_manual,
        }

    def commands(self) -> Mapping[int, CommandHandler]:
        mount: dict[int, CommandHandler] = {MOUNT_CONFIGURE: self._mount_mode, MOUNT_CONTROL: self._mount}
        return {
            **(mount if self._board.personality.mount_commands else {}),
            PITCHYAW: self._pitch_yaw,
            CONFIGURE: self._configure,
            ROI_LOCATION: self._roi,
            ROI_NONE: lambda _: self._forget(),
            ROI: lambda command: self._roi(command) if names_place(self._board.personality, command) else self._forget(),
        }

    def answers(self) -> Mapping[str, Any]:
        """Messages on request."""
        return {
            "GIMBAL_MANAGER_INFORMATION": lambda _: self._information(),
            "GIMBAL_DEVICE_INFORMATION": lambda _: self._device(),
        }

    def streams(self) -> Mapping[str, Any]:
        """Messages that may be streamed, as functions that give their values in wire order."""
        return {"GIMBAL_DEVICE_ATTITUDE_STATUS": self.attitude_status, "GIMBAL_MANAGER_STATUS": self._status}

    def look_at(self, north_m: float, east_m: float, down_m: float) -> None:
        """Keep pointing at a place, however the vehicle moves."""
        self._place = (north_m, east_m, down_m)

    def forget(self) -> None:
        """Give up the place pointed at: back to where the mount rests."""
        self._place, self._aim = None, self._rest

    def tick(self) -> None:
        flight = self._board.flight
        aim = self._towards(flight, self._place) if self._place else self._moved(self._aim, flight.step_s)
        pan_rad = aim.yaw_rad - flight.yaw_rad if aim.locked else aim.yaw_rad
        most = RATE_RADPS * flight.step_s
        pitch_by = min(max(aim.pitch_rad - self._pitch_rad, -most), most)
        pan_by = min(max(math.remainder(pan_rad - self._pan_rad, 2.0 * math.pi), -most), most)
        self._aim = aim
        self._pitch_rad += pitch_by
        self._pan_rad = math.remainder(self._pan_rad + pan_by, 2.0 * math.pi)
        self._turning = (pitch_by / flight.step_s, pan_by / flight.step_s)
        self._write(flight)

    def _write(self, flight: Flight) -> None:
        flight.camera_pan_rad, flight.camera_tilt_rad = self._pan_rad, -self._pitch_rad

    def _towards(self, flight: Flight, place: tuple[float, float, float]) -> _Aim:
        north, east, down = place[0] - flight.north_m, place[1] - flight.east_m, place[2] - flight.down_m
        pitch_rad = _clipped(math.atan2(-down, math.hypot(north, east)))
        return _Aim(pitch_rad, math.atan2(east, north), locked=True)

    def _moved(self, aim: _Aim, span_s: float) -> _Aim:
        if not aim.pitch_radps and not aim.yaw_radps:
            return aim
        pitch_rad = _clipped(aim.pitch_rad + aim.pitch_radps * span_s)
        yaw_rad = math.remainder(aim.yaw_rad + aim.yaw_radps * span_s, 2.0 * math.pi)
        return _Aim(pitch_rad, yaw_rad, aim.locked, aim.pitch_radps, aim.yaw_radps)

    def turn(self, flags: int, pitch_rad: float, yaw_rad: float, pitch_radps: float, yaw_radps: float) -> None:
        """Angles and rates as the protocol gives them: NaN leaves an angle where it is, and a rate at zero."""
        flight = self._board.flight
        self._place = None
        if flags & NEUTRAL:
            self._aim = _Aim(0.0, 0.0)
            return
        locked = bool(flags & _YAW_LOCK)
        in_earth = bool(flags & _EARTH_FRAME) or (locked and not flags & _VEHICLE_FRAME)
        nose_rad = flight.yaw_rad
        if not math.isfinite(yaw_rad):
            yaw_rad, in_earth = self._pan_rad, False
        if locked and not in_earth:
            yaw_rad += nose_rad
        elif in_earth and not locked:
            yaw_rad -= nose_rad
        self._aim = _Aim(
            _clipped(pitch_rad) if math.isfinite(pitch_rad) else self._pitch_rad,
            math.remainder(yaw_rad, 2.0 * math.pi),
            locked,
            _rate(pitch_radps),
            _rate(yaw_radps),
        )

    def _pitch_yaw(self, command: Command) -> Result | None:
        pitch, yaw, pitch_rate, yaw_rate, flags = (math.radians(one) for one in command.params[:5])
        flags = command.params[4]
        if not _for_us(command.params[6]) or not 0 <= flags <= KNOWN_FLAGS or int(flags) & _RETRACT:
            return Result.DENIED
        if not self._may(command.sender):
            return Result.DENIED
        self.turn(int(flags), pitch, yaw, pitch_rate, yaw_rate)
        return Result.ACCEPTED

    def _mount_mode(self, command: Command) -> Result | None:
        mode = command.params[0]
        if mode == _NEUTRAL_MODE:
            self.turn(NEUTRAL, 0.0, 0.0, math.nan, math.nan)
        return Result.ACCEPTED if mode in _MODES else Result.FAILED

    def _mount(self, command: Command) -> Result | None:
        """DO_MOUNT_CONTROL: pitch, roll and yaw in degrees, yaw from the nose; the mode behind them."""
        pitch, _, yaw = command.params[:3]
        if command.params[6] == _ANGLES_MODE:
            self.turn(0, math.radians(pitch), math.radians(yaw), math.nan, math.nan)
            return Result.ACCEPTED
        return self._mount_mode(replace(command, params=(command.params[6], *command.params[1:])))

    def _mount_message(self, m: Any, sender: Sender) -> None:
        """MOUNT_CONTROL, in hundredths of degrees."""
        self.turn(0, math.radians(m.input_a / 100.0), math.radians(m.input_c / 100.0), math.nan, math.nan)

    def _configure(self, command: Command) -> Result | None:
        asker = (command.sender.system, command.sender.component)
        p = command.params
        if not _for_us(p[6]) or not all(-3 <= one <= 255 for one in p[:4]):
            return Result.DENIED
        self._primary = _controller(p[0], p[1], self._primary, asker)
        self._secondary = _controller(p[2], p[3], self._secondary, asker)
        return Result.ACCEPTED

    def _may(self, sender: Sender) -> bool:
        asker = (sender.system, sender.component)
        if not self._board.personality.gimbal_needs_control and self._primary == _NOBODY:
            return True
        return asker in (self._primary, self._secondary)

    def _roi(self, command: Command) -> Result | None:
        latitude, longitude, altitude = command.params[4:7]
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and math.isfinite(altitude)):
            return Result.DENIED
        board, flight = self._board, self._board.flight
        above_sea_m = board.personality.altitude_amsl_m(flight, command.frame, altitude)
        self.look_at(*board.airframe.to_local_m(latitude, longitude), flight.origin.altitude_m - above_sea_m)
        return Result.ACCEPTED

    def _forget(self) -> Result | None:
        self.forget()
        return Result.ACCEPTED

    def _set_pitch_yaw(self, m: Any, sender: Sender) -> None:
        if self._heeds(m, sender):
            self.turn(m.flags, m.pitch, m.yaw, m.pitch_rate, m.yaw_rate)

    def _set_attitude(self, m: Any, sender: Sender) -> None:
        if not self._heeds(m, sender):
            return
        w, x, y, z = m.q
        pitch = yaw = math.nan
        if all(math.isfinite(one) for one in m.q):
            pitch = math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
            yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        self.turn(m.flags, pitch, yaw, m.angular_velocity_y, m.angular_velocity_z)

    def _set_manual(self, m: Any, sender: Sender) -> None:
        """Sticks: shares of the fastest rate. Angles by stick are not offered; NaN and they are no rate."""
        if self._heeds(m, sender):
            self.turn(m.flags, math.nan, math.nan, m.pitch_rate * RATE_RADPS, m.yaw_rate * RATE_RADPS)

    def _heeds(self, m: Any, sender: Sender) -> bool:
        return _for_us(m.gimbal_device_id) and not m.flags & _RETRACT and self._may(sender)

    def _flags(self) -> int:
        return _ROLL_LOCK | _PITCH_LOCK | (_YAW_LOCK | _EARTH_FRAME if self._aim.locked else _VEHICLE_FRAME)

    def attitude_status(self) -> tuple[Any, ...]:
        """GIMBAL_DEVICE_ATTITUDE_STATUS; the yaw of `q` is in the frame that its flags name."""
        flight = self._board.flight
        yaw = self._pan_rad + (flight.yaw_rad if self._aim.locked else 0.0)
        pitch_radps, yaw_radps = self._turning
        velocity = (0.0, pitch_radps, yaw_radps)
        return (
            *(flight.time_ms, *level_quaternion(self._pitch_rad, yaw), *velocity, 0, self._flags(), 0, 0),
            *(flight.yaw_rad, flight.r_radps, DEVICE),
        )

    def _status(self) -> tuple[Any, ...]:
        return (self._board.flight.time_ms, self._flags(), DEVICE, *self._primary, *self._secondary)

    def _information(self) -> dict[str, Any]:
        limits = {"pitch_min": LOWEST_RAD, "pitch_max": HIGHEST_RAD, "yaw_min": -math.pi, "yaw_max": math.pi}
        return {"time_boot_ms": self._board.flight.time_ms, "cap_flags": _CAPABILITIES, "gimbal_device_id": DEVICE, **limits}

    def _device(self) -> dict[str, Any]:
        names = {"vendor_name": b"REBAR", "model_name": b"level gimbal"}
        return {**self._information(), **names, "cap_flags": _DEVICE_CAPABILITIES}


def level_quaternion(pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """w, x, y, z of what is pitched and turned and does not roll."""
    cp, sp = math.cos(pitch_rad / 2.0), math.sin(pitch_rad / 2.0)
    cy, sy = math.cos(yaw_rad / 2.0), math.sin(yaw_rad / 2.0)
    return (cp * cy, -sp * sy, sp * cy, cp * sy)


def names_place(personality: Personality, command: Command) -> bool:
    """Whether a DO_SET_ROI or its like is of a place, and not the end of one."""
    if command.number != ROI or personality.roi_has_kind:
        return command.number == ROI_LOCATION or command.params[0] == _PLACE_KIND
    return any(command.params[4:6])


def _controller(system: float, component: float, now: tuple[int, int], asker: tuple[int, int]) -> tuple[int, int]:
    """Who controls after CONFIGURE: -1 leaves it, -2 takes it, -3 gives it back, 0 is nobody."""
    if system == -2 or component == -2:
        return asker
    if system == -3 or component == -3:
        return _NOBODY if now == asker else now
    return (now[0] if system == -1 else int(system), now[1] if component == -1 else int(component))


def _for_us(device: float) -> bool:
    return device in (0, DEVICE)


def _clipped(pitch_rad: float) -> float:
    return min(max(pitch_rad, LOWEST_RAD), HIGHEST_RAD)


def _rate(radps: float) -> float:
    return min(max(radps, -RATE_RADPS), RATE_RADPS) if math.isfinite(radps) else 0.0
