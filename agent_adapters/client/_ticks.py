"""The agent's connection to the session's clock, in lockstep."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from bench.errors import LinkLost

from ._protocol import MAX_LINE_BYTES, End, Tick, ack_line, hello_line, read_line

# The bench may take long to start a heavy world; it never falls silent for good without closing.
SILENCE_S = 600.0


class TickLine:
    """One connection to the session's clock."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._lines = connection.makefile("rb")
        self.malformed = 0

    def hello(self, agent: str, subscribes: Sequence[str], secret: str) -> None:
        """Say that everything is bound and subscribed. `secret` is the one in REBAR_TICK_SECRET."""
        self._send(hello_line(agent, subscribes, secret))

    def next(self) -> Tick | End:
        """Wait for the bench. A line that is not of the protocol is counted and passed over.

        Raises LinkLost when the bench closes without an End, or says nothing for `SILENCE_S` seconds of host
        time.
        """
        while True:
            try:
                # One byte more than allowed, so that a line that is too long can be told from one that just
                # fits.
                line = self._lines.readline(MAX_LINE_BYTES + 1)
            except OSError as error:
                raise LinkLost(f"the session's clock is gone: {error}") from error
            if not line:
                raise LinkLost("the session's clock closed without saying that it ends")
            message = read_line(line) if len(line) <= MAX_LINE_BYTES else None
            if isinstance(message, Tick | End):
                return message
            self.malformed += 1

    def ack(self, tick: Tick, topics: dict[str, int], links: dict[str, int]) -> None:
        """Tick dealt with; `topics` and `links` count what was sent since the start."""
        self._send(ack_line(tick.number, topics, links))

    def close(self) -> None:
        self._lines.close()

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
        line = TickLine(connection)
        try:
            yield line
        finally:
            line.close()
