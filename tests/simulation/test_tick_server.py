"""The tick socket serves the one program that bears its session's secret; strangers cost the agent nothing."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from bench.contracts import Hello, Outcome, Tick
from bench.simulation._stop_session import StopSession
from bench.simulation._tick_server import MAX_UNKNOWN, TickServer, open_tick_server

FIRST = Tick(number=0, time_ns=0)


@pytest.fixture
def server() -> Iterator[TickServer]:
    with open_tick_server() as opened:
        yield opened


class Peer:
    """One connection to the tick socket."""

    def __init__(self, server: TickServer) -> None:
        host, port = server.address.rsplit(":", 1)
        self.socket = socket.create_connection((host, int(port)))
        self._lines = self.socket.makefile("rb")

    def send(self, data: bytes) -> Peer:
        self.socket.sendall(data)
        return self

    def hello(self, **fields: str) -> Peer:
        return self.send(
            json.dumps({"kind": "hello", "protocol": 1, "agent": "mine", **fields}).encode() + b"\n"
        )

    def ack(self, number: int) -> Peer:
        return self.send(b'{"kind":"ack","number":%d,"topics":{},"links":{}}\n' % number)

    def line(self) -> dict[str, object]:
        """The next line of the bench; empty once it has closed."""
        try:
            line = self._lines.readline()
        except ConnectionError:
            line = b""
        return json.loads(line) if line else {}

    def close(self) -> None:
        self._lines.close()
        self.socket.close()


@pytest.fixture
def peers(server: TickServer) -> Iterator[Peers]:
    with ExitStack() as stack:
        yield Peers(server, stack)


class Peers:
    """Connects, and closes everything at the end of the test."""

    def __init__(self, server: TickServer, stack: ExitStack) -> None:
        self._server, self._stack = server, stack

    def connect(self) -> Peer:
        peer = Peer(self._server)
        self._stack.callback(peer.close)
        return peer


def test_strangers_before_the_agent_are_refused_and_the_agent_is_served(
    server: TickServer, peers: Peers
) -> None:
    """Garbage, a proper hello without the secret, one with a wrong secret, one that leaves and one that stays
    silent come first; then the agent, whose hello comes with the first ack in one packet.
    """
    garbage = peers.connect().send(b"GET / HTTP/1.1\r\n\r\n")
    polite = peers.connect().hello()
    guesser = peers.connect().hello(secret="0" * 32)
    peers.connect().close()
    silent = peers.connect()
    agent = peers.connect().hello(secret=server.secret).ack(0)

    assert server.hello(30.0) == Hello(agent="mine", secret=server.secret)
    assert server.exchange(FIRST, 30.0).number == 0
    assert agent.line()["kind"] == "tick"
    assert server.strangers == 5
    answers = {
        "a line that is no message": garbage.line(),
        "'mine' has no secret (REBAR_TICK_SECRET)": polite.line(),
        "'mine' has a wrong secret": guesser.line(),
        "no hello before the agent": silent.line(),
    }
    for words, answer in answers.items():
        assert (answer["kind"], words in str(answer["reason"])) == ("end", True), answer
    assert polite.line() == {}, "closed"


def test_strangers_after_the_agent_are_refused_while_it_is_served(server: TickServer, peers: Peers) -> None:
    """Two at once, one with a proper hello: both are told and closed, and the agent's acks go on counting."""
    agent = peers.connect().hello(secret=server.secret)
    server.hello(30.0)
    strangers = [peers.connect().hello(), peers.connect().send(b"\xff" * 1000)]
    for number in (0, 1, 2):
        agent.ack(number)
        assert server.exchange(Tick(number=number, time_ns=0), 30.0).number == number
        # An answer that is there is taken at once; the strangers get theirs in one of the waits.
    assert server.strangers == 2
    assert "the agent is connected already" in str(strangers[0].line()["reason"])


def test_a_stranger_who_knows_the_hello_is_not_the_agent_even_twice(server: TickServer, peers: Peers) -> None:
    """Only strangers come: the session ends as never connected, with their number and the last one's fault."""
    peers.connect().send(b"\n")
    peers.connect().hello(secret=server.secret[:-1])
    with pytest.raises(StopSession) as end:
        server.hello(0.4)
    assert end.value.outcome is Outcome.AGENT_NEVER_CONNECTED
    assert end.value.reason == (
        "no connection to the tick socket (2 strangers were refused, the last because its hello as 'mine' has "
        "a wrong secret (REBAR_TICK_SECRET)) within 0.4 s of the agent's own time"
    )


def test_a_crowd_of_silent_strangers_does_not_keep_the_agent_out(server: TickServer, peers: Peers) -> None:
    """More connections than are kept, some of which never say anything: the oldest go first."""
    crowd = [peers.connect() for _ in range(MAX_UNKNOWN - 1)]
    agent = peers.connect()
    crowd.append(peers.connect())
    agent.hello(secret=server.secret)
    assert server.hello(30.0).agent == "mine"
    assert server.strangers == len(crowd)


def test_a_first_line_without_an_end_is_bounded(server: TickServer, peers: Peers) -> None:
    """A stranger that writes on and on is cut off; what the agent says next is heard."""
    flood = peers.connect()
    flood.socket.settimeout(30.0)
    flood.send(b"x" * 65537)
    agent = peers.connect()
    agent.hello(secret=server.secret)
    server.hello(30.0)
    assert server.strangers == 1


def test_two_sessions_have_two_secrets() -> None:
    """The secret of one session opens no other."""
    with open_tick_server() as first, open_tick_server() as second, ExitStack() as stack:
        assert first.secret != second.secret
        Peers(second, stack).connect().hello(secret=first.secret)
        with pytest.raises(StopSession, match="a wrong secret"):
            second.hello(0.2)


def test_an_agent_that_waits_for_messages_hears_which_and_how_many(server: TickServer, peers: Peers) -> None:
    """A client that dropped frames answers never: the reason names each link that had messages, and the usual cause."""
    peers.connect().hello(secret=server.secret)
    server.hello(30.0)
    with pytest.raises(StopSession) as end:
        server.exchange(Tick(number=10, time_ns=0, links={"onboard": 214, "gcs": 37, "idle": 0}), 0.4)
    assert end.value.outcome is Outcome.AGENT_TIMEOUT
    head, hint = end.value.reason.split("; ", 1)
    assert head == "no answer to tick 10 within 0.4 s of the agent's own time"
    assert "sent so far: 37 on link 'gcs', 214 on link 'onboard'." in hint
    assert "frames that its dialect does not know" in hint
    assert "idle" not in hint
    # Nothing was sent, so nothing can have been miscounted.
    with pytest.raises(StopSession) as end:
        server.exchange(Tick(number=11, time_ns=0, links={"onboard": 0}), 0.4)
    assert end.value.reason.endswith("own time")
