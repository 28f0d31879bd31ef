"""Missions in the air: which item is flown, what comes next, and what is said of it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from .._flight import Behaviour, Flight
from .._service import Command, CommandHandler, Handler, Result, Sender
from .._service_context import ServiceContext
from ..guidance._guidance import Guidance
from ..guidance._legs import Climb, Descend, Goto, Leg, Place, Turns, bearing
from ..guidance._manoeuvres import Hold, Land
from ..payload._camera import CameraComponent
from ..payload._gimbal import Gimbal
from ..services._modes import Modes
from ._payload_items import use_payload
from ._policy import Text
from ._store import ABOVE_SEA, PLACELESS, Item, Plans

MISSION_START, SET_CURRENT, LAND_START = 300, 224, 189
WAYPOINT, UNLIMITED, TURNS, TIME, RETURN, LAND, TAKEOFF, TO_HEIGHT = 16, 17, 18, 19, 20, 21, 22, 31
SPLINE, VTOL_TAKEOFF, VTOL_LAND, DELAY = 82, 84, 85, 93
JUMP, SPEED, YAW, WAIT, LANDING_BEGINS, ROI_NONE = 177, 178, 115, 112, 189, 197
ROI = (80, 195, 201)
_FLOWN = frozenset({WAYPOINT, UNLIMITED, TURNS, TIME, RETURN, LAND, TAKEOFF, TO_HEIGHT, SPLINE, VTOL_TAKEOFF, VTOL_LAND, DELAY})
_PASSED = frozenset({WAYPOINT, SPLINE})
_MOST_JUMPS = 100  # at once: a ring of jumps without anything to fly ends the mission
_MOST_DOS = 1000  # between two items to fly
_DOS_A_STEP = 20
_FARTHEST_M = 500_000.0
_BRAKING_MPS2 = 1.5
NO_MISSION, NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 1, 2, 3, 4, 5  # MISSION_STATE


class MissionFlight:
    """Flies the mission while its mode is on; MISSION_SET_CURRENT, MISSION_START and their kin.

    `arm` arms the vehicle and says whether it could.
    """

    def __init__(
        self,
        board: ServiceContext,
        modes: Modes,
        guidance: Guidance,
        plans: Plans,
        arm: Callable[[], bool],
        gimbal: Gimbal | None,
        camera: CameraComponent | None,
    ) -> None:
        self._board, self._modes, self._guidance = board, modes, guidance
        self._policy = board.personality.missions
        self._plan = plans.mission
        self._plans = plans
        self._arm = arm
        self._gimbal, self._camera = gimbal, camera
        self._at = 0  # the item that is flown
        self._leg: Leg | None = None
        self._from: Place | None = None  # where the present leg begins; None: where the vehicle was
        self._descends = False  # the present leg is the way to a place to land on
        self._dos: deque[tuple[int, Item]] = deque()
        self._wait_ns = 0
        self._jumps: dict[int, int] = {}
        self._reached: int | None = None
        self._say_again_ns = 0
        self._complete = False
        self._far = False  # an item lies where nothing can be flown
        self._started = False
        self._cleared = False  # for leaving the ground
        self._named = -1
        self._over_with = False  # disarmed in the mode: nothing begins until it is entered again
        self._was_armed = False
        self._speed_mps: float | None = None
        self._roi: Place | None = None
        self._yaw_rad: float | None = None
        self._plan.on_change.append(self._changed)
        plans.fence.on_change.append(self._judge)

    def handlers(self) -> Mapping[str, Handler]:
        return {"MISSION_SET_CURRENT": self._set_current}

    def commands(self) -> Mapping[int, CommandHandler]:
        more: dict[int, CommandHandler] = {SET_CURRENT: self._set_current_command} if self._policy.set_current_command else {}
        return {MISSION_START: self._start, LAND_START: self._land_start, **more}

    def tick(self) -> None:
        flight = self._board.flight
        if self._was_armed is not flight.armed:
            self._was_armed, self._leg = flight.armed, None
            self._over_with = not flight.armed
            if not flight.armed:
                self._disarmed()
        if flight.mode.behaviour is not Behaviour.MISSION:
            self._leg, self._named, self._over_with = None, -1, False
        elif self._leg is None:
            if flight.armed or (self._policy.waits_for_start and not self._over_with):
                self._enter(flight)
        elif flight.armed:
            self._go_on(flight, self._leg)

    def _go_on(self, flight: Flight, leg: Leg) -> None:
        if self._guidance.manoeuvre is leg.manoeuvre:  # else it is paused
            if leg.over(flight):
                self._over(flight)
            if self._dos:
                self._do_due(flight)
        self._repeat(flight)

    def current(self) -> tuple[int, ...]:
        """Values of MISSION_CURRENT in wire order."""
        items, personality = self._plan.items, self._board.personality
        first = 1 if self._policy.home_first else 0
        total = len(items) - first if len(items) > first else personality.no_mission_total
        in_mode = self._board.flight.mode.behaviour is Behaviour.MISSION
        if not self._board.flight.mission_ready:
            state = NO_MISSION
        elif self._complete:
            state = COMPLETE
        elif in_mode and self._board.flight.armed:
            state = ACTIVE
        else:
            state = PAUSED if self._started else NOT_STARTED
        plans = self._plans
        identities = (plans.mission.identity, plans.fence.identity, plans.rally.identity)
        if not self._policy.one_at_a_time:
            identities = (0, 0, 0)
        return (self._at, total, state, 1 if in_mode else 2, *identities)

    # What the plan is.

    def _changed(self) -> None:
        marked = [number for number, item in enumerate(self._plan.items) if item.current and not self._policy.home_first]
        self._judge()
        if self._far and self._policy.far_note:
            self._board.texts.note(*self._policy.far_note)
        self._forget(marked[-1] if marked else self._first)

    def _judge(self) -> None:
        """Whether the mission can be flown at all."""
        items = self._plan.items[self._first :]
        ready, self._far = bool(items), False
        for number, item in enumerate(items, self._first):
            if item.command not in _FLOWN or item.frame in PLACELESS:
                continue
            place = None if item.nowhere else self._place(item)
            if item.nowhere or (place and math.hypot(*place) > _FARTHEST_M):
                ready, self._far = False, True
            elif place and self._policy.outside_text and not self._board.allows(*place, self._down_m(item)):
                severity, text = self._policy.outside_text
                self._board.texts.say(severity, text.format(number + 1))
                ready = False
                break
        self._board.flight.mission_ready = ready

    @property
    def _first(self) -> int:
        return 1 if self._policy.home_first and len(self._plan.items) > 1 else 0

    def _forget(self, at: int) -> None:
        self._at, self._leg, self._reached, self._complete = at, None, None, False
        self._jumps, self._started, self._speed_mps, self._roi, self._yaw_rad = {}, False, None, None, None
        self._dos.clear()

    def _disarmed(self) -> None:
        self._cleared, self._named = False, -1
        if self._policy.forgets_when_disarmed:
            self._forget(self._first)

    def _place(self, item: Item) -> Place | None:
        degrees = item.place_deg
        if degrees is None or (self._policy.home_first and degrees == (0.0, 0.0)):
            return None
        return self._board.airframe.to_local_m(*degrees)

    def _down_m(self, item: Item) -> float:
        flight = self._board.flight
        home_m = flight.home.altitude_m if flight.home else flight.origin.altitude_m
        altitude = item.z if item.frame in ABOVE_SEA else item.z + home_m
        if not math.isfinite(altitude):
            return flight.down_m
        return flight.origin.altitude_m - min(max(altitude, -1e4), 1e5)

    # Flying it.

    def _enter(self, flight: Flight) -> None:
        """The mode has just begun, or somebody chose another item."""
        if not flight.mission_ready:
            self._fly(Goto(flight, (flight.north_m, flight.east_m), flight.down_m, self._look, 1.0, 1.0, math.inf))
            return
        if self._complete:
            self._forget(self._first)
        self._from = None
        self._at = max(self._at, self._first)
        self._guidance.speed_mps = self._speed_mps
        if not self._started and flight.armed:
            self._say(self._policy.begin_text)
        self._begin(self._at)

    def _over(self, flight: Flight) -> None:
        if self._descends:
            self._descends = False
            self._fly(Descend(self._landing(flight, self._plan.items[self._at])))
            return
        self._arrived(self._at)
        self._from = self._place(self._plan.items[self._at]) if self._at < len(self._plan.items) else None
        self._begin(self._at + 1)

    def _begin(self, at: int) -> None:
        """Fly the next item from `at` on that can be flown; what is to be done on the way is done beside."""
        self._dos.clear()
        self._wait_ns, self._yaw_rad, jumps = 0, None, 0
        items = self._plan.items
        while at < len(items) and items[at].command not in _FLOWN:
            if items[at].command == JUMP:
                at = self._jump(at, items[at])
                jumps += 1
                if jumps > _MOST_JUMPS:
                    break
            elif len(self._dos) >= _MOST_DOS:
                at = len(items)
            else:
                self._dos.append((at, items[at]))
                at += 1
        flight = self._board.flight
        self._do_due(flight)
        if at >= len(items) or jumps > _MOST_JUMPS:
            self._finish(flight)
        else:
            self._at = at
            self._fly_item(flight, items[at])

    def _jump(self, at: int, item: Item) -> int:
        goal, times = item.params[0], item.params[1]
        done = self._jumps.get(at, 0)
        leads = math.isfinite(goal) and self._first <= goal < len(self._plan.items)
        if not leads or not math.isfinite(times) or (times >= 0 and done >= times):
            return at + 1
        self._jumps[at] = done + 1
        return int(goal)

    def _finish(self, flight: Flight) -> None:
        self._end("loitering" if flight.flying else "landed")
        self._fly(Goto(flight, self._here(flight), flight.down_m, lambda *_: None, 1.0, 1.0, math.inf))

    def _end(self, how: str) -> None:
        self._complete = True
        if self._policy.end_text:
            self._board.texts.say(self._policy.end_text[0], self._policy.end_text[1].format(how))

    def _here(self, flight: Flight) -> Place:
        """Where the vehicle was told to be, which is where it stays."""
        target = flight.target.north_east_m
        if target and math.hypot(target[0] - flight.north_m, target[1] - flight.east_m) < 20.0:
            return target
        return flight.north_m, flight.east_m

    def _fly(self, leg: Leg) -> None:
        self._leg = leg
        self._guidance.manoeuvre = leg.manoeuvre

    def _fly_item(self, flight: Flight, item: Item) -> None:
        policy = self._policy
        name = policy.name(item)
        self._descends = False
        if name and self._named != self._at:
            self._named = self._at
            self._board.texts.say(name[0], name[1].format(self._at))
        waiting = policy.waits_for_start and not flight.flying and not self._cleared
        if waiting:
            self._fly(Goto(flight, (flight.north_m, flight.east_m), flight.down_m, self._look, 1.0, 1.0, math.inf))
            return
        self._started = True
        if item.command == RETURN and policy.return_is_a_mode:
            self._end("loitering")
            self._modes.to(Behaviour.RETURN)
            return
        down = self._down_m(item)
        if not flight.flying and item.command not in (TAKEOFF, VTOL_TAKEOFF, LAND, VTOL_LAND, RETURN, DELAY):
            self._lift(flight, down)  # and then the item itself
            return
        self._fly(self._leg_of(flight, item, down))

    def _lift(self, flight: Flight, down_m: float) -> None:
        """Up to a waypoint's height before going there: the same item begins again in the air."""
        lowest = flight.down_m - self._guidance.limits.takeoff_height_m
        self._say_climb(flight, min(down_m, lowest))
        self._dos.clear()
        leg = Climb(flight, min(down_m, lowest))
        self._fly(_Then(leg, self._again))

    def _again(self) -> None:
        self._fly_item(self._board.flight, self._plan.items[self._at])

    def _say_climb(self, flight: Flight, down_m: float) -> None:
        if self._policy.climb_text:
            severity, text = self._policy.climb_text
            home_down = flight.home.down_m if flight.home else 0.0
            self._board.texts.say(severity, text.format(home_down - down_m))

    def _leg_of(self, flight: Flight, item: Item, down: float) -> Leg:
        first, _, third, _ = (one if math.isfinite(one) else 0.0 for one in item.params)
        place = self._place(item) or self._here(flight)
        match item.command:
            case 22 | 84:
                self._say_climb(flight, down)
                return Climb(flight, min(down, flight.down_m))
            case 20:
                return self._return(flight)
            case 21 | 85:
                away_m = math.hypot(place[0] - flight.north_m, place[1] - flight.east_m)
                if self._place(item) and away_m > 1.0 and not self._guidance.manoeuvres.lands_from_afar:
                    self._descends = True
                    return self._goto(flight, item, place, flight.down_m, 0.0, radius_m=1.0)
                return Descend(self._landing(flight, item))
            case 93:
                return self._goto(flight, item, self._here(flight), flight.down_m, max(first, 0.0), radius_m=math.inf)
            case 17:
                return self._goto(flight, item, place, down, math.inf)
            case 18:
                radius = self._guidance.manoeuvres.turning_radius_m(third, self._guidance.limits)
                return Turns(flight, place, down, radius, min(max(first, 0.0), 255.0), self._look, self._guidance.speed_mps)
            case _:
                stays = max(first, 0.0) if item.command != TO_HEIGHT else 0.0
                aim = self._beyond(flight, place) if item.command in _PASSED and stays == 0.0 else None
                return self._goto(flight, item, place, down, stays, aim=aim)

    def _goto(
        self,
        flight: Flight,
        item: Item,
        place: Place,
        down: float,
        stays_s: float,
        radius_m: float | None = None,
        aim: Place | None = None,
    ) -> Goto:
        radius = radius_m or self._policy.radius_m(item, self._board.parameters)
        degrees = item.params[3]
        if self._policy.item_yaw and math.isfinite(degrees) and item.command != DELAY:
            self._yaw_rad = math.radians(math.remainder(degrees, 360.0))
        height = math.inf if radius == math.inf else self._policy.alt_reached_m
        manoeuvres = self._guidance.manoeuvres
        radius, height = max(radius, manoeuvres.passes_m), max(height, manoeuvres.passes_height_m)
        return Goto(flight, place, down, self._look, radius, height, stays_s, aim, self._guidance.speed_mps, self._from)

    def _beyond(self, flight: Flight, place: Place) -> Place | None:
        """A point behind a waypoint that is only passed, so far ahead as the course goes on the same way: no braking."""
        goal = next((one for one in self._plan.items[self._at + 1 : self._at + 9] if one.command in _FLOWN), None)
        after = self._place(goal) if goal and goal.command in (WAYPOINT, SPLINE, TIME, UNLIMITED) else None
        if after is None:
            return None
        along = (place[0] - flight.north_m, place[1] - flight.east_m)
        on = (after[0] - place[0], after[1] - place[1])
        lengths = math.hypot(*along) * math.hypot(*on)
        if lengths < 1e-6:
            return None
        share = max((along[0] * on[0] + along[1] * on[1]) / lengths, 0.0)
        speed = self._guidance.speed_mps or self._guidance.limits.cruise_mps
        ahead = min(share * share * speed * speed / _BRAKING_MPS2, math.hypot(*on)) / math.hypot(*along)
        return place[0] + along[0] * ahead, place[1] + along[1] * ahead

    def _landing(self, flight: Flight, item: Item) -> Land:
        ground = flight.home.down_m if flight.home else 0.0
        return self._guidance.manoeuvres.land(flight, self._place(item), ground)

    def _return(self, flight: Flight) -> Leg:
        refuge = self._guidance.refuge(flight) or flight.origin
        return Descend(self._guidance.manoeuvres.go_home(flight, refuge, self._guidance.limits))

    def _look(self, flight: Flight, place: Place) -> float | None:
        if self._roi:
            return bearing(flight, self._roi)
        return self._yaw_rad if self._yaw_rad is not None else bearing(flight, place)

    # What is done beside flying.

    def _do_due(self, flight: Flight) -> None:
        left = _DOS_A_STEP
        while self._dos and left and flight.time_ns >= self._wait_ns:
            left -= 1
            number, item = self._dos.popleft()
            name = self._policy.name(item)
            if name:
                self._board.texts.say(name[0], name[1].format(number))
            self._do(flight, item)
            if not self._policy.reached_counts_next:
                self._arrived(number)

    def _do(self, flight: Flight, item: Item) -> None:
        first, second = item.params[:2]
        if item.command == SPEED:
            self._change_speed(item, first, second)
        elif item.command == WAIT and math.isfinite(first) and self._policy.home_first:
            self._wait_ns = flight.time_ns + round(min(max(first, 0.0), 1e6) * 1e9)
        elif item.command == YAW and math.isfinite(first):
            turn = math.radians(first)
            relative = item.params[3] == 1.0
            self._yaw_rad = flight.yaw_rad + math.copysign(turn, item.params[2] or 1.0) if relative else turn
        elif item.command == ROI_NONE:
            self._regard(None, flight.down_m)
        elif item.command in ROI:
            self._regard(self._place(item) if item.frame not in PLACELESS else None, self._down_m(item))
        else:
            use_payload(self._gimbal, self._camera, item)

    def _regard(self, place: Place | None, down_m: float) -> None:
        """A region of interest: the gimbal points at it, or the nose where there is no gimbal."""
        gimbal = self._gimbal
        if gimbal is None:
            self._roi = place
        elif place is None:
            gimbal.forget()
        else:
            gimbal.look_at(*place, down_m)

    def _change_speed(self, item: Item, kind: float, speed: float) -> None:
        if kind in (0.0, 1.0) and math.isfinite(speed):
            self._speed_mps = min(speed, self._guidance.limits.speed_max_mps) if speed > 0.0 else None
            manoeuvre = self._guidance.manoeuvre
            self._guidance.speed_mps = self._speed_mps
            if self._speed_mps and isinstance(manoeuvre, Hold):
                manoeuvre.change_speed(self._speed_mps)
        if self._policy.tells_speed:
            one, two, three, four = item.params
            fields = {"param1": one, "param2": two, "param3": three, "param4": four}
            self._board.radio.broadcast("COMMAND_LONG", command=SPEED, target_system=1, target_component=0, **fields)

    def _arrived(self, number: int) -> None:
        items, policy = self._plan.items, self._policy
        if policy.reached_counts_next:
            if items[number].command in _PASSED:
                self._board.texts.say(6, f"Reached command #{number}")
            if number + 1 < len(items) and items[number + 1].command not in _FLOWN:
                number += 1
        self._reached = number
        self._board.radio.broadcast("MISSION_ITEM_REACHED", seq=number)
        if policy.reached_again_s:
            self._say_again_ns = self._board.flight.time_ns + round(policy.reached_again_s * 1e9)

    def _repeat(self, flight: Flight) -> None:
        again_s = self._policy.reached_again_s
        if again_s and self._reached is not None and flight.time_ns >= self._say_again_ns:
            self._say_again_ns += round(again_s * 1e9)
            self._board.radio.broadcast("MISSION_ITEM_REACHED", seq=self._reached)

    def _say(self, text: Text | None) -> None:
        if text:
            self._board.texts.say(*text)

    # What clients ask.

    def _choose(self, number: int) -> bool:
        if not self._first <= number < len(self._plan.items) and not (self._policy.home_first and number == 0):
            return False
        started = self._started
        self._forget(max(number, self._first))
        self._started = started
        return True

    def _set_current(self, m: Any, sender: Sender) -> None:
        if m.seq < len(self._plan.items) and self._choose(m.seq):
            names = ("seq", "total", "mission_state", "mission_mode", "mission_id", "fence_id", "rally_points_id")
            sender.channel.tell("MISSION_CURRENT", **dict(zip(names, self.current(), strict=True)))
        else:
            self._say(self._policy.no_such_item_text)

    def _set_current_command(self, command: Command) -> Result | None:
        number, again = command.params[:2]
        if again == 1.0:
            self._jumps.clear()
        if number == -1.0:
            return Result.ACCEPTED
        known = math.isfinite(number) and 0.0 <= number < len(self._plan.items) and self._choose(int(number))
        return Result.ACCEPTED if known else Result.DENIED

    def _start(self, command: Command) -> Result | None:
        flight, policy = self._board.flight, self._policy
        if not flight.mission_ready and not (policy.starts_anywhere and not flight.armed):
            self._say(policy.start_text)
            mode = self._board.personality.mode(policy.mode)
            if policy.start_text is None:
                self._modes.ask(mode.custom)  # says why not
                return Result.FAILED
            return Result.DENIED
        first = command.params[0]
        if math.isfinite(first) and first > 0.0 and not policy.home_first:
            self._choose(int(min(first, 65535.0)))
        self._modes.switch(self._board.personality.mode(policy.mode))
        if policy.arms_at_start and not flight.armed and not self._arm():
            return Result.TEMPORARILY_REJECTED
        if flight.armed:
            self._cleared, self._leg = True, None
        return Result.ACCEPTED

    def _land_start(self, command: Command) -> Result | None:
        marks = [number for number, item in enumerate(self._plan.items) if item.command == LANDING_BEGINS]
        if not marks or not self._board.flight.mission_ready:
            for text in self._policy.no_landing_texts:
                self._board.texts.say(*text)
            return Result.FAILED if self._policy.home_first else Result.CANCELLED
        self._choose(marks[0])
        self._modes.switch(self._board.personality.mode(self._policy.mode))
        return Result.ACCEPTED


class _Then:
    """A leg, and behind it something else than the next item."""

    def __init__(self, leg: Climb, then: Callable[[], None]) -> None:
        self.manoeuvre = leg.manoeuvre
        self._leg, self._then = leg, then

    def over(self, flight: Flight) -> bool:
        if self._leg.over(flight):
            self._then()
        return False
