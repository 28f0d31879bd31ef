"""The agent's side of the air network at the paces that do not wait for its answers."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

from bench.contracts import MAX_AIR_LINE_BYTES, AgentEndpoints, Hello, Outcome, SimTime, Tick

from ._pace import Documents
from ._session_parts import SessionParts
from ._session_watch import SessionWatch
from ._stop_session import StopSession
from ._tick_server import EXIT_GRACE_S, TickServer, open_tick_server


class UnpacedAir:
    """Over Zenoh: what is published is on its way, and what has come is taken."""

    def __init__(self, parts: SessionParts) -> None:
        self._parts = parts

    def endpoints(self, endpoints: AgentEndpoints) -> AgentEndpoints:
        """The agent's endpoints with what it needs for this."""
        return endpoints

    def begin(self, *, waits: bool) -> None:
        """Publish from now on; with `waits` once an agent that can be waited for is there."""
        self._parts.air.open_for_all()

    def send(self, now: SimTime) -> None:
        """Hand over what was published up to this moment."""

    def flush(self) -> bool:
        """Hand over what has not gone yet; whether any of it went."""
        return False

    def take(self, now: SimTime) -> Documents:
        """What has come from the agent by now."""
        return self._parts.air.receive(now, None, 0.0)

    def end(self, end: StopSession) -> None:
        """Tell the agent that the session is over."""

    def counters(self) -> dict[str, int]:
        """Counters for the result."""
        return {}


class TickedAir(UnpacedAir):
    """In the lines of the tick socket, as in lockstep, but simulated time goes on meanwhile.

    Every `pace.tick_s`, or `interval_s` of the hello, there is a tick with what was published since the one before; while one
    is not acknowledged, there is no further one. Counts of messages are left out, because nobody waits for them.
    """

    def __init__(self, parts: SessionParts, watch: SessionWatch, ticks: TickServer) -> None:
        super().__init__(parts)
        self._watch, self._ticks = watch, ticks
        self._connect_s = parts.plan.simspec.budgets.connect_s
        ticks.watch(watch.check, watch.agent_time)
        self._tick_ns = round(parts.plan.simspec.pace.tick_s * 1e9)
        self._due_ns = self._number = 0
        self._has_said_hello = self._awaits_ack = False
        self._closed: SimTime | None = None

    def endpoints(self, endpoints: AgentEndpoints) -> AgentEndpoints:
        return replace(endpoints, tick=self._ticks.address, tick_secret=self._ticks.secret)

    def begin(self, *, waits: bool) -> None:
        if waits:
            with self._watch.agent_time.waiting():
                self._admit(self._ticks.hello(self._connect_s))
        elif hello := self._ticks.poll_hello():
            self._admit(hello)

    def _admit(self, hello: Hello) -> None:
        self._has_said_hello = True
        if hello.interval_s is not None:
            self._tick_ns = round(hello.interval_s * 1e9)
        self._parts.truth.write_event(self._parts.progress.now, "agent connected", hello.agent)
        self._parts.air.open_for(hello.subscribes)

    def send(self, now: SimTime) -> None:
        outbox = self._parts.air.outbox
        assert outbox is not None
        if not self._has_said_hello:
            self.begin(waits=False)
            if not self._has_said_hello and now.s > self._connect_s:
                raise self._ticks.missing_hello(self._connect_s)
        if self._closed is None and self._has_said_hello and not self._awaits_ack and now.ns >= self._due_ns:
            self._ticks.post(Tick(number=self._number, time_ns=now.ns, air=outbox.take()))
            self._awaits_ack = True
            self._due_ns = (now.ns // self._tick_ns + 1) * self._tick_ns
        else:
            outbox.shrink()
        self.flush()

    def flush(self) -> bool:
        return self._has_said_hello and self._ticks.flush()

    def take(self, now: SimTime) -> Documents:
        if self._closed is not None:
            if now.s - self._closed.s > EXIT_GRACE_S:
                reason = "the agent closed the tick socket and went on running"
                raise StopSession(Outcome.AGENT_PROTOCOL, reason)
            return {}
        # What comes ahead of its tick is seen when that is sent.
        if not self._awaits_ack:
            return {}
        try:
            ack = self._ticks.poll_ack(self._number)
        except EOFError:
            self._closed = now
            return {}
        if ack is None:
            return {}
        self._awaits_ack = False
        self._number += 1
        return self._parts.air.receive_messages(now, ack.air)

    def end(self, end: StopSession) -> None:
        # Whoever wrote the agent reads there what it did wrong.
        is_protocol = end.outcome is Outcome.AGENT_PROTOCOL
        self._ticks.end(end.reason if is_protocol else "the session is over")

    def counters(self) -> dict[str, int]:
        assert self._parts.air.outbox is not None
        return {"tick_strangers": self._ticks.strangers, "air_untaken": self._parts.air.outbox.dropped}


@contextmanager
def open_unpaced_air(parts: SessionParts, watch: SessionWatch) -> Generator[UnpacedAir]:
    """What the agent's manifest asks for: the tick socket, or nothing beside the session's router."""
    if parts.air.outbox is None:
        yield UnpacedAir(parts)
        return
    with open_tick_server(parts.plan.clock, MAX_AIR_LINE_BYTES) as ticks:
        yield TickedAir(parts, watch, ticks)
