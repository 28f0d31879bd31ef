"""The host's monotonic clock as a value, so that budgets can be tested without waiting for them."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass


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


def thread_starved_s(thread: int | None = None) -> float:
    """Run delay of a thread of this process (without an id, the calling one); 0 where the system does not
    tell.
    """
    with (
        suppress(OSError, ValueError, IndexError),
        open(f"/proc/self/task/{thread or threading.get_native_id()}/schedstat", "rb", buffering=0) as file,
    ):
        return int(file.read(100).split()[1]) / 1e9
    return 0.0


def others_starved_s() -> float:
    """Summed run delay of the threads of this process that live now, without the calling one."""
    own = threading.get_native_id()
    with suppress(OSError):
        return sum(thread_starved_s(int(name)) for name in os.listdir("/proc/self/task") if int(name) != own)
    return 0.0


HOST_CLOCK = HostClock(thread_starved=thread_starved_s, others_starved=others_starved_s)
