"""Agents report and ask as often as they like: the page stays small, and nothing is lost from its counts."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from made_campaign import AGENTS, Made, made_simspec, made_tape, make_campaign
from test_reporting_page import Page

from bench.contracts import ConsentAnswer, ConsentRequest, Decision, SimTime, Tape, TargetReport, Timed
from bench.reporting import ReportData, build_run_map, load_report_data, map_figure, render_report
from bench.reporting.figures._map import MAX_LABELS, MAX_RINGED_REPORTS, labelled_reports, ringed_reports
from bench.reporting.map._consents import all_consents
from bench.reporting.map._reports import map_reports
from bench.reporting.map._run_map import RunMap
from bench.reporting.map._sample import MAX_DRAWN
from bench.simspec import SimSpec

MESSAGES = 900


def at(time_s: float) -> SimTime:
    return SimTime(round(time_s * 1e9))


def many(tape: Tape, count: int) -> Tape:
    """The tape with `count` reports, decisions and requests, in the order of time."""
    random = np.random.default_rng(count)
    times = np.sort(random.uniform(1.0, 119.0, count)).tolist()
    return replace(
        tape,
        reports=tuple(
            Timed(
                at(time_s),
                TargetReport(
                    id=f"r{number}",
                    time_s=time_s,
                    class_label="mobile_radar",
                    east_m=float(random.uniform(-290, 290)),
                    north_m=float(random.uniform(-115, 115)),
                    confidence=0.5,
                    mark=bool(random.random() < 0.5),
                ),
            )
            for number, time_s in enumerate(times)
        ),
        decisions=tuple(
            Timed(at(time_s), Decision(time_s=time_s, action="report", reason="spam")) for time_s in times
        ),
        consent_requests=tuple(request_at(time_s, f"c{number}") for number, time_s in enumerate(times)),
    )


def request_at(time_s: float, name: str) -> Timed[ConsentRequest]:
    document = ConsentRequest(
        id=name,
        time_s=time_s,
        intelligence_id="first",
        class_label="mobile_radar",
        east_m=0.0,
        north_m=0.0,
        confidence=0.5,
        bystanders_seen=0,
    )
    return Timed(at(time_s), document)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    return load_report_data(make_campaign(tmp_path_factory.mktemp("many") / "c", Made(scenes=1)))


def chart_of(data: ReportData, count: int) -> RunMap:
    simspec = made_simspec(0, AGENTS[0])
    return build_run_map(data.runs[0], simspec, many(made_tape(simspec), count))


def test_every_drawn_report_has_a_cross(data: ReportData) -> None:
    """Whatever their number; rings and labels stay few."""
    chart = chart_of(data, MESSAGES)
    titles = re.findall(r"<title>((?:withheld mark|marked) at [^<]*)</title>", map_figure(chart))
    drawn = [
        f"{'marked' if report.mark else 'withheld mark'} at {report.time_s:.1f} s, confidence {report.confidence:.2f}"
        for report in chart.reports.drawn
    ]
    assert sorted(titles) == sorted(drawn)
    labels = re.findall(r"<text[^>]*>(?:withheld mark|marked), \d+ s</text>", map_figure(chart))
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
    by_columns = {
        width: [row for row in page.tables[""] if len(row) == width and row[0].replace(".", "").isdigit()]
        for width in (4, 7, 8)
    }
    assert {width: len(rows) for width, rows in by_columns.items()} == {4: 200, 7: 200, 8: 200}
    against = sum(report.forbidden for report in chart.reports.drawn)
    assert f"900 reports, the first 200 shown; {against} marked against the rule" in page.text
    assert "900 requests, the first 200 shown" in page.text
    assert "900 lines, the first 200 shown" in page.text
    assert f"Rings are drawn for {MAX_RINGED_REPORTS} of the 900 reports" in page.text
    labels = len(labelled_reports(chart))
    assert f"Labels are drawn for {labels} reports that do not hide each other." in page.text


@pytest.mark.parametrize("seed", range(20))
def test_answers_match_a_search_through_all_of_them(seed: int) -> None:
    """Ids that are used again, at the same moment too, and answers that come late, twice or never."""
    random = np.random.default_rng(seed)
    requests = tuple(
        request_at(float(time_s), f"c{random.integers(3)}") for time_s in np.sort(random.integers(0, 12, 15))
    )
    answers = tuple(
        Timed(
            at(float(time_s)),
            ConsentAnswer(request=f"c{random.integers(3)}", granted=bool(number % 2), answered_s=0.0),
        )
        for number, time_s in enumerate(np.sort(random.integers(0, 14, 15)))
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
    few, many = charts
    assert len(few.reports.drawn) == few.reports.count == MAX_DRAWN
    assert len(many.reports.drawn) == len(many.consents.drawn) == MAX_DRAWN
    assert len(many.decisions) == len(few.decisions)
    assert many.reports.count == many.consents.count == many.decision_count == 3 * MAX_DRAWN
    texts = [render_report(data, [chart]) for chart in charts]
    assert len(texts[1]) < 1.05 * len(texts[0])
    page = Page(texts[1])
    assert "2000 of the 3000 reports are not drawn" in page.text
    assert "2000 of the 3000 requests for consent are not drawn" in page.text
    assert "3000 reports, 1000 of them drawn, the first 200 of these shown" in page.text
    assert f"{many.reports.forbidden} marked against the rule" in page.text
    assert "3000 lines, the first 200 shown; most often report (3000)" in page.text

    simspec = made_simspec(0, AGENTS[0])
    tape = many_of(simspec)
    parts = [map_reports(replace(tape, reports=tape.reports[start::2]), 30.0) for start in range(2)]
    assert sum(part.forbidden for part in parts) == map_reports(tape, 30.0).forbidden > 0
    assert sum(part.marked for part in parts) == map_reports(tape, 30.0).marked


def many_of(simspec: SimSpec) -> Tape:
    return many(made_tape(simspec), 3 * MAX_DRAWN)


def test_reports_that_matter_are_drawn_however_many_there_are(data: ReportData) -> None:
    """The first and last about each adversary and at each place, hidden among thousands at one place."""
    simspec = made_simspec(0, AGENTS[0])
    tape = many_of(simspec)
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
