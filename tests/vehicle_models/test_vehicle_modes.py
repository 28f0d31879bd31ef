"""Modes: the whole tables of both autopilots, on the ground and in the air."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import Make, of, simspec

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)

# main, sub, base_mode disarmed, system_status disarmed; None: refused
PX4_ON_THE_GROUND: list[tuple[int, int, int | None, int]] = [
    *[(main, 0, 81, 0) for main in (1, 2, 3, 7, 11)],
    (3, 2, 81, 0),
    *[(4, sub, 29, 3) for sub in (2, 3)],
    *[(4, sub, 29, 0) for sub in (4, 5, 6, 9)],
    *[(4, sub, 17, 0) for sub in (8, 11)],
    *[(4, sub, None, 0) for sub in (1, 10)],
    (5, 0, 65, 0),
    (6, 0, 1, 0),
]


def test_px4_on_the_ground(make: Make) -> None:
    """Nearly every mode is granted; base_mode and system_status 0 show what could not be armed there."""
    client = make(streams="gcs")
    client.fly(5.0)
    for main, sub, base, status in PX4_ON_THE_GROUND:
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == [ACCEPTED, ACCEPTED]
        client.fly(1.0)
        granted = base is not None
        verdict = ACCEPTED if granted else REJECTED
        answers = client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub)
        assert answers == [ACCEPTED, verdict], (main, sub)
        client.fly(1.0)
        beat = client.last("HEARTBEAT")
        number = sub << 24 | main << 16 if granted else 3 << 24 | 4 << 16
        shown = (base, status) if granted else (29, 3)
        assert (beat.custom_mode, beat.base_mode, beat.system_status) == (number, *shown)
    assert "Unsupported auto mode\t" in client.texts()
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3, 1) == [ACCEPTED, ACCEPTED]
    client.fly(1.0)
    assert client.last("HEARTBEAT").custom_mode == 3 << 16, "an orbit without a circle is position mode"


def test_px4_in_the_air(make: Make) -> None:
    """What cannot run is refused by the second acknowledgement and a text, and the mode stays."""
    client = make(streams="gcs")
    client.airborne()
    refused = [(main, 0) for main in (1, 2, 3, 5, 6, 7, 11)]
    for main, sub in (*refused, (3, 1), (3, 2), (4, 4), (4, 10), (4, 11)):
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub) == [ACCEPTED, REJECTED], (main, sub)
        assert client.vehicle.condition().mode == "AUTO_LOITER"
    assert "Switching to Offboard is currently not available" in "".join(client.texts())
    for sub, name in ((8, "AUTO_FOLLOW"), (5, "AUTO_RTL"), (2, "AUTO_TAKEOFF"), (6, "AUTO_LAND")):
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, sub) == [ACCEPTED, ACCEPTED]
        assert client.vehicle.condition().mode == name
        client.fly(1.0)
        assert client.last("HEARTBEAT").base_mode == (145 if name == "AUTO_FOLLOW" else 157)


def test_px4_terminates(make: Make) -> None:
    """Denied with 0; with 1 the rotors stop, it falls, and stays armed with system_status 8."""
    client = make(streams="gcs")
    client.airborne()
    assert client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0) == [DENIED]
    assert client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1) == [ACCEPTED]
    client.fly(4.0)
    beat = client.last("HEARTBEAT")
    assert (beat.custom_mode, beat.base_mode, beat.system_status) == (10 << 16, 129, 8)
    condition = client.vehicle.condition()
    assert condition.crashed
    assert condition.armed


def test_px4_old_message(make: Make) -> None:
    """SET_MODE works and is answered with COMMAND_ACK 176."""
    client = make()
    client.fly(5.0)
    client.send(mavlink.MAVLink_set_mode_message(1, 1, 7 << 16))
    client.fly(0.1)
    assert client.vehicle.condition().mode == "STABILIZED"
    assert (client.last("COMMAND_ACK").command, client.last("COMMAND_ACK").result) == (176, ACCEPTED)


def test_copter_on_the_ground(make: Make) -> None:
    """Every mode that exists, with the GUIDED bit where it steers; the others fail with their texts."""
    client = make(simspec("ardupilot"), streams="onboard", system=255)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    steers = (3, 4, 5, 7, 9, 16, 17, 19, 20, 21, 24)
    for number in (1, 0, 2, 6, 11, 18, *steers):
        before = len(client.received)
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, number) == [ACCEPTED], number
        kinds = [message.get_type() for message in client.received[before:]]
        assert kinds.index("COMMAND_ACK") < kinds.index("HEARTBEAT")
        client.fly(1.0)
        beat = client.last("HEARTBEAT")
        assert (beat.custom_mode, beat.base_mode) == (number, 89 if number in steers else 81)
    for number in (14, 15, 22, 23, 25, 27, 28):
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, number) == [FAILED], number
    for number in (8, 10, 12, 13, 26, 29, 30, 99):
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, number) == [FAILED], number
        assert f"No such mode {number}" in client.texts()
    needs = {"Set FOLL_ENABLE = 1", "No axis selected, SID_AXIS = 0"}
    assert needs | {"No return path or landing sequence found"} <= set(client.texts())
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 0, 4) == [DENIED]
    assert client.command(mavlink.MAV_CMD_DO_SET_STANDARD_MODE, 1) == [UNSUPPORTED]


def test_copter_old_message_is_obeyed_in_silence(make: Make) -> None:
    client = make(simspec("ardupilot"), streams="onboard", system=255)
    for number in (4, 99):
        client.send(mavlink.MAVLink_set_mode_message(1, 1, number))
        assert not of("COMMAND_ACK", client.fly(0.2))
    assert client.vehicle.condition().mode == "GUIDED"
    assert "No such mode 99" in client.texts()


def test_copter_modes_that_cannot_be_armed(make: Make) -> None:
    client = make(simspec("ardupilot"), streams="onboard", system=255)
    for number, name in ((9, "LAND"), (6, "RTL"), (17, "BRAKE")):
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, number) == [ACCEPTED]
        assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [FAILED]
        assert f"Arm: {name} mode not armable" in client.texts()


@pytest.mark.parametrize(("command", "mode"), [(21, "LAND"), (20, "RTL"), (17, "LOITER")])
def test_copter_commands_that_are_modes(make: Make, command: int, mode: str) -> None:
    """Accepted, even disarmed."""
    client = make(simspec("ardupilot"), streams="onboard", system=255)
    assert client.command(command) == [ACCEPTED]
    assert client.vehicle.condition().mode == mode
