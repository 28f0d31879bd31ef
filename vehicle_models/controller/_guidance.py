"""Guidance: what each behaviour makes of the present state, one target for the airframe a step."""

from __future__ import annotations

import math
from typing import Protocol

from ._flight import Behaviour, Flight, Home, Target
from ._personality import Limits

_STOPPING_MPS2 = 2.0  # braking that the airframe manages with ease


class Manoeuvre(Protocol):
    """One thing being flown."""

    def target(self, flight: Flight, limits: Limits) -> Target:
        """Where to go during the next step."""

    def done(self, flight: Flight) -> bool:
        """Whether it has reached its end; what follows is the modes' business."""


class Hold:
    """Stay at a place; by default where the vehicle comes to rest when it brakes now. Also the way to a position."""

    def __init__(
        self,
        flight: Flight,
        north_east_m: tuple[float, float] | None = None,
        down_m: float | None = None,
        yaw_rad: float | None = None,
        speed_mps: float | None = None,
    ) -> None:
        self._place = north_east_m or _stopping_place(flight)
        self._down_m = down_m if down_m is not None else flight.down_m + _stopping_m(flight.vd_mps)
        self._yaw_rad = yaw_rad if yaw_rad is not None else flight.yaw_rad
        self._speed_mps = speed_mps

    def target(self, flight: Flight, limits: Limits) -> Target:
        return Target(
            north_east_m=self._place,
            down_m=self._down_m,
            yaw_rad=self._yaw_rad,
            speed_max_mps=self._speed_mps or limits.cruise_mps,
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
        )

    def change_speed(self, speed_mps: float) -> None:
        self._speed_mps = speed_mps

    def done(self, flight: Flight) -> bool:
        return False


class Takeoff:
    """Straight up to a height, over the place where it began; on the ground the rotors spool up first."""

    REACHED_M = 0.3
    SLOWEST_MPS = 0.2

    def __init__(self, flight: Flight, down_m: float) -> None:
        self._place = (flight.north_m, flight.east_m)
        self._down_m = min(down_m, flight.down_m)
        self._yaw_rad = flight.yaw_rad
        self._begun_ns: int | None = None
        self._spools = not flight.flying

    def target(self, flight: Flight, limits: Limits) -> Target:
        if self._begun_ns is None:
            self._begun_ns = flight.time_ns
        climbing_s = (flight.time_ns - self._begun_ns) * 1e-9 - limits.takeoff_spool_s
        waits = self._spools and climbing_s < 0.0
        share = climbing_s / limits.takeoff_ramp_s if self._spools and climbing_s < limits.takeoff_ramp_s else 1.0
        return Target(
            north_east_m=self._place,
            down_m=flight.down_m if waits else self._down_m,
            yaw_rad=self._yaw_rad,
            speed_max_mps=limits.cruise_mps,
            climb_max_mps=max(share * limits.takeoff_mps, self.SLOWEST_MPS),
            descent_max_mps=limits.descent_mps,
        )

    def done(self, flight: Flight) -> bool:
        return abs(flight.down_m - self._down_m) < self.REACHED_M

    def hold(self, flight: Flight) -> Hold:
        """Staying where it was going to."""
        return Hold(flight, self._place, self._down_m, self._yaw_rad)


class Land:
    """Straight down, slower near the ground. The ground is where the feet meet it, not where a map says."""

    def __init__(self, flight: Flight, north_east_m: tuple[float, float] | None = None, ground_down_m: float = 0.0) -> None:
        self._place = north_east_m or _stopping_place(flight)
        self._ground_down_m = ground_down_m
        self._yaw_rad = flight.yaw_rad

    def target(self, flight: Flight, limits: Limits) -> Target:
        height_m = self._ground_down_m - flight.down_m
        span_m = limits.land_fast_above_m - limits.land_slow_below_m
        share = 1.0 if span_m <= 0.0 else min(max((height_m - limits.land_slow_below_m) / span_m, 0.0), 1.0)
        if span_m <= 0.0 and height_m < limits.land_slow_below_m:
            share = 0.0
        speed = limits.land_mps + share * (limits.descent_mps - limits.land_mps)
        return Target(
            # With its feet on the ground it holds still: going after a wandering position would only turn it over.
            north_east_m=None if flight.on_ground else self._place,
            velocity_ned_mps=(0.0, 0.0, speed),
            yaw_rad=self._yaw_rad,
            speed_max_mps=limits.cruise_mps,
            climb_max_mps=limits.climb_mps,
            descent_max_mps=max(speed, 0.1),
        )

    def done(self, flight: Flight) -> bool:
        return False


class Return:
    """Climb, go home, land there."""

    ARRIVED_M = 0.5

    def __init__(self, flight: Flight, home: Home, limits: Limits) -> None:
        self._home = home
        away_m = math.hypot(flight.north_m - home.north_m, flight.east_m - home.east_m)
        height_m = home.down_m - flight.down_m
        if limits.return_climbs_by_m is not None:
            cruise_m = max(limits.return_height_m, height_m + limits.return_climbs_by_m)
        else:
            cruise_m = height_m if away_m < limits.return_near_m else max(limits.return_height_m, height_m)
        self._climb = Hold(flight, down_m=home.down_m - max(cruise_m, height_m))
        self._cruise_down_m = home.down_m - max(cruise_m, height_m)
        self._climbing = self._cruise_down_m < flight.down_m - 0.5
        self._land: Land | None = None

    @property
    def landing(self) -> bool:
        return self._land is not None

    def target(self, flight: Flight, limits: Limits) -> Target:
        if self._land:
            return self._land.target(flight, limits)
        if self._climbing:
            self._climbing = flight.down_m > self._cruise_down_m + 0.5
            return self._climb.target(flight, limits)
        home = (self._home.north_m, self._home.east_m)
        if math.hypot(flight.north_m - home[0], flight.east_m - home[1]) < self.ARRIVED_M:
            self._land = Land(flight, home, self._home.down_m)
        return Target(
            north_east_m=home,
            down_m=self._cruise_down_m,
            yaw_rad=self._yaw_home(flight),
            speed_max_mps=limits.cruise_mps,
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
        )

    def _yaw_home(self, flight: Flight) -> float | None:
        """Nose towards home on the way; kept when near, where the direction has no meaning."""
        north, east = self._home.north_m - flight.north_m, self._home.east_m - flight.east_m
        return math.atan2(east, north) if math.hypot(north, east) > 3.0 else None

    def done(self, flight: Flight) -> bool:
        return False


class Follow:
    """The setpoints of a companion, as last given."""

    def __init__(self, flight: Flight) -> None:
        self._rest = Hold(flight)
        self._given: Target | None = None

    def give(self, target: Target) -> None:
        self._given = target

    def lapse(self, flight: Flight) -> None:
        """The companion is silent: stop and stay."""
        self._given, self._rest = None, Hold(flight)

    def target(self, flight: Flight, limits: Limits) -> Target:
        return self._given or self._rest.target(flight, limits)

    def done(self, flight: Flight) -> bool:
        return False


class Manoeuvres:
    """How this kind of aircraft does what every kind can: the multicopter's way. Another kind overrides what it does otherwise."""

    def hold(
        self,
        flight: Flight,
        north_east_m: tuple[float, float] | None = None,
        down_m: float | None = None,
        yaw_rad: float | None = None,
        speed_mps: float | None = None,
        radius_m: float | None = None,
    ) -> Hold:
        """Stay at a place. `radius_m` is for what cannot stand still: positive clockwise, None as the parameters say."""
        return Hold(flight, north_east_m, down_m, yaw_rad, speed_mps)

    def takeoff(self, flight: Flight, down_m: float) -> Takeoff:
        return Takeoff(flight, down_m)

    def land(self, flight: Flight, north_east_m: tuple[float, float] | None = None, ground_down_m: float = 0.0) -> Land:
        return Land(flight, north_east_m, ground_down_m)

    def go_home(self, flight: Flight, home: Home, limits: Limits) -> Return:
        return Return(flight, home, limits)

    def follow(self, flight: Flight) -> Follow:
        return Follow(flight)


class Guidance:
    """The manoeuvre being flown. `begin` starts that of a behaviour."""

    def __init__(self, flight: Flight, limits: Limits, manoeuvres: Manoeuvres | None = None) -> None:
        self.limits = limits
        self.manoeuvres = manoeuvres or Manoeuvres()
        self.manoeuvre: Manoeuvre = self.manoeuvres.hold(flight)
        self.speed_mps: float | None = None  # of DO_CHANGE_SPEED, until the next change of mode

    def begin(self, behaviour: Behaviour, flight: Flight) -> None:
        """Start what a behaviour flies by default."""
        self.speed_mps = None
        match behaviour:
            case Behaviour.TAKEOFF:
                self.manoeuvre = self.manoeuvres.takeoff(flight, flight.down_m - self.limits.takeoff_height_m)
            case Behaviour.LAND:
                self.manoeuvre = self.manoeuvres.land(flight, ground_down_m=flight.home.down_m if flight.home else 0.0)
            case Behaviour.RETURN if flight.home:
                self.manoeuvre = self.manoeuvres.go_home(flight, flight.home, self.limits)
            case Behaviour.FOLLOW:
                self.manoeuvre = self.manoeuvres.follow(flight)
            case _:
                self.manoeuvre = self.manoeuvres.hold(flight)

    def target(self, flight: Flight) -> Target:
        return self.manoeuvre.target(flight, self.limits)

    @property
    def landing(self) -> bool:
        """Whether the present manoeuvre is on its way to the ground."""
        manoeuvre = self.manoeuvre
        return isinstance(manoeuvre, Land) or (isinstance(manoeuvre, Return) and manoeuvre.landing)


class LandDetector:
    """On the ground: the feet touch, nothing moves, and the target is not above. Off it: the feet are clear of it."""

    SETTLE_S = 0.6

    def __init__(self) -> None:
        self._still_s = 0.0

    def landed(self, flight: Flight, target: Target) -> bool:
        """Whether the vehicle has come to rest on the ground; to be asked once a step while it flies."""
        wants_down = target.velocity_ned_mps[2] > 0.05 if target.down_m is None else target.down_m > flight.down_m - 0.05
        still = flight.on_ground and abs(flight.vd_mps) < 0.15 and math.hypot(flight.vn_mps, flight.ve_mps) < 0.5
        self._still_s = self._still_s + flight.step_s if wants_down and still else 0.0
        return self._still_s >= self.SETTLE_S

    def wants_off(self, flight: Flight, target: Target) -> bool:
        """Whether a target, given on the ground, leads off it."""
        if target.down_m is None:
            return target.velocity_ned_mps[2] < -0.1
        return target.down_m < flight.down_m - 0.3

    def off(self, flight: Flight) -> bool:
        return not flight.on_ground and flight.vd_mps < 0.0


def _stopping_m(speed_mps: float) -> float:
    return math.copysign(speed_mps * speed_mps / (2.0 * _STOPPING_MPS2), speed_mps)


def _stopping_place(flight: Flight) -> tuple[float, float]:
    speed = math.hypot(flight.vn_mps, flight.ve_mps)
    ahead_s = speed / (2.0 * _STOPPING_MPS2) + 0.2 * min(speed, 1.0)
    return flight.north_m + flight.vn_mps * ahead_s, flight.east_m + flight.ve_mps * ahead_s
