"""Digests of files that are kept, and a heap that the collector leaves alone."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest

from bench.campaign.results._finish import frozen_heap
from bench.campaign.storage._files import MIN_KEPT_BYTES, FileDigests, digest_of, write_whole


def test_only_large_files_that_changed_are_read_again(tmp_path: Path) -> None:
    """Changed in place or replaced, by the same number of bytes, a file has its new digest."""
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


def test_a_file_that_has_just_changed_is_read_again(tmp_path: Path) -> None:
    """Its times would not show another change within the same tick."""
    reads: list[Path] = []

    def read(path: Path) -> str:
        reads.append(path)
        return digest_of(path)

    digests = FileDigests(read, settled_ns=10**18)
    write_whole(tmp_path / "large", b"a" * MIN_KEPT_BYTES)

    assert digests.of(tmp_path / "large") == digests.of(tmp_path / "large")
    assert len(reads) == 2


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
