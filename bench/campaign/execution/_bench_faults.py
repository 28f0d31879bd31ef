"""What happens when a session fails because of the bench: it is retried, and a broken bench stops the
campaign.
"""

from __future__ import annotations

from bench.contracts import Outcome, SessionResult

from ._task import BenchBroken

RETRIED_OUTCOMES = frozenset({Outcome.WORKER_LOST, Outcome.BENCH_ERROR, Outcome.WALL_BUDGET})
"""Outcomes that are the fault of the bench or of a busy host.

The realization is flown once more, because the agent did not cause them.
"""


MAX_ATTEMPTS = 2
"""Attempts after which an outcome of RETRIED_OUTCOMES becomes the result."""

FAULTS_BEFORE_GIVING_UP = 5
"""Realizations that fail with bench errors before any session succeeds, after which the bench is considered
broken.
"""


class BenchFaultWatch:
    """Gives up on a bench on which no session succeeds, before a whole campaign fails the same way."""

    def __init__(self) -> None:
        # None once a session succeeded: faults after that are results of their own.
        self._faulty: set[str] | None = set()

    def record(self, result: SessionResult) -> None:
        """Take up a result.

        Raises BenchBroken when the first FAULTS_BEFORE_GIVING_UP realizations all failed.
        """
        if self._faulty is None or result.outcome not in RETRIED_OUTCOMES:
            self._faulty = None
            return
        # By realization, not by session: the second attempt of a faulty realization is no new evidence.
        self._faulty.add(result.realization)
        if len(self._faulty) >= FAULTS_BEFORE_GIVING_UP:
            raise BenchBroken(
                f"the first {FAULTS_BEFORE_GIVING_UP} sessions all ended with bench errors, so no more are started. "
                f"The last error: {result.outcome}: {result.reason}. "
                f"Fix it, then run `rebar run ... --again {result.outcome}`."
            )
