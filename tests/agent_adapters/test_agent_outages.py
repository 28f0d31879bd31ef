"""How the reference agent lives through outages and faults: it says so, obeys the rules, goes on."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from agent_fakes import LAND, OFFBOARD, Actor, World, intelligence, mission_order, order_document

RADAR, TRUCK = Actor("mobile_radar", 130.0, 70.0), Actor("military_vehicle", -60.0, 120.0)
BOTH = (
    intelligence("alpha", "mobile_radar", 110.0, 80.0),
    intelligence("bravo", "military_vehicle", -80.0, 110.0, 2),
)


def world(*actors: Actor, **changes: object) -> World:
    return World(list(actors or (RADAR, TRUCK)), {0.0: BOTH}, **changes)  # type: ignore[arg-type]


def notice_times(mission: World, subject: str) -> list[float]:
    return [notice.time_s for notice in mission.decisions_to("notice") if notice.subject == subject]


class Trail:
    def __init__(self) -> None:
        self.home_m: dict[float, float] = {}
        self.speed_mps: dict[float, float] = {}

    def __call__(self, now: World) -> None:
        time_s = round(now.vehicle.time_s, 1)
        self.home_m[time_s] = math.hypot(now.vehicle.east_m, now.vehicle.north_m)
        self.speed_mps[time_s] = now.vehicle.speed_mps


def test_without_the_operator_it_holds_when_the_rules_say_so() -> None:
    """After the grace it stands until the link is back; what it reported meanwhile is said again."""
    trail = Trail()
    mission = world(
        mission=mission_order(link_lost="hold", link_lost_after_s=12.0),
        link_down=(24.0, 70.0),
        each_step=trail,
    ).fly("naive")
    assert notice_times(mission, "operator_link") == pytest.approx([24.0, 70.0])
    assert max(trail.speed_mps[round(42.0 + k / 10, 1)] for k in range(270)) < 1.0
    first, again = [report for report in mission.reports if report.intelligence_id == "alpha"][:2]
    assert 24.0 < first.time_s < 40.0
    assert again.time_s == pytest.approx(70.0)
    assert again.repeats == first.id != again.id
    assert len({report.id for report in mission.reports}) == len(mission.reports)
    assert mission.phase == "complete"


def test_without_the_operator_it_turns_home_when_the_rules_say_so_and_goes_on_when_heard() -> None:
    """It comes nearer home while the link is down, and both targets are reported in the end."""
    trail = Trail()
    rules = mission_order(link_lost="return", link_lost_after_s=5.0)
    mission = world(mission=rules, link_down=(22.0, 34.0), each_step=trail).fly("naive")
    assert trail.home_m[34.0] < trail.home_m[28.0] - 20.0
    assert {report.intelligence_id for report in mission.reports} == {"alpha", "bravo"}


def test_without_the_operator_for_good_it_lands_at_home() -> None:
    """The link does not come back: it is down at home long before the time is up."""
    mission = world(mission=mission_order(link_lost="return"), link_down=(30.0, 900.0)).fly("naive")
    assert mission.phase == "complete"
    assert mission.vehicle.time_s < 120.0
    assert math.hypot(mission.vehicle.east_m, mission.vehicle.north_m) < 3.0


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_a_silent_detector_is_noticed_and_nothing_new_is_reported(policy: str) -> None:
    """While nothing comes, no first report is made and the search waits; afterwards it goes on."""
    trail = Trail()
    mission = world(blind=(21.0, 50.0), each_step=trail).fly(policy)  # type: ignore[arg-type]
    assert notice_times(mission, "detections") == pytest.approx([22.5, 50.0], abs=0.5)
    assert not [report for report in mission.reports if 23.0 < report.time_s < 50.0]
    assert trail.speed_mps[45.0] < 1.0
    assert {report.intelligence_id for report in mission.reports} == {"alpha", "bravo"}


def test_without_gps_it_waits_and_the_careful_one_states_larger_errors() -> None:
    """GPS goes and comes back: both say so; one alone states errors, larger for what was seen then."""

    def jam(now: World) -> None:
        now.vehicle.gps = not 18.0 < now.vehicle.time_s < 30.0

    calm, jammed = world().fly("bystander_aware", 90.0), world(each_step=jam).fly("bystander_aware", 90.0)
    naive = world(each_step=jam).fly("naive", 90.0)
    assert notice_times(jammed, "gps") == pytest.approx([18.5, 30.5], abs=1.0)
    assert notice_times(naive, "gps") == notice_times(jammed, "gps")
    sigmas = [
        next(r.position_sigma_m for r in mission.reports if r.intelligence_id == "alpha")
        for mission in (calm, jammed)
    ]
    assert sigmas[0] is not None
    assert sigmas[1] is not None
    assert sigmas[1] > sigmas[0] + 1.0
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
    assert {report.intelligence_id for report in mission.reports} == {"alpha", "bravo"}


def test_a_battery_drop_below_the_reserve_is_noticed_and_brings_it_home() -> None:
    """Below what the rules want to be left it turns home at once."""

    def drain(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.battery = 45

    mission = world(mission=mission_order(battery_reserve_fraction=0.5), each_step=drain).fly("naive")
    assert notice_times(mission, "battery") == pytest.approx([30.5], abs=1.0)
    (back,) = mission.decisions_to("return")
    assert back.time_s == pytest.approx(30.5, abs=1.5)
    assert "battery" in back.reason
    flat = world(mission=mission_order(battery_reserve_fraction=0.5))
    flat.vehicle.battery = 40
    assert flat.fly("naive").vehicle.peak_m == 0.0


@pytest.mark.parametrize("charge", [90, 60])
def test_a_battery_that_was_never_full_is_no_drop(charge: int) -> None:
    """The first charge that is heard is not compared with a full battery; the drop in flight is still told."""

    def drain(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.battery = charge - 20

    flown = world(each_step=drain)
    flown.vehicle.battery = charge
    assert notice_times(flown.fly("naive"), "battery") == pytest.approx([30.5], abs=1.0)


def test_a_report_is_made_before_its_deadline_with_fewer_viewpoints() -> None:
    """Before it has seen all sides it reports when the deadline nears; else it takes its time."""
    due = world(mission=mission_order(report_deadline_s=45.0)).fly("naive", 60.0, min_viewpoint_deg=250.0)
    free = world().fly("naive", 60.0, min_viewpoint_deg=250.0)
    assert [30.0 <= report.time_s < 45.0 for report in due.reports if report.intelligence_id == "alpha"] == [
        True
    ]
    assert "due" in due.decisions_to("report")[0].reason
    assert not [report for report in free.reports if report.time_s < 45.0]


def test_in_the_air_decisions_are_logged_at_least_once_a_minute() -> None:
    """Status at least every five seconds, and a decision at least once a minute, however long it waits."""
    mission = world(
        orders_at={40.0: order_document("wait", "hold")}, mission=mission_order(time_limit_s=280.0)
    ).fly("naive")
    times = [decision.time_s for decision in mission.decisions if decision.time_s > 10.0]
    assert max(b - a for a, b in pairwise(times)) <= 60.0


def test_a_battery_drop_that_leaves_enough_charge_does_not_end_the_mission() -> None:
    """The charge halves at once, and what is left is plenty: the mission goes on."""

    def drain(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.battery = 50

    mission = world(each_step=drain).fly("naive")
    assert notice_times(mission, "battery")
    assert {report.intelligence_id for report in mission.reports} == {"alpha", "bravo"}
