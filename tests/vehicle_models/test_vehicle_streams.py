"""Who gets which message how often: the default sets, groups, parameters, intervals and requests."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import pytest
from vehicle_client import NAN, Client, Make, of, simspec

from vehicle_models.controller.links._dialect import dialect as mavlink

# What was observed on PX4's links.
BOTH = {
    "HEARTBEAT": 1,
    "ATTITUDE_QUATERNION": 50,
    "GLOBAL_POSITION_INT": 50,
    "SCALED_PRESSURE": 1,
    "LINK_NODE_STATUS": 1,
    "OPEN_DRONE_ID_LOCATION": 1,
    "OPEN_DRONE_ID_SYSTEM": 1,
    "MISSION_CURRENT": 1,
    "BATTERY_STATUS": 0.5,
    "HOME_POSITION": 0.5,
    "CURRENT_MODE": 0.5,
    "TIME_ESTIMATE_TO_TARGET": 0.5,
    "CURRENT_EVENT_SEQUENCE": 1 / 3,
}
ONBOARD = BOTH | {
    "ATTITUDE": 100,
    "ESC_INFO": 10,
    "ESC_STATUS": 10,
    "LOCAL_POSITION_NED": 30,
    "ODOMETRY": 30,
    "HIGHRES_IMU": 50,
    "SERVO_OUTPUT_RAW": 10,
    "ATTITUDE_TARGET": 10,
    "POSITION_TARGET_LOCAL_NED": 10,
    "GPS_RAW_INT": 8,
    "VFR_HUD": 10,
    "ALTITUDE": 10,
    "DISTANCE_SENSOR": 10,
    "TIMESYNC": 10,
    "SYS_STATUS": 5,
    "EXTENDED_SYS_STATE": 5,
    "SYSTEM_TIME": 1,
    "PING": 1,
    "ESTIMATOR_STATUS": 1,
    "VIBRATION": 0.5,
}
GCS = BOTH | {
    "ATTITUDE": 50,
    "LOCAL_POSITION_NED": 50,
    "SERVO_OUTPUT_RAW": 50,
    "ATTITUDE_TARGET": 50,
    "POSITION_TARGET_LOCAL_NED": 50,
    "GPS_RAW_INT": 5,
    "VFR_HUD": 4,
    "ALTITUDE": 1,
    "DISTANCE_SENSOR": 0.5,
    "SYS_STATUS": 1,
    "EXTENDED_SYS_STATE": 1,
    "PING": 0.1,
    "ESTIMATOR_STATUS": 0.5,
    "VIBRATION": 0.1,
}


def counted(client: Client, seconds: float) -> dict[str, float]:
    counts = Counter(message.get_type() for message in client.fly(seconds))
    return {name: count / seconds for name, count in counts.items()}


@pytest.mark.parametrize(("streams", "rates"), [("onboard", ONBOARD), ("gcs", GCS)])
def test_px4_streams_what_the_real_one_does(make: Make, streams: str, rates: dict[str, float]) -> None:
    """On the ground, disarmed: every message at its rate, and no others (texts and events aside)."""
    client = make(streams=streams)
    client.fly(5.0)
    measured = counted(client, 30.0)
    for aside in ("STATUSTEXT", "EVENT"):
        measured.pop(aside, None)
    assert set(measured) == set(rates)
    assert measured == pytest.approx(rates, rel=0.04)


def test_attitudes_between_two_steps_are_those_of_the_middle(make: Make) -> None:
    """10 ms apart; each lies where the rate of its neighbours leads."""
    client = make(streams="onboard")
    client.airborne(5.0)
    place = client.vehicle_goal(0.0, 30.0)
    client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, -1, 1, 0, NAN, *place, 493.0)
    rows = of("ATTITUDE", client.fly(3.0))
    assert (client.last("ESC_INFO").count, client.last("ESC_INFO").info) == (4, 15)
    assert len(rows) == 300
    assert {after.time_boot_ms - before.time_boot_ms for before, after in pairwise(rows)} == {10}
    turned = [abs(after.pitch - before.pitch) for before, after in pairwise(rows)]
    assert max(turned) > 0.005
    for before, after in pairwise(rows):
        led_rad = 0.005 * (before.pitchspeed + after.pitchspeed)
        assert after.pitch - before.pitch == pytest.approx(led_rad, abs=0.002)


def test_copter_by_group(make: Make) -> None:
    """REQUEST_DATA_STREAM 1 and 10 at 4 Hz, stopped again; the parameters show it."""
    client = make(simspec("ardupilot"), system=255)
    for group in (1, 10):
        client.send(mavlink.MAVLink_request_data_stream_message(1, 1, group, 4, 1))
    client.fly(1.0)
    measured = counted(client, 4.0)
    of_groups = ["RAW_IMU", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE", "SCALED_PRESSURE2"]
    of_groups += ["ATTITUDE", "SIMSTATE", "AHRS2"]
    assert [measured[name] for name in of_groups] == [4.0] * len(of_groups)
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"SR0_EXTRA1", -1))
    client.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 0))
    client.fly(0.1)
    assert client.last("PARAM_VALUE").param_value == 4.0
    assert not set(counted(client, 4.0)) & set(of_groups)


def test_copter_rates_by_parameter(make: Make) -> None:
    """SR0_* given at the start, or set later, stream on the first link; interval 0 goes back to them."""
    client = make(simspec("ardupilot", vehicle={"parameters": {"SR0_POSITION": 5}}), system=255)
    assert counted(client, 4.0)["GLOBAL_POSITION_INT"] == 5.0
    for interval_us, rate in ((100_000, 10.0), (0, 5.0)):
        number = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
        assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, interval_us) == [0]
        assert counted(client, 4.0)["GLOBAL_POSITION_INT"] == pytest.approx(rate, abs=0.3)
    client.put(SR0_POSITION=0)
    client.fly(0.1)
    assert "GLOBAL_POSITION_INT" not in counted(client, 2.0)


def test_copter_promises_messages_of_devices_that_are_not_there(make: Make) -> None:
    """Accepted, and nothing comes; what has no place at all is FAILED."""
    client = make(simspec("ardupilot"), system=255)
    no_place = mavlink.MAVLINK_MSG_ID_AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_EXT
    for number, result in ((259, 0), (124, 0), (132, 0), (226, 0), (no_place, 4)):
        assert client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number) == [result]
    heard = {message.get_type() for message in client.fly(1.0)}
    assert not {"CAMERA_INFORMATION", "GPS2_RAW", "DISTANCE_SENSOR", "RPM"} & heard
    assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 1000) == [2]


def test_long_texts_come_in_pieces(make: Make) -> None:
    """50 characters and the tab behind them: a second piece with nothing but the tab, and the same id."""
    client = make()
    client.fly(1.0)
    client.vehicle._controller._context.texts.send(6, "x" * 50)  # type: ignore[attr-defined]
    pieces = of("STATUSTEXT", client.fly(0.1))
    assert [(piece.text, piece.chunk_seq) for piece in pieces] == [("x" * 50, 0), ("\t", 1)]
    assert len({piece.id for piece in pieces}) == 1
    assert pieces[0].id > 0
