"""What happens when a session fails because of the bench: it is retried, and a broken bench stops the
campaign.
"""

from __future__ import annotations

import signal

from bench.contracts import AgentExit, Outcome, SessionResult

from ..storage._completeness import PROVISIONAL_OUTCOMES
from ._task import BenchBroken

FAULTS_BEFORE_GIVING_UP = 5
"""Realizations that fail because of the bench or the host before any session succeeds, after which the bench
is considered broken.
"""


def is_worth_a_retry(result: SessionResult) -> bool:
    """Whether the host may have caused this end, so that the session deserves another attempt.

    Of the ends of an agent, two before its first tick are among them: a signal that others send, and no hello in time,
    which a busy host may have held up. The agent has seen nothing of the situation, so it cannot use the second attempt
    to drop one that goes badly, and the second end is its own. An exit code is its program's decision, and the signals
    that the kernel sends for what a program does (SIGSEGV) are its program's fault: another attempt would only repeat
    them, or hide them where they fall by chance.
    """
    if result.outcome in PROVISIONAL_OUTCOMES:
        return True
    if result.simulated_s > 0.0:
        return False
    end = result.fact(AgentExit)
    return result.outcome is Outcome.AGENT_NEVER_CONNECTED or (
        result.outcome is Outcome.AGENT_CRASHED and end is not None and end.code in _ENDED_BY_OTHERS
    )


# Those by which a host ends programs: for want of memory, at the end of a service or a batch job, with a terminal.
_SENT_BY_OTHERS = (signal.SIGHUP, signal.SIGINT, signal.SIGKILL, signal.SIGTERM)
# Shells and container engines state the signal n that ended their program as the exit code 128 + n.
_ENDED_BY_OTHERS = frozenset(code for number in _SENT_BY_OTHERS for code in (-number, 128 + number))


class BenchFaultWatch:
    """Gives up on a bench on which no session succeeds, before a whole campaign fails the same way."""

    def __init__(self) -> None:
        # None once a session succeeded: faults after that are results of their own.
        self._faulty: set[str] | None = set()

    @property
    def succeeded(self) -> bool:
        """Whether any session ended otherwise than by a fault of the bench or the host."""
        return self._faulty is None

    def record(self, result: SessionResult) -> None:
        """Take up a result.

        Raises BenchBroken when the first FAULTS_BEFORE_GIVING_UP realizations all failed.
        """
        if self._faulty is None or result.outcome not in PROVISIONAL_OUTCOMES:
            self._faulty = None
            return
        # By realization, not by session: the second attempt of a faulty realization is no new evidence.
        self._faulty.add(result.realization)
        if len(self._faulty) >= FAULTS_BEFORE_GIVING_UP:
            raise BenchBroken(
                f"INCOMPLETE: the first {FAULTS_BEFORE_GIVING_UP} sessions all failed because of the bench or the host, "
                f"so no more are started. The last error: {result.outcome}: {result.reason}. "
                "Fix it, then run the same command again: it flies them again."
            )
