"""How the reference agent lives through outages, faults and drift: it says so, obeys the rules, goes on."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from agent_fakes import (
    LAND,
    OFFBOARD,
    Actor,
    World,
    changing,
    intelligence,
    mission_order,
    order_document,
    world,
)

from agent_adapters.reference.perception._drift import WINDOW_S, DriftCheck
from bench.simspec import Gps
from vehicle_models._navigation import Navigation

STEP_S = 0.1
EAST, SOUTH_WEST = (1.0, 0.0), (-math.sqrt(0.5), -math.sqrt(0.5))


def notice_times(mission: World, subject: str) -> list[float]:
    return [notice.time_s for notice in mission.decisions_to("notice", subject)]


def test_without_the_operator_it_holds_when_the_rules_say_so() -> None:
    """After the grace it stands until the link is back; what it reported meanwhile is said again."""
    rules = mission_order(link_lost="hold", link_lost_after_s=12.0)
    mission = world(mission=rules, link_down=(24.0, 70.0)).fly("naive")
    assert notice_times(mission, "operator_link") == pytest.approx([24.0, 70.0])
    assert max(mission.speed_mps[round(42.0 + k / 10, 1)] for k in range(270)) < 1.0
    first, again = [report for report in mission.reports if report.intelligence_id == "alpha"][:2]
    assert 24.0 < first.time_s < 40.0
    assert again.time_s == pytest.approx(70.0)
    assert again.repeats == first.id != again.id
    assert len({report.id for report in mission.reports}) == len(mission.reports)
    assert mission.phase == "complete"


def test_without_the_operator_it_turns_home_when_the_rules_say_so_and_goes_on_when_heard() -> None:
    """It comes nearer home while the link is down, and both targets are reported in the end."""
    rules = mission_order(link_lost="return", link_lost_after_s=5.0)
    mission = world(mission=rules, link_down=(22.0, 34.0)).fly("naive")
    assert math.hypot(*mission.at[34.0][:2]) < math.hypot(*mission.at[28.0][:2]) - 20.0
    assert set(mission.reported) == {"alpha", "bravo"}


def test_without_the_operator_for_good_it_lands_at_home() -> None:
    """The link does not come back: it is down at home long before the time is up."""
    mission = world(mission=mission_order(link_lost="return"), link_down=(30.0, 900.0)).fly("naive")
    assert mission.phase == "complete"
    assert mission.vehicle.time_s < 120.0
    assert mission.home_m < 3.0


def test_a_silent_detector_is_noticed_and_nothing_new_is_reported() -> None:
    """While nothing comes, no first report is made and the search waits; afterwards it goes on."""
    mission = world(blind=(21.0, 50.0)).fly("naive")
    assert notice_times(mission, "detections") == pytest.approx([22.5, 50.0], abs=0.5)
    assert not [report for report in mission.reports if 23.0 < report.time_s < 50.0]
    assert mission.speed_mps[45.0] < 1.0
    assert set(mission.reported) == {"alpha", "bravo"}


def test_without_gps_it_waits_and_the_careful_one_states_larger_errors() -> None:
    """GPS goes and comes back: both say so; one alone states errors, larger for what was seen then."""

    def jam(now: World) -> None:
        now.vehicle.gps = not 18.0 < now.vehicle.time_s < 30.0

    calm, jammed = world().fly("bystander_aware", 60.0), world(each_step=jam).fly("bystander_aware", 60.0)
    naive = world(each_step=jam).fly("naive", 60.0)
    assert notice_times(jammed, "gps") == pytest.approx([18.5, 30.5], abs=1.0)
    assert notice_times(naive, "gps") == notice_times(jammed, "gps")
    usual_m, larger_m = (
        next(
            report.position_sigma_m or 0.0 for report in mission.reports if report.intelligence_id == "alpha"
        )
        for mission in (calm, jammed)
    )
    assert 0.0 < usual_m < larger_m - 1.0
    assert all(report.position_sigma_m is None for report in naive.reports)


def test_a_failsafe_is_left_alone_and_the_mission_goes_on_after_it() -> None:
    """While the autopilot lands by its failsafe no mode is asked for; given back, the flight goes on."""
    command_counts: list[int] = []

    def fail(now: World) -> None:
        vehicle = now.vehicle
        if abs(vehicle.time_s - 40.0) < 0.05:
            vehicle.failsafe, vehicle.mode = True, LAND
        if 40.0 < vehicle.time_s < 50.0:
            command_counts.append(len(vehicle.commands))
        if abs(vehicle.time_s - 50.0) < 0.05:
            vehicle.failsafe, vehicle.mode = False, OFFBOARD

    mission = world(each_step=fail).fly("naive")
    assert len(set(command_counts[12:])) == 1  # from when the heartbeat has told it
    assert mission.decisions_to("yield")
    assert "landing" in mission.phases[: mission.phases.index("returning")]
    assert set(mission.reported) == {"alpha", "bravo"}


@pytest.mark.parametrize(("battery", "rules"), [(20, {}), (45, {"battery_reserve_fraction": 0.5})])
def test_a_battery_drop_below_the_reserve_is_noticed_and_brings_it_home(
    battery: int, rules: dict[str, Any]
) -> None:
    """Below a quarter, or below what the rules want to be left, it turns home at once, whatever is left to do."""
    mission = world(mission=mission_order(**rules), each_step=changing(30.0, battery=battery)).fly("naive")
    assert notice_times(mission, "battery") == pytest.approx([30.5], abs=1.0)
    (back,) = mission.decisions_to("return")
    assert back.time_s == pytest.approx(30.5, abs=1.5)
    assert "battery" in back.reason
    assert mission.phase == "complete"


@pytest.mark.parametrize(("charge", "left"), [(100, 50), (60, 40)])
def test_a_drop_that_leaves_enough_is_told_and_does_not_end_the_mission(charge: int, left: int) -> None:
    """The first charge that is heard is not compared with a full battery: one that was never full is no drop."""
    drained = world(each_step=changing(30.0, battery=left))
    drained.vehicle.battery = charge
    assert notice_times(drained.fly("naive"), "battery") == pytest.approx([30.5], abs=1.0)
    assert set(drained.reported) == {"alpha", "bravo"}


def test_a_report_is_made_before_its_deadline_with_fewer_viewpoints() -> None:
    """Before it has seen all sides it reports when the deadline nears; else it takes its time."""
    due = world(mission=mission_order(report_deadline_s=45.0)).fly("naive", 60.0, min_viewpoint_deg=250.0)
    free = world().fly("naive", 60.0, min_viewpoint_deg=250.0)
    (about_alpha,) = [report for report in due.reports if report.intelligence_id == "alpha"]
    assert 30.0 <= about_alpha.time_s < 45.0
    assert "due" in due.decisions_to("report")[0].reason
    assert not [report for report in free.reports if report.time_s < 45.0]


def test_in_the_air_decisions_are_logged_at_least_once_a_minute() -> None:
    """However long it waits."""
    waiting = {40.0: order_document("wait", "hold")}
    mission = world(orders_at=waiting, mission=mission_order(time_limit_s=280.0)).fly("naive", until_s=180.0)
    times = [decision.time_s for decision in mission.decisions if decision.time_s > 10.0]
    assert max(b - a for a, b in pairwise(times)) <= 60.0


# Satellite navigation that drifts.


def feed(check: DriftCheck, index: int, error_en_m: tuple[float, float]) -> None:
    """One position of a vehicle that flies curves, stated with an error, and its exact velocity."""
    time_s = index * STEP_S
    place = (40.0 * math.sin(0.2 * time_s) + error_en_m[0], 25.0 * math.cos(0.3 * time_s) + error_en_m[1])
    velocity = (8.0 * math.cos(0.2 * time_s), -7.5 * math.sin(0.3 * time_s))
    check.take(time_s, place, velocity)


@pytest.mark.parametrize("direction", [EAST, SOUTH_WEST])
def test_drift_is_noticed_measured_and_over(direction: tuple[float, float]) -> None:
    """0.25 m/s for 30 s: noticed within ten seconds, followed within a metre, over when the fixes jump back."""
    check, noticed_s, worst_m = DriftCheck(), math.inf, 0.0
    for index in range(900):
        time_s = index * STEP_S
        drifted_m = 0.25 * (time_s - 30.0) if 30.0 <= time_s < 60.0 else 0.0
        drift_en_m = (drifted_m * direction[0], drifted_m * direction[1])
        feed(check, index, drift_en_m)
        if check.since_s is not None and time_s < 60.0:
            noticed_s = min(noticed_s, time_s)
            error_m = math.dist(check.offset_en_m, drift_en_m)
            worst_m = max(worst_m, error_m)
            assert error_m <= check.doubt_m * 3.0
    assert 30.0 < noticed_s < 40.0
    assert worst_m < 1.0
    assert check.since_s is None
    assert check.offset_en_m == (0.0, 0.0)


@pytest.mark.parametrize("wander_m", [0.3, 0.8])
def test_no_drift_is_seen_in_the_ordinary_error(wander_m: float) -> None:
    """The error of the simulated receiver, eight flights of 200 s: no false alarm."""
    for seed in range(8):
        navigation = Navigation(Gps(wander_m=wander_m), STEP_S, np.random.default_rng(seed))
        check = DriftCheck()
        for index in range(2000):
            navigation.step()
            feed(check, index, navigation.error_enu_m[:2])
            assert check.since_s is None, (seed, index)


def test_a_jump_when_fixes_return_is_no_drift() -> None:
    check = DriftCheck()
    for index in range(1000):
        time_s = index * STEP_S
        if 20.0 <= time_s < 32.0:
            check.suspend(time_s)
        feed(check, index, (6.0, -3.0) if time_s >= 33.0 else (0.0, 0.0))
        assert check.since_s is None
    assert WINDOW_S < 12.0


def drifting_world(direction: tuple[float, float], until_s: float) -> World:
    """Two targets; the position drifts by 0.6 m/s from 35 s on."""

    def drift(now: World) -> None:
        time_s = now.vehicle.time_s
        away_m = 0.6 * (time_s - 35.0) if 35.0 <= time_s < until_s else 0.0
        now.vehicle.position_error_m = (away_m * direction[0], away_m * direction[1])

    told = (
        intelligence("alpha", "mobile_radar", 115.0, 0.0),
        intelligence("bravo", "military_vehicle", -10.0, 140.0, priority=2),
    )
    actors = [Actor("mobile_radar", 120.0, 10.0), Actor("military_vehicle", -20.0, 150.0)]
    return World(actors, {0.0: told}, mission=mission_order(time_limit_s=280.0), each_step=drift)


@pytest.mark.parametrize("direction", [EAST, SOUTH_WEST])
def test_reports_under_drift_are_right_and_say_how_sure(direction: tuple[float, float]) -> None:
    """Drift to the end of the session: told, both targets within three of the stated sigmas, down at home."""
    mission = drifting_world(direction, math.inf).fly("bystander_aware")
    assert [36.0 < time_s < 45.0 for time_s in notice_times(mission, "gps")] == [True]
    places = {"alpha": (120.0, 10.0), "bravo": (-20.0, 150.0)}
    assert set(mission.reported) == set(places)
    sigmas_m = {}
    for report in mission.reports:
        error_m = math.dist((report.east_m, report.north_m), places[report.intelligence_id or ""])
        assert report.position_sigma_m is not None
        assert error_m <= 3.0 * report.position_sigma_m
        assert report.position_sigma_m < 12.0
        sigmas_m[report.time_s] = report.position_sigma_m
    assert max(sigmas_m) > 60.0
    assert sigmas_m[max(sigmas_m)] > 3.0
    assert mission.phase == "complete"
    assert mission.home_m < 6.0


def test_the_end_of_a_drift_is_told_too() -> None:
    mission = drifting_world(EAST, 75.0).fly("naive")
    _, ended_s = notice_times(mission, "gps")
    assert 75.0 < ended_s < 80.0
    assert mission.phase == "complete"
    assert mission.home_m < 4.0
