"""The bench's side of the lockstep socket. bench/contracts/_tick.py describes the protocol."""

from __future__ import annotations

import secrets
import select
import socket
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from hmac import compare_digest
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
    line_fault,
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
EXIT_GRACE_S = 10.0
EXIT_POLL_S = 0.02
RECEIVE_BYTES = 65536
# Connections that may be open without having said anything. Chosen: far more than one agent needs.
MAX_UNKNOWN = 128
# What a refused connection may still send before it is closed. Chosen, not measured: many times the longest line.
MAX_DRAINED_BYTES = 4 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class _Budget:
    """What the agent may take of its own time in one wait, and how the session ends when it takes more."""

    wait: Wait
    span_s: float
    outcome: Outcome
    missing: str
    hint: str = ""

    def check(self) -> None:
        """Raise StopSession where the budget is spent. Time in which the agent had no core is not its own."""
        if self.wait.own_s() >= self.span_s:
            raise StopSession(
                self.outcome,
                f"{self.missing} within {self.span_s:g} s of the agent's own time{self.hint}",
            )


class TickServer:
    """Serves one agent: the program whose hello bears the session's secret, which only its agent was given.

    Every other connection is a stranger's: refused, counted, and no matter to the session. Every wait has a
    budget of the agent's own time and ends early when the agent's process ends. Whoever is refused is told why, and so
    is the reason of a session that ends without a hello: often the stranger is the agent, which says it wrong.
    """

    def __init__(
        self, listener: socket.socket, clock: HostClock, secret: str, max_line_bytes: int = MAX_LINE_BYTES
    ) -> None:
        self.secret = secret
        self.strangers = 0
        self.last_stranger = ""
        """Why the last stranger was refused; empty without one."""
        # Strangers may leave before they are accepted, and an accept that waits for the next would never end.
        listener.setblocking(False)
        self._listener = listener
        self._max_line_bytes = max_line_bytes
        self._clock = clock
        self._agent_time = AgentTime(clock, AgentUsage)
        self._check_agent: Callable[[], None] = lambda: None
        self._peer: socket.socket | None = None
        self._buffer = b""
        # What of a line the connection has not taken yet.
        self._unsent = b""
        # Connections without a whole first line yet, the oldest first.
        self._unknown: dict[socket.socket, bytes] = {}
        # Refused connections, with the bytes that came since: closed with something unread, a connection is reset, and a
        # program that still writes never reads why.
        self._leaving: dict[socket.socket, int] = {}

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
        wait = self._agent_time.wait()
        poll_s = min(LIVENESS_POLL_S, budget_s / 8)
        looked_s = 0.0
        while True:
            readable = self._readable(poll_s)
            if (hello := self._hello_from(readable)) is not None:
                return hello
            # Strangers who talk without end must not keep the session from looking at its agent.
            if not readable or wait.waited_s - looked_s >= poll_s:
                looked_s = wait.waited_s
                _Budget(wait, budget_s, Outcome.AGENT_NEVER_CONNECTED, self._missing_hello()).check()
                self._check_agent_before_hello()

    def _readable(self, poll_s: float) -> list[socket.socket]:
        return select.select([self._listener, *self._unknown, *self._leaving], [], [], poll_s)[0]

    def _hello_from(self, readable: list[socket.socket]) -> Hello | None:
        """Take in what has come; the agent's hello if it is among it."""
        for connection in readable:
            if connection is self._listener:
                self._accept_unknown()
            elif connection in self._leaving:
                self._drain(connection)
            elif connection in self._unknown and (hello := self._read_unknown(connection)) is not None:
                return hello
        return None

    def _check_agent_before_hello(self) -> None:
        try:
            self._check_agent()
        except StopSession as end:
            # What it said before it ended lies on the socket: its connection, and then the line.
            for _ in range(2):
                self._hello_from(self._readable(0.0))
            refused = self._refused_strangers()
            raise StopSession(end.outcome, f"{end.reason}; {refused}" if refused else end.reason) from None

    def _missing_hello(self) -> str:
        missing = "no hello on the tick socket" if self._unknown else "no connection to the tick socket"
        if begun := max((len(data) for data in self._unknown.values()), default=0):
            missing += f", only {begun} bytes without a line end"
        refused = self._refused_strangers()
        return f"{missing} ({refused})" if refused else missing

    def _refused_strangers(self) -> str:
        if not self.strangers:
            return ""
        refused = "1 stranger was" if self.strangers == 1 else f"{self.strangers} strangers were"
        return f"{refused} refused on the tick socket, the last because {self.last_stranger}"

    def _accept_unknown(self) -> None:
        with suppress(OSError):  # gone again already
            connection, _ = self._listener.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setblocking(False)
            self._unknown[connection] = b""
        if len(self._unknown) > MAX_UNKNOWN:
            # The agent says hello as soon as it is connected, so the oldest silent one is not the agent.
            self._refuse(next(iter(self._unknown)), "it connected and said nothing")

    def _read_unknown(self, connection: socket.socket) -> Hello | None:
        """Read on a connection whose other end is not known yet; its hello if it is the agent's."""
        try:
            data = connection.recv(RECEIVE_BYTES)
        except OSError:
            data = b""
        self._unknown[connection] += data
        line, newline, rest = self._unknown[connection].partition(b"\n")
        if not newline:
            if not data:
                self._refuse(connection, "it closed without a hello")
            elif len(line) > MAX_LINE_BYTES:
                self._refuse(connection, f"its first line has more than {MAX_LINE_BYTES} bytes")
            return None
        message = read_line(line)
        if not isinstance(message, Hello):
            self._refuse(connection, f"it sent {_shown(message, line)} in place of a hello")
        elif not compare_digest(message.secret.encode(), self.secret.encode()):
            kind = "a wrong secret" if message.secret else "no secret"
            self._refuse(connection, f"its hello as {message.agent!r} has {kind} (REBAR_TICK_SECRET)")
        else:
            del self._unknown[connection]
            self._peer, self._buffer = connection, rest
            while self._unknown:
                self._refuse(next(iter(self._unknown)), "it said no hello before the agent did")
            return message
        return None

    def _refuse(self, connection: socket.socket, reason: str) -> None:
        self._unknown.pop(connection, None)
        self.strangers += 1
        self.last_stranger = reason
        # The reason helps whoever wrote an agent that does not send the secret yet.
        _say_last(connection, f"refused: {reason}; see docs/agents-protocol.md")
        self._leaving[connection] = 0
        if len(self._leaving) > MAX_UNKNOWN:
            self._leave(next(iter(self._leaving)))

    def _drain(self, connection: socket.socket) -> None:
        """Discard what a refused connection still sends; close it when it ends, or has sent too much."""
        try:
            data = connection.recv(RECEIVE_BYTES)
        except OSError:
            data = b""
        self._leaving[connection] += len(data)
        if not data or self._leaving[connection] > MAX_DRAINED_BYTES:
            self._leave(connection)

    def _leave(self, connection: socket.socket) -> None:
        del self._leaving[connection]
        connection.close()

    def exchange(self, tick: Tick, budget_s: float) -> Ack:
        """Send a tick and wait for its acknowledgement."""
        self._check_silence(tick.number)
        budget = _Budget(
            self._agent_time.wait(),
            budget_s,
            Outcome.AGENT_TIMEOUT,
            f"no answer to tick {tick.number}",
            _count_hint(tick.links),
        )
        self._write(tick, budget)
        return _ack_in(self._read(budget), tick.number)

    def poll_hello(self) -> Hello | None:
        """The agent's hello if it has come by now."""
        # Strangers who talk without end get no more than this of a step.
        for _ in range(MAX_UNKNOWN):
            if not (readable := self._readable(0.0)):
                return None
            if (hello := self._hello_from(readable)) is not None:
                return hello
        return None

    def missing_hello(self, span_s: float) -> StopSession:
        """The end of a session whose agent has not said hello within `span_s`."""
        return StopSession(Outcome.AGENT_NEVER_CONNECTED, f"{self._missing_hello()} within {span_s:g} s")

    def post(self, tick: Tick) -> None:
        """Hand over a tick without waiting for anything; `flush` sends it."""
        self._check_silence(tick.number)
        self._unsent += write_line(tick)

    def flush(self) -> bool:
        """Send as much as the connection takes by now; whether it took anything."""
        assert self._peer is not None
        try:
            sent = self._peer.send(self._unsent) if self._unsent else 0
        except BlockingIOError:
            return False
        except OSError:  # it has closed, which `poll_ack` tells
            sent = len(self._unsent)
        self._unsent = self._unsent[sent:]
        return sent > 0

    def poll_ack(self, number: int) -> Ack | None:
        """The acknowledgement of tick `number` if it has come by now. Raises EOFError where the agent has closed its socket."""
        assert self._peer is not None
        self._serve_strangers(self._readable(0.0))
        while b"\n" not in self._buffer:
            self._check_line_length()
            try:
                data = self._peer.recv(RECEIVE_BYTES)
            except BlockingIOError:
                return None
            except OSError:
                data = b""
            if not data:
                raise EOFError
            self._buffer += data
        return _ack_in(self._next_line(), number)

    def end(self, reason: str) -> None:
        """Tell the agent that the session is over, if it is still connected."""
        if self._peer is not None:
            # A reason in the middle of a line would be none.
            if not self._unsent:
                _say_last(self._peer, reason)
            self._peer.close()
            self._peer = None
        while self._unknown:
            connection, data = next(iter(self._unknown.items()))
            said = (
                f"it sent {len(data)} bytes without a line end" if data else "it connected and said nothing"
            )
            self._refuse(connection, said)
        while self._leaving:
            self._leave(next(iter(self._leaving)))

    def _check_silence(self, number: int) -> None:
        """Raise StopSession where the agent has sent something that the bench has not asked for yet.

        An agent that answers ahead acts without what the tick will tell, and none of its own time is counted.
        """
        assert self._peer is not None
        ahead = self._buffer
        # Not recv: what is left on the socket may be its end, which has reasons of its own.
        with suppress(OSError):
            ahead += self._peer.recv(RECEIVE_BYTES, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        if ahead:
            raise StopSession(
                Outcome.AGENT_PROTOCOL,
                f"the agent sent {len(ahead)} bytes on the tick socket before tick {number} was sent; after its hello and "
                "after each ack it stays silent until it has read the next tick (docs/time.md)",
            )

    def _write(self, message: TickMessage, budget: _Budget) -> None:
        assert self._peer is not None
        self._unsent = write_line(message)
        while self._unsent:
            try:
                self._unsent = self._unsent[self._peer.send(self._unsent) :]
            except BlockingIOError:
                # A line with pictures is longer than what a connection holds: the agent has to read meanwhile.
                self._wait_for(self._peer, budget, to_write=True)
            except OSError:
                self._end_disconnected()

    def _read(self, budget: _Budget) -> bytes:
        """The agent's next line, without its end."""
        assert self._peer is not None
        while b"\n" not in self._buffer:
            self._check_line_length()
            self._wait_for(self._peer, budget)
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
        return self._next_line()

    def _check_line_length(self) -> None:
        if len(self._buffer) > self._max_line_bytes:
            raise StopSession(
                Outcome.AGENT_PROTOCOL,
                f"a line of more than {self._max_line_bytes} bytes on the tick socket",
            )

    def _next_line(self) -> bytes:
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line

    def _serve_strangers(self, readable: list[socket.socket]) -> None:
        for connection in readable:
            if connection in self._leaving:
                self._drain(connection)
        if self._listener in readable:
            self._accept_unknown()
            while self._unknown:
                self._refuse(next(iter(self._unknown)), "the agent is connected already")

    def _wait_for(self, sock: socket.socket, budget: _Budget, *, to_write: bool = False) -> None:
        # A budget that is shorter than a few polls is still looked at several times. What is there already is
        # an answer in time, however late this process gets a core to read it.
        poll_s = min(LIVENESS_POLL_S, budget.span_s / 8)
        while True:
            others = [self._listener, *self._leaving]
            reading, writing = (others, [sock]) if to_write else ([sock, *others], [])
            readable, writable, _ = select.select(reading, writing, [], poll_s)
            self._serve_strangers(readable)
            if sock in readable or writable:
                return
            if not readable or budget.wait.waited_s >= budget.span_s:
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
def open_tick_server(
    clock: HostClock = HOST_CLOCK, max_line_bytes: int = MAX_LINE_BYTES
) -> Generator[TickServer]:
    """Listen on a free loopback port; leaving the block closes everything."""
    # A backlog, so that strangers who connect first do not keep the agent's connection out.
    with socket.create_server(("127.0.0.1", 0), backlog=MAX_UNKNOWN) as listener:
        server = TickServer(listener, clock, secrets.token_urlsafe(24), max_line_bytes)
        try:
            yield server
        finally:
            server.end("the session is over")


def _ack_in(line: bytes, number: int) -> Ack:
    message = read_line(line)
    if isinstance(message, Ack) and message.number == number:
        return message
    got = f"that of tick {message.number}" if isinstance(message, Ack) else _shown(message, line)
    raise StopSession(Outcome.AGENT_PROTOCOL, f"expected the ack of tick {number}, got {got}")


def _count_hint(links: Mapping[str, int]) -> str:
    """What to check first where an agent does not answer: one that misses a message waits for it, and says nothing."""
    sent = [f"{count} on link {link!r}" for link, count in sorted(links.items()) if count]
    if not sent:
        return ""
    return (
        f"; the tick stated the MAVLink messages sent so far: {', '.join(sent)}. An agent that has counted fewer waits "
        "for the rest: usually its client drops frames that its dialect does not know. Count frames, not decoded "
        "messages (docs/time.md)"
    )


def _say_last(connection: socket.socket, reason: str) -> None:
    """Tell a connection why it ends. What comes after it is the end of the stream."""
    with suppress(OSError):
        connection.send(write_line(End(reason=reason)))
        connection.shutdown(socket.SHUT_WR)


def _shown(message: TickMessage | None, line: bytes) -> str:
    return line_fault(line) if message is None else f"{message.kind}"
