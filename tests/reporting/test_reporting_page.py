# mypy: disable-error-code="operator, str-bytes-safe"
# Cells of a data frame may be of any type; the columns used here are numbers.
"""The page says what the folder holds: numbers, failures, gaps; it is safe, self-contained and always the same."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from itertools import product
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import made_campaign
import numpy as np
import polars as pl
import pytest
import yaml
from made_campaign import AGENTS, STUDY, Made, made_map, make_campaign

from bench.contracts import Observation, Outcome, Record, SimTime
from bench.errors import SetupError
from bench.recording import read_simspec, read_tape
from bench.reporting import _page, build_run_map, load_report_data, render_report, runs_table, write_report
from bench.reporting._campaign_data import ReportedCompetence
from bench.reporting._page import _environment
from bench.scoring import NodeFloor, ScoredRun, score_table, stated_difficulty
from bench.statistics import clopper_pearson
from bench.streams import String, encode
from decompositions import load_decomposition

VOID = {"meta", "link", "br", "img", "hr", "input"}


class Page(HTMLParser):
    """What a browser would see: open elements, tables by id, texts of scripts, attributes that could fetch."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.scripts: dict[str, str] = {}
        self.attributes: list[tuple[str, str, str]] = []
        self.ids: list[str] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.tables_by_class: dict[str, list[list[list[str]]]] = {}
        self.text = ""
        self._script: str | None = None
        self._table = ""
        self._class: str | None = None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.attributes += [(tag, name, value) for name, value in values.items()]
        self.ids += [values["id"]] if "id" in values else []
        if tag not in VOID:
            self.open.append(tag)
        if tag == "script":
            self._script = values.get("id", f"script-{len(self.scripts)}")
            self.scripts[self._script] = ""
        if tag == "table":
            self._table = values.get("id", "")
            self.tables.setdefault(self._table, [])
            # The rows of a table without an id go to one list for all of them, and by class to one for each.
            if "class" in values:
                self.tables_by_class.setdefault(values["class"], []).append([])
            self._class = values.get("class")
        if tag == "tr":
            self.tables[self._table].append([])
            if self._class:
                self.tables_by_class[self._class][-1].append(self.tables[self._table][-1])
        if tag in ("td", "th"):
            self.tables[self._table][-1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag, f"</{tag}> closes another element"
        if tag == "script":
            self._script = None

    def handle_data(self, data: str) -> None:
        if self._script is not None:
            self.scripts[self._script] += data
            return
        self.text += data
        if self.open and {"td", "th"} & set(self.open):
            self.tables[self._table][-1][-1] += data

    def values(self, tag: str, name: str) -> list[str]:
        """Every value of an attribute of these elements."""
        return [value for *where, value in self.attributes if where == [tag, name]]

    def figures(self, begin: str) -> list[str]:
        """The labels of the figures that begin with these words."""
        return [label for label in self.values("svg", "aria-label") if label.startswith(begin)]


def page_of(folder: Path) -> tuple[Page, str]:
    text = write_report(folder).read_text(encoding="utf-8")
    return Page(text), text


@pytest.fixture(scope="module")
def campaign_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of 6 scenes and both agents, one crash with a nasty reason and one scene that could not be placed."""
    endings = {
        "p003-r0-reference-naive": (Outcome.AGENT_CRASHED, "exit 1: </script><script>alert(1)</script>"),
        "p004-r0-reference-bystander-aware": (Outcome.PLACEMENT_INFEASIBLE, "no place for group 'close'"),
    }
    return make_campaign(tmp_path_factory.mktemp("made") / "campaign", Made(endings=endings))


@pytest.fixture(scope="module")
def page(campaign_folder: Path) -> Page:
    return page_of(campaign_folder)[0]


def test_headline_shows_the_numbers_of_the_score_table(campaign_folder: Path, page: Page) -> None:
    """Score, confidence and counts of every studied node and agent equal the means of the Parquet file."""
    scores = pl.read_parquet(campaign_folder / "scores.parquet")
    counted = scores.filter(pl.col("outcome") != "placement_infeasible")
    rows = [row for row in page.tables["headline"] if len(row) == 11][1:]
    for row, (node, agent) in zip(rows, product(STUDY, AGENTS), strict=True):
        of_agent = counted.filter(node=node, agent=agent)
        runs, score = of_agent.height, of_agent["score"].mean()
        shown_score = re.search(r"(\d+\.\d|not scored)", row[3])
        assert shown_score is not None
        assert shown_score[1] == (f"{score:.1f}" if score is not None else "not scored")
        assert row[4] == f"{100 * of_agent['confidence'].mean():.1f} %"
        passed = of_agent.filter(pl.col("achieved") == pl.col("considered")).height
        low, high = clopper_pearson(passed, runs)
        assert row[1] == f"{passed} of {runs}{100 * low:.0f} to {100 * high:.0f} %"
        assert [int(cell) for cell in row[8:11]] == [runs, runs, of_agent["score"].count()]


def test_every_node_of_every_agent_has_a_row(campaign_folder: Path, page: Page) -> None:
    shown = [row[0].split(" · ")[0].strip() for row in page.tables[""] if len(row) == 11]
    for node in load_report_data(campaign_folder).nodes:
        assert shown.count(node) >= len(AGENTS)


def test_runs_that_did_not_complete_are_listed_first(page: Page) -> None:
    head, *rows = page.tables["all-runs"]
    assert [row[0] for row in rows[:2]] == ["p003-r0-reference-naive", "p004-r0-reference-bystander-aware"]
    cells = [[row[head.index(name)] for name in ("Outcome", "Counts", "Reason")] for row in rows]
    assert cells[0] == ["agent crashed", "✓", "exit 1: </script><script>alert(1)</script>"]
    assert cells[1] == ["placement infeasible", "✗", "no place for group 'close'"]
    assert cells[2:] == [["completed", "✓", "–"]] * 10
    assert "placement infeasible, 1" in page.text
    ends = "10 completed, 1 agent crashed, 1 placement infeasible."
    assert f"12 sessions of 6 scenes by 2 agents: {ends}" in page.text


def test_markup_from_an_agent_is_escaped(campaign_folder: Path) -> None:
    """Markup in reasons, decisions and class labels neither opens an element nor ends a script."""
    nasty = "</script><script>alert('x')</script><img src=x onerror=alert(2)>"
    data = load_report_data(campaign_folder)
    run = data.runs[0]
    tape = made_campaign.made_tape(data.simspecs[run.realization], reason=nasty)
    hostile_report = replace(tape.reports[0], value=replace(tape.reports[0].value, class_label=nasty[:60]))
    tape = replace(tape, reports=(hostile_report,))
    page = Page(render_report(data, [build_run_map(run, data.simspecs[run.realization], tape)]))
    assert len([name for name in page.scripts if not name.startswith("data-")]) == 1
    assert not [tag for tag, _, _ in page.attributes if tag == "img"]
    assert nasty in page.text


def test_no_name_of_an_agent_ends_a_script_or_a_drawing(campaign_folder: Path) -> None:
    """The data of the runs are JSON without a single `<`, and in figures the name is text."""
    data = load_report_data(campaign_folder)
    hostile_name = "</script></svg><b>"
    named = pl.col("agent").replace({AGENTS[0]: hostile_name})
    names = {AGENTS[0]: hostile_name, AGENTS[1]: AGENTS[1]}
    runs = tuple(replace(run, agent=names[run.agent]) for run in data.runs)
    tallies = {(names[agent], *where): tally for (agent, *where), tally in data.tallies.items()}
    renamed = replace(data, agents=tuple(names.values()), runs=runs, tallies=tallies)  # type: ignore[arg-type]
    text = render_report(replace(renamed, scores=data.scores.with_columns(named)))
    page = Page(text)
    assert page.open == []
    assert hostile_name not in text
    assert "<" not in page.scripts["data-runs"]
    assert hostile_name in str(json.loads(page.scripts["data-runs"]))


def test_page_fetches_nothing_and_runs_only_its_scripts(page: Page) -> None:
    """No attribute names another resource, and the policy has the digest of the page's script."""
    assert not {"src", "srcset", "action", "data", "poster"} & {name for _, name, _ in page.attributes}
    assert all(value.startswith("#") for _, name, value in page.attributes if name == "href")
    policy = next(text for text in page.values("meta", "content") if text.startswith("default-src"))
    assert policy.startswith("default-src 'none';")
    page_scripts = [text for name, text in page.scripts.items() if not name.startswith("data-")]
    for text in page_scripts:
        assert f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" in policy
    assert policy.count("sha256-") == len(page_scripts) == 1


def test_page_is_well_formed_html(page: Page) -> None:
    """Every element is closed in order, ids are unique, and every link leads to one."""
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    links = {value.removeprefix("#") for _, name, value in page.attributes if name == "href"}
    assert links <= set(page.ids)


def test_same_folder_gives_the_same_bytes(campaign_folder: Path, tmp_path: Path) -> None:
    first = write_report(campaign_folder).read_bytes()
    shutil.copytree(campaign_folder, tmp_path / "campaign")
    assert write_report(campaign_folder).read_bytes() == first
    assert write_report(tmp_path / "campaign").read_bytes() == first


def test_folder_without_a_campaign_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match=r"holds no campaign\.yaml"):
        write_report(tmp_path)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (Made(scenes=0), ["Nothing has been run yet.", "nothing has been scored"]),
        (
            Made(scenes=2, scored=False),
            ["There is no scores.parquet", "4 sessions of 2 scenes by 2 agents: 4 completed"],
        ),
        (Made(scenes=3, agents=AGENTS[:1]), ["One agent flew, so there is nothing to compare."]),
    ],
)
def test_what_a_campaign_lacks_is_told_by_a_whole_page(tmp_path: Path, made: Made, words: list[str]) -> None:
    page, _ = page_of(make_campaign(tmp_path / "c", made))
    assert [part for part in words if part not in page.text] == []
    assert page.open == []
    assert bool(page.figures("Configuration C1")) == (made.scenes > 0 and made.scored)
    assert not page.figures("Mean difference")


def test_campaign_of_bench_errors_has_no_numbers(tmp_path: Path) -> None:
    names = [f"p{scene:03d}-r0-{agent}" for scene in range(2) for agent in AGENTS]
    endings = dict.fromkeys(names, (Outcome.BENCH_ERROR, "out of disk"))
    page, _ = page_of(make_campaign(tmp_path / "c", Made(scenes=2, endings=endings)))
    assert len(page.tables["all-runs"]) == 5
    assert "outcome bench error; counts ✗" in page.text
    assert "4 runs, listed under “Every run”" in page.text
    rows = [row for row in page.tables["headline"] if len(row) == 10][1:]
    assert {row[3] for row in rows} == {"not scored"}


def test_node_without_a_score_is_shown_as_not_scored(tmp_path: Path) -> None:
    """KA-09 failed everywhere: not scored and confidence 0.0 %, listed among the disclaimers; not 0, nor missing."""
    page, _ = page_of(make_campaign(tmp_path / "c", Made(scenes=3, never_scored="KA-09")))
    rows = page.tables["headline"]
    heading_row = next(place for place, row in enumerate(rows) if row[0].startswith("KA-09"))
    assert [row[3:5] for row in rows[heading_row + 1 : heading_row + 3]] == [["not scored", "0.0 %"]] * 2
    sentence = next(line for line in page.text.splitlines() if "Not scored in any run:" in line)
    assert all(f"KA-09 for {agent}" in sentence for agent in AGENTS)


def test_missing_and_damaged_recordings_become_notes(tmp_path: Path) -> None:
    folder = make_campaign(tmp_path / "c", Made(scenes=2))
    (folder / "runs" / "p000-r0-reference-naive" / "recording.mcap").write_bytes(b"not a recording")
    page, _ = page_of(folder)
    assert "The recording of p000-r0-reference-naive cannot be read, so it is not drawn." in page.text
    assert "No recording is here of" in page.text
    assert page.open == []


def test_recordings_become_maps(tmp_path: Path) -> None:
    folder = make_campaign(tmp_path / "c", Made(scenes=1))
    for agent in AGENTS:
        simspec = made_campaign.made_simspec(0, agent)
        path = folder / "runs" / f"p000-r0-{agent}" / "recording.mcap"
        rubbish = Record(SimTime(0), "/vehicle_1/agent/reports", String.TYPE, encode(String("{<b>")))
        made_campaign.write_recording(path, simspec, made_campaign.made_tape(simspec), [rubbish])
        if agent == AGENTS[1]:
            path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    page, _ = page_of(folder)
    assert len(page.figures("Map of ")) == 2
    assert set(json.loads(page.scripts["data-runs"])["maps"].values()) == {"map-1-box", "map-2-box"}
    assert page.text.count("The recording is truncated") == 1
    assert "Messages that could not be decoded: 1 on /vehicle_1/agent/reports" in page.text
    assert any("marked, against the rule" in row[3] for row in page.tables[""] if len(row) == 8)


@pytest.mark.parametrize("name", ["manifest.json", "scores.parquet", f"runs/p000-r0-{AGENTS[0]}/result.json"])
def test_damaged_files_become_notes(tmp_path: Path, name: str) -> None:
    folder = make_campaign(tmp_path / "c", Made(scenes=1))
    (folder / name).write_bytes(b"{ damaged")
    page, _ = page_of(folder)
    assert Path(name).name in page.text
    assert page.open == []


def test_unknown_decomposition_leaves_bare_ids(tmp_path: Path) -> None:
    folder = make_campaign(tmp_path / "c", Made(scenes=2))
    (folder / "decomposition.json").unlink()
    page, _ = page_of(folder)
    assert "so nodes have no titles here" in page.text
    assert any(row[0].strip().startswith("KA-18") for row in page.tables["headline"])


def test_page_size_is_bounded(campaign_folder: Path) -> None:
    data = load_report_data(campaign_folder)
    charts = [made_map(data, run) for run in data.runs[:6]]
    assert len(render_report(data, charts).encode()) < 500_000


def test_each_studied_node_has_its_sentences(campaign_folder: Path, page: Page) -> None:
    """Competence, its bound and the remark on the curve are beside every figure; the flag gives the other mean."""
    data = load_report_data(campaign_folder)
    section = page.text.split("Results for each key attribute under study", 1)[1]
    section = section.split("What was run", 1)[0].replace("\u00a0", " ")
    tallies = [data.tallies[agent, "all", node] for agent, node in product(AGENTS, STUDY)]
    for tally in tallies:
        half = tally.competence.get("50")
        if half is None:
            assert "No competence is given: " in section
        else:
            prefix = "at least " if half.at_least else ""
            assert f"Competence 50: {prefix}{half.value:.1f}" in section or not half.value
        if tally.raised:
            assert f"exactly at its threshold, the score would be {tally.passed_score:.1f}." in section
    assert any(tally.raised for tally in tallies)
    assert section.count("No curve is drawn: fewer than ten runs considered the node.") == len(tallies)


def test_principles_are_folded_branches(campaign_folder: Path, page: Page) -> None:
    """Closed at first, one for each principle and agent, with verdict and score in the summary line."""
    assert page.values("details", "class").count("branch") == 2 * len(AGENTS)
    text = (campaign_folder / "report.html").read_text()
    assert not re.search(r'<details(?=[^>]*class="branch")[^>]*\bopen\b', text)
    tally = load_report_data(campaign_folder).tallies[AGENTS[0], "all", "P-RELIABLE"]
    low, high = clopper_pearson(tally.verdict_passed or 0, tally.verdict_considered or 0)
    passed = f"passed {tally.verdict_passed} of {tally.verdict_considered} runs ({100 * low:.0f} to {100 * high:.0f} %)"
    score = f"score {tally.score:.1f}{' †' if tally.raised else ''}"
    assert f"{passed}; {score}" in page.text.replace("\u00a0", " ")


def test_the_page_to_sign_comes_first(campaign_folder: Path, page: Page) -> None:
    scores = pl.read_parquet(campaign_folder / "scores.parquet")
    tables = page.tables_by_class["verdicts"]
    assert len(tables) == len(AGENTS)
    for agent, (heads, *rows) in zip(AGENTS, tables, strict=True):
        assert heads[:3] == ["Principle", "Runs passed", "95 % interval"]
        assert heads[3:] == ["Nine tenths pass up to difficulty", "Floor"]
        of_agent = scores.filter(agent=agent, level="principle").drop_nulls("verdict")
        assert len(rows) == of_agent["node"].n_unique()
        for row, node in zip(rows, of_agent["node"].unique(maintain_order=True), strict=True):
            verdicts = of_agent.filter(node=node)["verdict"]
            low, high = clopper_pearson(int(verdicts.sum()), len(verdicts))
            assert row[1:3] == [
                f"{verdicts.sum()} of {len(verdicts)}",
                f"{100 * low:.0f} to {100 * high:.0f} %",
            ]
            assert row[4] == "not flown"
    assert page.text.index("page to sign") < page.text.index("Runs passed") < page.text.index("sessions of")


def test_a_table_of_verdicts_says_what_it_lacks(campaign_folder: Path) -> None:
    """No verdict, no competence, the best null agent, and competence with its bound where it may be given."""
    data = load_report_data(campaign_folder)
    competence = {"90": ReportedCompetence(40.0, 20.0, at_least=True)}
    tallies = dict(data.tallies)
    for node, changes in (
        ("P-RESPONSIBLE", {"verdict_considered": 0, "verdict_passed": 0, "competence": {}}),
        ("P-RELIABLE", {"competence": competence}),
    ):
        key = (AGENTS[0], "all", node)
        tallies[key] = replace(tallies[key], **changes)
    known = {"level": "principle", "floor": 0.5, "floor_agents": ("null-idle",), "ceiling": 1.0, "scenes": 5}
    floors = {
        "P-RESPONSIBLE": NodeFloor(id="P-RESPONSIBLE", **known),
        "P-RELIABLE": NodeFloor(id="P-RELIABLE", verdict_passed=2, verdict_considered=5, **known),
    }
    page = Page(render_report(replace(data, tallies=tallies, floors=floors)))
    rows = {row[0]: row[1:] for row in page.tables_by_class["verdicts"][0][1:]}
    titles = [data.nodes[node].title for node in ("P-RESPONSIBLE", "P-RELIABLE")]
    assert rows[titles[0]] == ["no verdict", "–", "not given", "no verdict"]
    assert rows[titles[1]][2:] == ["≥ 40.0, bound 20.0", "2 of 5"]


def test_map_lists_orders_outages_and_failures(campaign_folder: Path) -> None:
    """With times and answers; events after the end of the run are marked."""
    data, reason = load_report_data(campaign_folder), "not near <people>"
    page = Page(render_report(data, [made_map(data, reason=reason)]))
    rows = [row for row in page.tables[""] if len(row) == 5 and row[2] in ("order", "outage", "fault")]
    assert rows == [
        ["30.0", "–", "order", "hold, within 5 s", "delivered at 30.0 s; not answered"],
        ["40.0", "50.0", "outage", "the operator’s link is down", "the agent was informed at 40.2 s"],
        [
            "45.0",
            "–",
            "order",
            "mark first, within 10 s",
            f"delivered at 50.0 s; refused at 52.0 s: {reason}",
        ],
        ["70.0", "75.0", "outage", "the detector is silent", "–"],
        ["100.0", "110.0", "fault", "fixes drift by 0.5 m/s towards 90°", "–"],
        ["250.0", "–", "fault", "rotor 2 stops", "the run had ended"],
        ["250.0", "–", "order", "return, within 10 s", "the run had ended"],
    ]


def test_events_are_read_from_recordings(tmp_path: Path) -> None:
    """Orders, answers and the state of the operator's link survive a real recording unchanged."""
    simspec = made_campaign.made_simspec(0, AGENTS[0])
    made_campaign.write_recording(tmp_path / "recording.mcap", simspec, made_campaign.made_tape(simspec))
    run = load_report_data(make_campaign(tmp_path / "c", Made(scenes=1))).runs[0]
    recording = tmp_path / "recording.mcap"
    recorded = build_run_map(run, read_simspec(recording), read_tape(recording))
    assert recorded.events == build_run_map(run, simspec, made_campaign.made_tape(simspec)).events


def test_page_of_the_full_decomposition_is_bounded(tmp_path: Path) -> None:
    """100 scenes, two agents: below 15 MB, every node in its table, figures only for nodes under study."""
    folder = make_campaign(tmp_path / "c", Made(scenes=2))
    decomposition = load_decomposition("search-and-report-full")
    (folder / "decomposition.json").unlink()
    campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
    (folder / "campaign.yaml").write_text(
        yaml.safe_dump({**campaign, "decomposition": decomposition.name, "study": list(decomposition.study)})
    )
    units = dict.fromkeys(decomposition.observables, 40.0)
    difficulty = stated_difficulty(decomposition, units)
    scored = [
        ScoredRun(f"p{scene:03d}-r0-{agent}", f"p{scene:03d}", 0, agent, Outcome.COMPLETED, difficulty, tuple(observations))
        for scene in range(100)
        for agent in AGENTS
        for random in [np.random.default_rng([scene, len(agent)])]
        for observations in [[Observation(observable=observable, considered=True, x=float(x)) for observable, x in zip(units, random.random(len(units)), strict=True)]]
    ]  # fmt: skip
    score_table(decomposition, scored, decomposition.study).write_parquet(folder / "scores.parquet")
    page, text = page_of(folder)
    assert len(text.encode()) < 15_000_000
    shown_nodes = {row[0].split(" · ")[0].strip() for row in page.tables[""] if len(row) == 11}
    assert set(decomposition.observables) | set(decomposition.key_attributes) <= shown_nodes
    assert len(page.figures("Pass rate of")) == len(decomposition.study)


@pytest.mark.parametrize("rows", [0, 1])
def test_a_table_of_factors_without_a_row_is_a_sentence(rows: int) -> None:
    row: dict[str, Any] = {
        "factor": "fog",
        "confidence_share": 0.5,
        "confidence_p": 0.01,
        "odds": [],
        "note": "",
    }
    row |= dict.fromkeys(("score_share", "score_p", "passes_p"))
    table = {"node": "KA-18", "agent": "a", "runs": 12, "notes": ["No run passed."], "rows": [row] * rows}
    matter: dict[str, Any] = {
        "tables": [table],
        "significant_effects": [],
        "score_only_effects": [],
        "too_few": [],
    }
    matter |= {"independence": None, "note": ""}
    text = _environment().get_template("factors.html.j2").render(matter=matter, factors_figure="")
    assert ("<table" in text) == bool(rows)
    assert ("A dash: " in text) == bool(rows)
    assert ("<p>KA-18 of a, 12 considered runs. No run passed.</p>" in text) == (not rows)


def test_words_about_a_table_do_not_scroll_with_it(campaign_folder: Path) -> None:
    """A caption is as wide as its table: a long one inside the scrolling box was cut at 1000 px."""
    text = page_of(campaign_folder)[1]
    assert max(map(len, re.findall(r"<caption>(.*?)</caption>", text, re.DOTALL)), default=0) < 120
    source = (Path(__file__).parents[2] / "bench/reporting/templates/report.html.j2").read_text()
    for table in ("headline", "sensor"):
        assert re.search(rf'<p [^>]*id="{table}-words">[^<]{{120,}}</p>\n<div class="scroll"><table ', source)
    assert '<table id="headline" aria-describedby="headline-words">' in text


@pytest.mark.parametrize("count", [1, 2])
def test_one_run_is_no_runs(campaign_folder: Path, count: int) -> None:
    """One run is not sorted, and shares what it is with nobody."""
    data = load_report_data(campaign_folder)
    text = Page(render_report(replace(data, runs=data.runs[:count]))).text
    assert ("2 runs, those first that say most." in text) == (count == 2)
    assert ("1 run: agent " in text) == (count == 1)


def test_runs_are_listed_once(campaign_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Page and companions are made of one table: of a large campaign it takes seconds."""
    listed = Mock(side_effect=runs_table)
    monkeypatch.setattr(_page, "runs_table", listed)
    write_report(shutil.copytree(campaign_folder, tmp_path / "copy"))
    assert listed.call_count == 1
