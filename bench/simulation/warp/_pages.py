"""The two files that the bench shares with the library in an agent; `preload.c` has the same layout."""

from __future__ import annotations

import ctypes
import mmap
import os
import platform
import struct
import sys
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from bench.contracts import Outcome

from .._stop_session import StopSession

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
# Places of 64-bit numbers in the clock's file, and of bytes in the other one.
_NOW, _RELEASED = 2, 4
_SLOTS_USED, _OVERFLOWED = 16, 20
_FIRST_PROCESS = 24
_FIRST_SLOT = _FIRST_PROCESS + MAX_PROCESSES * _PROCESS.itemsize
_HEAD = struct.pack("=QQ", MAGIC, VERSION)
_FREE_SLOT, _NOBODY = bytes(_SLOT.itemsize), bytes(4)
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
    """The agent's clock, which this side alone sets, and what the agent waits for.

    The agent can write the other page, and shorten its file: this side reads it as a file, because in memory it would be
    ended by SIGBUS. All that reads raises StopSession where the page is shorter than it was made, or its head another.
    """

    def __init__(self, clock: mmap.mmap, waiters_fd: int) -> None:
        # Whole numbers at their own alignment are moved by one instruction each: no half of one is ever seen.
        self._clock = memoryview(clock).cast("q")
        self._waiters_fd = waiters_fd
        # For its address alone, by which sleepers are woken: never read or written.
        self._mapped = mmap.mmap(waiters_fd, _WAITERS.itemsize)
        self._address = np.frombuffer(self._mapped, np.uint8).ctypes.data
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
        with suppress(StopSession):
            self._wake(self.entered())

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
        if any(0 < deadline_ns <= now_ns for deadline_ns in deadlines_ns):
            self._wake({waiter.pid for waiter in self.waiters() if waiter.deadline_ns <= now_ns})

    def waiters(self) -> list[Waiter]:
        """Everything that waits, by its place in the page."""
        return [
            Waiter(pid, tid, deadline_ns)
            for deadline_ns, pid, tid, *_ in np.frombuffer(self._slots(), _SLOT).tolist()
            if deadline_ns > 0
        ]

    def entered(self) -> set[int]:
        """The processes in which the library has started, as the agent numbers them."""
        return {pid for pid, _ in self._processes() if pid > 0}

    def forget(self, ended: Collection[int]) -> None:
        """Free what ended processes have left: a wait of theirs would stop time for good."""
        for index, pid in enumerate(np.frombuffer(self._slots(), _SLOT)["pid"].tolist()):
            if pid in ended:
                os.pwrite(self._waiters_fd, _FREE_SLOT, _FIRST_SLOT + index * _SLOT.itemsize)
        for index, (pid, _) in enumerate(self._processes()):
            if pid in ended:
                os.pwrite(self._waiters_fd, _NOBODY, _FIRST_PROCESS + index * _PROCESS.itemsize)

    @property
    def overflowed(self) -> bool:
        """Whether the agent had more processes or waits at once than the page holds, so that time must not go on."""
        return self._read(_OVERFLOWED, 4) != bytes(4)

    def close(self) -> None:
        """Let go of the agent's page."""
        os.close(self._waiters_fd)

    def _deadlines_ns(self) -> list[int]:
        """Of each slot that was ever used; 0 in those that are free."""
        return memoryview(self._slots()).cast("q")[:: _SLOT.itemsize // 8].tolist()

    def _slots(self) -> bytes:
        """The slots that were ever used."""
        head = self._read(0, _FIRST_PROCESS)
        used = int.from_bytes(head[_SLOTS_USED:_OVERFLOWED], sys.byteorder)
        if not head.startswith(_HEAD) or used > MAX_SLOTS:
            raise _spoiled()
        return self._read(_FIRST_SLOT, used * _SLOT.itemsize)

    def _processes(self) -> list[tuple[int, int]]:
        """The id of the process in each entry, 0 for none, and how often it was woken."""
        page = self._read(_FIRST_PROCESS, MAX_PROCESSES * _PROCESS.itemsize)
        processes: list[tuple[int, int]] = np.frombuffer(page, _PROCESS).tolist()
        return processes

    def _read(self, offset: int, size: int) -> bytes:
        data = os.pread(self._waiters_fd, size, offset)
        if len(data) < size:
            raise _spoiled()
        return data

    def _wake(self, pids: Collection[int]) -> None:
        for index, (pid, wake) in enumerate(self._processes()):
            if pid and pid in pids:
                futex = _FIRST_PROCESS + index * _PROCESS.itemsize + _WAKE_OFFSET
                os.pwrite(self._waiters_fd, ((wake + 1) & _WORD).to_bytes(4, sys.byteorder), futex)
                # Where the page is gone the kernel refuses the address, and nobody is woken.
                _system_call()(self._futex, self._address + futex, _FUTEX_WAKE, 2**31 - 1, None, None, 0)


def _spoiled() -> StopSession:
    reason = "the agent has overwritten the file REBAR_WARP_WAITERS, which only the library in it may write (docs/time.md)"
    return StopSession(Outcome.AGENT_PROTOCOL, reason)


def make_pages(clock: Path, waiters: Path, utc_ns: int) -> WarpPages:
    """Make the two files. The agent's wall clock starts at `utc_ns` since 1970."""
    clock_fd = _new_file(clock, _CLOCK.itemsize, 0o444)
    try:
        clock_page = mmap.mmap(clock_fd, _CLOCK.itemsize)
    finally:
        os.close(clock_fd)
    clock_page[:40] = _HEAD + struct.pack("=qqq", START_NS, utc_ns - START_NS, 0)
    # The agent may be another user to the kernel.
    waiters_fd = _new_file(waiters, _WAITERS.itemsize, 0o666)
    os.pwrite(waiters_fd, _HEAD, 0)
    return WarpPages(clock_page, waiters_fd)


def _new_file(path: Path, size: int, mode: int) -> int:
    """A descriptor of a new file of zeros."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    os.fchmod(descriptor, mode)
    os.ftruncate(descriptor, size)
    return descriptor


@cache
def _system_call() -> Callable[..., int]:
    call = ctypes.CDLL(None).syscall
    # With its types it takes plain numbers, which costs a third of objects made for each call.
    call.argtypes = (
        *(ctypes.c_long, ctypes.c_void_p, ctypes.c_int, ctypes.c_int),
        *(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int),
    )
    return call
