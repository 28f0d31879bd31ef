"""Flies an agent that asks two services of the host, and looks for a third that is not let in, on each rung."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from rungs import EVERY, rung_or_skip

from bench.agents import open_agent
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


def flights(folder: Path, image: str, words: list[str]) -> dict[str, dict[str, Any]]:
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
