"""How the time of a session passes for its agent: what the paces have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from bench.contracts import AgentEndpoints, AgentProcess, SimTime

from ._session_parts import SessionParts
from ._session_watch import SessionWatch
from ._stop_session import StopSession

Documents = Mapping[str, list[str | bytes]]
"""What an agent published, by topic."""


class Pace(ABC):
    """The agent's part of every beat. `span_s` is how far simulated time goes on from one beat to the next.

    What a pace has no need of does nothing here.
    """

    def __init__(self, parts: SessionParts, watch: SessionWatch, span_s: float) -> None:
        self._parts, self._watch, self.span_s = parts, watch, span_s
        self._budgets = parts.plan.simspec.budgets
        self._agent_links = {need.name for need in parts.plan.manifest.mavlink}

    def endpoints(self, endpoints: AgentEndpoints) -> AgentEndpoints:
        """The agent's endpoints with what it needs to keep this pace."""
        return endpoints

    def follow(self, agent: AgentProcess) -> None:
        """The agent has started. Raises SetupError where it cannot be flown at this pace."""
        self._watch.follow(agent)

    @abstractmethod
    def begin(self) -> None:
        """Wait until the agent is there, and open the air network for it."""

    @abstractmethod
    def exchange(self, now: SimTime) -> Documents:
        """Let the agent act on what was published of this moment, take in its MAVLink messages, and return its documents."""

    def judged(self, end: StopSession) -> StopSession:
        """The end of the session as this pace sees it. The agent may learn of it."""
        return end

    def counters(self) -> dict[str, int]:
        """Counters for the result."""
        return {}

    def release(self) -> None:  # noqa: B027 (real time has nothing to release)
        """The session is over, and its agent is about to be ended."""
