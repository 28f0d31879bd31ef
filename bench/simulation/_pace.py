"""How the time of a session passes for its agent: what the paces have in common, and the wait for messages that are under way."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from bench.contracts import OPERATOR_LINK, AgentEndpoints, AgentProcess, Outcome, SimTime

from ._session_parts import SessionParts
from ._session_watch import SessionWatch
from ._stop_session import StopSession

# Host time for samples that the agent says it has sent, on loopback. Chosen, not measured.
COUNT_BUDGET_S = 5.0
# Between two looks for MAVLink messages on loopback; a lockstep tick is to lose no more.
RECEIVE_POLL_S = 0.0005

Documents = Mapping[str, list[Any]]
"""What an agent published, by topic: documents, and the messages of PX4's topics."""


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


def receive_exactly(parts: SessionParts, stated: Mapping[str, int]) -> None:
    """Wait for as many messages on each link as the agent states that it has sent."""
    clock = parts.plan.clock
    deadline_s = clock.now() + COUNT_BUDGET_S
    while True:
        received = parts.vehicle.receive()
        missing = {link: count for link, count in stated.items() if received.get(link, 0) < count}
        if not missing:
            return
        if clock.now() > deadline_s:
            raise StopSession(Outcome.AGENT_PROTOCOL, _miscount(missing, received))
        clock.sleep(RECEIVE_POLL_S)


def receive_from_operator(parts: SessionParts) -> None:
    """Wait for what the operator has sent, so that the step which takes it does not depend on the host."""
    if parts.operator is None:
        return
    clock = parts.plan.clock
    deadline_s = clock.now() + COUNT_BUDGET_S
    while parts.vehicle.receive().get(OPERATOR_LINK, 0) < parts.operator.sent:
        if clock.now() > deadline_s:
            raise StopSession(Outcome.BENCH_ERROR, "the operator's MAVLink messages did not arrive")
        clock.sleep(RECEIVE_POLL_S)


def _miscount(stated: Mapping[str, int], received: Mapping[str, int]) -> str:
    """Why the agent's statement about the MAVLink messages that it sent cannot be true."""
    parts = [
        f"{count} on link {link!r}, of which {received[link]} came"
        if link in received
        else f"{count} on link {link!r}, which does not exist (links: {', '.join(sorted(received)) or 'none'})"
        for link, count in sorted(stated.items())
    ]
    return (
        f"the agent states that it sent these MAVLink messages since the start: {'; '.join(parts)}. Count each whole frame "
        "that went out on the link once (docs/time.md)"
    )
