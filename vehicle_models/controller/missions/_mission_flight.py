"""The flight of a mission: which item is flown, what comes next, and what is reported of it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from bench.contracts import Vector

from ..guidance._fence_boundary import FenceBoundary
from ..guidance._guidance import Guidance
from ..guidance._legs import ClimbLeg, DescendLeg, GotoLeg, HeadingFunction, MissionLeg, TurnsLeg, bearing
from ..guidance._manoeuvres import Hold, Land, stopping_m, stopping_place
from ..guidance._waypoints import PathSegment, WaypointApproach, WaypointPath
from ..links._enums import MAV_CMD
from ..links._frames import KINDS
from ..payload._camera import CameraComponent
from ..payload._gimbal import Gimbal
from ..policies._missions import MissionPolicy
from ..services._home import HomeKeeper
from ..services._modes import Modes
from ..services._own_commands import OwnCommands
from ..state._flight_state import Behaviour, FlightMode, FlightState, NorthEast
from ..state._plan_store import ABOVE_SEA, PLACELESS, MissionItem, StoredPlans
from ..state._service import Command, CommandHandler, CommandResult, MessageHandler, MessageSender, Stream
from ..state._service_context import ServiceContext
from ..state._texts import INFO, FlightEvent
from ._payload_items import PAYLOAD_ITEMS, use_payload

_TAKEOFFS = (MAV_CMD.NAV_TAKEOFF, MAV_CMD.NAV_VTOL_TAKEOFF)
_LANDINGS = (MAV_CMD.NAV_LAND, MAV_CMD.NAV_VTOL_LAND)
_PASSED = frozenset({MAV_CMD.NAV_WAYPOINT, MAV_CMD.NAV_SPLINE_WAYPOINT})
_FLOWN = _PASSED | {
    *_TAKEOFFS,
    *_LANDINGS,
    MAV_CMD.NAV_LOITER_UNLIM,
    MAV_CMD.NAV_LOITER_TURNS,
    MAV_CMD.NAV_LOITER_TIME,
    MAV_CMD.NAV_RETURN_TO_LAUNCH,
    MAV_CMD.NAV_LOITER_TO_ALT,
    MAV_CMD.NAV_DELAY,
}
# Items towards which the vehicle need not brake.
_WITH_COURSE = (*_PASSED, MAV_CMD.NAV_LOITER_TIME, MAV_CMD.NAV_LOITER_UNLIM)
# Flown from the ground as they are.
_NO_LIFTOFF = (*_TAKEOFFS, *_LANDINGS, MAV_CMD.NAV_RETURN_TO_LAUNCH, MAV_CMD.NAV_DELAY)
_ROI = (MAV_CMD.NAV_ROI, MAV_CMD.DO_SET_ROI_LOCATION, MAV_CMD.DO_SET_ROI)
_JUMPS = (MAV_CMD.DO_JUMP, MAV_CMD.DO_JUMP_TAG)
# Places in a mission, for a jump or for DO_LAND_START.
_MARKS = (MAV_CMD.JUMP_TAG, MAV_CMD.DO_LAND_START)
_ACTIONS = {
    *_ROI,
    *_JUMPS,
    MAV_CMD.DO_SET_ROI_NONE,
    MAV_CMD.DO_CHANGE_SPEED,
    MAV_CMD.CONDITION_YAW,
}
# In a row: a ring of jumps without anything to fly ends the mission.
_MAX_JUMPS = 100
# Looked up once, because every step compares with it.
_MISSION = Behaviour.MISSION
# DO and CONDITION items between two items to fly.
_MAX_ACTIONS = 1000
_ACTIONS_PER_STEP = 20
# Of an item from the origin.
_MAX_DISTANCE_M = 500_000.0
# Items between a waypoint and the next place to fly to.
_MAX_LOOK_AHEAD = 8
# A target farther away is not where the vehicle stays.
_MAX_RESUMED_DISTANCE_M = 20.0
# MISSION_STATE
_NO_MISSION, _NOT_STARTED, _ACTIVE, _PAUSED, _COMPLETE = 1, 2, 3, 4, 5


@dataclass(frozen=True, slots=True)
class _Following:
    """The place to which the mission goes on without a stop, and the speed of an item on the way; None by the
    parameters.
    """

    place: NorthEast
    down_m: float
    speed_mps: float | None


@dataclass(eq=False)
class MissionFlight:
    """Flies the mission while its mode is active; MISSION_SET_CURRENT, MISSION_START and similar commands.

    `arm` arms the vehicle and returns whether that was allowed.
    """

    _context: ServiceContext
    _policy: MissionPolicy
    _mode: FlightMode
    _modes: Modes
    _guidance: Guidance
    _fence: FenceBoundary
    _plans: StoredPlans
    _arm: Callable[[], bool]
    _home: HomeKeeper
    _gimbal: Gimbal | None
    _camera: CameraComponent | None
    _own_commands: OwnCommands | None
    _index: int = 0  # of the item that is flown
    _leg: MissionLeg | None = None
    _from: NorthEast | None = None  # where the present leg begins; None: where the vehicle was
    _passed: WaypointPath | None = None  # the path of the leg that is just over
    _lands_next: bool = False  # the present leg leads to a place to land on
    _actions: deque[tuple[int, MissionItem]] = field(
        default_factory=deque
    )  # DO and CONDITION items that are due
    _wait_ns: int = 0
    _within_m: float | None = None  # of the item that is flown, before the actions go on
    _jumps: dict[int, int] = field(default_factory=dict)
    _reached: int | None = None
    _repeat_ns: int = 0
    _complete: bool = False
    _far: bool = False  # an item is too far away to be flown
    _started: bool = False
    _may_lift_off: bool = False
    _announced: int = -1  # item whose text was sent last
    _ended: bool = False  # disarmed in the mode: nothing begins until it is entered again
    _was_armed: bool = False
    _speed_mps: float | None = None
    _roi: NorthEast | None = None
    _yaw_rad: float | None = None

    def __post_init__(self) -> None:
        self._plan = self._plans.mission
        self._plan.on_change.append(self._changed)
        self._plans.fence.on_change.append(self._judge)

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"MISSION_SET_CURRENT": self._set_current}

    def commands(self) -> Mapping[int, CommandHandler]:
        commands: dict[int, CommandHandler] = {
            MAV_CMD.MISSION_START: self._start,
            MAV_CMD.DO_LAND_START: self._start_landing,
        }
        if self._policy.set_current_command:
            commands[MAV_CMD.DO_SET_MISSION_CURRENT] = self._set_current_command
        return commands

    def streams(self) -> Mapping[str, Stream]:
        return {"MISSION_CURRENT": self._current}

    def tick(self) -> None:
        flight = self._context.flight
        if self._was_armed is not flight.armed:
            self._was_armed, self._leg = flight.armed, None
            self._ended = not flight.armed
            if not flight.armed:
                self._disarmed()
        if flight.mode.behaviour is not _MISSION:
            self._leg, self._announced, self._ended = None, -1, False
        elif self._leg is None:
            if flight.armed or (self._policy.waits_for_start and not self._ended):
                self._enter(flight)
        elif flight.armed:
            self._continue(flight, self._leg)

    def _continue(self, flight: FlightState, leg: MissionLeg) -> None:
        # Another manoeuvre means that a command has paused the mission.
        if self._guidance.manoeuvre is leg.manoeuvre:
            if leg.over(flight):
                self._leg_over(flight, leg)
            if self._actions:
                self._run_due_actions(flight)
        self._repeat(flight)

    def _current(self) -> tuple[int, ...]:
        """Values of MISSION_CURRENT in wire order."""
        items = self._plan.items
        first = 1 if self._policy.home_first else 0
        total = len(items) - first if len(items) > first else self._policy.total_without_mission
        in_mode = self._context.flight.mode.behaviour is Behaviour.MISSION
        if not self._context.flight.mission_ready:
            state = _NO_MISSION
        # A mission that is entered again after its end begins anew.
        elif self._complete:
            state = _COMPLETE
        elif in_mode and self._context.flight.armed:
            state = _ACTIVE
        else:
            state = _PAUSED if self._started else _NOT_STARTED
        plans = self._plans
        identities = (plans.mission.identity, plans.fence.identity, plans.rally.identity)
        if not self._policy.transfer.one_at_a_time:
            identities = (0, 0, 0)
        return (self._index, total, state, 1 if in_mode else 2, *identities)

    # The plan.

    def _changed(self) -> None:
        marked = [
            number
            for number, item in enumerate(self._plan.items)
            if item.current and not self._policy.home_first
        ]
        self._judge()
        if self._far and self._policy.far_event:
            self._context.texts.notify(*self._policy.far_event)
        self._reset(marked[-1] if marked else self._first)

    def _judge(self) -> None:
        """Whether the mission can be flown at all."""
        items = self._plan.items[self._first :]
        ready, self._far = bool(items), False
        for number, item in enumerate(items, self._first):
            if item.command not in _FLOWN or item.frame in PLACELESS:
                continue
            place = None if item.nowhere else self._place(item)
            if item.nowhere or (place and math.hypot(*place) > _MAX_DISTANCE_M):
                ready, self._far = False, True
            elif (
                place
                and self._policy.outside_fence_text
                and not self._fence.allows(*place, self._down_m(item))
            ):
                self._context.texts.report(self._policy.outside_fence_text, number + 1)
                ready = False
                break
        self._context.flight.mission_ready = ready

    @property
    def _first(self) -> int:
        return 1 if self._policy.home_first and len(self._plan.items) > 1 else 0

    def _reset(self, index: int) -> None:
        self._index, self._leg, self._reached, self._complete = index, None, None, False
        self._jumps, self._started, self._speed_mps, self._roi, self._yaw_rad = {}, False, None, None, None
        self._actions.clear()

    def _disarmed(self) -> None:
        self._may_lift_off, self._announced = False, -1
        if self._policy.restarts_when_disarmed:
            self._reset(self._first)

    def _place(self, item: MissionItem) -> NorthEast | None:
        degrees = item.place_deg
        if degrees is None or (self._policy.home_first and degrees == (0.0, 0.0)):
            return None
        return self._context.frame.to_local_m(*degrees)

    def _down_m(self, item: MissionItem) -> float:
        flight = self._context.flight
        home_m = flight.home.altitude_m if flight.home else flight.origin.altitude_m
        altitude = item.z if item.frame in ABOVE_SEA else item.z + home_m
        if not math.isfinite(altitude):
            return flight.down_m
        return flight.origin.altitude_m - min(max(altitude, -1e4), 1e5)

    # The flight.

    def _enter(self, flight: FlightState) -> None:
        """Begin or resume the mission: the mode was entered, or a client chose another item."""
        if not flight.mission_ready:
            self._stay(flight, (flight.north_m, flight.east_m))
            return
        if self._complete:
            self._reset(self._first)
        self._from = None
        self._index = max(self._index, self._first)
        self._guidance.speed_mps = self._speed_mps
        if not self._started and flight.armed:
            self._context.texts.report(self._policy.begin_text)
        self._begin(self._index)

    def _leg_over(self, flight: FlightState, leg: MissionLeg) -> None:
        if self._lands_next:
            self._lands_next = False
            self._fly(DescendLeg(self._landing(flight, self._plan.items[self._index])))
            return
        self._arrived(self._index)
        self._from = (
            self._place(self._plan.items[self._index]) if self._index < len(self._plan.items) else None
        )
        self._passed = (
            leg.course if isinstance(leg, GotoLeg) and isinstance(leg.course, WaypointPath) else None
        )
        self._begin(self._index + 1)
        self._passed = None

    def _begin(self, index: int) -> None:
        """Fly the next item from `index` on that can be flown; the actions on the way are carried out
        meanwhile.
        """
        self._actions.clear()
        self._wait_ns, self._within_m, self._yaw_rad, jumps = 0, None, None, 0
        items = self._plan.items
        while index < len(items) and items[index].command not in _FLOWN:
            if items[index].command in _JUMPS:
                index = self._jump(index, items[index])
                jumps += 1
                if jumps > _MAX_JUMPS:
                    break
            elif len(self._actions) >= _MAX_ACTIONS:
                index = len(items)
            else:
                self._actions.append((index, items[index]))
                index += 1
        flight = self._context.flight
        finished = index >= len(items) or jumps > _MAX_JUMPS
        if not finished:
            self._index = index
        self._run_due_actions(flight)
        if flight.mode.behaviour is not _MISSION:
            return  # an action has left the mode; when it is entered again, the item is flown
        if finished:
            self._finish(flight)
        else:
            self._fly_item(flight, items[index])

    def _jump(self, index: int, item: MissionItem) -> int:
        goal = self._due_jump(index, item)
        if goal is None:
            return index + 1
        self._jumps[index] = self._jumps.get(index, 0) + 1
        return goal

    def _due_jump(self, index: int, item: MissionItem) -> int | None:
        """Where a jump leads; None where it leads nowhere, or was taken as often as it asks for."""
        goal, times = item.params[0], item.params[1]
        if item.command == MAV_CMD.DO_JUMP_TAG:
            tags = (
                number
                for number, mark in enumerate(self._plan.items)
                if mark.command == MAV_CMD.JUMP_TAG and mark.params[0] == item.params[0]
            )
            goal = next(tags, math.nan)
        leads = math.isfinite(goal) and self._first <= goal < len(self._plan.items)
        due = leads and math.isfinite(times) and (times < 0 or self._jumps.get(index, 0) < times)
        return int(goal) if due else None

    def _finish(self, flight: FlightState) -> None:
        self._end("loitering" if flight.flying else "landed")
        self._stay(flight, self._here(flight), lambda *_: None)

    def _end(self, outcome: str) -> None:
        self._complete = True
        self._context.texts.report(self._policy.end_text, outcome)

    def _here(self, flight: FlightState) -> NorthEast:
        """Where the vehicle was last sent to, which is where it stays."""
        target = flight.target.north_east_m
        if (
            target
            and math.hypot(target[0] - flight.north_m, target[1] - flight.east_m) < _MAX_RESUMED_DISTANCE_M
        ):
            return target
        return flight.north_m, flight.east_m

    def _stay(
        self, flight: FlightState, place: NorthEast, heading_towards: HeadingFunction | None = None
    ) -> None:
        """Stay at a place until something else begins."""
        towards = heading_towards or self._heading_towards
        self._fly(GotoLeg(flight, place, flight.down_m, towards, 1.0, 1.0, math.inf))

    def _fly(self, leg: MissionLeg) -> None:
        self._leg = leg
        self._guidance.manoeuvre = leg.manoeuvre

    def _fly_item(self, flight: FlightState, item: MissionItem) -> None:
        policy = self._policy
        self._lands_next = False
        if self._announced != self._index:
            self._announced = self._index
            self._context.texts.report(policy.item_text(item), self._index)
        waiting = policy.waits_for_start and not flight.flying and not self._may_lift_off
        if waiting:
            self._stay(flight, (flight.north_m, flight.east_m))
            return
        self._started = True
        if item.command == MAV_CMD.NAV_RETURN_TO_LAUNCH and policy.return_changes_mode:
            self._end("loitering")
            self._context.texts.announce(FlightEvent.RETURNING)
            self._modes.switch_to(Behaviour.RETURN)
            return
        down = self._down_m(item)
        if not flight.flying and item.command not in _NO_LIFTOFF:
            # The item itself follows in the air.
            self._lift(flight, down)
            return
        self._fly(self._leg_of(flight, item, down))

    def _lift(self, flight: FlightState, down_m: float) -> None:
        """Climb to a waypoint's height before going there; the same item begins again in the air."""
        highest_down = flight.down_m - self._guidance.limits.takeoff_height_m
        self._announce_climb(flight, min(down_m, highest_down))
        self._actions.clear()
        leg = ClimbLeg(flight, min(down_m, highest_down))
        self._fly(_LegThen(leg, self._begin_item_again))

    def _begin_item_again(self) -> None:
        self._fly_item(self._context.flight, self._plan.items[self._index])

    def _announce_climb(self, flight: FlightState, down_m: float) -> None:
        home_down = flight.home.down_m if flight.home else 0.0
        self._context.texts.report(self._policy.climb_text, home_down - down_m)

    def _leg_of(self, flight: FlightState, item: MissionItem, down: float) -> MissionLeg:
        first, _, third, _ = (param if math.isfinite(param) else 0.0 for param in item.params)
        place = self._place(item) or self._here(flight)
        match item.command:
            case MAV_CMD.NAV_TAKEOFF | MAV_CMD.NAV_VTOL_TAKEOFF:
                self._announce_climb(flight, down)
                return ClimbLeg(flight, min(down, flight.down_m))
            case MAV_CMD.NAV_RETURN_TO_LAUNCH:
                return self._return(flight)
            case MAV_CMD.NAV_LAND | MAV_CMD.NAV_VTOL_LAND:
                distance_m = math.hypot(place[0] - flight.north_m, place[1] - flight.east_m)
                if (
                    self._place(item)
                    and distance_m > 1.0
                    and not self._guidance.manoeuvres.approaches_landing
                ):
                    self._lands_next = True
                    return self._goto(flight, item, place, flight.down_m, 0.0, radius_m=1.0)
                return DescendLeg(self._landing(flight, item))
            case MAV_CMD.NAV_DELAY:
                return self._goto(
                    flight, item, self._here(flight), flight.down_m, max(first, 0.0), radius_m=math.inf
                )
            case MAV_CMD.NAV_LOITER_UNLIM:
                return self._goto(flight, item, place, down, math.inf)
            case MAV_CMD.NAV_LOITER_TURNS:
                radius = self._guidance.manoeuvres.turning_radius_m(third, self._guidance.limits)
                return TurnsLeg(
                    flight,
                    place,
                    down,
                    radius,
                    min(max(first, 0.0), 255.0),
                    self._heading_towards,
                    self._guidance.speed_mps,
                )
            case _:
                stay_s = max(first, 0.0) if item.command != MAV_CMD.NAV_LOITER_TO_ALT else 0.0
                following = self._following() if item.command in _PASSED and stay_s == 0.0 else None
                return self._goto(flight, item, place, down, stay_s, following=following)

    def _goto(
        self,
        flight: FlightState,
        item: MissionItem,
        place: NorthEast,
        down: float,
        stay_s: float,
        radius_m: float | None = None,
        following: _Following | None = None,
    ) -> GotoLeg:
        radius = radius_m or self._policy.acceptance_radius_m(item, self._context.parameters)
        degrees = item.params[3]
        if self._policy.items_have_heading and math.isfinite(degrees) and item.command != MAV_CMD.NAV_DELAY:
            self._yaw_rad = math.radians(math.remainder(degrees, 360.0))
        height = math.inf if radius == math.inf else self._policy.acceptance_height_m
        manoeuvres = self._guidance.manoeuvres
        radius, height = (
            max(radius, manoeuvres.min_acceptance_radius_m),
            max(height, manoeuvres.min_acceptance_height_m),
        )
        return GotoLeg(
            flight,
            place,
            down,
            self._heading_towards,
            radius,
            height,
            stay_s,
            self._guidance.speed_mps,
            self._from,
            self._course(flight, place, down, following, radius),
        )

    def _course(
        self,
        flight: FlightState,
        place: NorthEast,
        down: float,
        following: _Following | None,
        radius_m: float,
    ) -> WaypointApproach | WaypointPath | None:
        """How the autopilot approaches a place of the mission, and leaves it again."""
        manoeuvres, limits = self._guidance.manoeuvres, self._guidance.limits
        if not manoeuvres.shapes_waypoints or radius_m == math.inf:
            return None
        if limits.waypoint_path is None:
            line = (self._from or (flight.north_m, flight.east_m), place)
            return WaypointApproach(flight, line, following.place if following else None, radius_m)
        passed, end = self._passed, (*place, down)
        if passed and passed.following and passed.following.end_m == end:
            segment, previous = passed.following, passed.segment
        else:
            start = (*stopping_place(flight), flight.down_m + stopping_m(flight.vd_mps))
            segment, previous = self._segment(start, end, self._guidance.speed_mps), None
        behind = (
            self._segment(end, (*following.place, following.down_m), following.speed_mps)
            if following
            else None
        )
        corner_mps2 = limits.waypoint_corner_mps2
        return WaypointPath(segment, behind, radius_m, corner_mps2, flight.time_ns, previous)

    def _segment(self, start_m: Vector, end_m: Vector, speed_mps: float | None) -> PathSegment:
        limits = self._guidance.limits
        assert limits.waypoint_path
        path = replace(limits.waypoint_path, speed_mps=speed_mps or limits.waypoint_path.speed_mps)
        return PathSegment.between(start_m, end_m, path, limits)

    def _following(self) -> _Following | None:
        """The place behind a waypoint that is only passed; None where the vehicle stops."""
        index, speed_mps, items = self._index + 1, self._guidance.speed_mps, self._plan.items
        for _ in range(_MAX_LOOK_AHEAD):
            if index >= len(items):
                return None
            item = items[index]
            if item.command in _FLOWN:
                place = self._place(item) if item.command in _WITH_COURSE else None
                return _Following(place, self._down_m(item), speed_mps) if place else None
            if item.command == MAV_CMD.DO_CHANGE_SPEED and _is_ground_speed(*item.params[:2]):
                speed_mps = self._speed_of(item.params[1])
            goal = self._due_jump(index, item) if item.command in _JUMPS else None
            index = index + 1 if goal is None else goal
        return None

    def _landing(self, flight: FlightState, item: MissionItem) -> Land:
        ground = flight.home.down_m if flight.home else 0.0
        return self._guidance.manoeuvres.land(flight, self._place(item), ground)

    def _return(self, flight: FlightState) -> MissionLeg:
        return_point = self._guidance.return_point(flight) or flight.origin
        return DescendLeg(self._guidance.manoeuvres.go_home(flight, return_point, self._guidance.limits))

    def _heading_towards(self, flight: FlightState, place: NorthEast) -> float | None:
        if self._roi:
            return bearing(flight, self._roi)
        return self._yaw_rad if self._yaw_rad is not None else bearing(flight, place)

    # DO and CONDITION items.

    def _run_due_actions(self, flight: FlightState) -> None:
        remaining = _ACTIONS_PER_STEP
        while self._actions and remaining and not self._waits(flight):
            remaining -= 1
            number, item = self._actions.popleft()
            self._context.texts.report(self._policy.item_text(item), number)
            self._run_action(flight, item)
            if flight.mode.behaviour is not _MISSION:
                return
            if not self._policy.reached_counts_next:
                self._arrived(number)

    def _run_action(self, flight: FlightState, item: MissionItem) -> None:
        first, second = item.params[:2]
        if item.command == MAV_CMD.DO_CHANGE_SPEED:
            self._change_speed(item, first, second)
        elif item.command == MAV_CMD.CONDITION_YAW and math.isfinite(first):
            turn = math.radians(first)
            relative = item.params[3] == 1.0
            self._yaw_rad = flight.yaw_rad + math.copysign(turn, item.params[2] or 1.0) if relative else turn
        elif item.command == MAV_CMD.DO_SET_ROI_NONE:
            self._look_at(None, flight.down_m)
        elif item.command in _ROI:
            self._look_at(self._place(item) if item.frame not in PLACELESS else None, self._down_m(item))
        elif item.command in self._policy.actions:
            self._run_own_action(flight, item)
        elif text := self._policy.idle_text(item):
            self._context.texts.report(text)
        else:
            use_payload(self._gimbal, self._camera, item)

    def _run_own_action(self, flight: FlightState, item: MissionItem) -> None:
        first, second = item.params[:2]
        match item.command:
            case MAV_CMD.CONDITION_DELAY if math.isfinite(first):
                self._wait_ns = flight.time_ns + round(min(max(first, 0.0), 1e6) * 1e9)
            case MAV_CMD.CONDITION_DISTANCE:
                self._within_m = max(first, 0.0)
            case MAV_CMD.DO_FENCE_ENABLE if first in (0.0, 1.0):
                self._fence.enable(first == 1.0)
            case MAV_CMD.DO_AUX_FUNCTION:
                self._modes.run_auxiliary(first, second)
            case MAV_CMD.DO_SET_HOME:
                place = None if first == 1.0 or item.nowhere else item.place_deg
                if place is None or (*place, item.z) == (0.0, 0.0, 0.0):
                    self._home.set_here()
                else:
                    self._home.set_at(place, flight.origin.altitude_m - self._down_m(item))

    def _waits(self, flight: FlightState) -> bool:
        """Whether a condition keeps the actions behind it back."""
        if flight.time_ns < self._wait_ns:
            return True
        if self._within_m is None:
            return False
        place = self._place(self._plan.items[self._index])
        away_m = 0.0 if place is None else math.hypot(place[0] - flight.north_m, place[1] - flight.east_m)
        if away_m >= self._within_m:
            return True
        self._within_m = None
        return False

    def _look_at(self, place: NorthEast | None, down_m: float) -> None:
        """Point the gimbal at a region of interest, or the nose where there is no gimbal; None ends it."""
        gimbal = self._gimbal
        if gimbal is None:
            self._roi = place
        elif place is None:
            gimbal.release()
        else:
            gimbal.look_at(*place, down_m)

    def _change_speed(self, item: MissionItem, kind: float, speed: float) -> None:
        if _is_ground_speed(kind, speed):
            self._speed_mps = self._speed_of(speed)
            manoeuvre = self._guidance.manoeuvre
            self._guidance.speed_mps = self._speed_mps
            if self._speed_mps and isinstance(manoeuvre, Hold):
                manoeuvre.change_speed(self._speed_mps)
        if self._own_commands:
            self._own_commands.send(MAV_CMD.DO_CHANGE_SPEED, item.params)

    def _speed_of(self, speed: float) -> float | None:
        """The speed that an item asks for; None for the parameters' speed."""
        return min(speed, self._guidance.limits.speed_max_mps) if speed > 0.0 else None

    def _arrived(self, number: int) -> None:
        items, policy = self._plan.items, self._policy
        if policy.reached_counts_next:
            if items[number].command in _PASSED:
                self._context.texts.send(INFO, f"Reached command #{number}")
            if number + 1 < len(items) and items[number + 1].command not in _FLOWN:
                number += 1
        self._reached = number
        self._context.radio.broadcast("MISSION_ITEM_REACHED", seq=number)
        if policy.reached_repeat_s:
            self._repeat_ns = self._context.flight.time_ns + round(policy.reached_repeat_s * 1e9)

    def _repeat(self, flight: FlightState) -> None:
        repeat_s = self._policy.reached_repeat_s
        if repeat_s and self._reached is not None and flight.time_ns >= self._repeat_ns:
            self._repeat_ns += round(repeat_s * 1e9)
            self._context.radio.broadcast("MISSION_ITEM_REACHED", seq=self._reached)

    # Requests of clients.

    def _choose(self, number: int) -> bool:
        if not self._first <= number < len(self._plan.items) and not (
            self._policy.home_first and number == 0
        ):
            return False
        started = self._started
        self._reset(max(number, self._first))
        self._started = started
        return True

    def _set_current(self, m: Any, sender: MessageSender) -> None:
        if m.seq < len(self._plan.items) and self._choose(m.seq):
            sender.channel.send(KINDS["MISSION_CURRENT"].id, self._current())
        else:
            self._context.texts.report(self._policy.no_such_item_text)

    def _set_current_command(self, command: Command) -> CommandResult | None:
        number, reset_jumps = command.params[:2]
        if reset_jumps == 1.0:
            self._jumps.clear()
        if number == -1.0:
            return CommandResult.ACCEPTED
        valid = math.isfinite(number) and 0.0 <= number < len(self._plan.items) and self._choose(int(number))
        return CommandResult.ACCEPTED if valid else CommandResult.DENIED

    def _start(self, command: Command) -> CommandResult | None:
        flight, policy = self._context.flight, self._policy
        if not flight.mission_ready and not (policy.starts_without_mission and not flight.armed):
            self._context.texts.report(policy.start_refused_text)
            if policy.start_refused_text is None:
                # The request is refused, which sends ArduPilot's text with the reason.
                self._modes.request(self._mode.custom)
                return CommandResult.FAILED
            return CommandResult.DENIED
        first = command.params[0]
        if math.isfinite(first) and first > 0.0 and not policy.home_first:
            self._choose(int(min(first, 65535.0)))
        if refusal := self._modes.enter(self._mode):
            return refusal.result
        if policy.arms_at_start and not flight.armed and not self._arm():
            return CommandResult.TEMPORARILY_REJECTED
        if flight.armed:
            self._may_lift_off, self._leg = True, None
        return CommandResult.ACCEPTED

    def _start_landing(self, command: Command) -> CommandResult | None:
        starts = [
            number for number, item in enumerate(self._plan.items) if item.command == MAV_CMD.DO_LAND_START
        ]
        if not starts or not self._context.flight.mission_ready:
            self._context.texts.send_all(self._policy.no_landing_texts)
            return CommandResult.FAILED if self._policy.home_first else CommandResult.CANCELLED
        self._choose(starts[0])
        if refusal := self._modes.enter(self._mode):
            return refusal.result
        return CommandResult.ACCEPTED


def _is_ground_speed(kind: float, speed: float) -> bool:
    """Whether DO_CHANGE_SPEED means the speed over ground (PX4 and ArduCopter take airspeed for the same)."""
    return kind in (0.0, 1.0) and math.isfinite(speed)


def effect_of(command: int, policy: MissionPolicy) -> str:
    """What an item does when its turn comes, in a word of docs/flight-controller.md."""
    if command in _FLOWN:
        return "flown"
    if command in _ACTIONS or command in policy.actions:
        return "carried out"
    if command in _MARKS:
        return "a mark"
    return PAYLOAD_ITEMS.get(command, "no effect")


class _LegThen:
    """A leg that is followed by something else than the next item."""

    def __init__(self, leg: ClimbLeg, then: Callable[[], None]) -> None:
        self.manoeuvre = leg.manoeuvre
        self._leg, self._then = leg, then

    def over(self, flight: FlightState) -> bool:
        if self._leg.over(flight):
            self._then()
        return False
