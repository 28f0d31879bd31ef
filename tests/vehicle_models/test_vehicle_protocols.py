"""Protocols that clients wait for: calibration, logs, shell, streams that stay silent, flight information."""

from __future__ import annotations

import pytest
from vehicle_client import Client, Make, of, simspec

from vehicle_models.controller.links._dialect import dialect as mavlink

ACCEPTED, REJECTED, DENIED, _, FAILED = range(5)
SHELL, REPLY = 10, 1


def calibrate(client: Client, *params: float) -> list[int]:
    return client.command(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, *params)


def test_a_gyro_calibration_ends_with_its_text(make: Make) -> None:
    """What MAVSDK waits for: started, progress up to 100, done; a second one is refused meanwhile."""
    client = make()
    client.fly(5.0)
    client.received.clear()
    assert calibrate(client, 1) == [ACCEPTED]
    assert calibrate(client, 0, 0, 1) == [REJECTED]
    client.fly(3.5)
    started, *progress, done = client.texts()
    assert (started, done) == ("[cal] calibration started: 2 gyro\t", "[cal] calibration done: gyro\t")
    assert progress == [f"[cal] progress <{percent}>\t" for percent in (20, 40, 60, 80, 100)]


def test_what_needs_turning_fails_and_can_be_cancelled(make: Make) -> None:
    """Nobody turns the vehicle: the accelerometer's calibration fails, the magnetometer's is cancelled."""
    client = make()
    client.fly(5.0)
    client.received.clear()
    assert calibrate(client, 0, 0, 0, 0, 1) == [ACCEPTED]
    client.fly(31.0)
    assert client.texts()[-1].startswith("[cal] calibration failed")
    assert calibrate(client, 0, 1) == [ACCEPTED]
    client.fly(0.1)
    assert calibrate(client) == [ACCEPTED]
    assert client.texts()[-1] == "[cal] calibration cancelled\t"
    client.fly(31.0)
    assert client.texts()[-1] == "[cal] calibration cancelled\t"


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_there_are_no_logs_to_download(make: Make, autopilot: str) -> None:
    """A client that lists logs hears at once that there are none, whatever range it asks for; data never come."""
    client = make(simspec(autopilot))
    client.fly(5.0)
    for start, end in ((0, 0xFFFF), (3, 7)):
        client.send(mavlink.MAVLink_log_request_list_message(1, 1, start, end))
        (entry,) = of("LOG_ENTRY", client.fly(0.1))
        assert (entry.id, entry.num_logs, entry.last_log_num, entry.time_utc, entry.size) == (0, 0, 0, 0, 0)
    client.send(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 90))
    assert not of("LOG_DATA", client.fly(0.1))


def ask(client: Client, line: str, seconds: float = 0.2) -> str:
    """Write a line to the shell, in two pieces, and return what it prints."""
    data = f"{line}\n".encode()
    for piece in (data[:3], data[3:]):
        fields = (SHELL, 0, 0, 0, len(piece), [*piece, *bytes(70 - len(piece))])
        client.send(mavlink.MAVLink_serial_control_message(*fields))
    answers = of("SERIAL_CONTROL", client.fly(seconds))
    assert all((answer.device, answer.flags) == (SHELL, REPLY) for answer in answers)
    return b"".join(bytes(answer.data[: answer.count]) for answer in answers).decode()


def test_the_shell_answers_version_parameters_and_topics(make: Make) -> None:
    """Echo, answer, prompt; an unknown command is named; all parameters come in the end."""
    client = make()
    client.fly(5.0)
    assert "PX4 version: 1.17.0" in ask(client, "ver all")
    shown = ask(client, "param show NAV_ACC*")
    assert shown.startswith("param show NAV_ACC*\n")
    assert shown.endswith("pxh> ")
    assert "] : 2.0000\n\n 1/888 parameters used." in shown
    assert ask(client, "param show", 4.0).count("\nx ") == 888
    topic = ask(client, "listener vehicle_local_position")
    assert "TOPIC: vehicle_local_position" in topic
    assert "heading:" in topic
    home = client.last("HOME_POSITION")
    assert f"lat: {home.latitude * 1e-7:.7f}" in ask(client, "listener home_position -n 1")
    for name in ("sensor_gps", "vehicle_gps_position"):
        fix = ask(client, f"listener {name}")
        assert f"latitude_deg: {home.latitude * 1e-7:.7f}" in fix
    assert "xyz: [" in ask(client, "listener vehicle_angular_velocity")
    assert "arming_state: 1" in ask(client, "listener vehicle_status")
    assert "usage: listener {" in ask(client, "listener no_such_topic")
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    assert "arming_state: 2" in ask(client, "listener vehicle_status")
    assert "Invalid command: rm" in ask(client, "rm -rf")
    assert ask(client, "") == "\npxh> "


def test_no_shell_on_ardupilot(make: Make) -> None:
    client = make(simspec("ardupilot"))
    assert ask(client, "ver all") == ""


@pytest.mark.parametrize(
    ("autopilot", "unknown", "requested"), [("px4", FAILED, DENIED), ("ardupilot", DENIED, ACCEPTED)]
)
def test_streams_of_devices_that_are_not_there_are_accepted_and_silent(
    make: Make, autopilot: str, unknown: int, requested: int
) -> None:
    """An interval is kept and shown; nothing is sent. ArduPilot promises the message on request too."""
    client = make(simspec(autopilot))
    interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    for name in ("EFI_STATUS", "GPS2_RAW"):
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
        assert client.command(interval, number, 100_000) == [ACCEPTED]
        assert client.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, number) == [ACCEPTED]
        assert client.last("MESSAGE_INTERVAL").interval_us == 100_000
        assert client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, number) == [requested]
    assert client.command(interval, mavlink.MAVLINK_MSG_ID_SCALED_IMU, 100_000) == [ACCEPTED]
    assert client.command(interval, mavlink.MAVLINK_MSG_ID_UAVIONIX_ADSB_OUT_CFG, 100_000) == [unknown]
    kinds = [m.get_type() for m in client.fly(1.0)]
    assert kinds.count("SCALED_IMU") == 10
    assert not {"EFI_STATUS", "GPS2_RAW"} & set(kinds)


def test_flight_information_has_the_time_of_arming(make: Make) -> None:
    client = make()
    client.fly(5.0)
    request = mavlink.MAV_CMD_REQUEST_MESSAGE
    assert client.command(request, mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION) == [ACCEPTED]
    assert client.last("FLIGHT_INFORMATION").arming_time_utc == 0
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    armed_us = client.vehicle.time.ns // 1000
    assert client.command(request, mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION) == [ACCEPTED]
    information = client.last("FLIGHT_INFORMATION")
    assert information.arming_time_utc > armed_us > information.time_boot_ms
    assert client.command(request, mavlink.MAVLINK_MSG_ID_SYSTEM_TIME) == [ACCEPTED]
    client.fly(0.1)
    boot_us = client.last("SYSTEM_TIME").time_unix_usec - client.last("SYSTEM_TIME").time_boot_ms * 1000
    assert information.arming_time_utc - boot_us == pytest.approx(armed_us, abs=40_000)
