"""One client script, flown twice: the same bytes on the wire and the same flight."""

from __future__ import annotations

import hashlib
import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_vehicle_missions import Row, bare, to, upload
from vehicle_client import NAN, Client, Make, mavlink, simspec

ENVIRONMENT = {"wind": {"speed_mps": 4.0, "from_deg": 200.0, "turbulence_mps": 4.0}}
NOISY = {"wander_m": 2.0, "noise_m": 0.1}
READY_S = {"px4": 5.0, "ardupilot": 2.0}
FAILURES: tuple[dict[str, Any], ...] = (  # seconds after the vehicle is ready
    {"at_s": 14.0, "kind": "link_loss", "duration_s": 1.0},
    {"at_s": 16.0, "kind": "gps_drift", "drift_mps": 1.0, "towards_deg": 70.0, "duration_s": 3.0},
    {"at_s": 20.0, "kind": "battery_drop", "to_fraction": 0.1},
    {"at_s": 23.0, "kind": "gps_off", "duration_s": 7.0},
    {"at_s": 33.0, "kind": "motor_off", "instance": 2},
)


def rows(client: Client) -> list[Row]:
    first: list[Row] = [to(client, 0, 0, 8)] if client.vehicle.condition().mode == "GUIDED" else []
    return [
        *first,
        to(client, 0, 0, 8, 22),
        to(client, 0, 15, 8),
        bare(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0, -1),
        to(client, 12, 15, 8),
        bare(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH),
    ]


def ready(client: Client, autopilot: str) -> None:
    """Armed in the air, a mission uploaded."""
    client.fly(READY_S[autopilot] - client.vehicle.time.s)
    ardupilot = autopilot == "ardupilot"
    if ardupilot:
        client.learn_home()
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 0 if ardupilot else 3)
    assert upload(client, rows(client)) == 0
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    altitude_m = 8.0 if ardupilot else 496.0
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, altitude_m) == [0]
    client.fly(12.0)


def fly_mission(client: Client, autopilot: str) -> None:
    mode = (4, 4) if autopilot == "px4" else (3,)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *mode)
    client.fly(25.0)


def fly_setpoints(client: Client, autopilot: str) -> None:
    """Positions and velocities ten times a second, then silence until the failsafe."""

    def place() -> None:
        client.setpoint(10, 4, -8)

    def speed() -> None:
        client.setpoint(0, 0, 0, mask=0xDC7, vn=-1.0, ve=1.5)

    client.fly(0.3, place)
    if autopilot == "px4":
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    client.fly(6.0, place)
    client.fly(5.0, speed)
    client.fly(6.0)


def fly_into_failures(client: Client, autopilot: str) -> None:
    client.fly(READY_S[autopilot] + 36.0 - client.vehicle.time.s)


SCRIPTS = {"mission": fly_mission, "setpoints": fly_setpoints, "failures": fly_into_failures}


def run(make: Make, autopilot: str, script: str, seed: int = 5) -> tuple[str, str]:
    """SHA-256 of everything on the wire, and of the true track with what the vehicle was at each moment."""
    wire, track = hashlib.sha256(), hashlib.sha256()

    def tap(link: str, direction: str, data: bytes) -> None:
        wire.update(direction.encode() + data)

    failures = FAILURES if script == "failures" else ()
    broken = [{**failure, "at_s": failure["at_s"] + READY_S[autopilot]} for failure in failures]
    vehicle = {"gps": NOISY, "failures": broken}
    spec = simspec(autopilot, environment=ENVIRONMENT, vehicle=vehicle, seeds={"root": seed})
    client = make(spec, streams="onboard", tap=tap, system=255)
    client.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    ready(client, autopilot)
    step = client.vehicle.step

    def watched() -> None:
        step()
        truth = client.vehicle.truth()
        track.update(struct.pack("<6d", *truth.position_enu_m, *truth.velocity_enu_mps))
        track.update(repr(client.vehicle.condition()).encode())

    client.vehicle.step = watched  # type: ignore[method-assign]
    SCRIPTS[script](client, autopilot)
    return wire.hexdigest(), track.hexdigest()


def printed(makes: Iterator[Make]) -> None:
    """For another process: the digests of all scripts, a line each."""
    make = next(makes)
    for autopilot in ("px4", "ardupilot"):
        for script in SCRIPTS:
            print(autopilot, script, *run(make, autopilot, script))


@pytest.fixture(scope="module")
def elsewhere() -> dict[tuple[str, str], tuple[str, str]]:
    """The digests as a fresh interpreter with another hash seed has them."""
    code = "import vehicle_client as c, test_vehicle_determinism as t; t.printed(c.make.__wrapped__())"
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    environment = {**os.environ, "PYTHONHASHSEED": "77", "PYTHONPATH": path}
    command = [sys.executable, "-W", "ignore", "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    lines = (line.split() for line in done.stdout.splitlines())
    return {(autopilot, script): (wire, track) for autopilot, script, wire, track in lines}


@pytest.mark.parametrize("script", sorted(SCRIPTS))
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_script_flown_again_is_the_same_flight(
    make: Make, elsewhere: dict[tuple[str, str], tuple[str, str]], autopilot: str, script: str
) -> None:
    """Here and in another process alike."""
    assert run(make, autopilot, script) == elsewhere[autopilot, script]


def test_every_script_and_seed_is_another_flight(
    make: Make, elsewhere: dict[tuple[str, str], tuple[str, str]]
) -> None:
    """Nothing that is compared above is empty or the same for all."""
    all_six = [digest for pair in elsewhere.values() for digest in pair]
    assert len(set(all_six)) == 2 * len(elsewhere) == 12
    assert not set(run(make, "px4", "setpoints", seed=6)) & set(all_six)


def test_jsbsim_is_silent_and_writes_nothing(tmp_path: Path) -> None:
    """Building and flying a vehicle prints nothing and leaves nothing in the working directory."""
    code = """
from vehicle_models import open_x500
from bench.simulation import StandalonePlan, standalone_simspec
from bench.contracts import VehiclePlan
with open_x500(VehiclePlan(standalone_simspec(StandalonePlan(home=(47.0, 8.0, 400.0, 0.0))), ())) as vehicle:
    for _ in range(100):
        vehicle.step()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("", "")
    assert list(tmp_path.iterdir()) == []
