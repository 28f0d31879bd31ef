"""The mission as one behaviour: take off, work through the tasks in order, come home.

Reads from top to bottom.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.contracts import (
    AgentPhase,
    ConsentAnswer,
    IntelligenceDocument,
    MissionOrder,
    OrderDocument,
)
from bench.errors import LinkLost

from .._log import Log
from .._orders import Ordered, Orders, Situation
from .._settings import PolicyName, Settings
from .._steps import Steps
from .._watch import Watch
from ..flight._control import TurnBack
from ..flight._paths import length_m
from ..flight._pilot import Pilot
from ..flight._piloted_vehicle import PilotedVehicle, PositionSetpoint
from ..perception._perception import ObjectPerception
from ..perception._tracks import Track
from ._findings import Findings
from ._planner import SearchTask
from ._policy import policy_named
from ._search_flight import SEARCH_S, SearchFlight

# The mission order is latched: without one by then none will come. Chosen, not measured.
ORDER_BY_S = 20.0
# From arming to being on the way; flights take 8.5 s. Chosen, not measured.
TAKEOFF_S = 10.0
# Before what waits cannot be served any more, a sub-area whose target is found is left. Chosen, not measured.
HURRY_S = 30.0
# So often it looks where the convoy is now; in this time the convoy drives some metres. Chosen, not measured.
STATION_S = 2.0
# Before the time limit the agent stops waiting on the ground for leave to report. Chosen, not measured.
LAST_WORD_S = 3.0


class MissionOrderMissing(LinkLost):
    """No mission order came; the agent cannot know what to do."""


class SearchMission(SearchFlight):
    """Decides and flies.

    `fly` is the behaviour; `tell` and `order` bring in what the bench says meanwhile.
    """

    def __init__(
        self,
        vehicle: PilotedVehicle,
        eyes: ObjectPerception,
        log: Log,
        watch: Watch,
        policy: PolicyName,
        settings: Settings,
    ) -> None:
        super().__init__(vehicle, eyes, log, settings)
        self.over = False
        self._watch = watch
        self._policy_name: PolicyName = policy
        self._order: MissionOrder | None = None
        self._orders = Orders()
        self._shared = eyes, log, watch, self._orders, settings  # between this, the pilot and the findings
        self._early: list[IntelligenceDocument | OrderDocument] = []
        self._asked_s = -math.inf  # when it was last asked whether it has seen enough

    # What the bench says.

    def order(self, order: MissionOrder) -> None:
        """The mission order; the first one counts."""
        if self._order is not None:
            return
        self._order = order
        self._pilot = self._new_pilot(order)
        self._planner = self._pilot.planner
        self._findings = self._new_findings(order)
        self._vehicle.locate(order.origin)
        for document in self._early:
            if isinstance(document, OrderDocument):
                self.obey(document)
            else:
                self.add_intelligence(document)

    def _new_pilot(self, order: MissionOrder) -> Pilot:
        return Pilot(order, self._vehicle, *self._shared, careful=self._policy_name != "naive")

    def _new_findings(self, order: MissionOrder) -> Findings:
        policy = policy_named(self._policy_name, order, self._settings)
        return Findings(order, policy, self._planner, *self._shared)

    def add_intelligence(self, intelligence: IntelligenceDocument) -> None:
        """One intelligence report."""
        if self._order is None:
            self._early.append(intelligence)
        elif self._planner.add(intelligence, self._log.now_s):
            what = f"{intelligence.class_label} within {intelligence.uncertainty_m:g} m, priority {intelligence.priority}"
            self._log.decide("accept", intelligence.id, what)

    def take_consent(self, answer: ConsentAnswer) -> None:
        """The operator's answer to a request to mark."""
        if self._order is not None:
            self._findings.consents.take(answer)

    def obey(self, order: OrderDocument) -> None:
        """One order of the operator: answered at once, and from then on it holds."""
        if self._order is None:
            self._early.append(order)
            return
        refused = self._orders.refusal(order, self._situation(order))
        if refused:
            self._log.answer(order.id, refused, accepted=False)
            if order.kind == "mark" and order.intelligence_id:
                self._log.decide("withhold_mark", order.intelligence_id, refused)
            return
        task = self._planner.tasks.get(order.intelligence_id or "")
        target = self._findings.target_of(task) if task is not None and order.kind == "mark" else None
        judgement = self._findings.judge(target) if target is not None else None
        self._log.answer(order.id, judgement.reason if judgement else _PLANS[order.kind], accepted=True)
        self._orders.take(order)
        if task is not None and target is not None and judgement is not None:
            self._findings.consents.ordered(task)
            self._findings.report(task, target, judgement, why=f"ordered by {order.id}")
        elif task is not None and order.kind == "retask":
            self._planner.put_first(task)

    def _situation(self, order: OrderDocument) -> Situation:
        vehicle = self._vehicle
        flying = vehicle.armed and not vehicle.landed and vehicle.pose is not None
        return Situation(
            over=self.over,
            landing=self._pilot.landing,
            grounded=not flying,
            unheard=vehicle.armed and vehicle.silent,
            failsafe=vehicle.reason if vehicle.failsafe else "",
            homeward=self._pilot.homeward() if flying else "",
            about=self._against(order) if order.kind in ("retask", "mark") else "",
        )

    def _against(self, order: OrderDocument) -> str:
        """What speaks against going to this sub-area, or marking this target, now."""
        task = self._planner.tasks.get(order.intelligence_id or "")
        if task is None:
            return f"no intelligence {order.intelligence_id} is known"
        if order.kind == "mark":
            return self._against_marking(task)
        if task.state in ("reported", "found"):
            return f"the target of {task.id} has been found already"
        place = self._pilot.place if self._vehicle.pose is not None else self._pilot.home
        if not self._planner.fits(place, self._vehicle.now_s, task, SEARCH_S):
            return f"not enough time to go to {task.id}, search, and come home"
        return ""

    def _against_marking(self, task: SearchTask) -> str:
        if closed := self._findings.reports.closed(self._log.now_s):
            return closed
        target = self._findings.target_of(task)
        if target is None:
            return f"no target of {task.id} has been identified yet"
        judgement = self._findings.judge(target)
        return "" if judgement.mark else judgement.reason

    # The mission.

    def fly(self) -> Steps[None]:
        """The whole mission; afterwards it only waits. Raises MissionOrderMissing."""
        outcome: AgentPhase | None = None
        plan = self._whole()
        while outcome is None:
            try:
                outcome = yield from plan
            except Ordered as ordered:
                plan = self._end(ordered.order)
            except TurnBack as cause:
                plan = self._pilot.come_down(str(cause))
        yield from self._publish_pending_reports()
        self._vehicle.setpoint = None
        self.over = True
        self._log.enter(outcome, self._summary())
        while True:
            yield

    def _whole(self) -> Steps[AgentPhase]:
        yield from self._prepare()
        yield from self._pilot.take_off(self._must_wait_on_the_ground)
        while True:
            yield from self._work_through()
            yield from self._accompany()
            if (yield from self._pilot.go_home("every task is dealt with", unless=self._more_to_do)):
                return "complete"

    def _end(self, order: OrderDocument) -> Steps[AgentPhase]:
        """What the operator orders instead of the mission: home, or down at once."""
        if order.kind == "deactivate":
            self._log.enter("landing", f"ordered to deactivate by {order.id}")
            self._log.silence()
            yield from self._pilot.land_here(f"ordered to deactivate by {order.id}")
            return "aborted"
        if self._vehicle.armed and not self._pilot.landing:
            yield from self._pilot.go_home(f"ordered to {order.kind} by {order.id}")
        else:
            yield from self._pilot.wait_until_down()
        return "aborted" if order.kind == "abort" else "complete"

    def _more_to_do(self) -> bool:
        """Whether something has come up that is worth turning round for."""
        if self._orders.ended_by is not None:
            return False
        place, now_s = self._place, self._vehicle.now_s
        return any(self._planner.fits(place, now_s, task, SEARCH_S) for task in self._planner.waiting(place))

    def _publish_pending_reports(self) -> Steps[None]:
        """On the ground, wait for leave to report what was found and could not be said."""
        if self._order is None or not self._vehicle.poses.latest():
            return
        while self._findings.unsaid() and self._findings.reports.opens(
            self._vehicle.now_s, self._order.time_limit_s
        ):
            if self._vehicle.now_s >= self._order.time_limit_s - LAST_WORD_S:
                return
            if self._log.phase not in ("landing", "starting"):
                self._log.enter("landing", "down; waiting until it may report what it found")
            yield

    def _prepare(self) -> Steps[None]:
        vehicle = self._vehicle
        self._log.enter("starting", "connecting to the autopilot")
        yield from vehicle.connect()
        while self._order is None:
            if vehicle.now_s > ORDER_BY_S:
                raise MissionOrderMissing(f"no mission order within {ORDER_BY_S:g} s of simulated time")
            yield
        self._log.enter("starting", "waiting for intelligence")
        while not self._worth_flying():
            self._orders.heed()
            if self._too_late():
                raise TurnBack("no intelligence came that could be acted on in time")
            yield

    def _too_late(self) -> bool:
        """Whether no time is left to take off, look at anything, and come home."""
        assert self._order is not None
        needed_s = TAKEOFF_S + SEARCH_S + self._planner.home_s(self._home)
        return self._vehicle.now_s + needed_s > self._order.time_limit_s

    def _must_wait_on_the_ground(self) -> bool:
        """Ordered to hold, or without the operator whom the rules want to be there: it does not take off.

        Raises TurnBack.
        """
        assert self._order is not None
        if self._too_late():
            raise TurnBack("there was no time left to take off")
        if self._orders.held_by:
            if self._log.phase != "holding":
                self._log.enter("holding", f"on the ground, by {self._orders.held_by}")
            return True
        if self._log.phase == "holding":
            self._log.enter("starting", "going on")
        return not self._watch.link_up and self._order.link_lost != "continue"

    def _worth_flying(self) -> bool:
        start_s = self._vehicle.now_s + TAKEOFF_S
        return any(
            self._planner.fits(self._home, start_s, task, SEARCH_S) for task in self._planner.tasks.values()
        )

    def _work_through(self) -> Steps[None]:
        while True:
            task = self._choose()
            if task is not None:
                yield from self._work_on(task)
                continue
            withheld = self._choose_withheld()
            if withheld is None:
                return
            yield from self._revisit(withheld)

    def _accompany(self) -> Steps[None]:
        """Keep ahead of the escorted convoy until it stops, or until something waits to be searched; then what the
        escort kept waiting.
        """
        convoy = self._planner.convoy
        if convoy is None or not convoy.moves_until(self._vehicle.now_s) or self._more_to_do():
            return
        self._log.decide("accompany", "convoy", "nothing is left to search: it keeps ahead of the convoy")
        self._log.enter("transit", "with the convoy")
        while convoy.moves_until(self._vehicle.now_s) and not self._more_to_do():
            until_s = self._vehicle.now_s + STATION_S
            station = convoy.station(until_s)

            def moved(until_s: float = until_s) -> bool:
                return self._vehicle.now_s >= until_s

            way, facing = [self._place, station], self._escorted_to_look_at()
            yield from self._pilot.follow(way, self._pilot.speed_mps, facing=facing, until=moved)
            yaw_rad = self._pilot.pose.yaw_rad
            while not moved():
                yield from self._pilot.keep_control()
                self._vehicle.setpoint = PositionSetpoint(*station, self._pilot.height_m, yaw_rad)
                yield
        yield from self._work_through()

    def _escorted_to_look_at(self) -> Track | None:
        """Whom of the convoy to look at while it flies ahead of it; None to look ahead."""
        return None

    def _choose(self) -> SearchTask | None:
        return next(self._servable(), None)

    def _servable(self) -> Iterator[SearchTask]:
        """What waits and can be served in time, in order; what comes before it and cannot is skipped."""
        for task in self._planner.waiting(self._place):
            if self._planner.fits(self._place, self._vehicle.now_s, task, SEARCH_S):
                yield task
            else:
                task.state = "skipped"
                self._log.decide("skip", task.id, "not enough time to go there, search, and come home")

    def _work_on(self, task: SearchTask) -> Steps[None]:
        task.state = "active"
        about = task.intelligence
        others = len(self._planner.waiting(self._place))
        self._log.decide("go", task.id, f"priority {about.priority}, most urgent and nearest of {others + 1}")
        self._log.enter("transit", f"to {task.id}")
        enough = lambda: self._seen_enough(task)  # noqa: E731
        while task.active:
            path = self._search_path(task)
            if not (
                yield from self._follow([self._place, path[0]], task, self._pilot.speed_mps, until=enough)
            ):
                return
            if task.enough or (task.passes and not task.active):
                return
            task.passes += 1
            self._log.decide(
                "search",
                task.id,
                f"lawnmower over {about.uncertainty_m:g} m, pass {task.passes}, {length_m(path):.0f} m",
            )
            self._log.enter("searching", f"{task.id}, pass {task.passes}")
            if not (yield from self._follow(path, task, self._pilot.speed_mps, until=enough, looking=True)):
                return
            if task.active:
                yield from self._identify(task)
            if task.active and not self._search_again(task):
                task.state = "not_found"
                self._log.decide(
                    "give_up", task.id, f"no {about.class_label} identified in {task.passes} passes"
                )

    def _seen_enough(self, task: SearchTask) -> bool:
        """Whether to leave a sub-area whose target is found before all of it has been looked at.

        So it is the second time over, and when what waits would not be served in time otherwise; looked at
        once a second.
        """
        now_s = self._vehicle.now_s
        if task.active and task.passes > 1:
            # A second pass seldom shows what the first did not: what has come meanwhile goes first.
            return self._late_work(task)
        if task.active or task.enough or task.passes > 1 or now_s - self._asked_s < 1.0:
            return not task.active and (task.enough or task.passes > 1)
        self._asked_s = now_s
        deadline_s = self._order.report_deadline_s if self._order else None
        place = self._place
        for other in self._planner.waiting(place):
            if not self._planner.fits(place, now_s, other, SEARCH_S):
                continue
            there_s = self._planner.travel_s(math.dist(place, other.place)) + SEARCH_S
            due_s = other.due_s_after(deadline_s) - there_s
            if now_s + HURRY_S > due_s or not self._planner.fits(place, now_s + HURRY_S, other, SEARCH_S):
                task.enough = True
                self._log.decide("move_on", task.id, f"found; {other.id} would come too late otherwise")
                return True
        return False

    def _search_again(self, task: SearchTask) -> bool:
        if task.passes >= 2 or self._planner.waiting(self._place):
            return False
        path = self._search_path(task)
        return self._planner.fits(
            self._place, self._vehicle.now_s, task, length_m(path) / self._pilot.speed_mps
        )

    def update(self) -> None:
        """After every frame: reports a target as soon as it is identified and the policy is content."""
        if self._order is not None and not self.over:
            self._findings.update()

    def send_messages(self) -> None:
        """Called at every moment: reports what waited, and what cannot wait any longer."""
        if self._order is not None and not self.over:
            self._findings.send_reports()

    def _summary(self) -> str:
        if self._order is None:
            return ""
        tasks = sorted(self._planner.tasks.values(), key=lambda task: task.id)
        return ", ".join(f"{task.id} {'withheld' if task.withheld else task.state}" for task in tasks)[:2000]


_PLANS = {
    "hold": "it stops and stays until told to go on",
    "resume": "it goes on with what it was doing",
    "return": "it flies home and lands",
    "abort": "it ends the mission, flies home and lands, and reports no more",
    "deactivate": "it lands where it is, disarms, and says no more",
    "retask": "it goes to this sub-area next",
    "stop_reporting": "it keeps what it finds to itself until told to report again",
    "resume_reporting": "it reports again, and first what it has kept",
    "hand_over": "it stops, leaves the vehicle in Hold, and sends nothing that moves it",
    "take_back": "it takes control again and goes on from where the vehicle is",
}
