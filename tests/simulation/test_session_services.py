"""Services outside of the session: what is let in is reached, everything is counted, and nothing else is let in."""

from __future__ import annotations

import os
import random
import signal
import socket
import threading
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from fake_agents import agent_manifest
from host_servers import LOCALHOST, echo, server, shout
from pydantic import ValidationError
from test_session import run, session_simspec

from bench.contracts import Outcome, ServicesLetIn, ServiceUse
from bench.simspec import AgentSpec, Mission, OutsideService, load_simspec
from bench.simulation import session_faults
from bench.simulation._service_relay import MAX_CONNECTIONS
from bench.simulation._service_relays import open_services

# A host that hangs must not hang the tests; no result depends on it.
PATIENCE_S = 60.0


def service(name: str, port: int, host: str = LOCALHOST) -> OutsideService:
    return OutsideService(name=name, host=host, port=port)


def connect(endpoint: str) -> socket.socket:
    host, _, port = endpoint.rpartition(":")
    return socket.create_connection((host, int(port)), PATIENCE_S)


def ask(client: socket.socket, question: bytes) -> bytes:
    client.sendall(question)
    answer = b""
    while len(answer) < len(question):
        answer += client.recv(65536)
    return answer


class Used:
    """Keeps what the services were used for, once they have ended."""

    uses: tuple[ServiceUse, ...] = ()

    def __call__(self, services: ServicesLetIn) -> None:
        self.uses = services.uses

    def counts(self) -> list[tuple[int, int, int]]:
        """Connections, failed ones and refused ones of each service."""
        return [(use.connections, use.failed, use.refused) for use in self.uses]


@pytest.fixture
def used() -> Used:
    return Used()


def test_two_services_and_their_counts(used: Used) -> None:
    """Each variable leads to its own service; the bytes are the agent's, to the last one."""
    with server(echo) as first, server(shout) as second:
        services = (service("first", first), service("far-map", second, "localhost"))
        with open_services(services, used) as opened:
            assert set(opened.endpoints) == {"REBAR_SERVICE_FIRST", "REBAR_SERVICE_FAR_MAP"}
            with (
                connect(opened.endpoints["REBAR_SERVICE_FIRST"]) as client,
                connect(opened.endpoints["REBAR_SERVICE_FAR_MAP"]) as reader,
                connect(opened.endpoints["REBAR_SERVICE_FAR_MAP"]) as reader_2,
            ):
                assert ask(client, b"abc") == b"abc"
                assert ask(reader, b"hello") == b"HELLO"
                assert ask(reader_2, b"you") == b"YOU"
                assert ask(client, b"de") == b"de"
            endpoints = tuple(opened.endpoints.values())
    assert [use.name for use in used.uses] == ["first", "far-map"]
    assert used.counts() == [(1, 0, 0), (2, 0, 0)]
    assert [(use.bytes_sent, use.bytes_received) for use in used.uses] == [(5, 5), (8, 8)]
    for endpoint in endpoints:
        with pytest.raises(ConnectionRefusedError):
            connect(endpoint)


def test_more_bytes_than_any_buffer_holds(used: Used) -> None:
    """Four megabytes to a server that sends all of them back, read only after half is sent; the end travels too."""
    data = random.Random(1).randbytes(4 << 20)
    with server(echo) as far, open_services((service("far", far),), used) as opened:
        with connect(*opened.endpoints.values()) as client:

            def send() -> None:
                client.sendall(data)
                client.shutdown(socket.SHUT_WR)

            sender = threading.Thread(target=send)
            sender.start()
            received = bytearray()
            while part := client.recv(1 << 20):
                received += part
            sender.join()
        assert received == data
    assert used.uses[0].bytes_sent == used.uses[0].bytes_received == len(data)


def test_a_service_that_goes_away_is_counted_and_the_other_goes_on(used: Used) -> None:
    """The agent sees a reset, not a regular end, and so does it where too many connections are open."""
    with server(echo) as stays, ExitStack() as stack:
        with server(echo) as down:
            opened = stack.enter_context(
                open_services((service("gone", down), service("stays", stays)), used)
            )
        away, here = opened.endpoints.values()
        for _ in range(2):
            with pytest.raises(ConnectionResetError), connect(away) as client:
                client.recv(1)
        clients = [connect(here) for _ in range(MAX_CONNECTIONS)]
        # Answered, and so counted as open, before the one too many comes.
        assert [ask(client, b"x") for client in clients] == [b"x"] * MAX_CONNECTIONS
        with pytest.raises(ConnectionResetError), connect(here) as client:
            client.recv(1)
        for client in clients:
            client.close()
    assert used.counts() == [(0, 2, 0), (MAX_CONNECTIONS, 0, 1)]


def test_what_is_open_at_the_end_is_closed(used: Used) -> None:
    """On both sides, and what was said before is counted."""
    with server(echo) as far:
        with open_services((service("far", far),), used) as opened:
            client = connect(*opened.endpoints.values())
            assert ask(client, b"still here") == b"still here"
        with client:
            assert client.recv(1) == b""
    assert used.counts() == [(1, 0, 0)]
    assert used.uses[0].bytes_sent == 10


def test_a_lost_process_refuses_the_agent_and_costs_the_counts(used: Used) -> None:
    """An unconfined agent can kill it: nobody listens then, and no count is made up."""
    with server(echo) as first, server(shout) as second, ExitStack() as stack:
        opened = stack.enter_context(
            open_services((service("first", first), service("second", second)), used)
        )
        client = stack.enter_context(connect(opened.endpoints["REBAR_SERVICE_FIRST"]))
        assert ask(client, b"abc") == b"abc"
        os.kill(relay_pid(), signal.SIGKILL)
        # Its sockets are closed with it, not later.
        assert client.recv(1) == b""
        for endpoint in opened.endpoints.values():
            with pytest.raises(ConnectionRefusedError):
                connect(endpoint)
    assert [use.counted for use in used.uses] == [False, False]
    assert str(used.uses[1]) == f"second (127.0.0.1:{second}), not counted"


def relay_pid() -> int:
    """The process among our children that carries connections."""
    pids: list[str] = []
    for task in Path("/proc/self/task").iterdir():
        # A thread of an earlier test may end meanwhile.
        with suppress(FileNotFoundError):
            pids += (task / "children").read_text().split()
    (relay,) = (pid for pid in pids if b"_service_relay" in Path(f"/proc/{pid}/cmdline").read_bytes())
    return int(relay)


def test_what_cannot_be_reached_is_said_before_the_flight(tmp_path: Path) -> None:
    """One that is down and one without an address, beside one that answers; before a campaign and before a session."""
    # Bound and not listening: nobody else gets the port, and it refuses connections.
    with socket.socket() as silent, server(echo) as up:
        silent.bind(("127.0.0.1", 0))
        port = silent.getsockname()[1]
        services = (
            service("down", port),
            service("lost", 80, "no-such-host.invalid"),
            service("up", up),
        )
        spec = session_simspec(agent=AgentSpec(manifest="fake", services=services))
        texts = [str(fault) for fault in session_faults(spec, agent_manifest("idle"))]
        end, records = run(tmp_path, agent_manifest("idle"), spec)
    assert len(texts) == 2
    assert texts[0].startswith(
        f"agent.services[down]: 127.0.0.1:{port} does not answer: Connection refused (start"
    )
    # Where no server of names answers, the look-up itself takes too long.
    assert texts[1].startswith("agent.services[lost]: no-such-host.invalid:80 ")
    assert "the name does not resolve" in texts[1] or "does not answer within" in texts[1]
    assert end.outcome is Outcome.SETUP_INVALID
    assert end.reason == "\n".join(texts)
    assert not records


def test_a_service_that_nobody_asks_changes_no_record(tmp_path: Path) -> None:
    """And its use is told all the same."""
    with server(echo) as first, server(echo) as second:
        services = (service("first", first), service("second", second))
        agent, mission = AgentSpec(manifest="fake", services=services), Mission(time_limit_s=1.0)
        served = session_simspec(agent=agent, mission=mission)
        end, records = run(tmp_path / "with", agent_manifest("idle"), served)
    plain = session_simspec(mission=mission)
    alone, unserved = run(tmp_path / "without", agent_manifest("idle"), plain)
    assert records == unserved
    assert end.outcome is alone.outcome is Outcome.TIME_LIMIT
    told = end.fact(ServicesLetIn)
    assert told is not None
    assert [(use.connections, use.bytes_sent) for use in told.uses] == [(0, 0), (0, 0)]
    assert alone.fact(ServicesLetIn) in (None, ServicesLetIn(uses=()))


@pytest.mark.parametrize(
    ("services", "words"),
    [
        ([("a-b", "x.org", 1), ("a_b", "y.org", 1)], "give one variable, REBAR_SERVICE_A_B"),
        ([("a", "X.org", 1), ("b", "x.org", 1)], "are both x.org:1"),
        ([("a", "localhost", 1), ("b", "127.0.0.1", 1)], "are both localhost:1"),
        ([("a", "https://x.org", 1)], "without http://"),
        ([("a", "x.org 127.0.0.1", 1)], "neither a host name"),
        ([("a", "x.org\n10.0.0.1 y.org", 1)], "neither a host name"),
        ([("a", "127.1", 1)], "neither a host name"),
        ([("a", "x" * 64, 1)], "neither a host name"),
        ([("a", "x.org", 0)], "greater than or equal to 1"),
        ([("A", "x.org", 1)], "pattern"),
    ],
)
def test_services_that_cannot_be_meant_are_refused(services: list[tuple[str, str, int]], words: str) -> None:
    """Each with its field; what would be more than one line of /etc/hosts above all."""
    with pytest.raises(ValidationError, match=words):
        AgentSpec(services=tuple(service(name, port, host) for name, host, port in services))


def test_documents_without_services_are_as_they_were(tmp_path: Path) -> None:
    """Digests of published situations hold; a file with two services is read."""
    assert "services" not in AgentSpec().model_dump_json()
    path = tmp_path / "simspec.yaml"
    example = Path(__file__).parents[2] / "examples" / "search.yaml"
    spec = load_simspec(example)
    services = (service("llm", 443, "api.example.org"), service("map", 8080, "::1"))
    path.write_text(spec.model_copy(update={"agent": AgentSpec(services=services)}).model_dump_json())
    assert load_simspec(path).agent.services == services
