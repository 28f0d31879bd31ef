"""The examples, and MAVSDK's reading of our metadata, in real time. Flights of real clients: tests/clients."""

from __future__ import annotations

import json
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
CLIENT = """
import json, sys, time
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.component_metadata import ComponentMetadata
from mavsdk.plugins.component_metadata.component_metadata import ComponentMetadataError, MetadataType
from mavsdk.plugins.param import Param

mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
mavsdk.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
system = mavsdk.first_autopilot(20.0)
metadata = ComponentMetadata(system)
metadata.request_autopilot_component()
found, end = {}, time.monotonic() + 20.0
while len(found) < 2 and time.monotonic() < end:
    time.sleep(0.2)
    for kind in (MetadataType.PARAMETER, MetadataType.EVENTS):
        try:
            found[kind.name] = json.loads(metadata.get_metadata(1, kind).json_metadata)
        except ComponentMetadataError:
            pass
all_of_them = Param(system).get_all_params()
described = [one["name"] for one in found["PARAMETER"]["parameters"]]
listed = [one.name for one in [*all_of_them.int_params, *all_of_them.float_params]]
print(json.dumps({"described": described, "listed": listed, "components": list(found["EVENTS"]["components"])}))
"""


def said_by(command: list[str], port: int, **environment: str) -> str:
    """What a client prints beside a PX4 that speaks at `port`."""
    stop = threading.Event()
    plan = StandalonePlan("px4", [LinkSpec("onboard", "udp_out", port=port)], speed=4.0)
    flying = threading.Thread(target=run_standalone, args=(plan,), kwargs={"stop": stop})
    flying.start()
    try:
        done = subprocess.run(
            [sys.executable, *command],
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
    finally:
        stop.set()
        flying.join()
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("script", "package"), [("mavsdk_patrol.py", "mavsdk"), ("pymavlink_hop.py", "pymavlink")]
)
def test_the_examples_fly(script: str, package: str) -> None:
    """Each connects by REBAR_MAVLINK, waits until it may arm, takes off, goes somewhere and lands."""
    pytest.importorskip(package)
    port = free_port(socket.SOCK_DGRAM)
    options = '{"side_m": 8, "height_m": 3, "timeout_s": 30}'
    link = f"udpin:127.0.0.1:{port}"
    assert "landed" in said_by([str(EXAMPLES / script)], port, REBAR_MAVLINK=link, REBAR_OPTIONS=options)


def test_mavsdk_reads_metadata_and_every_parameter(tmp_path: Path) -> None:
    """The general file, parameters and events have checksums that hold; every parameter is described."""
    pytest.importorskip("mavsdk")
    port = free_port(socket.SOCK_DGRAM)
    # Its cache of metadata is in HOME.
    metadata = json.loads(said_by(["-c", CLIENT, str(port)], port, HOME=str(tmp_path)).splitlines()[-1])
    assert sorted(metadata["described"]) == sorted(metadata["listed"])
    assert metadata["components"] == ["1"]
