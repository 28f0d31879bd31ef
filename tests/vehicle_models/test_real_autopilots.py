"""Real PX4 and ArduCopter, where REBAR_PX4 and REBAR_ARDUCOPTER name them: `make real`. It ends with a table to send.

The commands and times are those of the flights in docs/real-autopilots.md.
"""

from __future__ import annotations

import math
import os
import re
import signal
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from real_table import measured
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
            measured("firmware", opened.boot())
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


def go_to(kind: str, client: Client, north_m: float, east_m: float, height_m: float = HEIGHT_M) -> None:
    place = geodetic_e7(client, north_m, east_m)
    frame, height = (0, origin(client)[2] + height_m) if kind == "px4" else (6, height_m)
    client.command_int(mavlink.MAV_CMD_DO_REPOSITION, frame, -1.0, 1.0, 0.0, NAN, *place, height)
    wait(client, 20.0)


def position(client: Client) -> tuple[float, float, float]:
    return client.vehicle.truth().position_enu_m


def wait_until_down(client: Client, limit_s: float) -> float:
    """The seconds that it took."""
    for second in range(round(limit_s)):
        wait(client, 1.0)
        condition = client.vehicle.condition()
        if condition.landed and not condition.armed:
            return second + 1.0
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
        measured("landing from 10 m to disarmed (s)", f"{wait_until_down(client, 60.0):.0f}")
        assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=1.5)


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
                number, place, height_m = items[message.seq]
                # No delay, passed within 2 m, straight through, with whatever heading. ArduPilot refuses NaN in a return.
                is_return = number == command.MAV_CMD_NAV_RETURN_TO_LAUNCH
                # PX4 takes a return, which has no place, in no frame of places.
                at = mavlink.MAV_FRAME_MISSION if is_return else frame
                parameters = (0.0,) * 4 if is_return else (0.0, 2.0, 0.0, NAN)
                item = mavlink.MAVLink_mission_item_int_message
                client.send(item(1, 1, message.seq, at, number, 0, 1, *parameters, *place, height_m, 0))
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
        measured("farthest from a waypoint of the mission (m)", f"{max(nearest_m.values()):.1f}")
        assert max(nearest_m.values()) < 2.5, (nearest_m, client.texts())
        measured("return from 20 m to disarmed (s)", f"{wait_until_down(client, 120.0):.0f}")
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
                measured("a lost receiver is noticed after (s)", f"{client.vehicle.time.s - 40.0:.0f}")
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


def test_the_battery_is_the_one_of_the_bench(kind: str) -> None:
    """Within 3 % in flight, and again 10 s behind a drop."""
    drop = {"at_s": 60.0, "kind": "battery_drop", "to_fraction": 0.5}
    with flying(kind, failures=[drop], battery={"capacity_wh": 30.0}) as client:
        wait(client, 1.0)
        for number in (mavlink.MAVLINK_MSG_ID_SYS_STATUS, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS):
            client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 500_000)
        take_off(kind, client)
        apart = []
        for until_s in (30.0, 50.0, 58.0, 70.0, 80.0):
            wait(client, max(0.0, until_s - client.vehicle.time.s))
            told = client.last("SYS_STATUS").battery_remaining / 100.0
            apart.append(abs(told - client.vehicle.condition().battery_fraction))
        measured("battery: farthest from the bench's charge (%)", f"{100.0 * max(apart):.1f}")
        assert max(apart) <= 0.03, (apart, client.texts())
        assert client.vehicle.condition().battery_fraction < 0.5


def test_a_fall_is_told_as_a_crash(kind: str) -> None:
    """Rotors that stop at 30 m: the impact is the vehicle's end, and no failure of the bench or the firmware."""
    failures = [{"at_s": 70.0, "kind": "motor_off", "instance": number} for number in (1, 2, 3, 4)]
    with flying(kind, failures=failures) as client:
        take_off(kind, client)
        go_to(kind, client, 0.0, 0.0, height_m=30.0)
        wait(client, max(0.0, 69.0 - client.vehicle.time.s))
        assert position(client)[2] > 25.0, client.texts()
        wait(client, 8.0)
        assert client.vehicle.condition().crashed
        measured("a fall from 30 m", "crashed")


def test_no_message_ends_the_simulation(kind: str) -> None:
    """PX4 has no outputs in OFFBOARD on the ground, and none behind the end of a flight; ArduPilot always has."""
    with flying(kind) as client:
        if kind == "px4":
            client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
            wait(client, 10.0)
            client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)
            wait(client, 2.0)
        take_off(kind, client)
        client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1)
        wait(client, 8.0)
        assert position(client)[2] == pytest.approx(0.0, abs=0.5)
        unanswered = client.vehicle.counters().get("firmware_unanswered", 0)
        measured("samples without an answer, of 3,600 without a controller", unanswered)


def test_no_number_ends_the_simulation(kind: str) -> None:
    """NaN wherever a client can write a number: the SITL of ArduPilot aborts where it computes with it, by default."""
    with flying(kind) as client:
        take_off(kind, client)
        names = ("DO_CHANGE_SPEED", "CONDITION_YAW", "DO_SET_HOME", "SET_MESSAGE_INTERVAL", "BATTERY_RESET")
        for name in (*names, "DO_SET_SERVO", "DO_SET_ROI_LOCATION"):
            client.command(getattr(mavlink, f"MAV_CMD_{name}"), *[NAN] * 7)
            wait(client, 0.2)
        client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 6, *[NAN] * 4, 2**31 - 1, 2**31 - 1, NAN)
        client.setpoint(NAN, NAN, NAN)
        client.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, [NAN] * 4, NAN, NAN, NAN, NAN))
        client.put(WPNAV_SPEED=NAN)
        wait(client, 3.0)


def test_arducopter_has_the_date_of_the_scene(kind: str) -> None:
    """PX4 has the host's, which nothing of its start script sets."""
    with flying(kind) as client:
        client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYSTEM_TIME)
        wait(client, 0.4)
        start_s = client.vehicle._plan.simspec.environment.start_utc.timestamp()  # type: ignore[attr-defined]
        ahead_s = client.last("SYSTEM_TIME").time_unix_usec / 1e6 - start_s - client.vehicle.time.s
        measured("date", "the host's" if kind == "px4" else f"the scene's and {ahead_s:.1f} s")
        assert kind == "px4" or abs(ahead_s) < 2.0


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
    """ArduPilot repeats to the bit. PX4 does so in most pairs with pace `quiet`: here the difference is told.

    The second time the host is slow before the flight, as when an agent starts: ArduPilot sends its packet again then.
    """
    ends = []
    for pause_s in (0.0, 2.5):
        with flying(kind, autopilot={"pace": "quiet"}) as client:
            time.sleep(pause_s)
            take_off(kind, client)
            ends.append(position(client))
    measured("two flights at the pace quiet end apart (m)", f"{math.dist(*ends):.4f}")
    assert math.dist(*ends) < (0.1 if kind == "px4" else 1e-9)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""
