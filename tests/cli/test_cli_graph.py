"""`rebar graph`: what it writes, and what it refuses."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from bench.cli._app import run

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
