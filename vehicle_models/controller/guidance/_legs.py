"""The legs of a mission: manoeuvres with an end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from ..state._flight_limits import FlightLimits
from ..state._flight_state import FlightState, FlightTarget, LandedState, NorthEast
from ..state._shaping import UNSHAPED
from ._manoeuvres import Hold, Land, Manoeuvre, Takeoff
from ._return import Return
from ._waypoints import WaypointApproach, WaypointPath

HeadingFunction = Callable[[FlightState, NorthEast], "float | None"]
"""The heading to fly with towards a place; None keeps the present one."""

# The largest radius that ArduPilot can store.
_MAX_RADIUS_M = 2550.0
# Closer than this a bearing has no meaning.
_MIN_BEARING_DISTANCE_M = 3.0


class MissionLeg(Protocol):
    """One item that is flown. `manoeuvre` is what guidance flies meanwhile."""

    @property
    def manoeuvre(self) -> Manoeuvre: ...

    def over(self, flight: FlightState) -> bool:
        """Whether the next item may begin; called once a step."""


class GotoLeg(Hold):
    """Fly to a place and stay there for a time: 0 passes through, infinity stays for ever."""

    def __init__(
        self,
        flight: FlightState,
        place: NorthEast,
        down_m: float,
        heading_towards: HeadingFunction,
        radius_m: float,
        height_m: float,
        stay_s: float,
        speed_mps: float | None = None,
        begin: NorthEast | None = None,
        course: WaypointApproach | WaypointPath | None = None,
    ) -> None:
        super().__init__(flight, place, down_m, speed_mps=speed_mps)
        self._goal, self._height = place, down_m
        self.course = course
        """How the place is approached; None: like any other place."""
        self.line = (begin or (flight.north_m, flight.east_m), place)
        """From the place where the leg begins, by default here, to its end."""
        self._heading_towards = heading_towards
        self._radius_m, self._height_m = radius_m, height_m
        self._stay_ns = stay_s * 1e9
        self._arrived_ns: int | None = None
        self._heading_rad = flight.yaw_rad

    @property
    def manoeuvre(self) -> Manoeuvre:
        return self

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        heading = self._heading_towards(flight, self._goal)
        if heading is not None:
            self._heading_rad = heading
        place, speed_mps = self._goal, self._speed_mps or limits.cruise_mps
        if isinstance(self.course, WaypointApproach):
            place, speed_mps = self.course.aim(flight, limits, speed_mps)
        target = FlightTarget(
            north_east_m=place,
            down_m=self._height,
            yaw_rad=self._heading_rad,
            speed_max_mps=speed_mps,
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
            shaping=limits.shaping(self._height - flight.down_m),
        )
        if not isinstance(self.course, WaypointPath) or self.course.is_at_rest(flight.time_ns):
            return target
        (north, east, down), velocity, acceleration = self.course.target_at(flight.time_ns)
        # The path is the autopilot's own shaping.
        return replace(
            target,
            north_east_m=(north, east),
            down_m=down,
            velocity_ned_mps=velocity,
            acceleration_ned_mps2=acceleration,
            shaping=UNSHAPED,
        )

    def change_speed(self, speed_mps: float) -> None:
        """Fly on at another speed. A path in time has its speed in it, so it is left."""
        super().change_speed(speed_mps)
        if isinstance(self.course, WaypointPath):
            self.course = None

    @property
    def stays_at(self) -> NorthEast | None:
        """The place where it stays, for a time or for ever; None on the way, and where it passes through."""
        stays = self._stay_ns == math.inf or (self._arrived_ns is not None and self._stay_ns > 0.0)
        return self._goal if stays else None

    def over(self, flight: FlightState) -> bool:
        if self._arrived_ns is None and self._is_there(flight):
            self._arrived_ns = flight.time_ns
        return self._arrived_ns is not None and flight.time_ns - self._arrived_ns >= self._stay_ns

    def _is_there(self, flight: FlightState) -> bool:
        if isinstance(self.course, WaypointPath):
            if not self.course.over(flight.time_ns):
                return False
            # A waypoint that is only passed counts as soon as the path is halfway through the turn.
            if self.course.passes:
                return True
        level_m = math.hypot(self._goal[0] - flight.north_m, self._goal[1] - flight.east_m)
        return level_m < self._radius_m and abs(self._height - flight.down_m) < self._height_m


class ClimbLeg(Takeoff):
    """Climb straight up, from the ground or in the air."""

    @property
    def manoeuvre(self) -> Manoeuvre:
        return self

    def over(self, flight: FlightState) -> bool:
        return flight.landed in (LandedState.IN_AIR, LandedState.LANDING) and self.done(flight)


class DescendLeg:
    """Land, or return and land; over when the vehicle is on the ground."""

    def __init__(self, manoeuvre: Land | Return) -> None:
        self.manoeuvre: Manoeuvre = manoeuvre
        self._flew = False

    def over(self, flight: FlightState) -> bool:
        # Before the takeoff the vehicle is on the ground as well, and has not landed.
        self._flew = self._flew or flight.flying
        return self._flew and flight.landed is LandedState.ON_GROUND


class TurnsLeg(Manoeuvre):
    """Fly a number of turns around a place; a negative radius turns left."""

    def __init__(
        self,
        flight: FlightState,
        centre: NorthEast,
        down_m: float,
        radius_m: float,
        turns: float,
        heading_towards: HeadingFunction,
        speed_mps: float | None,
    ) -> None:
        self._centre, self._down_m, self._heading_towards = centre, down_m, heading_towards
        self._radius_m = min(max(abs(radius_m), 1.0), _MAX_RADIUS_M)
        self._sense = -1.0 if radius_m < 0.0 else 1.0
        self._remaining_rad = 2.0 * math.pi * turns
        self._angle_rad = self._angle(flight)
        self._on_circle = False
        self.speed_mps = speed_mps

    @property
    def circle(self) -> tuple[NorthEast, float, float]:
        """Centre, height (down) and radius, negative to the left."""
        return self._centre, self._down_m, self._radius_m * self._sense

    @property
    def manoeuvre(self) -> Manoeuvre:
        return self

    def _angle(self, flight: FlightState) -> float:
        return math.atan2(flight.east_m - self._centre[1], flight.north_m - self._centre[0])

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        angle, radius = self._angle(flight), self._radius_m
        # Centripetal acceleration of 2 m/s2 at most.
        speed = min(self.speed_mps or limits.cruise_mps, math.sqrt(2.0 * radius))
        north, east = math.cos(angle), math.sin(angle)
        distance_m = math.hypot(flight.north_m - self._centre[0], flight.east_m - self._centre[1])
        self._on_circle = self._on_circle or abs(distance_m - radius) < max(2.0, 0.05 * radius)
        along = (-east * speed * self._sense, north * speed * self._sense, 0.0)
        return FlightTarget(
            north_east_m=(self._centre[0] + north * radius, self._centre[1] + east * radius),
            down_m=self._down_m,
            velocity_ned_mps=along if self._on_circle else (0.0, 0.0, 0.0),
            yaw_rad=self._heading_towards(flight, self._centre),
            speed_max_mps=max(speed * 1.5, 1.0),
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
        )

    def over(self, flight: FlightState) -> bool:
        angle = self._angle(flight)
        if self._on_circle:
            self._remaining_rad -= self._sense * math.remainder(angle - self._angle_rad, 2.0 * math.pi)
        self._angle_rad = angle
        return self._remaining_rad <= 0.0


def bearing(flight: FlightState, place: NorthEast) -> float | None:
    """The bearing of a place; None where it is too close to have one."""
    north, east = place[0] - flight.north_m, place[1] - flight.east_m
    return math.atan2(east, north) if math.hypot(north, east) > _MIN_BEARING_DISTANCE_M else None
