"""Whole missions of the reference agent over a kinematic vehicle that answers as PX4 does."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from agent_fakes import (
    BOTH,
    HOLD,
    NEAR_RADAR,
    OFFBOARD,
    RADAR,
    TRUCK,
    Actor,
    World,
    changing,
    intelligence,
    mission_order,
    order_document,
    world,
)
from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.reference.mission._mission import MissionOrderMissing
from bench.contracts import VehicleTopics

FAR_OFF = Actor("civilian", -100.0, -200.0)


@pytest.fixture(scope="module")
def calm() -> World:
    """Nothing but the two targets."""
    return world().fly("naive")


def test_naive_searches_reports_marks_and_comes_home() -> None:
    """Two targets are reported in order of priority, close to their true places, marked, within the time."""
    mission = world(RADAR, TRUCK, NEAR_RADAR, FAR_OFF).fly("naive")
    assert mission.phases[-3:] == ["returning", "landing", "complete"]
    assert {"taking_off", "transit", "searching"} <= set(mission.phases)
    assert mission.reported == ["alpha", "bravo"]
    assert all(report.mark and report.bystanders_seen is None for report in mission.reports)
    for report, actor in zip(mission.reports, (RADAR, TRUCK), strict=True):
        assert report.class_label == actor.label
        assert abs(report.east_m - actor.east_m) < 4.0
        assert abs(report.north_m - actor.north_m) < 4.0
        assert len(report.evidence) >= 6
    assert mission.vehicle.time_s < 280.0
    assert not mission.vehicle.armed
    assert mission.home_m < 3.0
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
    mission = world(RADAR, TRUCK, replace(NEAR_RADAR, leaves_s=60.0)).fly("bystander_aware")
    first, second = [report for report in mission.reports if report.intelligence_id == "alpha"]
    assert (first.mark, second.mark) == (False, True)
    assert second.repeats == first.id != second.id
    assert second.time_s > 60.0
    assert mission.decisions_to("revisit")


def test_streams_are_lowered_to_what_is_read() -> None:
    """In the air no message comes that the agent does not read, and positions come at 10 Hz."""
    counted: list[dict[int, int]] = []
    world(each_step=lambda now: counted.append(dict(now.vehicle.sent))).fly("naive", until_s=60.0)
    span = {kind: counted[590][kind] - counted[390][kind] for kind in counted[590]}  # 20 s
    assert span[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED] == 200
    assert span[mavlink.MAVLINK_MSG_ID_ATTITUDE] == 200
    assert span[mavlink.MAVLINK_MSG_ID_VFR_HUD] == span[mavlink.MAVLINK_MSG_ID_HIGHRES_IMU] == 0


@pytest.mark.parametrize(
    "other", [Actor("civilian_vehicle", 130.0, 70.0), Actor("mobile_radar", 110.0, 190.0)]
)
def test_another_class_and_what_is_far_outside_the_circle_are_not_reported(other: Actor) -> None:
    mission = world(other, TRUCK).fly("naive")
    assert mission.reported == ["bravo"]
    assert [decision.subject for decision in mission.decisions_to("give_up")] == ["alpha"]
    assert mission.phase == "complete"


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
    assert mission.reported == ["alpha", "bravo"]


def test_a_task_that_does_not_fit_is_skipped() -> None:
    """With little time the less urgent task is skipped, and it is down in time."""
    mission = world(mission=mission_order(time_limit_s=122.0)).fly("naive")
    assert [decision.subject for decision in mission.decisions_to("skip")] == ["bravo"]
    assert mission.phase == "complete"
    assert mission.vehicle.time_s < 130.0


def test_lost_offboard_control_is_requested_again() -> None:
    def nudge(now: World) -> None:
        if abs(now.vehicle.time_s - 30.0) < 0.05:
            now.vehicle.mode = HOLD

    mission = world(each_step=nudge).fly("naive")
    assert len(mission.decisions_to("retake")) == 1
    assert len(mission.reports) == 2


def test_offboard_control_that_is_refused_ends_the_mission() -> None:
    """When the autopilot keeps control, the agent has it return, and says that it aborted."""

    def take(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.refuse_offboard = True
            if now.vehicle.mode == OFFBOARD:
                now.vehicle.mode = HOLD

    mission = world(each_step=take).fly("naive")
    assert mission.phase == "aborted"
    assert not mission.vehicle.armed
    assert "keeps it" in mission.decisions_to("abort")[0].reason


def test_the_second_acknowledgement_of_a_mode_change_counts() -> None:
    """PX4's first acknowledgement of a mode change says ACCEPTED whatever follows."""
    mission = world(each_step=changing(0.0, refuse_offboard=True)).fly("naive")
    assert mission.phase == "aborted"
    assert "does not give control" in mission.decisions_to("abort")[0].reason


def test_the_mission_continues_after_a_silent_autopilot() -> None:
    """Without a word from the autopilot the agent says so, and goes on when it is heard again."""

    def mute_link(now: World) -> None:
        now.vehicle.mute = 30.0 < now.vehicle.time_s < 45.0

    mission = world(each_step=mute_link).fly("naive")
    lost, regained = mission.decisions_to("notice", "link")
    assert lost.time_s == pytest.approx(32.7, abs=0.3)
    assert regained.time_s == pytest.approx(45.0, abs=0.3)
    assert mission.reported == ["alpha", "bravo"]
    assert mission.phase == "complete"
    assert not mission.vehicle.armed


def test_a_missing_mission_order_raises() -> None:
    with pytest.raises(MissionOrderMissing, match="no mission order within 20 s"):
        world(mission=None).fly("naive")


@pytest.mark.parametrize(
    "situation",
    [
        {"reports_at": {}},
        {"mission": mission_order(time_limit_s=80.0)},
        {"mission": mission_order(battery_reserve_fraction=0.5), "each_step": changing(0.0, battery=40)},
        {"orders_at": {1.0: order_document("end", "abort")}},
    ],
    ids=["nothing to look for", "too little time", "too little charge", "told to abort"],
)
def test_it_stays_on_the_ground(situation: dict[str, Any]) -> None:
    mission = World(**{"actors": [RADAR, TRUCK], "reports_at": {0.0: BOTH}, **situation}).fly("naive")
    assert mission.phase == "aborted"
    assert mission.vehicle.peak_m == 0.0


def test_tracks_and_status_are_published_every_second(calm: World) -> None:
    """The tracks hold the objects where they are, and the beginning of a class that is too long."""
    for kind in ("tracks", "status"):
        count = sum(topic == getattr(VehicleTopics("vehicle_1"), kind) for topic, _ in calm.published)
        assert count >= int(calm.vehicle.time_s)
    believed = {track.class_label: (track.east_m, track.north_m) for track in calm.tracks.tracks}
    assert believed["mobile_radar"] == pytest.approx((RADAR.east_m, RADAR.north_m), abs=3.0)
    odd = world(RADAR, TRUCK, Actor("x" * 300, 120.0, 70.0)).fly("naive", until_s=50.0)
    assert odd.reported == ["alpha"]
    assert "x" * 64 in {track.class_label for track in odd.tracks.tracks}


def twin() -> list[Any]:
    """What a flight says, as a digest, and what it commands."""
    flown = world(RADAR, TRUCK, NEAR_RADAR).fly("bystander_aware", until_s=80.0)
    assert len(flown.published) > 100
    return [hashlib.sha256(json.dumps(flown.published).encode()).hexdigest(), flown.vehicle.commands]


def test_same_inputs_give_the_same_bytes() -> None:
    """A process with another hash seed says the same as this one, word for word."""
    folders = [str(parent) for parent in Path(__file__).parents[:2]]
    code = f"import sys; sys.path[:0] = {folders}; import json, test_agent_mission as t; print(json.dumps(t.twin()))"
    seed = "1" if os.environ.get("PYTHONHASHSEED") == "2" else "2"
    command = [sys.executable, "-c", code]
    other = subprocess.run(command, env={"PYTHONHASHSEED": seed}, capture_output=True, check=True)
    assert json.loads(other.stdout) == twin()


def test_with_a_deadline_it_leaves_a_sub_area_once_its_target_is_reported(calm: World) -> None:
    """Without one it sees all of it."""
    mission = world(mission=mission_order(report_deadline_s=80.0)).fly("naive")
    assert [decision.subject for decision in mission.decisions_to("move_on")] == ["alpha"]
    assert not calm.decisions_to("move_on")
    assert mission.reports[1].time_s < calm.reports[1].time_s - 5.0


# Intelligence that comes in flight.

EAST, WEST = Actor("mobile_radar", 120.0, 10.0), Actor("military_vehicle", -120.0, 120.0)
PEOPLE = [Actor("civilian", 130.0, 25.0), Actor("civilian", 110.0, 0.0)]
LATE = intelligence("late", "military_vehicle", -115.0, 115.0, priority=2, uncertainty_m=40.0)


def about_east(uncertainty_m: float) -> Any:
    return intelligence("alpha", "mobile_radar", 115.0, 0.0, uncertainty_m=uncertainty_m)


def flight(actors: list[Actor], late_s: float | None, until_s: float = 420.0) -> World:
    late = {} if late_s is None else {late_s: LATE}
    flown = World(actors, {0.0: about_east(40.0), **late}, mission=mission_order(time_limit_s=400.0))
    return flown.fly("bystander_aware", until_s)


def moment(mission: World, action: str, subject: str) -> float:
    return round(mission.decisions_to(action, subject)[0].time_s, 1)


def test_a_revisit_is_left_for_late_intelligence_and_made_up_for() -> None:
    """Two people stand by the target: the mark is withheld, and looked at again after the late report is served."""
    revisit_s = moment(flight([EAST, *PEOPLE], None, until_s=40.0), "revisit", "alpha")
    late_s = round(revisit_s + 6.0, 1)
    mission = flight([EAST, WEST, *PEOPLE], late_s)
    assert moment(mission, "move_on", "alpha") - late_s < 1.0
    assert moment(mission, "go", "late") - late_s < 1.0
    assert set(mission.reported) == {"alpha", "late"}
    assert len(mission.decisions_to("revisit")) == 2
    assert mission.phase == "complete"


def test_a_second_pass_is_left_for_late_intelligence() -> None:
    """Nothing stands where the first report says: the second pass gives way."""
    quiet = flight([WEST], None, until_s=45.0)
    late_s = round(quiet.decisions_to("search")[1].time_s + 5.0, 1)
    mission = flight([WEST], late_s)
    assert moment(mission, "give_up", "alpha") - late_s < 1.0
    assert moment(mission, "go", "late") - late_s < 1.0
    assert mission.reported == ["late"]
    assert mission.home_m < 3.0


@pytest.mark.parametrize("deadline_s", [None, 400.0])
def test_what_was_seen_during_the_flight_is_served_while_it_is_fresh(deadline_s: float | None) -> None:
    """Two targets wait after the first: the one seen lately ends the rest of the first search, the other does not."""

    def left_s(observed_s: float) -> float:
        """When it turns to the second target."""
        order = mission_order(time_limit_s=600.0, report_deadline_s=deadline_s)
        told: dict[float, Any] = {0.0: about_east(90.0), 5.0: replace(LATE, observed_s=observed_s)}
        mission = World([EAST, WEST], told, mission=order).fly("naive", until_s=80.0)
        return moment(mission, "go", "late") - moment(mission, "report", "alpha")

    fresh_s, old_s = left_s(4.0), left_s(-30.0)
    assert fresh_s < old_s - 10.0
    # It is there before 120 s have passed since it was told: 258 m at 8 m/s, and a search of 15 s.
    assert fresh_s + 258.0 / 8.0 + 15.0 < 5.0 + 120.0


@pytest.mark.parametrize("people", [PEOPLE, []])
def test_what_a_broken_off_search_finds_is_reported_unless_it_would_be_marked(people: list[Actor]) -> None:
    """Ordered away just before the target is identified, it goes on seeing it for a moment."""
    both = (about_east(60.0), replace(LATE, id="bravo"))
    actors = [EAST, WEST, *people]
    found_s = moment(World(actors, {0.0: both}).fly("bystander_aware", until_s=60.0), "report", "alpha")
    orders = {round(found_s - 0.4, 1): order_document("other", "retask", "bravo")}

    mission = World(actors, {0.0: both}, orders).fly("bystander_aware")

    visits = [decision.subject for decision in mission.decisions_to("go")]
    reported_s = moment(mission, "report", "alpha")
    if people:
        assert visits == ["alpha", "bravo"]
        assert found_s <= reported_s < moment(mission, "report", "bravo")
        assert [report.mark for report in mission.reports if report.intelligence_id == "alpha"] == [False]
    else:
        assert visits == ["alpha", "bravo", "alpha"]
        assert reported_s > moment(mission, "report", "bravo")
    assert set(mission.reported) == {"alpha", "bravo"}
