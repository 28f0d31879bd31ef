"""Which files an agent may read: what its program needs, and no folder with sessions; and what a watch of its scratch
folder counts: whatever takes room on the disk, once.
"""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.agents.confinement import find_program, program_paths, without_sessions
from bench.agents.confinement._landlock_launch import (
    LEAST_FILE_BYTES,
    MAX_FOLDER_DEPTH,
    TooDeep,
    used_bytes,
)


def session_folder(path: Path, mark: str) -> Path:
    path.mkdir(parents=True)
    (path / mark).touch()
    return path


def test_folders_with_sessions_are_left_out_wherever_they_are(tmp_path: Path) -> None:
    """Of two campaigns one lies deep, of two single sessions one is marked by nothing and named as hidden."""
    agent = tmp_path / "agent"
    (agent / "models" / "large").mkdir(parents=True)
    (agent / "run.py").touch()
    session_folder(agent / "out" / "standard", "journal.sqlite")
    session_folder(agent / "models" / "tried" / "full", "simspecs")
    session_folder(agent / "flown", "recording.mcap")
    (agent / "now").mkdir()
    kept = without_sessions(agent, [agent / "now"])
    assert kept == [agent / "models" / "large", agent / "run.py"]
    assert without_sessions(agent / "models" / "large", ()) == [agent / "models" / "large"]
    assert without_sessions(agent / "flown", ()) == []


def test_of_a_checkout_only_packages_are_readable(tmp_path: Path) -> None:
    """An editable installation names the checkout in a .pth file; setuptools may name packages in a module."""
    checkout = tmp_path / "checkout"
    for package in ("pilot", "maps"):
        (checkout / package).mkdir(parents=True)
        (checkout / package / "__init__.py").touch()
    (checkout / "campaigns").mkdir()
    (checkout / "single.py").touch()
    venv.create(tmp_path / "env", with_pip=False, symlinks=True)
    site = next((tmp_path / "env" / "lib").glob("python3*")) / "site-packages"
    (site / "checkout.pth").write_text(f"# comment\nimport sys\n{checkout}\n")
    (site / "__editable___other_finder.py").write_text(
        f"MAPPING: dict[str, str] = {{'other': '{tmp_path}/other/src/other'}}\n"
    )
    paths = program_paths(tmp_path / "env" / "bin" / "python", {})
    below = {path for path in paths if path.is_relative_to(checkout) or "other" in path.parts}
    assert below == {
        checkout / "pilot",
        checkout / "maps",
        checkout / "single.py",
        tmp_path / "other" / "src" / "other",
    }
    assert tmp_path / "env" not in paths
    assert Path(sys.executable).resolve().parent in paths


def test_a_script_brings_its_interpreter(tmp_path: Path) -> None:
    """By a first line with the interpreter's path, and by one with env."""
    interpreter = tmp_path / "tools" / "shell"
    interpreter.parent.mkdir()
    os.symlink("/bin/sh", interpreter)
    for number, line in enumerate((f"#!{interpreter} -e", "#!/usr/bin/env shell")):
        script = tmp_path / f"run{number}"
        script.write_text(f"{line}\ntrue\n")
        script.chmod(0o755)
        assert program_paths(script, {"PATH": str(interpreter.parent)}) == [script, interpreter]


def test_programs_are_found_as_a_shell_finds_them(tmp_path: Path) -> None:
    """By the agent's PATH, and by a path from its folder; a file that cannot be executed is no program."""
    for name, mode in (("tool", 0o755), ("text", 0o644)):
        (tmp_path / name).write_text("#!/bin/sh\n")
        (tmp_path / name).chmod(mode)
    environment = {"PATH": str(tmp_path)}
    assert find_program("tool", environment, Path("/")) == tmp_path / "tool"
    assert find_program("./tool", {}, tmp_path) == tmp_path / "tool"
    assert find_program("text", environment, Path("/")) is None
    assert find_program("./text", {}, tmp_path) is None
    assert find_program("none", environment, Path("/")) is None


MEBIBYTE = 1 << 20
PLENTY = 1 << 40
HOLD_DELETED = """
import os, sys
with open("held", "w+b") as file:
    file.write(bytes(3 << 20))
    file.flush()
    os.unlink("held")
    print("ready", flush=True)
    sys.stdin.read()
"""


def used_here(folder: Path, enough: int = PLENTY) -> int:
    return used_bytes(str(folder), os.getpid(), enough)


def test_files_and_folders_of_any_depth_count_once(tmp_path: Path) -> None:
    """With a second name, with links out of the folder, with a hole in it, and empty."""
    deep = tmp_path / "a" / "b"
    deep.mkdir(parents=True)
    (tmp_path / "first").write_bytes(bytes(2 * MEBIBYTE))
    (deep / "second").write_bytes(bytes(MEBIBYTE))
    before = used_here(tmp_path)
    assert 3 * MEBIBYTE <= before <= 3 * MEBIBYTE + 16 * LEAST_FILE_BYTES
    (deep / "first").hardlink_to(tmp_path / "first")
    assert used_here(tmp_path) == before
    (deep / "out").symlink_to("/")
    with (tmp_path / "hole").open("wb") as file:
        file.truncate(PLENTY // 2)
    for number in range(100):
        (deep / f"empty-{number}").touch()
    assert 102 * LEAST_FILE_BYTES <= used_here(tmp_path) - before <= 120 * LEAST_FILE_BYTES
    assert used_here(tmp_path, enough=MEBIBYTE) < before, "it stops once it knows enough"


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A child that holds a deleted file of 3 MiB open."""
    command = [sys.executable, "-I", "-S", "-c", HOLD_DELETED]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=tmp_path, stdin=pipe, stdout=pipe, text=True) as child:
        assert child.stdout is not None
        child.stdout.readline()
        yield child


def test_a_deleted_file_counts_while_a_child_holds_it(tmp_path: Path, holder: subprocess.Popen[str]) -> None:
    """As long as it takes room; of another folder's disk nothing counts."""
    assert list(tmp_path.iterdir()) == []
    assert 3 * MEBIBYTE <= used_here(tmp_path) <= 3 * MEBIBYTE + 16 * LEAST_FILE_BYTES
    assert used_bytes(str(tmp_path), holder.pid, PLENTY) == 0, "a process alone: it is not below itself"
    holder.communicate("")
    assert used_here(tmp_path) == 0


@pytest.mark.parametrize("name", ["d", "d" * 255])
def test_folders_in_one_another_are_bounded(tmp_path: Path, name: str) -> None:
    """By their number, with paths that the system takes and with longer ones; up to it they count as any other."""
    held = os.open(tmp_path, os.O_RDONLY)
    depths = []
    for depth in range(1, MAX_FOLDER_DEPTH + 2):
        os.mkdir(name, dir_fd=held)
        deeper = os.open(name, os.O_RDONLY, dir_fd=held)
        os.close(held)
        held = deeper
        if depth in (MAX_FOLDER_DEPTH - 1, MAX_FOLDER_DEPTH):
            depths.append(used_here(tmp_path))
    os.close(held)
    assert depths == [(MAX_FOLDER_DEPTH - 1) * LEAST_FILE_BYTES, MAX_FOLDER_DEPTH * LEAST_FILE_BYTES]
    with pytest.raises(TooDeep):
        used_here(tmp_path)


def test_a_link_that_appears_in_the_place_of_a_folder_is_not_followed(tmp_path: Path) -> None:
    """Neither one out of the folder nor one into it."""
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "large").write_bytes(bytes(MEBIBYTE))
    watched = tmp_path / "watched"
    watched.mkdir()
    (watched / "link").symlink_to(outside)
    assert used_here(watched) == LEAST_FILE_BYTES
    with pytest.raises(OSError, match="Not a directory"):
        used_here(watched / "link")
