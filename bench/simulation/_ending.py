"""The end of a session, thrown from wherever it is noticed."""

from __future__ import annotations

from bench.contracts import Outcome


class StopSession(Exception):
    """Carries the outcome and its reason to the one place that turns it into a result. Not an error."""

    def __init__(self, outcome: Outcome, reason: str) -> None:
        super().__init__(reason)
        self.outcome = outcome
        self.reason = reason
