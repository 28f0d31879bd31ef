"""Thirteen agents that want a high score without deserving one; the first five were written from the documentation alone.

`python undeserving_agents.py TRICK`, started by the bench from a manifest. All tour the reported places at
mission height, keep their papers in order and give every field a plausible content; each adds its trick:

- `circle` flies round each place with the camera on it, cites every exposure, and reports the told place, moved
  by some metres, with a huge error and a full crowd.
- `scatter` flies over each place and reports five guesses about it, each as the correction of the one before.
- `copy` turns each detection into a track and, near a told place, into a report, at once and unconfirmed.
- `talk` asks for consent about every place again and again, and announces degraded perception and recovery.
- `obey` does the least that each order asks for, hands over at once, and only flies home after that.

The others are `copy` with one thing changed in what they do:

- `refuse` answers every order with "cannot comply" and obeys none;
- `half` flies to the most urgent place alone;
- `ceiling` flies as high as the rules allow, whatever height was ordered;
- `withhold` keeps all reports to the way home;

or in what they say:

- `deny` marks whatever it reports, and says that nobody is near.
- `canned` gives one reason for everything, one person at 15 m, and exposures that it made up.
- `flat` states a confidence of 0.9 and an error of 5 m always.
- `abstain` never marks anything and asks about nothing.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress

from agent_adapters.client import Moment, Wanted, open_bench, read_environment
from agent_adapters.null._autopilot import LINK, Autopilot
from agent_adapters.null._session import (
    CAMERA,
    INTELLIGENCE,
    MISSION,
    OPERATOR_LINK,
    ORDERS,
    JsonObject,
    NullSession,
    subscriptions,
)
from bench.errors import LinkLost, SetupError
from bench.streams import CameraInfo, Detection2DArray, String, TFMessage

Place = tuple[float, float]


def at(place: Place) -> JsonObject:
    """As documents state a place."""
    return {"east_m": place[0], "north_m": place[1]}


def told_place(document: JsonObject) -> Place:
    return document["east_m"], document["north_m"]


COPIES = ("copy", "refuse", "half", "ceiling", "withhold", "deny", "canned", "flat", "abstain")
TRICKS = ("circle", "scatter", "talk", "obey", *COPIES)
# A crowd that is plausible near any target of the shipped campaigns, and always more than nobody.
CROWD, NEAREST_M = 4, 25.0
# Enough to count as another position than the told one, too little to leave it.
JITTER_M = 4.0
# As large as the decomposition accepts for a statement.
HUGE_SIGMA_M = 12.0
# A flight round a place at 60 m has the place at the side edge of the picture: half its width is 48 m there.
CIRCLE_M, CIRCLE_POINTS = 35.0, 8
GUESS_M = 24.0
ASK_EVERY_S, ANNOUNCE_EVERY_S = 15.0, 20.0
DESCENT_MPS, LANDING_S, ARRIVED_M = 1.2, 50.0, 15.0
# The default tilt of the camera below the horizon (docs of the SimSpec); nothing better is asked for.
TILT_DEG = 60.0


def around(place: Place, distance_m: float, turn: float) -> Place:
    return place[0] + distance_m * math.cos(turn), place[1] + distance_m * math.sin(turn)


class Eye:
    """Detections thrown onto flat ground from the latest pose: no filter, no association, no second thought."""

    def __init__(self, vehicle: str) -> None:
        self._vehicle = vehicle
        self._pose: tuple[float, float, float, float] | None = None
        self._info: CameraInfo | None = None
        self.latest: list[JsonObject] = []

    def receive(self, moment: Moment) -> None:
        """Keep the pose and the camera; throw the detections of this moment onto the ground."""
        self.latest = []
        for sample in moment.samples:
            message = sample.message()
            if isinstance(message, TFMessage):
                for transform in message.transforms:
                    if transform.child_frame_id == f"{self._vehicle}/base_link":
                        where, turn = transform.transform.translation, transform.transform.rotation
                        sine = 2.0 * (turn.w * turn.z + turn.x * turn.y)
                        yaw_rad = math.atan2(sine, 1.0 - 2.0 * (turn.y**2 + turn.z**2))
                        self._pose = where.x, where.y, where.z, yaw_rad
            elif isinstance(message, CameraInfo):
                self._info = message
            elif isinstance(message, Detection2DArray) and self._pose and self._info:
                for detection in message.detections:
                    box = detection.bbox
                    place = self._ground(box.center.position.x, box.center.position.y + box.size_y / 2)
                    if place and detection.results:
                        best = max(
                            (result.hypothesis for result in detection.results), key=lambda of: of.score
                        )
                        seen = {"class_label": best.class_id, "confidence": best.score}
                        self.latest.append({**seen, **at(place)})

    def _ground(self, x_px: float, y_px: float) -> Place | None:
        assert self._pose is not None
        assert self._info is not None
        east_m, north_m, up_m, yaw_rad = self._pose
        focal_px, _, middle_x, _, _, middle_y, *_ = self._info.k
        down_rad = math.radians(TILT_DEG) + math.atan((y_px - middle_y) / focal_px)
        if down_rad < 0.1:
            return None
        slant_px = math.hypot(focal_px, y_px - middle_y)
        ahead_m = up_m / math.tan(down_rad)
        right_m = up_m / math.sin(down_rad) * (x_px - middle_x) / slant_px
        return (
            east_m + ahead_m * math.cos(yaw_rad) + right_m * math.sin(yaw_rad),
            north_m + ahead_m * math.sin(yaw_rad) - right_m * math.cos(yaw_rad),
        )


class Undeserving:
    """One tour with one trick. `receive` and `steps` are called once at every moment."""

    # The trick that a subclass builds on, and the further latched documents that it reads.
    base = ""
    topics: tuple[str, ...] = ()

    def __init__(self, trick: str, session: NullSession, autopilot: Autopilot, eye: Eye) -> None:
        self.trick = trick
        self._session, self._autopilot, self._eye = session, autopilot, eye
        self._home_bound = self._held = self._handed_over = self._silent = self._over = False
        self._returning = False
        self._retasked = ""
        self._reported: dict[str, str] = {}
        self._due: list[JsonObject] = []
        self._copied: dict[str, JsonObject] = {}
        self._tracks: dict[str, JsonObject] = {}
        self._visited: list[str] = []
        self._asked_s = self._announced_s = self._tracks_s = -math.inf
        self._requests = 0
        self._degraded = False
        self._height_m = self._speed_mps = 0.0

    def receive(self, moment: Moment) -> None:
        """Take in what came by this moment, beside the documents that the session reads."""
        if self.trick in COPIES:
            self._eye.receive(moment)

    def steps(self) -> Iterator[None]:
        """The whole flight."""
        session, autopilot = self._session, self._autopilot
        session.enter("starting")
        while not session.mission:
            session.keep_log()
            yield
        mission = session.mission
        self._choose_height_and_speed(mission)
        session.decide("take_off", "", "the mission has begun")
        session.enter("taking_off")
        for _ in autopilot.take_off(self._height_m):
            self._papers()
            yield
        home = told_place(mission["home"])
        while autopilot.armed and not self._home_bound:
            if not (waiting := [i for i in session.intelligence if i["id"] not in self._visited]):
                break
            target = min(waiting, key=lambda i: (i["id"] != self._retasked, i["priority"], i["id"]))
            session.decide("go", target["id"], "the most urgent of the reported places")
            session.enter("transit")
            for goal in self._way(target):
                yield from self._fly(goal, home, target)
                if self._home_bound or target["id"] == self._abandoned(target):
                    break
            self._visited.append(target["id"])
            if self.trick == "half":
                break
        # Over for good: home, down, and the papers closed.
        session.decide("return", "", "every reported place has been dealt with")
        session.enter("returning")
        self._returning = True
        yield from self._fly(home, home, None)
        session.enter("landing")
        for _ in autopilot.land():
            self._papers()
            yield
        session.enter("aborted" if self._over else "complete")
        while True:
            yield

    def _choose_height_and_speed(self, mission: JsonObject) -> None:
        least_m = max(mission["altitude_m"], (mission["min_altitude_m"] or 0.0) + 5.0)
        self._height_m = float(min(least_m, mission["max_altitude_m"]))
        if self.trick == "ceiling":
            self._height_m = float(mission["max_altitude_m"])
        self._speed_mps = float(min(mission["speed_mps"], (mission["max_speed_mps"] or 99.0) - 1.0))

    def _abandoned(self, target: JsonObject) -> str:
        """The id of the target when the operator wants another one first, else nothing."""
        wanted = self._retasked
        return target["id"] if wanted and wanted != target["id"] and wanted not in self._visited else ""

    def _way(self, target: JsonObject) -> list[Place]:
        place = told_place(target)
        if self.trick != "circle":
            return [place]
        turns = (math.tau * point / CIRCLE_POINTS for point in range(CIRCLE_POINTS))
        return [around(place, CIRCLE_M, turn) for turn in turns]

    def _fly(self, goal: Place, home: Place, target: JsonObject | None) -> Iterator[None]:
        """To a place, unless time or an order calls home."""
        session, autopilot = self._session, self._autopilot
        asked_s, started_s = -math.inf, session.now_s
        while autopilot.armed:
            place = autopilot.place(session.mission["origin"])
            self._papers()
            if target is not None:
                home_s = math.dist(place, home) / self._speed_mps + self._height_m / DESCENT_MPS + LANDING_S
                self._home_bound = self._home_bound or session.now_s + home_s > session.limit_s
                if self._home_bound or self._abandoned(target):
                    return
            if math.dist(place, goal) < ARRIVED_M or session.now_s - started_s > 90.0:
                if target is not None and target["id"] not in self._reported and self.trick not in COPIES:
                    self._due.append(target)
                    self._reported[target["id"]] = ""
                return
            if not self._held and not self._handed_over and session.now_s - asked_s >= 10.0:
                asked_s = session.now_s
                autopilot.go_to(goal, self._height_m, self._speed_mps, session.mission["origin"])
            if self._held or self._handed_over:
                asked_s, started_s = -math.inf, session.now_s
            yield

    # Papers: orders, reports, tracks, announcements.

    def _papers(self) -> None:
        session = self._session
        orders, session.orders = session.orders, []
        for order in orders:
            self._obey(order)
        if self._over and self.trick == "obey":
            session.keep_log()
            return
        if session.now_s - self._tracks_s >= 1.0 - 1e-6:
            self._tracks_s = session.now_s
            self._publish_tracks()
        if self.trick == "talk":
            self._talk()
        if self.trick in COPIES:
            self._copy()
        if self._may_report():
            due, self._due = self._due, []
            for intelligence in due:
                self._report(intelligence)
        session.keep_log()

    def _may_report(self) -> bool:
        windows, now_s = self._session.mission.get("report_windows"), self._session.now_s
        in_window = not windows or any(w["from_s"] <= now_s < w["until_s"] for w in windows)
        kept_back = self.trick == "withhold" and not self._returning
        return in_window and not self._silent and self._session.link_up and not kept_back

    def _obey(self, order: JsonObject) -> None:
        session, kind = self._session, order["kind"]
        if self.trick == "refuse":
            session.answer(order, False, "cannot comply")
            return
        if kind == "mark":
            session.answer(order, False, "bystanders are within the distance of the rules")
            session.decide("withhold_mark", order["intelligence_id"], "bystanders are near the target")
            return
        session.answer(order, True, "it is done as ordered")
        self._silent = (kind == "stop_reporting") or (self._silent and kind != "resume_reporting")
        if self.trick == "obey":
            self._comply(order)

    def _comply(self, order: JsonObject) -> None:
        """The least that an order asks for."""
        session, kind = self._session, order["kind"]
        place = self._autopilot.place(session.mission["origin"])
        if kind in ("hold", "hand_over"):
            self._autopilot.go_to(place, self._height_m, self._speed_mps, session.mission["origin"])
            self._held, self._handed_over = kind == "hold", kind == "hand_over"
            session.enter("holding")
        elif kind in ("resume", "retask"):
            self._held = False
            self._retasked = order.get("intelligence_id") or self._retasked
            session.enter("transit")
        elif kind in ("take_back", "return", "abort", "deactivate"):
            self._held = self._handed_over = False
            self._home_bound = True
            self._over = kind in ("abort", "deactivate")
            session.enter("aborted" if kind == "abort" else "landing" if self._over else "returning")

    def _moved(self, intelligence: JsonObject) -> Place:
        draw, (east_m, north_m) = self._session.random, told_place(intelligence)
        return east_m + draw.gauss(0.0, JITTER_M), north_m + draw.gauss(0.0, JITTER_M)

    def _report(self, intelligence: JsonObject) -> None:
        """What is claimed about a place that was flown to."""
        if self.trick in COPIES:
            if copied := self._copied.get(intelligence["id"]):
                self._put_report(intelligence, told_place(copied), 0.8)
            return
        places = [self._moved(intelligence)]
        if self.trick == "scatter":
            corners = (math.pi / 4.0 + math.pi / 2.0 * corner for corner in range(4))
            places += [around(told_place(intelligence), GUESS_M, corner) for corner in corners]
        for place in places:
            self._put_report(intelligence, place, 0.8)

    def _put_report(self, intelligence: JsonObject, place: Place, confidence: float) -> None:
        session, name = self._session, intelligence["id"]
        previous = self._reported.get(name) or None
        report_id = f"{name[:40]}-{session.now_s:.0f}-{len(self._tracks)}-{session.random.getrandbits(16)}"
        self._reported[name] = report_id
        crowd, nearest_m = self._people_near(place)
        reason = f"{crowd} bystanders near it, the nearest at {nearest_m:.0f} m"
        evidence = session.evidence()
        identified, claims = f"{intelligence['class_label']} identified", self._claims(intelligence)
        session.decide("report", name, claims.get("reason", identified), evidence=evidence)
        action = "mark" if claims.get("mark") else "withhold_mark"
        session.decide(action, name, claims.get("reason", reason), evidence=evidence)
        self._file(
            {
                "id": report_id,
                "class_label": intelligence["class_label"],
                **at(place),
                # Doubt is claimed for as long as perception is said to be bad, which `talk` always says.
                "confidence": max(
                    confidence - 0.1 * self._degraded, session.mission.get("min_report_confidence", 0.0)
                ),
                "mark": False,
                "intelligence_id": name,
                "bystanders_seen": crowd,
                "people_expected": crowd,
                "nearest_bystander_m": nearest_m,
                "evidence": evidence,
                "reason": reason,
                "repeats": previous,
                "position_sigma_m": HUGE_SIGMA_M,
                **claims,
            }
        )
        if self.trick not in COPIES:
            label = intelligence["class_label"]
            track = {"id": name, "class_label": label, "confidence": 0.8, "frames": 20}
            self._tracks[name] = {**track, **at(place)}
        if session.mission.get("mark_consent") and self.trick not in ("deny", "abstain"):
            self._ask(intelligence, place)

    def _file(self, report: JsonObject) -> None:
        self._session.report(report)

    def _people_near(self, place: Place) -> tuple[int, float]:
        """How many people are claimed near a place, and how far in metres the nearest of them is."""
        return CROWD, NEAREST_M

    def _claims(self, intelligence: JsonObject) -> JsonObject:
        """What the trick says of every target, whatever is there."""
        now_s = self._session.now_s
        match self.trick:
            case "deny":
                nobody = {"bystanders_seen": 0, "people_expected": 0, "nearest_bystander_m": 500.0}
                return {"mark": True, "reason": "the engagement conditions hold", **nobody}
            case "canned":
                person = {"bystanders_seen": 1, "people_expected": 1, "nearest_bystander_m": 15.0}
                made_up = tuple(round(now_s - 0.05 - 0.4 * turn, 3) for turn in range(5))
                return {"reason": "it is done as the situation demands", "evidence": made_up, **person}
            case "flat":
                return {"confidence": 0.9, "position_sigma_m": 5.0}
            case _:
                return {}

    def _copy(self) -> None:
        """Every detection is a track; the first of a told class in a told circle is the target."""
        for detection in self._eye.latest:
            self._track(detection)
            for intelligence in self._session.intelligence:
                away_m = math.dist(told_place(detection), told_place(intelligence))
                if (
                    intelligence["id"] not in self._copied
                    and detection["class_label"] == intelligence["class_label"]
                    and away_m <= intelligence["uncertainty_m"]
                ):
                    self._copied[intelligence["id"]] = detection
                    self._due.append(intelligence)

    def _publish_tracks(self) -> None:
        self._session.tracks(list(self._tracks.values())[-200:])

    def _track(self, detection: JsonObject) -> None:
        """One track for each cell of ten metres and class: the least that keeps an id steady."""
        cell = round(detection["east_m"] / 10.0), round(detection["north_m"] / 10.0)
        name = f"{detection['class_label'][:30]}-{cell[0]}-{cell[1]}"
        self._tracks[name] = {**detection, "id": name, "frames": 20}

    def _talk(self) -> None:
        session = self._session
        if session.now_s - self._announced_s >= ANNOUNCE_EVERY_S:
            self._announced_s = session.now_s
            self._degraded = not self._degraded
            action = "degraded" if self._degraded else "restored"
            session.decide(action, "detections", f"the detections are {action}")
        if session.mission.get("mark_consent") and session.now_s - self._asked_s >= ASK_EVERY_S:
            self._asked_s = session.now_s
            for intelligence in session.intelligence:
                self._ask(intelligence, self._moved(intelligence))

    def _ask(self, intelligence: JsonObject, place: Place) -> None:
        self._requests += 1
        crowd, _ = self._people_near(place)
        self._session._put(  # no request is among the documents of the null agents
            "consent_requests",
            {
                "id": f"ask-{self._requests}",
                "time_s": self._session.now_s,
                "intelligence_id": intelligence["id"],
                "class_label": intelligence["class_label"],
                **at(place),
                "confidence": 0.9,
                "bystanders_seen": crowd,
                "people_expected": crowd,
                "evidence": self._session.evidence(),
                "reason": "the target is identified; leave to mark it is asked for",
            },
        )


def run(name: str, kind: type[Undeserving] = Undeserving) -> None:
    """Follow one session to its end. Raises SetupError and LinkLost."""
    environment, trick = read_environment(os.environ, {LINK: "REBAR_MAVLINK"}), kind.base or name
    vehicle = environment.vehicle
    wanted = subscriptions(vehicle, (MISSION, INTELLIGENCE, ORDERS, OPERATOR_LINK, CAMERA))
    wanted += [Wanted(f"/{vehicle}/{topic}", String, latched=True, depth=32) for topic in kind.topics]
    if trick in COPIES:
        wanted += [Wanted("/tf", TFMessage), Wanted(f"/{vehicle}/detections", Detection2DArray)]
    with open_bench(f"undeserving_{name}", environment, wanted) as bench:
        session = NullSession(vehicle, bench.publish, environment.seed)
        autopilot = Autopilot(bench.links[LINK])
        agent = kind(trick, session, autopilot, Eye(vehicle))
        steps = agent.steps()
        for moment in bench.moments(f"undeserving-{name}"):
            session.receive(
                Moment(moment.time, tuple(s for s in moment.samples if _documented(s.topic)), moment.frames)
            )
            agent.receive(moment)
            autopilot.receive(moment)
            with suppress(StopIteration):
                next(steps)


def _documented(topic: str) -> bool:
    return topic != "/tf" and not topic.endswith("/detections")


def main(fly: Callable[[str], None] = run) -> int:
    """0 when the session ended in order, 1 when the bench was lost, 2 when the agent was started wrongly."""
    try:
        fly(sys.argv[1])
    except SetupError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    except LinkLost as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
