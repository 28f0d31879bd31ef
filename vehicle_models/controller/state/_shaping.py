"""How a position is approached and how velocity grows: the laws by which autopilots limit acceleration and jerk.

The airframe's cascade asks for the velocity

    sqrt(base + 2 brake d) - offset        towards a target at the distance d, nearer than `near` in proportion to d,

for an acceleration of `gain` times the velocity still missing, and changes that acceleration by `jerk` at most.
PX4's and ArduPilot's laws are two choices of these numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

# A distance too small to divide by.
_LEAST_M = 0.001
# PX4 limits no jerk of a setpoint and takes its own gain; the jerk stands for the time in which the vehicle tilts, the
# share of the gain for what that lag lets it overshoot. Fitted to one step of 15 m: 1.0 s to 10 %, 0.79 m of overshoot.
_TILTING_MPS3, _DIRECT_GAIN = 20.0, 0.95
# ArduPilot's gain of the acceleration is 1; less of it stands for the error that its integrators gather behind a
# trajectory which goes ahead of the vehicle. Fitted to the overshoot of 0.31 m of one step of 20 m.
_SQUARE_ROOT_GAIN = 0.93


@dataclass(frozen=True, slots=True)
class AxisShaping:
    """The law of one axis, or of both horizontal ones together."""

    accel_mps2: float
    jerk_mps3: float
    gain_per_s: float
    brake_mps2: float
    base_m2ps2: float
    offset_mps: float
    near_m: float = _LEAST_M

    @classmethod
    def with_braking_delay(cls, accel_mps2: float, jerk_mps3: float) -> Self:
        """PX4's trajectories: braking at full acceleration after the time that the jerk takes to turn it round.

        Source: PX4, `math::trajectory::computeMaxSpeedFromDistance`. The gain makes the acceleration end just as
        the velocity is reached, as its `VelocitySmoothing` does.
        """
        offset = 2.0 * accel_mps2 * accel_mps2 / jerk_mps3
        gain = 2.0 * jerk_mps3 / accel_mps2
        return cls(accel_mps2, jerk_mps3, gain, accel_mps2, offset * offset, offset)

    @classmethod
    def with_proportion(
        cls, speed_mps: float, accel_mps2: float, position_per_s: float, velocity_per_s: float
    ) -> Self:
        """PX4's position controller alone: velocity in proportion to the distance, up to a speed, and acceleration in
        proportion to the velocity still missing (source: PX4, `PositionControl`).
        """
        near_m = speed_mps / position_per_s
        return cls(
            accel_mps2,
            _TILTING_MPS3,
            _DIRECT_GAIN * velocity_per_s,
            0.5 * position_per_s * speed_mps,
            0.0,
            0.0,
            near_m,
        )

    @classmethod
    def with_square_root(cls, accel_mps2: float, jerk_mps3: float) -> Self:
        """ArduPilot (`shape_pos_vel_accel`, `sqrt_controller`): braking at half the acceleration."""
        brake, per_s = 0.5 * accel_mps2, 0.5 * jerk_mps3 / accel_mps2
        return cls(
            accel_mps2,
            jerk_mps3,
            _SQUARE_ROOT_GAIN * jerk_mps3 / accel_mps2,
            brake,
            -((brake / per_s) ** 2),
            0.0,
            brake / per_s**2,
        )


@dataclass(frozen=True, slots=True)
class MotionShaping:
    """The laws of a target."""

    horizontal: AxisShaping
    vertical: AxisShaping
    velocity_p_per_s: float  # of the horizontal velocity's error
    velocity_i_per_s2: float
    # Whether the drag of still air is fed forward. Neither PX4 nor ArduPilot does so by default: their integrators
    # learn it, and let the vehicle overshoot until they have forgotten it.
    knows_drag: bool = False

    def held(self) -> MotionShaping:
        """The same vertically, and a place held as firmly as an unshaped one: for a vertical climb in wind."""
        return replace(UNSHAPED, vertical=self.vertical)


# Of targets that an autopilot hands on unshaped, such as a companion's setpoints. The project chose them: an
# approach that overshoots nothing, and ramps that the airframe follows.
UNSHAPED = MotionShaping(
    horizontal=AxisShaping(3.0, 12.0, 2.5, 2.0, 4.0, 2.0),
    vertical=AxisShaping(3.0, 12.0, 3.0, 2.0, 4.0, 2.0),
    velocity_p_per_s=2.5,
    velocity_i_per_s2=0.8,
    knows_drag=True,
)


class StraightLine:
    """Rest to rest over a distance with bounded speed, acceleration and jerk: ArduPilot's path between waypoints.

    Source: ArduPilot, AP_Math/SCurve; its jerk rises and falls within 0.3 s, here at once.
    """

    def __init__(self, length_m: float, speed_mps: float, accel_mps2: float, jerk_mps3: float) -> None:
        # The greatest acceleration and speed that the length leaves room for.
        accel = min(accel_mps2, (0.5 * jerk_mps3 * jerk_mps3 * length_m) ** (1.0 / 3.0))
        self._jerk, self._rise_s = jerk_mps3, accel / jerk_mps3
        # Speeding up takes rise, hold and fall of the acceleration, and half of it is way to the middle.
        speed = min(
            speed_mps,
            0.5 * (math.sqrt((accel * self._rise_s) ** 2 + 4.0 * accel * length_m) - accel * self._rise_s),
        )
        if speed < accel * self._rise_s:
            self._rise_s = math.sqrt(speed / jerk_mps3)
            accel = jerk_mps3 * self._rise_s
        self._accel, self.speed_mps = accel, speed
        self._hold_s = speed / accel - self._rise_s if accel > 0.0 else 0.0
        self.ramp_s = 2.0 * self._rise_s + self._hold_s
        self._coast_s = length_m / speed - self.ramp_s if speed > 0.0 else 0.0
        self.length_m = length_m
        self.duration_s = 2.0 * self.ramp_s + self._coast_s

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Way from the start (m), speed and acceleration at a time after it."""
        if time_s >= self.duration_s:
            return self.length_m, 0.0, 0.0
        if time_s > 0.5 * self.duration_s:
            way, speed, accel = self._speeding_up(self.duration_s - time_s)
            return self.length_m - way, speed, -accel
        return self._speeding_up(max(time_s, 0.0))

    def _speeding_up(self, time_s: float) -> tuple[float, float, float]:
        jerk, rise_s, accel = self._jerk, self._rise_s, self._accel
        if time_s >= self.ramp_s:
            return self.speed_mps * (time_s - 0.5 * self.ramp_s), self.speed_mps, 0.0
        if time_s < rise_s:
            return jerk * time_s**3 / 6.0, 0.5 * jerk * time_s * time_s, jerk * time_s
        if time_s < rise_s + self._hold_s:
            held_s = time_s - rise_s
            speed = accel * (0.5 * rise_s + held_s)
            return (
                accel * (rise_s * rise_s / 6.0 + 0.5 * rise_s * held_s + 0.5 * held_s * held_s),
                speed,
                accel,
            )
        left_s = self.ramp_s - time_s
        # The ramp is point-symmetric about its middle.
        return (
            0.5 * self.speed_mps * self.ramp_s - self.speed_mps * left_s + jerk * left_s**3 / 6.0,
            self.speed_mps - 0.5 * jerk * left_s * left_s,
            jerk * left_s,
        )
