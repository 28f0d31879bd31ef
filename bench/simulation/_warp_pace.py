"""The pace at which simulated time goes on as soon as an agent that knows nothing of it rests."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

from bench.contracts import AgentEndpoints, AgentProcess, HasProcessRoot, SimTime, WarpLibrary
from bench.errors import SetupError

from ._pace import Documents, Pace, receive_from_operator
from ._session_parts import SessionParts
from ._session_watch import SessionWatch
from ._stop_session import StopSession
from ._unpaced_air import UnpacedAir, open_unpaced_air
from .warp import Warp, open_warp


class InWarp(Pace):
    """A beat is a step of the vehicle. The agent's clock is the session's, and goes on while it waits."""

    def __init__(self, parts: SessionParts, watch: SessionWatch, warp: Warp, air: UnpacedAir) -> None:
        super().__init__(parts, watch, parts.vehicle.step_s)
        self._air = air
        self._warp = warp

    def endpoints(self, endpoints: AgentEndpoints) -> AgentEndpoints:
        """With the library that sets the agent's clock, and the tick socket if the agent has the air network there."""
        return replace(self._air.endpoints(endpoints), warp=self._warp.access)

    def follow(self, agent: AgentProcess) -> None:
        """Follow its processes and threads."""
        if not isinstance(agent, HasProcessRoot):
            fault = "cannot follow an agent whose processes are not known"
            raise SetupError("pace.mode", fault, "fly it with --pace realtime")
        super().follow(agent)
        # Imports are no part of the mission.
        self._warp.start_budget_s = self._budgets.connect_s
        with_bench = self._parts.air.access is not None
        self._warp.watch(agent.root(), self._watch.check, self._watch.agent_time, with_bench=with_bench)

    def begin(self) -> None:
        """Let the agent start.

        Before it is told anything: a program that cannot fly in warp shows here, when its end says nothing of how the
        situation goes.
        """
        self._warp.settle()
        # Without a wait: time stands still until an agent that sleeps first may go on.
        self._air.begin(waits=False)
        self._warp.agent_is_informed = True

    def exchange(self, now: SimTime) -> Documents:
        """Let the agent live until the next step, and take in what it has sent."""
        warp = self._warp
        self._air.send(now)
        # What the vehicle and the streams say of this moment is with the agent: it acts on it.
        warp.settle()
        while self._air.flush():
            warp.settle()
        # Only now: before it has settled its end would be seen by this moment or by the next, as the host likes.
        self._watch.check_agent()
        # Then it lives until the next step, and acts at the moments for which it waits.
        warp.run_until(now.after(self.span_s))
        with self._watch.agent_input.taking():
            received = self._parts.vehicle.receive()
            documents = self._air.take(now)
        receive_from_operator(self._parts)
        spoke = bool(documents) or any(received[name] for name in self._agent_links)
        warp.agent_has_spoken = warp.agent_has_spoken or spoke
        return documents

    def counters(self) -> dict[str, int]:
        """How the agent was followed."""
        return self._warp.counts.counters() | self._air.counters()

    def judged(self, end: StopSession) -> StopSession:
        """The same end, of which the agent learns."""
        self._air.end(end)
        return end

    def release(self) -> None:
        """Let the agent's time go on by itself."""
        self._warp.release()


@contextmanager
def open_in_warp(parts: SessionParts, watch: SessionWatch) -> Generator[InWarp]:
    """Make the agent's clock."""
    plan = parts.plan
    utc_ns = round(plan.simspec.environment.start_utc.timestamp() * 1e9)
    with open_warp(plan.scratch, utc_ns, plan.clock) as warp, open_unpaced_air(parts, watch) as air:
        parts.progress.add(WarpLibrary(description=warp.description))
        yield InWarp(parts, watch, warp, air)
