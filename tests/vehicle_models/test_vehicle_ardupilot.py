"""The ardupilot autopilot: the same services under other policies."""

from __future__ import annotations

from collections import Counter

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import Client, Make, simspec

# pymavlink follows ArduPilot's definitions, which lack this message.
PROTOCOL_VERSION = 300
ACCEPTED, _, DENIED, UNSUPPORTED, FAILED = range(5)


@pytest.fixture
def copter(make: Make) -> Client:
    """An ArduCopter with streams at 10 Hz, ready to be armed in GUIDED."""
    client = make(simspec("ardupilot"), streams="onboard", system=255)
    client.learn_home()
    client.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 10, 1))
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [ACCEPTED]
    return client


def test_a_silent_client_hears_heartbeats_and_nothing_else(make: Make) -> None:
    """No texts, no position: everything has to be requested. TIMESYNC comes every ten seconds."""
    client = make(simspec("ardupilot"), streams="onboard")
    client.fly(20.5)
    assert Counter(message.get_type() for message in client.received) == {"HEARTBEAT": 21, "TIMESYNC": 3}
    assert (client.received[0].base_mode, client.received[0].system_status) == (81, 3)
    beat = client.last("HEARTBEAT")
    assert (beat.autopilot, beat.base_mode, beat.custom_mode, beat.system_status) == (3, 81, 0, 3)


def test_data_streams_come_at_the_requested_rate(copter: Client) -> None:
    """Group 0 is all of them, at exactly the rate; POSITION_TARGET is in no group."""
    counts = Counter(message.get_type() for message in copter.fly(4.0))
    for name in ("ATTITUDE", "GLOBAL_POSITION_INT", "SYS_STATUS", "VFR_HUD", "EKF_STATUS_REPORT", "RAW_IMU"):
        assert counts[name] == pytest.approx(40, abs=1)
    assert counts["EXTENDED_SYS_STATE"] == 0
    assert copter.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 9999, 100_000) == [DENIED]
    assert "No ap_message for mavlink id (9999)" in copter.texts()
    assert copter.command(mavlink.MAV_CMD_REQUEST_MESSAGE, PROTOCOL_VERSION) == [FAILED]


def test_guided_flight(copter: Client) -> None:
    """Takeoff without a mode of its own, a position, and RTL with a climb to 15 m, as the heartbeats show them."""
    assert copter.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == [FAILED], "disarmed"
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 2) == [UNSUPPORTED]
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    assert copter.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == [ACCEPTED]
    copter.fly(1.1)
    assert (copter.last("HEARTBEAT").base_mode, copter.last("HEARTBEAT").custom_mode) == (217, 4)
    copter.fly(9.0)
    assert copter.vehicle.truth().position_enu_m[2] == pytest.approx(10.0, abs=0.3)
    copter.setpoint(20, 5, -12)
    copter.fly(10.0)
    assert copter.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [ACCEPTED]
    copter.fly(4.0)
    assert copter.vehicle.truth().position_enu_m[2] == pytest.approx(15.0, abs=0.5)
    # A return shows the bit of a mode that steers position while it is flown.
    assert (copter.last("HEARTBEAT").base_mode, copter.last("HEARTBEAT").custom_mode) == (217, 6)
    copter.fly(50.0)
    assert (copter.last("HEARTBEAT").base_mode, copter.last("HEARTBEAT").custom_mode) == (81, 6)
    condition = copter.vehicle.condition()
    assert (condition.armed, condition.landed, condition.mode) == (False, True, "RTL")
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [FAILED]
    assert "Arm: RTL mode not armable" in copter.texts()


def test_a_takeoff_begun_late_is_flown(copter: Client) -> None:
    """Idle for 10 s it would be disarmed, but its rotors spool up by then."""
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    copter.fly(9.0)
    assert copter.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == [ACCEPTED]
    copter.fly(9.0)
    assert copter.vehicle.truth().position_enu_m[2] > 9.0
