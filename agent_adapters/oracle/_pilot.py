"""Flying where it is known how people will walk."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields

import numpy as np

from ..reference._steps import Steps
from ..reference.flight._caution import Caution
from ..reference.flight._paths import Place, ring
from ..reference.flight._pilot import Pilot, never
from ..reference.flight._vehicle import PositionSetpoint
from ._caution import OracleCaution
from ._truth import Truth

# Only on the way home: a failsafe that lands would otherwise sink as fast while it waits for GPS.
_DESCENT_MPS = {"MPC_Z_VEL_MAX_DN": 3.0, "MPC_Z_V_AUTO_DN": 3.0}
# Where to stand: how far ahead it comes to a stop, which places round that are tried, how long it may fly there, and
# for how long people are looked ahead. The measures call a stay one within 15 m. All chosen, not measured.
STOP_S, STAND_RINGS_M, STAND_BY_S, STAND_AHEAD_S, STAY_M = 1.0, (6.0, 12.0, 18.0), 3.0, 45, 17.0
# How near to home a person is in the way, nobody of the first coming before few of the second, and how long taking off
# and coming down take there. Chosen after the measures, which ask for 10 m, and campaign full, which asks for 25 m.
PEOPLE_NEAR_M, CLIMB_S, DESCENT_S = (12.0, 25.0), 10.0, 30.0
# From here, where nobody near home matters yet, it goes on when the way down is clearest, after at most so long where it
# stands near nobody.
HOME_APPROACH_M, HOME_WAIT_S = 45.0, 40.0
# Of the time limit: later than this, waiting costs more than it is worth. Chosen, not measured.
LATEST_SHARE = 0.85


class OraclePilot(Pilot):
    """Does not wait for what it knows: places without GPS, for as long as the autopilot follows."""

    def knowing(self, truth: Truth, people: list[int]) -> OraclePilot:
        """With the truth about where people will be; `people` are their rows in the cast."""
        self._truth, self._people_rows = truth, people
        rules = Caution.of(self._order)
        self._caution = OracleCaution(**{field.name: getattr(rules, field.name) for field in fields(rules)})
        return self

    def go_home(self, reason: str, unless: Callable[[], bool] = never) -> Steps[bool]:
        if not self._vehicle.silent:
            for name, speed_mps in _DESCENT_MPS.items():
                yield from self._vehicle.set_parameter(name, speed_mps)
        if self._order.return_home and math.dist(self.place, self.home) > HOME_APPROACH_M:
            self._log.enter("returning", reason)
            arrived = lambda: math.dist(self.place, self.home) < HOME_APPROACH_M  # noqa: E731
            way = [self.place, self.home]
            if not (
                yield from self.follow(way, self.speed_mps, until=arrived, leave=unless, home_bound=True)
            ):
                return False
            yield from self._wait_for_people_at_home(unless)
        return (yield from super().go_home(reason, unless))

    def _wait_for_people_at_home(self, unless: Callable[[], bool]) -> Steps[None]:
        """Hover where nobody is until the way down is as clear as it gets soon."""
        away_s, now_s = HOME_APPROACH_M / self.speed_mps, self._vehicle.now_s
        spare_s = LATEST_SHARE * self._order.time_limit_s - now_s
        place = self._stand_place() or self.place
        wait_s = min(spare_s, HOME_WAIT_S)
        if wait_s < 1.0:
            return
        leave_s = (
            clearest_s(self._truth, self._people_rows, self.home, now_s + away_s, DESCENT_S, wait_s) - away_s
        )
        yaw_rad = self.pose.yaw_rad
        while self._vehicle.now_s < leave_s and not unless() and not self.homeward():
            self._vehicle.setpoint = PositionSetpoint(*place, self.height_m, yaw_rad)
            yield from self.keep_control(home_bound=True)
            yield

    def _stand(self, cause: str, why: str, *, looking: bool, home_bound: bool) -> Steps[None]:
        """Beside people rather than over them: it knows who comes by while it stands."""
        place, begun_s, yaw_rad = self._stand_place(), self._vehicle.now_s, self.pose.yaw_rad
        while (
            place is not None
            and self._vehicle.now_s - begun_s < STAND_BY_S
            and math.dist(self.place, place) > 2.0
        ):
            self._vehicle.setpoint = PositionSetpoint(*place, self.height_m, yaw_rad)
            yield
            yield from self._control.check()
        yield from super()._stand(cause, why, looking=looking, home_bound=home_bound)

    def _stand_place(self) -> Place | None:
        """The place near where it would stop with the shortest stay near anybody; None where any place will do."""
        if self._caution.max_loiter_s is None or not self._people_rows:
            return None
        velocity = self._vehicle.poses.velocity_en_mps
        stop = self.place[0] + STOP_S * velocity[0], self.place[1] + STOP_S * velocity[1]
        places = [
            stop,
            *(place for ring_m in STAND_RINGS_M for place in ring(stop, ring_m, 0.0, corners=12)[:-1]),
        ]
        stays_s = np.zeros((len(places), len(self._people_rows)))
        longest_s = np.zeros(len(places))
        for ahead_s in range(STAND_AHEAD_S):
            people = self._truth.places_m(self._vehicle.now_s + ahead_s)[self._people_rows]
            is_stay = np.linalg.norm(np.array(places)[:, None] - people[None], axis=2) <= STAY_M
            stays_s = np.where(is_stay, stays_s + 1.0, 0.0)
            longest_s = np.maximum(longest_s, stays_s.max(axis=1))
        allowed = np.flatnonzero(longest_s < self._caution.max_loiter_s - 1.0)
        best = int(allowed[0]) if len(allowed) else int(longest_s.argmin())
        return None if best == 0 else places[best]

    def _must_stand(self, *, looking: bool, home_bound: bool) -> tuple[str, str] | None:
        # Never `looking`: it knows where everything is, so that it need not wait for a silent detector.
        must = super()._must_stand(looking=False, home_bound=home_bound)
        return None if must is not None and must[0] == "gps" else must


def clearest_s(
    truth: Truth, people: list[int], home: Place, from_s: float, span_s: float, wait_s: float
) -> float:
    """When to begin something at home that takes a while: with the fewest people near, within a wait."""

    def neighbours(begin_s: float) -> tuple[int, ...]:
        places = [truth.places_m(begin_s + s)[people] for s in range(int(span_s) + 1)]
        apart_m = np.array([np.hypot(*(place - home).T) for place in places])
        return tuple(int(np.count_nonzero(apart_m < near_m)) for near_m in PEOPLE_NEAR_M)

    return min(
        (from_s + wait for wait in range(int(wait_s) + 1)), key=lambda begin_s: (neighbours(begin_s), begin_s)
    )
