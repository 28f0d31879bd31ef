"""Being asked to stop: Ctrl-C and SIGTERM become a word that the runner reads between two sessions."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Stop:
    """Whether somebody asked to stop, and a file descriptor that becomes readable when they do."""

    def __init__(self, wake_fd: int, ring_fd: int) -> None:
        self.wake_fd = wake_fd
        self._ring_fd = ring_fd
        self.reason: str | None = None

    def ask(self, reason: str) -> None:
        """Ask to stop; the first reason stays."""
        if self.reason is None:
            self.reason = reason
            os.write(self._ring_fd, b"!")


@contextmanager
def open_stop() -> Iterator[Stop]:
    """Yield a Stop that SIGINT and SIGTERM ask; their former handlers come back at the end. Outside the main thread, nobody asks."""
    wake_fd, ring_fd = os.pipe()
    stop = Stop(wake_fd, ring_fd)

    def handler(number: int, frame: FrameType | None) -> None:
        del frame
        stop.ask(f"ended by {signal.Signals(number).name}")

    listens = threading.current_thread() is threading.main_thread()
    former = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)} if listens else {}
    try:
        yield stop
    finally:
        for number, before in former.items():
            signal.signal(number, before)
        os.close(wake_fd)
        os.close(ring_fd)
