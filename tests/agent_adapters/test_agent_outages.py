"""How the reference agent lives through outages and faults: it says so, does what the rules say, and goes on."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from agent_fakes import Actor, World, intelligence, order, ordered

RADAR, TRUCK = Actor("mobile_radar", 130.0, 70.0), Actor("military_vehicle", -60.0, 120.0)
BOTH = (intelligence("alpha", "mobile_radar", 110.0, 80.0), intelligence("bravo", "military_vehicle", -80.0, 110.0, 2))


def world(*actors: Actor, **changes: object) -> World:
    return World(list(actors or (RADAR, TRUCK)), {0.0: BOTH}, **changes)  # type: ignore[arg-type]


def noticed(flown: World, subject: str) -> list[float]:
    return [one.time_s for one in flown.decided("notice") if one.subject == subject]


class Trail:
    def __init__(self) -> None:
        self.home_m: dict[float, float] = {}
        self.speed_mps: dict[float, float] = {}

    def __call__(self, now: World) -> None:
        time_s = round(now.vehicle.time_s, 1)
        self.home_m[time_s] = math.hypot(now.vehicle.east_m, now.vehicle.north_m)
        self.speed_mps[time_s] = now.vehicle.speed_mps


def test_without_the_operator_it_holds_when_the_rules_say_so() -> None:
    """After the grace it stands until the link is back; what it reported meanwhile is said again, under an id of its own."""
    trail = Trail()
    flown = world(mission=order(link_lost="hold", link_lost_after_s=12.0), link_down=(24.0, 70.0), each_beat=trail).fly("naive")
    assert noticed(flown, "operator_link") == pytest.approx([24.0, 70.0])
    assert max(trail.speed_mps[round(42.0 + k / 10, 1)] for k in range(270)) < 1.0
    first, again = [report for report in flown.reports if report.intelligence_id == "alpha"][:2]
    assert 24.0 < first.time_s < 40.0
    assert again.time_s == pytest.approx(70.0)
    assert again.repeats == first.id != again.id
    assert len({report.id for report in flown.reports}) == len(flown.reports)
    assert flown.phase == "complete"


def test_without_the_operator_it_turns_home_when_the_rules_say_so_and_goes_on_when_heard() -> None:
    """It comes nearer home while the link is down, and both targets are reported in the end."""
    trail = Trail()
    rules = order(link_lost="return", link_lost_after_s=5.0)
    flown = world(mission=rules, link_down=(22.0, 34.0), each_beat=trail).fly("naive")
    assert trail.home_m[34.0] < trail.home_m[28.0] - 20.0
    assert {report.intelligence_id for report in flown.reports} == {"alpha", "bravo"}


def test_without_the_operator_for_good_it_lands_at_home() -> None:
    """The link does not come back: it is down at home long before the time is up."""
    flown = world(mission=order(link_lost="return"), link_down=(30.0, 900.0)).fly("naive")
    assert flown.phase == "complete"
    assert flown.vehicle.time_s < 120.0
    assert math.hypot(flown.vehicle.east_m, flown.vehicle.north_m) < 3.0


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_a_silent_detector_is_noticed_and_nothing_new_is_reported(policy: str) -> None:
    """While nothing comes, no first report is made and the search waits; afterwards it goes on."""
    trail = Trail()
    flown = world(blind=(21.0, 50.0), each_beat=trail).fly(policy)  # type: ignore[arg-type]
    assert noticed(flown, "detections") == pytest.approx([22.5, 50.0], abs=0.5)
    assert not [report for report in flown.reports if 23.0 < report.time_s < 50.0]
    assert trail.speed_mps[45.0] < 1.0
    assert {report.intelligence_id for report in flown.reports} == {"alpha", "bravo"}


def test_without_gps_it_waits_and_the_careful_one_states_larger_errors() -> None:
    """GPS goes and comes back: both say so; only one of them states errors at all, larger for what was seen meanwhile."""

    def jam(now: World) -> None:
        now.vehicle.gps = not 18.0 < now.vehicle.time_s < 30.0

    calm, jammed = world().fly("bystander_aware", 90.0), world(each_beat=jam).fly("bystander_aware", 90.0)
    naive = world(each_beat=jam).fly("naive", 90.0)
    assert noticed(jammed, "gps") == pytest.approx([18.5, 30.5], abs=1.0)
    assert noticed(naive, "gps") == noticed(jammed, "gps")
    sigmas = [next(r.position_sigma_m for r in flown.reports if r.intelligence_id == "alpha") for flown in (calm, jammed)]
    assert sigmas[0] is not None
    assert sigmas[1] is not None
    assert sigmas[1] > sigmas[0] + 1.0
    assert all(report.position_sigma_m is None for report in naive.reports)


def test_a_failsafe_is_left_alone_and_the_mission_goes_on_after_it() -> None:
    """While the autopilot lands by its failsafe no mode is asked for; given back, the flight goes on."""
    asked: list[int] = []

    def fail(now: World) -> None:
        vehicle = now.vehicle
        if abs(vehicle.time_s - 40.0) < 0.05:
            vehicle.failsafe, vehicle.mode = True, (4, 6)
        if 40.0 < vehicle.time_s < 50.0:
            asked.append(len(vehicle.commands))
        if abs(vehicle.time_s - 50.0) < 0.05:
            vehicle.failsafe, vehicle.mode = False, (6, 0)

    flown = world(each_beat=fail).fly("naive")
    assert len(set(asked[12:])) == 1  # from when the heartbeat has told it
    assert flown.decided("yield")
    assert "landing" in flown.phases[: flown.phases.index("returning")]
    assert {report.intelligence_id for report in flown.reports} == {"alpha", "bravo"}


def test_a_sudden_drop_of_the_charge_is_said_and_brings_it_home_with_the_reserve() -> None:
    """Below what the rules want to be left it turns home at once."""

    def drain(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.battery = 45

    flown = world(mission=order(battery_reserve_fraction=0.5), each_beat=drain).fly("naive")
    assert noticed(flown, "battery") == pytest.approx([30.5], abs=1.0)
    (back,) = flown.decided("return")
    assert back.time_s == pytest.approx(30.5, abs=1.5)
    assert "battery" in back.reason
    flat = world(mission=order(battery_reserve_fraction=0.5))
    flat.vehicle.battery = 40
    assert flat.fly("naive").vehicle.peak_m == 0.0


def test_a_report_that_falls_due_is_made_with_what_is_known() -> None:
    """Before it has seen the target from all sides it reports when the deadline nears; without one it takes its time."""
    due = world(mission=order(report_deadline_s=45.0)).fly("naive", 60.0, min_viewpoint_deg=250.0)
    free = world().fly("naive", 60.0, min_viewpoint_deg=250.0)
    assert [30.0 <= report.time_s < 45.0 for report in due.reports if report.intelligence_id == "alpha"] == [True]
    assert "due" in due.decided("report")[0].reason
    assert not [report for report in free.reports if report.time_s < 45.0]


def test_in_the_air_the_log_never_falls_silent_for_long() -> None:
    """Status at least every five seconds, and a decision at least once a minute, however long it waits."""
    flown = world(orders_at={40.0: ordered("wait", "hold")}, mission=order(time_limit_s=280.0)).fly("naive")
    times = [one.time_s for one in flown.decisions if one.time_s > 10.0]
    assert max(b - a for a, b in pairwise(times)) <= 60.0


def test_a_drop_is_not_taken_for_what_flying_needs() -> None:
    """The charge halves at once, and what is left is plenty: the mission goes on."""

    def drain(now: World) -> None:
        if now.vehicle.time_s > 30.0:
            now.vehicle.battery = 50

    flown = world(each_beat=drain).fly("naive")
    assert noticed(flown, "battery")
    assert {report.intelligence_id for report in flown.reports} == {"alpha", "bravo"}
