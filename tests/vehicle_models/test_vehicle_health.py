"""From power-up to readiness: bits, flags, texts and refusals at their times; and an ArduCopter that is ready at once."""

from __future__ import annotations

import math
import socket
from contextlib import closing

import pytest
from vehicle_client import Client, Make, of, simspec

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_x500
from vehicle_models.controller.links._dialect import dialect as mavlink

PREARM = 0x10000000


@pytest.fixture
def copter(make: Make) -> Client:
    """An ArduCopter that was started again, so that its start is seen."""
    client = make(simspec("ardupilot"), system=255)
    client.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    client.fly(1.1)
    client.received.clear()
    client.beat()
    return client


def running_s(client: Client) -> float:
    """Since the autopilot's start."""
    seconds: float = client.vehicle._flight.time_s  # type: ignore[attr-defined]
    return seconds


def until(client: Client, second: float) -> None:
    client.fly(second - running_s(client))


def test_a_copter_has_booted_before_the_session(make: Make) -> None:
    """Armed by the first words; its clock is 50 s ahead, the world's is not. What it said at boot is not repeated."""
    client = make(simspec("ardupilot"), system=255)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    assert client.texts() == ["Arming motors"]
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYSTEM_TIME)
    clock = client.last("SYSTEM_TIME")
    assert clock.time_boot_ms == pytest.approx(client.vehicle.time.s * 1e3 + 50_000, abs=20)
    begun_us = simspec("ardupilot").environment.start_utc.timestamp() * 1e6
    assert clock.time_unix_usec == pytest.approx(begun_us + client.vehicle.time.s * 1e6, abs=2e4)


def test_a_copter_tells_home_and_ground_pressures_while_nobody_is_there(make: Make) -> None:
    """A client that speaks before the first step hears neither; it may ask."""
    spec, client = simspec("ardupilot"), Client(255)
    link = LinkSpec("onboard", "tcp_in")
    with closing(client.socket), open_x500(VehiclePlan(spec, (link,))) as vehicle:
        address = vehicle.endpoints()["onboard"].split(":")
        with socket.create_connection((address[1], int(address[2]))) as stream:
            stream.sendall(bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(client.mav)))
            for _ in range(100):
                vehicle.receive()
                vehicle.step()
            messages = client.mav.parse_buffer(stream.recv(65536)) or []
    kinds = {message.get_type() for message in messages}
    assert "HEARTBEAT" in kinds
    assert not {"HOME_POSITION", "GPS_GLOBAL_ORIGIN", "PARAM_VALUE", "STATUSTEXT"} & kinds


def bits(client: Client) -> tuple[int, int, int]:
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    m = client.last("SYS_STATUS")
    enabled = m.onboard_control_sensors_enabled
    return m.onboard_control_sensors_present, enabled, m.onboard_control_sensors_health


def test_copter_bits_through_the_start(copter: Client) -> None:
    """As the SITL showed them, without the bit of logging, which the vehicle here does not do."""
    for second, shown in (
        (2.5, (0x5231FC0F, 0x52019C0F, 0x44119C0B)),
        (5.0, (0x5271FC0F, 0x52419C0F, 0x46519C0F)),
        (10.0, (0x5271FC2F, 0x52419C2F, 0x46519C2F)),
        (22.6, (0x5271FC2F, 0x52619C2F, 0x46719C2F)),
        (24.0, (0x5271FC2F, 0x52619C2F, 0x56719C2F)),
    ):
        until(copter, second)
        assert bits(copter) == shown, second
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    assert bits(copter)[2] & PREARM == 0
    until(copter, 43.0)
    assert bits(copter) == (0x5271FC2F, 0x5261FC2F, 0x5671FC2F)
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    assert bits(copter)[1] == 0x5261FC2F


def test_copter_has_no_local_position_before_its_estimator_has_one(copter: Client) -> None:
    """LOCAL_POSITION_NED is silent until 41.5 s, though home and the other position are sent from 20 s."""
    for name in ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "HOME_POSITION"):
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
        assert copter.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 200_000) == [0]
    until(copter, 41.4)
    kinds = {message.get_type() for message in copter.received}
    assert {"GLOBAL_POSITION_INT", "HOME_POSITION"} <= kinds
    assert "LOCAL_POSITION_NED" not in kinds
    assert all(math.isnan(axis) for axis in copter.last("HOME_POSITION").q)
    until(copter, 42.0)
    assert copter.last("LOCAL_POSITION_NED").time_boot_ms >= 41_500


def test_copter_arms_as_soon_as_its_estimator_shows_a_position(copter: Client) -> None:
    """A script that arms in GUIDED once, at the first report with flags 831, is not refused."""
    until(copter, 10.0)
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT)
    assert copter.last("EKF_STATUS_REPORT").flags == 167
    until(copter, 40.0)
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    assert copter.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 193, 100_000) == [0]
    while running_s(copter) < 45.0:
        reports = of("EKF_STATUS_REPORT", copter.fly(0.1))
        if reports and reports[-1].flags == 831:
            break
        assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [4]
    assert running_s(copter) == pytest.approx(41.5, abs=0.2)
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]


@pytest.mark.parametrize(
    ("second", "mode", "texts"),
    [
        (1.2, 0, ["System not initialised"]),
        (5.0, 0, ["Accels inconsistent", "EKF attitude is bad", "AHRS: EKF3 still initialising"]),
        (8.0, 0, ["AHRS: EK3 sources require GPS"]),
        (15.0, 0, ["AHRS: waiting for home"]),
        (25.0, 4, ["Need Position Estimate"]),
    ],
)
def test_copter_says_each_check_that_keeps_it_from_arming(
    copter: Client, second: float, mode: int, texts: list[str]
) -> None:
    """FAILED and a text for each; by force likewise, since these checks are mandatory."""
    until(copter, second)
    if mode:
        assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode) == [0]
        copter.fly(1.1)
    for force in (0, 21196):
        copter.received.clear()
        assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, force) == [4]
        told = [text for text in copter.texts() if text.startswith("Arm: ")]
        assert told == [f"Arm: {text}" for text in texts]


def test_copter_repeats_what_fails(copter: Client) -> None:
    """Failing checks of a mode are sent at once, then every 30 s; on request, at any time."""
    until(copter, 30.5)
    assert not [text for text in copter.texts() if text.startswith("PreArm")]
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    copter.fly(1.1)
    told = [text for text in copter.texts() if text.startswith("PreArm")]
    assert told == ["PreArm: Need Position Estimate"]
    assert copter.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == [0]
    assert copter.texts().count("PreArm: Need Position Estimate") == 2
    until(copter, 43.0)
    assert copter.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == [0]
    assert copter.texts().count("PreArm: Need Position Estimate") == 2
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    assert copter.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == [1]


def test_a_low_battery_keeps_a_copter_from_arming(copter: Client) -> None:
    until(copter, 43.0)
    copter.put(SIM_BATT_VOLTAGE=9.0)
    copter.fly(0.1)
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [4]
    assert [text for text in copter.texts() if text.startswith("Arm: ")] == [
        "Arm: Battery 1 low voltage failsafe",
        "Arm: Battery failsafe",
    ]


def test_copter_boot_texts(copter: Client) -> None:
    """Heard from 1.1 s on, where this client first spoke."""
    until(copter, 42.0)
    assert copter.texts() == [
        "Barometer 1 calibration complete",
        "Barometer 2 calibration complete",
        "ArduPilot Ready",
        "AHRS: DCM active",
        "RC7: SaveWaypoint LOW",
        "EKF3 IMU0 initialised",
        "EKF3 IMU1 initialised",
        "AHRS: EKF3 active",
        "EKF3 IMU0 tilt alignment complete",
        "EKF3 IMU1 tilt alignment complete",
        "EKF3 IMU0 MAG0 initial yaw alignment complete",
        "EKF3 IMU1 MAG0 initial yaw alignment complete",
        "GPS 1: probing for u-blox at 230400 baud",
        "GPS 1: detected u-blox",
        "EKF3 IMU0 origin set",
        "Field Elevation Set: 488m",
        "EKF3 IMU1 origin set",
        "EKF3 IMU0 is using GPS",
        "EKF3 IMU1 is using GPS",
    ]


def test_px4_is_ready_after_four_seconds(make: Make) -> None:
    """The PREARM bit of health alone, from 4.2 s on; without satellites for long it goes again."""
    client = make(simspec(vehicle={"failures": [{"at_s": 5.0, "kind": "gps_off"}]}))
    until(client, 4.1)
    assert bits(client)[2] & PREARM == 0
    until(client, 4.3)
    present, enabled, health = bits(client)
    assert (present & PREARM, enabled & PREARM, health & PREARM) == (0, 0, PREARM)
    until(client, 10.2)
    assert bits(client)[2] & PREARM == 0
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [1]
