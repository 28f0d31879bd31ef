"""The pace at which simulated time waits for the agent's answer to each tick."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

from bench.contracts import MAX_AIR_LINE_BYTES, MAX_LINE_BYTES, AgentEndpoints, Outcome, SimTime, Tick

from ._pace import COUNT_BUDGET_S, Documents, Pace, receive_exactly, receive_from_operator
from ._session_parts import SessionParts
from ._session_watch import SessionWatch
from ._stop_session import StopSession
from ._tick_server import TickServer, open_tick_server


class Lockstep(Pace):
    """A beat is a tick: the agent is told of it, and acknowledges it with counts of what it has sent."""

    def __init__(self, parts: SessionParts, watch: SessionWatch, ticks: TickServer) -> None:
        super().__init__(parts, watch, parts.plan.simspec.pace.tick_s)
        self._ticks = ticks
        self._number = 0
        self._in_ticks = parts.plan.manifest.air == "tick"
        ticks.watch(watch.check, watch.agent_time)

    def endpoints(self, endpoints: AgentEndpoints) -> AgentEndpoints:
        """With the tick socket and its secret."""
        return replace(endpoints, tick=self._ticks.address, tick_secret=self._ticks.secret)

    def begin(self) -> None:
        """Wait for the agent's hello."""
        with self._watch.agent_time.waiting():
            hello = self._ticks.hello(self._budgets.connect_s)
        self._parts.truth.write_event(self._parts.progress.now, "agent connected", hello.agent)
        self._parts.air.open_for(hello.subscribes)

    def exchange(self, now: SimTime) -> Documents:
        """Send a tick, and take in exactly what its acknowledgement states."""
        air = self._parts.air
        messages = air.outbox.take() if air.outbox is not None else ()
        sent = {
            link: count for link, count in self._parts.vehicle.sent().items() if link in self._agent_links
        }
        tick = Tick(number=self._number, time_ns=now.ns, topics=air.sent(), links=sent, air=messages)
        with self._watch.agent_time.waiting():
            ack = self._ticks.exchange(tick, self._budgets.reply_s)
            receive_exactly(self._parts, ack.links)
            # Inside, because it may state samples long before it sends them.
            if ack.air and not self._in_ticks:
                raise StopSession(
                    Outcome.AGENT_PROTOCOL,
                    "the agent's ack holds messages of the air network, and its manifest has no `air: tick`",
                )
            documents = (
                air.receive_messages(now, ack.air)
                if self._in_ticks
                else air.receive(now, ack.topics, COUNT_BUDGET_S)
            )
        receive_from_operator(self._parts)
        self._number += 1
        return documents

    def judged(self, end: StopSession) -> StopSession:
        """The same end. Whoever wrote the agent reads on the tick socket what it did wrong."""
        if end.outcome is Outcome.AGENT_PROTOCOL:
            self._ticks.end(end.reason)
        return end

    def counters(self) -> dict[str, int]:
        """Connections that were not the agent's."""
        return {"tick_strangers": self._ticks.strangers}

    def release(self) -> None:
        """Tell the agent."""
        self._ticks.end("the session is over")


@contextmanager
def open_lockstep(parts: SessionParts, watch: SessionWatch) -> Generator[Lockstep]:
    """Open the tick socket."""
    in_ticks = parts.plan.manifest.air == "tick"
    with open_tick_server(parts.plan.clock, MAX_AIR_LINE_BYTES if in_ticks else MAX_LINE_BYTES) as ticks:
        yield Lockstep(parts, watch, ticks)
