"""The two files that the bench shares with the library in an agent; `preload.c` has the same layout."""

from __future__ import annotations

import ctypes
import mmap
import os
import platform
import struct
import time
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MAGIC, VERSION = 0x5041575241424552, 1
MAX_PROCESSES, MAX_SLOTS = 256, 4096
_CLOCK = np.dtype(
    [
        ("magic", "u8"),
        ("version", "u8"),
        ("now_ns", "i8"),
        ("wall_offset_ns", "i8"),
        ("released_ns", "i8"),
    ]
)
_PROCESS = np.dtype([("pid", "i4"), ("wake", "u4")])
_SLOT = np.dtype([("deadline_ns", "i8"), ("pid", "i4"), ("tid", "i4"), ("state", "u4"), ("kind", "u4")])
_WAITERS = np.dtype(
    [
        ("magic", "u8"),
        ("version", "u8"),
        ("slots_used", "u4"),
        ("overflowed", "u4"),
        ("processes", _PROCESS, (MAX_PROCESSES,)),
        ("slots", _SLOT, (MAX_SLOTS,)),
    ]
)
_FUTEX = {"x86_64": 202, "aarch64": 98}
_FUTEX_WAKE = 1
_WAKE_OFFSET = 4
# The agent's monotonic clock at the start of a session. Not 0, which programs take for "never"; the value is chosen.
START_NS = 1000 * 10**9


@dataclass(frozen=True, slots=True)
class Waiter:
    """One wait of the agent's: process and thread as the agent numbers them, and until when, by its monotonic clock."""

    pid: int
    tid: int
    deadline_ns: int


class WarpPages:
    """The agent's clock, which this side alone sets, and what the agent waits for."""

    def __init__(self, clock: mmap.mmap, waiters: mmap.mmap) -> None:
        # Whole numbers of eight bytes at their own alignment: numpy moves each in one instruction.
        self._clock = np.frombuffer(clock, dtype="i8", count=_CLOCK.itemsize // 8)
        page = np.frombuffer(waiters, dtype=_WAITERS, count=1)[0]
        self._page = page
        self._processes = page["processes"]
        self._pids = self._processes["pid"]
        self._deadlines: NDArray[np.int64] = page["slots"]["deadline_ns"]
        self._owners = page["slots"]["pid"]
        self._wake_address = self._processes.ctypes.data + _WAKE_OFFSET
        self._futex = _FUTEX[platform.machine()]

    @property
    def now_ns(self) -> int:
        """The agent's monotonic clock."""
        return int(self._clock[2])

    def set_now(self, now_ns: int) -> None:
        """Set the clock, and wake each process that waits for a moment that has come."""
        self._clock[2] = now_ns
        self.wake_due()

    def release(self) -> None:
        """Let time pass by itself from now on, as fast as the host's: the session is over."""
        self._clock[4] = time.monotonic_ns()
        self._wake(set(self._pids[self._pids > 0].tolist()))

    def earliest_ns(self) -> int | None:
        """The first moment for which a thread or a timer of the agent waits; None while nothing waits for one."""
        deadlines = self._deadlines[: int(self._page["slots_used"])]
        waited = deadlines[deadlines > 0]
        return int(waited.min()) if waited.size else None

    def is_due(self) -> bool:
        """Whether something waits for a moment that has come."""
        earliest_ns = self.earliest_ns()
        return earliest_ns is not None and earliest_ns <= self.now_ns

    def wake_due(self) -> None:
        """Wake each process in which something is due."""
        used = int(self._page["slots_used"])
        deadlines = self._deadlines[:used]
        due = (deadlines > 0) & (deadlines <= self.now_ns)
        if due.any():
            self._wake(set(self._owners[:used][due].tolist()))

    def waiters(self) -> list[Waiter]:
        """Everything that waits, by its place in the page."""
        slots = self._page["slots"][: int(self._page["slots_used"])]
        return [
            Waiter(int(slot["pid"]), int(slot["tid"]), int(slot["deadline_ns"]))
            for slot in slots
            if slot["deadline_ns"] > 0
        ]

    def entered(self) -> set[int]:
        """The processes in which the library has started, as the agent numbers them."""
        return set(self._pids[self._pids > 0].tolist())

    def forget(self, ended: Collection[int]) -> None:
        """Free what ended processes have left: a wait of theirs would stop time for good."""
        for pid in ended:
            left = self._owners == pid
            self._deadlines[left] = 0
            self._page["slots"]["state"][left] = 0
            self._owners[left] = 0
            self._pids[self._pids == pid] = 0

    @property
    def overflowed(self) -> bool:
        """Whether the agent had more processes or waits at once than the page holds, so that time must not go on."""
        return bool(self._page["overflowed"])

    def _wake(self, pids: set[int]) -> None:
        for index in np.flatnonzero(self._pids):
            if int(self._pids[index]) in pids:
                self._processes["wake"][index] += np.uint32(1)
                address = ctypes.c_void_p(self._wake_address + int(index) * _PROCESS.itemsize)
                _libc().syscall(self._futex, address, _FUTEX_WAKE, 2**31 - 1, None, None, 0)


def make_pages(clock: Path, waiters: Path, utc_ns: int) -> WarpPages:
    """Make the two files. The agent's wall clock starts at `utc_ns` since 1970."""
    head = struct.pack("=QQ", MAGIC, VERSION)
    clock_page = _mapped(clock, _CLOCK.itemsize, 0o444)
    clock_page[:40] = head + struct.pack("=qqq", START_NS, utc_ns - START_NS, 0)
    # The agent may be another user to the kernel.
    waiters_page = _mapped(waiters, _WAITERS.itemsize, 0o666)
    waiters_page[:16] = head
    return WarpPages(clock_page, waiters_page)


def _mapped(path: Path, size: int, mode: int) -> mmap.mmap:
    """A new file of zeros in memory, which is given back when nobody holds it any more."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    try:
        os.fchmod(descriptor, mode)
        os.ftruncate(descriptor, size)
        return mmap.mmap(descriptor, size)
    finally:
        os.close(descriptor)


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None)
