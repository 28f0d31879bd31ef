"""Floor and ceiling as a user meets them: run --floor, the check of a decomposition, scores and report."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from command_line import fly_short, json_of

from bench.cli._app import run
from bench.cli._decomposition import _print_panel
from bench.contracts import SessionResult, TruthGiven
from bench.recording import read_simspec, read_tape
from bench.scoring import Panel, PanelNode
from decompositions import load_decomposition

FLOOR = "floor: {agents: [{manifest: null-idle}, {manifest: null-orders}], least_scenes: 1}"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes of five simulated seconds; the floor flies one of them."""
    return fly_short(tmp_path_factory.mktemp("floored"), FLOOR, 5.0)


def printed(line: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert run(line) == 0
    return capsys.readouterr().out


def test_the_floor_is_apart_from_the_scores(campaign: Path) -> None:
    """scores.parquet is about the agent under test alone; the digests cover both."""
    assert set(pl.read_parquet(campaign / "scores.parquet")["agent"]) == {"reference-naive"}
    assert set(pl.read_parquet(campaign / "floor.parquet")["agent"]) == {"null-idle", "null-orders", "oracle"}
    manifest = json.loads((campaign / "manifest.json").read_text())
    assert {"floor.parquet", "scores.parquet"} <= set(manifest["files"])
    assert any("null-idle/recording.mcap" in name for name in manifest["files"])
    assert run(["verify", str(campaign)]) == 0


def test_whoever_is_given_the_truth_is_marked(campaign: Path) -> None:
    """In the result and in the recording, and nobody else is."""
    given = set()
    for path in campaign.glob("runs/*/result.json"):
        result = SessionResult.model_validate_json(path.read_bytes())
        recording = path.with_name("recording.mcap")
        events = {event.value.name for event in read_tape(recording, read_simspec(recording)).events}
        assert ("truth given" in events) is (result.fact(TruthGiven) is not None)
        if result.fact(TruthGiven):
            given.add(result.realization)
    assert len(given) == 1
    assert given.pop().endswith("-oracle")


def test_the_check_shows_every_node(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As JSON every node with its numbers, as a table the worst first."""
    text = printed(
        ["decomposition", "check", "search-and-report", "--floor", str(campaign), "--json"], capsys
    )
    document: dict[str, Any] = json.loads(text)
    nodes = document["floor"]
    assert len(nodes) == document["nodes"]
    known = [node["discrimination"] for node in nodes if node["discrimination"] is not None]
    assert known == sorted(known)
    assert all(set(node) >= {"floor", "floor_agents", "ceiling", "scenes", "flaw"} for node in nodes)
    table = printed(["decomposition", "check", "search-and-report", "--floor", str(campaign)], capsys)
    assert "observables do not discriminate" in table
    assert "worst first" in table


def test_a_check_without_a_floor(campaign: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """The document alone is checked; a folder without null agents is refused with what to do."""
    assert "every measure" in printed(["decomposition", "check", "search-and-report-full"], capsys)
    assert run(["decomposition", "check", "search-and-report", "--floor", str(tmp_path)]) == 2
    assert run(["decomposition", "check", "nowhere"]) == 2


def test_confidence_stands_beside_floor_and_ceiling(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the JSON document, in the table, and on the page."""
    before = (campaign / "scores.parquet").read_bytes()
    document = json.loads(printed(["score", str(campaign), "--json"], capsys))
    whole = [node for node in document["nodes"] if node["configuration"] == "all"]
    assert {node["agent"] for node in whole} == {"reference-naive"}
    assert any(node["floor"] is not None for node in whole)
    assert all(node["floor"] is None for node in document["nodes"] if node["configuration"] != "all")
    flags = {node["discriminates"] for node in whole if node["level"] == "observable"}
    assert flags & {True, False}
    assert (campaign / "scores.parquet").read_bytes() == before
    table = printed(["score", str(campaign)], capsys)
    assert "Floor" in table
    assert "ceiling" in table
    page = (campaign / "report.html").read_text()
    assert "What needs no merit" in page
    assert 'data-agent="null-idle"' not in page
    assert run(["verify", str(campaign)]) == 0


def test_a_run_says_who_is_given_the_truth(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Resumed with nothing left to fly, it still says so."""
    text = printed(["run", str(campaign.parent / "short.yaml"), "--out", str(campaign)], capsys)
    assert "oracle is given the truth" in text


def test_a_panel_beyond_its_bounds_exits_with_1(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One agent, flown for five seconds, passes nothing and separates nobody. Scenes of two folders are different ones."""
    second = shutil.copytree(campaign, tmp_path / "second")
    line = ["decomposition", "check", "search-and-report", "--panel", str(campaign), "--panel", str(second)]
    capsys.readouterr()
    panel = json_of([*line, "--json"], capsys, 1)["panel"]
    assert panel["agents"] == ["reference-naive"]
    assert panel["sessions"] == 4
    assert list(panel["bounds"].values()) == [True, True, False, False, False]
    assert run(line) == 1
    text = capsys.readouterr().out
    assert all(bound in " ".join(text.split()) for bound in panel["bounds"])
    assert text.count("NOT MET") == 3


def test_a_panel_without_replicates_says_that_nothing_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    """Beside a node that separates nobody, and one that separates two."""
    pair = {"level": "ka", "lower": "poor", "higher": "good", "difference": 0.2}
    nodes = tuple(
        PanelNode(id=name, noise=noise, separated=noise == 0.1, **pair)
        for name, noise in (("KA-01", None), ("KA-02", 0.3), ("KA-03", 0.1))
    )
    panel = Panel(
        agents=("good", "poor"),
        sessions=2,
        observables=0,
        equal=(),
        always_passed={},
        constant=(),
        unknown_correlations=0,
        participation_ratio=None,
        nodes=nodes,
        worse_is_better=(),
        bounds={},
    )
    _print_panel(panel, load_decomposition("search-and-report"))
    unknown, same, apart = " ".join(capsys.readouterr().out.split()).split("KA-0")[1:]
    assert "not known: both flew no design point twice" in unknown
    assert "separates no two agents" in same
    assert "good, poor" in apart


def test_a_panel_is_refused_where_it_was_measured_otherwise(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is measured again: the error says how. An order of agents who did not fly names those who did, and one
    without a panel is refused. No folder counts twice.
    """
    assert run(["decomposition", "check", "search-and-report-full", "--panel", str(campaign)]) == 2
    assert "--decomposition search-and-report-full" in " ".join(capsys.readouterr().err.split())
    line = ["decomposition", "check", "search-and-report", "--panel", str(campaign)]
    assert run([*line, "--order", "reference-naive", "oracle"]) == 2
    assert "the tested agents are reference-naive" in " ".join(capsys.readouterr().err.split())
    assert run([*line, "--panel", str(campaign / ".." / campaign.name)]) == 2
    assert "is named twice" in capsys.readouterr().err
    assert run([*line[:3], "--order", "reference-naive", "oracle"]) == 2
    assert "--order: compares agents of a panel" in capsys.readouterr().err
