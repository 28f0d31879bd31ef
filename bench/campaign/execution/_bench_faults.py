"""What happens when a session fails because of the bench: it is retried, and a broken bench stops the
campaign.
"""

from __future__ import annotations

from bench.contracts import Outcome, SessionResult

from ..storage._completeness import PROVISIONAL_OUTCOMES
from ._task import BenchBroken

FAULTS_BEFORE_GIVING_UP = 5
"""Realizations that fail because of the bench or the host before any session succeeds, after which the bench
is considered broken.
"""


def is_worth_a_retry(result: SessionResult) -> bool:
    """Whether the host may have caused this end, so that the session deserves another attempt.

    An agent that ends before its first tick is one of them: it has seen nothing of the situation, so it
    cannot use the second attempt to drop one that goes badly, and its files or its memory may have been
    missing for a moment. The second end is its own.
    """
    at_start = result.outcome in (Outcome.AGENT_CRASHED, Outcome.AGENT_NEVER_CONNECTED)
    return result.outcome in PROVISIONAL_OUTCOMES or (at_start and result.simulated_s == 0.0)


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
