"""Opening the files that a user names: regular files alone, and a plain sentence for everything else."""

from __future__ import annotations

import difflib
import errno
import os
import shlex
import stat
from io import BufferedReader
from pathlib import Path

from ..errors import Fault, SetupError

MAX_BYTES = 16 * 1024 * 1024
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def open_file(path: Path, field: str = "") -> BufferedReader:
    """A regular file, opened for reading.

    A pipe may wait for ever, and a device may never end. Raises SetupError for them and for a file that is missing or
    cannot be opened; it names the path, and the field of the document that states it where one is given.
    """
    try:
        # Waits for no other end of a pipe, and becomes no terminal's process. Files know no waiting.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        raise SetupError(_fault(path, field, *_reason(path, error))) from None
    kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
    if kind != stat.S_IFREG:
        os.close(descriptor)
        raise SetupError(_no_file(path, field, kind))
    return os.fdopen(descriptor, "rb")


def read_bytes(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """The content of a regular file; SetupError as `open_file`, and for more than `max_bytes`."""
    with open_file(path) as file:
        # What is read counts, not the size that the file states: that of files in /proc is 0.
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise SetupError(_fault(path, "", f"the file is larger than {max_bytes} bytes", "split it"))
    return content


def read_text(path: Path, max_bytes: int = MAX_BYTES) -> str:
    """The text of a regular file, with line ends as newlines; SetupError as `read_bytes`, and when it is not UTF-8."""
    content = read_bytes(path, max_bytes)
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        what = f"cannot be read: 0x{content[error.start]:02x} is no character of UTF-8"
        raise SetupError(f"{path}:{line}", what, "save it as UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def similar_files(path: Path) -> str:
    """A hint naming files that look like the one that is missing."""
    try:
        if not path.parent.is_dir():
            return f"the folder {path.parent} does not exist"
        names = os.listdir(path.parent)
    except (OSError, ValueError):
        names = []
    close = difflib.get_close_matches(path.name, names, n=3)
    return f"did you mean {', '.join(close)}?" if close else "check the name"


def _fault(path: Path, field: str, what: str, remedy: str) -> Fault:
    return Fault(field, f"{path}: {what}", remedy) if field else Fault(str(path), what, remedy)


def _no_file(path: Path, field: str, kind: int) -> Fault:
    what = f"cannot be read: it is {_KINDS.get(kind, 'no regular file')}"
    if kind == stat.S_IFDIR:
        return _fault(path, field, what, "name a file in it")
    return _fault(path, field, what, "write what it gives into a file, and name that")


def _reason(path: Path, error: OSError | ValueError) -> tuple[str, str]:
    """Why a path cannot be opened, and the remedy."""
    if not isinstance(error, OSError):
        return f"cannot be read: {error}", "correct the path"
    match error.errno:
        case errno.ENOENT if path.is_symlink():
            target = os.readlink(path)
            return f"cannot be read: it is a link to {target}, which does not exist", "restore that"
        case errno.ENOENT:
            return "there is no such file", similar_files(path)
        case errno.ENOTDIR:
            return "there is no such file: a part of its path is no folder", "check the name"
        case errno.ELOOP:
            return "cannot be read: it is a link that leads back to itself", "name the file itself"
        case errno.ENXIO:
            return "cannot be read: it is a socket", "write what it gives into a file, and name that"
        case errno.EACCES | errno.EPERM:
            return "cannot be read: you have no permission", f"chmod u+r {shlex.quote(str(path))}"
        case _:
            return f"cannot be read: {error.strerror}", "name another file"
