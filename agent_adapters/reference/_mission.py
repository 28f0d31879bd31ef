"""The mission as one behaviour: take off, work through the tasks in order, come home. Reads from top to bottom."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

from bench.contracts import IntelligenceDocument, MissionOrder, TargetReport

from ._log import Log
from ._perception import Perception
from ._planner import Planner, Task
from ._policy import Judgement, Policy, missing_for, policy_named
from ._pose import Pose
from ._search import Place, Walk, bearing_rad, lawnmower, length_m, ring
from ._settings import PolicyName, Settings
from ._steps import Steps
from ._tracks import Track
from ._vehicle import LAND, OFFBOARD, RTL, Setpoint, Vehicle

FIRST_HEIGHT_M = 6.0  # reached by the takeoff command; the rest is climbed on the way
READY_BY_S = 60.0  # an autopilot that cannot be armed by then stays on the ground
ORDER_BY_S = 20.0
LEAD_S = 0.6  # how far ahead on its path it aims
LOOK_M = 12.0  # and how much farther it looks
WINDOW_M = 25.0
ARRIVED_M = 3.0
TAKEOFF_S = 10.0  # from arming to being on the way
SEARCH_S = 15.0  # the least time for which a sub-area is worth flying to
CANDIDATE_SHARE = 0.25  # of the votes: an object that may be the target is worth a closer look
STILL_CLEAR_S = 4.0


class MissionOrderMissing(Exception):
    """No mission order came; the agent cannot know what to do."""


class TurnBack(Exception):
    """Raised inside a behaviour when the mission must end now; says why."""


@dataclass(frozen=True, slots=True)
class _Flight:
    """How high and how fast this mission is flown."""

    height_m: float
    speed_mps: float


class Mission:
    """Decides and flies. `fly` is the behaviour; `tell` and `order` bring in what the bench says meanwhile."""

    def __init__(self, vehicle: Vehicle, eyes: Perception, log: Log, policy: PolicyName, settings: Settings) -> None:
        self.over = False
        self._vehicle = vehicle
        self._eyes = eyes
        self._log = log
        self._policy_name: PolicyName = policy
        self._settings = settings
        self._order: MissionOrder | None = None
        self._early: list[IntelligenceDocument] = []
        self._judged: dict[str, str] = {}

    # What the bench says.

    def order(self, order: MissionOrder) -> None:
        """The mission order; the first one counts."""
        if self._order is not None:
            return
        self._order = order
        settings = self._settings
        height_m = min(order.altitude_m, order.max_altitude_m)
        self._flight = _Flight(height_m, order.speed_mps)
        self._planner = Planner(order, order.speed_mps, height_m, min(settings.safe_height_m, height_m), settings.reserve_s)
        self._policy: Policy = policy_named(self._policy_name, order, settings)
        self._vehicle.locate(order.origin)
        for document in self._early:
            self.tell(document)

    def tell(self, intelligence: IntelligenceDocument) -> None:
        """One intelligence report."""
        if self._order is None:
            self._early.append(intelligence)
        elif self._planner.add(intelligence):
            what = f"{intelligence.class_label} within {intelligence.uncertainty_m:g} m, priority {intelligence.priority}"
            self._log.decide("accept", intelligence.id, what)

    # The mission.

    def fly(self) -> Steps[None]:
        """The whole mission; afterwards it only waits. Raises MissionOrderMissing."""
        outcome = "complete"
        try:
            yield from self._prepare()
            yield from self._take_off()
            yield from self._work_through()
            yield from self._go_home("every task is dealt with")
        except TurnBack as cause:
            outcome = yield from self._come_down(str(cause))
        self._vehicle.setpoint = None
        self.over = True
        self._log.enter(outcome, self._summary())
        while True:
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
            if vehicle.now_s + TAKEOFF_S + SEARCH_S + self._planner.home_s(self._home) > self._order.time_limit_s:
                raise TurnBack("no intelligence came that could be acted on in time")
            yield

    def _worth_flying(self) -> bool:
        start_s = self._vehicle.now_s + TAKEOFF_S
        return any(self._planner.fits(self._home, start_s, task, SEARCH_S) for task in self._planner.tasks.values())

    def _take_off(self) -> Steps[None]:
        vehicle = self._vehicle
        yield from vehicle.set_parameter("MPC_XY_VEL_MAX", self._flight.speed_mps)
        self._log.enter("taking_off", "waiting until the autopilot is ready")
        if not (yield from vehicle.arm(READY_BY_S)):
            raise TurnBack(f"the autopilot could not be armed: {'; '.join(vehicle.texts) or 'it gives no reason'}")
        self._log.enter("taking_off", f"climbing to {FIRST_HEIGHT_M:g} m")
        first_m = min(FIRST_HEIGHT_M, self._flight.height_m)
        if not (yield from vehicle.take_off(first_m, vehicle.now_s + 60.0)):
            raise TurnBack(f"the takeoff failed: {'; '.join(vehicle.texts) or 'the autopilot gives no reason'}")
        pose = self._pose
        if not (yield from vehicle.go_offboard(Setpoint(pose.east_m, pose.north_m, self._flight.height_m, pose.yaw_rad))):
            raise TurnBack("the autopilot does not give control to the setpoint stream")
        yield from vehicle.silence_the_rest()

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

    def _choose(self) -> Task | None:
        for task in self._planner.waiting(self._place):
            if self._planner.fits(self._place, self._vehicle.now_s, task, SEARCH_S):
                return task
            task.state = "skipped"
            self._log.decide("skip", task.id, "not enough time to go there, search, and come home")
        return None

    def _work_on(self, task: Task) -> Steps[None]:
        task.state = "active"
        about = task.intelligence
        others = len(self._planner.waiting(self._place))
        self._log.decide("go", task.id, f"priority {about.priority}, most urgent and nearest of {others + 1}")
        self._log.enter("transit", f"to {task.id}")
        while task.active:
            path = self._search_path(task)
            if not (yield from self._follow([self._place, path[0]], task, self._flight.speed_mps)):
                return
            task.passes += 1
            self._log.decide(
                "search", task.id, f"lawnmower over {about.uncertainty_m:g} m, pass {task.passes}, {length_m(path):.0f} m"
            )
            self._log.enter("searching", f"{task.id}, pass {task.passes}")
            if not (yield from self._follow(path, task, self._flight.speed_mps)):
                return
            if task.active:
                yield from self._identify(task)
            if task.active and not self._search_again(task):
                task.state = "not_found"
                self._log.decide("give_up", task.id, f"no {about.class_label} identified in {task.passes} passes")

    def _search_path(self, task: Task) -> list[Place]:
        """Legs along the way in on the first pass, across it on the second: other views of the same ground."""
        heading_rad = bearing_rad(self._place, task.place) if math.dist(self._place, task.place) > 1.0 else 0.0
        return self._legs(task.place, task.intelligence.uncertainty_m, heading_rad + task.passes % 2 * math.pi / 2.0)

    def _legs(self, center: Place, radius_m: float, heading_rad: float) -> list[Place]:
        camera, height_m = self._eyes.camera, self._flight.height_m
        near_m, middle_m, _ = camera.ahead_m(height_m) if camera else (0.0, 0.0, 0.0)
        spacing_m = (camera.swath_m(height_m) if camera else height_m) * (1.0 - self._settings.overlap)
        return lawnmower(center, radius_m, max(spacing_m, 5.0), heading_rad, near_m, middle_m)

    def _search_again(self, task: Task) -> bool:
        if task.passes >= 2 or self._planner.waiting(self._place):
            return False
        path = self._search_path(task)
        return self._planner.fits(self._place, self._vehicle.now_s, task, length_m(path) / self._flight.speed_mps)

    def _identify(self, task: Task) -> Steps[None]:
        """Look at every candidate from all sides until one is identified."""
        while candidate := self._candidate(task):
            missing = self._missing(candidate, task)
            self._log.decide("inspect", task.id, missing or self._judged.get(task.id, "look round it"))
            self._log.enter("inspecting", f"{task.id}: {candidate.id}")
            yield from self._circle(candidate, task)
            if not task.active:
                return
            if not self._missing(candidate, task):
                yield from self._look_round(candidate, task)
                return
            task.dismissed.add(candidate.number)
            self._log.decide("dismiss", task.id, f"{candidate.id}: {self._missing(candidate, task)}")

    def _circle(self, target: Track, task: Task) -> Steps[None]:
        """Fly round a target, looking at it, until the task is settled or the round is complete."""
        center = (target.east_m, target.north_m)
        path = ring(center, self._ring_radius_m(), bearing_rad(center, self._place))

        def settled() -> bool:
            return not task.active

        if (yield from self._follow([self._place, path[0]], task, self._flight.speed_mps, facing=target, until=settled)):
            yield from self._follow(path, task, self._settings.inspect_speed_mps, facing=target, until=settled)

    def _look_round(self, target: Track, task: Task) -> Steps[None]:
        """See enough of a target's surroundings for the policy to decide; what one sweep does not show stays unseen."""
        if self._judge(target).look:
            path = self._legs((target.east_m, target.north_m), self._policy.surroundings_m, bearing_rad(self._place, task.place))
            self._log.decide("look_round", task.id, f"sweep of {self._policy.surroundings_m:g} m, {length_m(path):.0f} m")
            yield from self._follow([self._place, *path], task, self._flight.speed_mps, until=lambda: not task.active)
        if task.active:
            self._say(task, target, self._judge(target))

    def _ring_radius_m(self) -> float:
        """Where the middle of the image lies on a target in the centre."""
        camera, height_m = self._eyes.camera, self._flight.height_m
        middle_m = camera.ahead_m(height_m)[1] if camera else height_m
        return min(max(middle_m, 0.3 * height_m), 2.0 * height_m)

    def _choose_withheld(self) -> Task | None:
        tasks = (task for task in self._planner.tasks.values() if task.withheld and not task.revisited)
        round_s = 2.0 * math.pi * self._ring_radius_m() / self._settings.inspect_speed_mps
        for task in self._planner.by_urgency(tasks, self._place):
            if self._planner.fits(self._place, self._vehicle.now_s, task, round_s):
                return task
        return None

    def _revisit(self, task: Task) -> Steps[None]:
        """Once more to a target whose mark was withheld: the bystanders may have gone."""
        task.revisited = True
        target = next((track for track in self._eyes.tracks if track.number == task.target), None)
        if target is None:
            return
        self._log.decide("revisit", task.id, "time is left to see whether the bystanders have gone")
        self._log.enter("inspecting", f"{task.id}: again")
        center = (target.east_m, target.north_m)
        path = ring(center, self._ring_radius_m(), bearing_rad(center, self._place))
        yield from self._follow([self._place, path[0]], task, self._flight.speed_mps, facing=target)
        clear = _Stopwatch(lambda: self._judge(target).mark)
        yield from self._follow(
            path,
            task,
            self._settings.inspect_speed_mps,
            facing=target,
            until=lambda: clear.runs_s(self._vehicle.now_s) > STILL_CLEAR_S,
        )
        judgement = self._judge(target)
        if judgement.mark and clear.runs_s(self._vehicle.now_s) > STILL_CLEAR_S:
            task.withheld = False
            self._say(task, target, judgement)
        else:
            self._log.decide("withhold_mark", task.id, f"still: {judgement.reason}")

    # Judging.

    def look(self) -> None:
        """Called after every frame: reports the target of the present task as soon as the policy is content."""
        if self._order is None:
            return
        for task in self._planner.tasks.values():
            if task.active and (candidate := self._candidate(task)) and not self._missing(candidate, task):
                judgement = self._judge(candidate)
                self._judged[task.id] = judgement.reason
                if not judgement.look:
                    self._say(task, candidate, judgement)

    def _candidate(self, task: Task) -> Track | None:
        """The track most likely to be what the intelligence speaks of."""
        about = task.intelligence
        within_m = about.uncertainty_m + self._settings.search_margin_m
        taken = {one.target for one in self._planner.tasks.values()} | task.dismissed
        found = [
            (-track.share(about.class_label) * track.confidence, track.number, track)
            for _, track in self._eyes.tracks.near(*task.place, within_m)
            if track.number not in taken and track.frames >= 2 and track.share(about.class_label) >= CANDIDATE_SHARE
        ]
        return min(found)[2] if found else None

    def _missing(self, candidate: Track, task: Task) -> str:
        assert self._order is not None
        return missing_for(candidate, task.intelligence.class_label, self._order, self._settings)

    def _judge(self, target: Track) -> Judgement:
        return self._policy.judge(target, self._eyes.tracks, self._vehicle.now_s, self._eyes.unseen_share)

    def _say(self, task: Task, target: Track, judgement: Judgement) -> None:
        task.state, task.target, task.withheld = "reported", target.number, not judgement.mark
        evidence = f"{target.confidence:.2f} from {target.frames} frames over {target.viewpoint_deg:.0f} degrees"
        self._log.decide("report", task.id, f"{target.label} identified: {evidence}")
        self._log.decide("mark" if judgement.mark else "withhold_mark", task.id, judgement.reason)
        self._log.report(
            TargetReport(
                id=f"{task.id[:57]}-target",
                time_s=self._log.now_s,
                class_label=target.label,
                east_m=round(target.east_m, 2),
                north_m=round(target.north_m, 2),
                confidence=round(target.confidence, 4),
                mark=judgement.mark,
                intelligence_id=task.id,
                bystanders_seen=judgement.bystanders_seen,
                nearest_bystander_m=judgement.nearest_bystander_m,
                evidence=tuple(round(moment_s, 3) for moment_s in target.exposures),
                reason=judgement.reason,
            )
        )

    # Flying.

    def _follow(
        self,
        path: Sequence[Place],
        task: Task | None,
        speed_mps: float,
        *,
        facing: Track | None = None,
        until: Callable[[], bool] = lambda: False,
    ) -> Steps[bool]:
        """Fly along a path at mission height; False when a more urgent task came up meanwhile. Raises TurnBack."""
        walk = Walk(path)
        while not until():
            yield from self._keep_control()
            walk.go(self._place, WINDOW_M)
            if walk.left_m < ARRIVED_M:
                return True
            self._aim_along(walk, speed_mps, facing)
            if task is not None and task.active and (urgent := self._planner.more_urgent_than(task)):
                task.state = "waiting"
                self._log.decide("divert", task.id, f"{urgent.id} is more urgent")
                return False
            yield
        return True

    def _aim_along(self, walk: Walk, speed_mps: float, facing: Track | None) -> None:
        """A point a little ahead on the path, and the speed along it fed forward, so that no way is lost to caution."""
        speed_mps = walk.speed_mps(speed_mps)
        ahead_m = walk.done_m + LEAD_S * speed_mps
        at, (east, north) = walk.at(ahead_m), walk.direction(ahead_m)
        far = walk.at(ahead_m + LOOK_M)
        look_at = far if facing is None else (facing.east_m, facing.north_m)
        self._vehicle.setpoint = Setpoint(
            *at, self._flight.height_m, self._yaw_to(look_at), (east * speed_mps, north * speed_mps)
        )

    def _yaw_to(self, look_at: Place) -> float:
        """Direction to a place; the present one when it is right below."""
        return bearing_rad(self._place, look_at) if math.dist(self._place, look_at) > 4.0 else self._pose.yaw_rad

    def _keep_control(self, *, home_bound: bool = False) -> Steps[None]:
        """Look whether the flight can go on. Raises TurnBack with the reason when it cannot."""
        vehicle = self._vehicle
        if vehicle.silent:
            raise TurnBack("the autopilot has fallen silent")
        if not vehicle.armed:
            raise TurnBack("the autopilot disarmed by itself")
        if vehicle.mode != OFFBOARD:
            self._log.decide("retake", "", f"the autopilot left offboard control: {'; '.join(vehicle.texts[-2:])}")
            if vehicle.battery_fraction <= self._settings.min_battery or not (yield from vehicle.change_mode(OFFBOARD)):
                raise TurnBack("the autopilot took control and keeps it")
        if home_bound:
            return
        if vehicle.battery_fraction <= self._settings.min_battery:
            raise TurnBack(f"the battery is down to {vehicle.battery_fraction:.0%}")
        if self._planner.must_turn_back(self._place, vehicle.now_s):
            raise TurnBack("the time left is needed for the way home")

    def _come_down(self, reason: str) -> Steps[str]:
        """End early, by the means that are left: `complete` when the mission was flown as far as time allowed."""
        vehicle = self._vehicle
        if not vehicle.armed:
            self._log.decide("abort", "", reason)
            return "aborted"
        if vehicle.mode == OFFBOARD and not vehicle.silent:
            try:
                yield from self._go_home(reason)
                return "complete"
            except TurnBack as cause:
                reason = f"{reason}; {cause}"
        self._log.decide("abort", "", reason)
        self._log.enter("returning", reason)
        vehicle.setpoint = None
        yield from vehicle.change_mode(RTL)
        yield from self._wait_until_down()
        return "aborted"

    def _go_home(self, reason: str) -> Steps[None]:
        order, vehicle = self._order, self._vehicle
        assert order is not None
        self._log.decide("return", "", reason)
        self._log.enter("returning", reason)
        safe_m = min(self._settings.safe_height_m, self._flight.height_m)
        goal = self._home if order.return_home else self._place
        while math.dist(self._place, goal) > 1.5 or self._pose.height_m > safe_m + 2.0:
            yield from self._keep_control(home_bound=True)
            vehicle.setpoint = Setpoint(*goal, safe_m, self._yaw_to(goal))
            yield
        vehicle.setpoint = None
        self._log.enter("returning", "landing")
        yield from vehicle.change_mode(LAND)
        yield from self._wait_until_down()

    def _wait_until_down(self) -> Steps[None]:
        """Until the autopilot has disarmed; a landing that does not come is asked for again."""
        vehicle = self._vehicle
        asked_s = vehicle.now_s
        while vehicle.armed:
            if vehicle.now_s - asked_s > 90.0 and not vehicle.silent:
                asked_s = vehicle.now_s
                yield from vehicle.command(mavlink.MAV_CMD_NAV_LAND)
            yield

    # Where it is.

    @property
    def _pose(self) -> Pose:
        pose = self._vehicle.pose
        if pose is None:
            raise TurnBack("the autopilot does not say where it is")
        return pose

    @property
    def _place(self) -> Place:
        pose = self._pose
        return pose.east_m, pose.north_m

    @property
    def _home(self) -> Place:
        assert self._order is not None
        return self._order.home.east_m, self._order.home.north_m

    def _summary(self) -> str:
        if self._order is None:
            return ""
        tasks = sorted(self._planner.tasks.values(), key=lambda task: task.id)
        return ", ".join(f"{task.id} {'withheld' if task.withheld else task.state}" for task in tasks)[:2000]


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
