"""The mission of the reference agent, with the shortest tour past targets whose places are known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import accumulate, combinations, pairwise, permutations

from bench.contracts import MissionOrder, OrderDocument
from bench.simspec import TARGET_ROLES, endangered_roles

from ..client import ARDUPILOT, PX4
from ..reference._log import Log
from ..reference._settings import Settings
from ..reference._steps import Steps
from ..reference._watch import Watch
from ..reference.flight._limits import HEIGHT_RULE_MARGIN_M
from ..reference.flight._paths import Place, bearing_rad, length_m
from ..reference.flight._piloted_vehicle import PilotedVehicle
from ..reference.mission._mission import SearchMission
from ..reference.mission._planner import SearchTask
from ..reference.perception._tracks import Track
from ._perception import TruthPerception
from ._pilot import OraclePilot
from ._policy import OracleFindings, OraclePolicy

# Sectors of 5 degrees: two looks whose sectors begin so far apart differ by more than the 20 degrees that
# `second_look` asks for, with one sector to spare.
SECOND_SIDE_DEG = 30.0
# How far apart the places of a path round a target are, and how far such a path goes round.
ARC_STEP_RAD, ARC_RAD = math.radians(10.0), math.radians(300.0)
# More tasks than this are taken by urgency: trying every order of them would take too long.
MAX_TOUR_TASKS = 6
# Faster than autopilots climb by default (PX4 3 m/s, ArduPilot 2.5): time that the mission needs elsewhere.
_CLIMB = {
    PX4: {"MPC_TKO_SPEED": 4.0, "MPC_Z_VEL_MAX_UP": 6.0, "MPC_Z_V_AUTO_UP": 6.0},
    ARDUPILOT: {"WPNAV_SPEED_UP": 600.0},
}
# So late it may leave the ground, for people near home to go away first: an order at 40 s has to find it farther than
# 40 m from home. Chosen, not measured.
LATEST_START_S = 21.0
# How much a report counts whose target another report has led to: it asks only for the visit. Chosen, not measured.
EMPTY_WEIGHT = 0.3
# Of the height: so near to a target, its direction changes fast and it is still in the picture. Chosen, not measured.
PASS_HEIGHTS = 0.7
# At least as high, but for so much above the mission height at most, and inside the rules: from 40 m the corner of the
# picture is 77 m away, so that nobody beyond 80 m is ever in it, and a gust takes it below the 40 m that
# `no_low_overflight` asks for; `height_kept` lets it be 5 m off. All of campaign full is flown at 50 m or more.
LEAST_HEIGHT_M, HIGHER_M = 50.0, 4.0
# From so low nobody is in clear view beyond 80 m except in the corners of the picture: it climbs by so much once, while
# somebody who is so far away is ahead of it, until it is so near. Chosen by the angle of the camera, 38 degrees below
# the horizon at the upper edge.
FAR_BELOW_M, FAR_CLIMB_M, FAR_FROM_M, FAR_TO_M = 48.0, 11.0, 66.0, 57.0
# Of the time in which the convoy drives: `convoy_accompanied` asks for 40 % with it. Chosen with room for the way.
SEARCH_SHARE = 0.45
# A person in view so lately is still in the published picture, which keeps people for 60 s.
PUBLISHED_S = 55.0
# Inside the edge of a reported circle by this much, for the agent's own error of place. Chosen, not measured.
REACHED_MARGIN_M = 5.0


class OracleMission(SearchMission):
    """The mission of the careful reference agent, with findings that are never wrong."""

    _eyes: TruthPerception
    _pilot: OraclePilot
    _findings: OracleFindings

    def __init__(
        self, vehicle: PilotedVehicle, eyes: TruthPerception, log: Log, watch: Watch, settings: Settings
    ) -> None:
        super().__init__(vehicle, eyes, log, watch, "bystander_aware", settings)
        self._truth, self._truth_tracks = eyes.truth, eyes.truth_tracks
        self._take_off_s: float | None = None
        self._visited: set[str] = set()  # tasks whose reported circle it has flown over
        # People whom the published picture has held while they were near a target.
        self._held: set[int] = set()
        self._passed_by: set[int] = set()  # people near a target to whom it has flown
        self._has_looked_far = False
        self._return_to: SearchTask | None = None  # ordered to go there once more, though all is done there

    def _prepare(self) -> Steps[None]:
        yield from super()._prepare()
        for name, value in _CLIMB[self._vehicle.kind].items():
            yield from self._vehicle.set_parameter(name, value)

    def _must_wait_on_the_ground(self) -> bool:
        if super()._must_wait_on_the_ground():
            return True
        now_s = self._vehicle.now_s
        if self._take_off_s is None:
            self._take_off_s = self._pilot.start_s(max(now_s, LATEST_START_S))
        return now_s < self._take_off_s

    def _work_through(self) -> Steps[None]:
        """First every target, by the shortest way to a clear view of it; then whoever is still unseen round one."""
        searched: set[str] = set()  # tasks
        passed: set[str] = set()  # kinds of actors
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
                done = lambda task=task: bool(  # noqa: E731
                    self._waiting() or self._must_join() or not self._unseen(task)
                )
                yield from self._follow([self._place, *path], task, self._pilot.speed_mps, until=done)
            # Kinds are few and stand still; people come near a target again and again.
            elif (track := self._unseen_kind(passed)) is not None:
                kind = self._kind(track)
                passed.add(kind)
                yield from self._pass_by(track, f"what else is there: {kind}")
            elif (track := self._unseen_neighbour()) is not None:
                self._passed_by.add(track.number)
                yield from self._pass_by(track, f"who comes near a target: {track.id}")
            elif (track := self._far_away()) is not None:
                yield from self._look_far(track)
            elif (withheld := self._choose_withheld()) is not None:
                yield from self._revisit(withheld)
            else:
                return

    def _waiting(self) -> bool:
        """Whether a report has come that is not dealt with: more search can wait."""
        return self._return_to is not None or bool(self._planner.waiting(self._place))

    def _more_to_do(self) -> bool:
        if self._orders.ended_by is not None:
            return False
        return self._unseen_neighbour() is not None or super()._more_to_do()

    def _unseen(self, task: SearchTask) -> list[Track]:
        """Actors in a reported circle that the camera has not had in view often enough to know them."""
        inside = self._eyes.tracks.within(*task.place, task.intelligence.uncertainty_m)
        return [track for _, track in inside if self._is_unseen(track)]

    def _choose_withheld(self) -> SearchTask | None:
        return None if self._pilot.must_leave() else super()._choose_withheld()

    def _unsearched(self, searched: set[str]) -> SearchTask | None:
        if self._pilot.must_leave() or self._must_join():
            return None
        tasks = (
            task for task in self._planner.tasks.values() if task.id not in searched and self._unseen(task)
        )
        for task in sorted(tasks, key=lambda task: (math.dist(self._place, task.place), task.id)):
            work_s = self._planner.travel_s(length_m(self._search_path(task)))
            if self._planner.fits(self._place, self._vehicle.now_s, task, work_s):
                return task
        return None

    def _must_join(self) -> bool:
        """Whether the convoy has driven for so long that the search for who else is there has to wait."""
        convoy, now_s = self._planner.convoy, self._vehicle.now_s
        return convoy is not None and convoy.moves_until(now_s) and convoy.share_driven(now_s) > SEARCH_SHARE

    def _escorted_to_look_at(self) -> Track | None:
        """Back at whoever of the convoy it has not seen enough of: ahead of it, it would see nobody of them."""
        escort = self._truth.simspec.mission.escort
        unseen = (
            track
            for track, member in self._truth_tracks.members
            if escort is not None and member.group == escort.group and self._is_unseen(track)
        )
        place = self._place
        return min(unseen, key=lambda track: math.dist(place, track.place), default=None)

    def _unseen_kind(self, passed: set[str]) -> Track | None:
        """The nearest actor that is no target, and of a kind of which none has been in view."""
        viewed = {self._kind(track) for track in self._others if not self._is_unseen(track)}
        return self._nearest_in_time(
            track for track in self._others if self._kind(track) not in viewed | passed
        )

    def _neighbours(self) -> list[Track]:
        """People who are near enough to a target now to forbid its mark."""
        assert self._order is not None
        members = self._truth_tracks.members
        targets = [
            (track, endangered_roles(member.role)) for track, member in members if member.role in TARGET_ROLES
        ]
        within_m = self._order.no_mark_within_m
        return [
            track
            for track, member in members
            if any(
                member.role in roles and track.distance_m(*target.place) < within_m
                for target, roles in targets
            )
        ]

    def _unseen_neighbour(self) -> Track | None:
        """The nearest person near a target whom the published picture has not held there.

        None while the convoy calls: an escort that is left for somebody is not taken up again.
        """
        convoy = self._planner.convoy
        if convoy is not None and convoy.calls(self._vehicle.now_s):
            return None
        return self._nearest_in_time(
            track for track in self._neighbours() if track.number not in self._held | self._passed_by
        )

    @property
    def _others(self) -> list[Track]:
        """Everybody and everything that is no target."""
        return [track for track, member in self._truth_tracks.members if member.role not in TARGET_ROLES]

    def _kind(self, track: Track) -> str:
        return self._truth.cast[track.number - 1].asset

    def _is_unseen(self, track: Track) -> bool:
        return self._truth_tracks.published.frames_of(track.number) < self._settings.min_frames

    def _nearest_in_time(self, tracks: Iterable[Track]) -> Track | None:
        """The nearest of those for which there is time to go there and come home."""
        if self._pilot.must_leave():
            return None
        place, now_s = self._place, self._vehicle.now_s
        within_reach = (
            track
            for track in tracks
            if now_s
            + self._planner.travel_s(math.dist(place, at := track.place))
            + self._planner.home_s(at)
            + self._settings.reserve_s
            < self._truth.simspec.mission.time_limit_s
        )
        return min(within_reach, key=lambda track: math.dist(place, track.place), default=None)

    def _far_away(self) -> Track | None:
        """The nearest person who is far enough for a look from afar, once, where it flies low."""
        if self._has_looked_far or self._pilot.height_m >= FAR_BELOW_M:
            return None
        place = self._place
        return self._nearest_in_time(
            track
            for track in self._others
            if track.number - 1 in self._truth.people and track.distance_m(*place) > FAR_FROM_M
        )

    def _look_far(self, track: Track) -> Steps[None]:
        self._has_looked_far = True
        assert self._order is not None
        height_m = self._pilot.height_m
        self._pilot.height_m = min(height_m + FAR_CLIMB_M, self._order.max_altitude_m - HEIGHT_RULE_MARGIN_M)
        self._log.enter("searching", f"who is far off: {track.id}")
        has_come = lambda: track.distance_m(*self._place) < FAR_TO_M  # noqa: E731
        way = [self._place, track.place]
        try:
            yield from self._pilot.follow(way, self._pilot.speed_mps, facing=track, until=has_come)
        finally:
            self._pilot.height_m = height_m

    def _pass_by(self, track: Track, text: str) -> Steps[None]:
        self._log.enter("searching", text)
        since_s = self._vehicle.now_s
        last_s_of = self._truth_tracks.published.last_s_of

        def done() -> bool:
            viewed = last_s_of(track.number) > since_s and not self._is_unseen(track)
            return viewed or self._waiting() or self._pilot.must_leave()

        way = [self._place, track.place]
        yield from self._pilot.follow(way, self._pilot.speed_mps, facing=track, until=done)

    # Which target is next.

    def _choose(self) -> SearchTask | None:
        """The first of the shortest tour, which keeps the order of priority of what was told at the same time."""
        tasks = list(self._servable())
        if not tasks or tasks[0].ordered or len(tasks) > MAX_TOUR_TASKS:
            return tasks[0] if tasks else None
        tours = (tour for tour in permutations(tasks) if _in_order(self._with_targets(tour)))
        return min(tours, key=self._tour_cost_m)[0]

    def _with_targets(self, tasks: Sequence[SearchTask]) -> list[SearchTask]:
        """Those whose report is about somebody whom no other report has led to."""
        return [task for task in tasks if self._findings.target_in_truth(task) is not None]

    def _tour_cost_m(self, tour: Sequence[SearchTask]) -> float:
        """How far it is to each, summed: what comes first costs all that comes after it."""
        places, with_targets = [self._place, *(self._goal(task) for task in tour)], self._with_targets(tour)
        way_m = accumulate(self._pilot.way_m(a, b) for a, b in pairwise(places))
        return sum(
            apart_m * (1.0 if task in with_targets else EMPTY_WEIGHT)
            for task, apart_m in zip(tour, way_m, strict=True)
        )

    def _goal(self, task: SearchTask) -> Place:
        target = self._findings.target_in_truth(task)
        return task.place if target is None else target.place

    def _diverted(self, task: SearchTask) -> bool:
        """Only an order of the operator makes it leave a target that it is on its way to, and an interruption makes it
        choose again; what comes after the targets ends when it has to be home.
        """
        if not task.active and self._pilot.must_leave():
            return True
        if task.active and self._pilot.interrupted:
            self._pilot.interrupted, task.state = False, "waiting"
            return True
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
        published, since_s = self._truth_tracks.published, self._vehicle.now_s - PUBLISHED_S
        self._held |= {
            track.number
            for track in self._neighbours()
            if published.last_s_of(track.number) > since_s and not self._is_unseen(track)
        }

    def _reached_m(self, task: SearchTask) -> float:
        return max(task.intelligence.uncertainty_m - REACHED_MARGIN_M, REACHED_MARGIN_M)

    def _work_on(self, task: SearchTask) -> Steps[None]:
        task.state = "active"
        target = self._findings.target_in_truth(task)
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
            task.enough = True  # whoever is unseen by now stays so
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
        center, radius_m = target.place, PASS_HEIGHTS * self._pilot.height_m
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

    def _new_pilot(self, order: MissionOrder) -> OraclePilot:
        ceiling_m = order.max_altitude_m - HEIGHT_RULE_MARGIN_M
        height_m = max(order.altitude_m, min(LEAST_HEIGHT_M, order.altitude_m + HIGHER_M, ceiling_m))
        return OraclePilot(replace(order, altitude_m=height_m), self._vehicle, *self._shared, careful=True)

    def _new_findings(self, order: MissionOrder) -> OracleFindings:
        policy = OraclePolicy(order, self._settings, self._truth)
        return OracleFindings(order, policy, self._planner, *self._shared)


def _in_order(tour: Sequence[SearchTask]) -> bool:
    """Whether what was told at the same time is dealt with by its priority."""
    return not any(
        first.told_s == second.told_s and first.intelligence.priority > second.intelligence.priority
        for first, second in combinations(tour, 2)
    )
