"""What agents report and ask, and how the operator answers; however often they do, the page stays small and counts all."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_campaign import AGENTS, Made, made_simspec, made_tape, make_campaign, timed
from test_reporting_page import Page

from bench.contracts import ConsentAnswer, ConsentRequest, Decision, Tape, TargetReport, Timed
from bench.reporting import ReportData, build_run_map, load_report_data, map_figure, render_report
from bench.reporting.figures._map import MAX_LABELS, MAX_RINGED_REPORTS, labelled_reports, ringed_reports
from bench.reporting.map._consents import all_consents
from bench.reporting.map._reports import map_reports
from bench.reporting.map._run_map import RunMap
from bench.reporting.map._sample import MAX_DRAWN
from bench.simspec import SimSpec

MESSAGES = 900


def many(tape: Tape, count: int) -> Tape:
    """The tape with `count` reports, decisions and requests, in the order of time."""
    random = np.random.default_rng(count)
    times = np.sort(random.uniform(1.0, 119.0, count)).tolist()

    def report_at(time_s: float, name: str) -> Timed[TargetReport]:
        east_m, north_m = random.uniform((-290, -115), (290, 115)).tolist()
        found: dict[str, Any] = {"class_label": "mobile_radar", "east_m": east_m, "north_m": north_m}
        found |= {"confidence": 0.5, "mark": bool(random.random() < 0.5)}
        return timed(time_s, TargetReport(id=name, time_s=time_s, **found))

    return replace(
        tape,
        reports=tuple(report_at(time_s, f"r{number}") for number, time_s in enumerate(times)),
        decisions=tuple(
            timed(time_s, Decision(time_s=time_s, action="report", reason="spam")) for time_s in times
        ),
        consent_requests=tuple(request_at(time_s, f"c{number}") for number, time_s in enumerate(times)),
    )


def request_at(time_s: float, name: str, about: str = "first", east_m: float = 5.0) -> Timed[ConsentRequest]:
    found: dict[str, Any] = {
        "class_label": "mobile_radar",
        "east_m": east_m,
        "north_m": 7.0,
        "confidence": 0.5,
    }
    asked: dict[str, Any] = {"id": name, "time_s": time_s, "intelligence_id": about, "bystanders_seen": 2}
    return timed(time_s, ConsentRequest(**found, **asked, reason=f"about <{about}>"))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    return load_report_data(make_campaign(tmp_path_factory.mktemp("many") / "c", Made(scenes=1)))


def chart_of(data: ReportData, count: int) -> RunMap:
    simspec = made_simspec(0, AGENTS[0])
    return build_run_map(data.runs[0], simspec, many(made_tape(simspec), count))


def test_every_drawn_report_has_a_cross(data: ReportData) -> None:
    """Whatever their number; rings and labels stay few."""
    chart = chart_of(data, MESSAGES)
    figure, kinds = map_figure(chart), {True: "marked", False: "withheld mark"}
    titles = re.findall(r"<title>((?:withheld mark|marked) at [^<]*)</title>", figure)
    drawn = [
        f"{kinds[report.mark]} at {report.time_s:.1f} s, confidence {report.confidence:.2f}"
        for report in chart.reports.drawn
    ]
    assert sorted(titles) == sorted(drawn)
    labels = re.findall(r"<text[^>]*>(?:withheld mark|marked), \d+ s</text>", figure)
    assert len(labels) == len(labelled_reports(chart))


def test_rings_go_to_marks_against_the_rule_first(data: ReportData) -> None:
    """Nobody should have to look for the marks that matter most; each kind is in time order."""
    reports = chart_of(data, MESSAGES).reports.drawn
    forbidden = [report for report in reports if report.forbidden]
    assert 0 < len(forbidden) < len(reports)
    ringed = ringed_reports(reports)
    assert len(ringed) == MAX_RINGED_REPORTS
    assert ringed[: len(forbidden)] == forbidden[:MAX_RINGED_REPORTS]
    few = [*forbidden[:2], *(report for report in reports if not report.forbidden)]
    assert ringed_reports(few)[:3] == few[:3]
    assert ringed_reports(few)[-1] == few[MAX_RINGED_REPORTS - 1]


def test_labels_do_not_hide_each_other(data: ReportData) -> None:
    """By the scale of the figure: a label is some 136 by 42 pixels. Few reports have all of theirs, wherever they are."""
    chart = chart_of(data, MESSAGES)
    labelled = labelled_reports(chart)
    assert 5 <= len(labelled) <= MAX_LABELS
    assert labelled[0] == ringed_reports(chart.reports.drawn)[0]
    places = [(report.east_m, report.north_m) for report in labelled]
    # The area is 600 m wide and its plot some 950 pixels, so a label is some 86 m wide and 27 m high.
    for row, (east_m, north_m) in enumerate(places):
        assert all(abs(east_m - e) > 80.0 or abs(north_m - n) > 25.0 for e, n in places[:row])
    few = replace(chart, reports=replace(chart.reports, drawn=chart.reports.drawn[:1] * MAX_LABELS))
    assert len(labelled_reports(few)) == MAX_LABELS


def test_tables_show_the_first_messages_and_count_all(data: ReportData) -> None:
    """Two hundred rows of each kind of message, with the number of all of them."""
    chart = chart_of(data, MESSAGES)
    page = Page(render_report(data, [chart]))
    rows = [row for row in page.tables[""] if row[0].replace(".", "").isdigit()]
    assert [sum(len(row) == columns for row in rows) for columns in (4, 7, 8)] == [200, 200, 200]
    against = sum(report.forbidden for report in chart.reports.drawn)
    for words in (
        f"900 reports, the first 200 shown; {against} marked against the rule",
        "900 requests, the first 200 shown",
        "900 lines, the first 200 shown",
        f"Rings are drawn for {MAX_RINGED_REPORTS} of the 900 reports",
        f"Labels are drawn for {len(labelled_reports(chart))} reports that do not hide each other.",
    ):
        assert words in page.text


@pytest.mark.parametrize("seed", range(20))
def test_answers_match_a_search_through_all_of_them(seed: int) -> None:
    """Ids that are used again, at the same moment too, and answers that come late, twice or never."""
    random = np.random.default_rng(seed)
    asked_s, answered_s = (np.sort(random.integers(0, last, 15)).astype(float) for last in (12, 14))
    requests = tuple(request_at(time_s, f"c{random.integers(3)}") for time_s in asked_s.tolist())
    answers = tuple(
        timed(
            time_s, ConsentAnswer(request=f"c{random.integers(3)}", granted=bool(number % 2), answered_s=0.0)
        )
        for number, time_s in enumerate(answered_s.tolist())
    )
    tape = replace(made_tape(made_simspec(0, AGENTS[0])), consent_requests=requests, consents=answers)
    states_here = [consent.state for consent in all_consents(tape)]
    wanted = []
    for request in requests:
        same = [other.time.ns for other in requests if other.value.id == request.value.id]
        until = min((ns for ns in same if ns > request.time.ns), default=2**63)
        states = [
            "granted" if answer.value.granted else "refused"
            for answer in answers
            if answer.value.request == request.value.id and request.time.ns <= answer.time.ns < until
        ]
        wanted.append((states or ["never answered"])[0])
    assert states_here == wanted
    assert len(set(wanted)) > 1


def test_a_big_session_is_drawn_by_a_sample(data: ReportData) -> None:
    """Three times as many messages as are drawn: figure, tables and page stay as they are, and the counts are of all."""
    charts = [chart_of(data, count) for count in (MAX_DRAWN, 3 * MAX_DRAWN)]
    few, more = charts
    assert len(few.reports.drawn) == few.reports.count == MAX_DRAWN
    assert len(more.reports.drawn) == len(more.consents.drawn) == MAX_DRAWN
    assert len(more.decisions) == len(few.decisions)
    assert more.reports.count == more.consents.count == more.decision_count == 3 * MAX_DRAWN
    texts = [render_report(data, [chart]) for chart in charts]
    assert len(texts[1]) < 1.05 * len(texts[0])
    page = Page(texts[1])
    for words in (
        "2000 of the 3000 reports are not drawn",
        "2000 of the 3000 requests for consent are not drawn",
        "3000 reports, 1000 of them drawn, the first 200 of these shown",
        f"{more.reports.forbidden} marked against the rule",
        "3000 lines, the first 200 shown; most often report (3000)",
    ):
        assert words in page.text

    tape = many(made_tape(made_simspec(0, AGENTS[0])), 3 * MAX_DRAWN)
    parts = [map_reports(replace(tape, reports=tape.reports[start::2]), 30.0) for start in range(2)]
    assert sum(part.forbidden for part in parts) == map_reports(tape, 30.0).forbidden > 0
    assert sum(part.marked for part in parts) == map_reports(tape, 30.0).marked


def test_reports_that_matter_are_drawn_however_many_there_are() -> None:
    """The first and last about each adversary and at each place, hidden among thousands at one place."""
    tape = many(made_tape(made_simspec(0, AGENTS[0])), 3 * MAX_DRAWN)
    crowd = [
        replace(report, value=replace(report.value, east_m=280.0, north_m=5.0, mark=False))
        for report in tape.reports
    ]
    radar = tape.cast[0]
    assert radar.class_label == "mobile_radar"
    for row, east_m, mark in ((1400, 1.0, True), (1800, 2.0, False), (700, 0.5, True), (2500, 0.25, False)):
        place = tape.actors_at(crowd[row].time.s)[0]
        there = replace(crowd[row].value, east_m=float(place[0]) + east_m, north_m=float(place[1]), mark=mark)
        crowd[row] = replace(crowd[row], value=there)
    lone = replace(crowd[1600].value, east_m=-280.0, north_m=-100.0)
    crowd[1600] = replace(crowd[1600], value=lone)
    drawn = map_reports(replace(tape, reports=tuple(crowd)), 30.0).drawn
    times = [report.time_s for report in drawn]
    assert len(drawn) == MAX_DRAWN
    assert times == sorted(times)
    # Four about the radar, of each kind the first and last; the ends of the crowd; the one that stands alone.
    assert {round(crowd[row].time.s, 2) for row in (0, 700, 1400, 1600, 1800, 2500, 2999)} <= set(times)
    assert sum(report.target == radar.id for report in drawn) == 4


def answer(time_s: float, name: str, *, granted: bool) -> Timed[ConsentAnswer]:
    return timed(time_s, ConsentAnswer(request=name, granted=granted, answered_s=time_s - 1.0))


def asked(tape: Tape) -> Tape:
    """Two grants, a refusal, and two requests without an answer, one of which uses an id again."""
    return replace(
        tape,
        consent_requests=(
            request_at(10.0, "c1"),
            request_at(20.0, "c2", "second", east_m=-40.0),
            request_at(30.0, "c3", "<b>third</b>"),
            request_at(40.0, "c4", "fourth"),
            request_at(50.0, "c1"),
        ),
        # The second answer to c3 is one that no bench gives: the first counts.
        consents=(
            answer(22.0, "c1", granted=True),
            answer(33.5, "c2", granted=False),
            answer(34.0, "c3", granted=True),
            answer(35.0, "c3", granted=False),
        ),
    )


@pytest.fixture(scope="module")
def asking() -> SimSpec:
    simspec = made_simspec(0, AGENTS[0])
    rules = simspec.rules.model_copy(update={"mark_consent": True})
    return simspec.model_copy(update={"rules": rules, "orders": ()})


def test_map_draws_requests_by_answer_with_a_legend(data: ReportData, asking: SimSpec) -> None:
    figure = map_figure(build_run_map(data.runs[0], asking, asked(made_tape(asking))))
    texts = re.findall(r"<(\w+ points=\"[^\"]*\") [^>]*><title>consent to mark ([^<]*)</title>", figure)
    assert [text for _, text in texts] == [
        "first asked at 10.0 s, granted at 22.0 s",
        "second asked at 20.0 s, refused at 33.5 s",
        "&lt;b&gt;third&lt;/b&gt; asked at 30.0 s, granted at 34.0 s",
        "fourth asked at 40.0 s, never answered",
        "first asked at 50.0 s, never answered",
    ]
    # Those that stand at one place have the shape of their answer.
    places = [shape for shape, _ in texts]
    assert places[0] == places[2] != places[3] == places[4]
    for state in ("granted", "refused", "never answered"):
        assert f"consent {state}</li>" in figure


def test_page_lists_requests_beside_the_map(data: ReportData, asking: SimSpec) -> None:
    tape = made_tape(asking)
    page = Page(render_report(data, [build_run_map(data.runs[0], asking, asked(tape))]))
    rows = [row for row in page.tables[""] if len(row) == 7 and row[2] == "mobile_radar"]
    assert [(row[0], row[1], row[4], row[5]) for row in rows] == [
        ("10.0", "first", "granted", "22.0"),
        ("20.0", "second", "refused", "33.5"),
        ("30.0", "<b>third</b>", "granted", "34.0"),
        ("40.0", "fourth", "never answered", "–"),
        ("50.0", "first", "never answered", "–"),
    ]
    labels = [value for tag, name, value in page.attributes if name == "aria-label"]
    assert any("5 requests for consent, 2 granted" in label for label in labels)


def test_silence_is_told_from_a_rule_that_asks_for_nothing(data: ReportData, asking: SimSpec) -> None:
    note = "Marks need the operator’s consent in this run. The agent asked for none."
    tape = made_tape(asking)
    assert note in Page(render_report(data, [build_run_map(data.runs[0], asking, tape)])).text
    free = made_simspec(0, AGENTS[0])
    assert note not in Page(render_report(data, [build_run_map(data.runs[0], free, tape)])).text
