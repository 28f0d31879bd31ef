"""The return: climb, fly home, land."""

from __future__ import annotations

import math
from dataclasses import replace

from ..state._flight_limits import FlightLimits, PathLimits
from ..state._flight_state import FlightState, FlightTarget, NorthEast, ReferencePoint
from ..state._shaping import UNSHAPED, StraightLine
from ._manoeuvres import Hold, Land, Manoeuvre, stopping_m, stopping_place


class Return(Manoeuvre):
    """Climb, go home, descend to a height where the autopilot waits, land."""

    def __init__(self, flight: FlightState, home: ReferencePoint, limits: FlightLimits) -> None:
        self._home = home
        distance_m = math.hypot(flight.north_m - home.north_m, flight.east_m - home.east_m)
        height_m = home.down_m - flight.down_m
        cruise_m = max(limits.return_height_m, height_m + (limits.return_climbs_by_m or 0.0))
        if limits.return_climbs_by_m is None and distance_m < limits.return_near_m:
            cruise_m = height_m
        self._cruise_down_m = home.down_m - max(cruise_m, height_m)
        self._climb = Hold(flight, stopping_place(flight), self._cruise_down_m)
        # Above home; never a climb.
        lower_m = limits.return_descends_to_m
        self._wait_down_m = self._cruise_down_m
        if lower_m is not None:
            self._wait_down_m = max(self._cruise_down_m, home.down_m - lower_m)
        self._is_above_home = False
        self._faces = limits.return_faces_home
        self._is_near = distance_m < limits.return_near_m
        # Source, and flights of PX4: it lands with the heading that it had when home was set.
        turns = self._faces and math.isfinite(home.yaw_rad)
        self._last_yaw_rad = home.yaw_rad if turns else None
        self._arrived_ns: int | None = None
        self._climbing = self._cruise_down_m < flight.down_m - limits.return_arrives_height_m
        self._land: Land | None = None
        self._path = (
            ReturnPath(flight, (home.north_m, home.east_m), self._cruise_down_m, limits.return_path, limits)
            if limits.return_path
            else None
        )

    @property
    def lands(self) -> bool:
        """Whether it is on its last way down, with no wait before the ground."""
        return self._land is not None

    def heights_m(self, origin_m: float) -> tuple[float, float]:
        """Altitude of the way home, and its height above the ground there; `origin_m` is that of the frame."""
        return origin_m - self._cruise_down_m, self._home.down_m - self._cruise_down_m

    @property
    def landing(self) -> bool:
        return self._land is not None or (self._is_above_home and self._wait_down_m > self._cruise_down_m)

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        if self._land:
            return self._land.target(flight, limits)
        if self._climbing:
            self._climbing = flight.down_m > self._cruise_down_m + limits.return_arrives_height_m
            climb = self._climb.target(flight, limits)
            return self._path.on_climb(climb, flight) if self._path else climb
        home = (self._home.north_m, self._home.east_m)
        distance_m = math.hypot(flight.north_m - home[0], flight.east_m - home[1])
        on_path = self._path is not None and not self._path.is_over(flight)
        self._is_above_home = self._is_above_home or (not on_path and distance_m < limits.return_arrives_m)
        arrived = self._is_above_home and self._wait_down_m - flight.down_m < limits.return_arrives_height_m
        if self._has_waited(flight, limits, arrived):
            self._land = Land(flight, home, self._home.down_m, self._last_yaw_rad)
        down_m = self._wait_down_m if self._is_above_home else self._cruise_down_m
        target = FlightTarget(
            north_east_m=home,
            down_m=down_m,
            yaw_rad=self._yaw_home(flight),
            speed_max_mps=limits.return_mps,
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
            shaping=limits.shaping(down_m - flight.down_m),
        )
        return self._path.on_way(target, flight) if self._path else target

    def _has_waited(self, flight: FlightState, limits: FlightLimits, arrived: bool) -> bool:
        """Whether the vehicle has been above home for long enough."""
        if arrived and self._arrived_ns is None:
            self._arrived_ns = flight.time_ns
        return self._arrived_ns is not None and flight.time_ns - self._arrived_ns >= round(
            limits.return_waits_s * 1e9
        )

    def _yaw_home(self, flight: FlightState) -> float | None:
        """The heading towards home; None near home, where a bearing has no meaning."""
        if not self._faces:
            return None
        if self._is_near:
            return self._last_yaw_rad
        north, east = self._home.north_m - flight.north_m, self._home.east_m - flight.east_m
        return math.atan2(east, north) if math.hypot(north, east) > 3.0 else None


class ReturnPath:
    """The course of a return in time: up from where the vehicle comes to rest, then straight home."""

    def __init__(
        self, flight: FlightState, home: NorthEast, down_m: float, path: PathLimits, limits: FlightLimits
    ) -> None:
        self._down_m = down_m
        self._start = stopping_place(flight)
        distance_m = math.dist(self._start, home)
        self._towards = (
            ((home[0] - self._start[0]) / distance_m, (home[1] - self._start[1]) / distance_m)
            if distance_m > 0.0
            else (0.0, 0.0)
        )
        self._climb_m = max(flight.down_m + stopping_m(flight.vd_mps) - down_m, 0.0)
        self._climb = StraightLine(self._climb_m, limits.climb_mps, path.vertical_accel_mps2, path.jerk_mps3)
        self._way = StraightLine(distance_m, path.speed_mps, path.accel_mps2, path.jerk_mps3)
        self._begun_ns = flight.time_ns
        self._way_begun_ns: int | None = None

    def on_climb(self, target: FlightTarget, flight: FlightState) -> FlightTarget:
        """`target` at this moment of the climb."""
        return self._at(target, flight, 0.0)

    def on_way(self, target: FlightTarget, flight: FlightState) -> FlightTarget:
        """`target` at this moment of the way home, on which the climb may still be ending."""
        if self.is_over(flight):
            return target
        if self._way_begun_ns is None:
            self._way_begun_ns = flight.time_ns
        return self._at(target, flight, (flight.time_ns - self._way_begun_ns) * 1e-9)

    def is_over(self, flight: FlightState) -> bool:
        """Whether both the climb and the way home have taken their time."""
        if self._way_begun_ns is None:
            return False
        way_s = (flight.time_ns - self._way_begun_ns) * 1e-9
        climb_s = (flight.time_ns - self._begun_ns) * 1e-9
        return bool(way_s > self._way.duration_s and climb_s > self._climb.duration_s)

    def _at(self, target: FlightTarget, flight: FlightState, way_s: float) -> FlightTarget:
        way_m, speed_mps, accel_mps2 = self._way.at(way_s)
        risen_m, climb_mps, lift_mps2 = self._climb.at((flight.time_ns - self._begun_ns) * 1e-9)
        north, east = self._towards
        return replace(
            target,
            north_east_m=(self._start[0] + north * way_m, self._start[1] + east * way_m),
            down_m=self._down_m + self._climb_m - risen_m,
            velocity_ned_mps=(north * speed_mps, east * speed_mps, -climb_mps),
            acceleration_ned_mps2=(north * accel_mps2, east * accel_mps2, -lift_mps2),
            shaping=UNSHAPED,
        )
