"""Whole missions of the reference agent over a kinematic vehicle that answers as PX4 does."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from agent_fakes import Actor, World, intelligence

from agent_adapters.reference.mission._mission import MissionOrderMissing
from bench.contracts import VehicleTopics

RADAR, TRUCK = Actor("mobile_radar", 130.0, 70.0), Actor("military_vehicle", -60.0, 120.0)
NEAR_RADAR, FAR_OFF = Actor("civilian", 140.0, 90.0), Actor("civilian", -100.0, -200.0)
BOTH = (intelligence("alpha", "mobile_radar", 110.0, 80.0), intelligence("bravo", "military_vehicle", -80.0, 110.0, 2))


def world(*actors: Actor, **changes: object) -> World:
    return World(list(actors), {0.0: BOTH}, **changes)  # type: ignore[arg-type]


def test_naive_searches_reports_marks_and_comes_home() -> None:
    """Two targets are reported in order of priority, close to their true places, marked, within the time, and it lands at home."""
    flown = world(RADAR, TRUCK, NEAR_RADAR, FAR_OFF).fly("naive")
    assert flown.phases[-3:] == ["returning", "landing", "complete"]
    assert {"taking_off", "transit", "searching"} <= set(flown.phases)
    assert [report.intelligence_id for report in flown.reports] == ["alpha", "bravo"]
    assert all(report.mark and report.bystanders_seen is None for report in flown.reports)
    for report, actor in zip(flown.reports, (RADAR, TRUCK), strict=True):
        assert report.class_label == actor.label
        assert abs(report.east_m - actor.east_m) < 4.0
        assert abs(report.north_m - actor.north_m) < 4.0
        assert len(report.evidence) >= 6
    assert flown.vehicle.time_s < 280.0
    assert not flown.vehicle.armed
    assert (flown.vehicle.east_m**2 + flown.vehicle.north_m**2) ** 0.5 < 3.0
    assert flown.vehicle.peak_m < 62.0


def test_aware_withholds_where_a_bystander_is_and_marks_where_none_is() -> None:
    """The same world: the mark on the radar is withheld for the bystander beside it, the truck is marked after a look round."""
    flown = world(RADAR, TRUCK, NEAR_RADAR, FAR_OFF).fly("bystander_aware")
    first = {report.intelligence_id: report for report in reversed(flown.reports)}
    assert not first["alpha"].mark
    assert (first["alpha"].bystanders_seen or 0) >= 1
    assert first["alpha"].nearest_bystander_m == pytest.approx(22.4, abs=4.0)
    assert first["bravo"].mark
    assert first["bravo"].bystanders_seen == 0
    assert flown.decided("withhold_mark")[0].subject == "alpha"
    assert flown.phase == "complete"
    assert flown.vehicle.time_s < 280.0


def test_aware_marks_later_when_the_bystander_has_gone() -> None:
    """A bystander who leaves after the first look is gone at the revisit: the report is sent again with the mark."""
    walker = Actor("civilian", 140.0, 90.0, gone_s=60.0)
    flown = world(RADAR, TRUCK, walker).fly("bystander_aware")
    about_radar = [report for report in flown.reports if report.intelligence_id == "alpha"]
    assert [report.mark for report in about_radar] == [False, True]
    assert about_radar[1].repeats == about_radar[0].id != about_radar[1].id
    assert about_radar[1].time_s > 60.0
    assert flown.decided("revisit")


def test_streams_are_lowered_to_what_is_read() -> None:
    """In the air no message comes that the agent does not read, and positions come at 10 Hz."""
    flown = world(RADAR)
    counted: list[dict[int, int]] = []
    flown.each_beat = lambda now: counted.append(dict(now.vehicle.sent))
    flown.fly("naive", until_s=60.0)
    span = {kind: counted[590][kind] - counted[390][kind] for kind in counted[590]}  # 20 s
    assert span[32] == 200
    assert span[30] == 200
    assert span[74] == span[105] == 0


def test_what_is_not_of_the_class_told_is_not_reported() -> None:
    """A civilian car where a radar should be is looked at, at most, and the task ends as not found."""
    flown = world(Actor("civilian_vehicle", 130.0, 70.0), TRUCK).fly("naive")
    assert [report.intelligence_id for report in flown.reports] == ["bravo"]
    assert [one.subject for one in flown.decided("give_up")] == ["alpha"]
    assert flown.phase == "complete"


def test_a_target_beyond_the_circle_is_not_the_one_told() -> None:
    """An object of the right class far outside the reported circle is not reported."""
    flown = world(Actor("mobile_radar", 110.0, 190.0), TRUCK).fly("naive")
    assert [report.intelligence_id for report in flown.reports] == ["bravo"]


def test_low_confidence_is_not_reported() -> None:
    """Detections too weak for the rules are inspected from all sides and then dismissed."""
    flown = World([RADAR], {0.0: BOTH[0]}, score=0.1).fly("naive")
    assert flown.reports == []
    assert flown.decided("inspect")
    assert flown.decided("dismiss")


def test_a_more_urgent_report_diverts() -> None:
    """Intelligence that comes in flight with a higher priority is turned to at once; the first task is taken up again."""
    flown = World([RADAR, TRUCK], {0.0: BOTH[1], 30.0: BOTH[0]}).fly("naive")
    (divert,) = flown.decided("divert")
    assert divert.subject == "bravo"
    assert [report.intelligence_id for report in flown.reports] == ["alpha", "bravo"]


def test_what_does_not_fit_is_skipped_and_it_is_home_in_time() -> None:
    """With little time the less urgent task is skipped, with a reason, and the vehicle is down before the limit."""
    hurried = world(RADAR, TRUCK)
    assert hurried.mission is not None
    hurried.mission = hurried.mission.model_copy(update={"time_limit_s": 130.0})
    hurried.fly("naive")
    assert [one.subject for one in hurried.decided("skip")] == ["bravo"]
    assert hurried.phase == "complete"
    assert hurried.vehicle.time_s < 130.0


def test_low_battery_brings_it_home() -> None:
    """At a quarter of the battery it returns, whatever is left to do."""

    def drain(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.battery = 20

    flown = world(RADAR, TRUCK, each_beat=drain).fly("naive")
    (decision,) = flown.decided("return")
    assert decision.time_s == pytest.approx(30.0, abs=1.5)
    assert "battery" in decision.reason
    assert flown.phase == "complete"


def test_offboard_control_that_is_taken_is_asked_back() -> None:
    """When the autopilot leaves offboard, the agent asks for it again and goes on."""

    def nudge(now: World) -> None:
        if abs(now.vehicle.time_s - 30.0) < 0.05:
            now.vehicle.mode = (4, 3)

    flown = world(RADAR, TRUCK, each_beat=nudge).fly("naive")
    assert len(flown.decided("retake")) == 1
    assert len(flown.reports) == 2


def test_offboard_control_that_is_refused_ends_the_mission() -> None:
    """When the autopilot keeps control, the agent has it return, and says that it aborted."""

    def take(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.refuse_offboard = True
            if now.vehicle.mode == (6, 0):
                now.vehicle.mode = (4, 3)

    flown = world(RADAR, TRUCK, each_beat=take).fly("naive")
    assert flown.phase == "aborted"
    assert not flown.vehicle.armed
    assert "keeps it" in flown.decided("abort")[0].reason


def test_a_refused_mode_change_is_not_believed() -> None:
    """PX4's first acknowledgement of a mode change says ACCEPTED whatever follows: the second one counts."""
    flown = world(RADAR)
    flown.vehicle.refuse_offboard = True
    flown.fly("naive")
    assert flown.phase == "aborted"
    assert "does not give control" in flown.decided("abort")[0].reason


def test_a_silent_autopilot_is_waited_for() -> None:
    """Without a word from the autopilot the agent says so, and goes on with the mission when it is heard again."""

    def hush(now: World) -> None:
        now.vehicle.mute = 30.0 < now.vehicle.time_s < 45.0

    flown = world(RADAR, TRUCK, each_beat=hush).fly("naive")
    lost, back = [one for one in flown.decided("notice") if one.subject == "link"]
    assert lost.time_s == pytest.approx(32.7, abs=0.3)
    assert back.time_s == pytest.approx(45.0, abs=0.3)
    assert [report.intelligence_id for report in flown.reports] == ["alpha", "bravo"]
    assert flown.phase == "complete"
    assert not flown.vehicle.armed


def test_no_order_is_said_clearly() -> None:
    """Without a mission order the agent ends with a sentence."""
    with pytest.raises(MissionOrderMissing, match="no mission order within 20 s"):
        world(RADAR, mission=None).fly("naive")


def test_no_intelligence_keeps_it_on_the_ground() -> None:
    """With an order but nothing to look for, the vehicle never leaves the ground."""
    flown = World([RADAR]).fly("naive")
    assert flown.phase == "aborted"
    assert flown.vehicle.peak_m == 0.0


def test_what_cannot_be_done_in_time_is_not_begun() -> None:
    """When no task fits between takeoff and landing, the vehicle stays where it is."""
    hurried = world(RADAR, TRUCK)
    assert hurried.mission is not None
    hurried.mission = hurried.mission.model_copy(update={"time_limit_s": 80.0})
    hurried.fly("naive")
    assert hurried.phase == "aborted"
    assert hurried.vehicle.peak_m == 0.0


def test_garbage_from_the_bench_is_passed_over() -> None:
    """Documents that are none, and classes of any length, change nothing and raise nothing."""
    odd = world(RADAR, TRUCK, Actor("x" * 300, 120.0, 70.0)).fly("naive")
    assert len(odd.reports) == 2
    assert all(len(track.class_label) <= 64 for track in odd.tracks.tracks)


def test_what_it_believes_is_published_every_second() -> None:
    """Tracks and status come once a second; the tracks hold the objects where they are."""
    flown = world(RADAR, TRUCK).fly("naive")
    for kind in ("tracks", "status"):
        count = sum(topic == getattr(VehicleTopics("vehicle_1"), kind) for topic, _ in flown.said)
        assert count >= int(flown.vehicle.time_s)
    believed = {track.class_label: (track.east_m, track.north_m) for track in flown.tracks.tracks}
    assert believed["mobile_radar"] == pytest.approx((RADAR.east_m, RADAR.north_m), abs=3.0)


TWIN = """
import hashlib, json, sys
sys.path.insert(0, {folder!r})
from test_agent_mission import NEAR_RADAR, RADAR, TRUCK, world
flown = world(RADAR, TRUCK, NEAR_RADAR).fly("bystander_aware")
print(json.dumps([hashlib.sha256(json.dumps(flown.said).encode()).hexdigest(), flown.vehicle.commands]))
"""


def test_same_inputs_give_the_same_bytes() -> None:
    """Two processes with different hash seeds say the same, word for word."""
    code = TWIN.format(folder=str(Path(__file__).parent))
    said = [
        subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": seed}, capture_output=True, check=True, text=True
        ).stdout
        for seed in ("1", "2")
    ]
    assert said[0] == said[1]
    assert len(json.loads(said[0])[1]) > 10


def test_what_waits_is_not_let_fall_due_for_a_place_whose_target_is_found() -> None:
    """With a deadline ahead it leaves the first sub-area once its target is reported; without one it looks at all of it."""
    hurried = world(RADAR, TRUCK)
    assert hurried.mission is not None
    hurried.mission = hurried.mission.model_copy(update={"report_deadline_s": 80.0})
    hurried.fly("naive")
    calm = world(RADAR, TRUCK).fly("naive")
    assert [one.subject for one in hurried.decided("move_on")] == ["alpha"]
    assert not calm.decided("move_on")
    assert hurried.reports[1].time_s < calm.reports[1].time_s - 5.0
