"""Every command is answered as the real autopilots answered it, silence included; and so are wrong addresses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import NAN, Client, Make, of, simspec

from vehicle_models.controller.links._dialect import dialect

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)

# Names of commands, or numbers that no autopilot knows, by the answer of the real one. INJECT_FAILURE is of a
# gyro, which is not modelled.
PX4_BOTH = {
    UNSUPPORTED: """
        31999 INJECT_FAILURE DO_PAUSE_CONTINUE DO_SET_MISSION_CURRENT DO_FENCE_ENABLE DO_PARACHUTE
        DO_SET_SERVO DO_SET_RELAY CONDITION_YAW NAV_GUIDED_ENABLE NAV_WAYPOINT NAV_LOITER_UNLIM
        IMAGE_START_CAPTURE VIDEO_START_CAPTURE LOGGING_START LOGGING_STOP 611 DO_REPOSITION
    """,
    ACCEPTED: """
        DO_CHANGE_SPEED DO_CHANGE_ALTITUDE DO_SET_ROI_LOCATION DO_SET_ROI_NONE DO_SET_ROI
        DO_GO_AROUND DO_SET_ACTUATOR RUN_PREARM_CHECKS
    """,
    CANCELLED: "DO_LAND_START",
    None: """
        DO_GIMBAL_MANAGER_PITCHYAW DO_GIMBAL_MANAGER_CONFIGURE DO_MOUNT_CONFIGURE DO_MOUNT_CONTROL
        DO_DIGICAM_CONTROL DO_SET_CAM_TRIGG_DIST DO_TRIGGER_CONTROL DO_WINCH SET_CAMERA_MODE
        REQUEST_CAMERA_INFORMATION DO_VTOL_TRANSITION START_RX_PAIR
    """,
}
PX4_FLYING = {
    REJECTED: "PREFLIGHT_CALIBRATION PREFLIGHT_STORAGE",
    DENIED: "ACTUATOR_TEST",
}
COPTER_BOTH = {
    UNSUPPORTED: """
        44999 DO_ORBIT DO_CHANGE_ALTITUDE GUIDED_CHANGE_SPEED GUIDED_CHANGE_ALTITUDE
        GUIDED_CHANGE_HEADING NAV_WAYPOINT DO_GUIDED_LIMITS DO_JUMP DO_REPOSITION
        REQUEST_PROTOCOL_VERSION REQUEST_CAMERA_INFORMATION REQUEST_FLIGHT_INFORMATION
        REQUEST_STORAGE_INFORMATION SET_CAMERA_MODE SET_CAMERA_ZOOM DO_VTOL_TRANSITION
        DO_ENGINE_CONTROL LOGGING_START DO_SET_STANDARD_MODE
    """,
    ACCEPTED: """
        DO_PAUSE_CONTINUE DO_SET_ROI_LOCATION DO_SET_ROI_NONE DO_SET_ROI DO_SET_ROI_SYSID
        DO_DIGICAM_CONTROL DO_SET_CAM_TRIGG_DIST DO_FENCE_ENABLE DO_SET_RELAY DO_PARACHUTE
        DO_SPRAYER REQUEST_AUTOPILOT_CAPABILITIES IMAGE_STOP_CAPTURE DO_FOLLOW CONTROL_HIGH_LATENCY
        DO_SEND_BANNER
    """,
    FAILED: """
        DO_MOUNT_CONFIGURE DO_MOUNT_CONTROL DO_GIMBAL_MANAGER_PITCHYAW DO_GIMBAL_MANAGER_CONFIGURE
        IMAGE_START_CAPTURE VIDEO_START_CAPTURE VIDEO_STOP_CAPTURE DO_GRIPPER DO_WINCH DO_LAND_START
    """,
    DENIED: "DO_SET_MISSION_CURRENT PREFLIGHT_STORAGE",
}


def check(client: Client, table: Mapping[Any, str]) -> None:
    for result, names in table.items():
        for name in names.split():
            number = int(name) if name.isdigit() else getattr(mavlink, f"MAV_CMD_{name}")
            assert client.command(number) == ([] if result is None else [result]), name


def test_px4(make: Make) -> None:
    client = make()
    client.fly(5.0)
    check(client, PX4_BOTH)
    assert client.command(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION) == [ACCEPTED]
    assert client.command(mavlink.MAV_CMD_MISSION_START) == [DENIED]
    assert "Mission start denied! No valid mission\t" in client.texts()
    assert client.command(mavlink.MAV_CMD_CONTROL_HIGH_LATENCY, 1) == [FAILED]
    # The gripper has a way to go once.
    assert client.command(mavlink.MAV_CMD_DO_GRIPPER, 1, 0) == [IN_PROGRESS]
    assert [message.result for message in of("COMMAND_ACK", client.fly(2.0))] == [ACCEPTED]
    assert client.command(mavlink.MAV_CMD_DO_GRIPPER, 1, 1) == [ACCEPTED]
    client.airborne()
    check(client, PX4_BOTH)
    check(client, PX4_FLYING)
    assert client.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == [DENIED]
    assert client.vehicle.condition().mode == "AUTO_LOITER"


def test_a_command_in_progress_can_be_cancelled(make: Make) -> None:
    """COMMAND_CANCEL of the gripper's way; for what is over, or is another's, or to every system, no answer."""
    client = make()
    client.fly(5.0)
    assert client.command(mavlink.MAV_CMD_DO_GRIPPER, 1, 0) == [IN_PROGRESS]

    def cancelled(system: int, number: int) -> list[int]:
        client.send(dialect.MAVLink_command_cancel_message(system, 1, number))
        return [message.result for message in of("COMMAND_ACK", client.fly(0.1))]

    assert cancelled(0, 211) == cancelled(42, 211) == cancelled(1, 400) == []
    assert cancelled(1, 211) == [CANCELLED]
    assert of("COMMAND_ACK", client.fly(2.0)) == []
    assert cancelled(1, 211) == []


@pytest.mark.parametrize(("autopilot", "taken_by_100"), [("px4", False), ("ardupilot", True)])
def test_addresses(make: Make, autopilot: str, taken_by_100: bool) -> None:
    """0 is every system. An absent component of its own system is none for PX4, as good as any for ArduPilot."""
    client = make(simspec(autopilot))
    client.fly(5.0)
    for whom, answered in (
        ((42, 1), False),
        ((1, 100), taken_by_100),
        ((1, 0), True),
        ((0, 0), True),
        ((0, 1), True),
    ):
        client.send(
            mavlink.MAVLink_command_long_message(
                *whom, mavlink.MAV_CMD_DO_SET_ROI_NONE, 0, 0, 0, 0, 0, 0, 0, 0
            )
        )
        acks = of("COMMAND_ACK", client.fly(0.1))
        assert bool(acks) is answered, whom
    assert (acks[0].target_system, acks[0].target_component, acks[0].progress) == (245, 190, 0)


@pytest.fixture
def copter(make: Make) -> Client:
    client = make(simspec("ardupilot"), streams="onboard", system=255)
    client.learn_home()
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [ACCEPTED]
    return client


def test_copter(copter: Client) -> None:
    check(copter, COPTER_BOTH)
    assert copter.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == [ACCEPTED]
    assert copter.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    assert copter.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5) == [ACCEPTED]
    copter.fly(8.0)
    check(copter, COPTER_BOTH)
    assert copter.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == [REJECTED]
    assert copter.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == [FAILED]
    assert copter.command(mavlink.MAV_CMD_DO_MOTOR_TEST, 1) == [FAILED]
    assert copter.command(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 1) == [FAILED]
    assert {"Motor Test: vehicle not landed", "Disarm to allow calibration"} <= set(copter.texts())


def test_copter_details(copter: Client) -> None:
    """Values that change the answer, and the texts that come with it."""
    for name, params, result in (
        ("DO_FENCE_ENABLE", (7,), FAILED),
        ("DO_SET_SERVO", (9, 1500), ACCEPTED),
        ("DO_SET_SERVO", (1, 1500), FAILED),
        ("DO_SET_SERVO", (99, 1500), FAILED),
        ("DO_FLIGHTTERMINATION", (0,), FAILED),
        ("DO_CHANGE_SPEED", (9, 5.0), ACCEPTED),
        ("DO_AUX_FUNCTION", (999, 2), FAILED),
        ("DO_AUX_FUNCTION", (55, 3), DENIED),
        ("SET_EKF_SOURCE_SET", (2,), ACCEPTED),
        ("SET_EKF_SOURCE_SET", (4,), DENIED),
        ("START_RX_PAIR", (), FAILED),
        ("PREFLIGHT_CALIBRATION", (0, 0, 1), IN_PROGRESS),
    ):
        assert copter.command(getattr(mavlink, f"MAV_CMD_{name}"), *params) == [result], (name, params)
    assert [message.result for message in of("COMMAND_ACK", copter.fly(2.0))] == [ACCEPTED]
    texts = {"ServoRelayEvent: Channel 1 is already in use", "Invalid channel option (999)"}
    assert texts <= set(copter.texts())
    # A switch of the mode LOITER, low and high.
    assert copter.command(mavlink.MAV_CMD_DO_AUX_FUNCTION, 56, 0) == [ACCEPTED]
    assert copter.vehicle.condition().mode == "GUIDED"
    assert copter.command(mavlink.MAV_CMD_DO_AUX_FUNCTION, 56, 2) == [ACCEPTED]
    assert copter.vehicle.condition().mode == "LOITER"


def test_copter_reposition(copter: Client) -> None:
    """COMMAND_INT alone; another mode needs the flag; 0/0, NaN and foreign frames are denied."""
    goal = copter.vehicle_goal(5.0, 5.0)

    def reposition(frame: int = 3, flag: int = 0, place: tuple[int, int] = goal) -> list[int]:
        return copter.command_int(mavlink.MAV_CMD_DO_REPOSITION, frame, -1, flag, 0, NAN, *place, 5.0)

    assert copter.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1) == [UNSUPPORTED]
    assert reposition() == [ACCEPTED]
    assert reposition(place=(0, 0)) == reposition(place=(950_000_000, goal[1])) == [DENIED]
    assert reposition(frame=1) == [DENIED]
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 5) == [ACCEPTED]
    assert reposition() == [DENIED]
    assert reposition(flag=1) == [ACCEPTED]
    assert copter.vehicle.condition().mode == "GUIDED"


def test_px4_modes_without_the_custom_flag(make: Make) -> None:
    """Accepted first, whatever is asked; then rejected where no bit asks for a mode, or as the bits ask."""
    client = make()
    client.fly(5.0)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 0, 4, 3) == [ACCEPTED, REJECTED]
    assert client.vehicle.condition().mode == "AUTO_LOITER"
    for base, mode in ((4, "AUTO_MISSION"), (64, "MANUAL"), (64 | 8, "POSCTL"), (64 | 16, "STABILIZED")):
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, base, 9, 9) == [ACCEPTED, ACCEPTED]
        assert client.vehicle.condition().mode == mode


@pytest.mark.parametrize("place", [(473970000 + 9_100_000, 85450000), (-473970000, -1714550000)])
def test_a_reposition_may_be_far_away(make: Make, place: tuple[int, int]) -> None:
    """100 km away or on the other side of the Earth: accepted without a text, and the vehicle sets out."""
    client = make(streams="onboard")
    client.airborne()
    before = client.texts()
    assert client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, -1, 1, 0, NAN, *place, 500.0) == [ACCEPTED]
    client.fly(4.0)
    assert client.texts() == before
    assert sum(axis**2 for axis in client.vehicle.truth().velocity_enu_mps[:2]) > 9.0


def test_px4_answers_a_new_origin_with_its_own(make: Make) -> None:
    """SET_GPS_GLOBAL_ORIGIN is answered at once; the origin stays."""
    client = make()
    client.fly(5.0)
    origin = client.last("GPS_GLOBAL_ORIGIN")
    client.send(mavlink.MAVLink_set_gps_global_origin_message(1, 10, 20, 30))
    answers = of("GPS_GLOBAL_ORIGIN", client.fly(0.1))
    assert [(m.latitude, m.longitude) for m in answers] == [(origin.latitude, origin.longitude)]


def test_copter_home(make: Make) -> None:
    """Not on Earth: FAILED. 0, 0 is the present place, and the origin is sent with home."""
    client = make(simspec("ardupilot"))
    client.learn_home()
    home = client.last("HOME_POSITION")
    set_home = mavlink.MAV_CMD_DO_SET_HOME
    assert client.command(set_home, 0, 0, 0, 0, 95.0, 8.0, 500.0) == [FAILED]
    client.received.clear()
    assert client.command(set_home) == [ACCEPTED]
    assert client.last("HOME_POSITION").latitude == pytest.approx(home.latitude, abs=300)
    assert client.last("GPS_GLOBAL_ORIGIN").latitude == pytest.approx(home.latitude, abs=300)


def test_copter_judges_the_first_item_of_a_fence(make: Make) -> None:
    """Home takes the first place of missions alone: a waypoint in a fence or among rally points is refused."""
    client = make(simspec("ardupilot"))
    for kind in (mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY):
        client.send(mavlink.MAVLink_mission_count_message(1, 1, 1, kind))
        client.fly(0.1)
        item = (1, 1, 0, 3, mavlink.MAV_CMD_NAV_WAYPOINT, 0, 1, 0, 0, 0, 0, 470000000, 80000000, 10, kind)
        client.send(mavlink.MAVLink_mission_item_int_message(*item))
        client.fly(0.1)
        assert (client.last("MISSION_ACK").type, client.last("MISSION_ACK").mission_type) == (3, kind)
