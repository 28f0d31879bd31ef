"""The agent's connection to the session's clock, in lockstep or with `air: tick`."""

from __future__ import annotations

import select
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from bench.errors import LinkLost

from ._protocol import End, Tick, ack_line, hello_line, read_line

# The bench may take long to start a heavy world; it never falls silent for good without closing.
SILENCE_S = 600.0
RECEIVE_BYTES = 1 << 16


class TickLine:
    """One connection to the session's clock."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._buffer = bytearray()
        self.malformed = 0

    def hello(
        self, agent: str, subscribes: Sequence[str], secret: str, interval_s: float | None = None
    ) -> None:
        """Say that everything is bound and subscribed. `secret` is the one in REBAR_TICK_SECRET."""
        self._send(hello_line(agent, subscribes, secret, interval_s))

    def next(self) -> Tick | End:
        """Wait for the bench. A line that is not of the protocol is counted and passed over.

        Raises LinkLost when the bench closes without an End, or says nothing for `SILENCE_S` seconds of host
        time.
        """
        if (message := self.poll(SILENCE_S)) is None:
            raise LinkLost(f"the session's clock has been silent for {SILENCE_S:g} s")
        return message

    def poll(self, timeout_s: float) -> Tick | End | None:
        """As `next`, but None when nothing comes within `timeout_s` of host time."""
        while True:
            if (end := self._buffer.find(b"\n")) < 0:
                if not select.select([self._connection], [], [], timeout_s)[0]:
                    return None
                self._receive()
                continue
            line = bytes(self._buffer[: end + 1])
            del self._buffer[: end + 1]
            if (message := read_line(line)) is not None:
                return message
            self.malformed += 1

    def ack(
        self, tick: Tick, topics: dict[str, int], links: dict[str, int], air: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        """Tick dealt with; `topics` and `links` count what was sent since the start, `air` is what is published."""
        self._send(ack_line(tick.number, topics, links, air))

    def _receive(self) -> None:
        try:
            data = self._connection.recv(RECEIVE_BYTES)
        except OSError as error:
            raise LinkLost(f"the session's clock is gone: {error}") from error
        if not data:
            raise LinkLost("the session's clock closed without saying that it ends")
        self._buffer += data

    def _send(self, line: bytes) -> None:
        try:
            self._connection.sendall(line)
        except OSError as error:
            raise LinkLost(f"the session's clock is gone: {error}") from error


@contextmanager
def open_tick_line(address: tuple[str, int], timeout_s: float = 10.0) -> Iterator[TickLine]:
    """Connect to the session's clock. Raises LinkLost when nobody listens there."""
    try:
        connection = socket.create_connection(address, timeout_s)
    except OSError as error:
        raise LinkLost(
            f"the session's clock at {address[0]}:{address[1]} does not answer: {error}"
        ) from error
    with connection:
        # A tick and its acknowledgement are one small packet each; Nagle's algorithm would delay every round.
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.settimeout(SILENCE_S)
        yield TickLine(connection)
