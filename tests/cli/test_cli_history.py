"""`rebar history`: what each version of an agent passed, and what makes the lines hard to compare."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from bench.cli._app import run
from bench.reporting import load_report_data, sheets

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import AGENTS, Made, make_campaign


def test_two_versions_are_two_lines_with_the_numbers_of_their_reports(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Folders of one campaign are told apart, the order is that given, and fewer scenes are said to be others."""
    monkeypatch.chdir(tmp_path)
    for name, scenes in (("v2", 3), ("v1", 6), ("v3", 6)):
        make_campaign(Path(name), Made(scenes=scenes))
    assert run(["history", "v1", "v2", "v3", "--agent", AGENTS[1]]) == 0
    text = capsys.readouterr().out
    rows = [line.split() for line in text.splitlines() if line.lstrip().startswith("v") and "/" in line]
    assert [row[0] for row in rows] == ["v1", "v2", "v3"]
    for row in rows:
        (page,) = (page for page in sheets(load_report_data(Path(row[0]))) if page.agent == AGENTS[1])
        assert row[1:] == [line.passed.replace(" of ", "/") for line in page.rows if " of " in line.passed]
    assert AGENTS[0] not in text
    assert "v2: other scenes than in the first" in text
    assert "v3: other scenes" not in text


def test_an_agent_who_never_flew_is_refused_with_the_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_campaign(tmp_path / "v1", Made(scenes=2))
    assert run(["history", str(tmp_path / "v1"), "--agent", "nobody"]) == 2
    assert f"name one of: {', '.join(AGENTS)}" in capsys.readouterr().err
