"""Every table of the command line fits into 80 columns, at a terminal's width and in a pipe, and nothing is cut."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import pytest
from command_line import EXAMPLE, Rebar, fly_surrogates

from bench.campaign import CampaignPlanned, CampaignStopping, RealizationFinished, RealizationRetried
from bench.cli._decomposition import _table
from bench.cli._progress import open_progress
from bench.cli._tables import plain_console
from bench.contracts import Outcome
from bench.scoring import NodeFloor
from bench.simspec import FACTORS
from decompositions import load_decomposition

AGENTS = ("reference-naive", "reference-bystander-aware")
STUDY = ("KA-03", "KA-05", "KA-09", "KA-18", "KA-20")
COMPARED = (*STUDY, "responsible", "reliable")
NULL_NAMES = ("null-repeat-hover-detailed", "null-everywhere", "null-announce", "null-random")


def assert_fits(text: str, whole: Iterable[str]) -> None:
    """No line is wider than the terminal unless it is a path, a digest or a command, which are to be copied; no cell
    ends in an ellipsis, and these words are in one piece.
    """
    wide = [line for line in text.splitlines() if len(line.rstrip()) > 80]
    assert [line for line in wide if not re.search(r"/|SHA-256", line)] == []
    assert "…" not in text
    assert set(whole) - set(re.split(r"[\s,;:()<>]+", text)) == set()


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of surrogates, with everything that a flown one has but recordings; its name is long."""
    folder = tmp_path_factory.mktemp("flown")
    fly_surrogates(folder, name="a-campaign-with-a-name-that-is-longer-than-usual")
    return folder


COMMANDS: dict[str, tuple[list[str], list[str]]] = {
    "run": (["run", "{flown}/campaign.yaml", "--out", "{flown}/out"], [*STUDY]),
    "dry run": (["run", "{flown}/campaign.yaml", "--dry-run"], [*AGENTS, *STUDY]),
    "score": (["score", "{flown}/out", "--per-run"], [f"p001-r1-{AGENTS[1]}", "OBS-031", "OBS-204"]),
    "compare": (["compare", "{flown}/out", *(f"--node={node}" for node in COMPARED)], [*AGENTS, *COMPARED]),
    "calibrate": (["calibrate", "{flown}/out"], [*AGENTS, "KA-18"]),
    "next": (["next", "{flown}/out"], ["KA-18", *AGENTS]),
    "difficulty": (["difficulty", str(EXAMPLE), "--node", "KA-18"], ["bystander_density_per_km2", "OBS-181"]),
    "tension": (["tension", "KA-18", "3"], ["bystander_density_per_km2"]),
    "examples": (["examples"], ["campaigns/demo.yaml", "examples/search.yaml"]),
    "check": (["decomposition", "check", "search-and-report-full"], ["search-and-report-full"]),
    "help": (["run", "--help"], ["--dry-run", "--session-s", "lockstep|realtime|warp"]),
}


@pytest.mark.parametrize(
    ("command", "columns"),
    [
        *((name, None) for name in COMMANDS),
        *((name, "80") for name in ("compare", "next", "tension", "help")),
    ],
)
def test_every_command_fits(
    flown: Path,
    command: str,
    columns: str | None,
    rebar: Rebar,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns:
        monkeypatch.setenv("COLUMNS", columns)
    line, whole = COMMANDS[command]
    text = rebar(*[word.format(flown=flown) for word in line])
    assert_fits(text, whole)


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
    assert_fits(text, [name])
    assert text.count(name) == 2
    heads = [line.split()[0] for line in text.splitlines() if not line.startswith(" ")]
    assert heads == ["2", f"{name}:", "[1/2]", "stopping:"]


@pytest.mark.parametrize("decomposition", ["search-and-report-full", "find-the-missing"])
def test_difficulty_fits(decomposition: str, rebar: Rebar) -> None:
    text = rebar("difficulty", EXAMPLE, "--decomposition", decomposition)
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


def test_doctor_wraps_what_it_found(rebar: Rebar, monkeypatch: pytest.MonkeyPatch) -> None:
    """Packages with their versions are a long line; the second check is a fault."""
    packages = ", ".join(f"package-{number} {number}.10.2" for number in range(20))

    def fault() -> str:
        raise RuntimeError(f"not installed: {packages}")

    monkeypatch.setattr("bench.cli._machine.CHECKS", {"packages": lambda: packages, "streams": fault})
    text = rebar("doctor", code=1)
    assert_fits(text, [f"package-{number}" for number in range(20)])
    assert [line[:3] for line in text.splitlines() if not line.startswith(" ")] == ["ok ", "BAD"]
