"""Files behind MAVLink FTP: those that the vehicle serves, and a client's own in memory."""

from __future__ import annotations

import errno
from collections.abc import Callable, Mapping

FileContent = Callable[[str], bytes]
"""Gives a file's bytes; its argument is the part of the path behind a question mark."""

# Of the scratch area.
_MAX_BYTES = 1 << 20
_MAX_NAMES = 256


class ServedFiles:
    """Files by path from the root, with or without a leading slash. Folders are those in paths of files, and
    those that were made.

    A path that begins with `memory_card` means the same without it.

    Every method that changes something raises OSError with a POSIX number: EACCES for a served file, ENOSPC
    when the scratch area is full, EROFS where there is none.
    """

    def __init__(
        self,
        contents: Mapping[str, FileContent],
        writable: bool = False,
        folders: tuple[str, ...] = (),
        memory_card: str = "",
    ) -> None:
        self._contents = contents
        self._memory_card = f"{memory_card}/" if memory_card else ""
        self._writable = writable
        self._scratch: dict[str, bytearray] = {}
        self._folders: set[str] = set(folders)

    def read(self, path: str) -> bytes | None:
        """A file's bytes, or None when there is none."""
        name, _, query = self._name(path).partition("?")
        if name in self._scratch:
            return bytes(self._scratch[name])
        content = self._contents.get(name)
        return content(query) if content else None

    def entries(self, path: str) -> list[str] | None:
        """A folder as the protocol lists it, sorted (F name, tab, size; D name); None without it."""
        folder = self._name(path)
        if not self._is_folder(folder):
            return None
        prefix = f"{folder}/" if folder else ""
        entries: dict[str, str] = {}
        for name in (*self._contents, *self._scratch, *self._folders):
            if not name.startswith(prefix) or name == folder:
                continue
            head, slash, _ = name[len(prefix) :].partition("/")
            if slash or name in self._folders:
                entries[head] = f"D{head}"
            else:
                entries[head] = f"F{head}\t{len(self.read(name) or b'')}"
        return [entries[head] for head in sorted(entries)]

    def create(self, path: str, truncate: bool = True) -> int:
        """Open a file for writing, creating it where it does not exist. Returns the size that it had."""
        name = self._writable_name(path)
        if self._is_folder(name):
            raise OSError(errno.EISDIR, path)
        self._needs_parent(name)
        if name not in self._scratch:
            self._needs_room(names=1)
        content = self._scratch.setdefault(name, bytearray())
        size = len(content)
        if truncate:
            content.clear()
        return size

    def write(self, path: str, offset: int, data: bytes) -> int:
        """Write, with zeros between the end and `offset`. Returns how many bytes were written."""
        content = self._existing(path)
        end = offset + len(data)
        self._needs_room(end - len(content))
        if len(content) < offset:
            content.extend(bytes(offset - len(content)))
        content[offset:end] = data
        return len(data)

    def truncate(self, path: str, size: int) -> None:
        content = self._existing(path)
        self._needs_room(size - len(content))
        content.extend(bytes(max(size - len(content), 0)))
        del content[size:]

    def remove(self, path: str) -> None:
        self._existing(path)
        del self._scratch[self._writable_name(path)]

    def rename(self, path: str, to: str) -> None:
        """Rename a file, or a folder with its contents; a file of the new name is replaced."""
        old, new = self._writable_name(path), self._writable_name(to)
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
        name = self._writable_name(path)
        if name in self._scratch or self._is_folder(name):
            raise OSError(errno.EEXIST, path)
        self._needs_parent(name)
        self._needs_room(names=1)
        self._folders.add(name)

    def remove_folder(self, path: str) -> None:
        name = self._writable_name(path)
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
        prefix = f"{old}/"

        def moved(name: str) -> str:
            return new + name[len(old) :] if name == old or name.startswith(prefix) else name

        self._folders = {moved(name) for name in self._folders}
        self._scratch = {moved(name): content for name, content in self._scratch.items()}

    def _writable_name(self, path: str) -> str:
        """The name of a file or folder that a client may change."""
        name = self._name(path)
        if not self._writable:
            raise OSError(errno.EROFS, path)
        if (
            not name
            or name in self._contents
            or any(served.startswith(f"{name}/") for served in self._contents)
        ):
            raise OSError(errno.EACCES, path)
        # A path must not leave the root, though there is nothing behind it but memory.
        if ".." in name.split("/"):
            raise OSError(errno.EACCES, path)
        return name

    def _existing(self, path: str) -> bytearray:
        content = self._scratch.get(self._writable_name(path))
        if content is None:
            raise OSError(
                errno.EISDIR if self._is_folder(self._name(path)) else self._missing(self._name(path)), path
            )
        return content

    def _name(self, path: str) -> str:
        """A path from the root without a leading slash."""
        return f"{_plain(path)}/".removeprefix(self._memory_card).strip("/")

    def _is_folder(self, name: str) -> bool:
        return (
            not name
            or name in self._folders
            or any(served.startswith(f"{name}/") for served in self._contents)
        )

    def _needs_parent(self, name: str) -> None:
        folder = name.rpartition("/")[0]
        if not self._is_folder(folder):
            raise OSError(self._missing(folder), name)

    def _missing(self, name: str) -> int:
        """The number for a name that does not exist: ENOTDIR where a parent is a file."""
        parts = name.split("/")
        parents = ("/".join(parts[:count]) for count in range(1, len(parts) + 1))
        return errno.ENOTDIR if any(parent in self._scratch for parent in parents) else errno.ENOENT

    def _needs_room(self, size: int = 0, names: int = 0) -> None:
        used = sum(len(content) for content in self._scratch.values())
        full = size > 0 and used + size > _MAX_BYTES
        if full or len(self._scratch) + len(self._folders) + names > _MAX_NAMES:
            raise OSError(errno.ENOSPC, "")


def _plain(path: str) -> str:
    return path.strip().removeprefix("./").strip("/") if path.strip() != "." else ""
