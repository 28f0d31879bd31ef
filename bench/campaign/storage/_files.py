"""Files written whole, and their digests."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

# Also hidden: globs for documents, and people who list the folder, do not come upon a half-written file.
_HALF_WRITTEN = ".part"


def is_half_written(path: Path) -> bool:
    """Whether a file is what `write_whole` leaves if its process is killed before the file is whole."""
    return path.name.startswith(".") and path.name.endswith(_HALF_WRITTEN)


def write_whole(path: Path, content: bytes | str) -> str:
    """Write a file and return the SHA-256 of its bytes.

    After a crash the old file or the new one is there, never a part.
    """
    data = content.encode() if isinstance(content, str) else content
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}{_HALF_WRITTEN}")
    with part.open("wb") as file:
        file.write(data)
        file.flush()
        # Before the rename: otherwise a power cut could leave the new name on a file whose bytes were never
        # written.
        os.fsync(file.fileno())
    part.replace(path)
    # The rename is an entry of the folder, so it survives a power cut only once the folder is synced as well.
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
    return hashlib.sha256(data).hexdigest()


def digest_of(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
