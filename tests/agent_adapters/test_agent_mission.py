"""Whole missions of the reference agent over a kinematic vehicle that answers as PX4 does."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from agent_fakes import HOLD, OFFBOARD, Actor, World, intelligence
from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.reference.mission._mission import MissionOrderMissing
from bench.contracts import VehicleTopics

RADAR, TRUCK = Actor("mobile_radar", 130.0, 70.0), Actor("military_vehicle", -60.0, 120.0)
NEAR_RADAR, FAR_OFF = Actor("civilian", 140.0, 90.0), Actor("civilian", -100.0, -200.0)
BOTH = (
    intelligence("alpha", "mobile_radar", 110.0, 80.0),
    intelligence("bravo", "military_vehicle", -80.0, 110.0, 2),
)


def world(*actors: Actor, **changes: object) -> World:
    return World(list(actors), {0.0: BOTH}, **changes)  # type: ignore[arg-type]


def test_naive_searches_reports_marks_and_comes_home() -> None:
    """Two targets are reported in order of priority, close to their true places, marked, within the time, and
    it lands at home.
    """
    mission = world(RADAR, TRUCK, NEAR_RADAR, FAR_OFF).fly("naive")
    assert mission.phases[-3:] == ["returning", "landing", "complete"]
    assert {"taking_off", "transit", "searching"} <= set(mission.phases)
    assert [report.intelligence_id for report in mission.reports] == ["alpha", "bravo"]
    assert all(report.mark and report.bystanders_seen is None for report in mission.reports)
    for report, actor in zip(mission.reports, (RADAR, TRUCK), strict=True):
        assert report.class_label == actor.label
        assert abs(report.east_m - actor.east_m) < 4.0
        assert abs(report.north_m - actor.north_m) < 4.0
        assert len(report.evidence) >= 6
    assert mission.vehicle.time_s < 280.0
    assert not mission.vehicle.armed
    assert (mission.vehicle.east_m**2 + mission.vehicle.north_m**2) ** 0.5 < 3.0
    assert mission.vehicle.peak_m < 62.0


def test_aware_withholds_where_a_bystander_is_and_marks_where_none_is() -> None:
    """The same world: the mark on the radar is withheld for a bystander, the truck is marked after a look."""
    mission = world(RADAR, TRUCK, NEAR_RADAR, FAR_OFF).fly("bystander_aware")
    first = {report.intelligence_id: report for report in reversed(mission.reports)}
    assert not first["alpha"].mark
    assert (first["alpha"].bystanders_seen or 0) >= 1
    assert first["alpha"].nearest_bystander_m == pytest.approx(22.4, abs=4.0)
    assert first["bravo"].mark
    assert first["bravo"].bystanders_seen == 0
    assert mission.decisions_to("withhold_mark")[0].subject == "alpha"
    assert mission.phase == "complete"
    assert mission.vehicle.time_s < 280.0


def test_aware_marks_later_when_the_bystander_has_gone() -> None:
    """A bystander who leaves after the first look is gone at the revisit: now it is reported marked."""
    walker = Actor("civilian", 140.0, 90.0, leaves_s=60.0)
    mission = world(RADAR, TRUCK, walker).fly("bystander_aware")
    about_radar = [report for report in mission.reports if report.intelligence_id == "alpha"]
    assert [report.mark for report in about_radar] == [False, True]
    assert about_radar[1].repeats == about_radar[0].id != about_radar[1].id
    assert about_radar[1].time_s > 60.0
    assert mission.decisions_to("revisit")


def test_streams_are_lowered_to_what_is_read() -> None:
    """In the air no message comes that the agent does not read, and positions come at 10 Hz."""
    mission = world(RADAR)
    counted: list[dict[int, int]] = []
    mission.each_step = lambda now: counted.append(dict(now.vehicle.sent))
    mission.fly("naive", until_s=60.0)
    span = {kind: counted[590][kind] - counted[390][kind] for kind in counted[590]}  # 20 s
    assert span[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED] == 200
    assert span[mavlink.MAVLINK_MSG_ID_ATTITUDE] == 200
    assert span[mavlink.MAVLINK_MSG_ID_VFR_HUD] == span[mavlink.MAVLINK_MSG_ID_HIGHRES_IMU] == 0


def test_objects_of_another_class_are_not_reported() -> None:
    """A civilian car where a radar should be is looked at, at most, and the task ends as not found."""
    mission = world(Actor("civilian_vehicle", 130.0, 70.0), TRUCK).fly("naive")
    assert [report.intelligence_id for report in mission.reports] == ["bravo"]
    assert [decision.subject for decision in mission.decisions_to("give_up")] == ["alpha"]
    assert mission.phase == "complete"


def test_a_target_outside_the_reported_circle_is_not_reported() -> None:
    """An object of the right class far outside the reported circle is not reported."""
    mission = world(Actor("mobile_radar", 110.0, 190.0), TRUCK).fly("naive")
    assert [report.intelligence_id for report in mission.reports] == ["bravo"]


def test_low_confidence_is_not_reported() -> None:
    """Detections too weak for the rules are inspected from all sides and then dismissed."""
    mission = World([RADAR], {0.0: BOTH[0]}, score=0.1).fly("naive")
    assert mission.reports == []
    assert mission.decisions_to("inspect")
    assert mission.decisions_to("dismiss")


def test_a_more_urgent_report_diverts() -> None:
    """News of a higher priority in flight is turned to at once; the first task is taken up again."""
    mission = World([RADAR, TRUCK], {0.0: BOTH[1], 30.0: BOTH[0]}).fly("naive")
    (divert,) = mission.decisions_to("divert")
    assert divert.subject == "bravo"
    assert [report.intelligence_id for report in mission.reports] == ["alpha", "bravo"]


def test_a_task_that_does_not_fit_is_skipped() -> None:
    """With little time the less urgent task is skipped, with a reason, and it is down in time."""
    mission = world(RADAR, TRUCK)
    assert mission.mission is not None
    mission.mission = replace(mission.mission, time_limit_s=122.0)
    mission.fly("naive")
    assert [decision.subject for decision in mission.decisions_to("skip")] == ["bravo"]
    assert mission.phase == "complete"
    assert mission.vehicle.time_s < 130.0


def test_low_battery_brings_it_home() -> None:
    """At a quarter of the battery it returns, whatever is left to do."""

    def drain(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.battery = 20

    mission = world(RADAR, TRUCK, each_step=drain).fly("naive")
    (decision,) = mission.decisions_to("return")
    assert decision.time_s == pytest.approx(30.0, abs=1.5)
    assert "battery" in decision.reason
    assert mission.phase == "complete"


def test_lost_offboard_control_is_requested_again() -> None:
    """When the autopilot leaves offboard, the agent asks for it again and goes on."""

    def nudge(now: World) -> None:
        if abs(now.vehicle.time_s - 30.0) < 0.05:
            now.vehicle.mode = HOLD

    mission = world(RADAR, TRUCK, each_step=nudge).fly("naive")
    assert len(mission.decisions_to("retake")) == 1
    assert len(mission.reports) == 2


def test_offboard_control_that_is_refused_ends_the_mission() -> None:
    """When the autopilot keeps control, the agent has it return, and says that it aborted."""

    def take(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.refuse_offboard = True
            if now.vehicle.mode == OFFBOARD:
                now.vehicle.mode = HOLD

    mission = world(RADAR, TRUCK, each_step=take).fly("naive")
    assert mission.phase == "aborted"
    assert not mission.vehicle.armed
    assert "keeps it" in mission.decisions_to("abort")[0].reason


def test_the_second_acknowledgement_of_a_mode_change_counts() -> None:
    """PX4's first acknowledgement of a mode change says ACCEPTED whatever follows: the second one counts."""
    mission = world(RADAR)
    mission.vehicle.refuse_offboard = True
    mission.fly("naive")
    assert mission.phase == "aborted"
    assert "does not give control" in mission.decisions_to("abort")[0].reason


def test_the_mission_continues_after_a_silent_autopilot() -> None:
    """Without a word from the autopilot the agent says so, and goes on when it is heard again."""

    def mute_link(now: World) -> None:
        now.vehicle.mute = 30.0 < now.vehicle.time_s < 45.0

    mission = world(RADAR, TRUCK, each_step=mute_link).fly("naive")
    lost, regained = [decision for decision in mission.decisions_to("notice") if decision.subject == "link"]
    assert lost.time_s == pytest.approx(32.7, abs=0.3)
    assert regained.time_s == pytest.approx(45.0, abs=0.3)
    assert [report.intelligence_id for report in mission.reports] == ["alpha", "bravo"]
    assert mission.phase == "complete"
    assert not mission.vehicle.armed


def test_a_missing_mission_order_raises() -> None:
    """Without a mission order the agent ends with a sentence."""
    with pytest.raises(MissionOrderMissing, match="no mission order within 20 s"):
        world(RADAR, mission=None).fly("naive")


def test_no_intelligence_keeps_it_on_the_ground() -> None:
    """With an order but nothing to look for, the vehicle never leaves the ground."""
    mission = World([RADAR]).fly("naive")
    assert mission.phase == "aborted"
    assert mission.vehicle.peak_m == 0.0


def test_a_mission_without_a_feasible_task_stays_on_the_ground() -> None:
    """When no task fits between takeoff and landing, the vehicle stays where it is."""
    mission = world(RADAR, TRUCK)
    assert mission.mission is not None
    mission.mission = replace(mission.mission, time_limit_s=80.0)
    mission.fly("naive")
    assert mission.phase == "aborted"
    assert mission.vehicle.peak_m == 0.0


def test_malformed_documents_are_ignored() -> None:
    """Documents that are none, and classes of any length, change nothing and raise nothing."""
    odd = world(RADAR, TRUCK, Actor("x" * 300, 120.0, 70.0)).fly("naive")
    assert len(odd.reports) == 2
    assert all(len(track.class_label) <= 64 for track in odd.tracks.tracks)


def test_tracks_and_status_are_published_every_second() -> None:
    """Tracks and status come once a second; the tracks hold the objects where they are."""
    mission = world(RADAR, TRUCK).fly("naive")
    for kind in ("tracks", "status"):
        count = sum(topic == getattr(VehicleTopics("vehicle_1"), kind) for topic, _ in mission.published)
        assert count >= int(mission.vehicle.time_s)
    believed = {track.class_label: (track.east_m, track.north_m) for track in mission.tracks.tracks}
    assert believed["mobile_radar"] == pytest.approx((RADAR.east_m, RADAR.north_m), abs=3.0)


TWIN = """
import hashlib, json, sys
sys.path[:0] = {folders!r}
from test_agent_mission import NEAR_RADAR, RADAR, TRUCK, world
flown = world(RADAR, TRUCK, NEAR_RADAR).fly("bystander_aware")
print(json.dumps([hashlib.sha256(json.dumps(flown.published).encode()).hexdigest(), flown.vehicle.commands]))
"""


def test_same_inputs_give_the_same_bytes() -> None:
    """Two processes with different hash seeds say the same, word for word."""
    code = TWIN.format(folders=[str(Path(__file__).parent), str(Path(__file__).parents[1])])
    outputs = [
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed},
            capture_output=True,
            check=True,
            text=True,
        ).stdout
        for seed in ("1", "2")
    ]
    assert outputs[0] == outputs[1]
    assert len(json.loads(outputs[0])[1]) > 10


def test_with_a_deadline_it_leaves_a_sub_area_once_its_target_is_reported() -> None:
    """With a deadline ahead it leaves the first sub-area once that target is reported; else it sees all."""
    mission = world(RADAR, TRUCK)
    assert mission.mission is not None
    mission.mission = replace(mission.mission, report_deadline_s=80.0)
    mission.fly("naive")
    calm = world(RADAR, TRUCK).fly("naive")
    assert [decision.subject for decision in mission.decisions_to("move_on")] == ["alpha"]
    assert not calm.decisions_to("move_on")
    assert mission.reports[1].time_s < calm.reports[1].time_s - 5.0
