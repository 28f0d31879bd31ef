"""ArduPilot's calibrations, as ground stations lead through them."""

from __future__ import annotations

from typing import Any

import pytest
from vehicle_client import NAN, Client, Make, of, simspec

from vehicle_models.controller.links._dialect import dialect as mavlink

ACCEPTED, REJECTED, _, UNSUPPORTED, FAILED, IN_PROGRESS = range(6)
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
START, ACCEPT = mavlink.MAV_CMD_DO_START_MAG_CAL, mavlink.MAV_CMD_DO_ACCEPT_MAG_CAL
CANCEL = mavlink.MAV_CMD_DO_CANCEL_MAG_CAL
POSITION = mavlink.MAV_CMD_ACCELCAL_VEHICLE_POS
FORCE = 21196


@pytest.fixture
def copter(make: Make) -> Client:
    """Its compasses' progress is streamed."""
    client = make(simspec("ardupilot"))
    assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 191, 100_000) == [ACCEPTED]
    return client


def calibrate(client: Client, *params: float) -> list[int]:
    return client.command(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, *params)


def progress(messages: list[Any]) -> list[tuple[int, ...]]:
    """Compass, mask, status, attempt and percentage of every MAG_CAL_PROGRESS."""
    return [
        (m.compass_id, m.cal_mask, m.cal_status, m.attempt, m.completion_pct)
        for m in of("MAG_CAL_PROGRESS", messages)
    ]


def requested_positions(messages: list[Any]) -> list[float]:
    return [m.param1 for m in of("COMMAND_LONG", messages) if m.command == POSITION]


def test_compasses_wait_then_run_and_never_finish(copter: Client) -> None:
    """Each reports in turn that it waits, then that it runs; standing still, it has seen one direction of 80."""
    assert progress(copter.fly(1.0)) == []
    assert copter.command(START, 0, 1, 1, 2) == [ACCEPTED]
    assert set(progress(copter.fly(1.5))) == {(compass, 7, 1, 1, 0) for compass in range(3)}
    copter.fly(1.0)
    shown = progress(copter.fly(60.0))
    assert set(shown) == {(compass, 7, 2, 1, 0) for compass in range(3)}
    assert [entry[0] for entry in shown[:6]] == [0, 1, 2, 0, 1, 2]
    assert len(shown) == pytest.approx(1800, abs=6)
    directions = copter.last("MAG_CAL_PROGRESS").completion_mask
    assert sum(byte.bit_count() for byte in directions) == 1
    # A second start changes nothing; that of a part adds to it.
    assert copter.command(START, 2, 0, 0, 30) == [ACCEPTED]
    assert set(progress(copter.fly(0.3))) == {(compass, 7, 2, 1, 0) for compass in range(3)}
    assert not of("MAG_CAL_REPORT", copter.received)


@pytest.mark.parametrize(("end", "result"), [(CANCEL, ACCEPTED), (ACCEPT, FAILED)])
def test_compasses_end_one_by_one_without_a_report(copter: Client, end: int, result: int) -> None:
    """What has not succeeded cannot be accepted; it ends all the same."""
    assert copter.command(end, 0) == [ACCEPTED]
    assert copter.command(START, 5) == [ACCEPTED]
    assert set(progress(copter.fly(0.3))) == {(0, 5, 2, 1, 0), (2, 5, 2, 1, 0)}
    assert copter.command(end, 2) == [ACCEPTED]
    assert copter.command(end, 4) == [result]
    assert set(progress(copter.fly(0.3))) == {(0, 1, 2, 1, 0)}
    assert copter.command(end, 300) == [FAILED]
    assert copter.command(end, -1) == copter.command(end, NAN) == [FAILED]
    assert copter.command(end) == [result]
    assert copter.command(end) == [ACCEPTED]
    assert progress(copter.fly(1.0)) == []
    assert not of("MAG_CAL_REPORT", copter.received)


def test_only_compasses_in_use_are_calibrated(copter: Client) -> None:
    """A list with one that is not there ends those that run; all means those in use."""
    assert copter.command(START, 1) == [ACCEPTED]
    assert copter.command(START, 9) == [FAILED]
    assert progress(copter.fly(0.5)) == []
    assert copter.command(START, 256) == copter.command(START, NAN) == [FAILED]
    copter.send(mavlink.MAVLink_param_set_message(1, 1, b"COMPASS_USE2", 0, 2))
    assert copter.command(START, 2) == [FAILED]
    assert copter.command(START, 0, 0, 0, NAN) == [ACCEPTED]
    assert {entry[:2] for entry in progress(copter.fly(0.5))} == {(0, 5), (2, 5)}
    assert copter.command(CANCEL) == [ACCEPTED]
    for name in (b"COMPASS_USE", b"COMPASS_USE3"):
        assert copter.command(START, 0) == [ACCEPTED]
        copter.send(mavlink.MAVLink_param_set_message(1, 1, name, 0, 2))
        assert copter.command(CANCEL) == [ACCEPTED]
    assert copter.command(START, 0) == [FAILED]
    copter.send(mavlink.MAVLink_param_set_message(1, 1, b"COMPASS_USE", 1, 2))
    assert copter.command(START, 0) == copter.command(CANCEL) == [ACCEPTED]
    copter.send(mavlink.MAVLink_param_set_message(1, 1, b"COMPASS_ENABLE", 0, 2))
    assert copter.command(START, 0) == [FAILED]


def test_a_compass_calibration_forbids_arming_until_the_restart(copter: Client) -> None:
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    copter.received.clear()
    assert copter.command(START, 0) == [ACCEPTED]
    assert copter.command(ARM, 1) == [FAILED]
    assert copter.command(CANCEL, 0) == [ACCEPTED]
    assert copter.command(ARM, 1) == [FAILED]
    assert copter.texts() == ["Arm: Compass calibration running", "Arm: Compass calibrated requires reboot"]
    assert copter.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == [ACCEPTED]
    assert copter.texts()[-1] == "PreArm: Compass calibrated requires reboot"
    # By force it is armed, and then nothing is calibrated.
    assert copter.command(ARM, 1, FORCE) == [ACCEPTED]
    assert copter.command(START, 0) == [FAILED]
    assert copter.texts()[-1] == "Disarm to allow compass calibration"
    assert copter.command(ARM, 0) == [ACCEPTED]
    copter.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    copter.fly(44.0)
    copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    assert copter.command(ARM, 1) == [ACCEPTED]


def test_accelerometers_ask_for_positions_and_fail_at_the_second(copter: Client) -> None:
    """As a client with the command leads through it; the vehicle lies as before, which the real one notices."""
    copter.received.clear()
    assert calibrate(copter, 0, 0, 0, 0, 1) == [ACCEPTED]
    messages = copter.fly(3.2)
    assert copter.texts() == ["Place vehicle level and press any key."]
    assert requested_positions(copter.received) == [1, 1, 1, 1]
    request = next(m for m in of("COMMAND_LONG", messages))
    assert (request.target_system, request.target_component) == (0, 0)
    assert copter.command(POSITION, 2) == [FAILED]
    assert copter.command(POSITION, 1) == [ACCEPTED]
    assert copter.command(POSITION, 1) == [FAILED]
    assert calibrate(copter, 0, 0, 0, 0, 1) == [ACCEPTED]
    assert set(requested_positions(copter.fly(2.0))) == {2}
    # Who answers by command gets no more texts to press a key.
    assert copter.texts() == ["Place vehicle level and press any key."]
    assert copter.command(POSITION, 2) == [ACCEPTED]
    failed = copter.fly(3.0)
    assert copter.texts()[1:] == ["Calibration FAILED"]
    assert requested_positions(failed) == [16_777_216] * 3
    assert copter.command(POSITION, 2) == [FAILED]
    # Another one begins anew.
    assert calibrate(copter, 0, 0, 0, 0, 1) == [ACCEPTED]
    assert requested_positions(copter.fly(1.0)) == [1]


def test_accelerometers_take_acknowledgements_for_an_answer(copter: Client) -> None:
    """The older way of ground stations; acknowledgements of other commands do not count."""

    def acknowledge(command: int, result: int) -> list[Any]:
        copter.send(mavlink.MAVLink_command_ack_message(command, result))
        return copter.fly(0.8)

    copter.received.clear()
    assert calibrate(copter, 0, 0, 0, 0, 1) == [ACCEPTED]
    acknowledge(7, REJECTED)
    acknowledge(0, ACCEPTED)
    assert copter.texts() == ["Place vehicle level and press any key."]
    acknowledge(0, REJECTED)
    assert copter.texts()[1:] == ["Place vehicle on its LEFT side and press any key."]
    acknowledge(2, REJECTED)
    assert copter.texts()[2:] == ["Calibration FAILED"]
    acknowledge(3, REJECTED)
    assert len(copter.texts()) == 3


def test_arming_cancels_an_accelerometer_calibration(copter: Client) -> None:
    copter.fly(24.0)
    copter.received.clear()
    assert calibrate(copter, 0, 0, 0, 0, 1) == [ACCEPTED]
    assert copter.command(ARM, 1) == [ACCEPTED]
    copter.fly(0.1)
    assert "Calibration cancelled" in copter.texts()
    assert requested_positions(copter.fly(3.0)) == []
    assert calibrate(copter, 0, 0, 0, 0, 1) == [FAILED]
    assert copter.texts()[-1] == "Disarm to allow calibration"


def test_calibrations_that_end_at_once(copter: Client) -> None:
    """Two of the accelerometers' within 5 s: the second is rejected, whichever it is."""
    copter.received.clear()
    assert calibrate(copter, 1) == [ACCEPTED]
    assert calibrate(copter) == calibrate(copter, 0, 1) == [UNSUPPORTED]
    assert calibrate(copter, 0, 0, 0, 0, 4) == [ACCEPTED]
    assert calibrate(copter, 0, 0, 0, 0, 2) == [REJECTED]
    copter.fly(5.0)
    assert copter.texts() == []
    assert calibrate(copter, 0, 0, 0, 0, 2) == [ACCEPTED]
    assert copter.texts() == ["Trim OK: roll=0.00 pitch=0.00 yaw=0.00"]
    assert calibrate(copter, 0, 0, 0, 0, 4) == [REJECTED]
    assert calibrate(copter, 0, 0, 0, 0, 76) == [ACCEPTED]
    assert calibrate(copter, 0, 0, 1) == [IN_PROGRESS]
    assert [m.result for m in of("COMMAND_ACK", copter.fly(1.1))] == [ACCEPTED]
