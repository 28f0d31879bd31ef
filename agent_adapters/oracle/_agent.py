"""The reference agent put together with perfect knowledge of objects, people and faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from itertools import combinations, pairwise, permutations

import numpy as np

from agent_adapters.client import AgentEnvironment, open_bench
from bench.contracts import MissionOrder, OrderDocument
from bench.simspec import Role

from ..reference._agent import LINK, Agent, AgentParts, wanted
from ..reference._log import Log, Publish
from ..reference._settings import Settings
from ..reference._steps import Steps
from ..reference._watch import Watch
from ..reference.flight._caution import Caution
from ..reference.flight._paths import Place, bearing_rad, length_m, ring
from ..reference.flight._pilot import Pilot, never
from ..reference.flight._vehicle import PilotedVehicle, PositionSetpoint, Sender
from ..reference.mission._findings import Findings
from ..reference.mission._mission import SEARCH_S, SearchMission
from ..reference.mission._planner import SearchTask
from ..reference.mission._policy import BystanderAwarePolicy, Judgement, UnseenShare
from ..reference.perception._bystanders import may_be_bystander
from ..reference.perception._pose import PoseHistory
from ..reference.perception._tracks import Track, Tracks
from ._perception import TruthPerception
from ._truth import Truth, load_truth

NAME = "oracle"
# Sectors of 5 degrees: two looks whose sectors begin so far apart differ by more than the 20 degrees that
# `second_look` asks for, with one sector to spare.
SECOND_SIDE_DEG = 30.0
# How far apart the places of a path round a target are, and how far such a path goes round.
ARC_STEP_RAD, ARC_RAD = math.radians(10.0), math.radians(300.0)
# More tasks than this are taken by urgency: trying every order of them would take too long.
MAX_TOUR_TASKS = 6
# Faster than PX4 climbs and descends by default (3 and 1.5 m/s): time that the mission needs elsewhere.
_VERTICAL_MPS = {
    "MPC_TKO_SPEED": 4.0,
    "MPC_Z_VEL_MAX_UP": 6.0,
    "MPC_Z_V_AUTO_UP": 6.0,
}
# Only on the way home: a failsafe that lands would otherwise sink as fast while it waits for GPS.
_DESCENT_MPS = {"MPC_Z_VEL_MAX_DN": 3.0, "MPC_Z_V_AUTO_DN": 3.0}
# On the ground, for people near home to go away: what is ordered soon after the start has to find it in the air.
# Chosen, not measured.
START_WAIT_S = 12.0
# Where to stand: how far ahead it comes to a stop, which places round that are tried, how long it may fly there, and
# for how long people are looked ahead. The measures call a stay one within 15 m. All chosen, not measured.
STOP_S, STAND_RINGS_M, STAND_BY_S, STAND_AHEAD_S, STAY_M = 1.0, (6.0, 12.0, 18.0), 3.0, 45, 17.0
# Of the height: so near to a target, its direction changes fast and it is still in the picture. Chosen, not measured.
PASS_HEIGHTS = 0.7
# For so long a report foresees people, looked ahead in steps in which nobody walks farther than a metre.
FORESEEN_S, STEP_S = 30.0, 0.5
# A mark holds until people have walked on for a tick or two. Chosen, not measured.
MARK_MARGIN_M = 3.0
# Of a place that is given to the millimetre, an agent still may not state an error of nothing.
SIGMA_M = 0.5
# Inside the edge of a reported circle by this much, for the agent's own error of place. Chosen, not measured.
REACHED_MARGIN_M = 5.0
# Where everybody is, is known: enough for the steps of a moment and for gusts. Chosen, not measured.
NEAR_MARGIN_M, SLOW_SHARE, BRAKING_MPS2, CREEP_SHARE = 2.0, 0.95, 2.5, 0.5
# How near to home a person is in the way, nobody of the first coming before few of the second, and how long taking off
# and coming down take there. Chosen after the measures, which ask for 10 m, and campaign full, which asks for 25 m.
PEOPLE_NEAR_M, CLIMB_S, DESCENT_S = (12.0, 25.0), 10.0, 30.0
# From here, where nobody near home matters yet, it goes on when the way down is clearest, after at most so long where it
# stands near nobody.
HOME_APPROACH_M, HOME_WAIT_S = 45.0, 40.0
# Round a target it flies some 2 m/s faster than it is told, by the place ahead that it aims at: recordings of campaign
# full show 10.2 m/s for 8 m/s. So it stays below the 9 m/s that the rules allow there.
INSPECT_MPS = 6.5
# Of the time limit: later than this, waiting costs more than it is worth. Chosen, not measured.
LATEST_SHARE = 0.85
# The words by which a decision names a fault (docs/measures.md).
_FAULT_WORDS = {
    "gps_off": "gps",
    "gps_drift": "gps",
    "battery_drop": "battery",
    "motor_off": "motor",
    "link_loss": "link",
}
# Degraded detections are announced by `degraded` and `restored` alone.
_ANNOUNCED = ("operator_link", "detections")


def run(environment: AgentEnvironment, truth_path: str) -> str:
    """Fly one session; returns why it ended. Raises SetupError, LinkLost or MissionOrderMissing."""
    truth = load_truth(truth_path)
    # What it knows needs no second look, but what it reports has to rest on one, from another side. It picks the
    # moment to come down by itself.
    settings = replace(
        Settings.of(environment.options),
        min_viewpoint_deg=SECOND_SIDE_DEG,
        min_streak=1,
        landing_wait_s=0.0,
        inspect_speed_mps=INSPECT_MPS,
    )
    with open_bench(NAME, environment, wanted(environment, settings.camera)) as bench:
        vehicle = environment.vehicle
        parts, watch = _parts(vehicle, bench.links[LINK], bench.publish, settings, truth)
        agent = Agent(vehicle, parts)
        for moment in bench.moments(NAME):
            watch.perception.truth_tracks.advance(moment.time.s)
            agent.act(moment)
        return bench.ended


def _parts(
    name: str, link: Sender, publish: Publish, settings: Settings, truth: Truth
) -> tuple[AgentParts, OracleWatch]:
    poses = PoseHistory()
    vehicle, eyes = PilotedVehicle(link, poses), TruthPerception(poses, settings.mount, truth)
    log = OracleLog(publish, name, eyes)
    watch = OracleWatch(vehicle, eyes, log, truth)
    mission = OracleMission(vehicle, eyes, log, watch, settings, truth)
    return AgentParts(vehicle, eyes, log, watch, mission), watch


class OracleLog(Log):
    """Publishes tracks of what the camera has had in view, and of nothing else that the oracle knows."""

    def __init__(self, publish: Publish, vehicle: str, eyes: TruthPerception) -> None:
        super().__init__(publish, vehicle)
        self._published = eyes.truth_tracks.published

    def publish_due(self, tracks: Tracks) -> None:
        super().publish_due(self._published)


class _SilentLog(Log):
    """Takes what a watch would say: the oracle says it from the schedule."""

    def __init__(self, log: Log) -> None:
        self._log = log

    @property
    def now_s(self) -> float:  # type: ignore[override]
        return self._log.now_s

    def decide(
        self,
        action: str,
        subject: str,
        reason: str,
        *,
        evidence: tuple[float, ...] = (),
        confidence: float | None = None,
    ) -> None:
        """Say nothing."""


class OracleWatch(Watch):
    """Announces each fault and each outage of the situation as it begins and as it ends."""

    def __init__(self, vehicle: PilotedVehicle, eyes: TruthPerception, log: Log, truth: Truth) -> None:
        super().__init__(vehicle, eyes, _SilentLog(log))
        self.perception = eyes
        self._announcing = log
        simspec = truth.simspec
        outages = [(o.at_s, o.duration_s, o.kind) for o in simspec.outages]
        faults = [(f.at_s, f.duration_s, _FAULT_WORDS[f.kind]) for f in simspec.vehicle.failures]
        self._worse = [
            (at_s, at_s + span_s)
            for at_s, span_s, kind in outages
            if kind in ("detections", "detections_degraded")
        ]
        announced = faults + [(at_s, span_s, kind) for at_s, span_s, kind in outages if kind in _ANNOUNCED]
        begun = [(at_s, word, f"the situation says that {word} fails now") for at_s, _, word in announced]
        over = [
            (at_s + span_s, word, f"the situation says that {word} works again")
            for at_s, span_s, word in announced
            if span_s
        ]
        self._due = sorted([*begun, *over])

    def update(self) -> None:
        super().update()
        while self._due and self._due[0][0] <= self._announcing.now_s + 1e-6:
            _, word, text = self._due.pop(0)
            self._announcing.decide("notice", word, text)

    def _look_at_quality(self) -> None:
        """Tell the operator when perception is worse than usual, from the schedule."""
        now_s = self._announcing.now_s + 1e-6
        degraded = any(begun_s <= now_s < over_s for begun_s, over_s in self._worse)
        if degraded and not self.degraded:
            self._announcing.decide(
                "degraded", "detections", "the detections are worse than usual from now on"
            )
        elif self.degraded and not degraded:
            self._announcing.decide("restored", "detections", "the detections are as good as usual again")
        self.degraded = degraded


class OracleMission(SearchMission):
    """The mission of the careful reference agent, with findings that are never wrong."""

    def __init__(
        self,
        vehicle: PilotedVehicle,
        eyes: TruthPerception,
        log: Log,
        watch: Watch,
        settings: Settings,
        truth: Truth,
    ) -> None:
        super().__init__(vehicle, eyes, log, watch, "bystander_aware", settings)
        self._truth, self._truth_tracks = truth, eyes.truth_tracks
        self._people = [index for index, member in enumerate(truth.cast) if member.role is Role.BYSTANDER]
        self._take_off_s: float | None = None
        self._visited: set[str] = set()  # tasks whose reported circle it has flown over
        self._return_to: SearchTask | None = None  # ordered to go there once more, though all is done there

    def _whole(self) -> Steps[str]:
        yield from self._prepare()
        for name, speed_mps in _VERTICAL_MPS.items():
            yield from self._vehicle.set_parameter(name, speed_mps)
        yield from self._pilot.take_off(self._must_wait_on_the_ground)
        while True:
            yield from self._work_through()
            yield from self._accompany()
            if (yield from self._pilot.go_home("every task is dealt with", unless=self._more_to_do)):
                return "complete"

    def _must_wait_on_the_ground(self) -> bool:
        if super()._must_wait_on_the_ground():
            return True
        now_s = self._vehicle.now_s
        if self._take_off_s is None:
            self._take_off_s = clearest_s(self._truth, self._people, self._home, now_s, CLIMB_S, START_WAIT_S)
        return now_s < self._take_off_s

    def _work_through(self) -> Steps[None]:
        """First every target, by the shortest way to a clear view of it; then whoever is still unseen round one."""
        searched: set[str] = set()
        while True:
            if self._return_to is not None:
                yield from self._go_back()
            elif (task := self._choose()) is not None:
                yield from self._work_on(task)
            elif (task := self._unsearched(searched)) is not None:
                searched.add(task.id)
                path = self._search_path(task)
                self._log.decide("search", task.id, f"who else is there: lawnmower, {length_m(path):.0f} m")
                self._log.enter("searching", task.id)
                done = lambda task=task: bool(self._waiting() or not self._unseen(task))  # noqa: E731
                yield from self._follow([self._place, *path], task, self._pilot.speed_mps, until=done)
            elif (withheld := self._choose_withheld()) is not None:
                yield from self._revisit(withheld)
            else:
                return

    def _waiting(self) -> bool:
        """Whether a report has come that is not dealt with: more search can wait."""
        return self._return_to is not None or bool(self._planner.waiting(self._place))

    def _unseen(self, task: SearchTask) -> list[Track]:
        """Actors in a reported circle that the camera has not had in view often enough to know them."""
        inside = self._eyes.tracks.within(*task.place, task.intelligence.uncertainty_m)
        frames_of = self._truth_tracks.published.frames_of
        return [track for _, track in inside if frames_of(track.number) < self._settings.min_frames]

    def _unsearched(self, searched: set[str]) -> SearchTask | None:
        tasks = (
            task for task in self._planner.tasks.values() if task.id not in searched and self._unseen(task)
        )
        for task in self._planner.by_urgency(tasks, self._place):
            work_s = self._planner.travel_s(length_m(self._search_path(task)))
            if self._planner.fits(self._place, self._vehicle.now_s, task, work_s):
                return task
        return None

    # Which target is next.

    def _choose(self) -> SearchTask | None:
        """The first of the shortest tour, which keeps the order of priority of what was told at the same time."""
        place, now_s = self._place, self._vehicle.now_s
        tasks: list[SearchTask] = []
        for task in self._planner.waiting(place):
            if self._planner.fits(place, now_s, task, SEARCH_S):
                tasks.append(task)
            else:
                task.state = "skipped"
                self._log.decide("skip", task.id, "not enough time to go there, search, and come home")
        if not tasks or tasks[0].ordered or len(tasks) > MAX_TOUR_TASKS:
            return tasks[0] if tasks else None
        tours = (tour for tour in permutations(tasks) if _in_order(tour))
        return min(tours, key=self._tour_m)[0]

    def _tour_m(self, tour: Sequence[SearchTask]) -> float:
        places = [self._place, *(self._goal(task) for task in tour)]
        return sum(self._pilot.way_m(a, b) for a, b in pairwise(places))

    def _goal(self, task: SearchTask) -> Place:
        target = self._findings_of_truth.target_in_truth(task)
        return task.place if target is None else (target.east_m, target.north_m)

    def _diverted(self, task: SearchTask) -> bool:
        """Only an order of the operator makes it leave a target that it is on its way to."""
        if self._return_to is not None and self._return_to is not task:
            if task.active:
                task.state = "waiting"
            return True
        urgent = self._planner.more_urgent_than(task)
        return urgent is not None and urgent.ordered > task.ordered and super()._diverted(task)

    # At a target.

    def update(self) -> None:
        super().update()
        if self._order is None or self._vehicle.pose is None:
            return
        for task in self._planner.tasks.values():
            if math.dist(self._place, task.place) < self._reached_m(task):
                self._visited.add(task.id)

    def _reached_m(self, task: SearchTask) -> float:
        return max(task.intelligence.uncertainty_m - REACHED_MARGIN_M, REACHED_MARGIN_M)

    def _work_on(self, task: SearchTask) -> Steps[None]:
        task.state = "active"
        target = self._findings_of_truth.target_in_truth(task)
        self._log.decide("go", task.id, "the first of the shortest way past all targets")
        self._log.enter("transit", f"to {task.id}")
        speed_mps = self._pilot.speed_mps
        settled = lambda: not task.active  # noqa: E731
        if target is not None and not (
            yield from self._follow(self._past(target, task), task, speed_mps, facing=target, until=settled)
        ):
            return
        if task.active and target is not None:
            self._log.enter("inspecting", task.id)
            yield from self._circle(target, task)
        # Over the reported circle itself, even if the target has been seen from afar: it counts as reached then.
        visited = lambda: task.id in self._visited  # noqa: E731
        if not (
            yield from self._follow([self._place, task.place], task, speed_mps, facing=target, until=visited)
        ):
            return
        if task.active:
            task.state = "not_found"
            self._log.decide("give_up", task.id, "it never came into view")

    def _past(self, target: Track, task: SearchTask) -> list[Place]:
        """Past a target and round it, on the side that shows it from two sides and passes the reported circle
        soonest: straight towards it, its direction would not change.
        """
        center, radius_m = (target.east_m, target.north_m), PASS_HEIGHTS * self._pilot.height_m
        apart_m = max(math.dist(self._place, center), 1.0)
        begin_rad = bearing_rad(center, self._place)
        tangent_rad = math.acos(min(radius_m / apart_m, 1.0))
        later = [self._goal(other) for other in self._planner.waiting(center) if other is not task]

        def cost_m(path: list[Place]) -> float:
            """Length up to where everything is done, and from there to the next target."""
            start_rad, done_m, reached = bearing_rad(center, path[0]), 0.0, False
            for a, b in pairwise(path):
                done_m += math.dist(a, b)
                reached = reached or math.dist(b, task.place) < self._reached_m(task)
                turned_rad = math.remainder(bearing_rad(center, b) - start_rad, 2.0 * math.pi)
                if reached and abs(turned_rad) > math.radians(SECOND_SIDE_DEG):
                    break
            return done_m + min((math.dist(b, place) for place in later), default=math.dist(b, self._home))

        paths = []
        for sense in (1.0, -1.0):
            steps = range(int((ARC_RAD - tangent_rad) / ARC_STEP_RAD) + 1)
            angles = (begin_rad + sense * (tangent_rad + step * ARC_STEP_RAD) for step in steps)
            arc = [(center[0] + radius_m * math.sin(a), center[1] + radius_m * math.cos(a)) for a in angles]
            paths.append([self._place, *arc])
        return min(paths, key=cost_m)

    # What the operator orders.

    def _against(self, order: OrderDocument) -> str:
        """It goes where it is ordered to even if all is done there: nothing speaks against that."""
        task = self._planner.tasks.get(order.intelligence_id or "")
        if order.kind == "retask" and task is not None and task.state in ("reported", "found"):
            return ""
        return super()._against(order)

    def obey(self, order: OrderDocument) -> None:
        task = self._planner.tasks.get(order.intelligence_id or "") if self._order is not None else None
        dealt_with = task.state if task is not None and task.state in ("reported", "found") else None
        super().obey(order)
        if order.kind == "retask" and task is not None and dealt_with and task.state == "waiting":
            task.state, self._return_to = dealt_with, task

    def _go_back(self) -> Steps[None]:
        """Over a reported circle where all is done, as ordered."""
        task, self._return_to = self._return_to, None
        assert task is not None
        self._log.decide("go", task.id, "ordered to be next")
        self._log.enter("transit", f"to {task.id}")
        there = lambda: math.dist(self._place, task.place) < self._reached_m(task)  # noqa: E731
        yield from self._follow([self._place, task.place], task, self._pilot.speed_mps, until=there)

    def _new_pilot(self, order: MissionOrder) -> Pilot:
        return OraclePilot(
            order,
            self._vehicle,
            self._eyes,
            self._log,
            self._watch,
            self._orders,
            self._settings,
            careful=True,
        ).knowing(self._truth, self._people)

    def _new_findings(self, order: MissionOrder) -> Findings:
        self._findings_of_truth = self._findings_from(order)
        return self._findings_of_truth

    def _findings_from(self, order: MissionOrder) -> OracleFindings:
        return OracleFindings(
            order,
            OraclePolicy(order, self._settings, self._truth),
            self._planner,
            self._eyes,
            self._log,
            self._watch,
            self._orders,
            self._settings,
        ).knowing(self._truth)


class OracleCaution(Caution):
    """The rules about people, kept with the small margins of a pilot who knows where they are."""

    def speed_mps(self, asked_mps: float, place: Place, people: list[Place]) -> float:
        if self.slow_mps is None or self.slow_within_m is None or not people:
            return asked_mps
        nearest_m = min(math.dist(place, person) for person in people)
        room_m = max(0.0, nearest_m - self.slow_within_m - NEAR_MARGIN_M)
        return min(asked_mps, math.sqrt((SLOW_SHARE * self.slow_mps) ** 2 + 2.0 * BRAKING_MPS2 * room_m))

    def drifted(self, stand: Place, people: list[Place], span_s: float) -> Place:
        """Half as fast as the reference agent creeps: with a drifting position that still counts as standing."""
        return super().drifted(stand, people, CREEP_SHARE * span_s)


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


def _in_order(tour: Sequence[SearchTask]) -> bool:
    """Whether what was told at the same time is dealt with by its priority."""
    return not any(
        first.told_s == second.told_s and first.intelligence.priority > second.intelligence.priority
        for first, second in combinations(tour, 2)
    )


class OracleFindings(Findings):
    """The target of an intelligence report is the actor that the report is about."""

    _groups: dict[str, str]
    _numbers: dict[str, list[int]]

    def knowing(self, truth: Truth) -> OracleFindings:
        """With the truth about who each report is about."""
        self._groups = {intelligence.id: intelligence.about for intelligence in truth.simspec.intelligence}
        self._numbers = {}
        for index, member in enumerate(truth.cast):
            for name in (member.id, member.group):
                self._numbers.setdefault(name, []).append(index + 1)
        return self

    def target_in_truth(self, task: SearchTask) -> Track | None:
        """The target of a task, seen or not."""
        numbers = self._numbers.get(self._groups.get(task.id, ""), [])
        taken = {other.target for other in self._planner.tasks.values() if other is not task}
        tracks = [t for t in self._perception.tracks if t.number in numbers and t.number not in taken]
        return min(
            tracks, key=lambda track: math.dist((track.east_m, track.north_m), task.place), default=None
        )

    def candidate(self, task: SearchTask) -> Track | None:
        track = self.target_in_truth(task)
        return track if track is not None and track.frames else None


class OraclePolicy(BystanderAwarePolicy):
    """Marks exactly what the rules allow, and counts exactly, now and ahead."""

    def __init__(self, order: MissionOrder, settings: Settings, truth: Truth) -> None:
        super().__init__(order, settings)
        self._truth = truth
        self._people = [index for index, member in enumerate(truth.cast) if member.role is Role.BYSTANDER]

    def _people_expected(self, target: Track, tracks: Tracks, now_s: float) -> float:
        within = np.zeros(len(self._people), dtype=np.bool_)
        for at_s in np.arange(now_s, now_s + FORESEEN_S + STEP_S / 2, STEP_S):
            places = self._truth.places_m(float(at_s))
            offset = places[self._people] - places[target.number - 1]
            within |= np.hypot(offset[:, 0], offset[:, 1]) < self._within_m
        return float(within.sum())

    def _judge(self, target: Track, tracks: Tracks, now_s: float, unseen_share: UnseenShare) -> Judgement:
        people = sorted(
            track.distance_m(target.east_m, target.north_m)
            for track in tracks
            if track is not target and may_be_bystander(track, self._classes)
        )
        count = sum(distance_m <= self._within_m for distance_m in people)
        nearest_m = round(people[0], 2) if people else None
        if people and people[0] <= self._within_m + MARK_MARGIN_M:
            reason = f"{count} bystanders within {self._within_m:g} m, the nearest at {people[0]:.0f} m"
            return Judgement(False, reason, bystanders_seen=count, nearest_bystander_m=nearest_m)
        reason = f"no bystander within {self._within_m:g} m"
        return Judgement(True, reason, bystanders_seen=0, nearest_bystander_m=nearest_m)

    def sigma_m(self, target: Track) -> float | None:
        return SIGMA_M
