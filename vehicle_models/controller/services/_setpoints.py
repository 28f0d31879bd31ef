"""Setpoints of a companion: offboard in PX4's words, guided in ArduPilot's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bench.contracts import Vector

from .._flight import Attitude, Behaviour, Flight, Target
from .._service import CommandHandler, Handler, Sender
from .._service_context import ServiceContext
from ..guidance._guidance import Guidance
from ..guidance._manoeuvres import Follow
from ..telemetry._texts import CRITICAL

_FORCE, _NO_YAW, _NO_YAW_RATE = 0x200, 0x400, 0x800
_NO_ROLL_RATE, _NO_PITCH_RATE, _NO_TURN_RATE, _NO_THRUST, _NO_ATTITUDE = 1, 2, 4, 64, 128
_LOCAL, _GLOBAL = 84, 86
_FAR = 1e6  # metres or anything else: beyond it nothing is meant seriously
_NAN3 = (math.nan,) * 3


@dataclass(frozen=True, slots=True)
class _Wish:
    """One message in north, east, down; NaN on an axis about which it says nothing."""

    position: Vector
    velocity: Vector
    acceleration: Vector
    yaw_rad: float
    yawrate_radps: float

    @property
    def empty(self) -> bool:
        return all(math.isnan(one) for one in (*self.position, *self.velocity, *self.acceleration))

    @property
    def sane(self) -> bool:
        numbers = (*self.position, *self.velocity, *self.acceleration, self.yaw_rad, self.yawrate_radps)
        return not any([abs(one) >= _FAR for one in numbers])  # noqa: C419 (a generator takes twice as long)


class Setpoints:
    """SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT, SET_ATTITUDE_TARGET."""

    def __init__(self, board: ServiceContext, guidance: Guidance) -> None:
        self._board = board
        self._guidance = guidance
        self._last_ns: int | None = None
        self._lapses = False
        self._last: tuple[Target, tuple[bool, bool]] | None = None
        self.ignored = 0

    def handlers(self) -> Mapping[str, Handler]:
        return {
            "SET_POSITION_TARGET_LOCAL_NED": self._local,
            "SET_POSITION_TARGET_GLOBAL_INT": self._global,
            "SET_ATTITUDE_TARGET": self._attitude,
        }

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        """A companion that has fallen silent where that ends its motion, but not its mode."""
        board = self._board
        if (
            not board.personality.returns_to_setpoints
            and self._lapses
            and not self.fresh()
            and isinstance(self._guidance.manoeuvre, Follow)
        ):
            self._guidance.manoeuvre.lapse(board.flight)
            self._lapses = False

    def fresh(self) -> bool:
        """Whether setpoints have come within the timeout."""
        return self._last_ns is not None and self._board.flight.time_ns - self._last_ns < round(
            self._guidance.limits.setpoint_timeout_s * 1e9
        )

    def resume(self) -> None:
        """Go on with the last setpoint, after the mode was entered again."""
        if self._last and isinstance(self._guidance.manoeuvre, Follow):
            self._guidance.manoeuvre.give(self._last[0], self._board.flight, self._last[1])

    def _local(self, m: Any, sender: Sender) -> None:
        board, flight = self._board, self._board.flight
        if self._unwanted():
            return
        kind = board.personality.local_frames.get(m.coordinate_frame)
        if kind is None:
            self._refuse(board.personality.bad_local_frame.format(m.coordinate_frame))
            return
        position, velocity, acceleration = self._groups(m, (m.x, m.y, m.z))
        yaw = math.nan if m.type_mask & _NO_YAW else m.yaw
        if kind == "body-velocity":
            position = _NAN3
            velocity, acceleration = _body_to_ned(velocity, flight), _body_to_ned(acceleration, flight)
        elif kind == "body":
            position, velocity = _turned(position, flight.yaw_rad), _turned(velocity, flight.yaw_rad)
            acceleration = _turned(acceleration, flight.yaw_rad)
            yaw += flight.yaw_rad
        if kind in ("body", "offset"):
            position = (position[0] + flight.north_m, position[1] + flight.east_m, position[2] + flight.down_m)
        self._take("SET_POSITION_TARGET_LOCAL_NED", m, _Wish(position, velocity, acceleration, yaw, _yawrate(m)))

    def _global(self, m: Any, sender: Sender) -> None:
        board, flight = self._board, self._board.flight
        if self._unwanted():
            return
        position, velocity, acceleration = self._groups(m, (0.0, 0.0, m.alt))
        if not math.isnan(sum(position)):
            kind = board.personality.global_frames.get(m.coordinate_frame)
            if kind is None:
                severity, text = board.personality.bad_global_frame
                self._stop()
                board.texts.say(severity, text.format(m.coordinate_frame))
                return
            if abs(m.lat_int) > 900_000_000 or abs(m.lon_int) > 1_800_000_000:
                self._stop()
                return
            north, east = board.airframe.to_local_m(m.lat_int * 1e-7, m.lon_int * 1e-7)
            ground = {"home": (flight.home or flight.origin).altitude_m, "ground": flight.origin.altitude_m}
            position = (north, east, flight.origin.altitude_m - m.alt - ground.get(kind, 0.0))
            if board.personality.fence.keeps_setpoints and not board.allows(*position):
                self._stop()
                return
        elif not all(math.isnan(one) for one in position):
            position = _NAN3
        yaw = math.nan if m.type_mask & _NO_YAW else m.yaw
        self._take("SET_POSITION_TARGET_GLOBAL_INT", m, _Wish(position, velocity, acceleration, yaw, _yawrate(m)))

    def _groups(self, m: Any, place: Vector) -> tuple[Vector, Vector, Vector]:
        """Position, velocity and acceleration with NaN for what the mask leaves out."""
        personality = self._board.personality
        whole = personality.axis_groups
        if m.get_msgId() == _LOCAL and personality.local_frames.get(m.coordinate_frame) == "body-velocity":
            whole = True
        mask = m.type_mask
        velocity, acceleration = (m.vx, m.vy, m.vz), (m.afx, m.afy, m.afz)
        return _said(place, mask, whole), _said(velocity, mask >> 3, whole), _said(acceleration, mask >> 6, whole)

    def _take(self, name: str, m: Any, wish: _Wish) -> None:
        personality = self._board.personality
        if m.type_mask & _FORCE and (m.type_mask >> 6 & 7) != 7:
            self._complain(f"{name} force not supported")
            return
        if personality.axis_groups and not self._makes_sense(m, wish):
            self._stop()
            return
        if wish.empty or not wish.sane:
            self._refuse(None if m.get_msgId() == _GLOBAL else f"{name} invalid")
            return
        target, pushes = self._target(wish)
        self._lapses = target.north_east_m is None or personality.position_setpoints_lapse
        self._give(target, pushes)

    def _makes_sense(self, m: Any, wish: _Wish) -> bool:
        """Where axes come in groups, a group that is not masked must be numbers, and the groups must be a known set."""
        masked = [(m.type_mask >> shift & 7) != 0 for shift in (0, 3, 6)]
        for left_out, values in zip(masked, (wish.position, wish.velocity, wish.acceleration), strict=True):
            if not left_out and not all(math.isfinite(one) for one in values):
                return False
        no_position, no_velocity, no_acceleration = masked
        if not no_position and no_velocity:
            return bool(no_acceleration)
        return not (no_position and no_velocity and no_acceleration)

    def _target(self, wish: _Wish) -> tuple[Target, tuple[bool, bool]]:
        """What a setpoint means. An axis (the horizontal two go together) that it leaves open is held still."""
        x, y, z = wish.position
        v, a = _zeroed(wish.velocity), _zeroed(wish.acceleration)
        has_xy = not math.isnan(x + y)
        has_vxy, has_axy = (not math.isnan(one[0] + one[1]) for one in (wish.velocity, wish.acceleration))
        has_z = not math.isnan(z)
        has_vz, has_az = not math.isnan(wish.velocity[2]), not math.isnan(wish.acceleration[2])
        limits, personality = self._guidance.limits, self._board.personality
        has_yaw, turns = not math.isnan(wish.yaw_rad), not math.isnan(wish.yawrate_radps)
        asked = self._guidance.speed_mps if personality.speed_command_binds_setpoints else None
        goes = (asked or limits.goto_mps) if has_xy else limits.speed_max_mps
        target = Target(
            north_east_m=(x, y) if has_xy else None,
            down_m=z if has_z else None,
            velocity_ned_mps=(v[0] if has_vxy else 0.0, v[1] if has_vxy else 0.0, v[2]),
            acceleration_ned_mps2=(a[0] if has_axy else 0.0, a[1] if has_axy else 0.0, a[2]),
            yaw_rad=wish.yaw_rad if has_yaw else None,
            yawrate_radps=wish.yawrate_radps if turns else 0.0,
            speed_max_mps=goes,
            climb_max_mps=limits.setpoint_climb_mps,
            descent_max_mps=limits.setpoint_descent_mps,
            faces_motion=personality.setpoints_face_motion and not has_yaw and not turns,
        )
        return target, (has_axy and not has_xy and not has_vxy, has_az and not has_z and not has_vz)

    def _attitude(self, m: Any, sender: Sender) -> None:
        if self._unwanted():
            return
        mask, flight, limits = m.type_mask, self._board.flight, self._guidance.limits
        rates = (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)
        masked = [bool(mask & bit) for bit in (_NO_ROLL_RATE, _NO_PITCH_RATE, _NO_TURN_RATE)]
        if not all(left_out or (math.isfinite(rate) and abs(rate) < _FAR) for left_out, rate in zip(masked, rates, strict=True)):
            self._refuse(None)
            return
        if limits.thrust_is_climb and (mask & _NO_THRUST or (any(masked) and not all(masked))):
            self._refuse(None)
            return
        thrust = 0.0 if mask & _NO_THRUST else m.thrust
        turns = 0.0 if masked[2] else rates[2]
        if not math.isfinite(thrust):
            self._refuse(None)
        elif not mask & _NO_ATTITUDE:
            angles = _euler_rad(m.q)
            if angles is None:
                self._refuse(None)
            else:
                self._tilt(angles[0], angles[1], angles[2], turns, thrust, None)
        elif not (masked[0] or masked[1]):
            self._tilt(0.0, 0.0, flight.yaw_rad, turns, thrust, (rates[0], rates[1], turns))
        else:
            self._refuse(None)

    def _tilt(self, roll: float, pitch: float, yaw: float, turns: float, thrust: float, rates: Vector | None) -> None:
        limits = self._guidance.limits
        climb = 0.0
        if limits.thrust_is_climb:
            share = 2.0 * min(max(thrust, 0.0), 1.0) - 1.0
            climb = share * (limits.climb_mps if share > 0.0 else limits.descent_mps)
        attitude = Attitude(roll, pitch, None if limits.thrust_is_climb else min(max(thrust, 0.0), 1.0), rates)
        target = Target(
            velocity_ned_mps=(0.0, 0.0, -climb),
            yaw_rad=yaw,
            yawrate_radps=turns,
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
            attitude=attitude,
        )
        self._lapses = True
        self._give(target, (False, False))

    def _give(self, target: Target, pushes: tuple[bool, bool]) -> None:
        flight = self._board.flight
        self._last_ns, self._last = flight.time_ns, (target, pushes)
        if flight.mode.behaviour is Behaviour.FOLLOW:
            self._following().give(target, flight, pushes)

    def _following(self) -> Follow:
        manoeuvre = self._guidance.manoeuvre
        if not isinstance(manoeuvre, Follow):
            manoeuvre = self._guidance.manoeuvre = Follow(self._board.flight)
        return manoeuvre

    def _unwanted(self) -> bool:
        """Heard in another mode than guided, where nobody waits for setpoints and nobody complains."""
        personality = self._board.personality
        if personality.setpoint_complaints or self._board.flight.mode.behaviour is Behaviour.FOLLOW:
            return False
        self.ignored += 1
        return True

    def _refuse(self, text: str | None) -> None:
        """Nonsense: a text where nonsense is talked about, and a halt where it is obeyed by stopping."""
        if text:
            self._complain(text)
        else:
            self.ignored += 1
        if not self._board.personality.setpoint_complaints:
            self._halt()

    def _stop(self) -> None:
        self.ignored += 1
        if not self._board.personality.setpoint_complaints:
            self._halt()

    def _halt(self) -> None:
        self._following().lapse(self._board.flight)
        self._lapses = False

    def _complain(self, text: str) -> None:
        self.ignored += 1
        if self._board.personality.setpoint_complaints:
            self._board.texts.say(CRITICAL, text)


def _yawrate(m: Any) -> float:
    rate: float = math.nan if m.type_mask & _NO_YAW_RATE else m.yaw_rate
    return rate


def _said(vector: Vector, masked: int, whole: bool) -> Vector:
    """A vector with NaN on the axes that are masked; on all of them where one is, and axes come together."""
    masked &= 7
    if not masked:
        return vector
    if whole or masked == 7:
        return _NAN3
    north, east, down = vector
    return math.nan if masked & 1 else north, math.nan if masked & 2 else east, math.nan if masked & 4 else down


def _zeroed(vector: Vector) -> Vector:
    north, east, down = vector
    return 0.0 if math.isnan(north) else north, 0.0 if math.isnan(east) else east, 0.0 if math.isnan(down) else down


def _turned(vector: Vector, yaw_rad: float) -> Vector:
    """A vector of the level body frame (forward, right, down) in north, east, down."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1], vector[2]


def _body_to_ned(vector: Vector, flight: Flight) -> Vector:
    """A vector of the body frame, tilted as the body is, in north, east, down."""
    cr, sr = math.cos(flight.roll_rad), math.sin(flight.roll_rad)
    cp, sp = math.cos(flight.pitch_rad), math.sin(flight.pitch_rad)
    right, down = cr * vector[1] - sr * vector[2], sr * vector[1] + cr * vector[2]
    return _turned((cp * vector[0] + sp * down, right, cp * down - sp * vector[0]), flight.yaw_rad)


def _euler_rad(q: Any) -> Vector | None:
    """Roll, pitch and yaw of a quaternion; None for what is not nearly one."""
    w, x, y, z = q
    size = math.sqrt(w * w + x * x + y * y + z * z)
    if not math.isfinite(size) or abs(size - 1.0) > 0.1:
        return None
    w, x, y, z = w / size, x / size, y / size, z / size
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
