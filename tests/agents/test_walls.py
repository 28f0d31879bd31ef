"""What each rung holds, by an agent that looks for ways out: exactly what the table says of this host."""

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
from pathlib import Path
from typing import Any

import pytest
from host_image import PYTHON, image_or_skip
from own_network import call_in_own_network
from rungs import BARE, EVERY, rung_or_skip
from started_agents import plan_of

from bench.agents import open_agent
from bench.agents.confinement import HOLDINGS, Host, Wall, leaves_open, rungs, this_host, walls_table
from bench.contracts import AgentLimits, AgentManifest
from bench.network_namespace import namespace_fault

DOCS = Path(__file__).parents[2] / "docs"


LIMITS = AgentLimits(memory_mb=192, processes=48, scratch_mb=4, file_mb=2)
PROBE_S = 90.0
# A watch looks ten times a second: time enough on a busy host.
WATCH_S = 8.0
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


def gaps_of(
    rung: str, canaries: dict[str, Any], folder: Path, image: str = ""
) -> tuple[dict[str, list[str]], Host]:
    """The gaps that the probe finds by wall, and the host that it ran on. `folder` is for the probe, and one more like it for
    what the bench keeps for it.
    """
    own_network = namespace_fault() is None
    # Root gives the agent a user of its own only where that one can reach its program.
    folder.mkdir(mode=0o755)
    with rung_or_skip(rung) as isolation:
        probe = shutil.copy(Path(__file__).with_name("escape_probe.py"), folder)
        place = rungs()[isolation].place(folder / "scratch")
        in_memory = [] if place.home.startswith(str(folder)) else ["/tmp", "/dev/shm"]
        planted = {**canaries, "writable": [*in_memory, place.home]}
        if rung == "none":
            # Nothing watches: a second shows that nobody ends it.
            planted["watch_s"] = 1.0
        manifest = AgentManifest(
            name="probe",
            command=(PYTHON if image else "{python}", "-I", "-S", str(probe)),
            environment={"PROBE": json.dumps(planted)},
            isolation=isolation,
            image=image,
            limits=LIMITS,
            zenoh=False,
        )
        with open_agent(plan_of(manifest, folder, folder / "scratch")) as agent:
            deadline = time.monotonic() + PROBE_S
            while agent.output_tail().count("}\n") < 2 and agent.exit_code() is None:
                assert time.monotonic() < deadline, agent.output_tail()
                time.sleep(0.01)
            own_user, limit = agent.own_user, agent.exceeded_limit()
        output = agent.output().decode()
        assert output.startswith("{"), output
        gaps: dict[str, list[str]] = {}
        for line in output.splitlines():
            gaps |= json.loads(line)
        if limit == f"{LIMITS.scratch_mb} MB in its folder":
            gaps["DISK"] = []
        gaps["USER"] = [] if own_user else ["the user of the bench"]
        gaps["DAEMONS"] = left_behind(canaries["word"][:15])
        return gaps, this_host(own_network=own_network, own_user=own_user)


def left_behind(name: str) -> list[str]:
    """Processes with the name that the probe gives its daemon; ended here."""
    found = []
    for path in Path("/proc").glob("[0-9]*/comm"):
        with suppress(OSError):
            # A program may give itself any bytes as a name.
            if path.read_bytes().strip() == name.encode():
                found.append(path.parent.name)
                os.kill(int(path.parent.name), 9)
    return found


@pytest.mark.parametrize("own_network", [False, True])
@pytest.mark.parametrize("rung", [*EVERY, "container"])
def test_a_rung_holds_what_the_table_says_and_no_less(rung: str, own_network: bool, tmp_path: Path) -> None:
    """A wall that the table calls open is open here too: a table that is too modest hides a test that is blind."""
    image = image_or_skip() if rung == "container" else ""
    with planted() as canaries:
        arguments = (rung, canaries, tmp_path / "probe", image)
        gaps, host = (
            call_in_own_network(tmp_path, gaps_of, *arguments) if own_network else gaps_of(*arguments)
        )
    assert host.own_network == own_network
    assert gaps.keys() == {wall.name for wall in Wall}
    expected = {wall.name for wall in leaves_open("landlock" if rung == BARE else rung, host)}
    assert {name for name, is_open in gaps.items() if is_open} == expected, gaps


def test_the_docs_have_the_table() -> None:
    """It is generated: `python -m bench.agents.confinement` prints it."""
    assert walls_table() in (DOCS / "agents-confinement.md").read_text()


def test_every_rung_takes_a_stand_on_every_wall() -> None:
    """By name, and on two hosts that differ in everything."""
    poor = Host(True, 1, False, False, False, False, False)
    rich = Host(True, 7, True, True, True, True, True)
    assert HOLDINGS.keys() == rungs().keys()
    for rung, holdings in HOLDINGS.items():
        assert set(holdings) == set(Wall)
        assert set(leaves_open(rung, rich)) <= set(leaves_open(rung, poor))
    assert leaves_open("landlock", rich) == ()
    assert Wall.TCP in leaves_open("landlock", poor)
