"""How much of the time that the session waits for its agent is the agent's own.

A session on a busy host waits longer, and must not blame the agent for that. The agent's own time is what it
spends running, or asleep while the session waits for it; being ready to run without a core is the host's.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from bench.contracts import AgentUsage

from ._host_clock import HostClock


def own_time_s(waited_s: float, usage: AgentUsage, bench_starved_s: float = 0.0) -> float:
    """The agent's own part of `waited_s` host seconds, in which it used the host by `usage`.

    `bench_starved_s` is how long threads of the bench were starved meanwhile that the agent may have waited
    for.
    """
    # Run delay is summed over threads, so children could add up any amount of it. What the agent spent
    # running was not spent waiting for a core by all of it, and a crowd of busy children runs a lot.
    excused_s = min(usage.starved_s + bench_starved_s, max(waited_s - usage.cpu_s, 0.0))
    return waited_s - excused_s


class AgentTime:
    """The stopwatch of a session's waits for its agent.

    `usage` reads the agent's usage so far. Reading it takes milliseconds, so a wait that ends at once does
    not.
    """

    def __init__(self, clock: HostClock, usage: Callable[[], AgentUsage]) -> None:
        self.clock = clock
        self.usage = usage
        self._ended_s = 0.0
        self._current: Wait | None = None
        self._waiting = _Waiting(self)
        # Threads of the air network outlive sessions.
        self._others_starved_s = clock.others_starved()

    def waiting(self) -> AbstractContextManager[None]:
        """Count what the block takes as waiting for the agent. The calling thread is the one that waits."""
        return self._waiting

    def wait(self) -> Wait:
        """The wait that `waiting` counts just now, or a new one."""
        return self._current or Wait(self)

    def begin(self) -> None:
        """Wait for the agent from now on; see `waiting`."""
        self._current = Wait(self)

    def end(self) -> None:
        """Wait no longer; see `waiting`."""
        self._ended_s, self._current = self.waited_s, None

    @property
    def waited_s(self) -> float:
        """Host seconds of all waits so far, with the current one."""
        return self._ended_s + (self._current.waited_s if self._current else 0.0)

    def own_s(self) -> float:
        """The agent's own part of all waits so far."""
        bench_starved_s = max(self.clock.others_starved() - self._others_starved_s, 0.0)
        return own_time_s(self.waited_s, self.usage(), bench_starved_s)


class Wait:
    """One wait for the agent, from now on."""

    def __init__(self, time: AgentTime) -> None:
        self._time = time
        self._started_s = time.clock.now()
        self._thread_starved_s = time.clock.thread_starved()
        self._first_look: tuple[float, AgentUsage, float] | None = None

    @property
    def waited_s(self) -> float:
        """Host seconds so far, without those in which the waiting thread itself had no core."""
        clock = self._time.clock
        starved_s = clock.thread_starved() - self._thread_starved_s
        return max(clock.now() - self._started_s - starved_s, 0.0)

    def own_s(self) -> float:
        """The agent's own part of this wait so far.

        The first call looks at the usage with which later ones are compared, so all of the wait before it
        counts as the agent's own.
        """
        waited_s, usage, others_s = self.waited_s, self._time.usage(), self._time.clock.others_starved()
        if self._first_look is None:
            self._first_look = waited_s, usage, others_s
        first_s, first, first_others_s = self._first_look
        change = AgentUsage(usage.cpu_s - first.cpu_s, usage.starved_s - first.starved_s)
        return first_s + own_time_s(waited_s - first_s, change, max(others_s - first_others_s, 0.0))


class _Waiting:
    """The block of `AgentTime.waiting`: two in every tick, where a generator costs as much as what it measures."""

    def __init__(self, time: AgentTime) -> None:
        self._time = time

    def __enter__(self) -> None:
        self._time.begin()

    def __exit__(self, *_: object) -> None:
        self._time.end()
