"""Flying for a task: along the legs of a search, round what may be its target, and back to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from .._log import Log
from .._settings import Settings
from .._steps import Steps
from ..flight._paths import Place, bearing_rad, lawnmower, length_m, ring
from ..flight._pilot import Pilot, never
from ..flight._piloted_vehicle import PilotedVehicle
from ..perception._perception import ObjectPerception
from ..perception._tracks import Track
from ._findings import Findings
from ._planner import Planner, SearchTask

# The least time for which a sub-area is worth flying to. Chosen, not measured.
SEARCH_S = 15.0
# A person who crosses is not gone yet. Chosen, not measured.
STILL_CLEAR_S = 4.0


class SearchFlight:
    """What is flown for one task. Pilot, planner and findings are there once the mission order has come."""

    _pilot: Pilot
    _planner: Planner
    _findings: Findings

    def __init__(self, vehicle: PilotedVehicle, eyes: ObjectPerception, log: Log, settings: Settings) -> None:
        self._vehicle = vehicle
        self._eyes = eyes
        self._log = log
        self._settings = settings

    # Where it is, and along a path.

    @property
    def _place(self) -> Place:
        return self._pilot.place

    @property
    def _home(self) -> Place:
        return self._pilot.home

    def _follow(
        self,
        path: Sequence[Place],
        task: SearchTask,
        speed_mps: float,
        *,
        facing: Track | None = None,
        until: Callable[[], bool] = never,
        looking: bool = False,
    ) -> Steps[bool]:
        """Fly along a path for a task; False when a more urgent one came up. Raises TurnBack and Ordered."""
        leave = lambda: self._diverted(task)  # noqa: E731
        return self._pilot.follow(path, speed_mps, facing=facing, until=until, leave=leave, looking=looking)

    def _diverted(self, task: SearchTask) -> bool:
        urgent = self._planner.more_urgent_than(task)
        if urgent is None or not (task.active or urgent.ordered > task.ordered):
            return False
        if task.active:
            task.state = "waiting"
        why = "ordered to be next" if urgent.ordered > task.ordered else "more urgent"
        self._log.decide("divert", task.id, f"{urgent.id} is {why}")
        return True

    def _late_work(self, task: SearchTask) -> bool:
        """Whether something waits that can be served and is not ordered to come after a task."""
        place, now_s = self._place, self._vehicle.now_s
        return any(
            other.ordered >= task.ordered and self._planner.fits(place, now_s, other, SEARCH_S)
            for other in self._planner.waiting(place)
        )

    # The search.

    def _search_path(self, task: SearchTask) -> list[Place]:
        """Legs along the way in on the first pass, across it on the second: other views of that ground."""
        heading_rad = (
            bearing_rad(self._place, task.place) if math.dist(self._place, task.place) > 1.0 else 0.0
        )
        return self._legs(
            task.place, task.intelligence.uncertainty_m, heading_rad + task.passes % 2 * math.pi / 2.0
        )

    def _legs(self, center: Place, radius_m: float, heading_rad: float) -> list[Place]:
        camera, height_m = self._eyes.camera, self._pilot.height_m
        near_m, middle_m, _ = camera.ahead_m(height_m) if camera else (0.0, 0.0, 0.0)
        spacing_m = (camera.swath_m(height_m) if camera else height_m) * (1.0 - self._settings.overlap)
        return lawnmower(center, radius_m, max(spacing_m, 5.0), heading_rad, near_m, middle_m)

    # Round a target.

    def _identify(self, task: SearchTask) -> Steps[None]:
        """Look at every candidate from all sides until one is identified."""
        while candidate := self._findings.candidate(task):
            missing = self._findings.missing(candidate, task)
            self._log.decide("inspect", task.id, missing or self._findings.verdict(task))
            self._log.enter("inspecting", f"{task.id}: {candidate.id}")
            yield from self._circle(candidate, task)
            if not task.active:
                return
            if not self._findings.missing(candidate, task):
                yield from self._look_round(candidate, task)
                return
            task.dismissed.add(candidate.number)
            self._log.decide("dismiss", task.id, f"{candidate.id}: {self._findings.missing(candidate, task)}")

    def _circle(self, target: Track, task: SearchTask) -> Steps[None]:
        """Fly round a target, looking at it, until the task is settled or the round is complete."""
        path, speed_mps = self._ring_round(target), self._pilot.speed_mps
        settled = lambda: not task.active  # noqa: E731
        if (yield from self._follow([self._place, path[0]], task, speed_mps, facing=target, until=settled)):
            slow_mps = self._settings.inspect_speed_mps
            yield from self._follow(path, task, slow_mps, facing=target, until=settled, looking=True)

    def _look_round(self, target: Track, task: SearchTask) -> Steps[None]:
        """See enough of a target's surroundings to decide; what one sweep does not show stays unseen."""
        if self._findings.judge(target).look:
            round_m = self._findings.policy.surroundings_m
            path = self._legs(target.place, round_m, bearing_rad(self._place, task.place))
            self._log.decide("look_round", task.id, f"sweep of {round_m:g} m, {length_m(path):.0f} m")
            done = lambda: not task.active  # noqa: E731
            yield from self._follow(
                [self._place, *path], task, self._pilot.speed_mps, until=done, looking=True
            )
        if task.active:
            self._findings.settle(task, target, self._findings.judge(target))

    def _ring_round(self, target: Track) -> list[Place]:
        """Once round a target, from where it is."""
        return ring(target.place, self._ring_radius_m(), bearing_rad(target.place, self._place))

    def _ring_radius_m(self) -> float:
        """Where the middle of the image lies on a target in the centre."""
        camera, height_m = self._eyes.camera, self._pilot.height_m
        middle_m = camera.ahead_m(height_m)[1] if camera else height_m
        return min(max(middle_m, 0.3 * height_m), 2.0 * height_m)

    # Again.

    def _choose_withheld(self) -> SearchTask | None:
        convoy, now_s = self._planner.convoy, self._vehicle.now_s
        # A second look at who stands about can wait; the convoy does not.
        if self._findings.reports.closed(now_s) or (convoy is not None and convoy.calls(now_s)):
            return None
        tasks = (
            task
            for task in self._planner.tasks.values()
            if task.withheld and not task.revisited and not self._findings.consents.hopeless(task)
        )
        round_s = 2.0 * math.pi * self._ring_radius_m() / self._settings.inspect_speed_mps
        for task in self._planner.by_urgency(tasks, self._place):
            if self._planner.fits(self._place, self._vehicle.now_s, task, round_s):
                return task
        return None

    def _revisit(self, task: SearchTask) -> Steps[None]:
        """Once more to a target whose mark was withheld: the bystanders may have gone."""
        waits = self._findings.consents.awaited(task)
        # While the operator decides it may come back: the wait is bounded by CONSENT_WAIT_S.
        task.revisited = not waits
        target = next((track for track in self._eyes.tracks if track.number == task.target), None)
        if target is None:
            task.revisited = True
            return
        purpose = "until the operator answers" if waits else "to see whether the bystanders have gone"
        self._log.decide("revisit", task.id, f"time is left {purpose}")
        self._log.enter("inspecting", f"{task.id}: again")
        path = self._ring_round(target)
        late = lambda: self._late_work(task)  # noqa: E731
        yield from self._follow(
            [self._place, path[0]], task, self._pilot.speed_mps, facing=target, until=late
        )
        clear = _Stopwatch(
            lambda: self._findings.judge(target).mark and not self._findings.consents.against_marking(task)
        )
        yield from self._follow(
            path,
            task,
            self._settings.inspect_speed_mps,
            facing=target,
            until=lambda: (
                clear.runs_s(self._vehicle.now_s) > STILL_CLEAR_S
                or self._late_work(task)
                or not task.withheld
                or self._findings.consents.hopeless(task)
            ),
            looking=True,
        )
        judgement = self._findings.judge(target)
        if judgement.mark and clear.runs_s(self._vehicle.now_s) > STILL_CLEAR_S:
            self._findings.settle(task, target, judgement, why="seen again")
        elif task.withheld and self._late_work(task):
            task.revisited = False
            self._log.decide(
                "move_on", task.id, "newer intelligence goes first; it comes back if time is left"
            )
        elif task.withheld:
            against = self._findings.consents.against_marking(task)
            self._log.decide("withhold_mark", task.id, f"still: {against or judgement.reason}")


class _Stopwatch:
    """For how long a condition has held without a break."""

    def __init__(self, condition: Callable[[], bool]) -> None:
        self._condition = condition
        self._since_s: float | None = None

    def runs_s(self, now_s: float) -> float:
        """Seconds; 0 when it does not hold now."""
        if not self._condition():
            self._since_s = None
            return 0.0
        self._since_s = now_s if self._since_s is None else self._since_s
        return now_s - self._since_s
