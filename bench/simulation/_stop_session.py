"""The end of a session, raised wherever it is noticed."""

from __future__ import annotations

from bench.contracts import Outcome


class StopSession(Exception):
    """Carries an outcome and its reason to `run_session`, which makes a result of it. Not an error."""

    def __init__(self, outcome: Outcome, reason: str) -> None:
        super().__init__(reason)
        self.outcome = outcome
        self.reason = reason
