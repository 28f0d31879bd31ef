"""What an agent reaches outside of its session on each rung, with two services let in and a third server that is not."""

from __future__ import annotations

import json
import socket
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from host_image import PYTHON, image_or_skip
from host_servers import LOCALHOST, answer_page, echo, server
from own_network import call_in_own_network
from rungs import BARE, EVERY, rung_or_skip

from bench.agents import open_agent
from bench.agents.confinement import Box, Wall, leaves_open, rungs, this_host
from bench.agents.confinement._landlock import namespaces_fault
from bench.campaign.execution._flight import AgentStarter
from bench.contracts import AgentManifest, Record, ServicesLetIn
from bench.simspec import (
    ActorGroup,
    AgentSpec,
    Budgets,
    Home,
    Mission,
    OutsideService,
    Pace,
    PlacedActor,
    Point,
    Polygon,
    Realized,
    Role,
    SimSpec,
    VehicleSpec,
    World,
)
from bench.simulation import SessionPlan, run_session

ALWAYS = {"web", "raw"}
OWN_FILES = {"landlock", "container"}


OTHER_HOST = "127.0.0.9"
AGENT = """
import http.client, json, os, socket, sys, time
host, other, port, hidden = *sys.argv[1:3], *map(int, sys.argv[3:])
answers = {}
def attempt(name, ask, *address):
    try:
        answers[name] = ask(*address)
    except OSError as error:
        answers[name] = None
def page(host, port):
    client = http.client.HTTPConnection(host, port, timeout=20)
    client.request("GET", "/")
    return client.getresponse().read().decode()
def echo(host, port):
    # Left open: the session ends under it.
    global kept
    kept = socket.create_connection((host, port), 20)
    kept.sendall(b"ping")
    return kept.recv(9).decode()
def given(name):
    host, _, port = os.environ["REBAR_SERVICE_" + name].rpartition(":")
    return host, int(port)
attempt("web", page, *given("WEB"))
attempt("web by name", page, host, port)
attempt("raw", echo, *given("RAW"))
attempt("raw by address", echo, other, port)
attempt("hidden", echo, "127.0.0.1", hidden)
# Who ends before the session's first step has flown nothing and counts as crashed. The model has no link that would tell.
time.sleep(1)
print(json.dumps(answers))
"""


def all_flown(folder: Path, image: str, words: list[str]) -> dict[str, dict[str, Any]]:
    """By rung: what the agent reached, how the session ended, and what was counted; the reason where a rung cannot start.

    `words`: a Python that is in the `image`, without which the rung `container` is left out; a name of this host; the port
    of the services there and at OTHER_HOST, and that of the third.
    """
    report = {}
    for name in (*EVERY, "container"):
        try:
            report[name] = flown(name, folder / name, image, words)
        except pytest.skip.Exception as reason:
            report[name] = {"reason": str(reason)}
    return report


def flown(rung: str, folder: Path, image: str, words: list[str]) -> dict[str, Any]:
    """One session on a rung."""
    if rung == "container" and not image:
        pytest.skip("no image")
    python, host, *ports = words
    manifest = AgentManifest.model_validate(
        {
            "name": "asker",
            "command": (
                python if rung == "container" else "{python}",
                "-I",
                "-S",
                "-c",
                AGENT,
                host,
                OTHER_HOST,
                *ports,
            ),
            "image": image if rung == "container" else "",
            "zenoh": False,
        }
    )
    services = (
        OutsideService(name="web", host=host, port=int(ports[0])),
        OutsideService(name="raw", host=OTHER_HOST, port=int(ports[0])),
    )
    corners = tuple(Point(east_m=e, north_m=n) for e, n in ((0, 0), (100, 0), (100, 100), (0, 100)))
    spec = SimSpec(
        name="asked",
        world=World(area=Polygon(corners=corners)),
        vehicle=VehicleSpec(model="still", home=Home(east_m=5, north_m=5)),
        actors=(ActorGroup(id="target", asset="soldier", role=Role.ADVERSARY, count=1),),
        mission=Mission(time_limit_s=60.0),
        agent=AgentSpec(manifest="asker", services=services),
        pace=Pace(mode="realtime", max_late_share=1.0),
        budgets=Budgets(wall_s=3600.0, reply_s=600.0, connect_s=600.0),
        realized=Realized(
            actors=(PlacedActor(id="target-1", group="target", east_m=50, north_m=50, heading_deg=0),)
        ),
    )
    folder.mkdir()
    records: list[Record] = []
    starter = AgentStarter(open_agent)
    with rung_or_skip(rung) as isolation:
        confined = manifest.model_copy(update={"isolation": isolation})
        end = run_session(
            SessionPlan(spec, confined, folder, starter.open, folder / "scratch", records.append)
        )
    log = (starter.output or b"").decode()
    return {
        "outcome": end.outcome,
        "reached": json.loads(log) if log.startswith("{") else log,
        "uses": [use.model_dump() for use in let_in.uses] if (let_in := end.fact(ServicesLetIn)) else [],
    }


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
            return call_in_own_network(folder, all_flown, *arguments)
        return all_flown(*arguments)


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
