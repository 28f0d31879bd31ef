"""Tricks that use up the host: so slow or full that a session ends in a way that does not count."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ._cheat import Cheat

MEMORY_MB, PROCESSES, SCRATCH_MB = 512, 64, 16
"""The limits in the cheats' manifest. Where a limit does not hold, a trick stops at `_EXCESS` times of it."""

_EXCESS = 2
_BLOCK_MB = 4
_FORK_LIFE_S = 20.0
_WATCH_S = 3.0
_OUTPUT_LINES = 200_000
_LINE = "x" * 63


def fork_bomb(cheat: Cheat) -> Iterator[None]:
    """Starts processes until the kernel refuses.

    A host without free process numbers starts no worker.
    """
    started: list[int] = []
    with suppress(OSError):
        while len(started) < _EXCESS * PROCESSES:
            number = os.fork()
            if number == 0:
                time.sleep(_FORK_LIFE_S)
                os._exit(0)
            started.append(number)
    cheat.attempts = len(started)
    cheat.gains = {"beyond_limit": max(0, len(started) - PROCESSES)}
    # A second of simulated time with all of them; then half are ended, and half are left to the bench.
    for _ in range(10):
        yield
    for number in started[::2]:
        os.kill(number, signal.SIGKILL)


def hog_memory(cheat: Cheat) -> Iterator[None]:
    """Takes memory until the kernel refuses.

    A host that runs out of memory kills some process, perhaps the bench's, and such a session does not count.
    """
    blocks: list[bytes] = []
    with suppress(MemoryError):
        while len(blocks) * 32 < _EXCESS * MEMORY_MB:
            # Written, not only reserved.
            blocks.append(b"\1" * (32 << 20))
    cheat.attempts = len(blocks)
    cheat.gains = {"beyond_limit_mb": max(0, len(blocks) * 32 - MEMORY_MB)}
    yield


def fill_disk(cheat: Cheat) -> Iterator[None]:
    """Writes to its scratch folder until the disk is full.

    A bench that cannot write its recording has no result.
    """
    yield from _fill(cheat, Path(os.environ["HOME"]))


def fill_shared_memory(cheat: Cheat) -> Iterator[None]:
    """Writes to /dev/shm, which is the host's memory, until it is full."""
    yield from _fill(cheat, Path("/dev/shm"))


def flood_output(cheat: Cheat) -> Iterator[None]:
    """Prints some 13 MB in one tick.

    A log without a limit fills the disk; a bench that waits for its reader is late.
    """
    cheat.attempts = _OUTPUT_LINES
    for _ in range(_OUTPUT_LINES // 1000):
        sys.stdout.write(f"{_LINE}\n" * 1000)
    yield


def dawdle(cheat: Cheat) -> Iterator[None]:
    """Answers a tick so late that the session runs out of the host's time.

    Sessions that the host was too slow for do not count: a bad run would disappear.
    """
    cheat.attempts = 1
    time.sleep(600.0)
    yield


def _fill(cheat: Cheat, folder: Path) -> Iterator[None]:
    """Write blocks, each a file: a limit on the size of a file is not the one that is tried."""
    paths: list[Path] = []
    with suppress(OSError):
        while len(paths) * _BLOCK_MB < _EXCESS * SCRATCH_MB:
            path = folder / f"{cheat.marker}-{len(paths)}"
            path.write_bytes(bytes(_BLOCK_MB << 20))
            paths.append(path)
    cheat.attempts = len(paths) + 1
    excess_mb = max(0, len(paths) * _BLOCK_MB - SCRATCH_MB)
    cheat.gains = {"beyond_limit_mb": excess_mb}
    if excess_mb:
        # A quota may be held by a watch; whoever goes on at once shows only that it looks now and then.
        time.sleep(_WATCH_S)
    yield
