"""The mission as it is stored: which of its items are flown, where they are, and where it goes on behind each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ..guidance._fence_boundary import FenceBoundary
from ..guidance._waypoints import Following
from ..links._enums import MAV_CMD
from ..policies._missions import MissionPolicy
from ..state._flight_limits import FlightLimits
from ..state._flight_state import NorthEast
from ..state._plan_store import ABOVE_SEA, PLACELESS, MissionItem, StoredPlans
from ..state._service_context import ServiceContext

TAKEOFFS = (MAV_CMD.NAV_TAKEOFF, MAV_CMD.NAV_VTOL_TAKEOFF)
LANDINGS = (MAV_CMD.NAV_LAND, MAV_CMD.NAV_VTOL_LAND)
PASSED = frozenset({MAV_CMD.NAV_WAYPOINT, MAV_CMD.NAV_SPLINE_WAYPOINT})
FLOWN = PASSED | {
    *TAKEOFFS,
    *LANDINGS,
    MAV_CMD.NAV_LOITER_UNLIM,
    MAV_CMD.NAV_LOITER_TURNS,
    MAV_CMD.NAV_LOITER_TIME,
    MAV_CMD.NAV_RETURN_TO_LAUNCH,
    MAV_CMD.NAV_LOITER_TO_ALT,
    MAV_CMD.NAV_DELAY,
}
JUMPS = (MAV_CMD.DO_JUMP, MAV_CMD.DO_JUMP_TAG)
# Items towards which the vehicle need not brake.
_WITH_COURSE = (*PASSED, MAV_CMD.NAV_LOITER_TIME, MAV_CMD.NAV_LOITER_UNLIM)
# In a row: a ring of jumps without anything to fly ends the mission.
_MAX_JUMPS = 100
# DO and CONDITION items between two items to fly.
_MAX_ACTIONS = 1000
# Of an item from the origin.
_MAX_DISTANCE_M = 500_000.0
# Items between a waypoint and the next place to fly to.
_MAX_LOOK_AHEAD = 8


@dataclass(eq=False)
class MissionPlan:
    """The items of the mission. `jumps` counts how often each jump was taken."""

    _context: ServiceContext
    _policy: MissionPolicy
    _fence: FenceBoundary
    stored: StoredPlans
    jumps: dict[int, int] = field(default_factory=dict)

    @property
    def items(self) -> tuple[MissionItem, ...]:
        return self.stored.mission.items

    @property
    def first(self) -> int:
        """The item with which the mission begins."""
        return 1 if self._policy.home_first and len(self.items) > 1 else 0

    def item(self, index: int) -> MissionItem | None:
        return self.items[index] if index < len(self.items) else None

    def place(self, item: MissionItem) -> NorthEast | None:
        degrees = item.place_deg
        if degrees is None or (self._policy.home_first and degrees == (0.0, 0.0)):
            return None
        return self._context.frame.to_local_m(*degrees)

    def down_m(self, item: MissionItem) -> float:
        """The height of an item; where it has none, the vehicle's."""
        flight = self._context.flight
        home_m = flight.home.altitude_m if flight.home else flight.origin.altitude_m
        altitude = item.z if item.frame in ABOVE_SEA else item.z + home_m
        if not math.isfinite(altitude):
            return flight.down_m
        return flight.origin.altitude_m - min(max(altitude, -1e4), 1e5)

    def judge(self) -> bool:
        """Set whether the mission can be flown at all; returns whether an item is too far away for that."""
        ready, far = len(self.items) > self.first, False
        for number, item in enumerate(self.items[self.first :], self.first):
            if item.command not in FLOWN or item.frame in PLACELESS:
                continue
            place = None if item.nowhere else self.place(item)
            if item.nowhere or (place and math.hypot(*place) > _MAX_DISTANCE_M):
                ready, far = False, True
            elif place and not self._may_fly_to(place, item):
                self._context.texts.report(self._policy.outside_fence_text, number + 1)
                ready = False
                break
        self._context.flight.mission_ready = ready
        return far

    def _may_fly_to(self, place: NorthEast, item: MissionItem) -> bool:
        return self._policy.outside_fence_text is None or self._fence.allows(*place, self.down_m(item))

    def next_flown(self, index: int) -> tuple[int | None, list[tuple[int, MissionItem]]]:
        """The next item from `index` on that is flown, None at the end of the mission; and the actions on the way."""
        actions: list[tuple[int, MissionItem]] = []
        jumps = 0
        while (item := self.item(index)) and item.command not in FLOWN:
            if item.command in JUMPS:
                goal = self._due_jump(index, item)
                if goal is not None:
                    self.jumps[index] = self.jumps.get(index, 0) + 1
                index = index + 1 if goal is None else goal
                jumps += 1
            else:
                actions.append((index, item))
                index += 1
            if jumps > _MAX_JUMPS or len(actions) > _MAX_ACTIONS:
                return None, actions[:_MAX_ACTIONS]
        return (index if item else None), actions

    def following(self, index: int, speed_mps: float | None, limits: FlightLimits) -> Following | None:
        """The place behind a waypoint that is only passed; None where the vehicle stops."""
        for _ in range(_MAX_LOOK_AHEAD):
            index += 1
            item = self.item(index)
            if item is None:
                return None
            if item.command in FLOWN:
                place = self.place(item) if item.command in _WITH_COURSE else None
                return Following(place, self.down_m(item), speed_mps) if place else None
            if item.command == MAV_CMD.DO_CHANGE_SPEED and is_ground_speed(*item.params[:2]):
                speed_mps = speed_of(item.params[1], limits)
            goal = self._due_jump(index, item) if item.command in JUMPS else None
            if goal is not None:
                index = goal - 1
        return None

    def _due_jump(self, index: int, item: MissionItem) -> int | None:
        """Where a jump leads; None where it leads nowhere, or was taken as often as it asks for."""
        goal, times = item.params[:2]
        if item.command == MAV_CMD.DO_JUMP_TAG:
            tags = (
                number
                for number, mark in enumerate(self.items)
                if mark.command == MAV_CMD.JUMP_TAG and mark.params[0] == item.params[0]
            )
            goal = next(tags, math.nan)
        leads = math.isfinite(goal) and self.first <= goal < len(self.items)
        due = leads and math.isfinite(times) and (times < 0 or self.jumps.get(index, 0) < times)
        return int(goal) if due else None


def speed_of(speed: float, limits: FlightLimits) -> float | None:
    """The speed that DO_CHANGE_SPEED asks for; None for the parameters' speed."""
    return min(speed, limits.speed_max_mps) if speed > 0.0 else None


def is_ground_speed(kind: float, speed: float) -> bool:
    """Whether DO_CHANGE_SPEED means the speed over ground (PX4 and ArduCopter take airspeed for the same)."""
    return kind in (0.0, 1.0) and math.isfinite(speed)
