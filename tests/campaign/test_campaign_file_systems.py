"""Campaigns on hosts that lack something: a sentence before the first session, or another way to the same end; and
digests of files that are kept.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import gc
import os
import resource
import sqlite3
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import pytest
from campaign_fakes import fly, small_campaign

from bench.campaign import check_file_system, open_journal, open_local_pool, verify_folder
from bench.campaign.execution import _local_pool
from bench.campaign.execution._local_pool import FILES_OF_A_SESSION
from bench.campaign.results._finish import frozen_heap
from bench.campaign.storage._file_system import file_system_of, may_be_shared
from bench.campaign.storage._files import (
    MIN_KEPT_BYTES,
    FileDigests,
    digest_of,
    sync_files_below,
    write_whole,
)
from bench.campaign.storage._folder import open_lock
from bench.campaign.storage._journal_file import open_journal_to_read
from bench.cli._app import run
from bench.errors import SetupError
from bench.temporary_folders import temporary_folder

SIMSPEC = Path(__file__).parents[2] / "examples" / "search.yaml"
LACKING = [
    (fcntl, "flock", errno.ENOLCK, "locks by flock (No locks available)"),
    (fcntl, "lockf", errno.ENOSYS, "locks by fcntl (Function not implemented)"),
    (os, "fsync", errno.EINVAL, "fsync (Invalid argument)"),
    (os, "replace", errno.EPERM, "a rename over another file (Operation not permitted)"),
]


def failing(code: int) -> Any:
    def fail(*_: object, **__: object) -> NoReturn:
        raise OSError(code, os.strerror(code))

    return fail


@pytest.mark.parametrize(("module", "name", "code", "words"), LACKING, ids=[lack[1] for lack in LACKING])
def test_a_campaign_names_its_folder_and_what_the_file_system_lacks(
    module: Any, name: str, code: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is written or flown; nothing of the trial stays."""
    folder = tmp_path / "out"
    with monkeypatch.context() as lacking:
        lacking.setattr(module, name, failing(code))
        with pytest.raises(SetupError) as error:
            fly(folder)
    (fault,) = error.value.faults
    assert (fault.where, fault.what) == (str(folder), f"lies on a file system without {words}")
    assert fault.remedy
    assert {path.name for path in folder.iterdir()} == {".lock"}


def test_all_that_is_lacking_is_named_at_once_and_a_run_without_a_campaign_needs_no_locks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full or broken disk is not told to lack anything."""
    check_file_system(tmp_path)
    monkeypatch.setattr(fcntl, "flock", failing(errno.ENOLCK))
    monkeypatch.setattr(fcntl, "lockf", failing(errno.ENOLCK))
    with pytest.raises(SetupError, match=r"without locks by flock .* and locks by fcntl "):
        check_file_system(tmp_path)
    check_file_system(tmp_path, with_locks=False)
    for code in (errno.ENOSPC, errno.EIO):
        monkeypatch.setattr(os, "fsync", failing(code))
        with pytest.raises(OSError, match=os.strerror(code)):
            check_file_system(tmp_path, with_locks=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["simulate", "realize"])
def test_other_commands_say_it_before_they_work(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign = tmp_path / "campaign.yaml"
    campaign.write_text(small_campaign().model_dump_json(exclude_none=True))
    monkeypatch.setattr(os, "fsync", failing(errno.ENOSYS))
    out = tmp_path / "out"
    assert run([command, str(SIMSPEC if command == "simulate" else campaign), "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"rebar: {out}: lies on a file system without fsync (Function not implemented)")


def test_temporary_files_without_locks_are_told_with_the_variable_that_moves_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fcntl, "flock", failing(errno.ENOLCK))
    with (
        pytest.raises(SetupError, match=r"without locks by flock .*set TMPDIR"),
        temporary_folder("test", tmp_path),
    ):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("code", [errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP, errno.EPERM])
def test_without_syncfs_each_file_is_synced(
    code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "simspecs"
    for name in ("a.json", "00/b.json"):
        write_whole(folder / name, name, synced=False)
    os.mkfifo(folder / "pipe")
    synced: list[Path] = []
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(Path(os.readlink(f"/proc/self/fd/{file}"))))
    monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: SimpleNamespace(syncfs=lambda _: -1))
    monkeypatch.setattr(ctypes, "get_errno", lambda: code)
    sync_files_below(folder)
    expected = (folder / "a.json", folder / "00" / "b.json", folder / "00", folder, tmp_path)
    assert sorted(synced) == sorted(expected)
    # A disk that has lost something says so in the same way, and is believed.
    monkeypatch.setattr(ctypes, "get_errno", lambda: errno.EIO)
    with pytest.raises(OSError, match=os.strerror(errno.EIO)):
        sync_files_below(folder)


def test_a_file_system_that_syncs_files_alone_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sync = os.fsync

    def sync_file(file: int) -> None:
        if os.path.isdir(f"/proc/self/fd/{file}"):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        sync(file)

    monkeypatch.setattr(os, "fsync", sync_file)
    check_file_system(tmp_path)
    write_whole(tmp_path / "file", "whole")
    assert (tmp_path / "file").read_text() == "whole"


MOUNTS = """\
22 1 8:1 / / rw,relatime shared:1 - ext4 /dev/sda1 rw
30 22 0:40 / {home}/shared rw,nosuid - nfs4 server:/export rw
31 30 8:2 / {home}/shared/own\\040disk rw - xfs /dev/sdb1 rw
32 22 0:41 / {home}/covered rw - lustre mgs:/work rw
33 22 0:42 / {home}/covered rw - tmpfs tmpfs rw
34 22 0:43 / {home}/user rw - fuse.sshfs host: rw
"""


def test_the_file_system_of_a_folder_is_that_of_the_nearest_mount(tmp_path: Path) -> None:
    home = tmp_path.resolve()
    mounts = home / "mountinfo"
    mounts.write_text(MOUNTS.format(home=home))
    link = home / "link"
    link.symlink_to(home / "shared")
    kinds = {
        home: "ext4",
        home / "shared": "nfs4",
        home / "shared" / "a" / "b": "nfs4",
        home / "shared2": "ext4",
        home / "shared" / "own disk" / "c": "xfs",
        home / "covered" / "c": "tmpfs",
        home / "user": "fuse.sshfs",
        link / "a": "nfs4",
    }
    for folder, kind in kinds.items():
        assert file_system_of(folder, mounts) == kind, folder
        assert may_be_shared(folder, mounts) is (kind in {"nfs4", "fuse.sshfs"}), folder
    assert may_be_shared(home, home / "no such list"), "a system that does not say is not trusted"


READS = """
import sys
from pathlib import Path
from bench.campaign.storage._journal_file import open_journal_to_read
with open_journal_to_read(Path(sys.argv[1])) as journal:
    print(len(journal.entries()), journal.fact("a fact"))
"""


@pytest.mark.parametrize(("shared", "mode"), [(False, "wal"), (True, "delete")])
def test_the_journal_of_a_disk_that_machines_share_needs_no_shared_memory(
    shared: bool, mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A whole campaign, and a reader in another process while somebody writes; a journal that was moved changes its mode."""
    monkeypatch.setattr("bench.campaign.storage._journal_file.may_be_shared", lambda _: not shared)
    fly(tmp_path)
    monkeypatch.setattr("bench.campaign.storage._journal_file.may_be_shared", lambda _: shared)
    assert fly(tmp_path).complete
    assert verify_folder(tmp_path) == []

    path = tmp_path / "journal.sqlite"
    with open_lock(tmp_path), open_journal(path) as journal:
        journal.note("a fact", "1")
        beside = {file.name for file in tmp_path.iterdir()} & {f"{path.name}-shm", f"{path.name}-wal"}
        assert bool(beside) is (mode == "wal")
        reader = [sys.executable, "-c", READS, str(path)]
        assert subprocess.run(reader, capture_output=True, text=True, check=True).stdout == "6 1\n"
    database = sqlite3.connect(path)
    assert database.execute("PRAGMA journal_mode").fetchone() == (mode,)
    database.close()


def test_a_journal_without_shared_memory_falls_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a file system in user space that cannot map a file into memory: SQLite refuses the write-ahead log."""

    class NoSharedMemory(sqlite3.Connection):
        def execute(self, sql: str, *parameters: Any) -> sqlite3.Cursor:
            if sql == "PRAGMA journal_mode = WAL":
                raise sqlite3.OperationalError("disk I/O error")
            return super().execute(sql, *parameters)

    connect = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", lambda *a, **k: connect(*a, factory=NoSharedMemory, **k))
    path = tmp_path / "journal.sqlite"
    with open_journal(path) as journal:
        journal.note("a fact", "1")
    with open_journal_to_read(path) as journal:
        assert journal.fact("a fact") == "1"
    assert {file.name for file in tmp_path.iterdir()} == {path.name}


class Limit:
    """The limit of open files of this process, as soft and hard; setting it changes nothing else."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, soft: int, hard: int) -> None:
        self.value = (soft, hard)
        monkeypatch.setattr(resource, "getrlimit", lambda _: self.value)
        monkeypatch.setattr(resource, "setrlimit", lambda _, value: setattr(self, "value", value))


def test_a_hard_limit_of_open_files_that_is_too_low_ends_all_before_the_first_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A campaign, and a session alone."""
    Limit(monkeypatch, 32, 32)
    with pytest.raises(SetupError) as error:
        fly(tmp_path / "campaign", open_executor=open_local_pool)
    (fault,) = error.value.faults
    assert fault.what == "32 open files are allowed (ulimit -Hn), and 128 are needed for sessions at once: 1"
    assert "ulimit -n 128" in fault.remedy
    assert "--workers" not in fault.remedy, "fewer than one is none"
    assert not (tmp_path / "campaign" / "runs").exists()
    assert run(["simulate", str(SIMSPEC), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("rebar: workers: 32 open files are allowed")


JUST_ENOUGH = (FILES_OF_A_SESSION, FILES_OF_A_SESSION)


@pytest.mark.parametrize(
    ("limit", "workers", "expected"),
    [
        (JUST_ENOUGH, 1, JUST_ENOUGH),
        (JUST_ENOUGH, 16, JUST_ENOUGH),
        ((32, FILES_OF_A_SESSION), 16, JUST_ENOUGH),
        ((32, resource.RLIM_INFINITY), 17, (132, resource.RLIM_INFINITY)),
        ((1024, 4096), 300, (1264, 4096)),
        ((1024, 4096), 8, (1024, 4096)),
        (
            (resource.RLIM_INFINITY, resource.RLIM_INFINITY),
            300,
            (resource.RLIM_INFINITY, resource.RLIM_INFINITY),
        ),
        ((FILES_OF_A_SESSION - 1, FILES_OF_A_SESSION - 1), 1, None),
        (JUST_ENOUGH, 17, None),
    ],
)
def test_a_soft_limit_is_raised_as_far_as_the_workers_need(
    limit: tuple[int, int], workers: int, expected: tuple[int, int] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = Limit(monkeypatch, *limit)
    if expected is None:
        with pytest.raises(SetupError, match="open files are allowed") as error:
            _local_pool._allow_open_files(workers)
        assert ("--workers" in str(error.value)) is (workers > 1)
        assert now.value == limit
    else:
        _local_pool._allow_open_files(workers)
        assert now.value == expected


def test_only_large_files_that_changed_are_read_again(tmp_path: Path) -> None:
    """Changed in place or replaced, by the same number of bytes, a file has its new digest. One that has just changed is
    read again: its times would not show another change within the same tick.
    """
    reads: list[str] = []

    def read(path: Path) -> str:
        reads.append(path.name)
        return digest_of(path)

    # No file has changed in the future: all are taken as settled.
    digests = FileDigests(read, settled_ns=-(10**18))
    large, other, small = (tmp_path / name for name in ("large", "other", "small"))
    for path, size in ((large, MIN_KEPT_BYTES), (other, MIN_KEPT_BYTES), (small, MIN_KEPT_BYTES - 1)):
        write_whole(path, b"a" * size)
    first = [digests.of(path) for path in (large, other, small)]
    assert [digests.of(path) for path in (large, other, small)] == first
    assert reads == ["large", "other", "small", "small"]

    write_whole(large, b"b" * MIN_KEPT_BYTES)
    with other.open("r+b") as file:
        file.write(b"longer")
        file.truncate(MIN_KEPT_BYTES + 1)
    assert digests.of(large) == digest_of(large) != first[0]
    assert digests.of(other) == digest_of(other) != first[1]

    unsettled = FileDigests(read, settled_ns=10**18)
    reads.clear()
    assert unsettled.of(large) == unsettled.of(large)
    assert reads == ["large", "large"]


def test_frozen_heap_thaws() -> None:
    """The outermost block alone freezes and thaws, also when it is left by an error."""
    with frozen_heap():
        with frozen_heap():
            assert gc.get_freeze_count() > 0
        assert gc.get_freeze_count() > 0
    assert gc.get_freeze_count() == 0

    with pytest.raises(ValueError, match="while frozen"), frozen_heap():
        raise ValueError("while frozen")
    assert gc.get_freeze_count() == 0
