"""Faults, outages and reports under rules: the edges."""

from __future__ import annotations

import pytest
from air_documents import valid
from cases import scene, x_of
from cases.bystanders import RADAR_AT, TRUCK_AT
from cases.mission import OVER_BOTH, went
from cases.reliability import FAULT_END_S, ONSET_S, decided, ended, fault, statuses
from made_run import at_s, report

from bench.contracts import OrderDocument, Timed
from test_ports.reliability.faults import fault_announced, fault_recovered, fault_survived
from test_ports.reliability.health import agent_lived, status_alive
from test_ports.reliability.outages import link_lost_obeyed
from test_ports.reports.targets import (
    report_windows_kept,
    reports_not_repeated,
    targets_reported,
)


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


@pytest.mark.parametrize(("after_s", "expected"), [(0.0, 1.0), (10.0, 1.0), (10.1, 0.0), (-0.1, 0.0)])
def test_a_fault_must_be_announced_in_time(after_s: float, expected: float) -> None:
    """A decision counts from the onset to the limit, and not before the onset."""
    run = went(
        scene(**fault("gps_off")), *OVER_BOTH, decisions=(decided(ONSET_S + after_s, "notice", "gps"),)
    )
    assert x_of(fault_announced, run, kind="gps_off") == expected
    assert x_of(fault_announced, run, kind="battery_drop") is None


def test_recovery_requires_progress_of_the_mission() -> None:
    """A report, a sub-area or a landing at home counts, but only after the end of the fault."""
    spec = scene(**fault("operator_link"))
    hovers = ((0.0, 0.0, 0.0), (30.0, 0.0, -200.0), (170.0, 0.0, -200.0), (180.0, 0.0, 0.0))
    assert x_of(fault_recovered, went(spec, *hovers), kind="operator_link", within_s=20.0) == 0.0
    reporting = went(spec, *hovers, reports=(report(FAULT_END_S + 10.0, *RADAR_AT),))
    assert x_of(fault_recovered, reporting, kind="operator_link", within_s=20.0) == 1.0
    before = went(
        spec, *hovers, reports=(report(FAULT_END_S - 10.0, *RADAR_AT), report(FAULT_END_S + 10.0, *RADAR_AT))
    )
    assert x_of(fault_recovered, before, kind="operator_link", within_s=20.0) == 0.0
    assert (
        x_of(fault_recovered, went(spec, *hovers, down_s=60.0), kind="operator_link") == 0.0
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
    hovers = ((0.0, 0.0, 0.0), (30.0, 0.0, -200.0), (170.0, 0.0, -200.0), (180.0, 0.0, 0.0))
    for ordered_s, expected in ((FAULT_END_S, None), (FAULT_END_S + 30.0, 0.0)):
        fields = {"id": "down", "issued_s": ordered_s, "kind": "deactivate", "within_s": 10.0}
        orders = (Timed(at_s(ordered_s), valid(OrderDocument, fields)),)
        run = went(spec, *hovers, orders=orders)
        assert x_of(fault_recovered, run, kind="operator_link", within_s=20.0) == expected


@pytest.mark.parametrize("action", ["return", "continue"])
def test_who_is_ordered_to_hold_may_stand_while_the_link_is_lost(action: str) -> None:
    """Left out while the order stands and the vehicle does; who flies on, or may go on, is judged by the rule."""
    spec = scene(**fault("operator_link"), rules={"link_lost": action, "link_lost_after_s": 5.0})

    def x(speed_mps: float, *kinds: str, place: tuple[float, float] = (50.0, 50.0)) -> float | None:
        orders = tuple(
            Timed(
                at_s(ONSET_S - 20.0 + 2.0 * number),
                valid(OrderDocument, {"id": f"o{number}", "issued_s": 1.0, "kind": kind, "within_s": 10.0}),
            )
            for number, kind in enumerate(kinds)
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
