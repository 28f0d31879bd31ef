"""Manoeuvres that a pilot's sticks fly, or change: manual flight, and circles in a mode with sticks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from ..state._flight_limits import FlightLimits
from ..state._flight_state import (
    FlightState,
    FlightTarget,
    NorthEast,
    StickControl,
    StickPositions,
    TargetAttitude,
)
from ._manoeuvres import Manoeuvre, stopping_m, stopping_place


class ThrottleHeight:
    """Height by a throttle stick: its middle holds, above that it climbs, below it descends."""

    def __init__(self) -> None:
        self._held_m: float | None = None

    def target(self, flight: FlightState, limits: FlightLimits) -> tuple[float | None, float]:
        """Height to hold and velocity downwards."""
        sticks, stick_limits = flight.sticks or StickPositions(), limits.sticks
        deflection = beyond_dead_zone(sticks.throttle, stick_limits.dead)
        if deflection == 0.0:
            if self._held_m is None:
                self._held_m = flight.down_m + stopping_m(flight.vd_mps)
            return self._held_m, 0.0
        self._held_m = None
        return None, -deflection * (stick_limits.climb_mps if deflection > 0.0 else stick_limits.descent_mps)


class ManualFlight(Manoeuvre):
    """Fly by the sticks of a pilot."""

    def __init__(self, flight: FlightState, stick: StickControl) -> None:
        self._stick = stick
        self._height = ThrottleHeight()
        self._place: NorthEast | None = None

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        sticks, stick_limits = flight.sticks or StickPositions(), limits.sticks
        down, sink = (
            (None, 0.0)
            if self._stick in (StickControl.RATES, StickControl.ATTITUDE)
            else self._height.target(flight, limits)
        )
        velocity = self._velocity(sticks, flight, limits)
        return FlightTarget(
            north_east_m=self._place,
            down_m=down,
            velocity_ned_mps=(*velocity, sink),
            yawrate_radps=beyond_dead_zone(sticks.yaw, stick_limits.dead) * stick_limits.yaw_radps,
            speed_max_mps=stick_limits.speed_mps,
            climb_max_mps=stick_limits.climb_mps,
            descent_max_mps=stick_limits.descent_mps,
            attitude=self._attitude(sticks, flight, limits),
        )

    def _velocity(self, sticks: StickPositions, flight: FlightState, limits: FlightLimits) -> NorthEast:
        if self._stick is not StickControl.POSITION:
            return 0.0, 0.0
        forward, right = (
            beyond_dead_zone(stick, limits.sticks.dead) * limits.sticks.speed_mps
            for stick in (sticks.pitch, sticks.roll)
        )
        if forward == right == 0.0:
            # On its feet it holds still: following a position that wanders would turn it over.
            self._place = None if flight.on_ground else self._place or stopping_place(flight)
            return 0.0, 0.0
        self._place = None
        cos, sin = math.cos(flight.yaw_rad), math.sin(flight.yaw_rad)
        return cos * forward - sin * right, sin * forward + cos * right

    def _attitude(
        self, sticks: StickPositions, flight: FlightState, limits: FlightLimits
    ) -> TargetAttitude | None:
        if self._stick is StickControl.POSITION:
            return None
        stick_limits = limits.sticks
        thrust = (
            None if self._stick is StickControl.ALTITUDE else _thrust(sticks.throttle, flight.hover_thrust)
        )
        if self._stick is StickControl.RATES:
            rates = (
                sticks.roll * stick_limits.rates_radps,
                -sticks.pitch * stick_limits.rates_radps,
                sticks.yaw * stick_limits.yaw_radps,
            )
            return TargetAttitude(thrust=thrust, rates_radps=rates)
        # On its feet the vehicle would turn over when it tilts.
        share = 0.0 if flight.on_ground else 1.0
        return TargetAttitude(
            sticks.roll * stick_limits.tilt_rad * share, -sticks.pitch * stick_limits.tilt_rad * share, thrust
        )


@dataclass(eq=False)
class Circle(Manoeuvre):
    """Circle a centre: first to the nearest point of the circle, then along it at constant speed."""

    JOINED_M = 1.0

    centre: NorthEast
    down_m: float
    radius_m: float
    speed_mps: float  # negative: anticlockwise
    _faces_direction: Literal["in", "ahead", "kept"] = "in"
    _angle_rad: float | None = None
    _flown_mps: float = 0.0
    _height: ThrottleHeight = field(default_factory=ThrottleHeight)

    @classmethod
    def around_point_ahead(cls, flight: FlightState, limits: FlightLimits) -> Circle:
        """Around a point one radius ahead of the nose."""
        radius = limits.circle_radius_m
        centre = (
            flight.north_m + radius * math.cos(flight.yaw_rad),
            flight.east_m + radius * math.sin(flight.yaw_rad),
        )
        return cls(centre, flight.down_m, radius, radius * limits.circle_radps)

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        north, east = flight.north_m - self.centre[0], flight.east_m - self.centre[1]
        # Away from the circle the vehicle first flies to its nearest point, without speed along it.
        if self._angle_rad is None and abs(math.hypot(north, east) - self.radius_m) > self.JOINED_M:
            angle, speed = math.atan2(east, north), 0.0
        else:
            self._accelerate(flight)
            speed = self._flown_mps
            angle = math.atan2(east, north) if self._angle_rad is None else self._angle_rad
            angle = self._angle_rad = angle + speed / self.radius_m * flight.step_s
        cos, sin = math.cos(angle), math.sin(angle)
        inwards_mps2 = -speed * speed / self.radius_m
        down, sink = self._vertical(flight, limits)
        return FlightTarget(
            north_east_m=(self.centre[0] + self.radius_m * cos, self.centre[1] + self.radius_m * sin),
            down_m=down,
            velocity_ned_mps=(-speed * sin, speed * cos, sink),
            acceleration_ned_mps2=(inwards_mps2 * cos, inwards_mps2 * sin, 0.0),
            yaw_rad=self._yaw_rad(angle, flight),
            speed_max_mps=max(limits.cruise_mps, abs(self.speed_mps) + 2.0),
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
        )

    def _accelerate(self, flight: FlightState) -> None:
        max_change = 1.5 * flight.step_s
        self._flown_mps += min(max(self.speed_mps - self._flown_mps, -max_change), max_change)

    def _vertical(self, flight: FlightState, limits: FlightLimits) -> tuple[float | None, float]:
        """Height and sink rate; in a mode with sticks the throttle changes the height."""
        if flight.mode.stick is None or flight.sticks is None:
            return self.down_m, 0.0
        return self._height.target(flight, limits)

    def _yaw_rad(self, angle: float, flight: FlightState) -> float | None:
        if self._faces_direction == "in":
            return angle + math.pi
        if self._faces_direction == "ahead":
            return angle + math.copysign(math.pi / 2, self.speed_mps)
        return None


def beyond_dead_zone(stick: float, dead: float) -> float:
    """A stick's share beyond its dead zone, -1 to 1."""
    return math.copysign(max(abs(stick) - dead, 0.0) / (1.0 - dead), stick)


def _thrust(throttle: float, hover: float) -> float:
    """Thrust of a throttle stick, -1 to 1; its middle carries the vehicle."""
    return hover * (1.0 + throttle) if throttle < 0.0 else hover + throttle * (1.0 - hover)
