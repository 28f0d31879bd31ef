"""Tricks with the tick socket. Those that break the protocol speak it by themselves, as the client never would."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterator
from contextlib import closing, suppress

from agent_adapters.client import AgentEnvironment, Bench

from ._cheat import Cheat

# Host time for the bench to say something: it ends such a session at once.
_SILENCE_S = 60.0
_STRANGERS = 4


class RawTicks:
    """A connection to the session's clock that sends what it is told to."""

    def __init__(self, environment: AgentEnvironment) -> None:
        assert environment.tick is not None
        self.secret = environment.tick_secret
        self._connection = socket.create_connection(environment.tick, _SILENCE_S)
        self._lines = self._connection.makefile("rb")

    def send(self, data: bytes) -> None:
        """Send bytes as they are. A bench that has closed the connection is no error."""
        with suppress(OSError):
            self._connection.sendall(data)

    def hello(self, secret: str | None = None) -> None:
        """Send a hello; with the session's secret when None."""
        secret = self.secret if secret is None else secret
        hello = {"kind": "hello", "protocol": 1, "agent": "cheat", "subscribes": [], "secret": secret}
        self.send(_line(hello))

    def kind(self) -> str:
        """What kind of message comes next; empty when the bench has closed, or sent none in time."""
        try:
            line = self._lines.readline()
        except OSError:
            return ""
        return str(json.loads(line)["kind"]) if line else ""

    def ticks(self) -> int:
        """How many ticks still come."""
        number = 0
        while self.kind() == "tick":
            number += 1
        return number

    def close(self) -> None:
        self._lines.close()
        self._connection.close()


ProtocolBreach = Callable[[RawTicks], int]
"""Breaks the protocol after the hello and the first tick. Returns what it gained: ticks that came afterwards."""


def acknowledge_ahead(line: RawTicks) -> int:
    """Acknowledges ticks that have not come yet.

    Time would run while it thinks, and none of its time would be counted.
    """
    # In one piece: one by one, the bench might send a tick between two of them before it notices.
    line.send(b"".join(_ack(number) for number in range(4)))
    return line.ticks()


def say_hello_twice(line: RawTicks) -> int:
    """Says hello once more in place of an acknowledgement.

    A second beginning might reset the session's clock or its counts.
    """
    line.hello()
    return line.ticks()


def send_nonsense(line: RawTicks) -> int:
    """Sends a line that is no message.

    A bench that stumbles over it ends with an error of its own, which does not count.
    """
    line.send(b'{"kind": "ack", "number": [[[\xff\n')
    return line.ticks()


def send_endless_line(line: RawTicks) -> int:
    """Sends a line without an end.

    A bench that waits for the end keeps all of it in memory.
    """
    for _ in range(64):
        line.send(b"x" * 65536)
    return line.ticks()


def skip_tick(line: RawTicks) -> int:
    """Acknowledges a later tick than the one that came.

    The ticks between would be over without a look at them.
    """
    line.send(_ack(7))
    return line.ticks()


def connect_strangers(cheat: Cheat) -> Iterator[None]:
    """Connects to the session's clock several times more, with the right secret and with wrong ones.

    Two agents in one session could share the work of one.
    """
    environment = cheat.bench.environment
    lines: list[RawTicks] = []
    for number in range(_STRANGERS):
        cheat.attempts += 1
        lines.append(RawTicks(environment))
        lines[-1].hello(None if number % 2 else "guessed")
    # The bench answers strangers while it waits for the agent.
    yield
    kinds = []
    for line in lines:
        with closing(line):
            kinds.append(line.kind())
    cheat.gains = {"ticks": kinds.count("tick")}
    yield


def breach(bench: Bench, trick: ProtocolBreach) -> int:
    """Say hello as agents do, take the first tick, and let the trick go on."""
    with closing(RawTicks(bench.environment)) as line:
        line.hello()
        line.kind()
        return trick(line)


def _ack(number: int) -> bytes:
    return _line({"kind": "ack", "number": number, "topics": {}, "links": {}})


def _line(document: dict[str, object]) -> bytes:
    return json.dumps(document).encode() + b"\n"
