"""Files behind MAVLink FTP: those that are served, made when first asked for, and a scratch area in memory for a client's own."""

from __future__ import annotations

import errno
from collections.abc import Callable, Mapping

Content = Callable[[str], bytes]
"""Gives a file's bytes; its argument is what stood behind a question mark in the path."""

_MOST_BYTES = 1 << 20  # of the scratch area
_MOST_NAMES = 256


class Files:
    """Paths are relative to the root, with or without a slash before them; folders are what paths imply, and what was made.

    Whatever changes something raises OSError with a POSIX number: EACCES for what is served, ENOSPC when the scratch area
    is full, EROFS where there is none.
    """

    def __init__(self, contents: Mapping[str, Content], writable: bool = False) -> None:
        self._contents = dict(contents)
        self._writable = writable
        self._scratch: dict[str, bytearray] = {}
        self._folders: set[str] = set()

    def read(self, path: str) -> bytes | None:
        """A file's bytes, or None when there is none."""
        name, _, query = _plain(path).partition("?")
        if name in self._scratch:
            return bytes(self._scratch[name])
        content = self._contents.get(name)
        return content(query) if content else None

    def entries(self, path: str) -> list[str] | None:
        """What a folder holds, as the protocol writes it (F name, tab, size; D name), in order; None for no folder."""
        folder = _plain(path)
        if not self._is_folder(folder):
            return None
        prefix = f"{folder}/" if folder else ""
        found: dict[str, str] = {}
        for name in (*self._contents, *self._scratch, *self._folders):
            if not name.startswith(prefix) or name == folder:
                continue
            head, slash, _ = name[len(prefix) :].partition("/")
            if slash or name in self._folders:
                found[head] = f"D{head}"
            else:
                found[head] = f"F{head}\t{len(self.read(name) or b'')}"
        return [found[head] for head in sorted(found)]

    def create(self, path: str, keeps: bool = False) -> int:
        """Open a file for writing, new or emptied; `keeps` leaves in it what it has. The size that it had."""
        name = self._own(path)
        if self._is_folder(name):
            raise OSError(errno.EISDIR, path)
        self._needs_parent(name)
        if name not in self._scratch:
            self._needs_room(names=1)
        held = self._scratch.setdefault(name, bytearray())
        size = len(held)
        if not keeps:
            held.clear()
        return size

    def write(self, path: str, offset: int, data: bytes) -> int:
        """Bytes written; what lies between the end and `offset` becomes zeros."""
        held = self._existing(path)
        end = offset + len(data)
        self._needs_room(end - len(held))
        if len(held) < offset:
            held.extend(bytes(offset - len(held)))
        held[offset:end] = data
        return len(data)

    def truncate(self, path: str, size: int) -> None:
        held = self._existing(path)
        self._needs_room(size - len(held))
        held.extend(bytes(max(size - len(held), 0)))
        del held[size:]

    def remove(self, path: str) -> None:
        self._existing(path)
        del self._scratch[self._own(path)]

    def rename(self, path: str, to: str) -> None:
        """A file, or a folder with what is in it; a file that stands there already gives way."""
        old, new = self._own(path), self._own(to)
        self._needs_parent(old)
        self._needs_parent(new)
        if old not in self._scratch and old not in self._folders:
            raise OSError(errno.ENOENT, path)
        if old.startswith(f"{new}/"):
            raise OSError(errno.ENOTEMPTY, to)
        if old in self._scratch:
            if self._is_folder(new):
                raise OSError(errno.EISDIR, to)
            self._scratch[new] = self._scratch.pop(old)
        else:
            self._move(old, new)

    def make_folder(self, path: str) -> None:
        name = self._own(path)
        if name in self._scratch or self._is_folder(name):
            raise OSError(errno.EEXIST, path)
        self._needs_parent(name)
        self._needs_room(names=1)
        self._folders.add(name)

    def remove_folder(self, path: str) -> None:
        name = self._own(path)
        if name not in self._folders:
            raise OSError(self._missing(name), path)
        if self.entries(path):
            raise OSError(errno.ENOTEMPTY, path)
        self._folders.remove(name)

    def _move(self, old: str, new: str) -> None:
        if new == old:
            return
        if new.startswith(f"{old}/"):
            raise OSError(errno.EINVAL, new)
        if new in self._scratch:
            raise OSError(errno.ENOTDIR, new)
        if self.entries(new):
            raise OSError(errno.ENOTEMPTY, new)
        self._folders.discard(new)
        inside = f"{old}/"
        self._folders = {new + one[len(old) :] if one == old or one.startswith(inside) else one for one in self._folders}
        self._scratch = {new + one[len(old) :] if one.startswith(inside) else one: held for one, held in self._scratch.items()}

    def _own(self, path: str) -> str:
        """The plain name of what a client may change."""
        name = _plain(path)
        if not self._writable:
            raise OSError(errno.EROFS, path)
        if not name or name in self._contents or any(one.startswith(f"{name}/") for one in self._contents):
            raise OSError(errno.EACCES, path)
        if ".." in name.split("/"):
            raise OSError(errno.EACCES, path)
        return name

    def _existing(self, path: str) -> bytearray:
        held = self._scratch.get(self._own(path))
        if held is None:
            raise OSError(errno.EISDIR if self._is_folder(_plain(path)) else self._missing(_plain(path)), path)
        return held

    def _is_folder(self, name: str) -> bool:
        return not name or name in self._folders or any(one.startswith(f"{name}/") for one in self._contents)

    def _needs_parent(self, name: str) -> None:
        folder = name.rpartition("/")[0]
        if not self._is_folder(folder):
            raise OSError(self._missing(folder), name)

    def _missing(self, name: str) -> int:
        """ENOTDIR where something on the way is a file."""
        above = name.split("/")
        ways = ("/".join(above[:count]) for count in range(1, len(above) + 1))
        return errno.ENOTDIR if any(one in self._scratch for one in ways) else errno.ENOENT

    def _needs_room(self, size: int = 0, names: int = 0) -> None:
        held = sum(len(one) for one in self._scratch.values())
        full = size > 0 and held + size > _MOST_BYTES
        if full or len(self._scratch) + len(self._folders) + names > _MOST_NAMES:
            raise OSError(errno.ENOSPC, "")


def _plain(path: str) -> str:
    return path.strip().removeprefix("./").strip("/") if path.strip() != "." else ""
