"""Steers the fixed wing from a target to its attitude: course by L1, height by pitch, airspeed by the motor.

Lateral: Park, Deyst and How, "A New Nonlinear Guidance Logic for Trajectory Tracking" (AIAA 2004-4900), in
the form for circles that autopilots use: far away the nearest way to the centre, near the circle a
proportional-derivative law in distance and its rate beside the circle's own acceleration. By ground velocity,
so that wind needs no estimate. Longitudinal: the pitch that carries the wing in level or banked flight plus
the flight path wanted, and thrust from the drag polar plus what climbing and gaining speed take; small
integrals make up for what the polar does not know.
"""

from __future__ import annotations

import math

from bench.contracts import Vector

from .._geodesy import LocalFrame
from ..controller import FlightTarget, TargetAttitude, WingTarget
from ._plant import AREA_M2, DRAG_0, DRAG_PER_LIFT2, LIFT_0, LIFT_PER_RAD, MASS_KG, WingPlant, most_thrust_n

_G = 9.80665
_AIR_KGPM3 = 1.225
# What the airframe can do, regardless of parameters.
_SLOWEST_MPS, _FASTEST_MPS = 10.5, 22.0
_CLIMB_MPS, _DESCENT_MPS = 4.0, 4.0
# Radius of a circle.
_TIGHTEST_M = 30.0
# Of the lateral guidance.
_PERIOD_S, _DAMPING = 9.0, 0.75
_BANK_MAX_RAD = math.radians(45.0)
_PITCH_RAD = (math.radians(-20.0), math.radians(25.0))
_CATAPULT_N, _RELEASE_MPS, _CATAPULT_MOST_S = 95.0, 14.0, 1.2
_THROWN_PITCH_RAD = math.radians(8.0)
# With a larger lack of speed, height is traded for speed.
_SLOW_MPS = 1.5


class WingAirframe:
    """The airframe as its flight controller sees it; targets by the vehicle's own estimate."""

    def __init__(self, plant: WingPlant, frame: LocalFrame, step_s: float) -> None:
        self._plant = plant
        self._home_east_m, self._home_north_m = frame.home_east_m, frame.home_north_m
        self._step_s = step_s
        self._flies = False
        self._thrown_s: float | None = None  # on the catapult; None: off it
        self._airspeed_mps = 0.0
        self._thrust_sum_n = 0.0
        self._pitch_sum_rad = 0.0
        self._wanted = (0.0, 0.0, 0.0, 0.0)
        self.error_enu_m: Vector = (0.0, 0.0, 0.0)

    def fly(self, target: FlightTarget) -> None:
        """Steer towards `target`; from rest on the ground the catapult launches the aircraft first."""
        motion, write = self._plant.motion, self._plant.write
        if not self._flies:
            self._begin()
        self._airspeed_mps += self._step_s / 0.4 * (motion.airspeed_mps - self._airspeed_mps)
        if self._thrown_s is not None:
            self._throw()
            roll, pitch, throttle = 0.0, _THROWN_PITCH_RAD, 1.0
            self._airspeed_mps = max(motion.airspeed_mps, _RELEASE_MPS)
        elif target.attitude:
            roll, pitch, throttle = self._given(target, target.attitude)
        else:
            roll = self._roll_rad(target)
            pitch, throttle = self._climb(target)
        speed = max(motion.airspeed_mps, 8.0)
        write("target-roll-rad", roll)
        write("target-pitch-rad", pitch)
        write("target-q-radps", _G / speed * math.sin(motion.roll_rad) * math.tan(motion.roll_rad))
        write("target-r-radps", _G / speed * math.sin(motion.roll_rad))
        write("throttle", throttle)
        write("flying", 1.0)
        self._wanted = (roll, pitch, motion.yaw_rad, throttle)

    def _given(self, target: FlightTarget, attitude: TargetAttitude) -> tuple[float, float, float]:
        """A commanded attitude within the airframe's bounds; in place of body rates wings are kept level."""
        pitch, throttle = self._climb(target)
        if attitude.rates_radps is not None:
            return 0.0, pitch, throttle
        roll = min(max(attitude.roll_rad, -_BANK_MAX_RAD), _BANK_MAX_RAD)
        if attitude.thrust is None:
            return roll, pitch, throttle
        pitch = min(max(attitude.pitch_rad, _PITCH_RAD[0]), _PITCH_RAD[1])
        return roll, pitch, min(max(attitude.thrust, 0.0), 1.0)

    def commanded_attitude(self) -> tuple[float, float, float, float]:
        """Roll, pitch, yaw in radians, and the share of full thrust; yaw, not steered, stays what it is."""
        return self._wanted

    def test_rotor(self, number: int, share: float) -> None:
        self._plant.write("throttle", share)

    def outputs(self) -> list[float]:
        return self._plant.outputs()

    def specific_force_mps2(self) -> Vector:
        return self._plant.specific_force_mps2()

    def rest(self) -> None:
        """At idle, armed or not, it lies as it does disarmed."""
        for name in ("flying", "throttle", "catapult-n"):
            self._plant.write(name, 0.0)
        self._flies = False
        self._plant.hold(self._lies())
        self._wanted = (0.0, 0.0, self._plant.motion.yaw_rad, 0.0)

    arm = disarm = rest

    def _lies(self) -> bool:
        motion = self._plant.motion
        return motion.up_m < 0.05 and math.hypot(motion.vn_mps, motion.ve_mps, motion.vd_mps) < 0.5

    def _begin(self) -> None:
        self._flies = True
        self._plant.hold(False)
        lies = self._plant.motion.up_m < 0.1 and self._plant.motion.airspeed_mps < _RELEASE_MPS
        self._thrown_s = 0.0 if lies else None
        self._thrust_sum_n = self._pitch_sum_rad = 0.0
        self._airspeed_mps = _RELEASE_MPS

    def _throw(self) -> None:
        """Pull until the aircraft has its airspeed, or the rail ends."""
        self._thrown_s = (self._thrown_s or 0.0) + self._step_s
        over = self._plant.motion.airspeed_mps >= _RELEASE_MPS or self._thrown_s > _CATAPULT_MOST_S
        self._plant.write("catapult-n", 0.0 if over else _CATAPULT_N)
        if over:
            self._thrown_s = None

    def _roll_rad(self, target: FlightTarget) -> float:
        """The bank angle whose turn has the acceleration that guidance commands."""
        bank = min(target.bank_max_rad, _BANK_MAX_RAD) if isinstance(target, WingTarget) else _BANK_MAX_RAD
        roll = math.atan(self._sideways_mps2(target) / _G)
        return min(max(roll, -bank), bank)

    def _sideways_mps2(self, target: FlightTarget) -> float:
        motion = self._plant.motion
        vn, ve = motion.vn_mps, motion.ve_mps
        if target.north_east_m is None:
            north, east = target.velocity_ned_mps[:2]
            return _toward(vn, ve, north, east) if math.hypot(north, east) > 1e-6 else 0.0
        error_e, error_n, _ = self.error_enu_m
        north = target.north_east_m[0] + self._home_north_m - (motion.north_m + error_n)
        east = target.north_east_m[1] + self._home_east_m - (motion.east_m + error_e)
        radius = target.radius_m if isinstance(target, WingTarget) else None
        if radius is None:
            return _toward(vn, ve, north, east)
        return _around(vn, ve, north, east, math.copysign(max(abs(radius), _TIGHTEST_M), radius))

    def _climb(self, target: FlightTarget) -> tuple[float, float]:
        """Pitch in radians, and throttle 0 to 1."""
        motion, speed = self._plant.motion, max(self._airspeed_mps, 8.0)
        wanted_mps = min(max(target.speed_max_mps, _SLOWEST_MPS), _FASTEST_MPS)
        motor = not isinstance(target, WingTarget) or target.motor
        missing_mps = wanted_mps - self._airspeed_mps
        climb = self._climb_mps(target)
        if motor and missing_mps > _SLOW_MPS:
            climb = min(climb, 3.0 - 2.0 * (missing_mps - _SLOW_MPS))
            climb = max(climb, -_DESCENT_MPS)
        load = 1.0 / math.cos(min(abs(motion.roll_rad), 1.0))
        pressure = 0.5 * _AIR_KGPM3 * speed * speed * AREA_M2
        lift = load * MASS_KG * _G / pressure
        path = math.asin(min(max(climb / speed, -0.4), 0.4))
        short_rad = (climb + motion.vd_mps) / speed
        self._pitch_sum_rad = min(max(self._pitch_sum_rad + 0.3 * short_rad * self._step_s, -0.1), 0.1)
        pitch = path + (lift - LIFT_0) / LIFT_PER_RAD + 0.6 * short_rad + self._pitch_sum_rad
        drag_n = pressure * (DRAG_0 + DRAG_PER_LIFT2 * lift * lift)
        need_n = drag_n + MASS_KG * (_G * climb / speed + 0.8 * missing_mps) + self._thrust_sum_n
        most_n = most_thrust_n(speed)
        if 0.0 < need_n < most_n:
            self._thrust_sum_n = min(max(self._thrust_sum_n + 0.3 * missing_mps * self._step_s, -3.0), 3.0)
        throttle = min(max(need_n / most_n, 0.0), 1.0) if motor else 0.0
        return min(max(pitch, _PITCH_RAD[0]), _PITCH_RAD[1]), throttle

    def _climb_mps(self, target: FlightTarget) -> float:
        sinking = target.velocity_ned_mps[2]
        if target.down_m is None:
            climb = -sinking
        else:
            height_m = self._plant.motion.up_m + self.error_enu_m[2]
            climb = 0.5 * (-target.down_m - height_m) - sinking
        climb = max(climb, -min(target.descent_max_mps, _DESCENT_MPS))
        return min(climb, min(target.climb_max_mps, _CLIMB_MPS))


def _toward(vn: float, ve: float, north: float, east: float) -> float:
    """Acceleration to the right that turns the ground velocity towards a direction."""
    speed = math.hypot(vn, ve)
    eta = math.remainder(math.atan2(east, north) - math.atan2(ve, vn), 2.0 * math.pi)
    eta = min(max(eta, -0.5 * math.pi), 0.5 * math.pi)
    reach = max(_DAMPING * _PERIOD_S / math.pi * speed, 1.0)
    return 4.0 * _DAMPING**2 * speed * speed / reach * math.sin(eta)


def _around(vn: float, ve: float, north: float, east: float, radius: float) -> float:
    """Acceleration to the right for a circle of `radius` (positive clockwise) around a place from here."""
    turn = math.copysign(1.0, radius)
    away = max(math.hypot(north, east), 0.1)
    capture = _toward(vn, ve, north, east)
    outward = -(vn * north + ve * east) / away
    # A clockwise circle has its centre on the right.
    along = turn * (vn * east - ve * north) / away
    omega = 2.0 * math.pi / _PERIOD_S
    beyond = away - abs(radius)
    law = beyond * omega * omega + outward * 2.0 * _DAMPING * omega
    if along < 0.0:
        law = max(law, 0.0)
    circle = turn * (law + along * along / max(0.5 * abs(radius), abs(radius) + beyond))
    if beyond > 0.0 and turn * capture < turn * circle:
        return capture
    return circle
