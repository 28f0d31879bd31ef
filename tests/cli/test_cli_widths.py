"""Every table of the command line fits into 80 columns, at a terminal's width and in a pipe, and nothing is cut."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import AGENTS, STUDY, Made, make_campaign

from bench.cli._app import run

WIDTH = 80


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_campaign(tmp_path_factory.mktemp("widths") / "made", Made(scenes=12))


def printed(line: list[str], capsys: pytest.CaptureFixture[str], code: int = 0) -> str:
    """What a command prints; pytest's standard output is a pipe to rich."""
    assert run(line) == code
    return capsys.readouterr().out


def assert_fits(text: str, whole: list[str], width: int = WIDTH) -> None:
    """No line is wider than the terminal, no cell ends in an ellipsis, and these words are in one piece."""
    assert max(map(len, (line.rstrip() for line in text.splitlines()))) <= width
    assert "…" not in text
    words = set(re.split(r"[\s,;:()]+", text))
    assert [word for word in whole if word not in words] == []


@pytest.mark.parametrize("columns", [None, "80"])
def test_compare_fits(
    made: Path, columns: str | None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All nodes of the decomposition, with the longest id; the pass rates of the worst case have five digits."""
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns:
        monkeypatch.setenv("COLUMNS", columns)
    nodes = [*STUDY, "P-RESPONSIBLE", "P-RELIABLE"]
    options = [word for node in nodes for word in ("--node", node)]
    text = printed(["compare", str(made), *options], capsys)
    assert_fits(text, [*nodes, *AGENTS])
    rows = [line.split() for line in text.splitlines() if line.split()[:1] and line.split()[0] in nodes]
    assert [row[0] for row in rows] == [*nodes, *nodes]
