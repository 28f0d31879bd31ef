"""Every table of the command line fits into 80 columns, at a terminal's width and in a pipe, and nothing is cut."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import AGENTS, STUDY, Made, make_campaign

from bench.campaign import CampaignPlanned, CampaignStopping, RealizationFinished, RealizationRetried
from bench.cli._app import run
from bench.cli._decomposition import _table
from bench.cli._progress import open_progress
from bench.cli._tables import plain_console
from bench.contracts import Outcome
from bench.scoring import NodeFloor
from bench.simspec import FACTORS
from decompositions import load_decomposition

WIDTH = 80
EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"
CAMPAIGN = f"""
format: rebar.campaign/1
name: a-campaign-with-a-name-that-is-longer-than-usual
base_file: {EXAMPLE}
fidelity: overhead
agents: [{{manifest: {AGENTS[0]}}}, {{manifest: {AGENTS[1]}}}]
design:
  seed: 3
  factors:
    - {{name: concealment, levels: [0.5, 1.0], sets: ['actors[radar].concealment']}}
    - {{name: fog, levels: [0, 1, 2], sets: [environment.fog_level]}}
"""
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


def assert_lines_fit(text: str, width: int = WIDTH) -> None:
    """No line is wider than the terminal unless it is a path, a digest or a command, which are to be copied."""
    wide = [line for line in text.splitlines() if len(line.rstrip()) > width]
    assert [line for line in wide if not re.search(r"/|SHA-256", line)] == []
    assert "…" not in text


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of surrogates, with everything that a flown one has but recordings; its name is long."""
    folder = tmp_path_factory.mktemp("flown")
    (folder / "campaign.yaml").write_text(CAMPAIGN)
    assert run(["run", str(folder / "campaign.yaml"), "--out", str(folder / "out"), "--json"]) == 0
    return folder


COMMANDS: dict[str, tuple[list[str], list[str]]] = {
    "run": (["run", "{flown}/campaign.yaml", "--out", "{flown}/out"], [*STUDY]),
    "dry run": (["run", "{flown}/campaign.yaml", "--dry-run"], [*AGENTS, *STUDY]),
    "score": (["score", "{flown}/out", "--per-run"], [f"p001-r1-{AGENTS[1]}", "OBS-031", "OBS-204"]),
    "compare": (["compare", "{flown}/out"], [*AGENTS, *STUDY]),
    "calibrate": (["calibrate", "{flown}/out"], [*AGENTS, "KA-18"]),
    "next": (["next", "{flown}/out"], ["KA-18", *AGENTS]),
    "difficulty": (["difficulty", str(EXAMPLE), "--node", "KA-18"], ["bystander_density_per_km2", "OBS-181"]),
    "tension": (["tension", "KA-18", "3"], ["bystander_density_per_km2"]),
    "examples": (["examples"], ["campaigns/demo.yaml", "examples/search.yaml"]),
    "check": (["decomposition", "check", "search-and-report-full"], ["search-and-report-full"]),
    "help": (["run", "--help"], ["--dry-run", "--session-s", "lockstep|realtime|warp"]),
}


@pytest.mark.parametrize("columns", [None, "80"], ids=["pipe", "80 columns"])
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_fits(
    flown: Path,
    command: str,
    columns: str | None,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What people read of a command, and its names and ids in one piece."""
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns:
        monkeypatch.setenv("COLUMNS", columns)
    line, whole = COMMANDS[command]
    text = printed([word.format(flown=flown) for word in line], capsys)
    assert_lines_fit(text)
    words = set(re.split(r"[\s,;:()<>]+", text))
    assert [word for word in whole if word not in words] == []


def test_the_progress_of_a_campaign_fits(capsys: pytest.CaptureFixture[str]) -> None:
    """A retry and a lost session, each with a traceback for a reason: wrapped, names whole, nothing broken."""
    name = "p10796-r12-reference-bystander-aware-of-a-long-name"
    reason = "Traceback (most recent call last):\n  File a\n    raise\n" + "OSError: no space left " * 20
    with open_progress("small") as progress:
        progress(CampaignPlanned(total=2, done=0))
        progress(
            RealizationRetried(realization=name, outcome=Outcome.BENCH_ERROR, reason=reason, pause_s=60.0)
        )
        progress(RealizationFinished(name, Outcome.BENCH_ERROR, reason, wall_s=3.21, done=1, total=2))
        progress(CampaignStopping("a signal"))
    text = capsys.readouterr().err
    assert_lines_fit(text)
    assert text.count(name) == 2
    heads = [line.split()[0] for line in text.splitlines() if not line.startswith(" ")]
    assert heads == ["2", f"{name}:", "[1/2]", "stopping:"]


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
