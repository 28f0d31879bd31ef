"""What the file system of a folder can do: network disks and those of user programs may lack what a campaign rests on."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from bench.errors import SetupError

_DISK_FAULTS = frozenset({errno.EIO, errno.ENOSPC, errno.EDQUOT})
_REMEDY = "name a folder on another disk, such as one of this machine's own; docs/campaign-folders.md, Network disks"

# Those whose files no other machine changes. Any other, also one that is not known, may be shared.
_OF_ONE_MACHINE = frozenset(
    [
        "ext2",
        "ext3",
        "ext4",
        "xfs",
        "btrfs",
        "zfs",
        "f2fs",
        "bcachefs",
        "jfs",
        "nilfs2",
        "overlay",
        "tmpfs",
        "ramfs",
        "vfat",
        "exfat",
        "ntfs3",
    ]
)
_MOUNTS = Path("/proc/self/mountinfo")


def check_file_system(folder: Path, *, with_locks: bool = True) -> None:
    """Raises SetupError, naming the folder, if its file system lacks what a campaign rests on: locks of both kinds (not
    asked for without `with_locks`), fsync, and a rename that takes another file's place. Takes milliseconds.
    """
    trials: list[tuple[str, Callable[[int, str, str], object]]] = [
        ("fsync", lambda file, _, __: os.fsync(file)),
        ("a rename over another file", lambda _, draft, target: os.replace(draft, target)),
    ]
    if with_locks:
        # SQLite locks by fcntl, the bench by flock. An NFS client makes the same lock of both, so each is given back.
        trials += [
            ("locks by flock", lambda file, _, __: _lock_and_unlock(fcntl.flock, file)),
            ("locks by fcntl", lambda file, _, __: _lock_and_unlock(fcntl.lockf, file)),
        ]
    # Named as a file that is half written, which readers and manifests pass over.
    file, draft = tempfile.mkstemp(prefix=".trial-", suffix=".part", dir=folder)
    target = f"{draft.removesuffix('.part')}-2.part"
    try:
        Path(target).touch()
        lacks = [
            f"{name} ({error.strerror})"
            for name, trial in trials
            if (error := _error_of(trial, file, draft, target)) is not None
        ]
    finally:
        os.close(file)
        for path in (draft, target):
            with suppress(FileNotFoundError):
                os.unlink(path)
    if lacks:
        raise SetupError(folder, f"lies on a file system without {' and '.join(lacks)}", _REMEDY)


def _error_of(trial: Callable[[int, str, str], object], file: int, draft: str, target: str) -> OSError | None:
    try:
        trial(file, draft, target)
    except OSError as error:
        # A full or broken disk lacks nothing that another one would have.
        if error.errno in _DISK_FAULTS:
            raise
        return error
    return None


def _lock_and_unlock(lock: Callable[[int, int], object], file: int) -> None:
    lock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    lock(file, fcntl.LOCK_UN)


def may_be_shared(folder: Path, mounts: Path = _MOUNTS) -> bool:
    """Whether other machines may see a folder's files: its file system is not one that is known for a machine's own."""
    return file_system_of(folder, mounts) not in _OF_ONE_MACHINE


def file_system_of(folder: Path, mounts: Path = _MOUNTS) -> str:
    """The kind of file system in which a folder lies, such as `ext4` or `nfs4`; empty where the system does not say.

    `mounts` has the form of /proc/self/mountinfo, proc(5).
    """
    try:
        lines = mounts.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        return ""
    resolved = folder.resolve()
    kind, depth = "", 0
    for line in lines:
        before, _, after = line.partition(" - ")
        # Blanks in a path are written as octal numbers.
        words = before.split(" ")[4]
        mount = Path(re.sub(r"\\([0-7]{3})", lambda octal: chr(int(octal[1], 8)), words))
        # The later of two mounts at one place covers the other.
        if len(mount.parts) >= depth and resolved.is_relative_to(mount):
            kind, depth = after.split(" ")[0], len(mount.parts)
    return kind
