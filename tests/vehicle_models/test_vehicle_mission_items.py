"""The items of ArduPilot's missions: which are taken, with which verdict others are refused, and what they do."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_vehicle_missions import (
    Row,
    bare,
    counted,
    download,
    item,
    ready_ardupilot,
    start_ardupilot,
    step,
    to,
    upload,
)
from vehicle_client import NAN, Client, Make, simspec

from vehicle_models.controller.ardupilot._missions import MISSIONS as ARDUPILOT
from vehicle_models.controller.links._enums import MAV_CMD
from vehicle_models.controller.missions._item_actions import effect_of
from vehicle_models.controller.px4._missions import MISSIONS as PX4
from vehicle_models.controller.state._plan_store import MISSION, MissionItem
from vehicle_models.tables import mission_table

# AP_Mission::mavlink_int_to_mission_cmd of ArduPilot 4.6.
WITH_PLACE = {16, 17, 18, 19, 21, 22, 30, 31, 82, 84, 85, 92, 94, 179, 188, 189, 191, 195, 197, 201}
WITHOUT_PLACE = {
    *(20, 83, 93, 112, 114, 115, 177, 178, 181, 182, 183, 184, 193, 194, 202, 203, 205, 206, 207, 208),
    *(210, 211, 212, 213, 215, 216, 217, 218, 222, 223, 531, 532, 534, 600, 601, 1000, 2000, 2001),
    *(2500, 2501, 3000, 42600, 42702, 42703),
}
TAKEN = WITH_PLACE | WITHOUT_PLACE
NAN_TAKEN = {16: {4}, 21: {4}, 22: {4}, 84: {4}, 85: {3, 4}}
PLAIN_NUMBERS = {202, 203, 1000, 42703}
# Missions of ArduPilot's own tests for copters, by the commands that they hold.
AUTOTEST = {16, 18, 19, 20, 21, 22, 31, 82, 93, 94, 177, 178, 203, 208, 211, 218}
ACCEPTED, FRAME, UNSUPPORTED, INVALID, X, Y, Z = 0, 2, 3, 5, 10, 11, 12


def verdict_of(command: int, frame: int, params: Sequence[float], x: int, y: int, z: float) -> int:
    """The checks of AP_Mission in their order, in other words than the product's."""
    for number, value in enumerate(params, start=1):
        if math.isinf(value) or (math.isnan(value) and number not in NAN_TAKEN.get(command, set())):
            return 5 + number
    if command in (0, 1):
        return INVALID
    if command not in TAKEN:
        return UNSUPPORTED
    if command in WITHOUT_PLACE:
        return ACCEPTED
    if not -900_000_000 <= x <= 900_000_000:
        return X
    if not -1_800_000_000 <= y <= 1_800_000_000:
        return Y
    if not abs(z) < 83_000.0:
        return Z
    return ACCEPTED if frame in (0, 2, 3, 5, 6, 10, 11) else FRAME


def refused(command: int, frame: int, params: Sequence[float], x: int, y: int, z: float) -> int:
    first, second, third, fourth = params
    mission_item = MissionItem(command, frame, (first, second, third, fourth), x, y, z)
    return int(ARDUPILOT.transfer.refuse_item(MISSION, mission_item, False) or 0)


def test_every_command_is_taken_or_refused_as_by_the_real_one() -> None:
    """All that MAVLink has, and numbers that it has not."""
    numbers = {*mavlink.enums["MAV_CMD"], *range(700), 65535}
    for number in numbers:
        place = (0.0, 0.0, 0.0, 0.0), 473_000_000, 85_000_000, 10.0
        assert refused(number, 3, *place) == verdict_of(number, 3, *place), number
    assert AUTOTEST <= TAKEN


def test_faults_have_the_verdict_of_the_first_check_that_finds_one() -> None:
    random = np.random.default_rng(17)
    commands = [*TAKEN, 0, 1, 176, 200, 400, 44999]
    odd = [0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 3e38]
    seen = set()
    for _ in range(5_000):
        command = int(random.choice(commands))
        params = [float(value) for value in random.choice(odd, 4, p=[0.6, 0.2, 0.12, 0.02, 0.02, 0.02, 0.02])]
        odd_x = [473_000_000, 900_000_000, 900_000_001, -950_000_000]
        x = int(random.choice([0, *odd_x], p=[0.5, 0.3, 0.1, 0.05, 0.05]))
        y = int(random.choice([0, 1_800_000_000, 1_800_000_001, -2_000_000_000], p=[0.7, 0.1, 0.1, 0.1]))
        odd_z = [10.0, 82_999.0, 83_000.0, -1e9, math.nan]
        z = float(random.choice([0.0, *odd_z], p=[0.5, 0.2, 0.1, 0.1, 0.05, 0.05]))
        frame = int(random.choice([0, 1, 2, 3, 5, 6, 10, 11, 99]))
        expected = verdict_of(command, frame, params, x, y, z)
        seen.add(expected)
        assert refused(command, frame, params, x, y, z) == expected, (command, frame, params, x, y, z)
    assert seen == {0, 2, 3, 5, 6, 7, 8, 9, 10, 11, 12}


def test_the_table_says_of_every_item_that_is_taken_what_it_does() -> None:
    rows = mission_table()[1:]
    ardupilot = {int(number): cell for number, _, _, cell in rows}
    assert {number for number, cell in ardupilot.items() if cell != "refused"} == TAKEN
    assert {number for number, _, px4, _ in rows if px4 != "refused"} >= {"16", "2000", "4501"}
    cells = [ardupilot[number] for number in (218, 211, 600, 82)]
    assert cells == ["carried out", "no effect", "a mark", "flown"]
    assert effect_of(MAV_CMD.CONDITION_DELAY, PX4) == "no effect"


def fly_mission(client: Client, rows: Sequence[Row], seconds: float) -> list[str]:
    """Upload, take off, and fly for a while; the texts meanwhile."""
    assert upload(client, [to(client, 0, 0, 0), to(client, 0, 0, 10, 22), *rows]) == 0
    begun = len(client.texts())
    start_ardupilot(client)
    client.fly(seconds)
    return client.texts()[begun:]


def test_items_without_an_effect_are_passed_over(make: Make) -> None:
    """All of them in one mission, which is flown to its end; a copter says which it does not know."""
    idle = [number for number in sorted(TAKEN) if effect_of(number, ARDUPILOT) == "no effect"]
    assert len(idle) > 25
    client = ready_ardupilot(make)
    rows: list[Row] = [(number, 3, 0, 0, 0, 0, 0, 0, 10) for number in idle]
    texts = fly_mission(client, [*rows, to(client, 0, 15, 10, yaw=0.0), bare(20)], 60.0)
    assert not client.vehicle.condition().armed
    assert [text for text in texts if text.startswith("Mission: ")][-1] == f"Mission: {len(idle) + 3} RTL"
    skipped = {int(text.split("#")[1]) for text in texts if text.startswith("Skipping invalid cmd #")}
    assert skipped == {191, 193, 194, 210, 212, 223, 3000}
    assert "Resume repeat dist set to 0 m" in texts


def test_an_auxiliary_function_leaves_the_mission_which_goes_on_when_asked(make: Make) -> None:
    """Function 70 enters ALT_HOLD; AUTO again flies the delay behind it, and returns."""
    client = ready_ardupilot(make)
    fly_mission(client, [bare(218, 70, 2), bare(93, 5), bare(20)], 0.1)
    while client.vehicle.condition().mode == "AUTO":
        client.fly(0.1)
    assert client.vehicle.condition().mode == "ALT_HOLD"
    assert client.texts()[-1] == "Mission: 2 AuxFunction"
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3) == [0]
    client.fly(45.0)
    begun = [text.partition(": ")[2] for text in client.texts() if text.startswith("Mission: ")]
    assert begun == ["1 Takeoff", "2 AuxFunction", "3 Delay", "4 RTL"]
    assert client.texts()[-1] == "Disarming motors"


def test_a_low_switch_or_an_unknown_function_changes_nothing(make: Make) -> None:
    client = ready_ardupilot(make)
    texts = fly_mission(client, [bare(218, 70, 0), bare(218, 999, 2), bare(93, 300)], 15.0)
    assert client.vehicle.condition().mode == "AUTO"
    assert "Invalid channel option (999)" in texts


def test_jumps_to_tags_repeat_as_often_as_they_ask(make: Make) -> None:
    client = ready_ardupilot(make)
    places = [to(client, 0, north, 10, yaw=0.0) for north in (8, 0)]
    no_such_tag = bare(601, 99, 2)
    texts = fly_mission(client, [bare(600, 7), *places, bare(601, 7, 2), no_such_tag, bare(20)], 90.0)
    reached = [text for text in texts if text.startswith("Reached")]
    assert reached == ["Reached command #3", "Reached command #4"] * 3
    assert texts[-1] == "Disarming motors"


def test_a_distance_keeps_back_what_is_behind_it(make: Make) -> None:
    """The speed changes where 10 m are left of 60."""
    client = ready_ardupilot(make)
    rows = [bare(114, 10), bare(178, 1, 1.0), to(client, 0, 60, 10, yaw=0.0), bare(93, 300)]
    fly_mission(client, rows, 5.0)
    while "Mission: 3 ChangeSpeed" not in client.texts():
        client.fly(0.1)
        assert client.vehicle.time.s < 60.0
    assert client.vehicle.truth().position_enu_m[1] == pytest.approx(50.0, abs=1.0)


def test_a_mission_sets_home_and_works_the_fence(make: Make) -> None:
    """The return goes to the home that the mission set; the fence is off, then on."""
    client = ready_ardupilot(make, parameters={"FENCE_ENABLE": 1, "FENCE_RADIUS": 30, "FENCE_TYPE": 2})
    place = client.vehicle_goal(0.0, 20.0)
    rows = [
        bare(207, 0),
        to(client, 0, 45, 10, yaw=0.0),
        to(client, 0, 20, 10, yaw=0.0),
        bare(207, 1),
        (179, 0, 0, 0, 0, 0, *place, 488.0),
        bare(20),
    ]
    texts = fly_mission(client, rows, 90.0)
    assert "Circle fence breached" not in texts
    assert texts[-1] == "Disarming motors"
    assert client.vehicle.truth().position_enu_m[1] == pytest.approx(20.0, abs=1.0)
    home = client.last("HOME_POSITION")
    assert (home.latitude, home.longitude) == place
    enabled = client.vehicle._controller._boundary.enabled  # type: ignore[attr-defined]
    assert enabled


def test_a_place_without_a_frame_is_above_the_sea_and_no_other_item_has_one(make: Make) -> None:
    """MAV_FRAME_MISSION; items without a place come back with frame 0 whatever they had."""
    client = ready_ardupilot(make)
    goal = client.vehicle_goal(0.0, 15.0)
    rows = [(16, 2, 0, 0, 0, 0, *goal, 500.0), (178, 3, 1, 3, 0, 0, 0, 0, 0), bare(93, 300)]
    fly_mission(client, rows, 25.0)
    assert [stored.frame for stored in download(client)] == [0, 3, 0, 0, 0]
    east_m, north_m, up_m = client.vehicle.truth().position_enu_m
    assert (east_m, north_m, up_m) == pytest.approx((0.0, 15.0, 12.0), abs=1.0)


@pytest.mark.parametrize(
    ("command", "sent", "kept"),
    [
        (16, (5, 2, 3, 90), (5, 0, 0, 0)),
        (16, (5, 0, 0, NAN), (5, 0, 0, 0)),
        (17, (1, 2, -30, 4), (0, 0, -30, 0)),
        (18, (2, 1, -30, 1), (2, 0, -30, 1)),
        (19, (7, 1, -9, 0), (7, 0, -1, 0)),
        (19, (7, 1, 9, 3), (7, 0, 1, 1)),
        (20, (1, 2, 3, 4), (0, 0, 0, 0)),
        (21, (1, 2, 3, NAN), (1, 0, 0, 1)),
        (21, (1, 2, 3, -9), (1, 0, 0, -1)),
        (22, (15, 2, 3, NAN), (15, 0, 0, 0)),
        (93, (9, 1, 2, 3), (9, 1, 2, 3)),
        (177, (1, 2, 3, 4), (1, 2, 0, 0)),
        (178, (1, 4, 50, 9), (1, 4, 50, 0)),
    ],
)
def test_the_store_keeps_what_ap_mission_has_room_for(
    make: Make, command: int, sent: tuple[float, ...], kept: tuple[float, ...]
) -> None:
    """By AP_Mission of ArduPilot 4.6: what comes back of an item, and its place where it has one."""
    client = ready_ardupilot(make)
    place = client.vehicle_goal(3.0, 4.0)
    rows: list[Row] = [(16, 0, 0, 0, 0, 0, 0, 0, 0), (command, 3, *sent, *place, 10)]
    assert upload(client, rows) == ACCEPTED
    back = download(client)[1]
    assert (back.param1, back.param2, back.param3, back.param4) == kept
    assert (back.x, back.y) == (place if command in WITH_PLACE else (0, 0))
    assert (back.current, back.autocontinue) == (0, 1)


def test_numbers_that_are_no_place_are_no_degrees_in_a_float_item(make: Make) -> None:
    """MISSION_ITEM: flags of a gimbal stay flags; degrees beyond the earth are refused in every other item."""
    client = ready_ardupilot(make)
    for command, x, y, verdict in (
        (178, 95.0, 0.0, X),
        (178, NAN, 0.0, X),
        (178, 0.0, 200.0, Y),
        (178, 90.0, -180.0, ACCEPTED),
        (1000, 16.0, 0.0, ACCEPTED),
    ):
        client.send(counted(2))
        step(client)
        client.send(item(0, to(client, 0, 0, 0, yaw=0.0)))
        step(client)
        message = mavlink.MAVLink_mission_item_message
        client.send(message(1, 1, 1, 3, command, 0, 1, 0, 0, 0, 0, x, y, 0, 0))
        assert step(client)[-1].type == verdict
    assert download(client)[1].x == 16


def test_a_waypoint_that_is_flown_at_once(make: Make) -> None:
    """MISSION_ITEM with current 2, DroneKit's way to go somewhere: flown, and no part of a mission."""
    client = make(simspec("ardupilot"))
    client.guided(20.0, risen_s=20.0)
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    latitude, longitude = (angle * 1e-7 for angle in client.vehicle_goal(0.0, 15.0))
    client.send(
        mavlink.MAVLink_mission_item_message(1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, latitude, longitude, 18)
    )
    client.fly(15.0)
    assert client.last("MISSION_ACK").type == 0
    east, north, up = client.vehicle.truth().position_enu_m
    assert (east, north, up) == pytest.approx((0.0, 15.0, 18.0), abs=1.0)
