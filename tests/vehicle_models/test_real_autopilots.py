"""Real PX4 and ArduCopter, where REBAR_PX4 and REBAR_ARDUCOPTER name them: `make real`. Never run against a real one so far.

The commands and times are those of the flights in docs/real-autopilots.md.
"""

from __future__ import annotations

import math
import os
import re
import signal
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from vehicle_client import NAN, Client, mavlink, simspec

from bench.contracts import LinkSpec, VehiclePlan
from bench.errors import FirmwareFault
from vehicle_models.firmware import FirmwareX500, open_firmware_x500
from vehicle_models.firmware._ardupilot import RunningArduPilot
from vehicle_models.firmware._px4 import RunningPx4

PLACES = {"px4": "REBAR_PX4", "ardupilot": "REBAR_ARDUCOPTER"}
HEIGHT_M = 10.0
SIDE_M = 20.0
_AUTO, _GUIDED = 3, 4

pytestmark = [pytest.mark.real, pytest.mark.timeout(1800)]


@pytest.fixture(params=list(PLACES))
def kind(request: pytest.FixtureRequest) -> str:
    variable = PLACES[str(request.param)]
    if not os.environ.get(variable):
        pytest.skip(f"{variable} is not set: it names the real autopilot's place (docs/real-autopilots.md)")
    return str(request.param)


@contextmanager
def flying(kind: str, **vehicle: Any) -> Generator[Client]:
    """A booted vehicle and its client."""
    client = Client(system=255)
    autopilot = {"kind": kind, "firmware": os.environ[PLACES[kind]], **vehicle.pop("autopilot", {})}
    spec = simspec(vehicle={"simulation_control": False, "autopilot": autopilot, **vehicle})
    link = LinkSpec("onboard", "udp_out", port=client.port)
    try:
        with open_firmware_x500(VehiclePlan(spec, (link,))) as opened:
            print(opened.boot())
            client.vehicle = opened
            client.fly(1.5)
            yield client
    finally:
        client.socket.close()


def wait(client: Client, span_s: float) -> None:
    """Let time pass with a ground station that is there: ten heartbeats a second, which no failsafe minds."""
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    client.fly(span_s, lambda: client.send(beat))


def take_off(kind: str, client: Client) -> None:
    altitude = HEIGHT_M
    if kind == "px4":
        altitude += origin(client)[2]
    else:
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, _GUIDED)
        wait(client, 1.0)
    client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    wait(client, 1.0)
    assert client.vehicle.condition().armed, client.texts()
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, altitude)
    wait(client, 20.0)


def origin(client: Client) -> tuple[float, float, float]:
    vehicle = client.vehicle
    assert isinstance(vehicle, FirmwareX500)
    place = vehicle._plan.simspec.world.origin
    return place.latitude_deg, place.longitude_deg, place.altitude_m


def go_to(kind: str, client: Client, north_m: float, east_m: float) -> None:
    latitude, longitude, altitude = origin(client)
    latitude_e7 = round((latitude + north_m / 111_170.0) * 1e7)
    longitude_e7 = round((longitude + east_m / (111_320.0 * math.cos(math.radians(latitude)))) * 1e7)
    frame, height = (0, altitude + HEIGHT_M) if kind == "px4" else (6, HEIGHT_M)
    client.command_int(
        mavlink.MAV_CMD_DO_REPOSITION, frame, -1.0, 1.0, 0.0, NAN, latitude_e7, longitude_e7, height
    )
    wait(client, 20.0)


def position(client: Client) -> tuple[float, float, float]:
    return client.vehicle.truth().position_enu_m


def wait_until_down(client: Client, limit_s: float) -> None:
    for _ in range(round(limit_s)):
        wait(client, 1.0)
        condition = client.vehicle.condition()
        if condition.landed and not condition.armed:
            return
    pytest.fail(f"not down and disarmed after {limit_s} s: {client.vehicle.condition()}, {client.texts()}")


def test_takeoff_square_and_landing(kind: str) -> None:
    with flying(kind) as client:
        take_off(kind, client)
        assert position(client) == pytest.approx((0.0, 0.0, HEIGHT_M), abs=1.0)
        for north_m, east_m in ((SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M), (0.0, 0.0)):
            go_to(kind, client, north_m, east_m)
            assert position(client) == pytest.approx((east_m, north_m, HEIGHT_M), abs=1.5)
            assert client.vehicle.estimate().position_enu_m == pytest.approx(position(client), abs=1.5)
        client.command(mavlink.MAV_CMD_NAV_LAND)
        wait_until_down(client, 60.0)
        assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=1.5)


def test_return_to_launch(kind: str) -> None:
    with flying(kind) as client:
        take_off(kind, client)
        go_to(kind, client, SIDE_M, 0.0)
        client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
        wait_until_down(client, 120.0)
        assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=2.0)


def upload(kind: str, client: Client, places: list[tuple[float, float]]) -> None:
    """A takeoff, these places north and east at 10 m, and a return. Item 0 of ArduPilot is its home."""
    command, frame = mavlink, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    home = geodetic_e7(client, 0.0, 0.0)
    items = [(command.MAV_CMD_NAV_WAYPOINT, home, 0.0)] if kind == "ardupilot" else []
    items.append((command.MAV_CMD_NAV_TAKEOFF, home, HEIGHT_M))
    items += [(command.MAV_CMD_NAV_WAYPOINT, geodetic_e7(client, *place), HEIGHT_M) for place in places]
    items.append((command.MAV_CMD_NAV_RETURN_TO_LAUNCH, (0, 0), 0.0))
    client.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
    for _ in range(200):
        for message in client.fly(0.1):
            if message.get_type() in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
                number, (latitude_e7, longitude_e7), height_m = items[message.seq]
                place = (latitude_e7, longitude_e7, height_m)
                # PX4 takes a return, which has no place, in no frame of places.
                at = mavlink.MAV_FRAME_MISSION if number == command.MAV_CMD_NAV_RETURN_TO_LAUNCH else frame
                # No delay, passed within 2 m, straight through, with whatever heading.
                parameters = (0.0, 2.0, 0.0, NAN)
                client.send(
                    mavlink.MAVLink_mission_item_int_message(
                        1, 1, message.seq, at, number, 0, 1, *parameters, *place, 0
                    )
                )
            elif message.get_type() == "MISSION_ACK":
                assert message.type == 0, message
                return
    pytest.fail(f"no MISSION_ACK: {client.texts()}")


def geodetic_e7(client: Client, north_m: float, east_m: float) -> tuple[int, int]:
    latitude, longitude, _ = origin(client)
    scale = 111_320.0 * math.cos(math.radians(latitude))
    return round((latitude + north_m / 111_170.0) * 1e7), round((longitude + east_m / scale) * 1e7)


def test_a_mission_passes_its_places_and_returns(kind: str) -> None:
    places = [(SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M)]
    with flying(kind) as client:
        upload(kind, client, places)
        if kind == "ardupilot":
            client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, _GUIDED)
            wait(client, 1.0)
        client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        wait(client, 1.0)
        assert client.vehicle.condition().armed, client.texts()
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *((4, 4) if kind == "px4" else (_AUTO,)))
        if kind == "ardupilot":
            wait(client, 0.5)
            client.command(mavlink.MAV_CMD_MISSION_START)
        nearest_m = dict.fromkeys(places, math.inf)
        for _ in range(600):
            wait(client, 0.2)
            east_m, north_m, _ = position(client)
            for place in places:
                nearest_m[place] = min(nearest_m[place], math.dist(place, (north_m, east_m)))
            condition = client.vehicle.condition()
            if condition.landed and not condition.armed and max(nearest_m.values()) < math.inf:
                break
        # PX4 passes within its acceptance radius of 2 m, ArduCopter within WPNAV_RADIUS of 2 m.
        assert max(nearest_m.values()) < 2.5, (nearest_m, client.texts())
        wait_until_down(client, 120.0)
        assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=2.0)


def test_a_lost_receiver_is_noticed(kind: str) -> None:
    """No fixes from 40 s on: within 40 s the autopilot says that a failsafe acts, or has left its mode."""
    with flying(kind, failures=[{"at_s": 40.0, "kind": "gps_off"}]) as client:
        take_off(kind, client)
        mode = client.vehicle.condition().mode
        wait(client, max(0.0, 40.0 - client.vehicle.time.s))
        for _ in range(40):
            wait(client, 1.0)
            condition = client.vehicle.condition()
            if condition.failsafe or condition.mode != mode:
                assert condition.failures
                return
        pytest.fail(f"nothing noticed: {client.texts()}")


def test_a_receiver_that_drifts_takes_the_vehicle_along(kind: str) -> None:
    """Fixes drift east by half a metre a second for 20 s from the 40th: the vehicle goes west to stay where it believes to be."""
    drift = {"at_s": 40.0, "kind": "gps_drift", "duration_s": 60.0, "drift_mps": 0.5, "towards_deg": 90.0}
    with flying(kind, failures=[drift]) as client:
        take_off(kind, client)
        wait(client, max(0.0, 60.0 - client.vehicle.time.s))
        east_m, _, up_m = position(client)
        assert east_m < -4.0
        assert up_m == pytest.approx(HEIGHT_M, abs=2.0)


def test_a_kill_in_mid_air_is_the_fault_of_the_firmware(kind: str) -> None:
    with flying(kind) as client:
        take_off(kind, client)
        vehicle = client.vehicle
        assert isinstance(vehicle, FirmwareX500)
        running = vehicle._running
        assert isinstance(running, RunningPx4 | RunningArduPilot)
        os.kill(running.program.pid, signal.SIGKILL)
        with pytest.raises(FirmwareFault, match=re.escape("SIGKILL")):
            client.fly(1.0)


def test_twenty_sessions_in_a_row_leave_nothing(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for _ in range(20):
        with flying(kind, autopilot={"boot_s": 5.0}) as client:
            client.fly(1.0)
        assert list(tmp_path.iterdir()) == []
        homes = [
            path for path in Path("/proc").glob("[0-9]*/environ") if str(tmp_path).encode() in _read(path)
        ]
        assert homes == []


def test_two_quiet_or_lockstep_flights_are_equal(kind: str) -> None:
    """ArduPilot repeats to the bit. PX4 does so in most pairs with pace `quiet`: here the difference is told."""
    ends = []
    for _ in range(2):
        with flying(kind, autopilot={"pace": "quiet"}) as client:
            take_off(kind, client)
            ends.append(position(client))
    print(f"{kind}: two flights end {math.dist(*ends):.4f} m apart")
    assert math.dist(*ends) < (0.1 if kind == "px4" else 1e-9)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""
