"""One client script, flown twice: the same bytes on the wire and the same flight."""

from __future__ import annotations

import ctypes
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

from bench.contracts import VehiclePlan
from vehicle_models import open_x500

ENVIRONMENT = {"wind": {"speed_mps": 4.0, "from_deg": 200.0, "turbulence_mps": 4.0}}
NOISY = {"wander_m": 2.0, "noise_m": 0.1}
READY_S = {"px4": 5.0, "ardupilot": 2.0}
FAIL_S = 31.0
FAILURES: tuple[dict[str, Any], ...] = (  # seconds after the vehicle is ready
    {"at_s": FAIL_S, "kind": "link_loss", "duration_s": 1.0},
    {"at_s": FAIL_S + 1.5, "kind": "gps_drift", "drift_mps": 1.0, "towards_deg": 70.0, "duration_s": 2.0},
    {"at_s": FAIL_S + 3.5, "kind": "battery_drop", "to_fraction": 0.1},
    {"at_s": FAIL_S + 4.5, "kind": "gps_off", "duration_s": 7.0},
    {"at_s": FAIL_S + 13.0, "kind": "motor_off", "instance": 2},
)


def rows(client: Client) -> list[Row]:
    first: list[Row] = [to(client, 0, 0, 8)] if client.vehicle.condition().mode == "GUIDED" else []
    return [
        *first,
        to(client, 0, 0, 8, 22),
        to(client, 0, 8, 8),
        bare(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0, -1),
        to(client, 6, 8, 8),
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
    client.fly(9.0)


def fly_mission(client: Client, autopilot: str) -> None:
    mode = (4, 4) if autopilot == "px4" else (3,)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *mode)
    client.fly(12.0)


def fly_setpoints(client: Client, autopilot: str) -> None:
    """Positions and velocities ten times a second, then silence until the failsafe; up to `FAIL_S`."""

    def place() -> None:
        client.setpoint(10, 4, -8)

    def speed() -> None:
        client.setpoint(0, 0, 0, mask=0xDC7, vn=-1.0, ve=1.5)

    client.fly(0.3, place)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6 if autopilot == "px4" else 4)
    client.fly(3.0, place)
    client.fly(2.0, speed)
    client.fly(READY_S[autopilot] + FAIL_S - client.vehicle.time.s)


def fly_into_failures(client: Client, autopilot: str) -> None:
    client.fly(READY_S[autopilot] + FAIL_S + 15.0 - client.vehicle.time.s)


PARTS = {"mission": fly_mission, "setpoints": fly_setpoints, "failures": fly_into_failures}
Digests = dict[str, tuple[str, str]]


def run(make: Make, autopilot: str, seed: int = 5) -> Digests:
    """Up to the end of each part: SHA-256 of everything on the wire, and of the true track with what the vehicle was at
    each moment.
    """
    wire, track = hashlib.sha256(), hashlib.sha256()

    def tap(link: str, direction: str, data: bytes) -> None:
        wire.update(direction.encode() + data)

    broken = [{**failure, "at_s": failure["at_s"] + READY_S[autopilot]} for failure in FAILURES]
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
    digests = {}
    for name, fly in PARTS.items():
        fly(client, autopilot)
        digests[name] = wire.hexdigest(), track.hexdigest()
    return digests


def printed(makes: Iterator[Make]) -> None:
    """For another process: the digests of both flights, a line each."""
    make = next(makes)
    for autopilot in READY_S:
        for part, digests in run(make, autopilot).items():
            print(autopilot, part, *digests)


def test_a_script_flown_again_is_the_same_flight(make: Make) -> None:
    """Here and in a fresh interpreter with another hash seed; nothing that is compared is empty or the same for all."""
    code = "import vehicle_client as c, test_vehicle_determinism as t; t.printed(c.make.__wrapped__())"
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    environment = {**os.environ, "PYTHONHASHSEED": "77", "PYTHONPATH": path}
    command = [sys.executable, "-W", "ignore", "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    elsewhere = [line.split() for line in done.stdout.splitlines()]
    here = {autopilot: run(make, autopilot) for autopilot in READY_S}
    assert elsewhere == [
        [autopilot, part, *digests] for autopilot, parts in here.items() for part, digests in parts.items()
    ]
    other_seed = run(make, "ardupilot", seed=6)
    every = [
        digest for parts in (*here.values(), other_seed) for digests in parts.values() for digest in digests
    ]
    assert len(set(every)) == len(every) == 18


def test_jsbsim_is_silent_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Building and flying a vehicle prints nothing and leaves nothing in the working directory."""
    monkeypatch.chdir(tmp_path)
    with open_x500(VehiclePlan(simspec(), ())) as vehicle:
        for _ in range(100):
            vehicle.step()
    # What C++ has printed waits in the C library's buffer.
    ctypes.CDLL(None).fflush(None)
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []
