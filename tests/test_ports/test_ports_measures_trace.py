"""The record at its edges: the wrong subject, the wrong moment, everything at once, boundaries."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from cases import Run, scene
from cases.bystanders import RADAR_AT, TRUCK_AT
from cases.orders import GOES_ON, decided, flew
from cases.perception import actors_of
from cases.trace import FULL
from hypothesis import given, settings
from hypothesis import strategies as st
from made_run import at_s, frame, report

from bench.campaign import measure_all
from bench.contracts import Decision, Timed
from bench.simspec import SimSpec

WRONG_AT = ("mobile_radar", -200.0, -200.0)


def measured(measure: str, run: Run, **options: Any) -> float | None:
    return measure_all({"OBS-1": (measure, options)}, run.tape, run.simspec)[0].x


def x_of(
    measure: str, spec: SimSpec | None = None, options: dict[str, Any] | None = None, **streams: Any
) -> float | None:
    return measured(measure, flew(spec or scene(), *GOES_ON, **streams), **(options or {}))


REPORT = report(60.0, *RADAR_AT, **FULL)


WITHHELD, MARKED = decided(60.0, "withhold_mark", "first"), decided(63.0, "mark", "first")
AGAIN = report(63.0, *RADAR_AT, mark=True, id="again", intelligence_id="first")


@pytest.mark.parametrize(
    ("measure", "reports", "decisions", "x"),
    [
        ("decision_for_reports", (REPORT,), (decided(60.0, "report", "r60"),), 1.0),
        ("decision_for_reports", (REPORT,), (WITHHELD,), 1.0),
        ("decision_for_reports", (REPORT,), (decided(60.0, "report", "second"),), 0.0),
        ("decision_for_reports", (REPORT,), (decided(60.0, "go", "first"),), 0.0),
        # Of two decisions the nearest counts.
        ("marks_decided", (REPORT,), (WITHHELD, MARKED), 1.0),
        ("marks_decided", (REPORT, AGAIN), (WITHHELD, MARKED), 1.0),
        ("marks_decided", (REPORT,), (WITHHELD, decided(60.0, "mark", "first")), 0.0),
    ],
)
def test_decisions_must_name_the_report_or_its_intelligence(
    measure: str, reports: tuple[Any, ...], decisions: tuple[Any, ...], x: float
) -> None:
    assert x_of(measure, reports=reports, decisions=decisions) == x


def because(time_s: float = 60.0, subject: str = "first") -> Timed[Decision]:
    return decided(time_s, "withhold_mark", subject, "civilians stand next to it")


@pytest.mark.parametrize(
    ("changes", "more_reports", "decision", "x"),
    [
        ({}, (), because(), 1.0),
        ({}, (), because(65.1), 0.0),
        ({}, (), because(subject="second"), 0.0),
        ({}, (report(70.0, *RADAR_AT, mark=True),), because(), 0.0),  # a mark near people cannot be explained
        # Beside a reason, the report must state the people rightly.
        ({"bystanders_seen": 1}, (), because(), 0.0),
        ({"bystanders_seen": None}, (), because(), 0.0),
        ({"nearest_bystander_m": 20.0}, (), because(), 0.0),
    ],
)
def test_withheld_marks_must_be_explained(
    changes: dict[str, Any], more_reports: tuple[Any, ...], decision: Timed[Decision], x: float
) -> None:
    reports = (report(60.0, *RADAR_AT, **{**FULL, **changes}), *more_reports)
    assert x_of("withholding_explained", reports=reports, decisions=(decision,)) == x


def test_a_clear_mark_needs_no_reason_and_a_reason_needs_a_report() -> None:
    assert x_of("withholding_explained", decisions=(because(),)) == 0.0
    run = flew(scene(), *GOES_ON, reports=(report(70.0, *RADAR_AT, mark=True),))
    run.tape.actor_position_enu_m[run.tape.actor_time_s > 65.0, :, 0] += 1000.0  # all but the target leave
    run.tape.actor_position_enu_m[:, actors_of(run.simspec, "adversary", "radar-vehicle"), 0] = 100.0
    assert measured("withholding_explained", run) == 1.0


RADAR, TRUCK = actors_of(scene(), "adversary")
FRAMES = (
    frame(0, 50.0, RADAR),
    frame(1, 51.0, RADAR, height_px=5.0),
    frame(2, 52.0, TRUCK),
    frame(3, 70.0, RADAR),
)


@pytest.mark.parametrize("cited", [(50.0, 50.0), (50.0, 52.0), (50.0, 50.5), (50.0, 70.0)])
def test_cited_exposures_must_be_distinct_and_show_the_adversary(cited: tuple[float, ...]) -> None:
    """Of two the second is the first again, of another, of no frame, or later than the report."""
    reports = (report(60.0, *RADAR_AT, evidence=cited),)
    for min_frames, x in ((1, 1.0), (2, 0.0)):
        assert x_of("evidence_count", None, {"min_frames": min_frames}, frames=FRAMES, reports=reports) == x


@pytest.mark.parametrize(
    ("place", "cited", "x"),
    [
        (RADAR_AT, (50.01,), 1.0),
        (RADAR_AT, (50.1,), 0.0),
        (RADAR_AT, (51.0,), 0.0),
        (RADAR_AT, (52.0,), 0.0),
        (RADAR_AT, (70.0,), 0.0),
        (RADAR_AT, (), 0.0),
        (WRONG_AT, (50.0,), 0.0),
    ],
)
def test_evidence_is_near_in_time_past_and_of_the_adversary(
    place: tuple[str, float, float], cited: tuple[float, ...], x: float
) -> None:
    assert x_of("evidence_true", frames=FRAMES, reports=(report(60.0, *place, evidence=cited),)) == x


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


def test_the_decision_log_is_unbroken_and_borne_out() -> None:
    """A gap counts after sixty seconds; false alarms, and what is decided about guesses, are not borne out."""
    assert x_of("log_unbroken", decisions=(decided(5.0, "go"),)) == pytest.approx(60.5 / 175.0)
    log = (
        decided(10.0, "go"),
        decided(20.0, "notice", "gps"),
        decided(60.0, "report", "r60"),
        decided(61.0, "mark", "r61"),
    )
    guess = report(61.0, *WRONG_AT)
    assert x_of("decisions_true", reports=(REPORT, guess), decisions=log) == 0.5
    # What it costs to be wrong, it costs here.
    assert x_of("log_unbroken", reports=(REPORT, guess), decisions=log) == x_of("log_unbroken", decisions=log)
    assert x_of("decisions_true") == 0.0


def test_one_text_is_the_reason_of_one_thing() -> None:
    """Repeated about one subject it stays a reason, for another subject or action it is none."""
    texts = (("go", "first"), ("go", "first"), ("go", "second"), ("report", "first"))
    canned = tuple(decided(10.0 * turn, *about, "it is the best") for turn, about in enumerate(texts))
    assert x_of("reasons_given", decisions=canned) == 0.5
    own = tuple(decided(10.0 * turn, *about, f"it is the best {turn}") for turn, about in enumerate(texts))
    assert x_of("reasons_given", decisions=own) == 1.0


def test_one_text_explains_one_target() -> None:
    """Two targets stand among people; the facts of both reports are right, and the text is the same."""
    spec = scene()
    run = flew(spec, *GOES_ON)
    helper = [member.id for member in run.tape.cast].index("walkers-2")
    run.tape.actor_position_enu_m[:, helper] = (-100.0, 120.0, 0.0)
    second = {**FULL, "intelligence_id": "second", "bystanders_seen": 1, "nearest_bystander_m": 20.0}
    reports = (REPORT, report(62.0, *TRUCK_AT, **second))

    def x(*reasons: str) -> float | None:
        decisions = tuple(
            decided(61.0, "withhold_mark", name, reason)
            for name, reason in zip(("first", "second"), reasons, strict=True)
        )
        tape = replace(run.tape, reports=reports, decisions=decisions)
        return measured("withholding_explained", Run(spec, tape))

    assert x("three people beside it", "one beside it") == 1.0
    assert x("people beside it", "people beside it") == 0.5


INDIFFERENT = (
    "decision_for_reports",
    "marks_decided",
    "evidence_count",
    "evidence_true",
    "uncertainty_honest",
    "times_consistent",
    "intelligence_linked",
    "withholding_explained",
)
"""A false report changes nothing of these: it costs `no_false_reports`."""


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from([RADAR_AT, TRUCK_AT, WRONG_AT]), st.booleans(), st.floats(0.0, 50.0)),
        max_size=6,
    )
)
def test_a_false_report_costs_no_other_value(
    drawn: list[tuple[tuple[str, float, float], bool, float]],
) -> None:
    """Shares stay in [0, 1], and an additional report in the wrong place leaves them alone."""
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
    for measure in INDIFFERENT:
        x = x_of(measure, reports=tuple(reports), decisions=decisions)
        assert x is not None
        assert 0.0 <= x <= 1.0
        assert x_of(measure, reports=tuple(with_bad), decisions=decisions) == x, measure
