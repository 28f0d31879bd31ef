"""When a mission reaches what it is sent to, by an agent that flies as ordered and loses no time.

The numbers of flight are those of the shipped quadrotor under PX4: what counts is how situations compare.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import shapely

from bench.simspec import ENDING_ORDERS, PAUSES, SimSpec

CLIMB_MPS = 3.0  # PX4's MPC_Z_VEL_MAX_UP
DESCENT_MPS = 1.5  # PX4's MPC_Z_VEL_MAX_DN
LEG_OVERLAP = 0.3  # of the camera's ground width, as the reference agents search
INSPECTION_S = 12.0  # a look at a found target from several sides; chosen
CLOSED_MARGIN_M = 25.0  # round no-fly areas, as the reference agents fly
HOVER_W = 178.0  # docs/vehicle.md

Place = tuple[float, float]
"""East and north in metres."""


@dataclass(frozen=True, slots=True)
class Stop:
    """One reported sub-area: the report, its group, its centre, when it is delivered, when it is searched."""

    report: str
    about: str
    priority: int
    place: Place
    delivered_s: float
    searched_s: float


@dataclass(frozen=True)
class Course:
    """The way through a realized situation."""

    simspec: SimSpec

    @cached_property
    def speed_mps(self) -> float:
        return min(self.simspec.mission.speed_mps, self.simspec.rules.max_speed_mps or math.inf)

    @cached_property
    def slant_m(self) -> float:
        """Distance along the camera's axis to the ground, from the ordered height."""
        # A camera that looks at the horizon has no such place; 20 degrees is the lowest view that serves a search.
        tilt_rad = math.radians(max(20.0, self.simspec.vehicle.camera.tilt_deg))
        return self.simspec.mission.altitude_m / math.sin(tilt_rad)

    @cached_property
    def stops(self) -> tuple[Stop, ...]:
        """The sub-areas in the order of urgency and then of nearness, as each is delivered."""
        realized = self.simspec.realized
        assert realized is not None  # features_of
        places = {report.id: (report.east_m, report.north_m) for report in realized.reports}
        open_reports = [report for report in self.simspec.intelligence if report.id in places]
        now_s, here, stops = self.simspec.mission.altitude_m / CLIMB_MPS, self._home, list[Stop]()
        while open_reports:
            now_s = max(now_s, min(report.delivered_s for report in open_reports))
            delivered = [report for report in open_reports if report.delivered_s <= now_s]
            report = min(delivered, key=lambda report: (report.priority, math.dist(here, places[report.id])))
            open_reports.remove(report)
            now_s = self._after_pauses(now_s, now_s + self._leg_s(here, places[report.id]))
            now_s = self._after_pauses(now_s, now_s + self._search_s(report.uncertainty_m) + INSPECTION_S)
            here = places[report.id]
            stops.append(Stop(report.id, report.about, report.priority, here, report.delivered_s, now_s))
        return tuple(stops)

    @cached_property
    def searched_s(self) -> float:
        """When the last sub-area is searched."""
        return max(
            (stop.searched_s for stop in self.stops), default=self.simspec.mission.altitude_m / CLIMB_MPS
        )

    @cached_property
    def home_s(self) -> float:
        """When the vehicle is down at home again."""
        last = self.stops[-1].place if self.stops else self._home
        descent_s = self.simspec.mission.altitude_m / DESCENT_MPS
        return self.searched_s + self._leg_s(last, self._home) + descent_s

    @cached_property
    def called_home_s(self) -> float:
        """When an order ends the search; infinite without one."""
        return min(
            (order.at_s for order in self.simspec.orders if order.kind in ENDING_ORDERS), default=math.inf
        )

    @cached_property
    def legs_across_closed(self) -> float:
        """Share of the straight legs between home and sub-areas that cross a no-fly area."""
        places = [self._home, *(stop.place for stop in self.stops), self._home]
        legs = [shapely.LineString(leg) for leg in pairwise(places)]
        return sum(any(area.intersects(leg) for area in self._closed) for leg in legs) / len(legs)

    @cached_property
    def charge_need(self) -> float:
        """Share of the battery that hovering takes until the vehicle is home."""
        return HOVER_W * self.home_s / 3600.0 / self.simspec.vehicle.battery.capacity_wh

    def share_of_work(self, spans: Iterable[tuple[float, float]]) -> float:
        """Share of the time from take-off to the end of the search that spans of time cover."""
        end_s = min(self.searched_s, self.simspec.mission.time_limit_s, self.called_home_s)
        covered_s = sum(max(0.0, min(until_s, end_s) - from_s) for from_s, until_s in spans)
        return min(1.0, covered_s / max(end_s, 1.0))

    @property
    def _home(self) -> Place:
        return self.simspec.vehicle.home.east_m, self.simspec.vehicle.home.north_m

    @cached_property
    def _closed(self) -> list[shapely.Geometry]:
        return [
            shapely.make_valid(shapely.Polygon([(c.east_m, c.north_m) for c in no_fly.area.corners]))
            for no_fly in self.simspec.rules.no_fly
        ]

    def _leg_s(self, start: Place, end: Place) -> float:
        """Time from place to place, round what is closed: half of the hull of the area and the leg."""
        length_m = math.dist(start, end)
        leg = shapely.LineString([start, end])
        for area in self._closed:
            if length_m > 0.0 and area.intersects(leg):
                hull = shapely.convex_hull(shapely.union(area.buffer(CLOSED_MARGIN_M), leg))
                length_m = max(length_m, hull.length / 2.0)
        return length_m / self.speed_mps

    def _search_s(self, radius_m: float) -> float:
        """A lawnmower over the reported circle, at the ordered height."""
        width_m = (
            2.0 * self.slant_m * math.tan(math.radians(self.simspec.vehicle.camera.horizontal_fov_deg) / 2.0)
        )
        spacing_m = width_m * (1.0 - LEG_OVERLAP)
        return max(2.0 * radius_m, math.pi * radius_m**2 / spacing_m) / self.speed_mps

    def _after_pauses(self, from_s: float, until_s: float) -> float:
        """When work that would end at `until_s` ends, with the pauses that the operator orders meanwhile."""
        orders = sorted(self.simspec.orders, key=lambda order: order.at_s)
        for order in orders:
            if order.kind in PAUSES and from_s <= order.at_s < until_s:
                ends_s = [
                    later.at_s
                    for later in orders
                    if later.kind == PAUSES[order.kind] and later.at_s > order.at_s
                ]
                until_s += min(ends_s, default=self.simspec.mission.time_limit_s) - order.at_s
        return until_s
