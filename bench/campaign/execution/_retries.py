"""When sessions that the host may have cost are flown again: with pauses that grow, so that a fault of a minute does
not use up every attempt in its first second.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Collection

from bench.contracts import SessionResult

from ..storage._completeness import PROVISIONAL_OUTCOMES
from ._bench_faults import is_worth_a_retry

# The pauses are chosen, not measured: attempts 0, 5, 15, 35 and 65 s after the first failure at the default
# `budgets.retry_s` of 60 s, which is a network drive that is remounted or a neighbour's job that ends.
FIRST_PAUSE_S = 5.0
MAX_PAUSE_S = 30.0
# More would make no pause longer, and a thousand are beyond a float.
_DOUBLINGS = 10
JITTER = 0.25
"""Share by which a pause is longer at most: sessions that failed together do not all come back at once."""


class Retries:
    """Which realizations of one run of a campaign get another attempt, and when. At least one attempt follows the
    first failure; more follow until `span_s` host seconds have passed since then.

    A run on another day, on a repaired host, has attempts of its own. `now` is a reading of the campaign's clock, in
    host seconds.
    """

    def __init__(self, span_s: float) -> None:
        self._span_s = span_s
        self._failures: Counter[str] = Counter()
        self._first_failure: dict[str, float] = {}
        self._due: dict[str, float] = {}

    def pause_s(self, result: SessionResult, now: float) -> float | None:
        """Take up the end of a session. Host seconds until its next attempt; None if the result is final."""
        if not is_worth_a_retry(result):
            return None
        realization = result.realization
        since_first_s = now - self._first_failure.setdefault(realization, now)
        self._failures[realization] += 1
        failures = self._failures[realization]
        # An agent that is killed or silent before its first tick gets one more attempt, however soon that fails: what
        # the host did once, it hardly does twice.
        limit_s = self._span_s if result.outcome in PROVISIONAL_OUTCOMES else 0.0
        if failures > 1 and since_first_s >= limit_s:
            return None
        nominal_s = min(FIRST_PAUSE_S * 2.0 ** min(failures - 1, _DOUBLINGS), MAX_PAUSE_S, self._span_s)
        # Seeded by what is retried: no run differs from its repetition by a draw.
        draw = random.Random(f"{realization} {failures}").random()
        pause_s = nominal_s * (1.0 + JITTER * draw)
        self._due[realization] = now + pause_s
        return pause_s

    def restart(self, realizations: Collection[str]) -> None:
        """Give these realizations attempts as if they had never failed, at once."""
        for realization in realizations:
            self._due.pop(realization, None)
            self._first_failure.pop(realization, None)
            self._failures.pop(realization, None)

    def is_due(self, realization: str, now: float) -> bool:
        """Whether a realization that waits may start: it never failed in this run, or its pause is over."""
        return realization not in self._due or self._due[realization] <= now

    def next_due_s(self, waiting: Collection[str], now: float) -> float | None:
        """Host seconds until the first pause of these realizations is over; None if none of them pauses."""
        pauses_s = [due - now for name, due in self._due.items() if due > now and name in waiting]
        return min(pauses_s, default=None)
