"""ArduCopter's texts, terrain, wind and motor tests; and PX4's simulated battery."""

from __future__ import annotations

import math
import re
from collections import Counter

import pytest
from vehicle_client import NAN, Client, Make, simspec

from vehicle_models import TangentPlane
from vehicle_models.controller.links._dialect import dialect as mavlink

MOTOR_TEST = mavlink.MAV_CMD_DO_MOTOR_TEST
TESTED = ["starting motor test", "finished motor test"]


@pytest.fixture
def copter(make: Make) -> Client:
    client = make(simspec("ardupilot"), system=255)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    return client


def outputs(client: Client) -> list[int]:
    """Pulse widths of the four rotors."""
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW)
    m = client.last("SERVO_OUTPUT_RAW")
    return [m.servo1_raw, m.servo2_raw, m.servo3_raw, m.servo4_raw]


def test_copter_reports_leaving_and_meeting_the_ground(copter: Client) -> None:
    """Yaw alignment of both filters 2.5 m up; the speed of touching down; each flight again."""
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    for _ in range(2):
        copter.received.clear()
        assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
        assert copter.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, 0, 0, 6) == [0]
        copter.fly(3.5)
        assert copter.texts() == ["Arming motors"]
        copter.fly(4.5)
        aligned = [f"EKF3 IMU{unit} MAG0 in-flight yaw alignment complete" for unit in (0, 1)]
        assert copter.texts()[1:] == aligned
        copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 9)
        copter.fly(25.0)
        *_, hit, end = copter.texts()
        assert end == "Disarming motors"
        match = re.fullmatch(r"SIM Hit ground at (\d\.\d{6}) m/s", hit)
        assert match
        assert float(match[1]) == pytest.approx(0.5, abs=0.12)
        assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]


def test_copter_streams_terrain_and_wind(copter: Client) -> None:
    """After a start: requests for the grid of the place, reports that know nothing, wind with the receiver."""
    copter.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    copter.fly(0.02)
    copter.send(mavlink.MAVLink_request_data_stream_message(1, 1, 12, 4, 1))
    copter.fly(19.0)
    early = {message.get_type() for message in copter.received}
    assert not {"WIND", "TERRAIN_REQUEST", "TERRAIN_REPORT"} & early
    copter.fly(23.0)
    counts = Counter(message.get_type() for message in copter.fly(20.0))
    assert (counts["TERRAIN_REQUEST"], counts["TERRAIN_REPORT"], counts["WIND"]) == (10, 80, 80)
    wind, request, report = (copter.last(name) for name in ("WIND", "TERRAIN_REQUEST", "TERRAIN_REPORT"))
    assert (wind.direction, wind.speed, wind.speed_z) == (-180.0, 0.0, 0.0)
    assert (request.grid_spacing, request.mask) == (100, 2**56 - 1)
    assert (report.spacing, report.pending, report.loaded) == (0, 56, 0)
    # The south-west corner of a grid of 24 by 28 spacings that holds the vehicle.
    corner = TangentPlane(request.lat * 1e-7, request.lon * 1e-7)
    east, north = corner.east_north_m(*(math.radians(angle * 1e-7) for angle in (report.lat, report.lon)))
    assert 0.0 <= north < 2430.0
    assert 0.0 <= east < 2840.0
    copter.put(TERRAIN_SPACING=30)
    copter.fly(2.0)
    assert copter.last("TERRAIN_REQUEST").grid_spacing == 30
    copter.put(TERRAIN_ENABLE=0)
    copter.fly(0.02)
    assert "TERRAIN_REPORT" not in {message.get_type() for message in copter.fly(3.0)}


def test_copter_turns_rotors_one_by_one(copter: Client) -> None:
    """Two rotors for a second each, a pause between; it looks armed and stays where it stands."""
    copter.fly(30.0)
    before = copter.vehicle.truth().position_enu_m
    assert copter.command(MOTOR_TEST, 1, 0, 30, 1.0, 2) == [0]
    copter.fly(0.5)
    assert outputs(copter) == [pytest.approx(1300, abs=15), 1000, 1000, 1000]
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HEARTBEAT)
    assert copter.last("HEARTBEAT").base_mode & 128
    assert not copter.vehicle.condition().armed
    copter.fly(0.9)
    assert max(outputs(copter)) < 1010
    copter.fly(0.5)
    # Clockwise: the rear right is number 4.
    assert outputs(copter) == [1000, 1000, 1000, pytest.approx(1300, abs=15)]
    copter.fly(2.0)
    assert max(outputs(copter)) < 1010
    copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HEARTBEAT)
    assert not copter.last("HEARTBEAT").base_mode & 128
    assert [text for text in copter.texts() if "motor test" in text] == TESTED
    assert copter.vehicle.truth().position_enu_m == pytest.approx(before, abs=0.02)


@pytest.mark.parametrize(
    "nonsense", [(1, 0, 150, 1), (1, 1, 2500, 1), (1, 9, 10, 1), (1, 0, NAN, 1), (NAN, NAN, NAN, NAN, NAN)]
)
def test_copter_ends_a_senseless_motor_test(copter: Client, nonsense: tuple[float, ...]) -> None:
    """Acknowledged and over at once, after the source; no rotor turns."""
    copter.fly(3.0)
    assert copter.command(MOTOR_TEST, *nonsense) == [0]
    assert max(outputs(copter)) == 1000
    assert [text for text in copter.texts() if "motor test" in text] == TESTED


def test_a_motor_test_ends_when_the_vehicle_is_armed(copter: Client) -> None:
    assert copter.command(MOTOR_TEST, 1, 1, 1200, 500) == [0]
    copter.fly(1.0)
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    copter.fly(0.5)
    assert "finished motor test" in copter.texts()
    assert copter.command(MOTOR_TEST, 1, 1, 1200, 500) == [4]
    assert copter.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, 0, 0, 6) == [0]
    copter.fly(8.0)
    assert copter.vehicle.truth().position_enu_m[2] == pytest.approx(6.0, abs=0.3)


def test_a_motor_test_is_no_time_for_a_restart(copter: Client) -> None:
    """Its motors count as armed. Another test takes the place of the one that runs."""
    copter.fly(3.0)
    assert copter.command(MOTOR_TEST, 2, 0, 20, 500) == [0]
    copter.fly(1.0)
    assert copter.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == [4]
    assert outputs(copter) == [1000, 1000, 1000, pytest.approx(1200, abs=15)]
    assert copter.command(MOTOR_TEST, 3, 0, 20, 500) == [0]
    copter.fly(1.0)
    assert outputs(copter) == pytest.approx([1000, 1200, 1000, 1000], abs=15)


def test_an_empty_battery_turns_no_rotor(make: Make) -> None:
    failure = {"at_s": 4.0, "kind": "battery_drop", "to_fraction": 0.0}
    client = make(simspec("ardupilot", vehicle={"failures": [failure]}), system=255)
    client.fly(1.9)
    assert client.command(MOTOR_TEST, 1, 0, 30, 500) == [0]
    client.fly(0.7)
    assert outputs(client)[0] == pytest.approx(1300, abs=15)
    client.fly(1.5)
    assert max(outputs(client)) < 1010


def battery_percent(client: Client) -> float:
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    return float(client.last("SYS_STATUS").battery_remaining)


def test_px4_simulates_a_battery_by_its_parameters(make: Make) -> None:
    """By the clock while armed, down to SIM_BAT_MIN_PCT, full when disarmed; the true charge is another."""
    client = make(simspec(vehicle={"parameters": {"SIM_BAT_DRAIN": 20.0, "SIM_BAT_MIN_PCT": 30.0}}))
    client.fly(5.0)
    assert battery_percent(client) == 100
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.fly(5.0)
    assert battery_percent(client) == pytest.approx(75, abs=1)
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    assert client.last("SYS_STATUS").voltage_battery == pytest.approx(4000 * (3.6 + 0.45 * 0.75), abs=30)
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 491.0) == [0]
    client.fly(15.0)
    assert battery_percent(client) == 30
    assert client.vehicle.condition().battery_fraction > 0.9
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == [0]
    client.fly(0.1)
    assert battery_percent(client) == 100


def test_px4_simulated_battery_triggers_its_failsafe_again_after_charging(make: Make) -> None:
    """A charge that falls below 15 % is reported once in each flight."""
    parameters = {"SIM_BAT_DRAIN": 5.0, "SIM_BAT_MIN_PCT": 12.0, "COM_DISARM_PRFLT": 0.0}
    client = make(simspec(vehicle={"parameters": parameters}))
    client.fly(5.0)
    for times in (1, 2):
        assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
        client.fly(6.0)
        assert [text.strip() for text in client.texts()].count("Low battery") == times
        assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [0]
        client.fly(0.1)


def test_px4_reports_the_true_battery_where_none_is_simulated(make: Make) -> None:
    client = make(simspec(vehicle={"parameters": {"SIM_BAT_DRAIN": 5.0, "SIM_BAT_ENABLE": 0.0}}))
    client.fly(5.0)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.fly(6.0)
    assert battery_percent(client) == round(100.0 * client.vehicle.condition().battery_fraction) > 90
