"""Runs the escape probe on one rung, in a process of its own, with things planted outside for it to find.

`python self_test.py RUNG[+fork] OWN_NETWORK [IMAGE]`, where OWN_NETWORK is 0 or 1 and IMAGE is for the rung
`container`; with `+fork` the probe is forked from a warm interpreter. Prints a JSON object: `gaps` by wall, and
`host`, the facts of this host that decide which walls are to hold.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from host_image import PYTHON

from bench.agents import open_agent
from bench.agents.confinement import this_host
from bench.contracts import AgentEndpoints, AgentLimits, AgentManifest, AgentPlan
from bench.network_namespace import enter_network_namespace
from bench.simspec import Isolation, Point, Polygon, SimSpec, World

LIMITS = AgentLimits(memory_mb=192, processes=48, scratch_mb=4, file_mb=2)
PATIENCE_S = 90.0
# A watch looks ten times a second: time enough on a busy host.
WATCH_S = 3.0
IPC_CREAT, IPC_RMID = 0o1000, 0


@contextmanager
def planted() -> Iterator[dict[str, Any]]:
    """Canaries: a campaign's file, shared memory, servers, and a process with a secret in its environment."""
    word = f"rebar{uuid.uuid4().hex[:9]}"
    libc = ctypes.CDLL(None, use_errno=True)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="campaign-")))
        folder.chmod(0o755)
        (folder / "simspec.json").write_text(word)
        shared = Path("/dev/shm", word)
        shared.write_text(word)
        stack.callback(shared.unlink)
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        echo = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        echo.bind(("127.0.0.1", 0))
        threading.Thread(target=serve_echo, args=(echo,), daemon=True).start()
        abstract = stack.enter_context(socket.socket(socket.AF_UNIX))
        abstract.bind("\0" + word)
        abstract.listen()
        key = int(word[5:12], 16)
        segment = libc.shmget(key, 4096, IPC_CREAT | 0o666)
        stack.callback(libc.shmctl, segment, IPC_RMID, None)
        neighbour = subprocess.Popen(
            [sys.executable, "-S", "-c", "import time; time.sleep(600)", str(folder)], env={"SECRET": word}
        )
        stack.callback(neighbour.wait)
        stack.callback(neighbour.kill)
        yield {
            "word": word,
            "folder": str(folder),
            "file": str(folder / "simspec.json"),
            "shm": str(shared),
            "tcp": server.getsockname()[1],
            "udp": echo.getsockname()[1],
            "abstract": word,
            "sysv": key,
            "pid": neighbour.pid,
            "host": socket.gethostname(),
            "memory_mb": LIMITS.memory_mb,
            "processes": LIMITS.processes,
            "scratch_mb": LIMITS.scratch_mb,
            "watch_s": WATCH_S,
        }


def serve_echo(echo: socket.socket) -> None:
    """Answer every datagram until the socket is closed."""
    with suppress(OSError):
        while True:
            data, address = echo.recvfrom(99)
            echo.sendto(data, address)


def main() -> None:
    """Plant, probe, and print what was found."""
    name, _, fork = sys.argv[1].partition("+")
    rung: Isolation = name  # type: ignore[assignment]  # checked by the manifest
    with planted() as canaries, tempfile.TemporaryDirectory() as scratch:
        # Root gives the agent a user of its own only where that one can reach its program.
        Path(scratch).chmod(0o755)
        # What was opened above is outside of it; a worker enters at its start too.
        own_network = sys.argv[2] == "1" and enter_network_namespace() is None
        probe = shutil.copy(Path(__file__).with_name("escape_probe.py"), scratch)
        home = Path(scratch, "home")
        own_root = rung in ("bwrap", "container")
        canaries["writable"] = ["/tmp", "/dev/shm", "/scratch"] if own_root else [str(home)]
        image = sys.argv[3] if rung == "container" else ""
        manifest = AgentManifest(
            name="probe",
            command=("{python}", str(probe))
            if fork
            else (PYTHON if image else "{python}", "-I", "-S", str(probe)),
            reset="fork" if fork else "process",
            environment={"PROBE": json.dumps(canaries)},
            isolation=rung,
            image=image,
            limits=LIMITS,
            zenoh=False,
        )
        corners = tuple(Point(east_m=e, north_m=n) for e, n in ((0, 0), (100, 0), (100, 100)))
        spec = SimSpec(name="probed", world=World(area=Polygon(corners=corners)))
        plan = AgentPlan(manifest, Path(scratch), spec, AgentEndpoints({}, None, "", "", 0, None), home)
        with open_agent(plan) as agent:
            deadline = time.monotonic() + PATIENCE_S
            while agent.output_tail().count("}\n") < 2 and agent.exit_code() is None:
                assert time.monotonic() < deadline, agent.output_tail()
                time.sleep(0.01)
            own_user, limit = agent.own_user, agent.exceeded_limit()
            assert agent.is_forked == bool(fork)
        output = (home / "agent.log").read_text()
        assert output.startswith("{"), output
        gaps: dict[str, list[str]] = {}
        for line in output.splitlines():
            gaps |= json.loads(line)
        if limit == f"{LIMITS.scratch_mb} MB in its folder":
            gaps["DISK"] = []
        gaps["USER"] = [] if own_user else ["the user of the bench"]
        gaps["DAEMONS"] = left_behind(canaries["word"][:15])
    host = this_host(own_network=own_network, own_user=own_user)
    print(json.dumps({"gaps": gaps, "host": asdict(host)}))


def left_behind(name: str) -> list[str]:
    """Processes with the name that the probe gives its daemon; ended here."""
    found = []
    for path in Path("/proc").glob("[0-9]*/comm"):
        with suppress(OSError):
            if path.read_text().strip() == name:
                found.append(path.parent.name)
                os.kill(int(path.parent.name), 9)
    return found


if __name__ == "__main__":
    main()
