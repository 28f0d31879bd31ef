"""How autopilot and physics share the host: pinned to one core, and in step with every thread of the autopilot."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from bench.errors import FirmwareFault

from ._px4_link import ANSWER_S, CheckAlive

# While PX4's start script runs, threads and processes come and go: one look is not enough.
_LOOKS_WHILE_STARTING = 3
_RUNNING = b"RD"


@dataclass(frozen=True, slots=True)
class LineClock:
    """The host's clock, which tests replace: in real time everything is measured by it."""

    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep


def core_of(instance: int) -> int:
    """The core for an autopilot with this number, of those that this process may use."""
    cores = sorted(os.sched_getaffinity(0))
    return cores[instance % len(cores)]


@contextmanager
def held_on(cores: frozenset[int]) -> Generator[None]:
    """Keep the present thread on these cores; nothing where there are none.

    Two processes that take turns lose more by waking each other across cores than the second core gives.
    """
    if not cores:
        yield
        return
    former = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, former)


class ThreadWatch:
    """Waits until every thread of a process sleeps, and at its start the processes of its group as well.

    PX4's commander and MAVLink threads are not part of its lockstep: they run in wall time between two samples, so that
    a sample that comes while one works finds another PX4 than one that comes later.
    """

    def __init__(self, pid: int, check_alive: CheckAlive, patience_s: float = ANSWER_S) -> None:
        self._pid = pid
        self._check_alive = check_alive
        self._patience_s = patience_s
        # Kept open and read again, which is four times cheaper than opening them for each sample.
        self._files: dict[str, int] = {}

    def wait(self, starting: bool) -> None:
        """Return once all sleep. Raises FirmwareFault when they do not within the budget."""
        looks, needed = 0, _LOOKS_WHILE_STARTING if starting else 1
        deadline_s = time.monotonic() + self._patience_s
        while looks < needed:
            if self._is_running() or (starting and self._group_is_running()):
                looks = 0
                if time.monotonic() > deadline_s:
                    self._check_alive()
                    raise FirmwareFault(f"the threads of PX4 have not slept for {self._patience_s:g} s")
                os.sched_yield()
            else:
                looks += 1

    def close(self) -> None:
        for handle in self._files.values():
            os.close(handle)
        self._files.clear()

    def _is_running(self) -> bool:
        try:
            names = os.listdir(f"/proc/{self._pid}/task")
        except OSError:
            self._check_alive()
            return False
        return any(self._state(name) in _RUNNING for name in names)

    def _state(self, name: str) -> bytes:
        try:
            handle = self._files.get(name)
            if handle is None:
                handle = self._files[name] = os.open(f"/proc/{self._pid}/task/{name}/stat", os.O_RDONLY)
            return _state_of(os.pread(handle, 64, 0))
        except FileNotFoundError:
            return b"-"
        except ProcessLookupError:
            os.close(self._files.pop(name))
            return b"-"

    def _group_is_running(self) -> bool:
        for name in os.listdir("/proc"):
            if not name.isdigit() or int(name) <= self._pid:
                continue
            with suppress(OSError):
                with open(f"/proc/{name}/stat", "rb") as file:
                    state, _, group = file.read().rsplit(b")", 1)[1].split()[:3]
                if int(group) == self._pid and state in _RUNNING:
                    return True
        return False


def _state_of(stat: bytes) -> bytes:
    # Behind the name of the thread, which may hold anything, brackets too.
    at = stat.rindex(b")") + 2
    return stat[at : at + 1]
