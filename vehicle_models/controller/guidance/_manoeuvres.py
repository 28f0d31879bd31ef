"""Manoeuvres: each turns the present state into a target for the airframe."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace

from ..state._flight_limits import FlightLimits
from ..state._flight_state import FlightState, FlightTarget, NorthEast, TargetAttitude
from ..state._shaping import UNSHAPED

# The airframe brakes harder than this when it must.
_STOPPING_MPS2 = 2.0


class Manoeuvre(ABC):
    """One manoeuvre that is flown."""

    @abstractmethod
    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        """Where to go during the next step."""

    def done(self, flight: FlightState) -> bool:
        """Whether the manoeuvre is complete, which some never are; the modes decide what follows."""
        return False


class Hold(Manoeuvre):
    """Stay at a place, by default where the vehicle comes to rest when it brakes now; or fly there and stay."""

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


class Takeoff(Manoeuvre):
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


class Land(Manoeuvre):
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
            # On its feet it holds still: following a position that wanders would turn it over.
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


class FollowSetpoints(Manoeuvre):
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
        accelerates = any(self._accelerates)
        return self._with_integrated_velocity(self._setpoint, flight) if accelerates else self._setpoint

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
        down = velocity[2] if vertically else setpoint_velocity[2]
        return replace(target, velocity_ned_mps=(north, east, down))


def stopping_m(speed_mps: float) -> float:
    return math.copysign(speed_mps * speed_mps / (2.0 * _STOPPING_MPS2), speed_mps)


def stopping_place(flight: FlightState) -> NorthEast:
    speed = math.hypot(flight.vn_mps, flight.ve_mps)
    ahead_s = speed / (2.0 * _STOPPING_MPS2) + 0.2 * min(speed, 1.0)
    return flight.north_m + flight.vn_mps * ahead_s, flight.east_m + flight.ve_mps * ahead_s
