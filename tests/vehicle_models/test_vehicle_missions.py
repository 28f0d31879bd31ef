"""Missions: the protocol as each autopilot speaks it, and the flight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby, product
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import NAN, Client, Make, of, simspec

Row = tuple[Any, ...]  # command, frame, params 1 to 4, x, y, z


def item(seq: int, row: Row, kind: int = 0) -> Any:
    command, frame, first, second, third, fourth, x, y, z = row
    message = mavlink.MAVLink_mission_item_int_message
    return message(1, 1, seq, frame, command, int(seq == 0), 1, first, second, third, fourth, x, y, z, kind)


def step(client: Client) -> list[Any]:
    """The messages of the mission protocol in one step."""
    return [
        message
        for message in client.fly(0.02)
        if message.get_type().startswith("MISSION_") and message.get_type() != "MISSION_CURRENT"
    ]


def upload(client: Client, rows: Sequence[Row], kind: int = 0) -> int:
    """Upload as a ground station does; the verdict."""
    client.send(mavlink.MAVLink_mission_count_message(1, 1, len(rows), kind))
    for _ in range(4 * len(rows) + 4):
        for message in step(client):
            if message.get_type() == "MISSION_ACK":
                verdict: int = message.type
                return verdict
            client.send(item(message.seq, rows[message.seq], kind))
    raise AssertionError("no end of the upload")


def download(client: Client, kind: int = 0) -> list[Any]:
    client.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
    (count,) = step(client)
    items = []
    for seq in range(count.count):
        client.send(mavlink.MAVLink_mission_request_int_message(1, 1, seq, kind))
        items += step(client)
    client.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
    client.fly(0.02)
    return items


def to(
    client: Client,
    east: float,
    north: float,
    height: float,
    command: int = 16,
    hold: float = 0.0,
    yaw: float = NAN,
) -> Row:
    return (command, 3, hold, 0, 0, yaw, *client.vehicle_goal(east, north), height)


def bare(command: int, *params: float) -> Row:
    return (command, 2, *[*params, *[0.0] * (4 - len(params))], 0, 0, 0)


def counted(count: int, kind: int = 0) -> Any:
    return mavlink.MAVLink_mission_count_message(1, 1, count, kind)


def ready_px4(make: Make) -> Client:
    client = make()
    client.fly(5.0)
    return client


def ready_ardupilot(make: Make, **vehicle: Any) -> Client:
    client = make(simspec("ardupilot", vehicle=vehicle), system=255)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    client.learn_home()
    return client


def start_ardupilot(client: Client) -> None:
    """Arm in GUIDED, and fly the mission in AUTO."""
    for number, arguments in ((176, (1, 4)), (400, (1,)), (176, (1, 3)), (300, ())):
        assert client.command(number, *arguments) == [0]


def start_px4(client: Client, *rows: Row) -> None:
    """Fly this mission from the air."""
    assert upload(client, rows) == 0
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 4) == [0, 0]


def reached(client: Client) -> list[int]:
    numbers = [message.seq for message in of("MISSION_ITEM_REACHED", client.received)]
    return [number for number, _ in groupby(numbers)]


def test_px4_stores_the_uploaded_items(make: Make) -> None:
    """Frames come back in the INT notation, the first item is current, the same plan is the same."""
    client = ready_px4(make)
    rows = [
        to(client, 0, 20, 10, yaw=0.0),
        bare(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0, -1),
        (21, 0, 0, 0, 0, 0, *client.vehicle_goal(0, 0), 488.0),
    ]
    assert upload(client, rows) == 0
    items = download(client)
    assert [item.frame for item in items] == [6, 2, 5]
    assert [item.command for item in items] == [16, 178, 21]
    assert [item.current for item in items] == [1, 0, 0]
    assert (items[0].x, items[0].y, items[0].z) == rows[0][6:]
    client.send(mavlink.MAVLink_mission_request_message(1, 1, 0, 0))
    (as_float,) = step(client)
    assert as_float.get_type() == "MISSION_ITEM"
    assert as_float.frame == 3
    assert as_float.x == pytest.approx(rows[0][6] * 1e-7, abs=1e-5)
    client.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 255))
    (ack,) = step(client)
    assert (ack.type, ack.mission_type) == (0, 255)
    assert download(client) == []


@pytest.mark.parametrize(
    ("row", "kind", "verdict"),
    [
        ((31999, 3, 0, 0, 0, 0, 0, 0, 0), 0, 3),
        ((mavlink.MAV_CMD_NAV_WAYPOINT, 1, 0, 0, 0, 0, 0, 0, 0), 0, 2),
        ((mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, 3, 2, 0, 0, 0, 0, 0, 0), 1, 1),
        ((mavlink.MAV_CMD_NAV_WAYPOINT, 3, 0, 0, 0, 0, 2000000000, 0, 10), 0, 0),
        ((mavlink.MAV_CMD_NAV_WAYPOINT, 3, 0, 0, 0, 0, 470000000, 80000000, NAN), 0, 0),
    ],
)
def test_px4_refuses_the_items_that_the_real_one_does(make: Make, row: Row, kind: int, verdict: int) -> None:
    """Unknown command, wrong frame, too few vertices; neither 200 degrees of latitude nor an altitude of NaN."""
    client = ready_px4(make)
    assert upload(client, [row], kind) == verdict
    assert ("IGN MISSION_ITEM: Invalid item\t" in client.texts()) == (verdict in (2, 3))


def test_px4_repeats_requests_and_gives_up_without_an_answer(make: Make) -> None:
    """Every 0.26 s for 5.1 s, then a text, no acknowledgement, and the old plan stays."""
    client = ready_px4(make)
    assert upload(client, [to(client, 0, 20, 10)]) == 0
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    messages = client.fly(7.0)
    requests = of("MISSION_REQUEST_INT", messages)
    assert 19 <= len(requests) <= 22
    assert not of("MISSION_ACK", messages)
    assert "Operation timeout\t" in client.texts()
    assert len(download(client)) == 1


def test_px4_refuses_an_unknown_type_and_an_unrequested_item(make: Make) -> None:
    """NO_SPACE and ERROR, also for a count during a download; a request out of range is silence."""
    client = ready_px4(make)
    assert upload(client, [to(client, 0, 20, 10)]) == 0
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 99))
    assert [message.type for message in step(client)] == [4]
    client.send(item(7, to(client, 0, 20, 10)))
    assert [message.type for message in step(client)] == [1]
    client.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    step(client)
    client.send(mavlink.MAVLink_mission_request_int_message(1, 1, 5, 0))
    assert step(client) == []
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    assert [message.type for message in step(client)] == [1]


def test_px4_mission_as_mavsdk_flies_it(make: Make) -> None:
    """Waypoints and speeds, no takeoff item, started by the mode: it climbs, flies, returns, and says so."""
    client = make(simspec(vehicle={"parameters": {"RTL_RETURN_ALT": 12.0}}))
    client.fly(5.0)
    client.ask_for("MISSION_CURRENT")
    rows = [
        to(client, 0, 20, 10),
        bare(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0, -1),
        to(client, 15, 20, 10),
        bare(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 8.0, -1),
        bare(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH),
    ]
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    start_px4(client, *rows)
    client.fly(12.0)
    assert client.vehicle.condition().mode == "AUTO_MISSION"
    assert client.last("MISSION_CURRENT").mission_state == 3
    client.fly(14.0)
    assert reached(client)[:2] == [0, 1]
    client.fly(40.0)
    wanted = ["Executing Mission", "Climb to 10.0 meters above home"]
    wanted += ["Mission finished, loitering", "Returning to launch"]
    texts = [text.strip() for text in client.texts()]
    assert [text for text in texts if text in wanted] == wanted
    currents = [message.seq for message in of("MISSION_CURRENT", client.received)]
    assert sorted(set(currents)) == [0, 2, 4]
    assert client.last("MISSION_CURRENT").mission_state == 5
    east, north, up = client.vehicle.truth().position_enu_m
    assert math.hypot(east, north) < 1.0
    assert up < 0.1
    assert not client.vehicle.condition().armed


def test_px4_start_arms_and_set_current_jumps(make: Make) -> None:
    """MISSION_START arms; MISSION_SET_CURRENT goes to that item, and says where there is none."""
    client = ready_px4(make)
    assert upload(client, [to(client, 0, 20, 5, 22), to(client, 0, 40, 10), to(client, 40, 0, 10)]) == 0
    assert client.command(mavlink.MAV_CMD_MISSION_START) == [0]
    assert client.vehicle.condition().armed
    client.fly(15.0)
    client.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    client.fly(0.02)
    client.send(mavlink.MAVLink_mission_set_current_message(1, 1, 9))
    client.fly(25.0)
    east, north, up = client.vehicle.truth().position_enu_m
    assert math.dist((east, north, up), (40, 0, 10)) < 1.0
    assert "WPM: WP CURR CMD: Not in list\t" in client.texts()
    assert client.texts()[-1] == "Mission finished, loitering\t"


def test_px4_pauses_and_goes_on(px4: Client) -> None:
    """Hold stops it on its way; back in the mission it flies on to where it was going."""
    start_px4(px4, to(px4, 0, 60, 10, hold=1.0))
    px4.fly(6.0)
    assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == [0, 0]
    px4.fly(6.0)
    assert 10 < px4.vehicle.truth().position_enu_m[1] < 50
    assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 4) == [0, 0]
    px4.fly(20.0)
    assert px4.vehicle.truth().position_enu_m[1] == pytest.approx(60.0, abs=0.5)


def test_passing_waypoints_keeps_the_speed(px4: Client) -> None:
    """Straight through a waypoint without a hold: never slower than 4 m/s."""
    start_px4(px4, to(px4, 0, 25, 10), to(px4, 0, 50, 10), to(px4, 0, 90, 10))
    slowest = 99.0
    while (north := px4.vehicle.truth().position_enu_m[1]) < 60.0:
        if north > 10.0:
            slowest = min(slowest, px4.vehicle.truth().velocity_enu_mps[1])
        px4.fly(0.1)
    assert slowest > 4.0


def test_jumps_turns_nothing_and_far_away(px4: Client) -> None:
    """A jump is taken twice and no more; a ring of jumps ends the mission; 100 km away is flown to."""
    start_px4(px4, to(px4, 0, 0, 10), to(px4, 0, 12, 10), bare(mavlink.MAV_CMD_DO_JUMP, 0, 2))
    px4.fly(40.0)
    assert reached(px4) == [0, 1, 0, 1, 0, 1]
    assert px4.texts()[-1] == "Mission finished, loitering\t"
    assert upload(px4, [bare(mavlink.MAV_CMD_DO_JUMP, 1, -1), bare(mavlink.MAV_CMD_DO_JUMP, 0, -1)]) == 0
    px4.fly(1.0)
    assert upload(px4, [to(px4, 100_000, 0, 10)]) == 0
    px4.fly(10.0)
    assert px4.vehicle.truth().position_enu_m[0] > 15.0
    assert not px4.vehicle.condition().crashed


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_items_of_extreme_values_leave_it_flying(make: Make, autopilot: str) -> None:
    """NaN, infinities and huge numbers in every field, stored or refused, flown or not."""
    client = ready_px4(make) if autopilot == "px4" else ready_ardupilot(make)
    big = 2**31 - 1
    commands = (16, 17, 18, 19, 20, 21, 22, 31, 93, 112, 115, 177, 178, 195, 201, 5001, 5003, 5100)
    for value in (NAN, math.inf, -math.inf, 3e38, -3e38):
        for command, frame, kind in product(commands, (0, 2, 3, 6, 10), (0, 1, 2)):
            client.send(counted(2, kind))
            for seq, place in enumerate(((big, -big), (473000000, 85000000))):
                client.send(item(seq, (command, frame, *[value] * 4, *place, value), kind))
        client.fly(1.0)
    client.fly(10.0)
    if autopilot == "px4":
        assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
        client.command(mavlink.MAV_CMD_MISSION_START)
    client.fly(5.0)
    assert not client.vehicle.condition().crashed


@pytest.mark.parametrize("value", [3e38, -3e38])
def test_ardupilot_flies_items_of_extreme_values(make: Make, value: float) -> None:
    """Turns, delays, speeds and headings of nonsense numbers, each flown: the vehicle stays in the air."""
    client = ready_ardupilot(make)
    place = client.vehicle_goal(10, 10)
    rows = [
        to(client, 0, 0, 0),
        to(client, 0, 0, 10, 22),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, 2, 1, value, value, value, 0, 0, 0),
        (mavlink.MAV_CMD_CONDITION_YAW, 2, 3e38, value, value, value, 0, 0, 0),
        (16, 3, 0, value, value, value, *place, 10),
        (18, 3, 1, value, value, value, *place, 10),
    ]
    assert upload(client, rows) == 0
    start_ardupilot(client)
    client.fly(60.0)
    assert client.vehicle.truth().position_enu_m[2] == pytest.approx(10.0, abs=1.0)
    assert not client.vehicle.condition().crashed


def test_ardupilot_upload_and_download(make: Make) -> None:
    """Home as item 0, frames 3 and 0; one item is replaced, one added behind the last, none two behind it."""
    client = ready_ardupilot(make)
    rows = [
        to(client, 5, 5, 0),
        to(client, 0, 20, 10, yaw=0.0),
        bare(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0),
    ]
    assert upload(client, rows) == 0
    items = download(client)
    assert [item.frame for item in items] == [0, 3, 0]
    assert [item.current for item in items] == [0, 0, 0]
    home = client.last("HOME_POSITION")
    assert (items[0].x, items[0].y) == (home.latitude, home.longitude)
    partial = mavlink.MAVLink_mission_write_partial_list_message
    for seq, height in ((1, 12), (3, 14)):
        assert answers(client, partial(1, 1, seq, seq, 0)) == ["MISSION_REQUEST"]
        row = to(client, 0, 44, height, yaw=0.0)
        assert answers(client, item(seq, row)) == [0, "Flight plan received"]
    assert [item.z for item in download(client)][1:] == [12.0, 0.0, 14.0]
    assert answers(client, partial(1, 1, 5, 5, 0)) == [1, "Flight plan update rejected"]
    assert answers(client, partial(1, 1, 2, 1, 0)) == [1, "Flight plan update rejected"]
    assert answers(client, mavlink.MAVLink_mission_clear_all_message(1, 1, 255)) == [3]


def test_ardupilot_upload_times_out_and_has_lost_the_old_plan(make: Make) -> None:
    """Asked again every second, cancelled after 8 s; the store was cleared as it began."""
    client = ready_ardupilot(make)
    assert upload(client, [to(client, 0, 0, 0), to(client, 0, 20, 10)]) == 0
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    *requests, verdict, text = spoken(client.fly(9.0))
    assert (requests, verdict, text) == (["MISSION_REQUEST"] * 8, 15, "Mission upload timeout")
    assert download(client) == []


@pytest.mark.parametrize(
    ("row", "verdict"),
    [
        ((mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 3, 0, 0, 0, 0, 0, 0, 0), 3),
        ((mavlink.MAV_CMD_NAV_WAYPOINT, 3, 0, 0, 0, NAN, 0, 0, 10), 0),
        ((mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, 2, 0, 0, 0, NAN, 0, 0, 0), 9),
        ((mavlink.MAV_CMD_DO_JUMP, 2, 9, 1, 0, 0, 0, 0, 0), 1),
        ((mavlink.MAV_CMD_DO_JUMP, 2, 2, 1, 0, 0, 0, 0, 0), 1),
        ((mavlink.MAV_CMD_DO_JUMP, 2, 1, 1, 0, 0, 0, 0, 0), 0),
        ((mavlink.MAV_CMD_DO_JUMP, 2, 0, 1, 0, 0, 0, 0, 0), 1),
    ],
)
def test_ardupilot_refuses_field_by_field(make: Make, row: Row, verdict: int) -> None:
    """Jumps lead to an item of this mission that is not home; the fields have tests in test_vehicle_mission_items."""
    client = ready_ardupilot(make)
    assert upload(client, [to(client, 0, 0, 0), row]) == verdict


def test_ardupilot_flies_as_observed(make: Make) -> None:
    """The texts and the items reached, in the order in which the real one gave them."""
    client = ready_ardupilot(make)
    rows = [
        to(client, 0, 0, 0),
        to(client, 0, 0, 10, 22),
        to(client, 0, 20, 10),
        bare(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0),
        to(client, 20, 20, 10),
        bare(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH),
    ]
    assert upload(client, rows) == 0
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3) == [0]
    client.fly(0.1)
    assert client.texts()[-1] == "Mission: 1 Takeoff"
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [4]
    assert "Arm: AUTO mode not armable" in client.texts()
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3)
    client.fly(2.0)
    assert client.vehicle.condition().landed
    assert client.command(mavlink.MAV_CMD_MISSION_START) == [0]
    begun = len(client.received)
    client.fly(90.0)
    log = [
        message.text if message.get_type() == "STATUSTEXT" else message.seq
        for message in client.received[begun:]
        if message.get_type() in ("STATUSTEXT", "MISSION_ITEM_REACHED")
    ]
    remarks = [entry for entry in log if isinstance(entry, str) and entry.startswith(("EKF3 ", "SIM "))]
    assert len(remarks) == 3
    assert [entry for entry in log if entry not in remarks] == [
        1,
        "Mission: 2 WP",
        "Reached command #2",
        3,
        "Mission: 3 ChangeSpeed",
        "Mission: 4 WP",
        "Reached command #4",
        4,
        "Mission: 5 RTL",
        5,
        "Disarming motors",
    ]
    assert client.vehicle.condition().mode == "AUTO"
    assert math.hypot(*client.vehicle.truth().position_enu_m[:2]) < 1.0
    # A mission that has landed steers no position; the mode entered anew does.
    assert (client.last("HEARTBEAT").base_mode, client.last("HEARTBEAT").custom_mode) == (81, 3)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3)
    assert (client.last("HEARTBEAT").base_mode, client.last("HEARTBEAT").custom_mode) == (89, 3)


def answers(client: Client, message: Any, system: int = 255) -> list[Any]:
    """What comes back for one message of a client: verdicts, names of other messages, texts."""
    client.mav.srcSystem = system
    client.send(message)
    client.mav.srcSystem = 255
    return spoken(client.fly(0.02))


def spoken(messages: Sequence[Any]) -> list[Any]:
    shown = {"MISSION_ACK": "type", "STATUSTEXT": "text", "COMMAND_ACK": "result"}
    return [
        getattr(reply, shown[reply.get_type()]) if reply.get_type() in shown else reply.get_type()
        for reply in messages
        if reply.get_type().startswith(("MISSION_", *shown))
    ]


def test_ardupilot_answers_before_its_texts(make: Make) -> None:
    """Verdict, then the reason; and the warning behind the request for the next item. Too many, another
    sequence, an item without an upload and a type that is none are refused.
    """
    client = ready_ardupilot(make)
    assert answers(client, counted(5000)) == [4, "Only 650 items are supported"]
    assert answers(client, counted(3)) == ["MISSION_REQUEST"]
    place = to(client, 0, 0, 0)
    assert [answers(client, item(seq, place)) for seq in (2, 0)] == [[13], [1]]
    assert answers(client, mavlink.MAVLink_mission_request_list_message(1, 1, 7)) == [3]
    assert client.last("MISSION_ACK").mission_type == 7
    arm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 9)
    assert answers(client, arm) == [4, "Arm: LAND mode not armable"]
    assert answers(client, counted(3)) == ["MISSION_REQUEST"]
    float_item = mavlink.MAVLink_mission_item_message
    warning = "got MISSION_ITEM; GCS should send MISSION_ITEM_INT"
    assert answers(client, item(0, to(client, 0, 0, 0, yaw=0.0))) == ["MISSION_REQUEST"]
    messages = [float_item(1, 1, seq, 2, 178, 0, 1, 1, 3, 0, 0, 0, 0, 0, 0) for seq in (1, 2)]
    assert answers(client, messages[0]) == ["MISSION_REQUEST", warning]
    assert answers(client, messages[1]) == [0, "Flight plan received"]
    as_float = mavlink.MAVLink_mission_request_message(1, 1, 1, 0)
    warned = ["MISSION_ITEM", "got MISSION_REQUEST; use MISSION_REQUEST_INT!"]
    assert [answers(client, as_float) for _ in range(2)] == [warned, warned[:1]]


def test_ardupilot_keeps_an_upload_for_its_client(make: Make) -> None:
    """Others are denied; the client itself reads nothing meanwhile, and may begin again."""
    client = ready_ardupilot(make)
    rows = [to(client, 0, 0, 0, yaw=0.0), to(client, 0, 20, 10, yaw=0.0)]
    assert upload(client, rows) == 0
    assert answers(client, counted(2)) == ["MISSION_REQUEST"]
    for message in (
        counted(2),
        item(0, rows[0]),
        mavlink.MAVLink_mission_request_list_message(1, 1, 0),
        mavlink.MAVLink_mission_request_int_message(1, 1, 0, 0),
    ):
        assert answers(client, message, system=7) == [14], message.get_type()
    assert answers(client, mavlink.MAVLink_mission_clear_all_message(1, 1, 0), system=7) == [14, 1]
    assert answers(client, mavlink.MAVLink_mission_request_int_message(1, 1, 0, 0)) == [14]
    assert answers(client, item(0, rows[0])) == ["MISSION_REQUEST"]
    assert answers(client, item(0, rows[0]), system=7) == [13]
    assert answers(client, counted(2)) == ["MISSION_REQUEST"]
    assert upload(client, rows) == 0
    assert len(download(client)) == 2


def test_ardupilot_takes_a_mission_and_a_fence_side_by_side(make: Make) -> None:
    """Two uploads of one client; each ends for itself."""
    client = ready_ardupilot(make)
    circle = (mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, 3, 50, 0, 0, 0, 473_977_500, 85_456_500, 0)
    assert answers(client, counted(2)) == ["MISSION_REQUEST"]
    assert answers(client, counted(1, 1)) == ["MISSION_REQUEST"]
    assert answers(client, item(0, to(client, 0, 0, 0, yaw=0.0))) == ["MISSION_REQUEST"]
    assert answers(client, item(0, circle, 1)) == [0, "Fence Indexed OK"]
    assert answers(client, item(1, to(client, 0, 9, 9, yaw=0.0))) == [0, "Flight plan received"]
    assert (len(download(client)), len(download(client, 1))) == (2, 1)
    assert answers(client, mavlink.MAVLink_mission_clear_all_message(1, 1, 1)) == [0, "Fence Indexed OK"]
    for kind, name in ((1, "Fence"), (2, "Rally")):
        client.received.clear()
        assert answers(client, counted(1, kind)) == ["MISSION_REQUEST"]
        client.fly(9.0)
        assert client.texts() == [f"{name} upload timeout"]


def test_ardupilot_says_how_long_a_mission_is_to_who_reads_beyond_it(make: Make) -> None:
    """Home is there without a mission; a fence and rally points have verdicts alone."""
    client = ready_ardupilot(make)
    request = mavlink.MAVLink_mission_request_int_message
    assert answers(client, request(1, 1, 0, 0)) == ["MISSION_ITEM_INT"]
    assert client.last("MISSION_ITEM_INT").x == client.last("HOME_POSITION").latitude
    assert answers(client, request(1, 1, 1, 0)) == ["MISSION_COUNT", 1]
    assert client.last("MISSION_COUNT").count == 0
    beyond = [answers(client, request(1, 1, seq, kind)) for kind in (1, 2) for seq in (0, 1)]
    assert beyond == [[1], [13], [13], [13]]


def test_ardupilot_keeps_a_mission_that_it_flies(make: Make) -> None:
    """MISSION_CLEAR_ALL fails in AUTO, and only there."""
    client = ready_ardupilot(make)
    rows = [to(client, 0, 0, 0), to(client, 0, 0, 10, 22), to(client, 0, 60, 10, yaw=0.0)]
    assert upload(client, rows) == 0
    start_ardupilot(client)
    client.fly(12.0)
    clear = mavlink.MAVLink_mission_clear_all_message(1, 1, 0)
    assert answers(client, clear) == [1]
    assert len(download(client)) == 3
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    assert answers(client, clear) == [0]
    assert download(client) == []


def test_ardupilot_turns_delays_and_commands(make: Make) -> None:
    """Two turns of 8 m, a loiter of 5 s, the current item by command; refused without a mission."""
    client = ready_ardupilot(make)
    assert client.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 1) == [2]
    turns = (18, 3, 2, 0, 8, 0, *client.vehicle_goal(0, 20), 10)
    rows = [
        to(client, 0, 0, 0),
        to(client, 0, 0, 10, 22),
        turns,
        to(client, 0, 40, 10, 19, hold=5.0, yaw=0.0),
        to(client, 0, 0, 0, 21),
    ]
    assert upload(client, rows) == 0
    start_ardupilot(client)
    client.fly(15.0)
    distances = []
    while "Mission: 3 LoitTime" not in client.texts():
        client.fly(0.5)
        assert client.vehicle.time.s < 150.0
        east, north, _ = client.vehicle.truth().position_enu_m
        distances.append(math.hypot(east, north - 20.0))
    assert len(distances) * 0.5 > 2 * 2 * math.pi * 8 / 10.0
    assert 6.0 < sorted(distances)[len(distances) // 2] < 10.0
    client.fly(4.0)
    assert client.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 2) == [0]
    assert client.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 77) == [2]
    client.fly(2.0)
    assert client.texts()[-1] == "Mission: 2 LoitTurns"
    assert client.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 4) == [0]
    client.fly(45.0)
    assert client.vehicle.condition().landed
    assert client.texts()[-1] == "Disarming motors"


def test_a_thousand_items_and_rings_leave_it_holding(px4: Client) -> None:
    """More items that nothing flies than calls may lie within each other, and a jump: taken, passed over, and the
    vehicle goes on holding.
    """
    idle = [bare(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3.0, -1)] * 1200
    start_px4(px4, *idle, bare(mavlink.MAV_CMD_DO_JUMP, 0, -1))
    px4.fly(5.0)
    assert px4.vehicle.truth().position_enu_m[2] == pytest.approx(10.0, abs=0.5)
    px4.send(counted(65535))
    assert [message.type for message in step(px4)] == [4]


def test_region_of_interest_turns_the_nose(px4: Client) -> None:
    """Along a leg north the vehicle looks at a place in the east, until there is none."""
    start_px4(
        px4,
        to(px4, 200, 0, 0, mavlink.MAV_CMD_DO_SET_ROI_LOCATION, yaw=0.0),
        to(px4, 0, 30, 10, hold=1.0),
        bare(mavlink.MAV_CMD_DO_SET_ROI_NONE),
        to(px4, 0, 60, 10, hold=1.0),
    )
    px4.fly(5.0)
    assert math.degrees(px4.vehicle.truth().yaw_rad) == pytest.approx(95.0, abs=10.0)
    px4.fly(10.0)
    assert math.degrees(px4.vehicle.truth().yaw_rad) == pytest.approx(0.0, abs=10.0)
