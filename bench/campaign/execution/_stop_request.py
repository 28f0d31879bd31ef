"""Requests to stop: Ctrl-C and SIGTERM set a reason that the runner reads between two sessions."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class StopRequest:
    """`reason` is None until a stop is requested. `wake_fd` becomes readable at that moment."""

    def __init__(self, wake_fd: int, signal_fd: int) -> None:
        self.wake_fd = wake_fd
        self._signal_fd = signal_fd
        self.reason: str | None = None

    def request(self, reason: str) -> None:
        """Request a stop. The first reason stays."""
        if self.reason is None:
            self.reason = reason
            os.write(self._signal_fd, b"!")


@contextmanager
def open_stop_request() -> Iterator[StopRequest]:
    """Yield a StopRequest that SIGINT and SIGTERM trigger. The former handlers come back at the end.

    Outside the main thread no signal triggers it.
    """
    # A pipe, not a flag alone: the runner sleeps in a wait on file descriptors, and a flag would not wake it.
    wake_fd, signal_fd = os.pipe()
    stop = StopRequest(wake_fd, signal_fd)

    def handler(number: int, frame: FrameType | None) -> None:
        del frame
        stop.request(f"received {signal.Signals(number).name}")

    # Python runs signal handlers in the main thread only, and refuses to install them from another.
    is_main_thread = threading.current_thread() is threading.main_thread()
    former = (
        {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
        if is_main_thread
        else {}
    )
    try:
        yield stop
    finally:
        for number, previous_handler in former.items():
            signal.signal(number, previous_handler)
        os.close(wake_fd)
        os.close(signal_fd)
