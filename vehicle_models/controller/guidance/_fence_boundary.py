"""The boundary of the fence: its areas, and which limit a place is beyond."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.polygons import is_inside

from ..._geodesy import LocalFrame
from ..links._enums import MAV_CMD
from ..policies._safety import Breach, FenceLimits, FencePolicy
from ..state._flight_state import FlightState, NorthEast
from ..state._parameter_store import ParameterStore
from ..state._plan_store import MissionItem, StoredPlan

_POLYGONS = (MAV_CMD.NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD.NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
_CIRCLES = (MAV_CMD.NAV_FENCE_CIRCLE_INCLUSION, MAV_CMD.NAV_FENCE_CIRCLE_EXCLUSION)
_INCLUSIONS = (MAV_CMD.NAV_FENCE_POLYGON_VERTEX_INCLUSION, MAV_CMD.NAV_FENCE_CIRCLE_INCLUSION)


@dataclass(frozen=True, slots=True)
class FenceArea:
    """A polygon, or a circle around its one corner; north and east metres."""

    corners: tuple[NorthEast, ...]
    radius_m: float
    inclusion: bool

    def contains(self, place: NorthEast) -> bool:
        if len(self.corners) == 1:
            return math.dist(place, self.corners[0]) <= self.radius_m
        return is_inside(place, self.corners)

    def nearest_edge(self, place: NorthEast) -> NorthEast:
        """The point of the edge that is nearest to a place."""
        if len(self.corners) == 1:
            return _nearest_on_circle(place, self.corners[0], self.radius_m)
        edges = zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True)
        return min(
            (_nearest_on_line(place, *edge) for edge in edges), key=lambda point: math.dist(point, place)
        )


def fence_areas(plan: StoredPlan, frame: LocalFrame) -> tuple[FenceArea, ...]:
    """The areas of a fence plan; an area that is incomplete or not on Earth is left out."""
    areas: list[FenceArea] = []
    index = 0
    while index < len(plan.items):
        item = plan.items[index]
        polygon = item.command in _POLYGONS
        # The number of vertices stands in each vertex, as a float that a client may set to anything.
        count = int(min(max(item.params[0], 1.0), 1e5)) if polygon and math.isfinite(item.params[0]) else 1
        places = [local_place(vertex, frame) for vertex in plan.items[index : index + count]]
        corners = tuple(place for place in places if place is not None)
        inclusion = item.command in _INCLUSIONS
        if polygon and len(corners) == count and count >= 3:
            areas.append(FenceArea(corners, 0.0, inclusion))
        elif item.command in _CIRCLES and corners and item.params[0] > 0.0:
            areas.append(FenceArea(corners, item.params[0], inclusion))
        index += count
    return tuple(areas)


def local_place(item: MissionItem, frame: LocalFrame) -> NorthEast | None:
    degrees = item.place_deg
    return frame.to_local_m(*degrees) if degrees else None


@dataclass(eq=False)
class FenceBoundary:
    """The fence as plan, parameters and commands have it at present."""

    policy: FencePolicy
    _flight: FlightState
    _frame: LocalFrame
    _parameters: ParameterStore
    _plan: StoredPlan
    _areas: tuple[FenceArea, ...] = ()
    _commanded: bool | None = None  # enabled or disabled by command; None: as the parameter says

    def __post_init__(self) -> None:
        self.limits: FenceLimits = self.policy.limits(self._parameters)
        self._plan.on_change.append(self._plan_changed)
        self._parameters.on_change(self._parameters_changed)

    @property
    def enabled(self) -> bool:
        name = self.policy.enable_parameter
        if name is None:
            return self.limits.enabled
        return bool(self._parameters[name]) if self._commanded is None else self._commanded

    def enable(self, enabled: bool) -> None:
        """Enable or disable the fence until its parameter says the same."""
        self._commanded = enabled

    def allows(self, north_m: float, east_m: float, down_m: float) -> bool:
        """Whether a place of the local frame may be flown to."""
        home = self._flight.home
        height_m = (home.down_m if home else 0.0) - down_m
        return not self.enabled or self.breach((north_m, east_m), height_m, 0.0) is Breach.NONE

    def breach(self, place: NorthEast, height_m: float, margin_m: float) -> Breach:
        """Which limit a place is beyond, with the fence closer by a margin."""
        limits = self.limits
        if limits.ceiling_m is not None and height_m > limits.ceiling_m - margin_m:
            return Breach.CEILING
        if limits.radius_m is not None and self._from_home_m(place) > limits.radius_m - margin_m:
            return Breach.CIRCLE
        return Breach.NONE if not limits.polygons or self._inside_areas(place) else Breach.POLYGON

    def outside_m(self, breach: Breach, place: NorthEast, height_m: float) -> float:
        """How far a place is beyond the limit that it breaches."""
        if breach is Breach.CEILING:
            return height_m - (self.limits.ceiling_m or 0.0)
        if breach is Breach.CIRCLE and self._flight.home:
            return self._from_home_m(place) - (self.limits.radius_m or 0.0)
        violated = (area for area in self._areas if area.contains(place) is not area.inclusion)
        return min((math.dist(area.nearest_edge(place), place) for area in violated), default=0.0)

    def nearest_edges(self, place: NorthEast) -> list[NorthEast]:
        """The nearest point of every edge, from inside."""
        home, radius_m = self._flight.home, self.limits.radius_m
        edges = [area.nearest_edge(place) for area in self._areas] if self.limits.polygons else []
        if radius_m is not None and home:
            edges.append(_nearest_on_circle(place, (home.north_m, home.east_m), radius_m))
        return edges

    def _from_home_m(self, place: NorthEast) -> float:
        home = self._flight.home
        return math.hypot(place[0] - home.north_m, place[1] - home.east_m) if home else 0.0

    def _inside_areas(self, place: NorthEast) -> bool:
        inclusions = [area for area in self._areas if area.inclusion]
        if any(area.contains(place) for area in self._areas if not area.inclusion):
            return False
        if not inclusions:
            return True
        enough = any if self.policy.any_inclusion else all
        return enough(area.contains(place) for area in inclusions)

    def _plan_changed(self) -> None:
        self._areas = fence_areas(self._plan, self._frame)

    def _parameters_changed(self) -> None:
        self.limits = self.policy.limits(self._parameters)
        name = self.policy.enable_parameter
        if name and self._commanded is not None and bool(self._parameters[name]) == self._commanded:
            self._commanded = None


def _nearest_on_circle(place: NorthEast, centre: NorthEast, radius_m: float) -> NorthEast:
    distance_m = math.dist(place, centre)
    share = radius_m / distance_m if distance_m > 0.0 else 0.0
    return centre[0] + share * (place[0] - centre[0]), centre[1] + share * (place[1] - centre[1])


def _nearest_on_line(place: NorthEast, begin: NorthEast, end: NorthEast) -> NorthEast:
    along = (end[0] - begin[0], end[1] - begin[1])
    length2 = along[0] ** 2 + along[1] ** 2
    share = (
        ((place[0] - begin[0]) * along[0] + (place[1] - begin[1]) * along[1]) / length2 if length2 else 0.0
    )
    share = min(max(share, 0.0), 1.0)
    return begin[0] + share * along[0], begin[1] + share * along[1]
