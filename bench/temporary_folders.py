"""Folders among the temporary files: one that a killed process has left is removed by the next process that needs one."""

from __future__ import annotations

import fcntl
import os
import re
import tempfile
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bench.errors import SetupError
from bench.removal import remove_tree

# Nobody names a folder of their own like this: what has such a name may be removed.
_NAME = re.compile(r"rebar-[a-z]+-[a-z0-9_]{8}\.scratch")
_SUFFIX = ".scratch"
UNLOCKED_S = 60.0
"""Host seconds that a new folder may be without its lock. Chosen: its maker needs microseconds."""


def user_cache() -> Path:
    """Where this user keeps what can be made again (XDG base directory specification)."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rebar"


@contextmanager
def temporary_folder(purpose: str, parent: Path | None = None) -> Generator[Path]:
    """A new folder for this user alone, gone after the block. `purpose` (lower-case letters) becomes part of its name.

    First those that killed processes of this user have left beside it are removed. Raises SetupError where the file
    system has no locks.
    """
    parent = parent or Path(tempfile.gettempdir())
    for folder in left_folders(parent):
        remove_tree(folder)
    folder = Path(tempfile.mkdtemp(prefix=f"rebar-{purpose}-", suffix=_SUFFIX, dir=parent))
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        _lock(lock, parent)
        yield folder
    finally:
        remove_tree(folder)
        os.close(lock)


def _lock(folder: int, parent: Path) -> None:
    try:
        # A lock of the kernel: it goes with this process however that ends.
        fcntl.flock(folder, fcntl.LOCK_SH)
    except OSError as error:
        what = f"lies on a file system without locks by flock ({error.strerror})"
        raise SetupError(
            str(parent), what, "set TMPDIR to a folder on a disk of this machine's own"
        ) from error


def left_folders(parent: Path) -> Iterator[Path]:
    """The temporary folders of this user in `parent` whose processes are gone."""
    with suppress(OSError):
        for entry in os.scandir(parent):
            if _NAME.fullmatch(entry.name) and _is_left(entry.path):
                yield Path(entry.path)


def _is_left(path: str) -> bool:
    try:
        folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return False
    try:
        status = os.fstat(folder)
        if status.st_uid != os.getuid() or time.time() - status.st_ctime < UNLOCKED_S:
            return False
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    finally:
        os.close(folder)
    return True
