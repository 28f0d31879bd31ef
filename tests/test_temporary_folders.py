"""Temporary folders go with their processes, however these end."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bench import temporary_folders
from bench.temporary_folders import left_folders, temporary_folder

KILLED = """
import os, signal, sys
from pathlib import Path
from bench.temporary_folders import temporary_folder
with temporary_folder("killed", Path(sys.argv[1])) as folder:
    (folder / "deep" / "er").mkdir(parents=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def killed_in(parent: Path) -> Path:
    """What a process leaves that is killed while it has a temporary folder."""
    subprocess.run([sys.executable, "-c", KILLED, str(parent)], check=False)
    (folder,) = parent.glob("rebar-killed-*")
    return folder


def test_a_folder_is_gone_after_the_block(tmp_path: Path) -> None:
    with temporary_folder("one", tmp_path) as one, temporary_folder("two", tmp_path) as two:
        assert one.name.startswith("rebar-one-")
        assert one != two
        assert one.stat().st_mode & 0o777 == 0o700
        (one / "below").mkdir()
        (one / "below" / "file").touch()
    assert list(tmp_path.iterdir()) == []


def test_the_next_one_removes_what_a_killed_one_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = killed_in(tmp_path)
    # So young it might be one whose maker has not locked it yet.
    assert list(left_folders(tmp_path)) == []
    with temporary_folder("alive", tmp_path) as alive:
        monkeypatch.setattr(temporary_folders, "UNLOCKED_S", 0.0)
        assert list(left_folders(tmp_path)) == [left]
        with temporary_folder("next", tmp_path):
            assert not left.exists()
            assert alive.is_dir()


def test_nothing_else_is_taken_for_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(temporary_folders, "UNLOCKED_S", 0.0)
    (tmp_path / "rebar-results").mkdir()
    (tmp_path / "rebar-agent-mine").mkdir()
    (tmp_path / "rebar-agent-abcdefgh.scratch").touch()
    (tmp_path / "rebar-agent-ijklmnop.scratch").symlink_to("rebar-results")
    assert list(left_folders(tmp_path)) == []
    assert list(left_folders(tmp_path / "missing")) == []


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder to somebody else")
def test_the_folders_of_other_users_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = killed_in(tmp_path)
    monkeypatch.setattr(temporary_folders, "UNLOCKED_S", 0.0)
    os.chown(left, 65534, 65534)
    assert list(left_folders(tmp_path)) == []
