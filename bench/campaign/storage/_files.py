"""Files written whole, and their digests."""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.documents import open_file

# Also hidden: globs for documents, and people who list the folder, do not come upon a half-written file.
_HALF_WRITTEN = ".part"


def is_half_written(path: Path) -> bool:
    """Whether a file is what `write_whole` leaves if its process is killed before the file is whole."""
    return path.name.startswith(".") and path.name.endswith(_HALF_WRITTEN)


# An NFS client's name for a file that was deleted while it was open: inode and a counter. It goes when the file is closed.
_DELETED_OVER_NFS = re.compile(r"\.nfs[0-9a-f]{24}")


def is_deleted_over_nfs(path: Path) -> bool:
    """Whether a file is one that a program on this network disk has deleted and still holds open."""
    return _DELETED_OVER_NFS.fullmatch(path.name) is not None


def write_whole(path: Path, content: bytes | str, *, synced: bool = True) -> str:
    """Write a file and return the SHA-256 of its bytes.

    After a crash the old file or the new one is there, never a part. Unless `synced`, that holds for a power cut only
    after `sync_files_below`.
    """
    data = content.encode() if isinstance(content, str) else content
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}{_HALF_WRITTEN}")
    with part.open("wb") as file:
        file.write(data)
        file.flush()
        # Before the rename: otherwise a power cut could leave the new name on a file whose bytes were never
        # written.
        if synced:
            os.fsync(file.fileno())
    part.replace(path)
    # The rename is an entry of the folder, so it survives a power cut only once the folder is synced as well.
    if synced:
        _sync_folder(path.parent)
    return hashlib.sha256(data).hexdigest()


def sync_files_below(folder: Path) -> None:
    """Let everything that was written below a folder so far survive a power cut. Raises OSError.

    For thousands of files at once: each `fsync` costs a millisecond or more, where the file system as a whole can be
    synced. Where it cannot, each file is.
    """
    with _opened(folder) as descriptor:
        # The standard library has os.sync() alone, which waits for the other file systems as well.
        if not ctypes.CDLL(None, use_errno=True).syncfs(descriptor):
            return
        code = ctypes.get_errno()
    if code not in _NOT_SUPPORTED:
        raise OSError(code, os.strerror(code), str(folder))
    for path in (*folder.rglob("*"), folder, folder.absolute().parent):
        if path.is_dir():
            _sync_folder(path)
        elif path.is_file():
            with _opened(path) as descriptor:
                os.fsync(descriptor)


# How file systems, and sandboxes that filter system calls, put that they have no such call.
_NOT_SUPPORTED = frozenset({errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP, errno.EPERM})


def _sync_folder(folder: Path) -> None:
    with _opened(folder) as descriptor:
        try:
            os.fsync(descriptor)
        except OSError as error:
            # SMB and some file systems in user space sync files alone: nothing better can be done for the entry there.
            if error.errno not in _NOT_SUPPORTED:
                raise


@contextmanager
def _opened(folder: Path) -> Iterator[int]:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def digest_of(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal. Raises SetupError for a path that is no file."""
    with open_file(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


MIN_KEPT_BYTES = 65536
"""Digests of smaller files are not kept: reading them again costs little, and a large campaign has four for each run."""
SETTLED_NS = 2_000_000_000
"""A file may change twice within one tick of its file system's clock, which is 2 s at most (FAT)."""


class FileDigests:
    """SHA-256 of files: a large one that is as it was when it was last asked for is not read again.

    Inode, size and times tell that it is; the time of the last change is the kernel's, and no program can set it.
    """

    def __init__(self, read: Callable[[Path], str] = digest_of, settled_ns: int = SETTLED_NS) -> None:
        """`read` gives the digest of a file. A file that changed within the last `settled_ns` is read again."""
        self._read, self._settled_ns = read, settled_ns
        self._kept: dict[str, tuple[int, bytes]] = {}

    def of(self, path: Path) -> str:
        """SHA-256 of a file, in hexadecimal."""
        name, status = os.fspath(path), path.stat()
        state = hash((status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns))
        known = self._kept.get(name)
        if known is not None and known[0] == state:
            return known[1].hex()
        # Before the file is read: a change that comes meanwhile is one that the times show.
        settled = time.time_ns() - status.st_ctime_ns > self._settled_ns
        digest = self._read(path)
        if settled and status.st_size >= MIN_KEPT_BYTES:
            self._kept[name] = state, bytes.fromhex(digest)
        return digest
