"""Removing a folder in which an agent could write, whatever it has left there."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from pathlib import Path


def remove_tree(folder: Path) -> None:
    """Remove a folder with all that is in it, as far as the system lets us: what stays decides nothing.

    Folders in folders are moved up before they are emptied, so a tree of any depth needs two descriptors and no recursion
    (`shutil.rmtree` ends in a RecursionError at a thousand). No link is followed. Whoever could write in the folder must
    have ended.
    """
    with suppress(OSError):
        top = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            _empty(top)
        finally:
            os.close(top)
        os.rmdir(folder)


def _empty(top: int) -> None:
    """Remove everything in an open folder."""
    moved = 0
    while folders := _remove_files(top):
        for name in folders:
            with suppress(OSError):
                inner = _open_folder(name, top)
                try:
                    for deeper in _remove_files(inner):
                        _make_writable(deeper, inner)
                        os.rename(deeper, f"{os.getpid()}-{moved}", src_dir_fd=inner, dst_dir_fd=top)
                        moved += 1
                finally:
                    os.close(inner)
                os.rmdir(name, dir_fd=top)
                continue
            # It stays, and must not be met again and again.
            return


def _remove_files(folder: int) -> list[str]:
    """Remove all but the folders in an open folder, and return their names."""
    folders = []
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                folders.append(entry.name)
            else:
                with suppress(OSError):
                    os.unlink(entry.name, dir_fd=folder)
    return folders


def _open_folder(name: str, parent: int) -> int:
    _make_writable(name, parent)
    return os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=parent)


def _make_writable(name: str, parent: int) -> None:
    # A move changes the entry `..` in the folder that is moved.
    with suppress(OSError):
        os.chmod(name, stat.S_IRWXU, dir_fd=parent)
