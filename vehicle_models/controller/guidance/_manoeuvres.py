"""Manoeuvres: each turns the present state into a target for the airframe."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal, Protocol

from ..state._flight_limits import FlightLimits, PathLimits
from ..state._flight_state import (
    FlightState,
    FlightTarget,
    NorthEast,
    ReferencePoint,
    StickControl,
    StickPositions,
    TargetAttitude,
)
from ..state._shaping import UNSHAPED, StraightLine

# The airframe brakes harder than this when it must.
_STOPPING_MPS2 = 2.0


class Manoeuvre(Protocol):
    """One manoeuvre that is flown."""

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        """Where to go during the next step."""

    def done(self, flight: FlightState) -> bool:
        """Whether the manoeuvre is complete; the modes decide what follows."""


class Hold:
    """Stay at a place, by default where the vehicle comes to rest when it brakes now; or fly to a place and
    stay.
    """

    def __init__(
        self,
        flight: FlightState,
        north_east_m: NorthEast | None = None,
        down_m: float | None = None,
        yaw_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> None:
        # Braking is the airframe's, as sharp as it can; a place that was given is approached as the autopilot does.
        self._brakes = north_east_m is None
        self._place = north_east_m or stopping_place(flight)
        self._down_m = down_m if down_m is not None else flight.down_m + stopping_m(flight.vd_mps)
        self._yaw_rad = yaw_rad if yaw_rad is not None else flight.yaw_rad
        self._speed_mps = speed_mps
        self._faces = False
        self._previous: tuple[FlightTarget, int] | None = None

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        if self._previous:
            previous_target, until_ns = self._previous
            if flight.time_ns < until_ns:
                return previous_target
            self._previous = None
        if self._faces and limits.faces_beyond_m is not None:
            north, east = self._place[0] - flight.north_m, self._place[1] - flight.east_m
            if math.hypot(north, east) > limits.faces_beyond_m:
                self._yaw_rad = math.atan2(east, north)
        along_motion = self._faces and limits.faces_beyond_m is None
        return FlightTarget(
            north_east_m=self._place,
            down_m=self._down_m,
            yaw_rad=None if along_motion else self._yaw_rad,
            faces_motion=along_motion,
            speed_max_mps=self._speed_mps or limits.cruise_mps,
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
            shaping=UNSHAPED if self._brakes else limits.shaping(self._down_m - flight.down_m),
        )

    def delay(self, flight: FlightState, delay_s: float) -> None:
        """Fly on to the present target for so long."""
        self._previous = (flight.target, flight.time_ns + round(delay_s * 1e9))

    def face_ahead(self) -> None:
        """Turn the nose to the place, as long as that is far enough away."""
        self._faces = True

    def change_down(self, down_m: float) -> None:
        """Fly to another height."""
        self._down_m = down_m

    def change_speed(self, speed_mps: float) -> None:
        self._speed_mps = speed_mps

    def done(self, flight: FlightState) -> bool:
        return False


class Takeoff:
    """Climb straight up to a height; on the ground the rotors spool up first."""

    def __init__(self, flight: FlightState, down_m: float) -> None:
        self._place = (flight.north_m, flight.east_m)
        self._down_m = min(down_m, flight.down_m)
        self._yaw_rad = flight.yaw_rad
        self._begun_ns: int | None = None
        self._spools_up = not flight.flying
        self._reached_m = 0.3  # as the limits said last

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        if self._begun_ns is None:
            self._begun_ns = flight.time_ns
        self._reached_m = limits.takeoff_reached_m
        ramping_s = (flight.time_ns - self._begun_ns) * 1e-9 - limits.takeoff_spool_s
        spooling = self._spools_up and ramping_s < 0.0
        climb_mps = limits.takeoff_mps
        if self._spools_up and ramping_s < limits.takeoff_ramp_s:
            start_mps = limits.takeoff_ramp_from_mps
            climb_mps = start_mps + ramping_s / limits.takeoff_ramp_s * (climb_mps - start_mps)
        return FlightTarget(
            # On its feet it holds still: following a position that wanders would turn it over.
            north_east_m=None if flight.on_ground else self._place,
            down_m=flight.down_m if spooling else self._down_m - limits.takeoff_beyond_m,
            yaw_rad=self._yaw_rad,
            speed_max_mps=limits.cruise_mps,
            climb_max_mps=max(climb_mps, 0.0),
            descent_max_mps=limits.descent_mps,
            shaping=limits.takeoff_shaping,
        )

    def done(self, flight: FlightState) -> bool:
        return not flight.on_ground and abs(flight.down_m - self._down_m) < self._reached_m

    def hold(self, flight: FlightState) -> Hold:
        """Hold at the height of the takeoff."""
        return Hold(flight, self._place, self._down_m, self._yaw_rad)


class Land:
    """Descend straight down, slower near the ground.

    The landing ends where the feet touch, at whatever height that is. Once there is no estimate of position, the
    vehicle descends level and drifts with the wind, also when the estimate comes back (source: ArduCopter; PX4
    begins another manoeuvre then).
    """

    def __init__(
        self,
        flight: FlightState,
        north_east_m: NorthEast | None = None,
        ground_down_m: float = 0.0,
        yaw_rad: float | None = None,
    ) -> None:
        self._place: NorthEast | None = north_east_m or stopping_place(flight)
        self._ground_down_m = ground_down_m
        self._yaw_rad = flight.yaw_rad if yaw_rad is None else yaw_rad
        self._begins_ns = flight.time_ns

    def delay(self, flight: FlightState, delay_s: float) -> None:
        """Stay at this height for so long before the descent."""
        self._begins_ns = flight.time_ns + round(delay_s * 1e9)

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        if not flight.position_ok:
            self._place = None
        blind = self._place is None
        speed, shaping = self._speed_mps(flight, limits), limits.descent_shaping
        if blind and limits.blind_land_mps is not None:
            speed, shaping = limits.blind_land_mps, UNSHAPED
        if flight.time_ns < self._begins_ns:
            speed = 0.0
        return FlightTarget(
            # With its feet on the ground the vehicle holds still: following a position that wanders would
            # turn it over.
            north_east_m=None if flight.on_ground else self._place,
            velocity_ned_mps=(0.0, 0.0, speed),
            yaw_rad=self._yaw_rad,
            speed_max_mps=limits.cruise_mps,
            climb_max_mps=limits.climb_mps,
            descent_max_mps=max(speed, 0.1),
            attitude=TargetAttitude() if blind else None,
            shaping=shaping,
        )

    def _speed_mps(self, flight: FlightState, limits: FlightLimits) -> float:
        height_m = self._ground_down_m - flight.down_m
        span_m = limits.land_fast_above_m - limits.land_slow_below_m
        share = 1.0 if span_m <= 0.0 else min(max((height_m - limits.land_slow_below_m) / span_m, 0.0), 1.0)
        if span_m <= 0.0 and height_m < limits.land_slow_below_m:
            share = 0.0
        return limits.land_mps + share * (limits.descent_mps - limits.land_mps)

    def done(self, flight: FlightState) -> bool:
        return False


class Return:
    """Climb, go home, descend to a height where the autopilot waits, land."""

    def __init__(self, flight: FlightState, home: ReferencePoint, limits: FlightLimits) -> None:
        self._home = home
        distance_m = math.hypot(flight.north_m - home.north_m, flight.east_m - home.east_m)
        height_m = home.down_m - flight.down_m
        if limits.return_climbs_by_m is not None:
            cruise_m = max(limits.return_height_m, height_m + limits.return_climbs_by_m)
        else:
            cruise_m = (
                height_m if distance_m < limits.return_near_m else max(limits.return_height_m, height_m)
            )
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
        """Altitude at which it flies home, and how much that is above the ground there; `origin_m` is the altitude of the
        local frame.
        """
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

    def done(self, flight: FlightState) -> bool:
        return False


class ReturnPath:
    """The course of a return in time: up from where the vehicle comes to rest, then straight home."""

    def __init__(
        self,
        flight: FlightState,
        home: NorthEast,
        down_m: float,
        path: PathLimits,
        limits: FlightLimits,
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
        over: bool = way_s > self._way.duration_s and climb_s > self._climb.duration_s
        return over

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


class FollowSetpoints:
    """Fly the last setpoint of a companion.

    Where it gives acceleration alone (`accelerates`: horizontally, vertically), the integral of it is the
    velocity flown.
    """

    # How far that integral may be ahead of the vehicle's velocity.
    LEAD_MPS = 2.0

    def __init__(self, flight: FlightState, rest: Hold | None = None) -> None:
        self._rest = rest or Hold(flight)
        self._setpoint: FlightTarget | None = None
        self._accelerates = (False, False)
        self._velocity_mps = (0.0, 0.0, 0.0)

    def give(
        self, target: FlightTarget, flight: FlightState, accelerates: tuple[bool, bool] = (False, False)
    ) -> None:
        """Fly `target` from now on."""
        previously, self._accelerates = self._accelerates, accelerates
        north, east, down = self._velocity_mps
        if not previously[0]:
            north, east = flight.vn_mps, flight.ve_mps
        if not previously[1]:
            down = flight.vd_mps
        self._velocity_mps = (north, east, down)
        self._setpoint = target

    def lapse(self, flight: FlightState) -> None:
        """Stop and stay, because no more setpoints come."""
        self._setpoint, self._rest, self._accelerates = None, Hold(flight), (False, False)

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        if self._setpoint is None:
            return self._rest.target(flight, limits)
        return (
            self._with_integrated_velocity(self._setpoint, flight)
            if any(self._accelerates)
            else self._setpoint
        )

    def _with_integrated_velocity(self, target: FlightTarget, flight: FlightState) -> FlightTarget:
        estimated = (flight.vn_mps, flight.ve_mps, flight.vd_mps)
        upper = (target.speed_max_mps, target.speed_max_mps, target.descent_max_mps)
        lower = (-target.speed_max_mps, -target.speed_max_mps, -target.climb_max_mps)
        velocity = []
        for axis, acceleration in enumerate(target.acceleration_ned_mps2):
            # The bound around the estimated velocity keeps the integral from winding up.
            speed = self._velocity_mps[axis] + acceleration * flight.step_s
            speed = min(max(speed, estimated[axis] - self.LEAD_MPS), estimated[axis] + self.LEAD_MPS)
            velocity.append(min(max(speed, lower[axis]), upper[axis]))
        self._velocity_mps = (velocity[0], velocity[1], velocity[2])
        horizontally, vertically = self._accelerates
        setpoint_velocity = target.velocity_ned_mps
        north, east = velocity[:2] if horizontally else setpoint_velocity[:2]
        return replace(
            target, velocity_ned_mps=(north, east, velocity[2] if vertically else setpoint_velocity[2])
        )

    def done(self, flight: FlightState) -> bool:
        return False


class Circle:
    """Circle a centre: first to the nearest point of the circle, then along it at constant speed."""

    JOINED_M = 1.0

    def __init__(
        self,
        centre: NorthEast,
        down_m: float,
        radius_m: float,
        speed_mps: float,  # negative: anticlockwise
        faces: Literal["in", "ahead", "kept"] = "in",
    ) -> None:
        self.centre, self.down_m, self.radius_m, self.speed_mps = centre, down_m, radius_m, speed_mps
        self._faces_direction = faces
        self._angle_rad: float | None = None
        self._flown_mps = 0.0
        self._height = ThrottleHeight()

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

    def done(self, flight: FlightState) -> bool:
        return False

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


class ManualFlight:
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

    def done(self, flight: FlightState) -> bool:
        return False

    def _velocity(self, sticks: StickPositions, flight: FlightState, limits: FlightLimits) -> NorthEast:
        if self._stick is not StickControl.POSITION:
            return 0.0, 0.0
        forward, right = (
            beyond_dead_zone(stick, limits.sticks.dead) * limits.sticks.speed_mps
            for stick in (sticks.pitch, sticks.roll)
        )
        if forward == right == 0.0:
            # With its feet on the ground the vehicle holds still: following a position that wanders would
            # turn it over.
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


class Manoeuvres:
    """The manoeuvres of a multicopter. Another kind of aircraft overrides those that it flies differently."""

    # Whether the speeds and paths of a multicopter's waypoints are flown.
    shapes_waypoints = True
    # Whether a landing begins away from its place.
    approaches_landing = False
    # A wing cannot meet a point exactly, so it raises these lower bounds of the acceptance radius.
    min_acceptance_radius_m, min_acceptance_height_m = 0.0, 0.0

    def turning_radius_m(self, requested_m: float, limits: FlightLimits) -> float:
        """Radius of the turns of a mission; a request of 0 leaves it to the vehicle."""
        return requested_m or 10.0

    def hold(
        self,
        flight: FlightState,
        north_east_m: NorthEast | None = None,
        down_m: float | None = None,
        yaw_rad: float | None = None,
        speed_mps: float | None = None,
        radius_m: float | None = None,
    ) -> Hold:
        """Stay at a place.

        `radius_m` is for an aircraft that cannot hover: positive clockwise, None by the parameters.
        """
        return Hold(flight, north_east_m, down_m, yaw_rad, speed_mps)

    def takeoff(self, flight: FlightState, down_m: float) -> Takeoff:
        return Takeoff(flight, down_m)

    def land(
        self, flight: FlightState, north_east_m: NorthEast | None = None, ground_down_m: float = 0.0
    ) -> Land:
        return Land(flight, north_east_m, ground_down_m)

    def go_home(self, flight: FlightState, home: ReferencePoint, limits: FlightLimits) -> Return:
        return Return(flight, home, limits)

    def follow(self, flight: FlightState, rest: Hold | None = None) -> FollowSetpoints:
        """Fly setpoints; until the first one, `rest` or stay here."""
        return FollowSetpoints(flight, rest)

    def shaped(
        self, manoeuvre: Manoeuvre, target: FlightTarget, flight: FlightState, limits: FlightLimits
    ) -> FlightTarget:
        """The target of any manoeuvre, turned into one that this kind of aircraft can fly."""
        return target


def beyond_dead_zone(stick: float, dead: float) -> float:
    """A stick's share beyond its dead zone, -1 to 1."""
    return math.copysign(max(abs(stick) - dead, 0.0) / (1.0 - dead), stick)


def _thrust(throttle: float, hover: float) -> float:
    """Thrust of a throttle stick, -1 to 1; its middle carries the vehicle."""
    return hover * (1.0 + throttle) if throttle < 0.0 else hover + throttle * (1.0 - hover)


def stopping_m(speed_mps: float) -> float:
    return math.copysign(speed_mps * speed_mps / (2.0 * _STOPPING_MPS2), speed_mps)


def stopping_place(flight: FlightState) -> NorthEast:
    speed = math.hypot(flight.vn_mps, flight.ve_mps)
    ahead_s = speed / (2.0 * _STOPPING_MPS2) + 0.2 * min(speed, 1.0)
    return flight.north_m + flight.vn_mps * ahead_s, flight.east_m + flight.ve_mps * ahead_s
