"""Flies an agent that asks two services of the host, and looks for a third that is not let in, on each rung.

`python service_flights.py OWN_NETWORK FOLDER IMAGE PYTHON HOST PORT HIDDEN`, in a process of its own, because a network
namespace is entered once. PYTHON is in the IMAGE, without which the rung `container` is left out. HOST is a name of this
host; the services are at its PORT and at the same port of OTHER_HOST. Prints a JSON object by rung: what the agent
reached, how the session ended, and what was counted; the reason where a rung cannot start.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from bench.agents import open_agent
from bench.agents.confinement import rungs
from bench.contracts import AgentManifest, Record
from bench.network_namespace import enter_network_namespace
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

OTHER_HOST = "127.0.0.9"
AGENT = """
import http.client, json, os, socket, sys
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
print(json.dumps(answers))
"""


def main() -> None:
    """Fly on each rung, and print."""
    own_network, folder, image, python, host, *ports = sys.argv[1:]
    fault = enter_network_namespace() if own_network == "1" else "not asked for"
    report: dict[str, object] = {"fault": fault}
    for name, rung in rungs().items():
        reason = "no image" if name == "container" and not image else rung.trial()
        report[name] = (
            {"reason": reason} if reason else flown(name, Path(folder, name), image, [python, host, *ports])
        )
    print(json.dumps(report))


def flown(rung: str, folder: Path, image: str, words: list[str]) -> dict[str, object]:
    """One session on a rung."""
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
            "isolation": rung,
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
    end = run_session(SessionPlan(spec, manifest, folder, open_agent, folder / "scratch", records.append))
    log = (folder / "scratch" / "agent.log").read_text()
    return {
        "outcome": end.outcome,
        "reached": json.loads(log) if log.startswith("{") else log,
        "uses": [use.model_dump() for use in end.services],
    }


if __name__ == "__main__":
    main()
