"""Flying where it is known how people will walk."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from ..client import ARDUPILOT, PX4
from ..reference._orders import MOVING
from ..reference._steps import Steps
from ..reference.flight._caution import Caution
from ..reference.flight._control import TurnBack
from ..reference.flight._paths import Place, Walk, ring
from ..reference.flight._pilot import OVER_HOME_M, SLOW_MPS, Pilot, never
from ..reference.flight._piloted_vehicle import PositionSetpoint
from ..reference.flight._reserve import ROUTE_AGE_S, Reserve
from ..reference.mission._planner import Planner
from ..reference.perception._tracks import Track
from ._clearance import DESCENT_S, DESCENT_UP_M, LOW_M, MARGIN_M, NEAR_M, Clearance
from ._perception import Truth, TruthPerception

# Only on the way home: a failsafe that lands would otherwise sink as fast while it waits for GPS.
# The last metres at twice the usual 0.7 m/s; an x500 bears 3 m/s.
_DESCENT = {
    PX4: {
        "MPC_Z_VEL_MAX_DN": 3.0,
        "MPC_Z_V_AUTO_DN": 3.0,
        "MPC_LAND_ALT1": 6.0,
        "MPC_LAND_ALT2": 3.0,
        "MPC_LAND_SPEED": 1.5,
    },
    ARDUPILOT: {
        "WPNAV_SPEED_DN": 300.0,
        "LAND_SPEED_HIGH": 300.0,
        "LAND_ALT_LOW": 300.0,
        "LAND_SPEED": 150.0,
    },
}
# Where to stand: how far ahead it comes to a stop, which places round that are tried, how long it may fly there, and
# for how long people are looked ahead. The measures call a stay one within 15 m. All chosen, not measured.
STOP_S, STAND_RINGS_M, STAND_BY_S, STAND_AHEAD_S, STAY_M = 1.0, (6.0, 12.0, 18.0, 24.0), 5.5, 45, 17.0
# How far Hold goes on by itself, in seconds of its speed: PX4 took 26 m from 9.5 m/s.
HOLD_COAST_S = 3.0
# Nearer than this to home it waits for the way down to be clear; coming down from there takes so long before the last
# `DESCENT_S` of it, on top of the height that is left. Flights of campaign full.
HOME_APPROACH_M, APPROACH_S, SINK_MPS = 45.0, 9.0, 3.0
# How fast it slows down over home when its place is commanded: from 10 m/s it takes 16 m. Flights of campaign standard.
BRAKING_MPS2 = 3.0
# What the camera shows of the ground, with a margin: from and to so many heights away, and so far to each side. By its
# angles, 38 to 81 degrees below the horizon and 35 degrees to a side.
PICTURE_HEIGHTS, PICTURE_RAD = (0.25, 1.1), math.radians(28.0)
# So far beside home it sinks to this height where somebody is under it over home: 5 s above the height from which it
# has to be over home. Less than `OVER_HOME_M`, so that it is not flown back at full height. Chosen, not measured.
ASIDE_M, ASIDE_TO_M = 7.0, 31.0
# From the order to sink to sinking so fast. Flights of campaign standard.
SINK_LAG_S = 1.0
# So late it starts where nobody expects it earlier and people are at home before. Chosen, not measured.
PATIENT_START_S = 70.0
# From full speed to rest. Flights of campaign full.
BRAKE_S = 4.0
# So much nearer it comes when it is told to come home. Chosen after the measures, which ask for 2 m.
TURN_M = 5.0
# Of the time limit: down by then. `mission_time` asks for 95 %. The first choice leaves room for a second.
LATEST_SHARE = 0.94
# After so long the way that it was on may no longer be the shortest. Chosen, not measured.
INTERRUPTED_S = 1.0
# Above the stand-off, for errors of height; and how far it flies for each metre that it climbs at full speed: some
# 8 m/s while it gathers way, at 6 m/s upwards. Flights of campaign standard.
STANDOFF_MARGIN_M, AWAY_PER_CLIMB = 1.0, 1.3
# So far ahead it looks where its momentum carries it: from 13 m/s it takes 34 m to rest. And by how much of the way that
# leads back from there its aim moves: with 2 s and 1 it came to 6 m from an area. Flights of campaign standard.
COAST_S, PUSH = 2.5, 1.5
# Of the time limit: where the way down is never clear, it comes down at the least bad moment after this. Chosen.
EARLIEST_SHARE = 0.6
# So often it looks where people will be while it waits. Chosen, not measured.
LOOK_AGAIN_S = 10.0
# For turning, and for gusts against it. Chosen, not measured.
LEAVE_MARGIN_S = 5.0
# So long before an order to go to another place it flies so slowly: at full speed it would still be carried over the
# place that it comes from. Chosen, not measured.
RETASK_AHEAD_S, RETASK_MPS = 6.0, 4.0
# From asking for control on the ground to leaving it, by flights of campaign full.
LIFT_OFF_S = 1.0
# So long after a fault a failsafe may still be its consequence: an autopilot is heard again 1.1 s after a lost link. Chosen.
AFTERMATH_S = 3.0


class OracleCaution(Caution):
    """The small margins of a pilot who knows where people are: for the steps of a moment and for gusts. Chosen."""

    # It creeps half as fast as the reference agent: with a drifting position that still counts as standing.
    slow_margin_m, slow_share, braking_mps2, creep_mps = 2.0, 0.95, 2.5, 0.35


class OraclePlanner(Planner):
    """Knows how fast it comes down."""

    descent_mps, landing_s = SINK_MPS, 14.0
    acceleration_mps2 = math.inf  # what turning costs is part of its reserve

    def home_s(self, place: Place) -> float:
        """It comes down only over home: nobody is to be under it while it is low."""
        away_s = self.travel_s(self._way_m(place, self._home)) if self._returns else 0.0
        return away_s + max(0.0, self._height_m - self._safe_height_m) / self.descent_mps + self.landing_s


class OracleReserve(Reserve):
    """Knows what it uses: a whole percent for what the autopilot rounds."""

    battery_margin = 0.015
    charge_spare_s = 0.0


class OraclePilot(Pilot):
    """Does not wait for what it knows: places without GPS, for as long as the autopilot follows."""

    planner_type, reserve_type, caution_type = OraclePlanner, OracleReserve, OracleCaution
    _eyes: TruthPerception
    interrupted = False  # something else has flown it, or held it, since this was last set back
    _touchdown: Place | None = None
    _touchdown_s = 0.0  # when it means to touch down
    _off_m: Place = (0.0, 0.0)  # how far its own position is off, east and north, as it comes down
    _has_people_below = False  # whether somebody will be under it on its way down
    _leave = (-math.inf, False)  # when it was last worked out, and what came of it

    @property
    def _truth(self) -> Truth:
        return self._eyes.truth

    @cached_property
    def _clearance(self) -> Clearance:
        return Clearance(self._truth, super().home, self._order.bystander_standoff_m)

    @property
    def home(self) -> Place:
        """Where it means to touch down: home, or some steps beside it, by its own erring position."""
        if self._touchdown is None:
            return super().home
        return self._touchdown[0] + self._off_m[0], self._touchdown[1] + self._off_m[1]

    def keep_control(self, *, looking: bool = False, home_bound: bool = False) -> Steps[None]:
        begun_s = self._vehicle.now_s
        yield from super().keep_control(looking=looking, home_bound=home_bound)
        self.interrupted = self.interrupted or self._vehicle.now_s - begun_s > INTERRUPTED_S

    # Up.

    def start_s(self, until_s: float) -> float:
        """When to leave the ground; from then on it is known which way to climb."""
        now_s = self._vehicle.now_s + LIFT_OFF_S
        self._start = self._clearance.start(now_s, until_s)
        # Rotors among people are worse than a late start, where nobody has ordered it to be out by then.
        if self._start.near_s > 0.0 and not any(order.kind in MOVING for order in self._truth.simspec.orders):
            self._start = self._clearance.start(now_s, max(until_s, PATIENT_START_S))
        return self._start.at_s - LIFT_OFF_S

    def _lift_off(self) -> Steps[None]:
        """Under its own setpoints from the ground on: away from people while it climbs."""
        self._log.enter("taking_off", f"climbing to {self.height_m:g} m")
        aim = PositionSetpoint(*self._start.place, self.height_m, self.pose.yaw_rad)
        if not (yield from self._attentive(self._vehicle.go_offboard(aim))):
            raise TurnBack("the autopilot does not give control to the setpoint stream")
        while self._is_low_near_people():
            self._vehicle.setpoint = aim
            yield from self._control.check()
            yield

    def _is_low_near_people(self) -> bool:
        """Whether it would come nearer to somebody than the stand-off if it left the way up that it has chosen."""
        below_m = self._order.bystander_standoff_m + STANDOFF_MARGIN_M - self.pose.height_m
        if below_m <= 0.0 or not self._truth.people:
            return False
        people = self._truth.people_m(self._vehicle.now_s)
        nearest_m = float(np.linalg.norm(people - np.array(self.place), axis=1).min())
        return nearest_m < self._order.bystander_standoff_m + AWAY_PER_CLIMB * below_m

    # Along.

    def _aim_along(self, walk: Walk, speed_mps: float, facing: Track | None) -> None:
        """Away from what is closed where its own momentum would carry it there."""
        if any(
            order.kind == "retask" and 0.0 <= order.at_s - self._vehicle.now_s < RETASK_AHEAD_S
            for order in self._truth.simspec.orders
        ):
            speed_mps = min(speed_mps, RETASK_MPS)
        super()._aim_along(walk, speed_mps, facing)
        coast, aim, space = self._coast(COAST_S), self._vehicle.setpoint, self.airspace
        # In a closed area, where a failsafe may have flown it, the way out is the path's: a push could hold it there.
        if aim is None or space.allows(coast) or not space.allows(self.place):
            return
        allowed = space.nearest(coast)
        self._vehicle.setpoint = replace(
            aim,
            east_m=aim.east_m + PUSH * (allowed[0] - coast[0]),
            north_m=aim.north_m + PUSH * (allowed[1] - coast[1]),
        )

    # Down.

    def go_home(self, reason: str, unless: Callable[[], bool] = never) -> Steps[bool]:
        if not self._vehicle.silent:
            for name, value in _DESCENT[self._vehicle.kind].items():
                yield from self._vehicle.set_parameter(name, value)
        # An order to come home can find it on the way down: then it goes on as it has planned.
        if self._order.return_home and (self._touchdown is None or self.pose.height_m > DESCENT_UP_M[-1]):
            self._log.enter("returning", reason)
            # An order to come home can find it waiting there: it has to come nearer all the same.
            wait_m = min(HOME_APPROACH_M, math.dist(self.place, self.home) - TURN_M)
            arrived = lambda: math.dist(self.place, self.home) < wait_m  # noqa: E731
            way = [self.place, self.home]
            if not (
                yield from self.follow(way, self.speed_mps, until=arrived, leave=unless, home_bound=True)
            ):
                return False
            yield from self._wait_for_people_at_home(unless)
            if not (yield from self._wait_over_home(unless)):
                return False
        return (yield from super().go_home(reason, unless))

    def must_leave(self) -> bool:
        """Whether it has to leave for home now to come down while the way down is clear for the last time."""
        now_s = self._vehicle.now_s
        if now_s - self._leave[0] >= ROUTE_AGE_S:
            way_s = self.planner.travel_s(self.way_m(self.place, self.home)) + BRAKE_S + self._down_s()
            self._leave = (now_s, now_s < self._last_clear_s < now_s + way_s + LEAVE_MARGIN_S)
        return self._leave[1]

    @cached_property
    def _last_clear_s(self) -> float:
        """When the way down at home is clear for the last time; 0 where it is told to come down elsewhere."""
        if any(order.kind == "deactivate" for order in self._truth.simspec.orders):
            return 0.0
        limit_s = self._order.time_limit_s
        clear_s = self._clearance.landings(LATEST_SHARE * limit_s)
        if not clear_s:
            return self._clearance.landing(EARLIEST_SHARE * limit_s, LATEST_SHARE * limit_s).at_s
        return max(clear_s)

    def _down_s(self) -> float:
        """From rest near home, where it waits, to the ground."""
        high_m = max(self.pose.height_m - DESCENT_UP_M[-1], 0.0)
        return float(APPROACH_S + high_m / SINK_MPS + DESCENT_S[-1])

    def _wait_for_people_at_home(self, unless: Callable[[], bool]) -> Steps[None]:
        """Hover where nobody is until the way down is clear, and choose the place to touch down at."""
        now_s, down_s = self._vehicle.now_s, self._down_s()
        landing = self._clearance.landing(now_s + BRAKE_S + down_s, LATEST_SHARE * self._order.time_limit_s)
        self._touchdown, self._touchdown_s = landing.place, landing.at_s
        self._has_people_below = landing.near_s > 0.0
        leave_s, looked_s = landing.at_s - down_s, now_s
        place = self._stand_place() or self.place
        while self._vehicle.now_s < leave_s and not unless() and not self.homeward():
            if self._vehicle.now_s - looked_s > LOOK_AGAIN_S:
                looked_s, place = self._vehicle.now_s, self._stand_place() or place
            yield from self._hover(place)

    def _wait_over_home(self, unless: Callable[[], bool]) -> Steps[bool]:
        """Over home before its time it waits up there: the sooner touchdown may be the one with people near."""
        # Position control from here on, which brakes in time: `follow` would be carried past home.
        arriving = lambda: math.dist(self.place, self.home) < OVER_HOME_M + self._braking_m()  # noqa: E731
        way = [self.place, self.home]
        if not (yield from self.follow(way, self.speed_mps, until=arriving, leave=unless, home_bound=True)):
            return False
        sink_s = self._touchdown_s - self._down_s() + APPROACH_S - SINK_LAG_S
        begun_s = self._vehicle.now_s
        while not unless() and not self.homeward():
            is_near = math.dist(self.place, self.home) < OVER_HOME_M
            is_late = self._vehicle.now_s - begun_s > BRAKE_S
            if self._vehicle.now_s >= sink_s and (is_near or is_late):
                break
            yield from self._hover(self.home)
        if self._has_people_below:
            yield from self._sink_aside(unless)
        return not unless()

    def _sink_aside(self, unless: Callable[[], bool]) -> Steps[None]:
        """The first part of the way down beside home, where somebody would be under it over home."""
        high_m, now_s = self.pose.height_m, self._vehicle.now_s
        if high_m <= ASIDE_TO_M:
            return  # it is that low already
        spans_s = np.arange(0.0, (high_m - ASIDE_TO_M) / SINK_MPS, 0.5)
        places = [self.home, *ring(self.home, ASIDE_M, 0.0, corners=12)[:-1]]
        people = np.array([self._truth.people_m(now_s + at_s) for at_s in spans_s.tolist()])
        apart_m = np.linalg.norm(people[None] - np.array(places)[:, None, None], axis=3).min(axis=2)
        is_near = (apart_m < NEAR_M + MARGIN_M) & (high_m - SINK_MPS * spans_s < LOW_M)
        place = places[int(is_near.sum(axis=1).argmin())]
        while self.pose.height_m > ASIDE_TO_M and not unless():
            self._vehicle.setpoint = PositionSetpoint(*place, self._settings.safe_height_m, self.pose.yaw_rad)
            yield from self.keep_control(home_bound=True)
            yield

    def _braking_m(self) -> float:
        return float(math.hypot(*self._vehicle.poses.velocity_en_mps) ** 2 / (2.0 * BRAKING_MPS2))

    def _hover(self, place: Place) -> Steps[None]:
        """For a moment, looking at those whose places tell how far its own position is off."""
        self._off_m = self._eyes.own_error.estimate_m(self._vehicle.now_s) or self._off_m
        self._vehicle.setpoint = PositionSetpoint(*place, self.height_m, self._yaw_to_most())
        yield from self.keep_control(home_bound=True)
        yield

    def _yaw_to_most(self) -> float:
        """The direction in which most people are in the picture; the present one among equals."""
        pose = self.pose
        people = self._truth.people_m(self._vehicle.now_s)
        offset = people - np.array(self.place)
        apart_m = np.hypot(offset[:, 0], offset[:, 1])
        bearings_rad = np.arctan2(offset[:, 0], offset[:, 1])
        nearest_m, farthest_m = (heights * pose.height_m for heights in PICTURE_HEIGHTS)
        shown = bearings_rad[(apart_m > nearest_m) & (apart_m < farthest_m)]

        def count(yaw_rad: float) -> int:
            return int((np.cos(shown - yaw_rad) > math.cos(PICTURE_RAD)).sum())

        turns_rad = [pose.yaw_rad, *(pose.yaw_rad + 2.0 * math.pi * k / 12 for k in range(1, 12))]
        return max(turns_rad, key=count)

    def _step_aside(self) -> Steps[None]:
        """Beside people rather than over them: it knows who comes by while it stands."""
        place, begun_s, yaw_rad = self._stand_place(), self._vehicle.now_s, self.pose.yaw_rad
        while (
            place is not None
            and self._vehicle.now_s - begun_s < STAND_BY_S
            and (
                math.dist(self.place, place) > 2.0
                or math.hypot(*self._vehicle.poses.velocity_en_mps) > SLOW_MPS
            )
        ):
            self._vehicle.setpoint = PositionSetpoint(*place, self.height_m, yaw_rad)
            yield

    def _stand_place(self) -> Place | None:
        """The place near where it would stop with the shortest stay near anybody; None where any place will do."""
        if self._caution.max_loiter_s is None or not self._truth.people:
            return None
        places = [stop := self._coast(STOP_S)]
        places += [place for ring_m in STAND_RINGS_M for place in ring(stop, ring_m, 0.0, corners=12)[:-1]]
        stays_s = np.zeros((len(places), len(self._truth.people)))
        # As bad as a stay without end: where the rules let nobody fly.
        longest_s = np.where([self.airspace.allows(place) for place in places], 0.0, np.inf)
        for ahead_s in range(STAND_AHEAD_S):
            people = self._truth.people_m(self._vehicle.now_s + ahead_s)
            is_stay = np.linalg.norm(np.array(places)[:, None] - people[None], axis=2) <= STAY_M
            stays_s = np.where(is_stay, stays_s + 1.0, 0.0)
            longest_s = np.maximum(longest_s, stays_s.max(axis=1))
        # Half of what is allowed where there is such a place: somebody may have been near it for a while already.
        short = [*np.flatnonzero(longest_s < self._caution.max_loiter_s / 2.0)]
        allowed = [*short, *np.flatnonzero(longest_s < self._caution.max_loiter_s - 1.0)]
        best = int(allowed[0]) if allowed else int(longest_s.argmin())
        # Left to itself, Hold coasts on; where that is too near to what is closed, it brakes by its own setpoints.
        return None if best == 0 and self.airspace.allows(self._coast(HOLD_COAST_S)) else places[best]

    def _coast(self, span_s: float) -> Place:
        """Where its speed carries it."""
        velocity = self._vehicle.poses.velocity_en_mps
        return self.place[0] + span_s * velocity[0], self.place[1] + span_s * velocity[1]

    def _failsafe_cause(self) -> str:
        """The fault of the situation that is there or was there a moment ago; "" where the autopilot acts on something else,
        such as setpoints that it missed while the operator had the vehicle.
        """
        now_s = self._vehicle.now_s
        words = [
            failure.kind.partition("_")[0]
            for failure in self._truth.simspec.vehicle.failures
            if failure.at_s <= now_s <= failure.at_s + (failure.duration_s or math.inf) + AFTERMATH_S
        ]
        return words[-1] if words else ""

    def _must_stand(self, *, looking: bool, home_bound: bool) -> tuple[str, str] | None:
        # Never `looking`: it knows where everything is, so that it need not wait for a silent detector.
        must = super()._must_stand(looking=False, home_bound=home_bound)
        return None if must is not None and must[0] == "gps" else must
