"""The px4 autopilot as an agent sees it, against observations of the real SITL."""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from itertools import groupby

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import NAN, Client, Make, of, simspec

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_x500

CURRENT_MODE = 436
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)


def test_arming_waits_for_readiness(make: Make) -> None:
    """Refused with a text before 4.2 s, accepted after; nonsense gets a text and no answer."""
    client = make()
    client.fly(1.0)
    assert client.last("HEARTBEAT").system_status == 0
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [TEMPORARILY_REJECTED]
    assert any("Resolve system health" in text for text in client.texts())
    client.fly(2.3)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 2) == []
    assert "Unsupported ARM_DISARM param: 2.000\t" in client.texts()
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    client.fly(1.0)
    beat = client.last("HEARTBEAT")
    assert (beat.base_mode, beat.custom_mode, beat.system_status) == (157, 0x03040000, 4)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [ACCEPTED]


def test_unknown_commands_are_unsupported(make: Make) -> None:
    """What no module owns is not answered; other systems get no answer."""
    client = make()
    assert client.command(31999) == [UNSUPPORTED]
    assert client.command_int(31999, 0, 0, 0, 0, 0, 0, 0, 0) == [UNSUPPORTED]
    assert client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 6, -1, 0, 0, NAN, 0, 0, 10) == [UNSUPPORTED]
    assert client.command(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW) == []
    assert client.command(mavlink.MAV_CMD_DO_SET_ROI_LOCATION) == [ACCEPTED]
    client.send(mavlink.MAVLink_command_long_message(42, 1, 31999, 0, 0, 0, 0, 0, 0, 0, 0))
    client.send(mavlink.MAVLink_command_long_message(1, 99, 31999, 0, 0, 0, 0, 0, 0, 0, 0))
    assert not of("COMMAND_ACK", client.fly(0.1))
    client.send(mavlink.MAVLink_command_long_message(0, 0, 31999, 0, 0, 0, 0, 0, 0, 0, 0))
    (ack,) = of("COMMAND_ACK", client.fly(0.1))
    assert (ack.result, ack.target_system, ack.target_component) == (UNSUPPORTED, 245, 190)


def test_landed_states_follow_the_flight(make: Make) -> None:
    """1 on the ground, 3 while taking off, 2 when done, 4 on the way down, 1 again."""
    client = make(streams="onboard")
    client.airborne(5.0)
    client.command(mavlink.MAV_CMD_NAV_LAND)
    client.fly(15.0)
    states = groupby(message.landed_state for message in of("EXTENDED_SYS_STATE", client.received))
    assert [state for state, _ in states] == [1, 3, 2, 4, 1]


def test_losing_setpoints_returns_and_their_return_resumes(make: Make) -> None:
    """1 s after the last: failsafe, AUTO_RTL, status 5; when they come back: OFFBOARD by itself."""
    client = make()
    client.airborne()
    client.offboard(30, 0, -10)
    client.fly(3.0, lambda: client.setpoint(30, 0, -10))
    client.fly(0.8)
    assert client.vehicle.condition().mode == "OFFBOARD"
    client.fly(0.3)
    assert client.vehicle.condition().mode == "AUTO_RTL"
    assert client.vehicle.condition().failsafe == "setpoints"
    client.fly(1.0)
    assert client.last("HEARTBEAT").system_status == 5
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, CURRENT_MODE)
    client.fly(0.1)
    # Both what is flown and what was asked for.
    mode = client.last("CURRENT_MODE")
    assert (mode.custom_mode, mode.intended_custom_mode) == (0x05040000, 6 << 16)
    client.fly(0.6, lambda: client.setpoint(30, 0, -10))
    assert client.vehicle.condition().mode == "OFFBOARD"
    assert client.vehicle.condition().failsafe == ""


@pytest.mark.parametrize(
    ("mask", "frame", "text"), [(0xFFF, 1, "invalid"), (2552, 6, "coordinate frame 6 unsupported")]
)
def test_senseless_setpoints_are_complained_of_and_count_as_none(
    make: Make, mask: int, frame: int, text: str
) -> None:
    client = make()
    client.fly(4.0)
    client.setpoint(1, 2, -3, mask, frame)
    client.fly(0.1)
    assert any(text in sent for sent in "".join(client.texts()).split("\t"))
    assert client.vehicle.counters()["setpoints_ignored"] == 1
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6) == [ACCEPTED, ACCEPTED]
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [TEMPORARILY_REJECTED]


def test_offboard_from_the_ground_and_back(make: Make) -> None:
    """A setpoint above it lifts it off; a velocity downwards lands and disarms it."""
    client = make(streams="onboard")
    client.fly(4.0)
    client.offboard(0, 0, -4)
    client.setpoint(0, 0, -4)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    client.fly(8.0, lambda: client.setpoint(0, 0, -4))
    assert client.vehicle.truth().position_enu_m == pytest.approx((0, 0, 4), abs=0.1)
    client.fly(9.0, lambda: client.setpoint(0, 0, 0, 0x7 | 0x1C0 | 0xC00, vd=1.0))
    condition = client.vehicle.condition()
    assert (condition.armed, condition.landed, condition.crashed) == (False, True, False)


def test_nonsense_in_parameters_does_not_break_the_flight(make: Make) -> None:
    """A speed limit of 9999 m/s: the airframe goes as fast as it can and still stops."""
    client = make(simspec(vehicle={"parameters": {"MPC_XY_VEL_MAX": 9999.0, "MPC_LAND_SPEED": -5.0}}))
    client.airborne(5.0)
    client.offboard(150, 0, -5)
    client.fly(22.0, lambda: client.setpoint(150, 0, -5))
    assert client.vehicle.truth().position_enu_m == pytest.approx((0, 150, 5), abs=0.3)


def test_intervals_can_be_set_read_and_reset(make: Make) -> None:
    """Exact rates, -1 stops, 0 restores the default; an unknown one fails and is still reported on."""
    interval, attitude = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE
    client = make(streams="onboard")
    client.fly(5.0)
    assert client.command(interval, attitude, 100_000) == [ACCEPTED]
    assert client.command(interval, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, -1) == [ACCEPTED]
    counts = Counter(message.get_type() for message in client.fly(5.0))
    assert counts["ATTITUDE"] == pytest.approx(50, abs=1)
    assert counts["GLOBAL_POSITION_INT"] == 0
    client.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, attitude)
    assert client.last("MESSAGE_INTERVAL").interval_us == 100_000
    assert client.command(interval, attitude, 0) == [ACCEPTED]
    assert len(of("ATTITUDE", client.fly(1.0))) == pytest.approx(100, abs=1)
    assert client.command(interval, mavlink.MAVLINK_MSG_ID_RAW_IMU, 1000) == [FAILED]
    assert client.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 9999) == [ACCEPTED]
    assert client.command(interval, NAN, NAN) == [FAILED]


def test_timesync_is_answered_with_the_simulated_time_since_boot(make: Make) -> None:
    client = make()
    client.fly(3.0)
    client.send(mavlink.MAVLink_timesync_message(0, 77))
    answers = [message for message in of("TIMESYNC", client.fly(0.02)) if message.ts1 == 77]
    assert [message.tc1 for message in answers] == [client.vehicle.time.ns - 20_000_000]


def test_a_takeoff_to_below_home_rises_all_the_same(make: Make) -> None:
    """Lower than MIS_TAKEOFF_ALT: that height, with a text; and lower than the vehicle: it stays, with another."""
    client = make()
    client.fly(5.0)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 480.0) == [0]
    client.fly(8.0)
    assert client.vehicle.truth().position_enu_m[2] == pytest.approx(2.5, abs=0.3)
    goal = client.vehicle_goal(0.0, 0.0)
    assert client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, -1, 1, 0, NAN, *goal, 496.0) == [0]
    client.fly(6.0)
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 491.0) == [0]
    client.fly(3.0)
    assert client.vehicle.truth().position_enu_m[2] == pytest.approx(8.0, abs=0.4)
    texts = [text for text in client.texts() if "takeoff altitude" in text]
    assert texts == ["Using minimum takeoff altitude: 2.50 m\t", "Already higher than takeoff altitude\t"]


def test_texts_go_where_a_ground_station_is_heard(make: Make) -> None:
    """To no companion; to a station until 2.5 s after its last heartbeat. Events go to both."""
    client = make()
    client.is_station = False
    client.fly(3.0)
    client.received.clear()

    def beat(kind: int) -> None:
        client.send(mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 0, 3))

    def texts_of_a_refusal() -> int:
        client.received.clear()
        assert client.command(mavlink.MAV_CMD_MISSION_START) == [DENIED]
        assert of("EVENT", client.received)
        return len(client.texts())

    assert texts_of_a_refusal() == 0
    beat(mavlink.MAV_TYPE_ONBOARD_CONTROLLER)
    assert texts_of_a_refusal() == 0
    beat(mavlink.MAV_TYPE_GCS)
    assert texts_of_a_refusal() == 1
    client.fly(2.4)
    assert texts_of_a_refusal() == 1
    client.fly(0.2)
    assert texts_of_a_refusal() == 0


def test_a_text_goes_over_the_stations_link_alone() -> None:
    """A companion on another link of the same vehicle reads none."""
    station, companion = Client(255), Client()
    links = tuple(
        LinkSpec(name, "udp_out", port=client.port, streams="none")
        for name, client in (("gcs", station), ("onboard", companion))
    )
    with (
        closing(station.socket),
        closing(companion.socket),
        open_x500(VehiclePlan(simspec(), links)) as vehicle,
    ):
        station.vehicle = companion.vehicle = vehicle
        station.is_station = True
        station.fly(2.0)
        companion.fly(0.1)
        companion.command(mavlink.MAV_CMD_MISSION_START)
        station.fly(0.1)
    assert station.texts() == ["Mission start denied! No valid mission\t"]
    assert companion.texts() == []


def test_a_return_says_how_high_it_flies(make: Make) -> None:
    """In two pieces, as the real one; the text of the command comes with the command alone."""
    client = make()
    client.airborne(10.0)
    client.fly(5.0)
    client.received.clear()
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 5)
    assert client.texts()[:2] == ["RTL: start return at 499 m (11 m above destination", ")\t"]
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)
    client.received.clear()
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    assert client.texts()[0] == "Returning to launch\t"
    client.fly(1.0)
    assert client.texts()[-1] == "RTL: land at destination\t"


def test_a_landing_out_of_offboard_shows_offboard_again(make: Make) -> None:
    """17, status 0, also where its failsafe landed; after a return that was ordered Hold."""
    client = make()
    client.airborne(3.0)
    client.offboard(0.0, 0.0, -3.0)
    client.fly(25.0)
    assert not client.vehicle.condition().armed
    heartbeat = client.last("HEARTBEAT")
    assert (heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status) == (17, 6 << 16, 0)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)
    client.airborne(3.0)
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    client.fly(15.0)
    heartbeat = client.last("HEARTBEAT")
    assert (heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status) == (29, 0x03040000, 3)


def test_a_return_levels_its_gimbal(make: Make) -> None:
    """Takes it, levels it, gives it back, each four times in two seconds; an answer ends one of them."""
    client = make()
    client.airborne(10.0)
    client.received.clear()
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    client.fly(3.0)
    commands = of("COMMAND_LONG", client.received)
    assert [(message.command, message.param1) for message in commands[::2]][:1] == [(1001, 1.0)]
    assert Counter(message.command for message in commands) == {1000: 4, 1001: 8}
    assert {message.target_system for message in commands} == {1}
    assert sorted({message.confirmation for message in commands}) == [0, 1, 2, 3]

    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)
    client.received.clear()
    client.command(mavlink.MAV_CMD_NAV_LAND)
    client.mav.srcSystem = 1
    client.send(mavlink.MAVLink_command_ack_message(1000, 0))
    client.mav.srcSystem = 245
    client.fly(3.0)
    commands = of("COMMAND_LONG", client.received)
    assert Counter(message.command for message in commands) == {1000: 1, 1001: 8}
