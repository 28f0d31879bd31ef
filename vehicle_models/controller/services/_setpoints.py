"""Setpoints of a companion: offboard in PX4's words, guided in ArduPilot's."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bench.contracts import Vector

from ..guidance._fence_boundary import FenceBoundary
from ..guidance._guidance import Guidance
from ..guidance._manoeuvres import FollowSetpoints
from ..policies._setpoints import SetpointPolicy
from ..state._flight_limits import FlightLimits
from ..state._flight_state import Behaviour, FlightState, FlightTarget, NorthEast, TargetAttitude
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ..state._texts import CRITICAL

# Bits of POSITION_TARGET_TYPEMASK and ATTITUDE_TARGET_TYPEMASK.
_FORCE, _IGNORE_YAW, _IGNORE_YAW_RATE = 0x200, 0x400, 0x800
_IGNORE_ROLL_RATE, _IGNORE_PITCH_RATE, _IGNORE_TURN_RATE, _IGNORE_THRUST, _IGNORE_ATTITUDE = 1, 2, 4, 64, 128
_SET_POSITION_TARGET_LOCAL_NED, _SET_POSITION_TARGET_GLOBAL_INT = 84, 86
# Metres or anything else: a larger number is a client's error.
_MAX_SETPOINT = 1e6
_NAN3 = (math.nan,) * 3
_FOLLOWING = (Behaviour.OFFBOARD, Behaviour.EXTERNAL)


@dataclass(frozen=True, slots=True)
class _Setpoint:
    """One message in north, east, down; NaN on an axis that it leaves open."""

    position: Vector
    velocity: Vector
    acceleration: Vector
    yaw_rad: float
    yawrate_radps: float

    @property
    def empty(self) -> bool:
        for vector in (self.position, self.velocity, self.acceleration):
            # What a mask leaves out is this very vector, so most need no look at their numbers.
            if vector is not _NAN3 and not all(map(math.isnan, vector)):
                return False
        return True

    @property
    def sane(self) -> bool:
        if abs(self.yaw_rad) >= _MAX_SETPOINT or abs(self.yawrate_radps) >= _MAX_SETPOINT:
            return False
        for vector in (self.position, self.velocity, self.acceleration):
            if vector is not _NAN3:
                x, y, z = vector
                if abs(x) >= _MAX_SETPOINT or abs(y) >= _MAX_SETPOINT or abs(z) >= _MAX_SETPOINT:
                    return False
        return True


class Setpoints:
    """SET_POSITION_TARGET_LOCAL_NED, _GLOBAL_INT, SET_ATTITUDE_TARGET; `ignored` were not flown."""

    def __init__(
        self, context: ServiceContext, policy: SetpointPolicy, guidance: Guidance, fence: FenceBoundary
    ) -> None:
        self._context = context
        self._policy = policy
        self._guidance = guidance
        self._fence = fence
        self._last_ns: int | None = None
        self._timeout_of: FlightLimits | None = None  # the limits that `_timeout_ns` was taken from
        self._timeout_ns = 0
        self._lapses = False
        self._last: tuple[FlightTarget, tuple[bool, bool]] | None = None
        self.ignored = 0

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {
            "SET_POSITION_TARGET_LOCAL_NED": self._take_local,
            "SET_POSITION_TARGET_GLOBAL_INT": self._take_global,
            "SET_ATTITUDE_TARGET": self._take_attitude,
        }

    def tick(self) -> None:
        """Stop the vehicle when no setpoints arrive any more, where that is no failsafe."""
        manoeuvre, lapses = self._guidance.manoeuvre, self._lapses and not self._policy.fails_safe_when_lost
        if lapses and not self.fresh() and isinstance(manoeuvre, FollowSetpoints):
            manoeuvre.lapse(self._context.flight)
            self._lapses = False

    def fresh(self) -> bool:
        """Whether setpoints have come within the timeout."""
        if self._last_ns is None:
            return False
        limits = self._guidance.limits
        if limits is not self._timeout_of:
            self._timeout_of, self._timeout_ns = limits, round(limits.setpoint_timeout_s * 1e9)
        return self._context.flight.time_ns - self._last_ns < self._timeout_ns

    def keep_alive(self, alive: bool = True) -> None:
        """The companion is there, or says itself that it controls nothing."""
        self._last_ns = self._context.flight.time_ns if alive else None

    # Setpoints that are no sign of life, as PX4's topics have them. False: the setpoint makes no sense.

    def take_trajectory(
        self, position: Vector, velocity: Vector, acceleration: Vector, yaw_rad: float, yawrate_radps: float
    ) -> bool:
        """Position, velocity and acceleration in north, east, down; NaN for what is left open."""
        setpoint = _Setpoint(position, velocity, acceleration, yaw_rad, yawrate_radps)
        if setpoint.empty or not setpoint.sane:
            return False
        self._fly(*self._target(setpoint))
        return True

    def take_attitude(self, q: Sequence[float], yawrate_radps: float, thrust: float) -> bool:
        """A quaternion (w first), a rate of yaw beside it, and a share of full thrust."""
        angles = _euler_rad(q)
        if angles is None or not abs(yawrate_radps) < _MAX_SETPOINT or not math.isfinite(thrust):
            return False
        self._fly(self._tilted(*angles, yawrate_radps, thrust, None))
        return True

    def take_rates(self, rates_radps: Vector, thrust: float) -> bool:
        """Rates of the body and a share of full thrust."""
        if not all(abs(rate) < _MAX_SETPOINT for rate in rates_radps) or not math.isfinite(thrust):
            return False
        yaw_rad = self._context.flight.yaw_rad
        self._fly(self._tilted(0.0, 0.0, yaw_rad, rates_radps[2], thrust, rates_radps))
        return True

    def take_goto(
        self, position: Vector, yaw_rad: float, speed_mps: float, climb_mps: float, turn_radps: float
    ) -> bool:
        """A place in north, east, down, a heading or NaN, and the most of each speed, or infinity."""
        setpoint = _Setpoint(position, _NAN3, _NAN3, yaw_rad, math.nan)
        if not (
            setpoint.sane and math.isfinite(sum(position)) and min(speed_mps, climb_mps, turn_radps) > 0.0
        ):
            return False
        target, accelerates = self._target(setpoint)
        limited = replace(
            target,
            speed_max_mps=min(target.speed_max_mps, speed_mps),
            climb_max_mps=min(target.climb_max_mps, climb_mps),
            descent_max_mps=min(target.descent_max_mps, climb_mps),
            turn_max_radps=min(target.turn_max_radps, turn_radps),
        )
        self._fly(limited, accelerates)
        return True

    def resume(self) -> None:
        """Fly the last setpoint again, after the mode was entered again."""
        if self._last and isinstance(self._guidance.manoeuvre, FollowSetpoints):
            self._guidance.manoeuvre.give(self._last[0], self._context.flight, self._last[1])

    def _take_local(self, m: Any, sender: MessageSender) -> None:
        flight = self._context.flight
        if self._ignores_mode():
            return
        frame = self._policy.local_frames.get(m.coordinate_frame)
        if frame is None:
            self._refuse(self._policy.bad_local_frame.format(m.coordinate_frame))
            return
        position, velocity, acceleration = self._vectors(m, (m.x, m.y, m.z))
        yaw = math.nan if m.type_mask & _IGNORE_YAW else m.yaw
        if frame == "body-velocity":
            position = _NAN3
            velocity, acceleration = _body_to_ned(velocity, flight), _body_to_ned(acceleration, flight)
        elif frame == "body":
            position, velocity = _turned(position, flight.yaw_rad), _turned(velocity, flight.yaw_rad)
            acceleration = _turned(acceleration, flight.yaw_rad)
            yaw += flight.yaw_rad
        if frame in ("body", "offset"):
            north, east, down = position
            position = (north + flight.north_m, east + flight.east_m, down + flight.down_m)
        setpoint = _Setpoint(position, velocity, acceleration, yaw, _yaw_rate(m))
        self._take("SET_POSITION_TARGET_LOCAL_NED", m, setpoint)

    def _take_global(self, m: Any, sender: MessageSender) -> None:
        context, flight = self._context, self._context.flight
        if self._ignores_mode():
            return
        position, velocity, acceleration = self._vectors(m, (0.0, 0.0, m.alt))
        # A position with one open axis is none: horizontal axes of a geodetic one cannot be separated.
        if not math.isnan(sum(position)):
            frame = self._policy.global_frames.get(m.coordinate_frame)
            if frame is None:
                self._stop()
                context.texts.report(self._policy.bad_global_frame, m.coordinate_frame)
                return
            if abs(m.lat_int) > 900_000_000 or abs(m.lon_int) > 1_800_000_000:
                self._stop()
                return
            north, east = context.frame.to_local_m(m.lat_int * 1e-7, m.lon_int * 1e-7)
            reference_m = {
                "home": (flight.home or flight.origin).altitude_m,
                "ground": flight.origin.altitude_m,
            }
            position = (north, east, flight.origin.altitude_m - m.alt - reference_m.get(frame, 0.0))
            if self._fence.policy.refuses_setpoints and not self._fence.allows(*position):
                self._stop()
                return
        elif not all(math.isnan(value) for value in position):
            position = _NAN3
        yaw = math.nan if m.type_mask & _IGNORE_YAW else m.yaw
        setpoint = _Setpoint(position, velocity, acceleration, yaw, _yaw_rate(m))
        self._take("SET_POSITION_TARGET_GLOBAL_INT", m, setpoint)

    def _vectors(self, m: Any, place: Vector) -> tuple[Vector, Vector, Vector]:
        """Position, velocity and acceleration with NaN for what the mask leaves out."""
        policy = self._policy
        grouped = policy.axes_in_groups
        if m.get_msgId() == _SET_POSITION_TARGET_LOCAL_NED:
            # The body tilts, so one missing axis leaves all three unknown.
            grouped |= policy.local_frames.get(m.coordinate_frame) == "body-velocity"
        mask = m.type_mask
        velocity, acceleration = (m.vx, m.vy, m.vz), (m.afx, m.afy, m.afz)
        return (
            _masked(place, mask, grouped),
            _masked(velocity, mask >> 3, grouped),
            _masked(acceleration, mask >> 6, grouped),
        )

    def _take(self, name: str, m: Any, setpoint: _Setpoint) -> None:
        policy = self._policy
        # The specification allows forces in place of accelerations; PX4 refuses them with this text.
        if m.type_mask & _FORCE and (m.type_mask >> 6 & 7) != 7:
            self._complain(f"{name} force not supported")
            return
        if policy.axes_in_groups and not self._is_known_combination(m, setpoint):
            self._stop()
            return
        if setpoint.empty or not setpoint.sane:
            self._refuse(None if m.get_msgId() == _SET_POSITION_TARGET_GLOBAL_INT else f"{name} invalid")
            return
        target, accelerates = self._target(setpoint)
        self._lapses = target.north_east_m is None or policy.position_lapses
        self._give(target, accelerates)

    def _is_known_combination(self, m: Any, setpoint: _Setpoint) -> bool:
        """Whether unmasked vectors hold numbers alone, in a combination that ArduPilot knows."""
        masked = [(m.type_mask >> shift & 7) != 0 for shift in (0, 3, 6)]
        vectors = (setpoint.position, setpoint.velocity, setpoint.acceleration)
        for ignored, vector in zip(masked, vectors, strict=True):
            if not ignored and not all(math.isfinite(value) for value in vector):
                return False
        no_position, no_velocity, no_acceleration = masked
        if not no_position and no_velocity:
            return bool(no_acceleration)
        return not (no_position and no_velocity and no_acceleration)

    def _target(self, setpoint: _Setpoint) -> tuple[FlightTarget, tuple[bool, bool]]:
        """The target of a setpoint, and whether it gives acceleration alone: horizontally, vertically.

        An axis that the setpoint leaves open is held still; the two horizontal axes go together.
        """
        place, down = _axes(setpoint.position)
        speed, sink = _axes(setpoint.velocity)
        acceleration, drop = _axes(setpoint.acceleration)
        limits, policy = self._guidance.limits, self._policy
        has_yaw, has_yaw_rate = not math.isnan(setpoint.yaw_rad), not math.isnan(setpoint.yawrate_radps)
        commanded_mps = self._guidance.speed_mps if policy.speed_command_binds else None
        target = FlightTarget(
            north_east_m=place,
            down_m=down,
            velocity_ned_mps=_filled(speed, sink),
            acceleration_ned_mps2=_filled(acceleration, drop),
            yaw_rad=setpoint.yaw_rad if has_yaw else None,
            yawrate_radps=setpoint.yawrate_radps if has_yaw_rate else 0.0,
            speed_max_mps=(commanded_mps or limits.goto_mps) if place else limits.speed_max_mps,
            climb_max_mps=limits.setpoint_climb_mps,
            descent_max_mps=limits.setpoint_descent_mps,
            faces_motion=policy.faces_motion and not has_yaw and not has_yaw_rate,
            shaping=limits.setpoint_shaping if place and not speed else limits.velocity_shaping,
        )
        level = acceleration is not None and place is None and speed is None
        return target, (level, drop is not None and down is None and sink is None)

    def _take_attitude(self, m: Any, sender: MessageSender) -> None:
        if self._ignores_mode():
            return
        rates = (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)
        masks = (_IGNORE_ROLL_RATE, _IGNORE_PITCH_RATE, _IGNORE_TURN_RATE)
        masked = [bool(m.type_mask & bit) for bit in masks]
        # What is masked is zero, whatever it holds.
        roll_rate, pitch_rate, yaw_rate = (
            0.0 if ignored else rate for ignored, rate in zip(masked, rates, strict=True)
        )
        lacks_thrust = bool(m.type_mask & _IGNORE_THRUST)
        thrust = 0.0 if lacks_thrust else m.thrust
        bound = max(abs(roll_rate), abs(pitch_rate), abs(yaw_rate))
        numbers = (roll_rate, pitch_rate, yaw_rate, thrust)
        sane = all(map(math.isfinite, numbers)) and bound < _MAX_SETPOINT
        some_masked = any(masked) and not all(masked)
        by_rates = bool(m.type_mask & _IGNORE_ATTITUDE)
        angles = self._angles_beside_rates(masked) if by_rates else _euler_rad(m.q)
        body_rates = (roll_rate, pitch_rate, yaw_rate) if by_rates else None
        climbs_by_thrust = self._guidance.limits.thrust_is_climb
        if not sane or angles is None or (climbs_by_thrust and (lacks_thrust or some_masked)):
            self._refuse(None)
        else:
            self._lapses = True
            self._give(self._tilted(*angles, yaw_rate, thrust, body_rates), (False, False))

    def _angles_beside_rates(self, masked: list[bool]) -> Vector | None:
        """Rates alone need those of roll and pitch; None without them."""
        return None if masked[0] or masked[1] else (0.0, 0.0, self._context.flight.yaw_rad)

    def _tilted(
        self, roll: float, pitch: float, yaw: float, yaw_rate: float, thrust: float, rates: Vector | None
    ) -> FlightTarget:
        limits = self._guidance.limits
        climb = 0.0
        if limits.thrust_is_climb:
            share = 2.0 * min(max(thrust, 0.0), 1.0) - 1.0
            climb = share * (limits.climb_mps if share > 0.0 else limits.descent_mps)
        attitude = TargetAttitude(
            roll, pitch, None if limits.thrust_is_climb else min(max(thrust, 0.0), 1.0), rates
        )
        return FlightTarget(
            velocity_ned_mps=(0.0, 0.0, -climb),
            yaw_rad=yaw,
            yawrate_radps=yaw_rate,
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
            attitude=attitude,
        )

    def _give(self, target: FlightTarget, accelerates: tuple[bool, bool]) -> None:
        """Fly what a client sent over MAVLink, where each setpoint is a sign of life."""
        self.keep_alive()
        # An external mode has setpoints of its companion alone, as PX4's MAVLink publishes them in offboard only (source).
        if self._context.flight.mode.behaviour is not Behaviour.EXTERNAL:
            self._fly(target, accelerates)

    def _fly(self, target: FlightTarget, accelerates: tuple[bool, bool] = (False, False)) -> None:
        flight = self._context.flight
        self._last = target, accelerates
        flight.had_setpoints = True
        if flight.mode.behaviour in _FOLLOWING:
            self._manoeuvre().give(target, flight, accelerates)

    def _manoeuvre(self) -> FollowSetpoints:
        manoeuvre = self._guidance.manoeuvre
        if not isinstance(manoeuvre, FollowSetpoints):
            manoeuvre = self._guidance.manoeuvre = FollowSetpoints(self._context.flight)
        return manoeuvre

    def _ignores_mode(self) -> bool:
        """Whether the mode flies no setpoints and the autopilot does not complain about that; counts it."""
        if self._policy.complains or self._context.flight.mode.behaviour is Behaviour.OFFBOARD:
            return False
        self.ignored += 1
        return True

    def _refuse(self, text: str | None) -> None:
        """Handle a bad setpoint: send a text where the autopilot complains, else stop."""
        if text:
            self._complain(text)
        else:
            self.ignored += 1
        if not self._policy.complains:
            self._halt()

    def _stop(self) -> None:
        self.ignored += 1
        if not self._policy.complains:
            self._halt()

    def _halt(self) -> None:
        self._manoeuvre().lapse(self._context.flight)
        self._lapses = False

    def _complain(self, text: str) -> None:
        self.ignored += 1
        if self._policy.complains:
            self._context.texts.send(CRITICAL, text)


def _yaw_rate(m: Any) -> float:
    rate: float = math.nan if m.type_mask & _IGNORE_YAW_RATE else m.yaw_rate
    return rate


def _masked(vector: Vector, mask: int, grouped: bool) -> Vector:
    """A vector with NaN on the axes that are masked; on all of them where one is, and axes are `grouped`."""
    mask &= 7
    if not mask:
        return vector
    if grouped or mask == 7:
        return _NAN3
    north, east, down = vector
    return math.nan if mask & 1 else north, math.nan if mask & 2 else east, math.nan if mask & 4 else down


def _axes(vector: Vector) -> tuple[NorthEast | None, float | None]:
    """Both horizontal axes, which go together, and the vertical one; None for what is left open."""
    if vector is _NAN3:
        return None, None
    north, east, down = vector
    return None if math.isnan(north + east) else (north, east), None if math.isnan(down) else down


def _filled(level: NorthEast | None, vertical: float | None) -> Vector:
    """A vector that is zero on the axes that are left open."""
    north, east = level or (0.0, 0.0)
    return north, east, 0.0 if vertical is None else vertical


def _turned(vector: Vector, yaw_rad: float) -> Vector:
    """A vector of the level body frame (forward, right, down) in north, east, down."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1], vector[2]


def _body_to_ned(vector: Vector, flight: FlightState) -> Vector:
    """A vector of the body frame, tilted as the body is, in north, east, down."""
    cr, sr = math.cos(flight.roll_rad), math.sin(flight.roll_rad)
    cp, sp = math.cos(flight.pitch_rad), math.sin(flight.pitch_rad)
    right, down = cr * vector[1] - sr * vector[2], sr * vector[1] + cr * vector[2]
    return _turned((cp * vector[0] + sp * down, right, cp * down - sp * vector[0]), flight.yaw_rad)


def _euler_rad(q: Any) -> Vector | None:
    """Roll, pitch and yaw of a quaternion; None where its length is off by more than a tenth."""
    w, x, y, z = q
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not math.isfinite(length) or abs(length - 1.0) > 0.1:
        return None
    w, x, y, z = w / length, x / length, y / length, z / length
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
