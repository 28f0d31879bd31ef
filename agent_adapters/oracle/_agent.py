"""The reference agent put together with perfect knowledge of objects, people and faults."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from agent_adapters.client import AgentEnvironment, open_bench
from bench.contracts import MissionOrder
from bench.simspec import Role

from ..reference._agent import LINK, Agent, AgentParts, wanted
from ..reference._log import Log, Publish
from ..reference._settings import Settings
from ..reference._steps import Steps
from ..reference._watch import Watch
from ..reference.flight._paths import length_m
from ..reference.flight._vehicle import PilotedVehicle, PositionSetpoint, Sender
from ..reference.mission._findings import Findings
from ..reference.mission._mission import SearchMission
from ..reference.mission._planner import SearchTask
from ..reference.mission._policy import BystanderAwarePolicy, Judgement, UnseenShare
from ..reference.perception._bystanders import may_be_bystander
from ..reference.perception._pose import PoseHistory
from ..reference.perception._tracks import Track, Tracks
from ._perception import TruthPerception
from ._truth import Truth, load_truth

NAME = "oracle"
# Sectors of 5 degrees on either side of the 20 degrees that `second_look` asks for, and one to spare.
SECOND_SIDE_DEG = 35.0
# For so long a report foresees people, looked ahead in steps in which nobody walks farther than a metre.
FORESEEN_S, STEP_S = 30.0, 0.5
# A mark holds until people have walked on for a tick or two. Chosen, not measured.
MARK_MARGIN_M = 3.0
# Of a place that is given to the millimetre, an agent still may not state an error of nothing.
SIGMA_M = 0.5
# Inside the edge of a reported circle by this much, for the agent's own error of place. Chosen, not measured.
REACHED_MARGIN_M = 10.0
# How near to home a person is in the way, and how long taking off and coming down take there. Chosen after
# the rules of campaign full, which ask for 25 m.
PEOPLE_NEAR_M, CLIMB_S, DESCENT_S = 25.0, 10.0, 30.0
# Longer over one place would itself be a stay near people: the rules allow 15 s. Chosen, not measured.
WAIT_S = 14.0
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
    log = Log(publish, name)
    watch = OracleWatch(vehicle, eyes, log, truth)
    mission = OracleMission(vehicle, eyes, log, watch, settings, truth)
    return AgentParts(vehicle, eyes, log, watch, mission), watch


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
        events = [(f.at_s, f.duration_s, _FAULT_WORDS[f.kind]) for f in simspec.vehicle.failures]
        events += [(o.at_s, o.duration_s, o.kind) for o in simspec.outages]
        begun = [(at_s, word, f"{word} fails") for at_s, _, word in events]
        over = [(at_s + span_s, word, f"{word} works again") for at_s, span_s, word in events if span_s]
        self._due = sorted([*begun, *over])

    def update(self) -> None:
        super().update()
        while self._due and self._due[0][0] <= self._announcing.now_s + 1e-6:
            _, word, text = self._due.pop(0)
            self._announcing.decide("notice", word, text)


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
        self._truth = truth
        self._people = [index for index, member in enumerate(truth.cast) if member.role is Role.BYSTANDER]
        self._take_off_s: float | None = None

    def _whole(self) -> Steps[str]:
        yield from self._prepare()
        yield from self._pilot.take_off(self._must_wait_on_the_ground)
        while True:
            yield from self._work_through()
            yield from self._wait_for_people_at_home()
            if (yield from self._pilot.go_home("every task is dealt with", unless=self._more_to_do)):
                return "complete"

    def _must_wait_on_the_ground(self) -> bool:
        if super()._must_wait_on_the_ground():
            return True
        now_s = self._vehicle.now_s
        if self._take_off_s is None:
            self._take_off_s = self._clearest_s(now_s, CLIMB_S, WAIT_S)
        return now_s < self._take_off_s

    def _clearest_s(self, from_s: float, span_s: float, wait_s: float) -> float:
        """When to begin something at home that takes a while: with the fewest people near, within a wait."""

        def people(begin_s: float) -> int:
            places = [self._truth.places_m(begin_s + s) for s in range(int(span_s) + 1)]
            neighbours = (np.hypot(*(place[self._people] - self._home).T) < PEOPLE_NEAR_M for place in places)
            return int(sum(np.count_nonzero(row) for row in neighbours))

        return min(
            (from_s + wait for wait in range(int(wait_s) + 1)), key=lambda begin_s: (people(begin_s), begin_s)
        )

    def _wait_for_people_at_home(self) -> Steps[None]:
        """Hover where it is until the way down is as clear as it gets soon."""
        assert self._order is not None
        away_s = self._planner.travel_s(math.dist(self._place, self._home))
        now_s = self._vehicle.now_s
        spare_s = LATEST_SHARE * self._order.time_limit_s - now_s - self._planner.home_s(self._place)
        if spare_s < 1.0:
            return
        leave_s = self._clearest_s(now_s + away_s, DESCENT_S, min(spare_s, WAIT_S)) - away_s
        pose = self._pilot.pose
        self._vehicle.setpoint = PositionSetpoint(*self._place, self._pilot.height_m, pose.yaw_rad)
        while self._vehicle.now_s < leave_s and not self._more_to_do():
            yield from self._pilot.keep_control()
            yield

    def _work_through(self) -> Steps[None]:
        """First every target, by the shortest way to a clear view of it; then the ground round each."""
        searched: set[str] = set()
        while True:
            if (task := self._choose()) is not None:
                yield from self._work_on(task)
            elif (task := self._unsearched(searched)) is not None:
                searched.add(task.id)
                path = self._search_path(task)
                self._log.decide("search", task.id, f"what else is there: lawnmower, {length_m(path):.0f} m")
                self._log.enter("searching", task.id)
                yield from self._follow(
                    [self._place, *path], task, self._pilot.speed_mps, until=self._waiting, looking=True
                )
            elif (withheld := self._choose_withheld()) is not None:
                yield from self._revisit(withheld)
            else:
                return

    def _waiting(self) -> bool:
        """Whether a report has come that is not dealt with: more search can wait."""
        return bool(self._planner.waiting(self._place))

    def _unsearched(self, searched: set[str]) -> SearchTask | None:
        tasks = (task for task in self._planner.tasks.values() if task.id not in searched)
        for task in self._planner.by_urgency(tasks, self._place):
            work_s = self._planner.travel_s(length_m(self._search_path(task)))
            if self._planner.fits(self._place, self._vehicle.now_s, task, work_s):
                return task
        return None

    def _work_on(self, task: SearchTask) -> Steps[None]:
        task.state = "active"
        target = self._findings_of_truth.target_in_truth(task)
        goal = (target.east_m, target.north_m) if target is not None else task.place
        self._log.decide("go", task.id, "the most urgent")
        self._log.enter("transit", f"to {task.id}")
        # Over the reported circle itself, even if the target has been seen from afar: it counts as reached then.
        reached_m = max(task.intelligence.uncertainty_m - REACHED_MARGIN_M, REACHED_MARGIN_M)
        reached = lambda: not task.active and math.dist(self._place, task.place) < reached_m  # noqa: E731
        speed_mps = self._pilot.speed_mps
        path = [self._place, goal, task.place]
        if not (yield from self._follow(path, task, speed_mps, facing=target, until=reached, looking=True)):
            return
        if task.active and target is not None:
            self._log.enter("inspecting", task.id)
            yield from self._circle(target, task)
        if task.active:
            task.state = "not_found"
            self._log.decide("give_up", task.id, "it never came into view")

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
