"""Which target to turn to next, and whether there is time for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from bench.contracts import IntelligenceDocument, MissionOrder

from ..flight._limits import DESCENT_MPS, landing_s
from ..flight._paths import Place

if TYPE_CHECKING:
    from ._convoy import Convoy

# What slowing down and turning costs at the end of a leg, on the safe side. Chosen, not measured.
TURN_S = 3.0
# PX4's MPC_ACC_HOR. In 24 flights of campaign standard, turning for home took what it predicts and at most 2 s more where
# nothing stood in the way.
ACCELERATION_MPS2 = 3.0

# How long intelligence about what was seen during the flight stays good: a vehicle that stands still now will not stand
# there for long. Chosen, not measured.
FRESH_S = 120.0

State = Literal[
    "waiting", "active", "found", "reported", "not_found", "skipped"
]  # found: to be reported when that is allowed


@dataclass(slots=True)
class SearchTask:
    """One intelligence report and what became of it."""

    intelligence: IntelligenceDocument
    told_s: float = 0.0
    state: State = "waiting"
    due_s: float = math.inf  # when the escorted convoy comes by
    ordered: int = 0  # the later it was ordered to be next, the higher
    target: int | None = None  # number of the track that was reported
    withheld: bool = False  # reported, but not marked
    revisited: bool = False
    passes: int = 0
    enough: bool = False  # found, and left before all of it was searched
    dismissed: set[int] = field(default_factory=set)

    @property
    def id(self) -> str:
        return self.intelligence.id

    @property
    def place(self) -> Place:
        return self.intelligence.east_m, self.intelligence.north_m

    @property
    def active(self) -> bool:
        return self.state == "active"

    def due_s_after(self, deadline_s: float | None) -> float:
        """When its target should be known: by the deadline for reports, counted from when it was told, and what was seen
        during the flight while that is fresh.
        """
        fresh_s = FRESH_S if self.intelligence.observed_s > 0.0 else math.inf
        return self.told_s + min(fresh_s, deadline_s or math.inf)

    @property
    def urgency(self) -> tuple[int, float, int]:
        """The smaller, the more urgent: the operator's order, then when a convoy comes by, then priority."""
        return -self.ordered, self.due_s, self.intelligence.priority


class Planner:
    """Keeps the tasks in order of urgency, and the time that the way home needs."""

    descent_mps = DESCENT_MPS
    acceleration_mps2 = ACCELERATION_MPS2

    def __init__(
        self,
        order: MissionOrder,
        speed_mps: float,
        height_m: float,
        safe_height_m: float,
        reserve_s: float,
        way_m: Callable[[Place, Place], float] = math.dist,
        sinks_on_the_way: Callable[[Place], bool] = lambda place: True,
    ) -> None:
        """`sinks_on_the_way`: whether it comes down while it flies home from a place, and not only over home."""
        self.tasks: dict[str, SearchTask] = {}
        self.convoy: Convoy | None = None
        if order.escort is not None:
            # Imported here: a mission without an escort is flown without NumPy.
            from ._convoy import Convoy

            self.convoy = Convoy(order.escort, order.time_limit_s)
        self._home = (order.home.east_m, order.home.north_m)
        self._limit_s = order.time_limit_s
        self._returns = order.return_home
        self._speed_mps = speed_mps
        self._height_m = height_m
        self._safe_height_m = safe_height_m
        self._reserve_s = reserve_s
        self._way_m = way_m
        self._sinks_on_the_way = sinks_on_the_way

    def add(self, intelligence: IntelligenceDocument, now_s: float = 0.0) -> SearchTask | None:
        """The new task, or None when this report is known already."""
        if intelligence.id in self.tasks:
            return None
        task = self.tasks[intelligence.id] = SearchTask(intelligence, now_s)
        if self.convoy is not None:
            task.due_s = self.convoy.near_s(task.place, now_s)
        return task

    def put_first(self, task: SearchTask) -> None:
        """Ordered by the operator: next, before anything else, from the beginning where it was given up."""
        if task.state in ("not_found", "skipped"):
            task.passes = 0
            task.dismissed.clear()
        task.ordered = 1 + max(other.ordered for other in self.tasks.values())
        if task.state != "active":
            task.state = "waiting"

    def travel_s(self, distance_m: float) -> float:
        """Time to fly a distance and slow down at its end."""
        return distance_m / self._speed_mps + TURN_S

    def home_s(self, place: Place) -> float:
        """Time from a place, at mission height, to disarmed on the ground."""
        away_s = self.travel_s(self._way_m(place, self._home)) if self._returns else 0.0
        down_s = max(0.0, self._height_m - self._safe_height_m) / self.descent_mps
        to_safe_s = max(away_s, down_s) if self._sinks_on_the_way(place) else away_s + down_s
        return to_safe_s + landing_s(self._safe_height_m)

    def turn_s(self, place: Place, velocity_en_mps: Place) -> float:
        """Time that it loses until it flies home from a place as fast as it may, because of how it flies now."""
        away_m = math.dist(place, self._home)
        if not self._returns or away_m < 1.0:
            return 0.0
        toward = (self._home[0] - place[0]) / away_m, (self._home[1] - place[1]) / away_m
        toward_mps = toward[0] * velocity_en_mps[0] + toward[1] * velocity_en_mps[1]
        missing_mps = max(0.0, self._speed_mps - toward_mps)
        return missing_mps**2 / (2.0 * self.acceleration_mps2 * self._speed_mps)

    def must_turn_back(self, place: Place, now_s: float, velocity_en_mps: Place = (0.0, 0.0)) -> bool:
        """Whether the way home takes all the time that is left."""
        home_s = self.turn_s(place, velocity_en_mps) + self.home_s(place)
        return now_s + home_s + self._reserve_s >= self._limit_s

    def fits(self, place: Place, now_s: float, task: SearchTask, work_s: float) -> bool:
        """Whether there is time to fly to a task, work there for a while, and come home."""
        there_s = self.travel_s(self._way_m(place, task.place))
        return now_s + there_s + work_s + self.home_s(task.place) + self._reserve_s < self._limit_s

    def by_urgency(self, tasks: Iterable[SearchTask], place: Place) -> list[SearchTask]:
        """Most urgent first; among equals the nearest, then by name."""
        return sorted(tasks, key=lambda task: (*task.urgency, math.dist(place, task.place), task.id))

    def waiting(self, place: Place) -> list[SearchTask]:
        """What has not been turned to yet, in order."""
        return self.by_urgency((task for task in self.tasks.values() if task.state == "waiting"), place)

    def more_urgent_than(self, task: SearchTask) -> SearchTask | None:
        """A waiting task that should not wait for this one."""
        return next((other for other in self.waiting(task.place) if other.urgency < task.urgency), None)
