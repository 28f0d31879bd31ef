"""PREFLIGHT_REBOOT_SHUTDOWN: the flight controller begins anew, over the same aircraft and the same links."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
from test_vehicle_missions import upload
from vehicle_client import NAN, Client, Make, mavlink, of, simspec

from bench.contracts import LinkSpec, OpenVehicle, Vehicle, VehiclePlan
from bench.simspec import SimSpec
from bench.simulation._parameter_file import HasParameters
from vehicle_models import open_wing, open_x500

AUTOPILOTS = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
REBOOT, ACCEPTED, DENIED, UNSUPPORTED, FAILED = 246, 0, 2, 3, 4
ID = {"px4": "MAV_SYS_ID", "ardupilot": "SYSID_THISMAV"}
READY = 0x10000000


def names(messages: list[Any]) -> list[str]:
    return [message.get_type() for message in messages]


def put(client: Client, autopilot: str, name: str, value: int) -> None:
    kind = 6 if autopilot == "px4" else 4
    packed = struct.unpack("<f", struct.pack("<i", value))[0] if autopilot == "px4" else value
    client.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), packed, kind))
    assert "PARAM_VALUE" in names(client.fly(0.1))


def ordered(number: int, param1: float, system: int = 1) -> Any:
    return mavlink.MAVLink_command_long_message(system, 1, number, 0, param1, 0, 0, 0, 0, 0, 0)


def requested_message(client: Client, number: int, system: int = 1) -> Any:
    """The message of that number, requested."""
    client.send(ordered(mavlink.MAV_CMD_REQUEST_MESSAGE, number, system))
    return next(message for message in client.fly(0.1) if message.get_msgId() == number)


@AUTOPILOTS
def test_a_restarted_controller_begins_anew(make: Make, autopilot: str) -> None:
    """Acknowledged; then time since boot from zero, no home, not ready, the first mode; ready again when it
    was before. Parameters and the mission stay, a new system id takes effect, counts go on, and the wall
    clock does too.
    """
    ready_s = 5.0 if autopilot == "px4" else 43.0
    client = make(simspec(autopilot))
    client.fly(5.0)
    assert upload(client, [(16, 6, 0, 0, 0, NAN, 473977500, 85456500, 20.0)] * 3) == 0
    put(client, autopilot, ID[autopilot], 7)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 5)  # RTL, GUIDED
    mode = client.vehicle.condition().mode
    utc_us = requested_message(client, 2).time_unix_usec
    sent, received = client.vehicle.sent()["onboard"], client.vehicle.receive()["onboard"]
    assert client.last("HEARTBEAT").get_srcSystem() == 1
    assert client.command(REBOOT, 1) == [ACCEPTED]
    restarted_s = client.vehicle.time.s
    # A client that has read the acknowledgement is heard, by the new controller.
    assert requested_message(client, 2, system=7).time_boot_ms <= 100

    messages = client.fly(2.0)
    assert {message.get_srcSystem() for message in messages} == {7}
    assert client.vehicle.condition().mode != mode
    assert client.vehicle.sent()["onboard"] > sent
    assert client.vehicle.receive()["onboard"] > received
    clock = requested_message(client, 2, system=7)
    assert clock.time_boot_ms == pytest.approx((client.vehicle.time.s - restarted_s) * 1e3, abs=150)
    assert clock.time_unix_usec == pytest.approx(utc_us + 2.1e6, abs=3e5)
    assert not requested_message(client, 1, system=7).onboard_control_sensors_health & READY
    client.send(mavlink.MAVLink_mission_request_list_message(7, 1, 0))
    client.fly(0.1)
    assert client.last("MISSION_COUNT").count == 3

    messages = client.fly(ready_s)
    assert requested_message(client, 1, system=7).onboard_control_sensors_health & READY
    assert "HOME_POSITION" in names(messages)
    client.send(ordered(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, system=7))
    client.fly(0.1)
    assert client.vehicle.condition().armed


@AUTOPILOTS
def test_a_restart_is_refused_while_armed(make: Make, autopilot: str) -> None:
    client = make(simspec(autopilot))
    client.fly(5.0)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    assert client.command(REBOOT, 1) == [DENIED if autopilot == "px4" else FAILED]
    client.fly(0.1)
    assert client.vehicle.condition().armed
    assert requested_message(client, 2).time_boot_ms > 5000


@AUTOPILOTS
def test_other_values_restart_nothing(make: Make, autopilot: str) -> None:
    """0 and shutting down; time goes on."""
    client = make(simspec(autopilot))
    client.fly(5.0)
    results = [client.command(REBOOT, value) for value in (0, 2)]
    assert results == ([[ACCEPTED], [DENIED]] if autopilot == "px4" else [[UNSUPPORTED], [UNSUPPORTED]])
    assert requested_message(client, 2).time_boot_ms > 5000


def test_requested_streams_end_with_a_restart(make: Make) -> None:
    """Rates of REQUEST_DATA_STREAM are not saved; rates that were set as parameters are."""
    client = make(simspec("ardupilot"), system=255)
    put(client, "ardupilot", "SR0_RC_CHAN", 2)
    client.send(mavlink.MAVLink_request_data_stream_message(1, 1, 10, 4, 1))
    assert {"ATTITUDE", "RC_CHANNELS"} <= set(names(client.fly(2.0)))
    assert client.command(REBOOT, 1) == [ACCEPTED]
    messages = set(names(client.fly(3.0)))
    assert "RC_CHANNELS" in messages
    assert "ATTITUDE" not in messages
    assert isinstance(client.vehicle, HasParameters)
    assert client.vehicle.changed_parameters() == {"SR0_RC_CHAN": 2.0}


@contextmanager
def listened(
    spec: SimSpec, link: LinkSpec, open_vehicle: OpenVehicle = open_x500
) -> Iterator[tuple[Vehicle, socket.socket]]:
    with (
        open_vehicle(VehiclePlan(spec, (link,))) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
    ):
        client.connect(("127.0.0.1", int(vehicle.endpoints()["air"].split(":")[2])))
        client.setblocking(False)
        yield vehicle, client


def steps(vehicle: Vehicle, count: int) -> None:
    for _ in range(count):
        vehicle.receive()
        vehicle.step()


def all_of(client: socket.socket) -> bytes:
    data = b""
    with suppress(BlockingIOError):
        while True:
            data += client.recv(65536)
    return data


def test_the_key_and_the_counts_stay() -> None:
    """What was rejected before is rejected after it, a repeated order to restart too, and counted on."""
    with listened(simspec(), LinkSpec("air", "udp_in", signing_key="11" * 32)) as (vehicle, client):
        mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        plain = bytes(ordered(REBOOT, 1).pack(mav))
        mav.signing.secret_key, mav.signing.sign_outgoing = bytes([0x11] * 32), True
        mav.signing.timestamp = 10**14
        order = bytes(ordered(REBOOT, 1).pack(mav))
        steps(vehicle, 100)
        client.send(plain)
        client.send(order)
        steps(vehicle, 2)
        assert vehicle.counters()["mavlink_unsigned"] == 1
        client.send(plain)
        client.send(order)
        steps(vehicle, 60)
        counters = vehicle.counters()
        assert (counters["mavlink_unsigned"], counters["mavlink_old_timestamp"]) == (2, 1)
        messages = mavlink.MAVLink(None).parse_buffer(all_of(client)) or []
        boots = [message.time_boot_ms for message in of("ATTITUDE", messages)]
        assert boots[-1] == pytest.approx(1200, abs=60)


def test_the_fixed_wing_begins_anew() -> None:
    spec = simspec(vehicle={"model": "wing"})
    with listened(spec, LinkSpec("air", "udp_in", streams="none"), open_wing) as (vehicle, client):
        mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        mav.robust_parsing = True
        steps(vehicle, 300)
        client.send(bytes(ordered(REBOOT, 1).pack(mav)))
        steps(vehicle, 50)
        client.recv(1 << 16)
        client.send(bytes(ordered(mavlink.MAV_CMD_REQUEST_MESSAGE, 2).pack(mav)))
        steps(vehicle, 1)
        messages = mav.parse_buffer(client.recv(1 << 16)) or []
        (clock,) = of("SYSTEM_TIME", messages)
        assert clock.time_boot_ms == pytest.approx(1000, abs=40)


def test_a_restart_makes_the_log_no_other(make: Make) -> None:
    """Twice the same flight with a restart in it, the same bytes."""

    def log() -> bytes:
        wind = {"speed_mps": 4.0, "turbulence_mps": 4.0}
        client = make(simspec(environment={"wind": wind}), streams="onboard")
        client.fly(2.0)
        assert client.command(REBOOT, 1) == [ACCEPTED]
        client.airborne()
        return client.raw

    assert log() == log()
