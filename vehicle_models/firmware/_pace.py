"""How autopilot and physics share the host: on one core, or in step with every thread."""

from __future__ import annotations

import os
import time
from collections.abc import Generator
from contextlib import contextmanager

from bench.errors import Fault, FirmwareFault
from bench.process_threads import ProcessThreads, unseen_reason

from ._px4_link import ANSWER_S, CheckAlive

# While PX4's start script runs, threads and processes come and go: one look is not enough.
_LOOKS_WHILE_STARTING = 3


def core_of(instance: int) -> int:
    """The core for an autopilot with this number, of those that this process may use."""
    cores = sorted(os.sched_getaffinity(0))
    return cores[instance % len(cores)]


@contextmanager
def held_on(cores: frozenset[int]) -> Generator[None]:
    """Keep the thread on these cores, if any: two that take turns lose more by waking across cores."""
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
        self._check_alive = check_alive
        self._patience_s = patience_s
        self._threads = ProcessThreads(pid, root_is_box=False, with_bench=False)

    def asleep(self) -> bool:
        """Whether all sleep now; a start script is not asked."""
        self._threads.with_group = False
        return self._threads.at_rest()

    def wait(self, starting: bool) -> None:
        """Return once all sleep. Raises FirmwareFault when they do not within the budget."""
        looks, needed = 0, _LOOKS_WHILE_STARTING if starting else 1
        deadline_s = time.monotonic() + self._patience_s
        self._threads.with_group = starting
        while looks < needed:
            if self._threads.at_rest():
                looks += 1
                continue
            looks = 0
            if not self._threads.processes:
                self._check_alive()
            if time.monotonic() > deadline_s:
                self._check_alive()
                raise FirmwareFault(f"the threads of PX4 have not slept for {self._patience_s:g} s")
            os.sched_yield()

    def close(self) -> None:
        self._threads.close()


def quiet_fault() -> Fault | None:
    """Why no autopilot can be flown at pace `quiet` on this host; None where it can."""
    if not (reason := unseen_reason()):
        return None
    what = f"quiet must see whether threads sleep, and {reason}"
    return Fault("vehicle.autopilot.pace", what, "take one_core, which need not repeat")
