"""The X500's airframe: targets of the flight controller become properties of the cascade in x500.xml."""

from __future__ import annotations

import math

from bench.contracts import Vector

from .._geodesy import LocalFrame
from ..controller import FlightTarget, MotionShaping, TargetAttitude
from ._plant import FULL_THRUST_N, ROTORS, X500Plant

_YAW_MAX_RADPS = 1.0
# What the airframe can do, regardless of parameters; chosen, not measured.
_SPEED_MAX_MPS, _CLIMB_MAX_MPS, _DESCENT_MAX_MPS = 18.0, 6.0, 3.0
# Bounds of attitudes and rates that a client commands.
_TILT_MAX_RAD, _RATE_MAX_RADPS = math.radians(45.0), 4.0


class X500Airframe:
    """The airframe of the flight controller: targets by its estimate, heading turned by 1 rad/s at most."""

    def __init__(self, plant: X500Plant, frame: LocalFrame, step_s: float) -> None:
        self._plant = plant
        self._home_east_m, self._home_north_m = frame.home_east_m, frame.home_north_m
        self._step_s = step_s
        self._yaw_rad = plant.motion.yaw_rad
        self._target: FlightTarget | None = None  # as last taken
        self._shaping: MotionShaping | None = None  # likewise
        self.error_enu_m: Vector = (0.0, 0.0, 0.0)

    def arm(self) -> None:
        self._plant.write("armed", 1.0)
        self._yaw_rad = self._plant.motion.yaw_rad

    def disarm(self) -> None:
        self._plant.write("flying", 0.0)
        self._plant.write("armed", 0.0)
        for name in ROTORS:
            self._plant.write(f"test-{name}", 0.0)

    def rest(self) -> None:
        self._plant.write("flying", 0.0)
        self._yaw_rad = self._plant.motion.yaw_rad

    def fly(self, target: FlightTarget) -> None:
        """Steer the true position off the target by the estimate's error, so that the estimate meets it."""
        # Most steps repeat the target; comparing is cheaper than writing some twenty properties.
        if target is not self._target and target != self._target:
            self._write_constant(target)
        write = self._plant.write
        error_e, error_n, error_u = self.error_enu_m
        if target.north_east_m is not None:
            shift_n, shift_e = self._plant.shift_ne_m
            write("target-n-m", target.north_east_m[0] + self._home_north_m - error_n + shift_n)
            write("target-e-m", target.north_east_m[1] + self._home_east_m - error_e + shift_e)
        if target.down_m is not None:
            write("target-u-m", -target.down_m - error_u)
        self._write_heading(target)
        write("flying", 1.0)

    def _write_constant(self, target: FlightTarget) -> None:
        """Write everything of a target that stays the same while it is flown."""
        self._target = target
        write = self._plant.write
        write("position-mode", 0.0 if target.north_east_m is None else 1.0)
        write("height-mode", 0.0 if target.down_m is None else 1.0)
        north, east, down = target.velocity_ned_mps
        write("target-vn-mps", north)
        write("target-ve-mps", east)
        write("target-vu-mps", -down)
        north, east, down = target.acceleration_ned_mps2
        write("target-an-mps2", north)
        write("target-ae-mps2", east)
        write("target-au-mps2", -down)
        self._write_attitude(target.attitude)
        write("speed-max-mps", min(target.speed_max_mps, _SPEED_MAX_MPS))
        write("climb-max-mps", min(target.climb_max_mps, _CLIMB_MAX_MPS))
        write("descent-max-mps", min(target.descent_max_mps, _DESCENT_MAX_MPS))
        if target.shaping != self._shaping:
            self._write_shaping(target.shaping)

    def _write_shaping(self, shaping: MotionShaping) -> None:
        self._shaping = shaping
        self._plant.write("velocity-p-per-s", shaping.velocity_p_per_s)
        self._plant.write("velocity-i-per-s2", shaping.velocity_i_per_s2)
        self._plant.write("drag-share", 1.0 if shaping.knows_drag else 0.0)
        for prefix, axis in (("", shaping.horizontal), ("vertical-", shaping.vertical)):
            write = self._plant.write
            write(f"{prefix}accel-max-mps2", axis.accel_mps2)
            write(f"{prefix}jerk-step-mps2", axis.jerk_mps3 * self._plant.outer_s)
            write(f"{prefix}ramp-gain-per-s", axis.gain_per_s)
            write(f"{prefix}brake-twice-mps2", 2.0 * axis.brake_mps2)
            write(f"{prefix}approach-base-m2ps2", axis.base_m2ps2)
            write(f"{prefix}approach-offset-mps", axis.offset_mps)
            write(f"{prefix}approach-near-m", axis.near_m)

    def _write_attitude(self, attitude: TargetAttitude | None) -> None:
        write = self._plant.write
        rates = attitude.rates_radps if attitude else None
        write("tilt-mode", 1.0 if attitude else 0.0)
        write("thrust-mode", 1.0 if attitude and attitude.thrust is not None else 0.0)
        write("rate-mode", 1.0 if rates else 0.0)
        if attitude:
            write("given-roll-rad", _clipped(attitude.roll_rad, _TILT_MAX_RAD))
            write("given-pitch-rad", _clipped(attitude.pitch_rad, _TILT_MAX_RAD))
            write("given-thrust-n", min(max(attitude.thrust or 0.0, 0.0), 1.0) * FULL_THRUST_N)
        if rates:
            for name, rate in zip("pqr", rates, strict=True):
                write(f"given-{name}-radps", _clipped(rate, _RATE_MAX_RADPS))

    def commanded_attitude(self) -> tuple[float, float, float, float]:
        return self._plant.commanded_attitude()

    def test_rotor(self, number: int, share: float) -> None:
        self._plant.write(f"test-{ROTORS[number]}", share)

    def outputs(self) -> list[float]:
        return self._plant.rotor_commands()

    def specific_force_mps2(self) -> Vector:
        return self._plant.specific_force_mps2()

    def _write_heading(self, target: FlightTarget) -> None:
        if target.attitude and target.attitude.rates_radps:
            self._yaw_rad = self._plant.motion.yaw_rad
            self._plant.write("target-yawrate-radps", 0.0)
            return
        rate = target.yawrate_radps
        if target.yaw_rad == self._yaw_rad and -math.pi <= self._yaw_rad <= math.pi:
            # Most of a flight keeps its heading: the same numbers, without two remainders.
            self._plant.write("target-yaw-rad", self._yaw_rad)
            self._plant.write("target-yawrate-radps", 0.0)
            return
        if target.yaw_rad is not None:
            error_rad = math.remainder(target.yaw_rad - self._yaw_rad, 2.0 * math.pi)
            max_turn = min(target.turn_max_radps, _YAW_MAX_RADPS) * self._step_s
            turn = min(max(error_rad, -max_turn), max_turn)
            rate = turn / self._step_s
        rate = min(max(rate, -_YAW_MAX_RADPS), _YAW_MAX_RADPS)
        self._yaw_rad = math.remainder(self._yaw_rad + rate * self._step_s, 2.0 * math.pi)
        self._plant.write("target-yaw-rad", self._yaw_rad)
        self._plant.write("target-yawrate-radps", rate)


def _clipped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
