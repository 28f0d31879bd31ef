"""The two files that the bench shares with the library in an agent; `preload.c` has the same layout."""

from __future__ import annotations

import ctypes
import mmap
import os
import platform
import struct
import time
from collections.abc import Callable, Collection
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
# Places of whole numbers: of 64 bits in the clock's file and among the slots, of 32 bits at the head of the other file.
_NOW, _RELEASED = 2, 4
_SLOTS_USED, _OVERFLOWED = 4, 5
_FIRST_SLOT = (24 + MAX_PROCESSES * _PROCESS.itemsize) // 8
_SLOT_NUMBERS = _SLOT.itemsize // 8
# Counted in 32 bits: ids of processes, each followed by its futex; and of a slot's process, behind its deadline.
_FIRST_PID, _PROCESS_HEADS = 24 // 4, _PROCESS.itemsize // 4
_LAST_PID = _FIRST_PID + MAX_PROCESSES * _PROCESS_HEADS
_FIRST_OWNER, _SLOT_HEADS = _FIRST_SLOT * 2 + 2, _SLOT.itemsize // 4
_WORD = 0xFFFFFFFF
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
        # Whole numbers at their own alignment are moved by one instruction each: no half of one is ever seen.
        self._clock = memoryview(clock).cast("q")
        self._numbers = memoryview(waiters).cast("q")
        self._heads = memoryview(waiters).cast("I")
        page = np.frombuffer(waiters, dtype=_WAITERS, count=1)[0]
        self._slots = page["slots"]
        self._processes = page["processes"]
        self._pids: NDArray[np.int32] = self._processes["pid"]
        self._owners: NDArray[np.int32] = self._slots["pid"]
        self._first_futex = self._processes.ctypes.data + _WAKE_OFFSET
        self._futex = _FUTEX[platform.machine()]

    @property
    def now_ns(self) -> int:
        """The agent's monotonic clock."""
        return self._clock[_NOW]

    def set_now(self, now_ns: int) -> None:
        """Set the clock, and wake each process that waits for a moment that has come."""
        self._clock[_NOW] = now_ns
        self.wake_due()

    def release(self) -> None:
        """Let time pass by itself from now on, as fast as the host's: the session is over."""
        self._clock[_RELEASED] = time.monotonic_ns()
        self._wake(set(self._pids[self._pids > 0].tolist()))

    def earliest_ns(self) -> int | None:
        """The first moment for which a thread or a timer of the agent waits; None while nothing waits for one."""
        return min(filter(None, self._deadlines_ns()), default=None)

    def is_due(self) -> bool:
        """Whether something waits for a moment that has come."""
        earliest_ns = self.earliest_ns()
        return earliest_ns is not None and earliest_ns <= self.now_ns

    def wake_due(self) -> None:
        """Wake each process in which something is due."""
        # Of a dozen slots: calls of numpy on all of them cost four times as much.
        now_ns, deadlines_ns = self._clock[_NOW], self._deadlines_ns()
        due = [slot for slot, deadline_ns in enumerate(deadlines_ns) if 0 < deadline_ns <= now_ns]
        if due:
            self._wake({self._heads[_FIRST_OWNER + slot * _SLOT_HEADS] for slot in due})

    def waiters(self) -> list[Waiter]:
        """Everything that waits, by its place in the page."""
        slots = self._slots[: self._heads[_SLOTS_USED]]
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
            slots = self._owners == pid
            self._slots["deadline_ns"][slots] = 0
            self._slots["state"][slots] = 0
            self._owners[slots] = 0
            self._pids[self._pids == pid] = 0

    @property
    def overflowed(self) -> bool:
        """Whether the agent had more processes or waits at once than the page holds, so that time must not go on."""
        return bool(self._heads[_OVERFLOWED])

    def _deadlines_ns(self) -> list[int]:
        """Of each slot that was ever used; 0 in those that are free."""
        end = _FIRST_SLOT + self._heads[_SLOTS_USED] * _SLOT_NUMBERS
        return self._numbers[_FIRST_SLOT:end:_SLOT_NUMBERS].tolist()

    def _wake(self, pids: Collection[int]) -> None:
        for index, pid in enumerate(self._heads[_FIRST_PID:_LAST_PID:_PROCESS_HEADS].tolist()):
            if pid and pid in pids:
                futex = _FIRST_PID + index * _PROCESS_HEADS + 1
                self._heads[futex] = (self._heads[futex] + 1) & _WORD
                address = self._first_futex + index * _PROCESS.itemsize
                _system_call()(self._futex, address, _FUTEX_WAKE, 2**31 - 1, None, None, 0)


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
def _system_call() -> Callable[..., int]:
    call = ctypes.CDLL(None).syscall
    # With its types it takes plain numbers, which costs a third of objects made for each call.
    call.argtypes = (
        *(ctypes.c_long, ctypes.c_void_p, ctypes.c_int, ctypes.c_int),
        *(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int),
    )
    return call
