"""Every table of the command line fits into 80 columns, at a terminal's width and in a pipe, and nothing is cut."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import AGENTS, STUDY, Made, make_campaign

from bench.cli._app import run
from bench.cli._decomposition import _table
from bench.cli._tables import plain_console
from bench.scoring import NodeFloor
from bench.simspec import FACTORS
from decompositions import load_decomposition

WIDTH = 80
EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"
NULL_NAMES = ("null-repeat-hover-detailed", "null-everywhere", "null-announce", "null-random")


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


@pytest.mark.parametrize("decomposition", ["search-and-report-full", "find-the-missing"])
def test_difficulty_fits(decomposition: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Every node of a decomposition is there, and no factor's name is broken."""
    text = printed(["difficulty", str(EXAMPLE), "--decomposition", decomposition], capsys)
    tree = load_decomposition(decomposition)
    assert_fits(text, [*tree.nodes])
    names = set(re.findall(r"\w+_\w+", text))
    assert names
    assert names <= FACTORS.keys()


def test_decomposition_check_fits(capsys: pytest.CaptureFixture[str]) -> None:
    """The longest flaw and all the null agents: the words wrap, ids and numbers stay whole."""
    nodes = [
        NodeFloor(id=name, level="observable", floor=1.0, floor_agents=NULL_NAMES, ceiling=1.0, scenes=100)
        for name in ("OBS-031", "OBS-PERSON-2")
    ]
    titles = {node.id: "Bystanders known in all parts of the area of interest" for node in nodes}
    plain_console().print(_table(nodes, titles))
    assert_fits(capsys.readouterr().out, ["OBS-031", "OBS-PERSON-2", "100%"])


def test_doctor_wraps_what_it_found(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Packages with their versions are a long line; the second check is a fault."""
    packages = ", ".join(f"package-{number} {number}.10.2" for number in range(20))

    def fault() -> str:
        raise RuntimeError(f"not installed: {packages}")

    monkeypatch.setattr("bench.cli._machine.CHECKS", {"packages": lambda: packages, "streams": fault})
    text = printed(["doctor"], capsys, code=1)
    assert_fits(text, [f"package-{number}" for number in range(20)])
    assert [line[:3] for line in text.splitlines() if not line.startswith(" ")] == ["ok ", "BAD"]
