"""The host's monotonic clock as a value, so that budgets can be tested without waiting for them."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path


def _no_delay() -> float:
    return 0.0


@dataclass(frozen=True, slots=True)
class HostClock:
    """Host seconds, for budgets and for the realtime pace alone: they never become simulated time.

    `thread_starved` is how long the calling thread has been ready to run without a core so far, and
    `others_starved` the same summed over the other threads of this process, which carry the air network.
    """

    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    thread_starved: Callable[[], float] = _no_delay
    others_starved: Callable[[], float] = _no_delay


class _Schedstat:
    """The scheduler's statistics of the thread that makes it, kept open: opening takes two thirds of a reading."""

    def __init__(self) -> None:
        self.process = os.getpid()
        self._fd = os.open(f"/proc/self/task/{threading.get_native_id()}/schedstat", os.O_RDONLY)

    def __del__(self) -> None:
        with suppress(AttributeError, OSError):
            os.close(self._fd)

    def read(self) -> bytes:
        return os.pread(self._fd, 100, 0)


class _OwnSchedstat(threading.local):
    """That of the calling thread, which every round of a session reads three times."""

    schedstat: _Schedstat | None = None

    def read(self) -> bytes:
        """Its text. Raises OSError where the system does not tell."""
        # A forked process has another thread under the same object.
        if self.schedstat is None or self.schedstat.process != os.getpid():
            self.schedstat = _Schedstat()
        return self.schedstat.read()


_own_schedstat = _OwnSchedstat()


def thread_starved_s() -> float:
    """Run delay of the calling thread; 0 where the system does not tell."""
    with suppress(OSError, ValueError, IndexError):
        return _delay_s(_own_schedstat.read())
    return 0.0


def _delay_s(schedstat: bytes) -> float:
    return int(schedstat.split()[1]) / 1e9


def _starved_s(thread: str) -> float:
    with suppress(OSError, ValueError, IndexError):
        return _delay_s(Path("/proc/self/task", thread, "schedstat").read_bytes())
    return 0.0


def others_starved_s() -> float:
    """Summed run delay of the threads of this process that live now, without the calling one."""
    own = str(threading.get_native_id())
    with suppress(OSError):
        return sum(_starved_s(thread) for thread in os.listdir("/proc/self/task") if thread != own)
    return 0.0


HOST_CLOCK = HostClock(thread_starved=thread_starved_s, others_starved=others_starved_s)
