"""Floor and ceiling as a user meets them: run --floor, the check of a decomposition, scores and report."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from command_line import Rebar, fly_short

from bench.cli._app import run
from bench.cli._decomposition import _print_panel
from bench.contracts import SessionResult, TruthGiven
from bench.recording import read_simspec, read_tape
from bench.scoring import Panel, PanelNode
from decompositions import load_decomposition

CHECK = ("decomposition", "check", "search-and-report")
FLOOR = "floor: {agents: [{manifest: null-idle}, {manifest: null-orders}], least_scenes: 1}"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes of five simulated seconds; the floor flies one of them."""
    return fly_short(tmp_path_factory.mktemp("floored"), FLOOR, 5.0)


def test_the_floor_is_apart_from_the_scores(campaign: Path) -> None:
    """scores.parquet is about the agent under test alone; the digests cover both."""
    assert set(pl.read_parquet(campaign / "scores.parquet")["agent"]) == {"reference-naive"}
    assert set(pl.read_parquet(campaign / "floor.parquet")["agent"]) == {"null-idle", "null-orders", "oracle"}
    manifest = json.loads((campaign / "manifest.json").read_text())
    assert {"floor.parquet", "scores.parquet"} <= set(manifest["files"])
    assert any("null-idle/recording.mcap" in name for name in manifest["files"])
    assert run(["verify", str(campaign)]) == 0


def test_whoever_is_given_the_truth_is_marked(campaign: Path) -> None:
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


def test_the_check_shows_every_node(campaign: Path, rebar: Rebar) -> None:
    document = rebar.json(*CHECK, "--floor", campaign)
    nodes = document["floor"]
    assert len(nodes) == document["nodes"]
    known = [node["discrimination"] for node in nodes if node["discrimination"] is not None]
    assert known == sorted(known)
    assert all(set(node) >= {"floor", "floor_agents", "ceiling", "scenes", "flaw"} for node in nodes)
    table = rebar(*CHECK, "--floor", campaign)
    assert "observables do not discriminate" in table
    assert "worst first" in table


def test_a_check_without_a_floor(rebar: Rebar, tmp_path: Path) -> None:
    assert "every measure" in rebar("decomposition", "check", "search-and-report-full")
    rebar.refused(*CHECK, "--floor", tmp_path)
    rebar.refused("decomposition", "check", "nowhere")


def test_confidence_stands_beside_floor_and_ceiling(campaign: Path, rebar: Rebar) -> None:
    before = (campaign / "scores.parquet").read_bytes()
    document = rebar.json("score", campaign)
    whole = [node for node in document["nodes"] if node["configuration"] == "all"]
    assert {node["agent"] for node in whole} == {"reference-naive"}
    assert any(node["floor"] is not None for node in whole)
    assert all(node["floor"] is None for node in document["nodes"] if node["configuration"] != "all")
    flags = {node["discriminates"] for node in whole if node["level"] == "observable"}
    assert flags & {True, False}
    assert (campaign / "scores.parquet").read_bytes() == before
    table = rebar("score", campaign)
    assert "Floor" in table
    assert "ceiling" in table
    page = (campaign / "report.html").read_text()
    assert "What needs no merit" in page
    assert 'data-agent="null-idle"' not in page
    assert run(["verify", str(campaign)]) == 0


def test_a_run_says_who_is_given_the_truth(campaign: Path, rebar: Rebar) -> None:
    """Resumed with nothing left to fly, it still says so."""
    text = rebar("run", campaign.parent / "short.yaml", "--out", campaign)
    assert "oracle is given the truth" in text


def test_a_panel_beyond_its_bounds_exits_with_1(campaign: Path, tmp_path: Path, rebar: Rebar) -> None:
    """One agent, flown for five seconds, passes nothing and separates nobody. Scenes of two folders are different ones."""
    second = shutil.copytree(campaign, tmp_path / "second")
    line = [*CHECK, "--panel", campaign, "--panel", second]
    panel = rebar.json(*line, code=1)["panel"]
    assert panel["agents"] == ["reference-naive"]
    assert panel["sessions"] == 4
    assert list(panel["bounds"].values()) == [True, True, False, False, False]
    text = rebar(*line, code=1)
    assert all(bound in " ".join(text.split()) for bound in panel["bounds"])
    assert text.count("NOT MET") == 3


def test_a_panel_without_replicates_says_that_nothing_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    pair = {"level": "ka", "lower": "poor", "higher": "good", "difference": 0.2}
    nodes = tuple(
        PanelNode(id=name, noise=noise, separated=noise == 0.1, **pair)
        for name, noise in (("KA-01", None), ("KA-02", 0.3), ("KA-03", 0.1))
    )
    empty: dict[str, Any] = {
        "observables": 0,
        "equal": (),
        "always_passed": {},
        "constant": (),
        "worse_is_better": (),
    }
    empty |= {"unknown_correlations": 0, "participation_ratio": None, "bounds": {}}
    panel = Panel(agents=("good", "poor"), sessions=2, nodes=nodes, **empty)
    _print_panel(panel, load_decomposition("search-and-report"))
    unknown, same, apart = " ".join(capsys.readouterr().out.split()).split("KA-0")[1:]
    assert "not known: both flew no design point twice" in unknown
    assert "separates no two agents" in same
    assert "good, poor" in apart


def test_a_panel_is_refused_where_it_was_measured_otherwise(campaign: Path, rebar: Rebar) -> None:
    """Nothing is measured again: the error says how. An order is of agents who flew; no folder counts twice."""
    assert "--decomposition search-and-report-full" in rebar.refused(
        "decomposition", "check", "search-and-report-full", "--panel", campaign
    )
    line = ["decomposition", "check", "search-and-report", "--panel", str(campaign)]
    assert "the tested agents are reference-naive" in rebar.refused(
        *line, "--order", "reference-naive", "oracle"
    )
    assert "is named twice" in rebar.refused(*line, "--panel", campaign / ".." / campaign.name)
    assert "--order: compares agents of a panel" in rebar.refused(
        *line[:3], "--order", "reference-naive", "oracle"
    )
