"""Every command is answered as the real autopilots answered it, silence included; and so are wrong addresses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import NAN, Client, simspec

from vehicle_models.controller.links._dialect import dialect

Make = Callable[..., Client]
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)

PX4_BOTH = {
    UNSUPPORTED: (31999, 193, 224, 207, 208, 183, 181, 115, 92, 16, 17, 2000, 2500, 611, 192),
    ACCEPTED: (178, 186, 195, 197, 201, 191, 187, 401, 2510, 2511),
    CANCELLED: (189,),
    None: (1000, 1001, 204, 205, 203, 206, 2003, 42600, 530, 521, 3000, 500),
    DENIED: (420,),  # while SYS_FAILURE_EN is 0
}
PX4_FLYING = {REJECTED: (241, 245), DENIED: (310,)}
COPTER_BOTH = {
    UNSUPPORTED: (44999, 34, 186, 43000, 43001, 43002, 16, 222, 177, 192, 519, 521, 528, 525, 530, 531, 3000, 223, 2510, 262),
    ACCEPTED: (193, 195, 197, 201, 198, 203, 206, 207, 181, 208, 216, 520, 2001, 32, 2600, 42428),
    FAILED: (204, 205, 1000, 1001, 2000, 2500, 2501, 211, 42600, 189),
    DENIED: (224, 245),
}


def check(client: Client, table: Mapping[Any, tuple[int, ...]]) -> None:
    for result, numbers in table.items():
        for number in numbers:
            if number in (400, 300):
                continue
            heard = client.command(number)
            assert heard == ([] if result is None else [result]), number


def test_px4(make: Make) -> None:
    client = make()
    client.fly(5.0)
    check(client, PX4_BOTH)
    assert client.command(241) == [ACCEPTED]
    assert client.command(300) == [DENIED]
    assert "Mission start denied! No valid mission\t" in client.texts()
    assert client.command(2600, 1) == [FAILED]
    client.airborne()
    check(client, PX4_BOTH)
    check(client, PX4_FLYING)
    assert client.command(246, 1) == [DENIED]
    assert client.vehicle.condition().mode == "AUTO_LOITER"


def test_px4_gripper_takes_its_time(make: Make) -> None:
    """IN_PROGRESS, then ACCEPTED; ACCEPTED alone from then on."""
    client = make()
    client.fly(5.0)
    assert client.command(211, 1, 0) == [IN_PROGRESS]
    assert [one.result for one in client.fly(2.0) if one.get_type() == "COMMAND_ACK"] == [ACCEPTED]
    assert client.command(211, 1, 1) == [ACCEPTED]


def test_a_command_in_progress_can_be_cancelled(make: Make) -> None:
    """COMMAND_CANCEL ends the gripper's way with CANCELLED and nothing after it; for what is over, is not going on, or is
    somebody else's, or to everybody, there is no answer."""
    client = make()
    client.fly(5.0)
    assert client.command(211, 1, 0) == [IN_PROGRESS]

    def cancelled(system: int, number: int) -> list[int]:
        client.send(dialect.MAVLink_command_cancel_message(system, 1, number))
        return [one.result for one in client.fly(0.1) if one.get_type() == "COMMAND_ACK"]

    assert cancelled(0, 211) == cancelled(42, 211) == cancelled(1, 400) == []
    assert cancelled(1, 211) == [CANCELLED]
    assert [one for one in client.fly(2.0) if one.get_type() == "COMMAND_ACK"] == []
    assert cancelled(1, 211) == []


def test_px4_addresses(make: Make) -> None:
    """Another system and an absent component hear nothing; 0 is everybody."""
    client = make()
    client.fly(5.0)
    for system, component, answered in ((42, 1, False), (1, 100, False), (1, 0, True), (0, 0, True), (0, 1, True)):
        client.send(mavlink.MAVLink_command_long_message(system, component, 178, 0, 1, 5, 0, 0, 0, 0, 0))
        acks = [one for one in client.fly(0.1) if one.get_type() == "COMMAND_ACK"]
        assert bool(acks) is answered, (system, component)
    assert (acks[0].target_system, acks[0].target_component, acks[0].progress) == (245, 190, 0)


@pytest.fixture
def copter(make: Make) -> Client:
    client = make(simspec("ardupilot"), streams="onboard", system=255)
    client.fly(43.0)
    assert client.command(176, 1, 4) == [ACCEPTED]
    return client


def test_copter(copter: Client) -> None:
    check(copter, COPTER_BOTH)
    assert copter.command(401) == [ACCEPTED]
    assert copter.command(400, 1) == [ACCEPTED]
    assert copter.command(22, 0, 0, 0, 0, 0, 0, 5) == [ACCEPTED]
    copter.fly(8.0)
    check(copter, COPTER_BOTH)
    assert copter.command(401) == [REJECTED]
    assert copter.command(246, 1) == [FAILED]
    assert copter.command(209, 1) == [FAILED]
    assert copter.command(241, 1) == [FAILED]
    assert {"Motor Test: vehicle not landed", "Disarm to allow calibration"} <= set(copter.texts())


def test_copter_details(copter: Client) -> None:
    """Values that change the answer, and the texts that come with it."""
    assert copter.command(207, 7) == [FAILED]
    assert copter.command(183, 9, 1500) == [ACCEPTED]
    assert copter.command(183, 1, 1500) == [FAILED]
    assert copter.command(183, 99, 1500) == [FAILED]
    assert copter.command(218, 999) == [FAILED]
    assert copter.command(185, 0) == [FAILED]
    assert copter.command(178, 9, 5.0) == [ACCEPTED]
    assert copter.command(241, 0, 0, 1) == [IN_PROGRESS]
    assert [one.result for one in copter.fly(2.0) if one.get_type() == "COMMAND_ACK"] == [ACCEPTED]
    assert {"ServoRelayEvent: Channel 1 is already in use", "Invalid channel option (999)"} <= set(copter.texts())


def test_copter_reposition(copter: Client) -> None:
    """COMMAND_INT alone; another mode needs the flag; 0/0, NaN and foreign frames are denied."""
    goal = copter.command(410) and copter.vehicle_goal(5.0, 5.0)
    assert goal
    assert copter.command(192, -1, 1) == [UNSUPPORTED]
    assert copter.command_int(192, 3, -1, 0, 0, NAN, *goal, 5.0) == [ACCEPTED]
    assert copter.command_int(192, 3, -1, 0, 0, NAN, 0, 0, 5.0) == [DENIED]
    assert copter.command_int(192, 1, -1, 0, 0, NAN, *goal, 5.0) == [DENIED]
    assert copter.command_int(192, 3, -1, 0, 0, NAN, 950_000_000, goal[1], 5.0) == [DENIED]
    assert copter.command(176, 1, 5) == [ACCEPTED]
    assert copter.command_int(192, 3, -1, 0, 0, NAN, *goal, 5.0) == [DENIED]
    assert copter.command_int(192, 3, -1, 1, 0, NAN, *goal, 5.0) == [ACCEPTED]
    assert copter.vehicle.condition().mode == "GUIDED"


def test_copter_addresses(copter: Client) -> None:
    """Any component of its system is itself; another system is nobody's."""
    for system, component, answered in ((42, 1, False), (1, 100, True), (1, 0, True), (0, 0, True)):
        copter.send(mavlink.MAVLink_command_long_message(system, component, 206, 0, 0, 0, 0, 0, 0, 0, 0))
        assert bool([one for one in copter.fly(0.1) if one.get_type() == "COMMAND_ACK"]) is answered, (system, component)
