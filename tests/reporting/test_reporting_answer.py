"""The paragraph that answers the question has the numbers of the tables, and says what weakens it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from made_campaign import AGENTS, STUDY, Made, make_campaign
from test_reporting_page import Page, page_of

from bench.contracts import Outcome
from bench.reporting import ReportData, load_report_data
from bench.reporting._campaign_data import ReportedCompetence
from bench.reporting.text._answer import answer_paragraph
from bench.scoring import NodeFloor
from bench.statistics import clopper_pearson

NAIVE, AWARE = AGENTS
LOST = "p004-r0-reference-bystander-aware"
CRASHED = "p003-r0-reference-naive"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    endings = {CRASHED: (Outcome.AGENT_CRASHED, "exit <1>"), LOST: (Outcome.WORKER_LOST, "killed")}
    return make_campaign(tmp_path_factory.mktemp("answer") / "c", Made(scenes=12, endings=endings))


@pytest.fixture(scope="module")
def data(folder: Path) -> ReportData:
    return load_report_data(folder)


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return page_of(folder)[0]


def paragraph(data: ReportData, agent: str) -> str:
    return answer_paragraph(data, agent).replace("\u00a0", " ")


@pytest.mark.parametrize("agent", AGENTS)
def test_numbers_are_those_of_the_tables(data: ReportData, agent: str) -> None:
    text = paragraph(data, agent)
    tallies = [data.tallies[agent, "all", node] for node in STUDY]
    counted = 12 if agent == NAIVE else 11
    assert text.startswith(f"In {counted} simulated runs that count, on {counted} scenes, {agent} met")
    lowest = min(tallies, key=lambda tally: (tally.confidence or 0.0, tally.node))
    assert f"lowest confidence is in {lowest.node} (" in text
    low, high = clopper_pearson(lowest.passed, lowest.considered)
    # The runs passed and the mean share of achieved observables are two quantities, each with its own interval.
    confidence = (lowest.confidence, lowest.confidence_low, lowest.confidence_high)
    mean, lower, upper = (100 * (share or 0.0) for share in confidence)
    passed = (
        f"It passed {lowest.passed} of {lowest.considered} runs ({100 * low:.0f} to {100 * high:.0f} %). "
    )
    share = f"the mean share of achieved observables, is {mean:.1f} %, 95 % interval {lower:.0f} to {upper:.0f} %."
    assert f"{passed}The confidence, {share}" in text
    shown = [tally.competence["50"].value for tally in tallies if tally.competence]
    assert ("No limit of difficulty is given" in text) is (not shown)
    assert ("No limit is given for" in text) is (0 < len(shown) < len(tallies))
    assert ("up to difficulty" in text) is (bool(shown) and min(shown) > 0.0)


def test_a_limit_is_given_only_where_failures_rise(data: ReportData) -> None:
    """The nodes without one are named; with none at all the paragraph says why."""
    tallies = {key: replace(tally, competence={}) for key, tally in data.tallies.items()}
    text = paragraph(replace(data, tallies=tallies), AWARE)
    reason = "these runs do not show that failures rise with the rated difficulty."
    assert f"No limit of difficulty is given: {reason}" in text
    competence = {rate: ReportedCompetence(40.0, 20.0, at_least=False) for rate in ("50", "90")}
    tallies[AWARE, "all", STUDY[0]] = replace(tallies[AWARE, "all", STUDY[0]], competence=competence)
    text = paragraph(replace(data, tallies=tallies), AWARE)
    assert f"Half of such runs pass {STUDY[0]} up to difficulty 40.0" in text
    assert f"No limit is given for {STUDY[1]}, " in text


def test_two_limits_with_their_bounds(data: ReportData) -> None:
    """The node that ends first gives the limit, the node with the lowest bound how sure it is."""
    competences = [(80.0, 30.0), (60.0, 40.0), (70.0, 50.0), (90.0, 60.0), (95.0, 70.0)]
    tallies = dict(data.tallies)
    for node, (value, low) in zip(STUDY, competences, strict=True):
        competence = {
            "50": ReportedCompetence(value, low, at_least=value == 60.0),
            "90": ReportedCompetence(value - 20.0, 0.0, at_least=False),
        }
        tallies[AWARE, "all", node] = replace(tallies[AWARE, "all", node], competence=competence)
    text = paragraph(replace(data, tallies=tallies), AWARE)
    nodes, sure = f"each of {', '.join(STUDY[:-1])} and {STUDY[-1]}", "with 95 % confidence"
    half = f"Half of such runs pass {nodes} up to difficulty 60.0 (the hardest flown of {STUDY[1]}); "
    assert f"{half}{sure} they do up to 30.0." in text
    most = f"Nine in ten of such runs pass {nodes} up to difficulty 40.0 (where {STUDY[1]} ends); "
    assert f"{most}{sure}, these runs support no difficulty above 0." in text


def test_caveats(data: ReportData) -> None:
    """A lost run, observables that do not discriminate, floors that were not flown, nodes that nothing exercised."""
    text = paragraph(data, AWARE)
    assert "INCOMPLETE: 1 of 24 runs are missing (1 worker lost)" in text
    assert "agent without merit would reach was not flown" in text
    observables = [name for name, node in data.nodes.items() if node.level == "observable"]
    known = {"level": "observable", "floor_agents": ("null-idle",), "ceiling": 1.0, "scenes": 5}
    flat = dict.fromkeys(observables[:2], 0.9)
    floors = {name: NodeFloor(id=name, floor=flat.get(name, 0.1), **known) for name in observables}
    flawed = paragraph(replace(data, floors=floors), AWARE)
    assert "2 observables under the key attributes under study do not discriminate" in flawed
    assert "was not flown" not in flawed
    never = dict(data.tallies)
    never[AWARE, "all", "KA-09"] = replace(never[AWARE, "all", "KA-09"], considered=0, competence={})
    text = paragraph(replace(data, tallies=never), AWARE)
    assert "Nothing is known about KA-09: no run considered it." in text
    whole = replace(data, runs=tuple(run for run in data.runs if run.realization != LOST))
    assert "INCOMPLETE" not in paragraph(whole, AWARE)


def test_page_has_a_paragraph_for_each_agent(data: ReportData, page: Page) -> None:
    shown = page.text.replace("\u00a0", " ")
    for agent in AGENTS:
        assert paragraph(data, agent) in shown
