"""Real clients against `rebar fly`: each a plain program of its own process, in the environment that it comes
from.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from ports import free_port

SCRIPTS = Path(__file__).parent / "scripts"
OURS = Path(sys.executable)
THEIRS = Path(sys.prefix) / "clients" / "bin" / "python"  # `make test` and `make clients` build it

Flown = Callable[..., dict[str, Any]]


@dataclass(frozen=True)
class Program:
    """A client's program, the autopilot that it is for, and how it is told where the vehicle is."""

    script: str
    autopilot: str
    url: str
    python: Path = OURS


PROGRAMS = {
    "mavsdk": Program("mavsdk_flight.py", "px4", "udpin://127.0.0.1:{}"),
    "mavsdk-asyncio": Program("mavsdk_asyncio_flight.py", "px4", "udpin://127.0.0.1:{}"),
    "mavsdk-grpc": Program("mavsdk_grpc_flight.py", "px4", "udpin://127.0.0.1:{}", THEIRS),
    "pymavlink-px4": Program("pymavlink_px4_flight.py", "px4", "udpin:127.0.0.1:{}"),
    "pymavlink-ardupilot": Program("pymavlink_ardupilot_flight.py", "ardupilot", "tcp:127.0.0.1:{}"),
    "mavproxy": Program("mavproxy_flight.py", "ardupilot", "tcp:127.0.0.1:{}", THEIRS),
    "dronekit": Program("dronekit_flight.py", "ardupilot", "tcp:127.0.0.1:{}", THEIRS),
}


@contextmanager
def flying(autopilot: str, speed: float, options: Sequence[str]) -> Iterator[int]:
    """The port of a `rebar fly` whose link is open; it must stop in good order."""
    kind, sort = ("udpout", socket.SOCK_DGRAM) if autopilot == "px4" else ("tcpin", socket.SOCK_STREAM)
    port = free_port(sort)
    link = f"{kind}:127.0.0.1:{port}"
    command = [str(OURS.parent / "rebar"), "fly", "--autopilot", autopilot, "--mavlink", link]
    command += ["--speed", str(speed), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as vehicle:
        assert vehicle.stdout
        try:
            line = vehicle.stdout.readline()
            assert "connect to" in line, line + vehicle.stdout.read()
            yield port
            assert vehicle.poll() is None, vehicle.stdout.read()
        finally:
            # Heard also where Ctrl-C is ignored, as in a job in the background.
            vehicle.send_signal(signal.SIGTERM)
            line, _ = vehicle.communicate(timeout=20)
    assert vehicle.returncode == 0, line


@pytest.fixture
def flown(tmp_path: Path) -> Flown:
    """Fly chapters of a client's program; what it told."""

    def fly(client: str, *chapters: str, speed: float, options: Sequence[str] = ()) -> dict[str, Any]:
        program = PROGRAMS[client]
        if not program.python.exists():
            pytest.skip("its environment is built by `make clients`")
        done = attempt(program, chapters, speed, options)
        if done.returncode and speed > 1.0:
            # Clients wait by the host's clock. A busy host makes the vehicle late, and then a hop at eight times its
            # speed ends before the client has looked: at its own speed there is time for everybody.
            done = attempt(program, chapters, 1.0, options)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        printed: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        return printed

    def attempt(
        program: Program, chapters: Sequence[str], speed: float, options: Sequence[str]
    ) -> subprocess.CompletedProcess[str]:
        with flying(program.autopilot, speed, options) as port:
            return subprocess.run(
                [str(program.python), str(SCRIPTS / program.script), program.url.format(port), *chapters],
                # What a client keeps from one run to the next stays in this test's folder.
                env={**os.environ, "HOME": str(tmp_path)},
                cwd=tmp_path,
                capture_output=True,
                text=True,
                timeout=110,
                check=False,
            )

    return fly
