"""Search, mission and care for people near targets: the edges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from cases import scene, x_of
from cases.bystanders import RADAR_AT, TRUCK_AT, reporting
from cases.mission import BACKWARDS, OVER_BOTH, found_radar, went
from cases.perception import actors_of
from cases.reliability import FAULT_END_S, HOVERS, ONSET_S, ended, fault, statuses
from made_run import conditions, frame, order, report

from bench.contracts import lens_of
from test_ports.mission.completion import mission_time
from test_ports.mission.search import (
    area_searched,
    late_intelligence_served,
    priority_visited,
    reach_in_heights,
    targets_seen,
)
from test_ports.reliability.faults import fault_announced, fault_recovered, fault_survived
from test_ports.reliability.health import agent_lived, status_alive
from test_ports.reliability.outages import link_lost_obeyed
from test_ports.reports.bystanders import (
    nearest_bystander_right,
    people_not_denied,
)
from test_ports.reports.targets import (
    report_after_sight,
    report_windows_kept,
    reports_not_repeated,
    targets_reported,
)

SLOWLY = ((0.0, 0.0, 0.0), (80.0, -90.0, 100.0), (180.0, 105.0, 95.0))
LATE = [{"id": "first", "about": "radar", "uncertainty_m": 50.0, "delivered_s": 100.0}]


def test_mission_time_falls_linearly() -> None:
    """Down at 95 % of the limit is halfway from 90 % to 100 %."""
    spec = scene(mission={"time_limit_s": 200.0})
    assert x_of(mission_time, went(spec, *OVER_BOTH, down_s=190.0)) == pytest.approx(0.5)
    assert x_of(mission_time, went(spec, *OVER_BOTH, down_s=180.0)) == pytest.approx(1.0)


def test_landing_accuracy_uses_the_last_landing() -> None:
    """The landing is the last time that the vehicle came down."""
    spec = scene(mission={"time_limit_s": 200.0})
    condition = conditions((0.0, True), (5.0, False), (60.0, True), (70.0, False), (195.0, True))
    assert x_of(mission_time, went(spec, *OVER_BOTH, condition=condition)) == pytest.approx(0.25)


def test_a_sub_area_that_is_never_reached_is_out_of_order() -> None:
    """Reaching only the urgent sub-area leaves the pair out of order."""
    first_only = ((0.0, 0.0, 0.0), (60.0, 105.0, 95.0), (180.0, 0.0, 0.0))
    assert x_of(priority_visited, went(scene(), *first_only)) == 0.0


def test_an_area_on_the_way_to_a_more_urgent_one_is_in_no_order() -> None:
    """The least urgent area overlaps the most urgent one, and cannot but be reached with it."""
    intelligence = [
        {"id": "first", "about": "radar", "priority": 1, "uncertainty_m": 30.0},
        {"id": "second", "about": "truck", "priority": 2, "uncertainty_m": 30.0},
        {"id": "again", "about": "radar", "priority": 3, "uncertainty_m": 30.0},
    ]
    spec = scene(intelligence=intelligence)
    assert x_of(priority_visited, went(spec, *OVER_BOTH)) == 1.0
    assert x_of(priority_visited, went(spec, *BACKWARDS)) == 0.0


@pytest.mark.parametrize(
    ("kind", "area", "x"), [("retask", "second", None), ("retask", "first", 0.0), ("mark", "second", 0.0)]
)
def test_sub_areas_that_an_order_puts_first_are_in_no_order(kind: str, area: str, x: float | None) -> None:
    """Both are reached in the wrong order: as an order to go to the second asks, and no other order does."""
    asked = {"id": "asked", "kind": kind, "at_s": 12.0, "intelligence": area}
    assert x_of(priority_visited, went(scene(orders=[asked]), *BACKWARDS)) == x


def test_late_intelligence_is_timed_from_its_delivery() -> None:
    """A visit before the delivery does not count; a visit within the limit does."""
    late = scene(intelligence=LATE)
    assert x_of(late_intelligence_served, went(late, *OVER_BOTH)) == 0.0
    find = found_radar(late)
    assert x_of(late_intelligence_served, went(late, *SLOWLY, **find), limit_s=100.0) == 1.0
    assert x_of(late_intelligence_served, went(late, *SLOWLY, **find), limit_s=30.0) == 0.0


@pytest.mark.parametrize(
    ("kind", "expected"), [("hold", 1.0), ("hand_over", 1.0), ("mark", 0.0), ("return", 0.0)]
)
def test_the_time_for_late_intelligence_stops_while_the_agent_has_to_wait(kind: str, expected: float) -> None:
    """From an order to hold or to hand over up to the next order about where to go; no other order stops it."""
    late = scene(intelligence=LATE)
    find = found_radar(late)

    def x(next_kind: str) -> float | None:
        orders = (order(101.0, kind), order(102.0, next_kind))
        return x_of(late_intelligence_served, went(late, *SLOWLY, **find, orders=orders), limit_s=30.0)

    assert x("stop_reporting") == expected
    assert x("resume") == 0.0


@pytest.mark.parametrize(("rule", "expected"), [("hold", 1.0), ("return", 1.0), ("continue", 0.0)])
def test_the_time_for_late_intelligence_stops_with_a_lost_link(rule: str, expected: float) -> None:
    """Only where the rules forbid to go on."""
    outage = {"kind": "operator_link", "at_s": 101.0, "duration_s": 80.0}
    rules = {"link_lost": rule, "link_lost_after_s": 2.0}
    late = scene(intelligence=LATE, outages=[outage], rules=rules)
    run = went(late, *SLOWLY, **found_radar(late))
    assert x_of(late_intelligence_served, run, limit_s=30.0) == expected


def test_a_visit_without_a_find_serves_no_intelligence() -> None:
    """Of two late reports the one with a target reported is served; one about a bystander by the visit."""
    of_targets = [
        {"id": "first", "about": "radar", "uncertainty_m": 50.0, "delivered_s": 30.0},
        {"id": "second", "about": "truck", "uncertainty_m": 50.0, "delivered_s": 30.0},
    ]
    late = scene(intelligence=of_targets)
    find = found_radar(late)
    assert x_of(late_intelligence_served, went(late, *OVER_BOTH)) == 0.0
    assert x_of(late_intelligence_served, went(late, *OVER_BOTH, **find)) == 0.5
    guesses = tuple(report(63.0 + east, "mobile_radar", 300.0 + 40.0 * east, 0.0) for east in range(4))
    flooded = {**find, "reports": (*find["reports"], *guesses)}
    assert x_of(late_intelligence_served, went(late, *OVER_BOTH, **flooded)) == 0.125


@pytest.mark.parametrize(
    ("up_m", "as_ordered"), [(65.0, True), (55.0, True), (65.1, False), (54.9, False), (90.0, False)]
)
def test_what_is_seen_counts_from_the_ordered_height(up_m: float, *, as_ordered: bool) -> None:
    """The ceiling shows more ground and the floor more pixels: neither was ordered."""
    spec = scene(mission={"altitude_m": 60.0})
    looks = tuple(frame(number, float(number), *actors_of(spec, "adversary")) for number in range(6, 179, 2))
    run = went(spec, *OVER_BOTH, frames=looks, up_m=up_m)
    for measure in (targets_seen, area_searched):
        assert (x_of(measure, run) or 0.0) > 0.5 if as_ordered else x_of(measure, run) == 0.0


def test_a_find_that_is_kept_to_the_way_home_is_late() -> None:
    """Seen at 60 s: reported a minute later at the latest, unless an order to stop reporting stood in between."""
    late = scene(intelligence=[LATE[0] | {"delivered_s": 30.0}])
    orders = (order(70.0, "stop_reporting"), order(120.0, "resume_reporting"))
    for report_s, given, x in (
        (119.9, (), 1.0),
        (120.1, (), 0.0),
        (169.9, orders, 1.0),
        (170.1, orders, 0.0),
    ):
        find = found_radar(late) | {"reports": (report(report_s, *RADAR_AT),), "orders": given}
        run = went(late, *OVER_BOTH, **find)
        assert x_of(late_intelligence_served, run) == x
        assert x_of(report_after_sight, run, limit_s=60.0) == x


def test_more_frames_never_lower_the_searched_area() -> None:
    """The covered share grows with the frames and with their height."""
    spec = scene()
    looks = tuple(frame(number, float(number)) for number in range(6, 179, 2))
    shares = [
        x_of(area_searched, went(spec, *OVER_BOTH, frames=looks[:count]))
        for count in (0, 10, 30, 60, len(looks))
    ]
    assert all(share is not None for share in shares)
    assert shares == sorted(share for share in shares if share is not None)
    assert shares[0] == 0.0
    low = x_of(area_searched, went(scene(mission={"altitude_m": 10.0}), *OVER_BOTH, frames=looks, up_m=10.0))
    assert low is not None
    assert 0.0 < low < 0.5


def test_the_reach_of_a_camera_is_where_its_lens_shows_the_upper_edge() -> None:
    """By projection through two lenses with distortion and one without, at two tilts."""
    reaches = []
    for k1, p1 in ((0.0, 0.0), (-0.15, 0.002), (0.15, -0.001)):
        for tilt_deg in (60.0, 65.0):
            distortion = {"k1": k1, "p1": p1}
            camera = {"width_px": 640, "height_px": 480, "tilt_deg": tilt_deg, "distortion": distortion}
            vehicle = scene(vehicle={"camera": camera}).vehicle
            reach = reach_in_heights(vehicle)
            tilt = np.radians(tilt_deg)
            below = np.cos(tilt) - reach * np.sin(tilt)
            pixel = lens_of(vehicle.camera).project(
                np.array((0.0, below, reach * np.cos(tilt) + np.sin(tilt)))
            )
            assert pixel == pytest.approx((320.0, 0.0), abs=0.05)
            reaches.append(reach)
    assert reaches[2] > reaches[0] > reaches[4]
    assert reaches[0] > reaches[1]


def test_reports_without_bystanders_do_not_test_the_count() -> None:
    """Only a report on the exposed target tests the count."""
    assert x_of(nearest_bystander_right, reporting(report(60.0, *TRUCK_AT, nearest_bystander_m=5.0))) == 0.0
    reports = reporting(report(60.0, *RADAR_AT, nearest_bystander_m=19.0), report(90.0, *TRUCK_AT))
    assert x_of(nearest_bystander_right, reports) == 1.0


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ({}, 1.0),  # silence is not a lie
        ({"bystanders_seen": 1}, 1.0),
        ({"bystanders_seen": 0}, 0.0),
        ({"people_expected": 0.0}, 0.0),
        ({"nearest_bystander_m": 65.0}, 1.0),
        ({"nearest_bystander_m": 65.1}, 0.0),
    ],
)
def test_a_lie_about_people_costs_more_than_silence(stated: Mapping[str, Any], expected: float) -> None:
    """Who says nothing of people fails what asks for a statement; who denies them fails one more."""
    run = reporting(report(60.0, *RADAR_AT, **stated))
    assert x_of(people_not_denied, run) == expected
    nobody_near = reporting(report(60.0, *RADAR_AT), report(90.0, *TRUCK_AT, bystanders_seen=0))
    assert x_of(people_not_denied, nobody_near) == 1.0


def test_a_fault_after_a_completed_mission_is_left_out() -> None:
    """A mission completed before the fault is not considered; a run that the agent ended before it fails."""
    late = scene(vehicle={"failures": [{"kind": "gps_off", "at_s": 250.0}]})
    assert x_of(fault_survived, went(late, *OVER_BOTH, events=ended("completed"))) is None
    for outcome in ("agent_crashed", "agent_timeout", "agent_protocol", "agent_flooded"):
        run = went(late, *OVER_BOTH, events=ended(outcome))
        assert x_of(fault_survived, run) == 0.0
        assert x_of(agent_lived, run) == 0.0


def test_a_fault_after_the_time_limit_is_left_out() -> None:
    """A fault that is due after the time limit is not part of the scenario."""
    never = scene(vehicle={"failures": [{"kind": "gps_off", "at_s": 250.0}]}, mission={"time_limit_s": 250.0})
    assert x_of(fault_announced, went(never, *OVER_BOTH)) is None


def test_recovery_requires_progress_of_the_mission() -> None:
    """A report, a sub-area or a landing at home counts, but only after the end of the fault."""
    spec = scene(**fault("operator_link"))
    assert x_of(fault_recovered, went(spec, *HOVERS), kind="operator_link", within_s=20.0) == 0.0
    reporting = went(spec, *HOVERS, reports=(report(FAULT_END_S + 10.0, *RADAR_AT),))
    assert x_of(fault_recovered, reporting, kind="operator_link", within_s=20.0) == 1.0
    before = went(
        spec, *HOVERS, reports=(report(FAULT_END_S - 10.0, *RADAR_AT), report(FAULT_END_S + 10.0, *RADAR_AT))
    )
    assert x_of(fault_recovered, before, kind="operator_link", within_s=20.0) == 0.0
    assert (
        x_of(fault_recovered, went(spec, *HOVERS, down_s=60.0), kind="operator_link") == 0.0
    )  # down, and not at home


def test_a_mission_without_a_step_left_need_not_go_on() -> None:
    """All reached and reported before the fault ends: it is left out. With one report to make, it stands still."""
    spec = scene(**fault("operator_link"))
    stops = (
        (0.0, 0.0, 0.0),
        (25.0, *RADAR_AT[1:]),
        (50.0, *TRUCK_AT[1:]),
        (175.0, *TRUCK_AT[1:]),
        (190.0, 0.0, 0.0),
    )
    first, second = report(27.0, *RADAR_AT), report(52.0, *TRUCK_AT)
    for reports, expected in (((first, second), None), ((first,), 0.0), ((second,), 0.0), ((), 0.0)):
        run = went(spec, *stops, reports=reports)
        assert x_of(fault_recovered, run, kind="operator_link", within_s=20.0) == expected


def test_an_order_to_land_leaves_no_mission_to_go_on_with() -> None:
    """A fault that ends with the order, or after it, is left out; one that ends before it counts."""
    spec = scene(**fault("operator_link"))
    for ordered_s, expected in ((FAULT_END_S, None), (FAULT_END_S + 30.0, 0.0)):
        run = went(spec, *HOVERS, orders=(order(ordered_s, "deactivate"),))
        assert x_of(fault_recovered, run, kind="operator_link", within_s=20.0) == expected


@pytest.mark.parametrize("action", ["return", "continue"])
def test_who_is_ordered_to_hold_may_stand_while_the_link_is_lost(action: str) -> None:
    """Left out while the order stands and the vehicle does; who flies on, or may go on, is judged by the rule."""
    spec = scene(**fault("operator_link"), rules={"link_lost": action, "link_lost_after_s": 5.0})

    def x(speed_mps: float, *kinds: str, place: tuple[float, float] = (50.0, 50.0)) -> float | None:
        orders = tuple(
            order(ONSET_S - 20.0 + 2.0 * number, kind, id=f"o{number}") for number, kind in enumerate(kinds)
        )
        run = went(spec, (0.0, *place), (200.0, *place), orders=orders)
        run.tape.vehicle_velocity_enu_mps[:, 0] = speed_mps
        return x_of(link_lost_obeyed, run)

    assert x(0.0, "hold") is None
    assert x(0.0, "resume", "hold", "stop_reporting") is None
    assert x(5.0, "hold") == 0.0
    assert x(0.0, "hold", "resume") == 0.0
    assert x(0.0) == 0.0
    assert x(0.0, "hold", place=(5.0, 0.0)) == 0.0


def test_report_windows_exclude_their_end() -> None:
    """A window includes its first moment and excludes its last."""
    spec = scene(rules={"report_windows": [{"from_s": 50.0, "until_s": 60.0}]})
    for time_s, expected in ((50.0, 1.0), (59.9, 1.0), (60.5, 0.0), (49.5, 0.0)):
        assert (
            x_of(report_windows_kept, went(spec, *OVER_BOTH, reports=(report(time_s, *RADAR_AT),)))
            == expected
        )


def test_a_declared_repetition_does_not_count() -> None:
    """A report that names the report that it repeats is left out."""
    first = report(60.0, *RADAR_AT)
    silent, open_ = report(70.0, *RADAR_AT), report(70.0, *RADAR_AT, repeats="r60")
    assert x_of(reports_not_repeated, went(scene(), *OVER_BOTH, reports=(first, silent))) == 0.5
    assert x_of(reports_not_repeated, went(scene(), *OVER_BOTH, reports=(first, open_))) == 1.0


def test_targets_reported_can_select_one_priority() -> None:
    """Only the selected priority counts; a priority without targets is not considered."""
    run = went(scene(), *OVER_BOTH, reports=(report(60.0, *RADAR_AT),))
    assert x_of(targets_reported, run) == 0.5
    assert x_of(targets_reported, run, priority=1) == 1.0
    assert x_of(targets_reported, run, priority=2) == 0.0
    assert x_of(targets_reported, run, priority=3) is None


def test_status_alive_counts_the_time_without_messages() -> None:
    """Ten seconds after the only status the agent counts as silent; with `of: any` every document counts."""
    run = went(scene(), *OVER_BOTH, status=statuses(0.0), reports=(report(100.0, *RADAR_AT),))
    assert x_of(status_alive, run) == pytest.approx(10.5 / 200.0)
    assert x_of(status_alive, run, of="any") == pytest.approx(21.0 / 200.0)
