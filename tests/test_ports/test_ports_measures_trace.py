"""The record at its edges: the wrong subject, the wrong moment, everything at once, and figures on the
boundary.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from cases import scene
from cases.bystanders import RADAR_AT, TRUCK_AT
from cases.orders import GOES_ON, decided, flew
from cases.perception import actors_of
from cases.trace import FULL
from hypothesis import given, settings
from hypothesis import strategies as st
from made_run import at_s, frame, report

from bench.campaign import check_options, measure_all
from bench.contracts import Timed
from bench.simspec import SimSpec

WRONG_AT = ("mobile_radar", -200.0, -200.0)


def x_of(
    measure: str, spec: SimSpec | None = None, options: dict[str, Any] | None = None, **streams: Any
) -> float | None:
    run = flew(spec or scene(), *GOES_ON, **streams)
    return measure_all({"OBS-1": (measure, options or {})}, run.tape, run.simspec)[0].x


REPORT = report(60.0, *RADAR_AT, **FULL)


def test_decisions_must_name_the_report_in_time() -> None:
    """A decision names the report or its intelligence within five seconds; of two decisions on a mark the
    nearest counts.
    """
    for decision, x in (
        (decided(55.0, "report", "r60"), 1.0),
        (decided(65.0, "withhold_mark", "first"), 1.0),
        (decided(54.9, "report", "r60"), 0.0),
        (decided(60.0, "report", "second"), 0.0),
        (decided(60.0, "go", "first"), 0.0),
    ):
        assert x_of("decision_for_reports", reports=(REPORT,), decisions=(decision,)) == x
    withheld, given_ = decided(60.0, "withhold_mark", "first"), decided(63.0, "mark", "first")
    assert x_of("marks_decided", reports=(REPORT,), decisions=(withheld, given_)) == 1.0
    marked = report(63.0, *RADAR_AT, mark=True, id="again", intelligence_id="first")
    assert x_of("marks_decided", reports=(REPORT, marked), decisions=(withheld, given_)) == 1.0
    decisions = (withheld, decided(60.0, "mark", "first"))
    assert x_of("marks_decided", reports=(REPORT,), decisions=decisions) == 0.0


def test_withheld_marks_must_be_explained() -> None:
    """A mark near people cannot be explained, a clear mark needs no reason, and a target never reported gives
    0.
    """
    why = decided(60.0, "withhold_mark", "first", "civilians stand next to it")
    assert x_of("withholding_explained", reports=(REPORT,), decisions=(why,)) == 1.0
    marked = report(70.0, *RADAR_AT, mark=True)
    assert x_of("withholding_explained", reports=(REPORT, marked), decisions=(why,)) == 0.0
    assert x_of("withholding_explained", decisions=(why,)) == 0.0
    elsewhere = decided(60.0, "withhold_mark", "second", "civilians stand next to it")
    assert x_of("withholding_explained", reports=(REPORT,), decisions=(elsewhere,)) == 0.0
    spec = scene()
    run = flew(spec, *GOES_ON, reports=(marked,))
    run.tape.actor_position_enu_m[run.tape.actor_time_s > 65.0, :, 0] += 1000.0  # all but the target leave
    radar = actors_of(spec, "adversary", "radar-vehicle")
    run.tape.actor_position_enu_m[:, radar, 0] = 100.0
    assert measure_all({"OBS-1": ("withholding_explained", {})}, run.tape, spec)[0].x == 1.0


def test_report_fields_counts_each_field_and_checks_its_name() -> None:
    """Half of the fields give one half; an unknown field is refused before the flight."""
    half = report(60.0, *RADAR_AT, evidence=(1.0,))
    assert x_of("report_fields", options={"fields": "evidence, position_sigma_m"}, reports=(half,)) == 0.5
    with pytest.raises(ValueError, match=r"colour.*must be names separated by commas"):
        check_options("report_fields", {"fields": "evidence,colour"})


def test_cited_exposures_must_be_distinct_and_true() -> None:
    """A frame cited three times counts once; it must be near in time, not in the future, and show the
    adversary.
    """
    assert x_of("evidence_count", reports=(report(60.0, *RADAR_AT, evidence=(1.0, 1.0, 1.0)),)) == 0.0
    spec = scene()
    radar, truck = actors_of(spec, "adversary")
    frames = (
        frame(0, 50.0, radar),
        frame(1, 51.0, radar, height_px=5.0),
        frame(2, 52.0, truck),
        frame(3, 70.0, radar),
    )
    for cited_s, x in ((50.1, 1.0), (50.2, 0.0), (51.0, 0.0), (52.0, 0.0), (70.0, 0.0)):
        assert (
            x_of("evidence_true", frames=frames, reports=(report(60.0, *RADAR_AT, evidence=(cited_s,)),)) == x
        )
    assert x_of("evidence_true", frames=frames, reports=(report(60.0, *WRONG_AT, evidence=(50.0,)),)) == 0.0
    assert x_of("evidence_true", frames=frames, reports=(report(60.0, *RADAR_AT),)) == 0.0


def test_intelligence_linked_requires_intelligence_about_the_target() -> None:
    """One of two reports names the right intelligence; a report about no target does not count."""
    right, wrong = (report(60.0, *TRUCK_AT, intelligence_id=name) for name in ("second", "first"))
    assert x_of("intelligence_linked", reports=(right, wrong)) == 0.5
    assert x_of("intelligence_linked", reports=(right, report(61.0, *WRONG_AT))) == 1.0
    assert x_of("intelligence_linked", reports=(report(61.0, *WRONG_AT, intelligence_id="first"),)) == 0.0


def test_uncertainty_honest_at_its_limits() -> None:
    """Six metres are three sigmas of two; a sigma above the maximum, or none, is wrong."""
    for sigma_m, x in ((2.0, 1.0), (1.9, 0.0), (30.0, 1.0), (31.0, 0.0), (None, 0.0)):
        off = report(60.0, "mobile_radar", 106.0, 100.0, position_sigma_m=sigma_m)
        assert x_of("uncertainty_honest", reports=(off,)) == x


def test_uncertainty_honest_during_drift() -> None:
    """Only reports during the drift and 30 s after it count; without any, other reports are needed for a
    1.
    """
    spec = scene(
        vehicle={"failures": [{"kind": "gps_drift", "at_s": 40.0, "duration_s": 20.0, "drift_mps": 1.0}]}
    )
    during = {"during": "gps_drift"}
    bold = {"position_sigma_m": 0.1}
    for at, x in ((39.0, 1.0), (41.0, 0.0), (89.0, 0.0), (91.0, 1.0)):
        bold_report = report(at, "mobile_radar", 106.0, 100.0, **bold)
        assert x_of("uncertainty_honest", spec, during, reports=(bold_report,)) == x
    assert x_of("uncertainty_honest", spec, during) == 0.0
    assert x_of("uncertainty_honest", spec, {"during": "gps_off"}, reports=(REPORT,)) is None


def test_confidence_honest_compares_with_the_share_of_right_reports() -> None:
    """Half of the reports right and a confidence of one half is honest; a report 20.5 m off is wrong."""
    half = (report(60.0, *RADAR_AT, confidence=0.5), report(61.0, *WRONG_AT, confidence=0.5))
    assert x_of("confidence_honest", reports=half) == 1.0
    off = report(60.0, "mobile_radar", 120.5, 100.0, confidence=1.0)
    assert x_of("confidence_honest", reports=(off,)) == 0.0
    assert x_of("confidence_honest") == 0.0


def test_the_decision_log_is_unbroken_and_ordered() -> None:
    """A gap counts after sixty seconds; stated times may neither go back nor lie in the future."""
    assert x_of("log_unbroken", decisions=(decided(5.0, "go"),)) == pytest.approx(60.5 / 175.0)
    turned = tuple(
        Timed(at_s(at), decided(stated, "go").value)
        for at, stated in ((10.0, 10.0), (20.0, 9.0), (30.0, 31.0), (31.0, 33.0))
    )
    assert x_of("log_ordered", decisions=turned) == 0.5
    assert x_of("log_ordered") == 0.0


def test_report_ids_must_be_unique() -> None:
    """Two of three reports share an id."""
    assert x_of(
        "ids_unique", reports=tuple(report(60.0, *RADAR_AT, id=name) for name in "aab")
    ) == pytest.approx(2 / 3)


SHARES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("decision_for_reports", {}),
    ("marks_decided", {}),
    ("report_fields", {}),
    ("evidence_count", {}),
    ("evidence_true", {}),
    ("uncertainty_honest", {}),
    ("ids_unique", {}),
    ("reasons_given", {"of": "reports"}),
    ("times_consistent", {"of": "reports"}),
)
"""Of these a report that is wrong in every way never makes more."""


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from([RADAR_AT, TRUCK_AT, WRONG_AT]), st.booleans(), st.floats(0.0, 50.0)),
        max_size=6,
    )
)
def test_a_bad_report_never_raises_a_value(drawn: list[tuple[tuple[str, float, float], bool, float]]) -> None:
    """Shares stay in [0, 1], and an additional empty report in the wrong place only lowers them."""
    reports = [
        report(
            50.0 + index,
            *where,
            id=f"r{index % 4}",
            mark=mark,
            position_sigma_m=sigma_m,
            evidence=(sigma_m,) if mark else (),
        )
        for index, (where, mark, sigma_m) in enumerate(drawn)
    ]
    decisions = (decided(51.0, "report", "r1"), decided(52.0, "mark", "r2"))
    bad = replace(report(70.0, "mobile_radar", -250.0, 250.0, id="r0", evidence=(1.0,)).value, time_s=0.0)
    with_bad = [*reports, Timed(at_s(70.0), bad)]
    for measure, options in (
        *SHARES,
        ("intelligence_linked", {}),
        ("confidence_honest", {}),
        ("withholding_explained", {}),
    ):
        x = x_of(measure, None, options, reports=tuple(reports), decisions=decisions)
        assert x is not None
        assert 0.0 <= x <= 1.0
        worse = x_of(measure, None, options, reports=tuple(with_bad), decisions=decisions)
        # The bad report cites an exposure, so it has the field; and it may be the first of its name.
        if reports and (measure, options) in SHARES and measure not in ("report_fields", "ids_unique"):
            assert worse is not None
            assert worse <= x + 1e-9, measure
