"""What an agent reaches outside of its session on each rung, with two services let in and a third server that is not."""

from __future__ import annotations

import socket
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import service_flights
from host_image import PYTHON, image_or_skip
from host_servers import LOCALHOST, answer_page, echo, server
from own_network import call_in_own_network
from rungs import BARE, EVERY
from service_flights import OTHER_HOST

from bench.agents.confinement import Box, Wall, leaves_open, rungs, this_host
from bench.agents.confinement._landlock import namespaces_fault

HERE = Path(__file__).parent
ALWAYS = {"web", "raw"}
OWN_FILES = {"landlock", "container"}


def host_name() -> tuple[str, str] | None:
    """A name of this host other than localhost, and its address."""
    name = socket.gethostname()
    with suppress(OSError):
        return name, socket.gethostbyname(name)
    return None


@cache
def flights(own_network: bool) -> dict[str, dict[str, Any]]:
    """Of all rungs at once: the start of a process costs more than a session."""
    named = host_name()
    if named is None:
        pytest.skip("this host has no name that resolves")
    name, address = named
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        # Root gives the agent a user of its own only where that one can reach its folder.
        folder.chmod(0o755)
        port = stack.enter_context(server(answer_page, address))
        # Two services on one port, and a third server that nobody lets in.
        servers = [stack.enter_context(server(echo, OTHER_HOST, port)), stack.enter_context(server(echo))]
        arguments = (folder, _image(), [PYTHON, name, *map(str, servers)])
        if own_network:
            return call_in_own_network(folder, service_flights.flights, *arguments)
        return service_flights.flights(*arguments)


def _image() -> str:
    try:
        return image_or_skip()
    except pytest.skip.Exception:
        return ""


def flight(rung: str, own_network: bool) -> dict[str, Any]:
    flown = flights(own_network)[rung]
    if reason := flown.get("reason"):
        pytest.skip(reason)
    return flown


@pytest.mark.parametrize("own_network", [True, False])
@pytest.mark.parametrize("rung", [*EVERY, "container"])
def test_an_agent_reaches_its_services_and_nothing_else(rung: str, own_network: bool) -> None:
    """By their variables on every rung; by their usual addresses where the session has a network of its own, and by a
    name of the host where the agent has files of its own too. The server that is not let in is reached exactly where
    the table of the walls says that TCP is open.
    """
    flown = flight(rung, own_network)
    reached = {name for name, answer in flown["reached"].items() if answer is not None}
    isolation = "landlock" if rung == BARE else rung
    open_tcp = Wall.TCP in leaves_open(isolation, this_host(own_network=own_network))
    expected = set(ALWAYS)
    if own_network:
        expected |= {"raw by address"} | ({"web by name"} if rung in OWN_FILES else set())
        assert not open_tcp
    elif open_tcp:
        # The host's network itself, where the table says so. Engines copy the names of the host into a container.
        expected |= {"raw by address", "hidden"} | (set() if rung == "landlock" else {"web by name"})
    assert reached == expected
    assert {flown["reached"][name] for name in ALWAYS} == {"map", "ping"}
    assert flown["outcome"] == "completed"


@pytest.mark.parametrize("own_network", [True, False])
@pytest.mark.parametrize("rung", [*EVERY, "container"])
def test_what_went_over_each_service_is_counted(rung: str, own_network: bool) -> None:
    """Once for each way in which the agent came; a connection that it left open counts."""
    flown = flight(rung, own_network)
    web, raw = flown["uses"]
    ways = (
        {name for name, answer in flown["reached"].items() if answer is not None} if own_network else ALWAYS
    )
    assert (web["name"], raw["name"]) == ("web", "raw")
    assert web["connections"] == len(ways & {"web", "web by name"})
    assert raw["connections"] == len(ways & {"raw", "raw by address"})
    assert raw["bytes_sent"] == raw["bytes_received"] == 4 * raw["connections"]
    assert web["bytes_received"] == 60 * web["connections"]
    assert web["failed"] == raw["failed"] == web["refused"] == raw["refused"] == 0


def test_two_host_names_lead_into_the_box(tmp_path: Path) -> None:
    """As the C library looks them up, and before the names that every box has."""
    rung = rungs()["landlock"]
    if reason := namespaces_fault():
        pytest.skip(f"no namespaces here: {reason}")
    hosts = {"api.example.org": "127.0.0.2", "maps.example.org": "127.0.0.3", "agent": "127.0.0.4"}
    command = ("/usr/bin/getent", "ahostsv4", *hosts, "localhost")
    log = tmp_path / "output"
    with log.open("wb") as output:
        process = rung.start(Box(command, {}, tmp_path, hosts=hosts), output.fileno())
        while process.poll() is None:
            pass
        process.end()
    addresses = [line.split()[0] for line in log.read_text().splitlines() if "STREAM" in line]
    assert addresses == ["127.0.0.2", "127.0.0.3", "127.0.0.4", LOCALHOST]
