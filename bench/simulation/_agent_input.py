"""What the bench spends on what its agent sends: CPU time, so that a busy host adds nothing to it."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from ._host_clock import HostClock


class AgentInput:
    """The stopwatch of a session's work on its agent's messages.

    The session's thread takes them in, inside `taking`. Before it the threads of the air network read them from their
    connections, and whatever an agent declares or sends there, allowed or not, is work of theirs alone.
    """

    def __init__(self, clock: HostClock) -> None:
        self._clock = clock
        self._before_s = clock.air_readers_cpu()
        self.taken_s = 0.0
        """CPU seconds of the session's thread so far."""
        self._marked = (0.0, self._before_s, clock.thread_starved())

    @contextmanager
    def taking(self) -> Generator[None]:
        """Count the CPU time of the calling thread in the block."""
        began_s = self._clock.thread_cpu()
        try:
            yield
        finally:
            self.taken_s += self._clock.thread_cpu() - began_s

    @property
    def cpu_s(self) -> float:
        """CPU seconds of all threads so far."""
        return self.taken_s + max(self._clock.air_readers_cpu() - self._before_s, 0.0)

    def delay_since_mark_s(self) -> float:
        """By how much input has delayed the calling thread at most since this was last asked.

        What it took in itself; and while it had no core, as long as the air network's threads had one for input.
        """
        taken_s, readers_s, starved_s = self._marked
        self._marked = (self.taken_s, self._clock.air_readers_cpu(), self._clock.thread_starved())
        reading_s = max(self._marked[1] - readers_s, 0.0)
        return self._marked[0] - taken_s + min(reading_s, max(self._marked[2] - starved_s, 0.0))
