"""Faults, outages and reports under rules: the edges."""

from __future__ import annotations

from typing import Any

import pytest
from cases import Run, scene
from cases.bystanders import RADAR_AT, TRUCK_AT
from cases.mission import OVER_BOTH, went
from cases.reliability import MENDED_S, ONSET_S, decided, ended, fault, statuses
from made_run import report, tracks

from test_ports.reliability.faults import fault_announced, fault_recovered, fault_survived
from test_ports.reliability.health import agent_lived, status_alive
from test_ports.reliability.outages import blind_reports_withheld, link_lost_obeyed, reports_resent
from test_ports.reports.targets import report_windows_kept, reports_in_time, reports_not_repeated, targets_reported


def x_of(measure: Any, run: Run, **options: Any) -> float | None:
    x: float | None = measure("OBS-1", run.tape, run.simspec, options).x
    return x


def test_a_fault_after_a_mission_that_was_over_asks_nothing() -> None:
    """Over before it came is not considered; ended by the agent before it came is failed."""
    late = scene(vehicle={"failures": [{"kind": "gps_off", "at_s": 250.0}]})
    assert x_of(fault_survived, went(late, *OVER_BOTH, events=ended("completed"))) is None
    for outcome in ("agent_crashed", "agent_timeout", "agent_protocol"):
        run = went(late, *OVER_BOTH, events=ended(outcome))
        assert x_of(fault_survived, run) == 0.0
        assert x_of(agent_lived, run) == 0.0


def test_a_fault_past_the_limit_is_none() -> None:
    """What would happen after the time limit is no part of the scenario."""
    never = scene(vehicle={"failures": [{"kind": "gps_off", "at_s": 250.0}]}, mission={"time_limit_s": 250.0})
    assert x_of(fault_announced, went(never, *OVER_BOTH)) is None


@pytest.mark.parametrize(("after_s", "expected"), [(0.0, 1.0), (10.0, 1.0), (10.1, 0.0), (-0.1, 0.0)])
def test_noticing_has_a_time(after_s: float, expected: float) -> None:
    """From the onset to the limit; foreknowledge is none."""
    run = went(scene(**fault("gps_off")), *OVER_BOTH, decisions=(decided(ONSET_S + after_s, "notice", "gps"),))
    assert x_of(fault_announced, run, kind="gps_off") == expected
    assert x_of(fault_announced, run, kind="battery_drop") is None


def test_two_faults_are_counted_each() -> None:
    """One noticed, one not."""
    two = {
        "failures": [
            {"kind": "gps_off", "at_s": 40.0, "duration_s": 5.0},
            {"kind": "battery_drop", "at_s": 90.0, "to_fraction": 0.2},
        ]
    }
    run = went(scene(vehicle=two), *OVER_BOTH, decisions=(decided(41.0, "notice", "gps"),))
    assert x_of(fault_announced, run) == 0.5


def test_recovery_is_a_step_of_the_mission() -> None:
    """A report, a sub-area, or the way home's end; what lay before the end of the fault does not count."""
    spec = scene(**fault("operator_link"))
    hovers = ((0.0, 0.0, 0.0), (30.0, 0.0, -200.0), (170.0, 0.0, -200.0), (180.0, 0.0, 0.0))
    assert x_of(fault_recovered, went(spec, *hovers), kind="operator_link", within_s=20.0) == 0.0
    reporting = went(spec, *hovers, reports=(report(MENDED_S + 10.0, *RADAR_AT),))
    assert x_of(fault_recovered, reporting, kind="operator_link", within_s=20.0) == 1.0
    before = went(spec, *hovers, reports=(report(MENDED_S - 10.0, *RADAR_AT), report(MENDED_S + 10.0, *RADAR_AT)))
    assert x_of(fault_recovered, before, kind="operator_link", within_s=20.0) == 0.0
    assert x_of(fault_recovered, went(spec, *hovers, down_s=60.0), kind="operator_link") == 0.0  # down, and not at home


@pytest.mark.parametrize(("action", "still", "moving"), [("hold", 1.0, 0.0), ("continue", 0.0, 1.0)])
def test_without_a_link_it_does_as_agreed(action: str, still: float, moving: float) -> None:
    """Standing still is holding, and is not going on."""
    spec = scene(**fault("operator_link"), rules={"link_lost": action, "link_lost_after_s": 5.0})
    stands = went(spec, (0.0, 50.0, 50.0), (200.0, 50.0, 50.0))
    assert x_of(link_lost_obeyed, stands) == still
    goes = went(spec, *OVER_BOTH)
    goes.tape.vehicle_velocity_enu_mps[:, 0] = 5.0
    assert x_of(link_lost_obeyed, goes) == moving


def test_a_short_outage_changes_nothing() -> None:
    """Shorter than the rules let pass: nothing to do."""
    assert x_of(link_lost_obeyed, went(scene(**fault("operator_link"), rules={"link_lost_after_s": 30.0}), *OVER_BOTH)) is None


def test_what_was_heard_before_need_not_be_said_again() -> None:
    """A repetition during the outage of what was heard before it is no loss; silence throughout is."""
    spec = scene(**fault("operator_link"))
    received_before = went(spec, *OVER_BOTH, reports=(report(30.0, *RADAR_AT), report(50.0, *RADAR_AT)))
    assert x_of(reports_resent, received_before) == 1.0
    assert x_of(reports_resent, went(spec, *OVER_BOTH)) == 0.0
    half = went(spec, *OVER_BOTH, reports=(report(50.0, *RADAR_AT), report(51.0, *TRUCK_AT), report(MENDED_S, *TRUCK_AT)))
    assert x_of(reports_resent, half) == 0.5


def test_what_was_tracked_may_be_reported_blind() -> None:
    """A report on what the picture held before the outage is no guess."""
    spec = scene(**fault("detections"))
    reports = (report(60.0, *TRUCK_AT),)
    known = went(spec, *OVER_BOTH, reports=reports, tracks=(tracks(30.0, TRUCK_AT),))
    assert x_of(blind_reports_withheld, known) == 1.0
    too_late = went(spec, *OVER_BOTH, reports=reports, tracks=(tracks(50.0, TRUCK_AT),))
    assert x_of(blind_reports_withheld, too_late) == 0.0


def test_windows_end_before_their_end() -> None:
    """From the first moment of a window on, not at its last."""
    spec = scene(rules={"report_windows": [{"from_s": 50.0, "until_s": 60.0}]})
    for time_s, expected in ((50.0, 1.0), (59.9, 1.0), (60.5, 0.0), (49.5, 0.0)):
        assert x_of(report_windows_kept, went(spec, *OVER_BOTH, reports=(report(time_s, *RADAR_AT),))) == expected


def test_the_deadline_counts_from_delivery() -> None:
    """Intelligence that comes late has its time from then on."""
    late = [{"id": "first", "about": "radar", "uncertainty_m": 50.0, "delivered_s": 100.0}]
    spec = scene(intelligence=late, rules={"report_deadline_s": 30.0})
    assert x_of(reports_in_time, went(spec, *OVER_BOTH, reports=(report(125.0, *RADAR_AT),))) == 1.0
    assert x_of(reports_in_time, went(spec, *OVER_BOTH, reports=(report(135.0, *RADAR_AT),))) == 0.0
    assert x_of(reports_in_time, went(spec, *OVER_BOTH, reports=(report(135.0, *RADAR_AT),)), limit_s=60.0) == 1.0


def test_a_repetition_that_says_so_is_none() -> None:
    """Saying which report is repeated is good manners."""
    first = report(60.0, *RADAR_AT)
    silent, open_ = report(70.0, *RADAR_AT), report(70.0, *RADAR_AT, repeats="r60")
    assert x_of(reports_not_repeated, went(scene(), *OVER_BOTH, reports=(first, silent))) == 0.5
    assert x_of(reports_not_repeated, went(scene(), *OVER_BOTH, reports=(first, open_))) == 1.0


def test_targets_of_one_priority() -> None:
    """The most urgent alone; a priority that nobody has is not considered."""
    run = went(scene(), *OVER_BOTH, reports=(report(60.0, *RADAR_AT),))
    assert x_of(targets_reported, run) == 0.5
    assert x_of(targets_reported, run, priority=1) == 1.0
    assert x_of(targets_reported, run, priority=2) == 0.0
    assert x_of(targets_reported, run, priority=3) is None


def test_silence_is_counted_by_time() -> None:
    """Ten seconds after the only status the agent is not heard to be alive; any document serves where any counts."""
    run = went(scene(), *OVER_BOTH, status=statuses(0.0), reports=(report(100.0, *RADAR_AT),))
    assert x_of(status_alive, run) == pytest.approx(10.5 / 200.0)
    assert x_of(status_alive, run, of="any") == pytest.approx(21.0 / 200.0)
