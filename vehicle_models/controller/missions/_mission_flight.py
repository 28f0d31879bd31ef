"""The flight of a mission: which item is flown, what comes next, and what is reported of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ..guidance._guidance import Guidance
from ..guidance._legs import ClimbLeg, DescendLeg, GotoLeg, HeadingFunction, MissionLeg, TurnsLeg
from ..guidance._manoeuvres import Land
from ..guidance._waypoints import Following, WaypointApproach, WaypointPath, waypoint_course
from ..links._enums import MAV_CMD
from ..links._frames import KINDS
from ..policies._missions import MissionPolicy
from ..services._modes import Modes
from ..state._flight_state import Behaviour, FlightMode, FlightState, NorthEast
from ..state._plan_store import MissionItem
from ..state._service import Command, CommandHandler, CommandResult, MessageHandler, MessageSender, Stream
from ..state._service_context import ServiceContext
from ..state._texts import INFO, FlightEvent
from ._item_actions import ItemActions
from ._mission_plan import FLOWN, LANDINGS, PASSED, TAKEOFFS, MissionPlan

# Flown from the ground as they are.
_NO_LIFTOFF = (*TAKEOFFS, *LANDINGS, MAV_CMD.NAV_RETURN_TO_LAUNCH, MAV_CMD.NAV_DELAY)
# Looked up once, because every step compares with it.
_MISSION = Behaviour.MISSION
# A target farther away is not where the vehicle stays.
_MAX_RESUMED_DISTANCE_M = 20.0
# MISSION_STATE
_NO_MISSION, _NOT_STARTED, _ACTIVE, _PAUSED, _COMPLETE = 1, 2, 3, 4, 5


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
    _plan: MissionPlan
    _actions: ItemActions
    _arm: Callable[[], bool]
    _index: int = 0  # of the item that is flown
    _leg: MissionLeg | None = None
    _from: NorthEast | None = None  # where the present leg begins; None: where the vehicle was
    _passed: WaypointPath | None = None  # the path of the leg that is just over
    _lands_next: bool = False  # the present leg leads to a place to land on
    _reached: int | None = None
    _repeat_ns: int = 0
    _complete: bool = False
    _started: bool = False
    _may_lift_off: bool = False
    _announced: int = -1  # item whose text was sent last
    _ended: bool = False  # disarmed in the mode: nothing begins until it is entered again
    _was_armed: bool = False

    def __post_init__(self) -> None:
        plans = self._plan.stored
        plans.mission.on_change.append(self._changed)
        plans.fence.on_change.append(self._plan.judge)

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
            self._run_actions(flight)
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
        plans = self._plan.stored
        identities = (plans.mission.identity, plans.fence.identity, plans.rally.identity)
        if not self._policy.transfer.one_at_a_time:
            identities = (0, 0, 0)
        return (self._index, total, state, 1 if in_mode else 2, *identities)

    def _changed(self) -> None:
        marked = [number for number, item in enumerate(self._plan.items) if item.current]
        if self._plan.judge() and self._policy.far_event:
            self._context.texts.notify(*self._policy.far_event)
        self._reset(marked[-1] if marked and not self._policy.home_first else self._plan.first)

    def _reset(self, index: int) -> None:
        self._index, self._leg, self._reached, self._complete = index, None, None, False
        self._plan.jumps, self._started = {}, False
        self._actions.reset()

    def _disarmed(self) -> None:
        self._may_lift_off, self._announced = False, -1
        if self._policy.restarts_when_disarmed:
            self._reset(self._plan.first)

    def _enter(self, flight: FlightState) -> None:
        """Begin or resume the mission: the mode was entered, or a client chose another item."""
        if not flight.mission_ready:
            self._stay(flight, (flight.north_m, flight.east_m))
            return
        if self._complete:
            self._reset(self._plan.first)
        self._from = None
        self._index = max(self._index, self._plan.first)
        self._guidance.speed_mps = self._actions.speed_mps
        if not self._started and flight.armed:
            self._context.texts.report(self._policy.begin_text)
        self._begin(self._index)

    def _leg_over(self, flight: FlightState, leg: MissionLeg) -> None:
        if self._lands_next:
            self._lands_next = False
            self._fly(DescendLeg(self._landing(flight, self._plan.items[self._index])))
            return
        self._arrived(self._index)
        item = self._plan.item(self._index)
        self._from = self._plan.place(item) if item else None
        course = leg.course if isinstance(leg, GotoLeg) else None
        self._passed = course if isinstance(course, WaypointPath) else None
        self._begin(self._index + 1)
        self._passed = None

    def _begin(self, index: int) -> None:
        """Fly the next item from `index` on that can be flown, and carry out the actions on the way."""
        flight = self._context.flight
        flown, actions = self._plan.next_flown(index)
        self._actions.begin(actions)
        if flown is not None:
            self._index = flown
        self._run_actions(flight)
        if flight.mode.behaviour is not _MISSION:
            return  # an action has left the mode; when it is entered again, the item is flown
        if flown is None:
            self._finish(flight)
        else:
            self._fly_item(flight, self._plan.items[flown])

    def _run_actions(self, flight: FlightState) -> None:
        for number in self._actions.run(flight, self._plan.item(self._index)):
            if not self._policy.reached_counts_next:
                self._arrived(number)

    def _finish(self, flight: FlightState) -> None:
        self._end("loitering" if flight.flying else "landed")
        self._stay(flight, self._here(flight), lambda *_: None)

    def _end(self, outcome: str) -> None:
        self._complete = True
        self._context.texts.report(self._policy.end_text, outcome)

    def _here(self, flight: FlightState) -> NorthEast:
        """Where the vehicle was last sent to, which is where it stays."""
        target, place = flight.target.north_east_m, (flight.north_m, flight.east_m)
        return target if target and math.dist(target, place) < _MAX_RESUMED_DISTANCE_M else place

    def _stay(
        self, flight: FlightState, place: NorthEast, heading_towards: HeadingFunction | None = None
    ) -> None:
        """Stay at a place until something else begins."""
        towards = heading_towards or self._actions.heading_towards
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
        if policy.waits_for_start and not flight.flying and not self._may_lift_off:
            self._stay(flight, (flight.north_m, flight.east_m))
            return
        self._started = True
        if item.command == MAV_CMD.NAV_RETURN_TO_LAUNCH and policy.return_changes_mode:
            self._end("loitering")
            self._context.texts.announce(FlightEvent.RETURNING)
            self._modes.switch_to(Behaviour.RETURN)
            return
        down = self._plan.down_m(item)
        if not flight.flying and item.command not in _NO_LIFTOFF:
            # The item itself follows in the air.
            self._lift(flight, down)
            return
        self._fly(self._leg_of(flight, item, down))

    def _lift(self, flight: FlightState, down_m: float) -> None:
        """Climb to a waypoint's height before going there; the same item begins again in the air."""
        highest_down = flight.down_m - self._guidance.limits.takeoff_height_m
        self._announce_climb(flight, min(down_m, highest_down))
        self._actions.drop()
        leg = ClimbLeg(flight, min(down_m, highest_down))
        self._fly(_LegThen(leg, self._begin_item_again))

    def _begin_item_again(self) -> None:
        self._fly_item(self._context.flight, self._plan.items[self._index])

    def _announce_climb(self, flight: FlightState, down_m: float) -> None:
        home_down = flight.home.down_m if flight.home else 0.0
        self._context.texts.report(self._policy.climb_text, home_down - down_m)

    def _leg_of(self, flight: FlightState, item: MissionItem, down: float) -> MissionLeg:
        first, _, third, _ = (param if math.isfinite(param) else 0.0 for param in item.params)
        place = self._plan.place(item) or self._here(flight)
        match item.command:
            case MAV_CMD.NAV_TAKEOFF | MAV_CMD.NAV_VTOL_TAKEOFF:
                self._announce_climb(flight, down)
                return ClimbLeg(flight, min(down, flight.down_m))
            case MAV_CMD.NAV_RETURN_TO_LAUNCH:
                return self._return(flight)
            case MAV_CMD.NAV_LAND | MAV_CMD.NAV_VTOL_LAND:
                return self._land(flight, item)
            case MAV_CMD.NAV_DELAY:
                here, stay_s = self._here(flight), max(first, 0.0)
                return self._goto(flight, item, here, flight.down_m, stay_s, radius_m=math.inf)
            case MAV_CMD.NAV_LOITER_UNLIM:
                return self._goto(flight, item, place, down, math.inf)
            case MAV_CMD.NAV_LOITER_TURNS:
                radius = self._guidance.manoeuvres.turning_radius_m(third, self._guidance.limits)
                turns, towards = min(max(first, 0.0), 255.0), self._actions.heading_towards
                return TurnsLeg(flight, place, down, radius, turns, towards, self._guidance.speed_mps)
            case _:
                stay_s = max(first, 0.0) if item.command != MAV_CMD.NAV_LOITER_TO_ALT else 0.0
                following = None
                if item.command in PASSED and stay_s == 0.0:
                    guidance = self._guidance
                    following = self._plan.following(self._index, guidance.speed_mps, guidance.limits)
                return self._goto(flight, item, place, down, stay_s, following=following)

    def _land(self, flight: FlightState, item: MissionItem) -> MissionLeg:
        """Land at the item's place; where that is not here and the vehicle does not approach it by itself, go there first."""
        place = self._plan.place(item)
        away = place and math.hypot(place[0] - flight.north_m, place[1] - flight.east_m) > 1.0
        if place and away and not self._guidance.manoeuvres.approaches_landing:
            self._lands_next = True
            return self._goto(flight, item, place, flight.down_m, 0.0, radius_m=1.0)
        return DescendLeg(self._landing(flight, item))

    def _goto(
        self,
        flight: FlightState,
        item: MissionItem,
        place: NorthEast,
        down: float,
        stay_s: float,
        radius_m: float | None = None,
        following: Following | None = None,
    ) -> GotoLeg:
        radius = radius_m or self._policy.acceptance_radius_m(item, self._context.parameters)
        degrees = item.params[3]
        if self._policy.items_have_heading and math.isfinite(degrees) and item.command != MAV_CMD.NAV_DELAY:
            self._actions.yaw_rad = math.radians(math.remainder(degrees, 360.0))
        height = math.inf if radius == math.inf else self._policy.acceptance_height_m
        manoeuvres = self._guidance.manoeuvres
        radius = max(radius, manoeuvres.min_acceptance_radius_m)
        height = max(height, manoeuvres.min_acceptance_height_m)
        towards, speed_mps = self._actions.heading_towards, self._guidance.speed_mps
        course = self._course(flight, place, down, following, radius)
        return GotoLeg(flight, place, down, towards, radius, height, stay_s, speed_mps, self._from, course)

    def _course(
        self, flight: FlightState, place: NorthEast, down: float, following: Following | None, radius_m: float
    ) -> WaypointApproach | WaypointPath | None:
        guidance = self._guidance
        if not guidance.manoeuvres.shapes_waypoints or radius_m == math.inf:
            return None
        line = (self._from or (flight.north_m, flight.east_m), place)
        behind = (self._passed, following)
        return waypoint_course(flight, guidance.limits, line, down, radius_m, guidance.speed_mps, *behind)

    def _landing(self, flight: FlightState, item: MissionItem) -> Land:
        ground = flight.home.down_m if flight.home else 0.0
        return self._guidance.manoeuvres.land(flight, self._plan.place(item), ground)

    def _return(self, flight: FlightState) -> MissionLeg:
        return_point = self._guidance.return_point(flight) or flight.origin
        return DescendLeg(self._guidance.manoeuvres.go_home(flight, return_point, self._guidance.limits))

    def _arrived(self, number: int) -> None:
        items, policy = self._plan.items, self._policy
        if policy.reached_counts_next:
            if items[number].command in PASSED:
                self._context.texts.send(INFO, f"Reached command #{number}")
            if number + 1 < len(items) and items[number + 1].command not in FLOWN:
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
        is_home = self._policy.home_first and number == 0
        if not is_home and not self._plan.first <= number < len(self._plan.items):
            return False
        started = self._started
        self._reset(max(number, self._plan.first))
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
            self._plan.jumps.clear()
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
        commands = [item.command for item in self._plan.items]
        if MAV_CMD.DO_LAND_START not in commands or not self._context.flight.mission_ready:
            self._context.texts.send_all(self._policy.no_landing_texts)
            return CommandResult.FAILED if self._policy.home_first else CommandResult.CANCELLED
        self._choose(commands.index(MAV_CMD.DO_LAND_START))
        if refusal := self._modes.enter(self._mode):
            return refusal.result
        return CommandResult.ACCEPTED


class _LegThen:
    """A leg that is followed by something else than the next item."""

    def __init__(self, leg: ClimbLeg, then: Callable[[], None]) -> None:
        self.manoeuvre = leg.manoeuvre
        self._leg, self._then = leg, then

    def over(self, flight: FlightState) -> bool:
        if self._leg.over(flight):
            self._then()
        return False
