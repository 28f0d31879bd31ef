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
    `others_starved` the same summed over the other threads of this process, which carry the air network. `thread_cpu` is
    the CPU time of the calling thread, and `air_readers_cpu` that of the threads that read what agents send over Zenoh.
    """

    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], object] = time.sleep
    thread_starved: Callable[[], float] = _no_delay
    others_starved: Callable[[], float] = _no_delay
    thread_cpu: Callable[[], float] = _no_delay
    air_readers_cpu: Callable[[], float] = _no_delay


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
    return sum(_starved_s(thread) for thread in _threads() if thread != own)


def _threads() -> list[str]:
    with suppress(OSError):
        return os.listdir("/proc/self/task")
    return []


class _AirReaders:
    """The threads of this process that accept and read Zenoh's connections, and what they cost.

    Known by the names that Zenoh gives to its runtimes. Those that send have others, so what the bench itself publishes is
    not among it.
    """

    def __init__(self) -> None:
        self._process = os.getpid()
        # Kept open, and names read once: a session in real time asks at every step.
        self._schedstats: dict[str, int] = {}
        self._cpu_ns: dict[str, int] = {}
        self._ended_ns = 0
        self._others: set[str] = set()

    def cpu_s(self) -> float:
        """Their CPU time so far; 0 where the system does not tell."""
        # A forked process has other threads under the same numbers.
        if self._process != os.getpid():
            self._process = os.getpid()
            self._schedstats, self._cpu_ns, self._others = {}, {}, set()
        present = set(_threads())
        self._others &= present
        for thread in present - self._others - self._schedstats.keys():
            self._add(thread)
        for thread, file in list(self._schedstats.items()):
            try:
                self._cpu_ns[thread] = int(os.pread(file, 100, 0).split()[0])
            except (OSError, ValueError, IndexError):
                # It has ended, as those do that Zenoh starts for a while.
                self._ended_ns += self._cpu_ns.pop(thread, 0)
                os.close(self._schedstats.pop(thread))
        return (self._ended_ns + sum(self._cpu_ns.values())) / 1e9

    def _add(self, thread: str) -> None:
        folder = Path("/proc/self/task", thread)
        with suppress(OSError):
            if (folder / "comm").read_bytes().startswith((b"rx-", b"acc-", b"net-")):
                self._schedstats[thread] = os.open(folder / "schedstat", os.O_RDONLY | os.O_CLOEXEC)
            else:
                self._others.add(thread)


HOST_CLOCK = HostClock(
    thread_starved=thread_starved_s,
    others_starved=others_starved_s,
    thread_cpu=time.thread_time,
    air_readers_cpu=_AirReaders().cpu_s,
)
