"""The bench's side of the lockstep socket. bench/contracts/_tick.py describes the protocol."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import NoReturn

from bench.contracts import (
    MAX_LINE_BYTES,
    Ack,
    AgentUsage,
    End,
    Hello,
    Outcome,
    Tick,
    TickMessage,
    read_line,
    write_line,
)

from ._agent_time import AgentTime, Wait
from ._host_clock import HOST_CLOCK, HostClock
from ._stop_session import StopSession

# How often a wait checks whether the agent's process still runs. Chosen, not measured: a crash costs at most
# this.
LIVENESS_POLL_S = 0.25
# Host time that a process may take to end after its socket has closed, so that its exit code becomes the
# reason.
EXIT_GRACE_S = 1.0
EXIT_POLL_S = 0.02
RECEIVE_BYTES = 65536


@dataclass(frozen=True, slots=True)
class _Budget:
    """What the agent may take of its own time in one wait, and how the session ends when it takes more."""

    wait: Wait
    span_s: float
    outcome: Outcome
    missing: str

    def check(self) -> None:
        """Raise StopSession where the budget is spent. Time in which the agent had no core is not its own."""
        if self.wait.own_s() >= self.span_s:
            raise StopSession(
                self.outcome, f"{self.missing} within {self.span_s:g} s of the agent's own time"
            )


class TickServer:
    """Serves one agent.

    Every wait has a budget of the agent's own time and ends early when the agent's process ends.
    """

    def __init__(self, listener: socket.socket, clock: HostClock) -> None:
        self._listener = listener
        self._clock = clock
        self._agent_time = AgentTime(clock, AgentUsage)
        self._check_agent: Callable[[], None] = lambda: None
        self._peer: socket.socket | None = None
        self._buffer = b""

    @property
    def address(self) -> str:
        """host:port for the agent."""
        host, port = self._listener.getsockname()[:2]
        return f"{host}:{port}"

    def watch(self, check_agent: Callable[[], None], agent_time: AgentTime) -> None:
        """Set what is called while waiting, and the stopwatch of the waits.

        `check_agent` raises StopSession when the agent's process or the session's host time has ended.
        """
        self._check_agent, self._agent_time = check_agent, agent_time

    def hello(self, budget_s: float) -> Hello:
        """Wait for the agent to connect and to send its hello."""
        never = Outcome.AGENT_NEVER_CONNECTED
        budget = _Budget(Wait(self._agent_time), budget_s, never, "no connection to the tick socket")
        while self._peer is None:
            self._wait_readable(self._listener, budget)
            peer, _ = self._listener.accept()
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            peer.setblocking(False)
            self._peer = peer
        message = self._read(replace(budget, missing="no hello"))
        if not isinstance(message, Hello):
            raise StopSession(Outcome.AGENT_PROTOCOL, f"expected a hello, got {_shown(message)}")
        return message

    def exchange(self, tick: Tick, budget_s: float) -> Ack:
        """Send a tick and wait for its acknowledgement."""
        budget = _Budget(
            Wait(self._agent_time), budget_s, Outcome.AGENT_TIMEOUT, f"no answer to tick {tick.number}"
        )
        self._write(tick)
        message = self._read(budget)
        if not isinstance(message, Ack) or message.number != tick.number:
            raise StopSession(
                Outcome.AGENT_PROTOCOL, f"expected the ack of tick {tick.number}, got {_shown(message)}"
            )
        return message

    def end(self, reason: str) -> None:
        """Tell the agent that the session is over, if it is still connected."""
        if self._peer is not None:
            with suppress(OSError):
                self._peer.sendall(write_line(End(reason=reason)))
            self._peer.close()
            self._peer = None

    def _write(self, message: TickMessage) -> None:
        assert self._peer is not None
        try:
            self._peer.sendall(write_line(message))
        except OSError:
            self._end_disconnected()

    def _read(self, budget: _Budget) -> TickMessage | None:
        assert self._peer is not None
        while b"\n" not in self._buffer:
            if len(self._buffer) > MAX_LINE_BYTES:
                raise StopSession(
                    Outcome.AGENT_PROTOCOL, f"a line of more than {MAX_LINE_BYTES} bytes on the tick socket"
                )
            self._wait_readable(self._peer, budget)
            try:
                data = self._peer.recv(RECEIVE_BYTES)
            except OSError:
                data = b""
            if not data:
                self._end_disconnected()
            self._buffer += data
            # A line that comes byte by byte always has something to read.
            if b"\n" not in data and budget.wait.waited_s >= budget.span_s:
                budget.check()
        line, _, self._buffer = self._buffer.partition(b"\n")
        return read_line(line)

    def _wait_readable(self, sock: socket.socket, budget: _Budget) -> None:
        # A budget that is shorter than a few polls is still looked at several times. What is there already is
        # an answer in time, however late this process gets a core to read it.
        poll_s = min(LIVENESS_POLL_S, budget.span_s / 8)
        while not select.select([sock], [], [], poll_s)[0]:
            budget.check()
            self._check_agent()

    def _end_disconnected(self) -> NoReturn:
        # The process usually ends a moment after its socket: give it that moment, so that the exit code is
        # known.
        deadline_s = self._clock.now() + EXIT_GRACE_S
        while self._clock.now() < deadline_s:
            self._check_agent()
            self._clock.sleep(EXIT_POLL_S)
        raise StopSession(Outcome.AGENT_PROTOCOL, "the agent closed the tick socket and went on running")


@contextmanager
def open_tick_server(clock: HostClock = HOST_CLOCK) -> Generator[TickServer]:
    """Listen on a free loopback port; leaving the block closes everything."""
    with socket.create_server(("127.0.0.1", 0), backlog=1) as listener:
        server = TickServer(listener, clock)
        try:
            yield server
        finally:
            server.end("the session is over")


def _shown(message: TickMessage | None) -> str:
    return "a line that is no message" if message is None else f"{message.kind}"
