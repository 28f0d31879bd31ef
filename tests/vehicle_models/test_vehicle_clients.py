"""The examples, in real time. Whole flights of real clients: tests/clients."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from ports import free_port

from bench.contracts import LinkSpec
from bench.simulation import StandalonePlan, run_standalone

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize(
    ("script", "package"), [("mavsdk_patrol.py", "mavsdk"), ("pymavlink_hop.py", "pymavlink")]
)
def test_the_examples_fly(script: str, package: str) -> None:
    """Each connects by REBAR_MAVLINK, waits until it may arm, takes off, goes somewhere, lands and sees it
    disarmed.
    """
    pytest.importorskip(package)
    port = free_port(socket.SOCK_DGRAM)
    stop = threading.Event()
    link = LinkSpec("onboard", "udp_out", port=port)
    flying = threading.Thread(
        target=run_standalone, args=(StandalonePlan("px4", [link], speed=4.0),), kwargs={"stop": stop}
    )
    flying.start()
    try:
        environment = {**os.environ, "REBAR_MAVLINK": f"udpin:127.0.0.1:{port}"}
        environment["REBAR_OPTIONS"] = '{"side_m": 8, "height_m": 3, "timeout_s": 30}'
        done = subprocess.run(
            [sys.executable, str(EXAMPLES / script)],
            env=environment,
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
    finally:
        stop.set()
        flying.join()
    assert done.returncode == 0, done.stdout + done.stderr
    assert "landed" in done.stdout
