"""A session that its agent has forfeited: it ends before anything flies, and is recorded and measured like any other."""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager

from bench.contracts import AgentPlan, AgentUsage, Outcome

from ._stop_session import StopSession


class _Forfeit:
    """In place of an agent's process. The session's first look at it is its end."""

    pid = os.getpid()

    def exit_code(self) -> int | None:
        raise StopSession(
            Outcome.AGENT_BROKE_BENCH,
            "the bench was lost each time that it flew this session with the agent unconfined, and flew others meanwhile; "
            "the agent is not started again",
        )

    def usage(self) -> AgentUsage:
        return AgentUsage()

    def exceeded_limit(self) -> str:
        return ""

    def output_tail(self) -> str:
        return ""


@contextmanager
def open_forfeit(plan: AgentPlan) -> Generator[_Forfeit]:
    """An `OpenAgent` that starts nothing and ends the session as AGENT_BROKE_BENCH."""
    yield _Forfeit()
