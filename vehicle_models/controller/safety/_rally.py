"""Rally points: where a return goes instead of home."""

from __future__ import annotations

import math
from dataclasses import replace

from ..._geodesy import LocalFrame
from ..guidance._fence_boundary import local_place
from ..policies._safety import FencePolicy
from ..state._flight_state import FlightState, NorthEast, ReferencePoint
from ..state._parameter_store import ParameterStore
from ..state._plan_store import MissionItem, StoredPlan


class Rally:
    """Home, or the nearest rally point where the autopilot counts them."""

    def __init__(
        self, policy: FencePolicy, frame: LocalFrame, parameters: ParameterStore, plan: StoredPlan
    ) -> None:
        self._policy = policy
        self._frame = frame
        self._parameters = parameters
        self._plan = plan
        self._points: tuple[tuple[MissionItem, NorthEast], ...] = ()
        plan.on_change.append(self._plan_changed)

    def return_point(self, flight: FlightState) -> ReferencePoint | None:
        """The place to return to, with home's height for its ground."""
        home, p = flight.home, self._parameters
        if home is None or not self._points or not self._policy.uses_rally(p):
            return home
        distances = [
            (math.hypot(place[0] - flight.north_m, place[1] - flight.east_m), item, place)
            for item, place in self._points
        ]
        distance_m, item, (north, east) = min(distances, key=lambda point: point[0])
        if distance_m > self._policy.rally_limit_m(p):
            return home
        home_m = math.hypot(home.north_m - flight.north_m, home.east_m - flight.east_m)
        # ArduPilot counts home among the rally points only where RALLY_INCL_HOME allows it.
        if self._policy.rally_includes_home(p) and home_m <= distance_m:
            return home
        return replace(home, latitude_e7=item.x, longitude_e7=item.y, north_m=north, east_m=east)

    def _plan_changed(self) -> None:
        places = [(item, local_place(item, self._frame)) for item in self._plan.items]
        self._points = tuple((item, place) for item, place in places if place)
