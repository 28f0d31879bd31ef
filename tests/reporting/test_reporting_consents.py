"""The map shows every request for consent, and how the operator answered it."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from made_campaign import AGENTS, Made, made_simspec, made_tape, make_campaign
from test_reporting_page import Page

from bench.contracts import ConsentAnswer, ConsentRequest, SimTime, Tape, Timed
from bench.reporting import ReportData, build_run_map, load_report_data, map_figure, render_report
from bench.reporting.map._consents import all_consents
from bench.simspec import SimSpec


def request(time_s: float, name: str, about: str, east_m: float = 5.0) -> Timed[ConsentRequest]:
    return Timed(
        SimTime(round(time_s * 1e9)),
        ConsentRequest(
            id=name,
            time_s=time_s,
            intelligence_id=about,
            class_label="mobile_radar",
            east_m=east_m,
            north_m=7.0,
            confidence=0.9,
            bystanders_seen=2,
            reason=f"about <{about}>",
        ),
    )


def answer(time_s: float, name: str, *, granted: bool) -> Timed[ConsentAnswer]:
    document = ConsentAnswer(request=name, granted=granted, answered_s=time_s - 1.0)
    return Timed(SimTime(round(time_s * 1e9)), document)


def asked(tape: Tape) -> Tape:
    """Two grants, a refusal, and two requests without an answer, one of which uses an id again."""
    return replace(
        tape,
        consent_requests=(
            request(10.0, "c1", "first"),
            request(20.0, "c2", "second", east_m=-40.0),
            request(30.0, "c3", "<b>third</b>"),
            request(40.0, "c4", "fourth"),
            request(50.0, "c1", "first"),
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
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    return load_report_data(make_campaign(tmp_path_factory.mktemp("consents") / "c", Made(scenes=1)))


@pytest.fixture(scope="module")
def simspec() -> SimSpec:
    simspec = made_simspec(0, AGENTS[0])
    return simspec.model_copy(
        update={"rules": simspec.rules.model_copy(update={"mark_consent": True}), "orders": ()}
    )


def test_each_request_has_the_answer_that_reached_the_agent(simspec: SimSpec) -> None:
    """An answer belongs to the last request with its id; one that came late enough belongs to the second."""
    tape = asked(made_tape(simspec))
    states = [(consent.state, consent.answered_s) for consent in all_consents(tape)]
    nothing = ("never answered", None)
    assert states == [("granted", 22.0), ("refused", 33.5), ("granted", 34.0), nothing, nothing]
    later = replace(tape, consents=(answer(60.0, "c1", granted=False),))
    assert [consent.state for consent in all_consents(later)] == ["never answered"] * 4 + ["refused"]


def test_map_draws_requests_by_answer_with_a_legend(data: ReportData, simspec: SimSpec) -> None:
    figure = map_figure(build_run_map(data.runs[0], simspec, asked(made_tape(simspec))))
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


def test_page_lists_requests_beside_the_map(data: ReportData, simspec: SimSpec) -> None:
    tape = made_tape(simspec)
    page = Page(render_report(data, [build_run_map(data.runs[0], simspec, asked(tape))]))
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


def test_silence_is_told_from_a_rule_that_asks_for_nothing(data: ReportData, simspec: SimSpec) -> None:
    note = "Marks need the operator’s consent in this run. The agent asked for none."
    tape = made_tape(simspec)
    assert note in Page(render_report(data, [build_run_map(data.runs[0], simspec, tape)])).text
    free = made_simspec(0, AGENTS[0])
    assert note not in Page(render_report(data, [build_run_map(data.runs[0], free, tape)])).text
