"""The network of a worker: its own loopback, from which nothing of the host can be reached."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import anyio
import pytest
from host_servers import echo, server

from bench.campaign import Task, WorkerPlan, open_local_pool
from bench.contracts import Outcome, SessionResult
from bench.documents import dump_json
from bench.network_namespace import namespace_fault
from bench.simspec import SimSpec, load_simspec

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"

PROBE = """
import json, socket, sys
from bench.network_namespace import enter_network_namespace, namespace_fault, outside_socket
fault = enter_network_namespace()
assert namespace_fault() == fault
ports = json.loads(sys.argv[1])
def reached(make):
    found = []
    for port in ports:
        with make(socket.SOCK_STREAM) as client:
            try:
                client.connect(("127.0.0.1", port))
                found.append(port)
            except OSError:
                pass
    return found
own = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
here = [socket.create_connection(server.getsockname()).getpeername()[1] for server in own]
print(json.dumps({
    "fault": fault,
    "own": here == [server.getsockname()[1] for server in own],
    "host": reached(lambda kind: socket.socket(socket.AF_INET, kind)),
    "outside": reached(outside_socket),
}))
"""


@pytest.fixture(scope="module")
def namespace_refusal() -> str | None:
    """Why this host gives no network namespace; tried in a process of its own."""
    code = (
        "from bench.network_namespace import enter_network_namespace; print(enter_network_namespace() or '')"
    )
    probe = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return probe.stdout.strip() or None


def test_a_process_leaves_the_network_of_the_host(namespace_refusal: str | None) -> None:
    """Two servers of its own are reached, two of the host are not, and sockets from outside reach both of those.

    Where the host gives no namespace, the process is told why and shares the host's network.
    """
    with server(echo) as first, server(echo) as second:
        ports = [first, second]
        probe = subprocess.run(
            [sys.executable, "-c", PROBE, json.dumps(ports)], capture_output=True, text=True, check=True
        )
    report = json.loads(probe.stdout)
    assert report["own"]
    assert report["outside"] == ports
    assert report["fault"] == namespace_refusal
    assert report["host"] == ([] if namespace_refusal is None else ports)


def test_a_process_that_never_asked_is_on_the_network_of_the_host() -> None:
    """It says so, for the record of what confined an agent."""
    assert namespace_fault() is not None


def knock(simspec: SimSpec, decomposition: list[int], folder: Path, realization: str) -> SessionResult:
    """A job: tries the ports that stand in place of a decomposition."""
    reached = []
    for port in decomposition:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            reached.append(port)
    return SessionResult(realization=realization, outcome=Outcome.COMPLETED, reason=json.dumps(reached))


@pytest.mark.parametrize("own_network", [True, False])
def test_workers_have_networks_of_their_own_if_asked(
    tmp_path: Path, own_network: bool, namespace_refusal: str | None
) -> None:
    """Both of two workers."""
    document = tmp_path / "simspec.json"
    document.write_text(dump_json(load_simspec(EXAMPLE)))
    with server(echo) as one, server(echo) as other:
        ports = [one, other]
        plan = WorkerPlan(f"{__name__}:knock", ports, own_network)
        results: list[SessionResult] = []
        workers: list[str] = []

        async def fly_two() -> None:
            async def fly(name: str) -> None:
                results.append(await pool.fly(Task(name, document, tmp_path, 3600.0), workers.append))

            async with open_local_pool(plan, 2, tmp_path) as pool, anyio.create_task_group() as flights:
                for name in ("first", "second"):
                    flights.start_soon(fly, name)

        anyio.run(fly_two)
    assert len(set(workers)) == 2
    expected = [] if own_network and namespace_refusal is None else ports
    assert [json.loads(result.reason) for result in results] == [expected, expected]
