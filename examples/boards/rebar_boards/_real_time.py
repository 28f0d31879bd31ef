"""A board's time: the host's clock, and a thread that keeps the board in it while the session does something else."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LineClock:
    """The host's clock, which tests replace: in real time everything is measured by it."""

    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep


class Keeper:
    """Keeps a board in real time while the session does something else: calls `work` again and again in a thread of its own
    until it is stopped. Nobody else touches the vehicle meanwhile.
    """

    def __init__(self, work: Callable[[], None]) -> None:
        self._work = work
        self._over = threading.Event()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="board", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop, and raise what went wrong."""
        self.close()
        if self._error:
            raise self._error

    def close(self) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            while not self._over.is_set():
                self._work()
        except Exception as error:  # of another thread: it is raised where the session can see it
            self._error = error
