"""The fence: where the vehicle may be, what happens when it is elsewhere; and the places to which it may return."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from .._flight import Airframe, Flight, Home, Target
from .._service import Command, CommandHandler, Handler, Result
from .._service_context import ServiceContext
from ..missions._store import Item, Plan, Plans
from ..services._modes import Modes
from ._failsafe import Failsafe
from ._fence_policy import Breach, FenceLimits

FENCE_ENABLE = 207
INCLUSION, EXCLUSION, CIRCLE_INCLUSION, CIRCLE_EXCLUSION = 5001, 5002, 5003, 5004
_LOOKS_NS = 100_000_000  # ten looks a second are enough for what moves at 20 m/s
_SLOWS_MPS2 = 1.0  # before the ceiling and the edges
_CREEPS_MPS = 0.5  # so fast an edge is passed all the same
_BACK_M = 1.0  # so far inside a breach is over
Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Area:
    """A polygon, or a circle around its one corner; north and east metres."""

    corners: tuple[Place, ...]
    radius_m: float
    keeps_in: bool

    def contains(self, place: Place) -> bool:
        if len(self.corners) == 1:
            return math.dist(place, self.corners[0]) <= self.radius_m
        inside, (north, east) = False, place
        before = self.corners[-1]
        for corner in self.corners:
            if (corner[1] > east) != (before[1] > east):
                crossing = corner[0] + (east - corner[1]) * (before[0] - corner[0]) / (before[1] - corner[1])
                inside ^= north < crossing
            before = corner
        return inside

    def edge(self, place: Place) -> Place:
        """The point of the edge that is nearest to a place."""
        if len(self.corners) == 1:
            return _on_circle(place, self.corners[0], self.radius_m)
        edges = zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True)
        return min((_on_line(place, *edge) for edge in edges), key=lambda one: math.dist(one, place))


def areas(plan: Plan, airframe: Airframe) -> tuple[Area, ...]:
    """The areas of a fence plan; what is incomplete or not on Earth is left out."""
    found: list[Area] = []
    at = 0
    while at < len(plan.items):
        item = plan.items[at]
        polygon = item.command in (INCLUSION, EXCLUSION)
        count = int(min(max(item.params[0], 1.0), 1e5)) if polygon and math.isfinite(item.params[0]) else 1
        corners = [_local(one, airframe) for one in plan.items[at : at + count]]
        known = tuple(one for one in corners if one is not None)
        keeps_in = item.command in (INCLUSION, CIRCLE_INCLUSION)
        whole = len(known) == count
        if polygon and whole and count >= 3:
            found.append(Area(known, 0.0, keeps_in))
        elif item.command in (CIRCLE_INCLUSION, CIRCLE_EXCLUSION) and known and item.params[0] > 0.0:
            found.append(Area(known, item.params[0], keeps_in))
        at += count
    return tuple(found)


def _on_circle(place: Place, centre: Place, radius_m: float) -> Place:
    away_m = math.dist(place, centre)
    share = radius_m / away_m if away_m > 0.0 else 0.0
    return centre[0] + share * (place[0] - centre[0]), centre[1] + share * (place[1] - centre[1])


def _on_line(place: Place, begin: Place, end: Place) -> Place:
    along = (end[0] - begin[0], end[1] - begin[1])
    length = along[0] ** 2 + along[1] ** 2
    share = ((place[0] - begin[0]) * along[0] + (place[1] - begin[1]) * along[1]) / length if length else 0.0
    share = min(max(share, 0.0), 1.0)
    return begin[0] + share * along[0], begin[1] + share * along[1]


def _local(item: Item, airframe: Airframe) -> Place | None:
    degrees = item.place_deg
    return airframe.to_local_m(*degrees) if degrees else None


class Fence:
    """Watches the fence while the vehicle is armed; DO_FENCE_ENABLE where there is one. One reaction a breach."""

    def __init__(self, board: ServiceContext, modes: Modes, failsafe: Failsafe, plans: Plans) -> None:
        self._board, self._failsafe, self._plan = board, failsafe, plans.fence
        self._policy = board.personality.fence
        self._areas: tuple[Area, ...] = ()
        self._due_ns = 0
        self._limits: FenceLimits = self._policy.limits(board.parameters)
        self._enabled: bool | None = None  # as commanded; None: as the parameter says
        self._breach, self._since_ns, self._count = Breach.NONE, 0, 0
        self._acted_m: float | None = None  # so far outside when it was last acted upon; None: it is inside
        self._spared_ns = 0  # until then nobody looks
        board.allows = self.allows
        self._holds_back = False
        self._plan.on_change.append(self._plan_changed)
        modes.on_change.append(self._mode_changed)
        board.parameters.on_change(self._parameters_changed)

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {FENCE_ENABLE: self._enable} if self._policy.can_be_enabled else {}

    @property
    def on(self) -> bool:
        """Whether the fence is watched."""
        name = self._policy.enabling
        if name is None:
            return self._limits.watched
        return bool(self._board.parameters[name]) if self._enabled is None else self._enabled

    def tick(self) -> None:
        flight = self._board.flight
        if flight.time_ns < self._due_ns:
            return
        self._due_ns = flight.time_ns + _LOOKS_NS
        if not flight.armed or not flight.flying or not self.on:
            self._breach, self._acted_m, self._spared_ns = Breach.NONE, None, 0
            return
        if flight.time_ns < self._spared_ns:
            return
        here = (flight.north_m, flight.east_m)
        self._breach = self.beyond(here, flight.height_m, 0.0)
        if self._breach is not Breach.NONE:
            outside_m = self._outside_m(here, flight.height_m)
            farther = self._breach is not Breach.POLYGON and outside_m > (self._acted_m or 0.0) + self._policy.again_m
            if self._acted_m is None or farther:
                self._act(flight, outside_m)
        elif self._acted_m is not None and self.beyond(here, flight.height_m, _BACK_M) is Breach.NONE:
            self._acted_m = None
            self._failsafe.over("fence")
            if self._policy.over_text:
                self._board.texts.say(*self._policy.over_text)

    def beyond(self, place: Place, height_m: float, margin_m: float) -> Breach:
        """What of the fence a place lies beyond, were the fence nearer by a margin."""
        limits, home = self._limits, self._board.flight.home
        if limits.ceiling_m is not None and height_m > limits.ceiling_m - margin_m:
            return Breach.CEILING
        away_m = math.hypot(place[0] - home.north_m, place[1] - home.east_m) if home else 0.0
        if limits.radius_m is not None and away_m > limits.radius_m - margin_m:
            return Breach.CIRCLE
        return Breach.NONE if not limits.polygons or self._inside(place) else Breach.POLYGON

    def allows(self, north_m: float, east_m: float, down_m: float) -> bool:
        """Whether a place in the local frame may be flown to."""
        home = self._board.flight.home
        height = (home.down_m if home else 0.0) - down_m
        return not self.on or self.beyond((north_m, east_m), height, 0.0) is Breach.NONE

    def held(self, flight: Flight, target: Target) -> Target:
        """A target as it is flown near the fence, where the autopilot avoids it: slower, and not through its ceiling."""
        self._holds_back = False
        if self._limits.ceiling_margin_m is None or not self.on:
            return target
        return self._before_edges(flight, self._under_ceiling(flight, target, self._limits.ceiling_margin_m))

    def _under_ceiling(self, flight: Flight, target: Target, margin_m: float) -> Target:
        ceiling_m = self._limits.ceiling_m
        if ceiling_m is None or flight.height_m > ceiling_m:
            return target  # too late: what the breach leads to is flown
        left_m = ceiling_m - margin_m - flight.height_m
        north, east, down = target.velocity_ned_mps
        fastest = math.sqrt(2.0 * _SLOWS_MPS2 * left_m) if left_m > 0.0 else 0.0
        if target.down_m is None and -down > fastest:
            self._holds_back = True
            return replace(target, velocity_ned_mps=(north, east, -fastest))
        if target.down_m is not None and target.down_m < flight.down_m - max(left_m, 0.0):
            self._holds_back = True
            return replace(target, down_m=flight.down_m - max(left_m, 0.0))
        return target

    def _before_edges(self, flight: Flight, target: Target) -> Target:
        """Velocities alone: positions beyond are not flown to in the first place."""
        north, east, down = target.velocity_ned_mps
        if target.north_east_m is not None or self._breach is not Breach.NONE or north == east == 0.0:
            return target
        here = (flight.north_m, flight.east_m)
        for edge in self._edges(here):
            left_m = math.dist(edge, here)
            if left_m < 1e-6:
                continue
            way = ((edge[0] - here[0]) / left_m, (edge[1] - here[1]) / left_m)
            excess = north * way[0] + east * way[1] - max(math.sqrt(2.0 * _SLOWS_MPS2 * left_m), _CREEPS_MPS)
            if excess > 0.0:
                self._holds_back = True
                north, east = north - excess * way[0], east - excess * way[1]
        return replace(target, velocity_ned_mps=(north, east, down)) if self._holds_back else target

    def _edges(self, here: Place) -> list[Place]:
        """The nearest point of every edge, from inside."""
        home, radius_m = self._board.flight.home, self._limits.radius_m
        found = [one.edge(here) for one in self._areas] if self._limits.polygons else []
        if radius_m is not None and home:
            found.append(_on_circle(here, (home.north_m, home.east_m), radius_m))
        return found

    def status(self) -> tuple[Any, ...] | None:
        """Values of FENCE_STATUS in wire order; None while there is no fence."""
        if not self.on:
            return None
        kind = min(self._breach, Breach.CIRCLE)  # a polygon is a boundary as well
        return (
            self._since_ns // 1_000_000,
            self._count,
            int(self._breach is not Breach.NONE),
            int(kind),
            2 if self._holds_back else 1,
        )

    def _inside(self, place: Place) -> bool:
        inclusions = [one for one in self._areas if one.keeps_in]
        if any(one.contains(place) for one in self._areas if not one.keeps_in):
            return False
        if not inclusions:
            return True
        enough = any if self._policy.needs_one else all
        return enough(one.contains(place) for one in inclusions)

    def _outside_m(self, place: Place, height_m: float) -> float:
        """How far a place is outside what it has been found to lie beyond."""
        limits, home = self._limits, self._board.flight.home
        if self._breach is Breach.CEILING:
            return height_m - (limits.ceiling_m or 0.0)
        if self._breach is Breach.CIRCLE and home:
            return math.hypot(place[0] - home.north_m, place[1] - home.east_m) - (limits.radius_m or 0.0)
        broken = [math.dist(one.edge(place), place) for one in self._areas if one.contains(place) is not one.keeps_in]
        return min(broken, default=0.0)

    def _act(self, flight: Flight, outside_m: float) -> None:
        self._acted_m, self._since_ns, self._count = outside_m, flight.time_ns, min(self._count + 1, 65535)
        self._failsafe.react("fence", self._policy.reaction(self._breach, outside_m, self._board.parameters))

    def _mode_changed(self) -> None:
        """Whoever changes the mode during a breach is given time to bring the vehicle back."""
        if self._breach is Breach.NONE or self._policy.recovery_text is None:
            return
        self._spared_ns = self._board.flight.time_ns + round(self._policy.recovery_s * 1e9)
        self._board.texts.say(*self._policy.recovery_text)

    def _enable(self, command: Command) -> Result | None:
        if command.params[0] not in (0.0, 1.0, 2.0):
            return Result.FAILED
        if command.params[0] != 2.0:  # 2 turns the floor off, which is not watched here
            self._enabled = command.params[0] == 1.0
        return Result.ACCEPTED

    def _plan_changed(self) -> None:
        self._areas = areas(self._plan, self._board.airframe)

    def _parameters_changed(self) -> None:
        self._limits = self._policy.limits(self._board.parameters)
        name = self._policy.enabling
        if name and self._enabled is not None and bool(self._board.parameters[name]) == self._enabled:
            self._enabled = None


class Rally:
    """Where a return goes: home, or the nearest rally point where the autopilot counts them."""

    def __init__(self, board: ServiceContext, plans: Plans) -> None:
        self._board, self._plan = board, plans.rally
        self._policy = board.personality.fence
        self._points: tuple[tuple[Item, Place], ...] = ()
        self._plan.on_change.append(self._plan_changed)

    def refuge(self, flight: Flight) -> Home | None:
        """The place to return to, with home's height for its ground."""
        home, p = flight.home, self._board.parameters
        if home is None or not self._points or not self._policy.uses_rally(p):
            return home
        away = [(math.hypot(place[0] - flight.north_m, place[1] - flight.east_m), item, place) for item, place in self._points]
        nearest = min(away, key=lambda one: one[0])
        if nearest[0] > self._policy.rally_limit_m(p):
            return home
        if self._policy.home_counts(p) and math.hypot(home.north_m - flight.north_m, home.east_m - flight.east_m) <= nearest[0]:
            return home
        item, (north, east) = nearest[1:]
        return replace(home, latitude_e7=item.x, longitude_e7=item.y, north_m=north, east_m=east)

    def _plan_changed(self) -> None:
        places = [(item, _local(item, self._board.airframe)) for item in self._plan.items]
        self._points = tuple((item, place) for item, place in places if place)
