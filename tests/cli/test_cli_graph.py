"""`rebar graph`: what it writes, and what it refuses."""

from __future__ import annotations

import sys
from pathlib import Path

import networkx as nx
import pytest

from bench.cli._app import run
from decompositions import excerpt, load_decomposition

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import AGENTS, Made, make_campaign


def test_both_files_by_the_name_of_the_decomposition(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without an option: a page and a drawing here, and their names are printed."""
    monkeypatch.chdir(tmp_path)
    assert run(["graph", "search-and-report"]) == 0
    assert capsys.readouterr().out.split() == ["search-and-report.html", "search-and-report.svg"]
    assert (tmp_path / "search-and-report.html").read_text().startswith("<!DOCTYPE html>")
    assert (tmp_path / "search-and-report.svg").read_text().startswith("<svg ")


def test_coloured_by_a_campaign(tmp_path: Path) -> None:
    """One file of the kind that its end says, with the agent's numbers, in a folder that is made."""
    folder = make_campaign(tmp_path / "made", Made(scenes=3))
    out = tmp_path / "new" / "graph.svg"
    line = [
        "graph",
        str(folder / "decomposition.json"),
        "--campaign",
        str(folder),
        "--agent",
        AGENTS[1],
        "--by",
        "score",
    ]
    assert run([*line, "--out", str(out)]) == 0
    assert [path.name for path in out.parent.iterdir()] == ["graph.svg"]
    assert f"ARL score of {AGENTS[1]}, made-up" in out.read_text()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (["--out", "graph.pdf"], "has an unknown suffix"),
        (["--agent", "mine"], "there is no campaign to take results from"),
        (["--node", "KA-99"], "KA-99"),
        (["--campaign", "nowhere"], "holds no campaign.yaml"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    line: list[str],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Nothing is written, and the message says what would be right."""
    monkeypatch.chdir(tmp_path)
    assert run(["graph", "search-and-report", *line]) == 2
    assert expected in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["KA-18", "OBS-181", "responsible"])
def test_an_excerpt_holds_what_a_node_serves_and_what_is_below_it(name: str, tmp_path: Path) -> None:
    """By the ancestors and descendants of its graph, with their edges and no others; as a drawing too."""
    whole = load_decomposition("search-and-report")
    graph = whole.graph()
    part = excerpt(whole, name)
    kept = {name, *nx.ancestors(graph, name), *nx.descendants(graph, name)}
    assert set(part.nodes) == kept
    assert set(part.graph().edges) == {edge for edge in graph.edges if kept.issuperset(edge)}
    assert list(part.nodes) == [node for node in whole.nodes if node in kept]
    out = tmp_path / "part.svg"
    assert run(["graph", "search-and-report", "--node", name, "--out", str(out)]) == 0
    text = out.read_text()
    assert all((node in text) == (node in kept) for node in whole.key_attributes)
