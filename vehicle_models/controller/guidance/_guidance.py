"""Guidance: the manoeuvres of a vehicle, the one that each behaviour begins with, and where the nose points meanwhile."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from ..state._flight_limits import FlightLimits
from ..state._flight_state import Behaviour, FlightState, FlightTarget, NorthEast, ReferencePoint
from ._manoeuvres import FollowSetpoints, Hold, Land, Manoeuvre, Takeoff
from ._return import Return
from ._sticks import Circle, ManualFlight

_MIN_FACING_SPEED_MPS = 0.5


@dataclass(frozen=True, slots=True)
class HeadingCommand:
    """A heading that a command asks for, whatever is being flown: one heading, or the one towards a place."""

    heading_rad: float = 0.0
    place: NorthEast | None = None
    turn_max_radps: float = 1.0

    def yaw_rad(self, flight: FlightState) -> float:
        """The heading at this moment."""
        if self.place is None:
            return self.heading_rad
        return math.atan2(self.place[1] - flight.east_m, self.place[0] - flight.north_m)


class Manoeuvres:
    """The manoeuvres of a multicopter. Another kind of aircraft overrides those that it flies differently."""

    # Whether the speeds and paths of a multicopter's waypoints are flown.
    shapes_waypoints = True
    # Whether a landing begins away from its place.
    approaches_landing = False
    # A wing cannot meet a point exactly, so it raises these lower bounds of the acceptance radius.
    min_acceptance_radius_m, min_acceptance_height_m = 0.0, 0.0
    takeoff: type[Takeoff] = Takeoff
    land: type[Land] = Land
    go_home: type[Return] = Return
    follow: type[FollowSetpoints] = FollowSetpoints

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
        """Stay at a place; who cannot hover circles by `radius_m` (clockwise; None by the parameters)."""
        return Hold(flight, north_east_m, down_m, yaw_rad, speed_mps)

    def shaped(
        self, manoeuvre: Manoeuvre, target: FlightTarget, flight: FlightState, limits: FlightLimits
    ) -> FlightTarget:
        """The target of any manoeuvre, turned into one that this kind of aircraft can fly."""
        return target


class Guidance:
    """The manoeuvre being flown. `begin` starts that of a behaviour."""

    def __init__(
        self,
        flight: FlightState,
        limits: FlightLimits,
        return_point: Callable[[FlightState], ReferencePoint | None],
        manoeuvres: Manoeuvres | None = None,
    ) -> None:
        self.limits = limits
        self.manoeuvres = manoeuvres or Manoeuvres()
        self.manoeuvre: Manoeuvre = self.manoeuvres.hold(flight)
        self.speed_mps: float | None = None  # of DO_CHANGE_SPEED, until the next change of mode
        # Of CONDITION_YAW or a region of interest; overrides the manoeuvre's
        self.heading: HeadingCommand | None = None
        self.return_point = return_point

    def begin(self, behaviour: Behaviour, flight: FlightState) -> None:
        """Start the manoeuvre that a behaviour begins with."""
        self.speed_mps = None
        self.heading = None
        match behaviour:
            case Behaviour.TAKEOFF:
                self.manoeuvre = self.manoeuvres.takeoff(flight, flight.down_m - self.limits.takeoff_height_m)
            case Behaviour.LAND:
                self.manoeuvre = self.manoeuvres.land(
                    flight, ground_down_m=flight.home.down_m if flight.home else 0.0
                )
            case Behaviour.RETURN if flight.home:
                self.manoeuvre = self.manoeuvres.go_home(
                    flight, self.return_point(flight) or flight.home, self.limits
                )
            case Behaviour.OFFBOARD | Behaviour.EXTERNAL:
                self.manoeuvre = self.manoeuvres.follow(flight)
            case Behaviour.PILOT if flight.mode.stick:
                self.manoeuvre = ManualFlight(flight, flight.mode.stick)
            case Behaviour.CIRCLE:
                self.manoeuvre = Circle.around_point_ahead(flight, self.limits)
            case _:
                self.manoeuvre = self.manoeuvres.hold(flight)

    def target(self, flight: FlightState) -> FlightTarget:
        """Where to go during the next step, and where the nose points meanwhile."""
        target = self.manoeuvre.target(flight, self.limits)
        target = self.manoeuvres.shaped(self.manoeuvre, target, flight, self.limits)
        # An attitude setpoint has a heading of its own, which no region of interest changes.
        if self.heading and target.attitude is None:
            yaw = self.heading.yaw_rad(flight)
            return replace(target, yaw_rad=yaw, yawrate_radps=0.0, turn_max_radps=self.heading.turn_max_radps)
        if target.faces_motion:
            speed = math.hypot(flight.vn_mps, flight.ve_mps)
            if speed > _MIN_FACING_SPEED_MPS:
                return replace(target, yaw_rad=math.atan2(flight.ve_mps, flight.vn_mps))
        return target

    @property
    def landing(self) -> bool:
        """Whether the present manoeuvre is on its way to the ground."""
        manoeuvre = self.manoeuvre
        return isinstance(manoeuvre, Land) or (isinstance(manoeuvre, Return) and manoeuvre.landing)
