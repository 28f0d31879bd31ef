"""`rebar doctor`: can this machine run the bench, and if not, what is missing."""

from __future__ import annotations

import json
import os
import platform
import shutil
import socket
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated

import typer

PACKAGES = (
    "jsbsim",
    "pymavlink",
    "fastcrc",
    "eclipse-zenoh",
    "mcap",
    "numpy",
    "scipy",
    "polars",
    "plotly",
    "pydantic",
    "networkx",
    "shapely",
)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at."""

    name: str
    fine: bool
    text: str


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(doctor)


def doctor(as_json: Annotated[bool, typer.Option("--json", help="For a machine to read")] = False) -> None:
    """Check this machine: Python, packages, plug-ins, JSBSim, Zenoh, loopback, space. Example: rebar doctor"""
    findings = [_try(name, check) for name, check in CHECKS.items()]
    if as_json:
        print(json.dumps([{"name": one.name, "fine": one.fine, "text": one.text} for one in findings], indent=2))
    else:
        width = max(len(one.name) for one in findings)
        for one in findings:
            print(f"{'ok ' if one.fine else 'BAD'}  {one.name:<{width}}  {one.text}")
    if not all(one.fine for one in findings):
        raise typer.Exit(1)


def _try(name: str, check: Callable[[], str]) -> Finding:
    try:
        return Finding(name, True, check())
    except Exception as error:
        return Finding(name, False, f"{type(error).__name__}: {error}")


def _python() -> str:
    return f"{platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} processors"


def _packages() -> str:
    missing = []
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            missing.append(package)
    if missing:
        raise RuntimeError(f"not installed: {', '.join(missing)}; run `make demo` or install requirements.lock")
    return ", ".join(found)


def _plugins() -> str:
    from bench.contracts import plugins

    groups = ("rebar.vehicles", "rebar.scenes", "rebar.agents", "rebar.measures")
    counts = {group: len(plugins(group)) for group in groups}
    if not all(counts.values()):
        raise RuntimeError(f"a family is empty: {counts}; install the distribution (pip install -e .)")
    return ", ".join(f"{count} {group.removeprefix('rebar.')}" for group, count in counts.items())


def _vehicle() -> str:
    from bench.contracts import START, VehiclePlan, load_plugin
    from bench.simspec import Point, Polygon, SimSpec, World

    corners = tuple(Point(east_m=x, north_m=y) for x, y in ((-50, -50), (50, -50), (50, 50), (-50, 50)))
    spec = SimSpec(name="doctor", world=World(area=Polygon(corners=corners)))
    with load_plugin("rebar.vehicles", spec.vehicle.model)(VehiclePlan(spec, ())) as vehicle:
        for _ in range(50):
            vehicle.step()
        return f"{spec.vehicle.model} stepped from {START.s:g} to {vehicle.time.s:g} simulated seconds"


def _streams() -> str:
    from bench.streams import AirPlan, String, open_client, open_router

    plan = AirPlan(domain=1, agent_reads=(("/doctor", "std_msgs/msg/String"),), agent_writes=())
    with open_router(plan) as router, open_client(router.access, "doctor") as client:
        heard = client.subscribe("/doctor", String, latched=True)
        router.node("bench", "/").latched("/doctor", String).put(String("well"))
        if not heard.wait(1, 5.0):
            raise RuntimeError("a sample did not arrive within 5 s over loopback")
    return "an embedded router passed a sample to a client with credentials"


def _loopback() -> str:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname(), timeout=2):
        return "TCP on 127.0.0.1 works"


def _space() -> str:
    folder = Path(tempfile.gettempdir())
    free_gb = shutil.disk_usage(folder).free / 1e9
    if free_gb < 1.0:
        raise RuntimeError(f"only {free_gb:.1f} GB free in {folder}; a session needs some megabytes, a campaign gigabytes")
    return f"{free_gb:.0f} GB free for scratch"


CHECKS: dict[str, Callable[[], str]] = {
    "python": _python,
    "packages": _packages,
    "plug-ins": _plugins,
    "vehicle": _vehicle,
    "streams": _streams,
    "loopback": _loopback,
    "space": _space,
}
