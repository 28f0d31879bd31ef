"""`rebar doctor`: checks whether this machine can run the bench, and what is missing."""

from __future__ import annotations

import json
import os
import platform
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated

import typer

from ._fly import parse_firmware
from ._tables import plain_console, wrapped

PACKAGES = (
    "jsbsim",
    "pymavlink",
    "fastcrc",
    "eclipse-zenoh",
    "mcap",
    "numpy",
    "scipy",
    "polars",
    "pydantic",
    "networkx",
    "shapely",
)


@dataclass(frozen=True, slots=True)
class MachineCheck:
    """The result of one check. `text` describes what works, or the error."""

    name: str
    fine: bool
    text: str


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
    firmware: Annotated[
        str,
        typer.Option(
            help="Start this real autopilot too: PX4's folder or its bin/px4, ArduPilot's program, or one of a plug-in, "
            "KIND:OPTION=VALUE,..."
        ),
    ] = "",
) -> None:
    """Check this machine: Python, packages, plug-ins, JSBSim, Zenoh, loopback, free space, confinement of agents, pace warp. Example:
    rebar doctor
    """
    checks = [_try(name, check) for name, check in CHECKS.items()]
    if firmware:
        checks.append(_try("firmware", partial(_firmware, firmware)))
    if as_json:
        print(json.dumps([asdict(check) for check in checks], indent=2))
    else:
        width = max(len(check.name) for check in checks)
        for check in checks:
            head = f"{'ok ' if check.fine else 'BAD'}  {check.name:<{width}}  "
            print(wrapped(check.text, plain_console().width, len(head), head))
    if not all(check.fine for check in checks):
        raise typer.Exit(1)


def _try(name: str, check: Callable[[], str]) -> MachineCheck:
    # Any exception is a finding: the command is there to say what does not work.
    try:
        return MachineCheck(name, True, check())
    except Exception as error:
        return MachineCheck(name, False, f"{type(error).__name__}: {error}")


def _python() -> str:
    return f"{platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} processors"


def _packages() -> str:
    missing = []
    installed = []
    for package in PACKAGES:
        try:
            installed.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            missing.append(package)
    if missing:
        raise RuntimeError(
            f"not installed: {', '.join(missing)}; run `make demo` or install requirements.lock"
        )
    return ", ".join(installed)


def _plugins() -> str:
    from bench.contracts import PluginGroup, plugins

    # Plug-ins are found by entry points, which exist only once the distribution is installed.
    groups: tuple[PluginGroup, ...] = (
        "rebar.vehicles",
        "rebar.scenes",
        "rebar.agents",
        "rebar.measures",
        "rebar.renderers",
        "rebar.detectors",
        "rebar.firmware",
    )
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


def _firmware(text: str) -> str:
    """Start a real autopilot on the ground for some seconds; the bench's own kinds are known by what the path is."""
    from bench.contracts import BootsFirmware, VehiclePlan, load_plugin
    from bench.simulation import StandalonePlan, standalone_simspec

    if plugin := parse_firmware(text):
        plan = StandalonePlan(firmware=plugin.model_copy(update={"boot_s": 5.0}))
    else:
        # PX4 is a folder of program and start scripts, ArduPilot one executable.
        kind = "px4" if Path(text).is_dir() or Path(text).name == "px4" else "ardupilot"
        plan = StandalonePlan(kind, firmware=text)
    spec = standalone_simspec(plan)
    with load_plugin("rebar.vehicles", spec.vehicle.model)(VehiclePlan(spec, ())) as vehicle:
        assert isinstance(vehicle, BootsFirmware)
        return vehicle.boot()


def _streams() -> str:
    from bench.streams import AirPlan, String, open_client, open_router

    plan = AirPlan(domain=1, agent_reads=(("/doctor", "std_msgs/msg/String"),), agent_writes=())
    with open_router(plan) as router, open_client(router.access, "doctor") as client:
        subscription = client.subscribe("/doctor", String, latched=True)
        router.node("bench", "/").latched("/doctor", String).put(String("well"))
        if not subscription.wait(1, 5.0):
            raise RuntimeError("no sample arrived over loopback within 5 s")
    return "an embedded router passed a sample to a client with credentials"


def _loopback() -> str:
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(server.getsockname(), timeout=2),
    ):
        return "TCP on 127.0.0.1 works"


def _space() -> str:
    folder = Path(tempfile.gettempdir())
    free_gb = shutil.disk_usage(folder).free / 1e9
    if free_gb < 1.0:
        raise RuntimeError(
            f"only {free_gb:.1f} GB free in {folder}; a session needs some megabytes, a campaign gigabytes"
        )
    return f"{free_gb:.0f} GB free for scratch"


@cache
def _own_network_fault() -> str | None:
    """Why sessions share the host's network; tried in a child, because this process has threads."""
    code = (
        "from bench.network_namespace import enter_network_namespace as enter; raise SystemExit(enter() or 0)"
    )
    tried = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=False)
    return tried.stderr.strip() if tried.returncode else None


def _network() -> str:
    fault = _own_network_fault()
    return f"sessions share the host's network: {fault}" if fault else "sessions have networks of their own"


def _rung(name: str) -> str:
    # A rung that cannot start is no fault of this machine: `auto` takes another.
    from bench.agents.confinement import Wall, leaves_open, rungs, this_host

    if reason := rungs()[name].trial():
        return f"cannot start: {reason}"
    host = this_host(own_network=_own_network_fault() is None, own_user=os.getuid() == 0)
    gaps = leaves_open(name, host)
    if len(gaps) > len(Wall) // 2:
        holding = ", ".join(wall for wall in Wall if wall not in gaps)
        return f"works; holds nothing but: {holding}"
    return f"works; leaves open: {', '.join(gaps) or 'nothing of the table in docs/agents-confinement.md'}"


def _warp() -> str:
    # Another pace can be flown here, so this is no fault of the machine either.
    from bench.simulation.warp import warp_fault

    fault = warp_fault()
    return f"not available: {fault.what}; {fault.remedy}" if fault else "agents can be flown at the pace warp"


CHECKS: dict[str, Callable[[], str]] = {
    "python": _python,
    "packages": _packages,
    "plug-ins": _plugins,
    "vehicle": _vehicle,
    "streams": _streams,
    "loopback": _loopback,
    "space": _space,
    "network": _network,
    "landlock": partial(_rung, "landlock"),
    "container": partial(_rung, "container"),
    "isolation none": partial(_rung, "none"),
    "pace warp": _warp,
}
