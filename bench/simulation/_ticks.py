"""The bench's side of the lockstep socket. The protocol stands in bench/contracts/_tick.py."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress

from bench.contracts import MAX_LINE_BYTES, Ack, End, Hello, Outcome, Tick, TickMessage, read_line, write_line

from ._ending import StopSession

LIVENESS_POLL_S = 0.25  # how often a wait looks whether the agent still lives


class TickServer:
    """Serves one agent. Every wait has a budget on the host's monotonic clock and notices an agent that has ended."""

    def __init__(self, listener: socket.socket, alive: Callable[[], None]) -> None:
        self._listener = listener
        self._alive = alive
        self._peer: socket.socket | None = None
        self._buffer = b""

    @property
    def address(self) -> str:
        """host:port for the agent."""
        host, port = self._listener.getsockname()[:2]
        return f"{host}:{port}"

    def watch(self, alive: Callable[[], None]) -> None:
        """Set what is called while waiting; it raises StopSession when there is nobody to wait for."""
        self._alive = alive

    def hello(self, budget_s: float) -> Hello:
        """Wait for the agent to connect and introduce itself."""
        deadline = time.monotonic() + budget_s
        while self._peer is None:
            self._wait_readable(
                self._listener, deadline, Outcome.AGENT_NEVER_CONNECTED, f"no connection to the tick socket within {budget_s:g} s"
            )
            peer, _ = self._listener.accept()
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            peer.setblocking(False)
            self._peer = peer
        message = self._read(deadline, Outcome.AGENT_NEVER_CONNECTED, f"no hello within {budget_s:g} s")
        if not isinstance(message, Hello):
            raise StopSession(Outcome.AGENT_PROTOCOL, f"expected a hello, got {_shown(message)}")
        return message

    def exchange(self, tick: Tick, budget_s: float) -> Ack:
        """Send a tick and wait for its acknowledgement."""
        self._write(tick)
        deadline = time.monotonic() + budget_s
        message = self._read(deadline, Outcome.AGENT_TIMEOUT, f"no answer to tick {tick.number} within {budget_s:g} s")
        if not isinstance(message, Ack) or message.number != tick.number:
            raise StopSession(Outcome.AGENT_PROTOCOL, f"expected the ack of tick {tick.number}, got {_shown(message)}")
        return message

    def end(self, reason: str) -> None:
        """Say that the session is over, if anybody listens."""
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
            self._gone()

    def _read(self, deadline: float, outcome: Outcome, reason: str) -> TickMessage | None:
        assert self._peer is not None
        while b"\n" not in self._buffer:
            if len(self._buffer) > MAX_LINE_BYTES:
                raise StopSession(Outcome.AGENT_PROTOCOL, f"a line of more than {MAX_LINE_BYTES} bytes on the tick socket")
            self._wait_readable(self._peer, deadline, outcome, reason)
            try:
                data = self._peer.recv(65536)
            except OSError:
                data = b""
            if not data:
                self._gone()
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        return read_line(line)

    def _wait_readable(self, sock: socket.socket, deadline: float, outcome: Outcome, reason: str) -> None:
        while True:
            left = deadline - time.monotonic()
            if left <= 0:
                raise StopSession(outcome, reason)
            if select.select([sock], [], [], min(left, LIVENESS_POLL_S))[0]:
                return
            self._alive()

    def _gone(self) -> None:
        # The process usually ends a moment after its socket: give it that moment, so that the exit code is known.
        deadline = time.monotonic() + 1.0
        while time.monotonic() < deadline:
            self._alive()
            time.sleep(0.02)
        raise StopSession(Outcome.AGENT_PROTOCOL, "the agent closed the tick socket and went on running")


@contextmanager
def open_tick_server() -> Generator[TickServer]:
    """Listen on a free loopback port; leaving the block closes everything."""
    with socket.create_server(("127.0.0.1", 0), backlog=1) as listener:
        server = TickServer(listener, alive=lambda: None)
        try:
            yield server
        finally:
            server.end("the session is over")


def _shown(message: TickMessage | None) -> str:
    return "a line that is no message" if message is None else f"{message.kind}"
