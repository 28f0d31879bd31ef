"""Paths that cannot be what a command needs: exit code 2, one sentence with the path, and nothing made on the way."""

from __future__ import annotations

import errno
import os
import shlex
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import EXAMPLE, Rebar, short_campaign
from detector_fit import declare

from bench.cli._app import run
from bench.cli._fault_paths import path_fault
from bench.errors import command_line

# `@` stands for the path.
READING = (
    "report @",
    "score @",
    "score @ --explain KA-03",
    "score --observations @ --decomposition search-and-report",
    "verify @",
    "verify @ --refly 1",
    "sign @ --key key",
    "compare @",
    "next @",
    "calibrate @",
    "status @",
    "pause @",
    "resume @",
    "retry @",
    "merge @ --out merged",
    "graph @",
    "graph search-and-report --campaign @",
    "decomposition check @",
    "decomposition check search-and-report --floor @",
    "run @",
    "run @ --dry-run",
    "realize @",
    "simulate @",
    "difficulty @",
    "difficulty SEARCH --decomposition @",
    "prose --file @",
    "prose truck --vocabulary @",
    "fit-detector @",
)
MAKING_FOLDERS = (
    *("run CAMPAIGN --out=@", "realize CAMPAIGN --out=@", "simulate SEARCH --out=@", "examples --copy=@"),
)
# The file itself, or the folder that it is to lie in.
MAKING_FILES = (
    "prose truck --out=@",
    "prose truck --campaign=@",
    "graph search-and-report --out=@/graph.svg",
    "camera sheet --out=@/sheet.png",
    "run CAMPAIGN --out=out --events=@",
)


# By their kind, in the working folder.
PATHS = {
    "missing": "no/such/path",
    "folder": "folder",
    "file": "file",
    "below a file": "file/below",
    "dangling link": "link",
    "below a dangling link": "link/below",
    "link to itself": "loop",
    "too long": "n" * 300,
    "/": "/",
    # Root may write everywhere but there.
    "unwritable": "/sys/kernel/rebar",
}
Answer = Callable[[str, str], list[str]]


@pytest.fixture
def answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rebar: Rebar) -> Answer:
    """Runs a command that must be refused and make nothing, and returns the lines of the error."""
    monkeypatch.chdir(tmp_path)
    declare(monkeypatch)
    short_campaign(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("no: [document\n")
    (tmp_path / "link").symlink_to("nowhere/at-all")
    (tmp_path / "loop").symlink_to("loop")

    def answer(command: str, path: str) -> list[str]:
        before = {*tmp_path.rglob("*")}
        names = {"SEARCH": str(EXAMPLE), "CAMPAIGN": "short.yaml"}
        lines = rebar.refused(*(names.get(word, word).replace("@", path) for word in command.split()))
        assert {*tmp_path.rglob("*")} == before
        return lines.splitlines()

    return answer


@pytest.mark.parametrize("command", READING)
def test_a_path_that_cannot_be_read_is_a_matter_of_input(command: str, answer: Answer) -> None:
    # The others are no more to a reader than a path that is missing, or a folder.
    kinds = PATHS.keys() - {"below a dangling link", "/", "unwritable"}
    # Any text is prose.
    for kind in kinds - ({"file"} if command == "prose --file @" else set()):
        lines = answer(command, PATHS[kind])
        assert lines, kind
        assert all(line.startswith("rebar: ") for line in lines), (kind, lines)


@pytest.mark.parametrize("command", [*MAKING_FOLDERS, *MAKING_FILES])
def test_a_path_that_cannot_be_written_is_a_matter_of_input(command: str, answer: Answer) -> None:
    for kind in ("below a file", "below a dangling link", "link to itself", "too long", "unwritable"):
        line = answer(command, PATHS[kind])[-1]
        assert line.startswith("rebar: "), (kind, line)
    for kind in ("file", "dangling link") if command in MAKING_FOLDERS else ():
        assert f"rebar: {PATHS[kind]}: is " in answer(command, PATHS[kind])[-1]


def test_a_link_that_leads_nowhere_is_not_overwritten(tmp_path: Path, answer: Answer) -> None:
    (tmp_path / "mine" / "campaigns").mkdir(parents=True)
    (tmp_path / "mine" / "campaigns" / "demo.yaml").symlink_to("gone")
    (line,) = answer("examples --copy=mine", "")
    assert "exist" in line


def test_what_is_in_the_way_is_named(tmp_path: Path) -> None:
    """The path of the error may be one that the bench makes inside what the user named."""
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("gone")

    def told(code: int, *parts: str) -> str:
        fault = path_fault(OSError(code, os.strerror(code), str(tmp_path.joinpath(*parts))))
        assert fault is not None
        assert fault.remedy
        return f"{Path(fault.where).relative_to(tmp_path)} {fault.what}"

    assert told(errno.ENOTDIR, "file", "runs", "x.json") == "file is no folder"
    assert told(errno.EEXIST, "file") == "file is no folder"
    assert told(errno.EEXIST, "link") == "link is a link to gone, which does not exist"
    assert told(errno.ENOENT, "link", "scores") == "link is a link to gone, which does not exist"
    assert told(errno.ENOENT, "gone", "scores") == "gone/scores does not exist"
    assert told(errno.EACCES, "file") == "file is closed to this user"
    assert told(errno.EISDIR, ".") == ". is a folder"
    # What is about no path, or not about the path, is no matter of input.
    assert path_fault(OSError(errno.EACCES, "Permission denied")) is None
    assert path_fault(OSError(errno.ENOSPC, "No space left on device", str(tmp_path))) is None


def test_a_journal_that_cannot_be_opened_is_a_matter_of_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rebar: Rebar
) -> None:
    """SQLite has errors of its own; a full disk is none of the user's input."""
    database = tmp_path / "journal.sqlite"
    sqlite3.connect(database).close()

    def write_read_only(*_: object) -> None:
        sqlite3.connect(f"file:{database}?mode=ro", uri=True).execute("create table t (x)")

    def write_elsewhere(*_: object) -> None:
        sqlite3.connect(tmp_path / "no" / "such.sqlite")

    def fill(*_: object) -> None:
        connection = sqlite3.connect(":memory:")
        connection.execute("pragma max_page_count = 1")
        connection.execute("create table t (x)")

    for trouble, code in ((write_read_only, 2), (write_elsewhere, 2), (fill, 1)):
        monkeypatch.setattr("bench.campaign.finish_campaign", trouble)
        assert "rebar: cannot write the journal" in rebar.refused("report", "out", code=code)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read and write everything")
def test_what_is_closed_to_the_user_is_a_matter_of_input(tmp_path: Path, answer: Answer) -> None:
    (tmp_path / "file").chmod(0)
    (tmp_path / "folder").chmod(0)
    try:
        assert all(answer(command, path) for command in READING for path in ("file", "folder"))
    finally:
        (tmp_path / "folder").chmod(0o700)


def test_hints_can_be_pasted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rebar: Rebar) -> None:
    """Also where a name begins with a dash, which an option does, or has a space."""
    line = command_line("rebar", "run", Path("-a b"), "--out", Path("-dash"))
    assert shlex.split(line) == ["rebar", "run", "./-a b", "--out", "./-dash"]
    monkeypatch.chdir(tmp_path)
    assert run(["prose", "A truck. Five civilians.", "--campaign=-dash.yaml", "--out=-dash"]) == 0
    hint = rebar("examples", "--copy=-mine").splitlines()[-1].partition("Try: ")[2]
    assert run([*shlex.split(hint)[1:], "--dry-run"]) == 0
