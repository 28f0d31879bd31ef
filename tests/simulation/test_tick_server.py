"""The tick socket serves the one program that bears its session's secret; strangers cost the agent nothing."""

from __future__ import annotations

import json
import select
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from threading import Thread

import pytest

from bench.contracts import AgentUsage, Hello, Outcome, Tick
from bench.simulation._agent_time import AgentTime
from bench.simulation._host_clock import HOST_CLOCK
from bench.simulation._stop_session import StopSession
from bench.simulation._tick_server import MAX_UNKNOWN, TickServer, open_tick_server

FIRST = Tick(number=0, time_ns=0)
ACK = b'{"kind":"ack","number":%d,"topics":{},"links":{}}\n'


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
        return self.send(hello_line("subscribes", **fields))

    def ack(self, number: int) -> Peer:
        return self.send(ACK % number)

    def line(self) -> dict[str, object]:
        """The next line of the bench; empty once it has closed."""
        try:
            line = self._lines.readline()
        except ConnectionError:
            line = b""
        return json.loads(line) if line else {}

    def answered(self, server: TickServer, tick: Tick) -> int:
        """The number of the ack that the bench takes for this tick, from an agent that answers once it has read it."""
        answer = Thread(target=lambda: self.ack(int(str(self.line()["number"]))))
        answer.start()
        try:
            return server.exchange(tick, 30.0).number
        finally:
            answer.join()

    def close(self) -> None:
        self._lines.close()
        self.socket.close()


Connect = Callable[[], Peer]


@pytest.fixture
def connect(server: TickServer) -> Iterator[Connect]:
    """Connects, and closes everything at the end of the test."""
    with ExitStack() as stack:
        yield lambda: stack.enter_context(closing(Peer(server)))


@pytest.fixture
def agent(server: TickServer, connect: Connect) -> Peer:
    """The agent, whose hello the bench has taken."""
    peer = connect().hello(secret=server.secret)
    assert server.hello(30.0) == Hello(agent="mine", secret=server.secret)
    return peer


def test_strangers_before_the_agent_are_refused_and_the_agent_is_served(
    server: TickServer, connect: Connect
) -> None:
    """Garbage, a proper hello without the secret, one with a wrong secret, one that leaves and one that stays
    silent come first; then the agent.
    """
    garbage = connect().send(b"GET / HTTP/1.1\r\n\r\n")
    polite = connect().hello()
    guesser = connect().hello(secret="0" * 32)
    connect().close()
    silent = connect()
    agent = connect().hello(secret=server.secret)

    assert server.hello(30.0) == Hello(agent="mine", secret=server.secret)
    assert agent.answered(server, FIRST) == 0
    assert server.strangers == 5
    answers = {
        "an HTTP request": garbage.line(),
        "'mine' has no secret (REBAR_TICK_SECRET)": polite.line(),
        "'mine' has a wrong secret": guesser.line(),
        "no hello before the agent": silent.line(),
    }
    for words, answer in answers.items():
        assert (answer["kind"], words in str(answer["reason"])) == ("end", True), answer
    assert polite.line() == {}, "closed"


def test_strangers_after_the_agent_are_refused_while_it_is_served(
    server: TickServer, connect: Connect, agent: Peer
) -> None:
    """Two at once, one with a proper hello: both are told and closed, and the agent's acks go on counting."""
    strangers = [connect().hello(), connect().send(b"\xff" * 1000)]
    for number in (0, 1, 2):
        assert agent.answered(server, Tick(number=number, time_ns=0)) == number
    assert server.strangers == 2
    assert "the agent is connected already" in str(strangers[0].line()["reason"])


def test_a_stranger_who_knows_the_hello_is_not_the_agent_even_twice(
    server: TickServer, connect: Connect
) -> None:
    """Only strangers come: the session ends as never connected, with their number and the last one's fault."""
    connect().send(b"\n")
    connect().hello(secret=server.secret[:-1])
    with pytest.raises(StopSession) as end:
        server.hello(0.4)
    assert end.value.outcome is Outcome.AGENT_NEVER_CONNECTED
    assert "2 strangers were refused on the tick socket, the last because its hello as" in end.value.reason
    assert end.value.reason.endswith("within 0.4 s of the agent's own time")


def hello_line(*without: str, **fields: object) -> bytes:
    whole = {"kind": "hello", "protocol": 1, "agent": "mine", "subscribes": ["/clock"], **fields}
    return json.dumps({name: whole[name] for name in whole if name not in without}).encode() + b"\n"


WRONG_HELLOS = {
    "a wrong secret": (hello_line(secret="0" * 32), "its hello as 'mine' has a wrong secret"),
    "a number as secret": (hello_line(secret=123456), "secret: Input should be a valid string"),
    "no agent": (hello_line("agent"), "a line of kind hello with faults: agent: Field required"),
    "another protocol": (hello_line(protocol=2), "protocol: Input should be 1"),
    "a text of topics": (hello_line(subscribes="/clock"), "subscribes: Input should be a valid"),
    "a number as topic": (hello_line(subscribes=["/clock", 7]), "subscribes.1: Input should be a valid"),
    "many faults": (hello_line(**dict.fromkeys("abcde", 0)), "a: Extra inputs are not permitted; b: Extra"),
    "no kind": (hello_line("kind"), "an object with no kind (kinds: ack, end, hello, tick)"),
    "another kind": (hello_line(kind="helo"), "an object with the kind 'helo' (kinds: ack, end,"),
    "an ack": (b'{"kind":"ack","number":0}\n', "it sent ack in place of a hello"),
    "a comma too many": (b'{"kind":"hello",}\n', "a line that is no JSON (Expecting property name"),
    "half a hello": (b'{"kind":"hello","protocol":1\n', "a line that is no JSON (Expecting ',' delimiter"),
    "a list": (b"[1, 2]\n", "JSON that is no object, but list"),
    "a number of 5000 digits": (b"1" * 5000 + b"\n", "a line that is no JSON (ValueError)"),
    "deep nesting": (b"[" * 60000 + b"\n", "a line that is no JSON (RecursionError)"),
    "an empty line": (b"\r\n", "it sent an empty line in place of a hello"),
    "latin-1": ('{"kind":"hello","agent":"für"}\n'.encode("latin-1"), "no UTF-8 text (byte 27)"),
    "HTTP": (b"POST /tick HTTP/1.1\r\nHost: bench\r\n\r\n", "an HTTP request (the tick socket takes one"),
    "TLS": (b"\x16\x03\x01\x02\x00\x01\x00\x0a", "the start of a TLS connection"),
    "too long": (b'{"kind":"hello","agent":"' + b"a" * 3_000_000, "its first line has more than 65536 bytes"),
    "a tab": (hello_line().replace(b'"kind": ', b'"kind":\t'), 'write the kind as "kind":"hello"'),
    "control characters": (hello_line(**{"\x1b[2J": 1}), "\\x1b[2J: Extra inputs"),
}


@pytest.mark.parametrize(("data", "words"), WRONG_HELLOS.values(), ids=WRONG_HELLOS)
def test_whoever_says_hello_wrong_is_told_what_is_wrong(
    server: TickServer, connect: Connect, data: bytes, words: str
) -> None:
    """On its connection before that closes, however much it still sends; and in the reason of the session. Neither
    repeats a secret.
    """
    peer = connect()
    sender = Thread(target=lambda: peer.send(data))
    sender.start()

    def ended() -> None:
        if server.strangers and not sender.is_alive():
            raise StopSession(Outcome.AGENT_CRASHED, "exit code 1")

    server.watch(ended, AgentTime(HOST_CLOCK, AgentUsage))
    with pytest.raises(StopSession) as end:
        server.hello(60.0)
    told = peer.line()
    assert told["kind"] == "end"
    assert words in str(told["reason"])
    assert str(told["reason"]).startswith("refused: it")
    assert str(told["reason"]).endswith("see docs/agents-protocol.md")
    assert peer.line() == {}, "closed"
    assert words in end.value.reason
    assert "\x1b" not in end.value.reason
    assert "0000" not in end.value.reason
    assert "123456" not in end.value.reason


def test_a_hello_that_never_ends_is_told_when_the_session_does(server: TickServer, connect: Connect) -> None:
    """Half a line waits for its end, since the rest may be under way."""
    half, silent = connect().send(hello_line()[:-1]), connect()
    with pytest.raises(StopSession) as end:
        server.hello(0.4)
    assert f"only {len(hello_line()) - 1} bytes without a line end" in end.value.reason
    server.end("the session is over")
    assert f"it sent {len(hello_line()) - 1} bytes without a line end" in str(half.line()["reason"])
    assert "it connected and said nothing" in str(silent.line()["reason"])


def crashed() -> None:
    raise StopSession(Outcome.AGENT_CRASHED, "exit code 3")


def test_an_agent_that_ends_after_a_wrong_hello_leaves_the_reason(
    server: TickServer, connect: Connect
) -> None:
    """It has ended before the bench has looked: what it said lies on the socket, and is named beside its exit code."""
    server.watch(crashed, AgentTime(HOST_CLOCK, AgentUsage))
    with pytest.raises(StopSession) as end:
        server.hello(30.0)
    assert end.value.reason == "exit code 3"
    connect().send(hello_line("agent"))
    with pytest.raises(StopSession) as end:
        server.hello(30.0)
    assert end.value.outcome is Outcome.AGENT_CRASHED
    assert end.value.reason.startswith(
        "exit code 3; 1 stranger was refused on the tick socket, the last because"
    )
    assert "agent: Field required" in end.value.reason


def test_a_line_that_is_no_ack_is_named(server: TickServer, agent: Peer) -> None:
    """The same words for a wrong answer to a tick."""

    def answer(data: bytes) -> str:
        thread = Thread(target=lambda: agent.line() and agent.send(data))
        thread.start()
        with pytest.raises(StopSession) as end:
            server.exchange(FIRST, 30.0)
        thread.join()
        assert end.value.outcome is Outcome.AGENT_PROTOCOL
        return end.value.reason

    assert answer(b'{"kind":"ack"}\n').endswith("got a line of kind ack with faults: number: Field required")
    assert answer(b'{"kind":"ack","number":7}\n').endswith("expected the ack of tick 0, got that of tick 7")
    assert answer(b"good morning\n").endswith("got a line that is no JSON (Expecting value, character 1)")
    server.end("the agent's fault")
    assert agent.line() == {"kind": "end", "reason": "the agent's fault"}


def test_a_crowd_of_silent_strangers_does_not_keep_the_agent_out(
    server: TickServer, connect: Connect
) -> None:
    """More connections than are kept, some of which never say anything: the oldest go first."""
    crowd = [connect() for _ in range(MAX_UNKNOWN - 1)]
    agent = connect()
    crowd.append(connect())
    agent.hello(secret=server.secret)
    assert server.hello(30.0).agent == "mine"
    assert server.strangers == len(crowd)


def test_a_first_line_without_an_end_is_bounded(server: TickServer, connect: Connect) -> None:
    """A stranger that writes on and on is cut off; what the agent says next is heard."""
    flood = connect()
    flood.socket.settimeout(30.0)
    flood.send(b"x" * 65537)
    connect().hello(secret=server.secret)
    server.hello(30.0)
    assert server.strangers == 1


def test_two_sessions_have_two_secrets(server: TickServer) -> None:
    with open_tick_server() as other:
        assert other.secret != server.secret


@pytest.mark.usefixtures("agent")
def test_an_agent_that_waits_for_messages_hears_which_and_how_many(server: TickServer) -> None:
    """A client that dropped frames answers never: the reason names each link that had messages, and the usual cause."""
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


def arrived(server: TickServer, count: int) -> None:
    """Wait until so many bytes of the agent lie on the bench's side: loopback delivers, but not in no time."""
    peer = server._peer
    assert peer is not None
    while not select.select([peer], [], [], 30.0)[0] or len(peer.recv(1 << 16, socket.MSG_PEEK)) < count:
        pass


@pytest.mark.parametrize(
    "ahead",
    [ACK % 1, ACK % 1 + ACK % 2 + ACK % 3, (ACK % 1)[:20], ACK % 7, b"\n"],
    ids=["one", "many", "half", "of another tick", "an empty line"],
)
def test_what_is_sent_ahead_of_its_tick_breaks_the_protocol(
    server: TickServer, agent: Peer, ahead: bytes
) -> None:
    """The agent answers the first tick as it should, and sends more before the second."""
    assert agent.answered(server, FIRST) == 0
    agent.send(ahead)
    arrived(server, len(ahead))
    with pytest.raises(StopSession) as end:
        server.exchange(Tick(number=1, time_ns=1), 30.0)
    assert end.value.outcome is Outcome.AGENT_PROTOCOL
    assert f"sent {len(ahead)} bytes on the tick socket before tick 1 was sent" in end.value.reason


@pytest.mark.parametrize("ahead", [ACK % 0, ACK % 0 + ACK % 1, (ACK % 0)[:-1]], ids=["one", "two", "half"])
def test_an_ack_in_one_packet_with_the_line_before_it_is_ahead(
    server: TickServer, connect: Connect, ahead: bytes
) -> None:
    """What came with the hello is in the server's own buffer, no longer on the socket."""
    connect().send(hello_line(secret=server.secret) + ahead)
    server.hello(30.0)
    with pytest.raises(StopSession, match=f"sent {len(ahead)} bytes .* before tick 0 was sent"):
        server.exchange(FIRST, 30.0)


def test_a_fast_agent_that_reads_its_ticks_is_never_ahead(server: TickServer, agent: Peer) -> None:
    """Acks in two pieces and in one, each sent the moment its tick is read, over many ticks."""

    def answer() -> None:
        while (line := agent.line()).get("kind") == "tick":
            whole = ACK % int(str(line["number"]))
            cut = len(whole) // 2 if line["number"] in (3, 4, 50) else 0
            agent.send(whole[:cut]).send(whole[cut:])

    thread = Thread(target=answer)
    thread.start()
    for number in range(200):
        assert server.exchange(Tick(number=number, time_ns=number), 30.0).number == number
    server.end("over")
    thread.join()


def test_an_agent_that_leaves_before_a_tick_is_not_ahead(server: TickServer, agent: Peer) -> None:
    """The end of the stream is readable too, and is no answer: the reason is what became of the agent."""
    assert agent.answered(server, FIRST) == 0
    agent.close()
    server.watch(crashed, AgentTime(HOST_CLOCK, AgentUsage))
    with pytest.raises(StopSession) as end:
        server.exchange(Tick(number=1, time_ns=1), 30.0)
    assert end.value.outcome is Outcome.AGENT_CRASHED
