"""The page to sign: at most 250 words, whatever there is to say, and nothing that weakens it is left out."""

from __future__ import annotations

import csv
import io
import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from made_campaign import AGENTS, PRINCIPLES, Made, make_campaign
from test_reporting_page import page_of

from bench.campaign.storage._folder import MADE_FROM_RESULTS
from bench.contracts import Outcome
from bench.errors import SetupError
from bench.reporting import (
    COMPANIONS,
    csv_text,
    load_report_data,
    matching,
    render_report,
    requirements_table,
    runs_table,
    write_report,
)
from bench.scoring import NodeFloor

CAUGHT = "p000-r0-reference-naive"
MAX_WORDS = 250
HOSTILE = 'exit 1: <b>"=1+1",\n\x1b[31m|</testcase>'


def sheet_texts(page: str) -> list[str]:
    sections = re.findall(r'<section class="sheet".*?</section>', page, flags=re.S)
    return [" ".join(unescape(re.sub(r"<[^>]*>", " ", section)).split()) for section in sections]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Everything that weakens an answer: a lost run, an agent that saw the truth, one that flew free, a crash."""
    boxed = {"isolation": "landlock", "network": "own", "open_walls": ["tcp"]}
    free = {"isolation": "none", "network": "host"}
    saw: dict[str, Any] = {"saw_the_truth": {"texts": ["a honeypot"]}, "truth": {"agent": AGENTS[0]}}
    facts = {CAUGHT: saw | {"confinement": free}, "p001-r0-reference-naive": {"confinement": boxed}}
    endings = {
        "p002-r0-reference-naive": (Outcome.WORKER_LOST, "killed"),
        "p003-r0-reference-naive": (Outcome.AGENT_CRASHED, HOSTILE),
    }
    folder = make_campaign(tmp_path_factory.mktemp("sheet") / "c", Made(endings=endings, facts=facts))
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["evidence"] = {"lines": 12, "head": "ab" * 32}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def test_the_page_to_sign_has_at_most_250_words(folder: Path) -> None:
    """With every warning, unseen nodes by the hundred and flat observables too."""
    data = load_report_data(folder)
    unseen = {
        key: replace(tally, considered=0, competence={}) if key[2].startswith(("KA", "OBS")) else tally
        for key, tally in data.tallies.items()
    }
    flat = {"level": "observable", "floor": 0.9, "floor_agents": ("null-idle",), "ceiling": 1.0, "scenes": 5}
    observables = [name for name, node in data.nodes.items() if node.level == "observable"]
    floors = {name: NodeFloor(id=name, **flat) for name in observables}
    scores = data.scores.with_columns(until_settled=True)
    worst = replace(data, tallies=unseen, floors=floors, scores=scores)
    # Surrogates replaced the sessions, so nothing was confined, lost or given to an agent.
    surrogates = tuple(replace(run, facts={}, outcome=Outcome.COMPLETED) for run in data.runs)
    overhead = replace(worst, runs=surrogates, campaign={**data.campaign, "fidelity": "overhead"}, notes=())
    for shown in (data, worst, overhead):
        texts = sheet_texts(render_report(shown))
        assert len(texts) == len(AGENTS)
        for text in texts:
            # Five principles have three rows of some ten words more than these two.
            assert len(text.split()) + 3 * 11 <= MAX_WORDS, text


def test_who_reads_it_alone_knows_what_weakens_it(folder: Path) -> None:
    """Lost runs, the truth, missing walls, remarks elsewhere, what was not considered, the digest, the signature."""
    naive, aware = sheet_texts(page_of(folder)[1])
    for words in (
        "INCOMPLETE: 1 of 12 runs are missing (1 worker lost)",
        "It saw the truth in 1 run.",
        "It was given the truth: this is no agent’s result.",
        "5 runs count of 6, on 5 scenes",
        "NOT CONFINED in 1 run; not recorded in 3 runs; landlock, 1 wall open in 1 run",
        "2 remarks: see the appendix.",
        "ab" * 32,
        "None when this was written",
        "What an agent without merit would reach.",
        "of rebar-bench 0.1.0",
    ):
        assert words in naive
    assert naive.endswith("Name Date Signature")
    assert "saw the truth" not in aware
    assert "NOT CONFINED" not in aware


def test_unseen_key_attributes_are_named_and_counted(folder: Path) -> None:
    data = load_report_data(folder)
    key = (AGENTS[1], "all", "KA-09")
    tallies = {**data.tallies, key: replace(data.tallies[key], considered=0, competence={})}
    text = sheet_texts(render_report(replace(data, tallies=tallies)))[1]
    assert "1 of 5 key attributes (KA-09): considered in no run." in text


def test_files_beside_the_report_hold_its_numbers(folder: Path) -> None:
    """Counts, verdicts and reasons as in the table of scores; hostile text changes no structure."""
    assert set(COMPANIONS) <= MADE_FROM_RESULTS
    page_of(folder)
    scores = pl.read_csv(folder / "scores.csv")
    data = load_report_data(folder)
    assert len(scores) == len(data.tallies)
    for row in scores.filter(configuration="all").iter_rows(named=True):
        tally = data.tallies[row["agent"], "all", row["node"]]
        assert (row["passed"], row["runs"]) == (tally.passes.passed, tally.passes.runs)
        assert row["passed.low"] == pytest.approx(tally.passes.low)
    runs = pl.read_csv(folder / "runs.csv", infer_schema_length=None)
    assert runs.height == 12
    reasons = [run.reason for run in data.runs if run.outcome is Outcome.AGENT_CRASHED]
    assert runs.filter(run="p003-r0-reference-naive")["reason"].to_list() == reasons
    assert runs["run"][0] == CAUGHT
    verdicts = data.scores.filter(node="P-RESPONSIBLE").select("realization", "verdict").drop_nulls()
    shown = runs.select("run", "P-RESPONSIBLE.passed").drop_nulls()
    assert dict(shown.iter_rows()) == dict(verdicts.iter_rows())
    suites = ElementTree.parse(folder / "junit.xml").getroot()
    assert [suite.get("tests") for suite in suites] == ["6", "6"]
    assert suites[0].get("errors") == "1"
    for case in (case for suite in suites for case in suite):
        (passed,) = (
            runs.filter(run=case.get("name")).select(*(f"{name}.passed" for name in PRINCIPLES)).rows()
        )
        assert (case.find("failure") is not None) == (False in passed)
    card = (folder / "card.md").read_text()
    assert "It saw the truth in 1 run." in card
    assert card.count("| Is responsible |") == len(AGENTS)


def test_a_page_elsewhere_writes_nothing_beside_it(folder: Path, tmp_path: Path) -> None:
    write_report(folder, tmp_path / "page.html")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


@pytest.fixture(scope="module")
def table(folder: Path) -> pl.DataFrame:
    return runs_table(load_report_data(folder))


@pytest.mark.parametrize(
    ("condition", "test"),
    [
        (
            "KA-18.passed == false and fog > 1",
            lambda row: row["KA-18.passed"] is False and row["fog_level"] > 1,
        ),
        ("not fog_level >= 1", lambda row: row["fog_level"] < 1),
        ("fog == 0 or fog == 2 and replicate == 1", lambda row: row["fog_level"] == 0),
        ("(fog == 0 or fog == 2) and replicate == 1", lambda row: False),
        ('outcome != "completed"', lambda row: row["outcome"] != "completed"),
        ("recording == none", lambda row: True),
        ("configuration != none and failed <= 1e0", lambda row: row["failed"] <= 1 and row["configuration"]),
        ("not (sha256 == 'x')", lambda row: True),
        ("`P-RELIABLE`.passed==true", lambda row: row["P-RELIABLE.passed"] is True),
        ("P-RELIABLE.passed != true", lambda row: row["P-RELIABLE.passed"] is False),
    ],
)
def test_a_condition_chooses_what_python_would(table: pl.DataFrame, condition: str, test: object) -> None:
    """Row by row; an empty cell is chosen neither by a comparison nor by its opposite."""
    assert callable(test)
    wanted = [row["run"] for row in table.iter_rows(named=True) if test(row)]
    assert matching(table, condition, "--where")["run"].to_list() == wanted


def test_empty_cells_meet_no_comparison() -> None:
    frame = pl.DataFrame({"x": [1.0, None]})
    counts = {"x > 0": 1, "not x > 0": 0, "x != 1": 0, "x == none": 1, "x != none": 1}
    assert {text: len(matching(frame, text, "-")) for text in counts} == counts


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("", "its end where a value should be"),
        ("fog >", "its end where a value should be"),
        ("fog", "where a comparison should be"),
        ("fog > 3)", "where it should end"),
        ("(fog > 3", "lacks a )"),
        ("fog > 'x'", "compares a number with a text"),
        ("fog > none", "compares none by >"),
        ("fog $ 3", "cannot be read from '$ 3' on"),
        ("outcome == completed", "the word 'completed', which is no column"),
        ("KA-18.pased == true", "did you mean KA-18.passed"),
        ("intelligence > 1", "did you mean intelligence_latency_s or intelligence_uncertainty_m"),
        ("__import__('os').system('x') == 1", "cannot be read from"),
        ("(" * 41 + "fog > 3" + ")" * 41, "is nested deeper than 40"),
        ("not " * 41 + "fog > 3", "is nested deeper than 40"),
        ("(" * 20_000, "is nested deeper than 40 (leave out brackets)"),
    ],
)
def test_a_condition_that_cannot_be_read_says_why(table: pl.DataFrame, condition: str, words: str) -> None:
    with pytest.raises(SetupError) as refused:
        matching(table, condition, "--where")
    assert words in str(refused.value)
    assert f"--where {condition[:120]!r}"[:-1] in str(refused.value)
    assert len(str(refused.value)) < 500


def test_nesting_and_length_have_a_bound_that_no_person_meets(table: pl.DataFrame) -> None:
    """Forty levels, brackets side by side, and a long row of alternatives are read."""
    fog = len(matching(table, "fog > 1", "--where"))
    deepest = "(" * 20 + "not not " * 10 + "fog > 1" + ")" * 20
    # Two thousand comparisons in one expression took minutes.
    for condition in (deepest, *(word.join(["(fog > 1)"] * 3000) for word in (" and ", " or "))):
        assert len(matching(table, condition, "--where")) == fog > 0


def test_requirements_have_the_numbers_of_each_agent(folder: Path) -> None:
    data = load_report_data(folder)
    required = requirements_table(data)
    assert required["agent"].to_list() == list(AGENTS)
    for agent in AGENTS:
        tally = data.tallies[agent, "all", "KA-18"]
        row = required.row(by_predicate=pl.col("agent") == agent, named=True)
        assert row["KA-18.passed.low"] == pytest.approx(tally.passes.low)
        assert (row["KA-18.passed"], row["KA-18.runs"]) == (tally.passes.passed, tally.passes.runs)
        assert row["KA-18.passed.share"] == tally.passes.passed / tally.passes.runs
    # Competence is not given for six scenes, and what is not shown meets no requirement.
    assert required["KA-18.competence_90.low"].to_list() == [None, None]
    assert matching(required, "KA-18.competence_90.low >= 0", "--require").is_empty()


def test_no_text_of_an_agent_becomes_a_formula() -> None:
    """A spreadsheet computes what begins like one; numbers, negative ones too, stay numbers."""
    reasons = ["=1+1", "+x", "@x", "-x", "\t=1", "-1+x", "-3.5", "plain", "a=b"]
    text = csv_text(pl.DataFrame({"reason": reasons, "x": [-1.0] * len(reasons)}))
    read = [row["reason"] for row in csv.DictReader(io.StringIO(text))]
    assert read == ["'=1+1", "'+x", "'@x", "'-x", "'\t=1", "'-1+x", "-3.5", "plain", "a=b"]
    assert {row["x"] for row in csv.DictReader(io.StringIO(text))} == {"-1.0"}
