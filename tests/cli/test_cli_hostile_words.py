"""Two agents and their files hold what would rewrite a terminal, wherever they can: nothing of it comes out raw."""

from __future__ import annotations

import json
import os
import pty
import re
import sqlite3
import subprocess
import sys
import unicodedata
from html import unescape
from pathlib import Path

import polars as pl
import pytest
import yaml
from hostile.hostile_agent import HOSTILE, MARKUP

from bench.cli import main
from bench.recording import read_simspec, read_tape

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
NAME = "agent\x1b[2J\u202e[red]"
SHOWN_NAME = r"agent\x1b[2J\u202e[red]"
SHOWN = r"\x1b[2J\x1b[H\x1b[31m\x1b]0;passed\x07\x1b]52;c;cm0gLXJm\x07\u009b2J\u202edessap\u202c\u2066\u200b\u2028\u0085\u007f"
MANIFEST = """
format: rebar.agent/1
name: hostile
command: ["{{python}}", "{agent}"{option}]
pace: [lockstep]
mavlink: [{{name: onboard, kind: udp_out, streams: none, variable: REBAR_MAVLINK}}]
zenoh: true
read: ["{root}"]
"""
# What rich itself sends to a terminal: colours, moves to a line, and whether the cursor is seen.
OWN_CODES = re.compile(r"\x1b\[[0-9;]*[mAK]|\x1b\[\?25[lh]|\r")


def assert_visible(text: str | bytes) -> None:
    """No control character but newline and tab, no bidirectional or zero-width mark, no half of a character."""
    if isinstance(text, bytes):
        text = text.decode("utf-8", "surrogateescape")
    raw = {sign for sign in text if unicodedata.category(sign) in ("Cc", "Cf", "Cs", "Zl", "Zp")}
    assert raw <= {"\n", "\t"}


def values_in(document: object) -> list[str]:
    """Every text in plain values, names of fields too."""
    if isinstance(document, dict):
        return [text for pair in document.items() for part in pair for text in values_in(part)]
    if isinstance(document, list):
        return [text for part in document for text in values_in(part)]
    return [document] if isinstance(document, str) else []


def on_a_terminal(line: list[str]) -> tuple[int, str]:
    """Exit code of a command, and what it sends to a terminal."""
    master, slave = pty.openpty()
    command = [sys.executable, "-m", "bench.cli", *line]
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "200"}
    with subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=environment) as process:
        os.close(slave)
        sent = b""
        while True:
            try:
                part = os.read(master, 65536)
            # Linux says so once the last process has closed the other end.
            except OSError:
                break
            sent += part
    os.close(master)
    return process.returncode, sent.decode()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of an agent that completes its mission and of one that crashes, flown on a terminal."""
    folder = tmp_path_factory.mktemp("words")
    names = [f"{NAME}.yaml", f"{NAME}-crash.yaml"]
    for name, option in zip(names, ("", ', "--crash"'), strict=True):
        text = MANIFEST.format(agent=HERE / "hostile" / "hostile_agent.py", option=option, root=ROOT)
        (folder / name).write_text(text)
    campaign = {
        "format": "rebar.campaign/1",
        "name": "hostile",
        "description": HOSTILE,
        "base_file": str(ROOT / "examples" / "search.yaml"),
        "agents": [{"manifest": name} for name in names],
    }
    (folder / "campaign.json").write_text(json.dumps(campaign))
    words = ["run", str(folder / "campaign.json"), "--out", str(folder / "out")]
    code, sent = on_a_terminal([*words, "--workers", "1", "--events", str(folder / "events.jsonl")])
    assert code == 0, sent
    assert_visible(OWN_CODES.sub("", sent))
    assert SHOWN[:40] in sent
    assert SHOWN_NAME in sent
    return folder


def result_of(folder: Path, end: str) -> dict[str, object]:
    runs = (folder / "out" / "runs").iterdir()
    (path,) = (path for path in runs if path.name.endswith("-crash") is (end == "crash"))
    document: dict[str, object] = json.loads((path / "result.json").read_text())
    return document


def test_the_words_of_a_crash_are_kept_and_shown(folder: Path) -> None:
    completed, crashed = result_of(folder, "complete"), result_of(folder, "crash")
    assert (completed["outcome"], crashed["outcome"]) == ("completed", "agent_crashed")
    assert SHOWN in str(crashed["reason"])
    for text in (*values_in(completed), *values_in(crashed)):
        assert_visible(text)


def test_documents_with_hidden_labels_are_refused_and_counted(folder: Path) -> None:
    """The recording has them as they came. What was taken has its free words as they came."""
    for recording in (folder / "out" / "runs").glob("*/recording.mcap"):
        tape = read_tape(recording, read_simspec(recording))
        assert {report.value.id for report in tape.reports} == {MARKUP, f"{MARKUP}2", f"{MARKUP}3"}
        assert {report.value.reason for report in tape.reports} == {HOSTILE}
        assert {decision.value.action for decision in tape.decisions} == {MARKUP, "refuse"}
        refused = {topic.rpartition("/")[2]: count for topic, count in tape.malformed.items()}
        assert refused == {"reports": 3, "decisions": 3, "answers": 1, "tracks": 1, "status": 1}
        raw = (recording.parent / "agent.log").read_bytes().decode()
        assert HOSTILE in raw


@pytest.mark.parametrize("pattern", ["*.json", "*.yaml", "*.jsonl", "*.log", "*.html"])
def test_every_file_but_the_raw_ones_is_visible(folder: Path, pattern: str) -> None:
    for path in (*(folder / "out").rglob(pattern), folder / "events.jsonl"):
        # The library of the figures holds two controls of its own.
        text = re.sub("<script>.*?</script>", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        if path.name != "agent.log":
            assert_visible(text)
            # Escapes of JSON are read before they are seen.
            scripts = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', text, re.DOTALL)
            parts = [part for script in scripts for part in values_in(json.loads(script))]
            assert path.suffix != ".html" or any(SHOWN_NAME in part for part in parts)
            assert_visible("".join(parts))
            assert_visible(unescape(text.replace("&shy;", "")))


def test_the_report_shows_the_words(folder: Path) -> None:
    page = unescape((folder / "out" / "report.html").read_text(encoding="utf-8"))
    assert SHOWN in page
    assert SHOWN_NAME in page


def test_journal_and_scores_hold_only_what_is_seen(folder: Path) -> None:
    with sqlite3.connect(folder / "out" / "journal.sqlite") as journal:
        rows = "SELECT * FROM realizations LEFT JOIN attempts ON realizations.id = realization"
        for value in (value for row in journal.execute(rows) for value in row):
            assert_visible(str(value))
    scores = pl.read_parquet(folder / "out" / "scores.parquet")
    assert set(scores["agent"]) == {SHOWN_NAME, f"{SHOWN_NAME}-crash"}


COMMANDS = {
    "score": ["score", "{0}/out", "--per-run"],
    "score --json": ["score", "{0}/out", "--per-run", "--json"],
    "explain": ["score", "{0}/out", "--explain", "KA-20", "--limit", "0"],
    "explain --json": ["score", "{0}/out", "--explain", "KA-20", "--json"],
    "compare": ["compare", "{0}/out"],
    "compare --json": ["compare", "{0}/out", "--json"],
    "status": ["status", "{0}/out"],
    "status --json": ["status", "{0}/out", "--json"],
    "verify": ["verify", "{0}/out"],
    "report": ["report", "{0}/out"],
    "dry run": ["run", "{0}/campaign.json", "--dry-run"],
    "simulate": ["simulate", "{0}/scene.json", "--out", "{0}/simulated\x1b[2J[red]"],
    "simulate --json": ["simulate", "{0}/scene.json", "--out", "{0}/simulated", "--json"],
    "difficulty": [
        "difficulty",
        "{0}/scene.json",
        "--decomposition",
        "{0}/decomposition.yaml",
        "--node=KA-18",
    ],
    "decomposition": ["decomposition", "check", "{0}/decomposition.yaml"],
    "tension": ["tension", "KA-18", "3", "--decomposition", "{0}/decomposition.yaml"],
    "graph": ["graph", "{0}/decomposition.yaml", "--out", "{0}/graph"],
    "prose": ["prose", "--file", "{0}/prose.txt"],
    "prose --json": ["prose", "--file", "{0}/prose.txt", "--json"],
    "prose --out": ["prose", "--file", "{0}/prose.txt", "--out", "{0}/prose.yaml"],
    "table": ["score", "--observations={0}/table.csv", "--decomposition=search-and-report", "--per-run"],
    # Refused, each with its own words in the error.
    "no such file": ["simulate", "{0}/none\x1b[2J\u202e"],
    "bad file": ["difficulty", "{0}/bad.yaml"],
    "no such command": ["\x1b[2J\u202e"],
    "no such option": ["score", "--\x1b[2J\u202e"],
    "no such node": ["score", "{0}/out", "--explain", "\x1b[2J\u202e"],
}
REFUSED = ("no such file", "bad file", "no such command", "no such option", "no such node")


@pytest.fixture(scope="module")
def files(folder: Path) -> Path:
    """Files from elsewhere beside the campaign."""
    scene = yaml.safe_load((ROOT / "examples" / "search.yaml").read_text())
    scene |= {"description": HOSTILE, "agent": {"manifest": str(folder / f"{NAME}-crash.yaml")}}
    (folder / "scene.json").write_text(json.dumps(scene, default=str))
    prose = f"A radar vehicle {HOSTILE} and 5 civilians\u202e. Zog \x1b[2J the frobnicator."
    (folder / "prose.txt").write_text(prose)
    (folder / "bad.yaml").write_text('name: "x\\e[2J\\u202e"\n"zz\\e[2J\\u202e": 3\nworld: "\\e[2J\\u202e"\n')
    decomposition = (ROOT / "decompositions" / "data" / "search_and_report.yaml").read_text()
    title = "Suppression of target marking near bystanders"
    assert title in decomposition
    (folder / "decomposition.yaml").write_text(decomposition.replace(title, json.dumps(HOSTILE)))
    rows = [f"r{number}{HOSTILE[:20]},{HOSTILE[:20]},OBS-181,50,{number}" for number in (0, 1)]
    (folder / "table.csv").write_text("\n".join(["run,agent,observable,difficulty,x", *rows]))
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_shows_what_it_prints(
    files: Path, command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["rebar", *(word.format(files) for word in COMMANDS[command])])
    with pytest.raises(SystemExit) as end:
        main()
    printed = capsys.readouterr()
    assert end.value.code == (2 if command in REFUSED else 0), printed.err
    assert_visible(printed.out)
    assert_visible(printed.err)
    if "--json" in command:
        json.loads(printed.out)
    if command in ("explain", "simulate"):
        assert f"report {MARKUP} (mobile_radar)" in " ".join(printed.out.split())
        assert SHOWN in printed.out
    if command == "simulate":
        # No line of the agent's begins where those of the bench begin.
        assert f"\n    {SHOWN}" in printed.out
        assert f"recording: {files}/simulated\\x1b[2J[red]/recording.mcap" in printed.out
    for path in (*files.glob("graph.*"), *files.glob("prose.[yh]*")):
        assert_visible(path.read_bytes())
