"""Guidance of a fixed wing: manoeuvres where a multicopter would hover or fly straight up and down."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from bench.values import value_class

from ..state._flight_limits import FlightLimits, Seconds
from ..state._flight_state import FlightState, FlightTarget, NorthEast, ReferencePoint
from ._guidance import Manoeuvres
from ._legs import GotoLeg, TurnsLeg
from ._manoeuvres import FollowSetpoints, Hold, Land, Manoeuvre, Takeoff
from ._return import Return
from ._sticks import Circle

# How far ahead on a line it aims, in seconds of flight; the airframe's lateral law is made for it.
_LEAD_S = 2.2
_BANK_MAX_RAD = math.radians(45.0)


@value_class(frozen=True, slots=True)
class WingTarget(FlightTarget):
    """A target for an aircraft that has to keep moving. `speed_max_mps` is the airspeed to hold, `down_m` is
    met by climbing on the way.

    With a place, `radius_m` circles around it, clockwise when positive; None flies over it. Without one the
    direction of `velocity_ned_mps` is the course; its third component is the sink rate without `down_m`, and
    added to it beside one.
    """

    radius_m: float | None = None
    motor: bool = True
    bank_max_rad: float = _BANK_MAX_RAD


@dataclass(frozen=True, slots=True, kw_only=True)
class WingLimits(FlightLimits):
    """Limits with what only a fixed wing has. `cruise_mps`, `speed_max_mps` are airspeeds."""

    min_airspeed_mps: float
    landing_mps: float
    loiter_radius_m: float  # negative: anticlockwise
    return_radius_m: float
    descend_height_m: float  # above home, circled at before landing
    land_delay_s: Seconds | None  # of that circling; None: until commanded
    glide_rad: float
    flare_height_m: float
    flare_sink_mps: float


def wing_limits(limits: FlightLimits) -> WingLimits:
    """The limits as those of a fixed wing. Raises TypeError for those of a multicopter."""
    if not isinstance(limits, WingLimits):
        raise TypeError("a fixed wing needs the limits of a fixed wing")
    return limits


class WingHold(Hold):
    """Circle around a place; by default around where the vehicle is now."""

    def __init__(
        self,
        flight: FlightState,
        north_east_m: NorthEast | None = None,
        down_m: float | None = None,
        speed_mps: float | None = None,
        radius_m: float | None = None,
    ) -> None:
        self._place = north_east_m or (flight.north_m, flight.east_m)
        self._down_m = flight.down_m if down_m is None else down_m
        self._speed_mps = speed_mps
        self._radius_m = radius_m

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        return _circle(wing_limits(limits), self._place, self._down_m, self._radius_m, self._speed_mps)


class WingTakeoff(Takeoff):
    """Climb off the catapult, straight ahead, to a height."""

    REACHED_M = 1.5

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        return _climb_ahead(wing_limits(limits), self._down_m, self._yaw_rad)

    def done(self, flight: FlightState) -> bool:
        return flight.down_m - self._down_m < self.REACHED_M

    def hold(self, flight: FlightState) -> Hold:
        """Circle here, at the height."""
        return WingHold(flight, down_m=self._down_m)


class WingLand(Land):
    """Descend in a circle to the beginning of the glide path, follow it against the wind, and flare."""

    APPROACH_HEIGHT_M = 25.0
    # How far ahead on the path it aims.
    LEAD_M = 40.0
    # How long the flare floats, in seconds at landing speed; the glide path ends so far before the place.
    FLOAT_S = 2.1

    def __init__(
        self, flight: FlightState, north_east_m: NorthEast | None = None, ground_down_m: float = 0.0
    ) -> None:
        self._landing_place = north_east_m or (flight.north_m, flight.east_m)
        self._ground_down_m = ground_down_m
        self._course_rad, self._headwind_mps = _into_wind(flight)
        self._phase = "circle"

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        wing = wing_limits(limits)
        height_m = self._ground_down_m - flight.down_m
        along_m, _ = self._along(flight)
        if self._phase == "circle" and self._at_entry(flight, wing, height_m):
            self._phase = "glide"
        if self._phase == "glide" and height_m < wing.flare_height_m:
            self._phase = "flare"
        if self._phase == "circle":
            down = self._ground_down_m - self.APPROACH_HEIGHT_M
            return _circle(wing, self._turn_centre(wing), down, abs(wing.loiter_radius_m))
        cos, sin = math.cos(self._course_rad), math.sin(self._course_rad)
        ahead_m = along_m + self.LEAD_M
        place = (self._landing_place[0] + ahead_m * cos, self._landing_place[1] + ahead_m * sin)
        slope = math.tan(wing.glide_rad)
        if self._phase == "glide":
            path_m = max(-along_m - self._float_m(wing), 0.0) * slope
            return WingTarget(
                north_east_m=place,
                down_m=self._ground_down_m - path_m,
                velocity_ned_mps=(0.0, 0.0, slope * math.hypot(flight.vn_mps, flight.ve_mps)),
                speed_max_mps=wing.landing_mps,
                climb_max_mps=wing.climb_mps,
                descent_max_mps=wing.descent_mps,
            )
        return WingTarget(
            north_east_m=place,
            velocity_ned_mps=(0.0, 0.0, wing.flare_sink_mps),
            speed_max_mps=wing.landing_mps,
            descent_max_mps=wing.descent_mps,
            motor=False,
            bank_max_rad=math.radians(5.0),
        )

    def _along(self, flight: FlightState) -> NorthEast:
        """The vehicle's place from the landing place: metres along the course, and to the right of it."""
        north, east = flight.north_m - self._landing_place[0], flight.east_m - self._landing_place[1]
        cos, sin = math.cos(self._course_rad), math.sin(self._course_rad)
        return north * cos + east * sin, east * cos - north * sin

    def _entry_m(self, wing: WingLimits) -> float:
        return self.APPROACH_HEIGHT_M / math.tan(wing.glide_rad) + self._float_m(wing)

    def _float_m(self, wing: WingLimits) -> float:
        return self.FLOAT_S * max(wing.landing_mps - self._headwind_mps, 0.0)

    def _turn_centre(self, wing: WingLimits) -> NorthEast:
        """The centre of the clockwise circle that leads into the glide path."""
        back_m, offset_m = self._entry_m(wing), abs(wing.loiter_radius_m)
        cos, sin = math.cos(self._course_rad), math.sin(self._course_rad)
        north, east = self._landing_place
        return north - back_m * cos - offset_m * sin, east - back_m * sin + offset_m * cos

    def _at_entry(self, flight: FlightState, wing: WingLimits, height_m: float) -> bool:
        along_m, right_m = self._along(flight)
        course = math.atan2(flight.ve_mps, flight.vn_mps)
        # The glide begins only where the circle meets the path in its direction.
        aligned = abs(math.remainder(course - self._course_rad, 2.0 * math.pi)) < math.radians(25.0)
        at_place = math.hypot(along_m + self._entry_m(wing), right_m) < 40.0
        return aligned and at_place and height_m < self.APPROACH_HEIGHT_M + 3.0


class WingReturn(Return):
    """Fly home at the return height, descend in circles over it, and land where the parameters ask for it."""

    def __init__(self, flight: FlightState, home: ReferencePoint, limits: FlightLimits) -> None:
        wing = wing_limits(limits)
        self._home = home
        height_m = home.down_m - flight.down_m
        self._cruise_down_m = home.down_m - max(wing.return_height_m, height_m)
        self._arrived = False
        self._descended_ns: int | None = None
        self._land = None

    @property
    def landing(self) -> bool:
        # The circles on the way down are flown above home and are no landing.
        return self._land is not None

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        if self._land:
            return self._land.target(flight, limits)
        wing = wing_limits(limits)
        home = (self._home.north_m, self._home.east_m)
        distance_m = math.hypot(flight.north_m - home[0], flight.east_m - home[1])
        self._arrived = self._arrived or distance_m < 1.25 * abs(wing.return_radius_m)
        descended_down = self._home.down_m - wing.descend_height_m
        if self._arrived and flight.down_m > descended_down - 2.0 and self._descended_ns is None:
            self._descended_ns = flight.time_ns
        since_ns, delay_s = self._descended_ns, wing.land_delay_s
        if since_ns is not None and delay_s is not None and flight.time_ns - since_ns >= round(delay_s * 1e9):
            self._land = WingLand(flight, home, self._home.down_m)
        down = descended_down if self._arrived else self._cruise_down_m
        return _circle(wing, home, down, wing.return_radius_m)


class WingFollowSetpoints(FollowSetpoints):
    """The setpoints of a companion: a position is circled, a velocity is a course with a climb."""

    def __init__(self, flight: FlightState, rest: Hold | None = None) -> None:
        super().__init__(flight, WingHold(flight))

    def lapse(self, flight: FlightState) -> None:
        super().lapse(flight)
        self._rest = WingHold(flight)

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        wing = wing_limits(limits)
        if self._setpoint is None:
            return self._rest.target(flight, limits)
        setpoint = super().target(flight, limits)
        if setpoint.attitude:
            return setpoint
        speed = math.hypot(*setpoint.velocity_ned_mps[:2])
        return WingTarget(
            north_east_m=setpoint.north_east_m,
            down_m=setpoint.down_m,
            velocity_ned_mps=setpoint.velocity_ned_mps,
            speed_max_mps=speed if speed > 1.0 else wing.cruise_mps,
            climb_max_mps=wing.climb_mps,
            descent_max_mps=wing.descent_mps,
            radius_m=wing.loiter_radius_m,
        )


class WingManoeuvres(Manoeuvres):
    """The manoeuvres of a fixed wing."""

    shapes_waypoints = False
    approaches_landing = True
    min_acceptance_radius_m, min_acceptance_height_m = 25.0, 10.0
    takeoff, land, go_home, follow = WingTakeoff, WingLand, WingReturn, WingFollowSetpoints

    def turning_radius_m(self, requested_m: float, limits: FlightLimits) -> float:
        if not requested_m:
            return wing_limits(limits).loiter_radius_m
        return math.copysign(max(abs(requested_m), 30.0), requested_m)

    def hold(
        self,
        flight: FlightState,
        north_east_m: NorthEast | None = None,
        down_m: float | None = None,
        yaw_rad: float | None = None,
        speed_mps: float | None = None,
        radius_m: float | None = None,
    ) -> Hold:
        return WingHold(flight, north_east_m, down_m, speed_mps, radius_m)

    def shaped(
        self, manoeuvre: Manoeuvre, target: FlightTarget, flight: FlightState, limits: FlightLimits
    ) -> FlightTarget:
        """Turn circles and climbs into what a wing flies; other targets stay as they are."""
        wing = wing_limits(limits)
        if isinstance(target, WingTarget) or target.attitude:
            return target
        if isinstance(manoeuvre, Circle):
            radius_m = math.copysign(manoeuvre.radius_m, manoeuvre.speed_mps)
            return _circle(wing, manoeuvre.centre, manoeuvre.down_m, radius_m)
        if isinstance(manoeuvre, TurnsLeg):
            return _circle(wing, *manoeuvre.circle, manoeuvre.speed_mps)
        down = flight.down_m if target.down_m is None else target.down_m
        if isinstance(manoeuvre, GotoLeg):
            if manoeuvre.stays_at:
                return _circle(wing, manoeuvre.stays_at, down, None, target.speed_max_mps)
            return replace(target, north_east_m=_aim_point(flight, *manoeuvre.line))
        if isinstance(manoeuvre, Takeoff):
            return _climb_ahead(wing, down, flight.yaw_rad if target.yaw_rad is None else target.yaw_rad)
        return target


def _circle(
    wing: WingLimits,
    place: NorthEast,
    down_m: float,
    radius_m: float | None = None,
    speed_mps: float | None = None,
) -> WingTarget:
    return WingTarget(
        north_east_m=place,
        down_m=down_m,
        speed_max_mps=max(speed_mps or wing.cruise_mps, wing.min_airspeed_mps),
        climb_max_mps=wing.climb_mps,
        descent_max_mps=wing.descent_mps,
        radius_m=radius_m or wing.loiter_radius_m,
    )


def _aim_point(flight: FlightState, begin: NorthEast, end: NorthEast) -> NorthEast:
    """The point of a line to aim at: ahead of the nearest by the lead or its distance, whichever is more."""
    north, east = end[0] - begin[0], end[1] - begin[1]
    length = math.hypot(north, east)
    if length < 1.0:
        return end
    north, east = north / length, east / length
    here = (flight.north_m - begin[0], flight.east_m - begin[1])
    passed_m, offset_m = here[0] * north + here[1] * east, abs(here[1] * north - here[0] * east)
    lead_m = max(_LEAD_S * math.hypot(flight.vn_mps, flight.ve_mps), offset_m)
    aim_m = min(max(passed_m + lead_m, 0.0), length)
    return begin[0] + aim_m * north, begin[1] + aim_m * east


def _climb_ahead(wing: WingLimits, down_m: float, course_rad: float) -> WingTarget:
    return WingTarget(
        down_m=down_m,
        velocity_ned_mps=(math.cos(course_rad), math.sin(course_rad), 0.0),
        speed_max_mps=wing.cruise_mps,
        climb_max_mps=wing.climb_mps,
        descent_max_mps=wing.descent_mps,
        bank_max_rad=math.radians(15.0),  # the tips are near the ground
    )


def _into_wind(flight: FlightState) -> NorthEast:
    """Course into the wind, and its speed, from airspeed and ground speed; in a calm the present course."""
    level = flight.airspeed_mps * math.cos(flight.pitch_rad)
    north = flight.vn_mps - level * math.cos(flight.yaw_rad)
    east = flight.ve_mps - level * math.sin(flight.yaw_rad)
    wind = math.hypot(north, east)
    if wind < 1.5:
        return math.atan2(flight.ve_mps, flight.vn_mps), 0.0
    return math.atan2(-east, -north), wind
