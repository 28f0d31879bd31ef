"""Commands that only read a campaign leave its folder as it is, so they work where nobody may write."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import pytest
from command_line import Rebar, fly_surrogates

from bench.campaign import open_journal
from bench.campaign.storage._journal_file import open_journal_to_read
from bench.documents import load_document
from bench.reporting import AssuranceCase, assurance_svg, figure_files, load_report_data

READING = [
    ["status", "{folder}"],
    ["verify", "{folder}"],
    ["report", "{folder}", "--out", "{elsewhere}/report.html"],
    ["report", "{folder}", "--assurance", "{elsewhere}/case"],
    ["report", "{folder}", "--figures", "{elsewhere}/figures"],
    ["score", "{folder}", "--explain", "KA-03"],
    ["compare", "{folder}"],
    ["calibrate", "{folder}"],
    ["next", "{folder}", "--out", "{elsewhere}/next.yaml"],
    ["graph", "search-and-report", "--campaign", "{folder}", "--out", "{elsewhere}/graph.svg"],
]
# A process that is killed in mid-transaction, in either of SQLite's ways to keep one whole.
KILLED_BETWEEN_TRANSACTIONS = """
import os, sys
from pathlib import Path
from bench.campaign import open_journal
with open_journal(Path(sys.argv[1])) as journal:
    journal.note("left by", "a killed runner")
    os._exit(0)
"""
KILLED_IN_A_TRANSACTION = """
import os, sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
database.execute("PRAGMA journal_mode = DELETE")
database.execute("PRAGMA cache_size = 1")
database.execute("BEGIN IMMEDIATE")
database.execute("INSERT INTO facts VALUES ('half', 'a transaction')")
# Far more than the cache holds: pages of the unfinished transaction are in the file.
database.executemany("INSERT INTO facts VALUES (?, ?)", ((f"filler {number}", "x" * 4000) for number in range(50)))
os._exit(0)
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fly_surrogates(tmp_path_factory.mktemp("archive"))


def state_of(folder: Path) -> dict[str, tuple[object, ...]]:
    """What shows a write in a folder: of files all but the time of the last look, of folders also what came and went."""
    return {
        str(path.relative_to(folder)): (status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)
        for path in (folder, *folder.rglob("*"))
        for status in (path.stat(),)
    }


@pytest.mark.parametrize("line", READING, ids=lambda line: " ".join(line[::2]))
def test_a_command_that_reads_a_campaign_writes_nothing_there(
    line: list[str], flown: Path, tmp_path: Path, rebar: Rebar
) -> None:
    before = state_of(flown)
    rebar(*(word.format(folder=flown, elsewhere=tmp_path) for word in line))
    assert state_of(flown) == before


@pytest.mark.parametrize("killed", [KILLED_BETWEEN_TRANSACTIONS, KILLED_IN_A_TRANSACTION])
def test_a_killed_runner_leaves_a_journal_that_is_read_without_a_write(
    killed: str, flown: Path, tmp_path: Path, rebar: Rebar
) -> None:
    """What its last whole transaction left is read, nothing of an unfinished one, and the next runner finds all as it was."""
    folder = tmp_path / "killed"
    shutil.copytree(flown, folder)
    subprocess.run([sys.executable, "-c", killed, str(folder / "journal.sqlite")], check=True)
    left = {path.name for path in folder.iterdir() if path.name.startswith("journal.sqlite-")}
    assert left >= {"journal.sqlite-journal" if killed is KILLED_IN_A_TRANSACTION else "journal.sqlite-wal"}

    before = state_of(folder)
    with open_journal_to_read(folder / "journal.sqlite") as journal:
        facts = (journal.fact("left by"), journal.fact("half"), len(journal.entries()))
    assert facts == (None if killed is KILLED_IN_A_TRANSACTION else "a killed runner", None, 12)
    for command in ("status", "compare"):
        rebar(command, folder)
    assert state_of(folder) == before
    with open_journal(folder / "journal.sqlite") as journal:
        assert (journal.fact("left by"), journal.fact("half"), len(journal.entries())) == facts


def test_a_report_elsewhere_is_the_one_in_the_folder_and_of_no_changed_scores(
    flown: Path, tmp_path: Path, rebar: Rebar
) -> None:
    folder, page = tmp_path / "copy", tmp_path / "report.html"
    shutil.copytree(flown, folder)
    line = ["report", folder, "--out", page]
    rebar(*line)
    assert page.read_bytes() == (flown / "report.html").read_bytes()
    assert "report.html: already exists and is not overwritten" in rebar.refused(*line)
    page.unlink()
    with (folder / "scores.parquet").open("ab") as file:
        file.write(b"more")
    assert "scores.parquet: has changed since the manifest was written" in rebar.refused(*line)
    assert not page.exists()


def test_each_agent_has_one_case_and_one_drawing(flown: Path, tmp_path: Path, rebar: Rebar) -> None:
    """With the digests of the manifest; in no folder that there is, and not beside a report."""
    out = tmp_path / "made" / "case"
    line = ["report", flown, "--assurance", out]
    rebar(*line)
    manifest = json.loads((flown / "manifest.json").read_text())
    agents = []
    for place in (1, 2):
        case = load_document(out / f"agent-{place}.json", AssuranceCase)
        agents.append(case.agent)
        assert (out / f"agent-{place}.svg").read_text() == assurance_svg(case)
        evidence = {path: manifest["files"][path] for path in ("scores.parquet", "runs.csv")}
        solutions = [element for element in case.elements if element.kind == "solution"]
        assert [element.evidence for element in solutions] == [evidence] * len(solutions) != []
    assert len(set(agents)) == len(list(out.iterdir())) / 2 == 2
    assert "case: already exists and is not overwritten" in rebar.refused(*line)
    assert "give one of them" in rebar.refused(*line, "--out", tmp_path / "report.html")


def test_the_figures_are_those_of_the_campaign(flown: Path, tmp_path: Path, rebar: Rebar) -> None:
    out = tmp_path / "figures"
    printed = rebar("report", flown, "--figures", out).split()
    files = dict(figure_files(load_report_data(flown)))
    assert {path.name: path.read_text() for path in out.iterdir()} == files
    assert printed == [str(out / name) for name in files]
    assert "figures: already exists" in rebar.refused("report", flown, "--figures", out)


@pytest.mark.parametrize("command", ["report", "score", "retry"])
def test_a_command_that_writes_says_what_reads(
    command: str, flown: Path, monkeypatch: pytest.MonkeyPatch, rebar: Rebar
) -> None:
    """One sentence that names the folder, and not a file of the bench in it."""
    opened: Callable[..., IO[Any]] = Path.open

    def open_unless_written(path: Path, mode: str = "r", *rest: Any, **options: Any) -> IO[Any]:
        if flown in path.parents and set(mode) & set("wax+"):
            raise OSError(30, os.strerror(30), str(path))
        return opened(path, mode, *rest, **options)

    monkeypatch.setattr(Path, "open", open_unless_written)
    (fault,) = rebar.refused(command, flown).splitlines()
    assert fault.startswith(
        f"rebar: {flown}: cannot be written (Read-only file system) (name another folder,"
    )
    assert "compare" in fault
