"""Every command is answered as the real autopilots answered it, silence included; and so are wrong
addresses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import NAN, Client, Make, of, simspec

from vehicle_models.controller.links._dialect import dialect

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)

PX4_BOTH = {
    UNSUPPORTED: (
        31999,
        mavlink.MAV_CMD_INJECT_FAILURE,  # of a gyro, which is not modelled; DENIED while SYS_FAILURE_EN is 0
        mavlink.MAV_CMD_DO_PAUSE_CONTINUE,
        mavlink.MAV_CMD_DO_SET_MISSION_CURRENT,
        mavlink.MAV_CMD_DO_FENCE_ENABLE,
        mavlink.MAV_CMD_DO_PARACHUTE,
        mavlink.MAV_CMD_DO_SET_SERVO,
        mavlink.MAV_CMD_DO_SET_RELAY,
        mavlink.MAV_CMD_CONDITION_YAW,
        mavlink.MAV_CMD_NAV_GUIDED_ENABLE,
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_VIDEO_START_CAPTURE,
        mavlink.MAV_CMD_LOGGING_START,
        mavlink.MAV_CMD_LOGGING_STOP,
        611,
        mavlink.MAV_CMD_DO_REPOSITION,
    ),
    ACCEPTED: (
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_CHANGE_ALTITUDE,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_DO_GO_AROUND,
        mavlink.MAV_CMD_DO_SET_ACTUATOR,
        mavlink.MAV_CMD_RUN_PREARM_CHECKS,
    ),
    CANCELLED: (mavlink.MAV_CMD_DO_LAND_START,),
    None: (
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
        mavlink.MAV_CMD_DO_MOUNT_CONFIGURE,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        mavlink.MAV_CMD_DO_TRIGGER_CONTROL,
        mavlink.MAV_CMD_DO_WINCH,
        mavlink.MAV_CMD_SET_CAMERA_MODE,
        mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION,
        mavlink.MAV_CMD_DO_VTOL_TRANSITION,
        mavlink.MAV_CMD_START_RX_PAIR,
    ),
}
PX4_FLYING = {
    REJECTED: (mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, mavlink.MAV_CMD_PREFLIGHT_STORAGE),
    DENIED: (mavlink.MAV_CMD_ACTUATOR_TEST,),
}
COPTER_BOTH = {
    UNSUPPORTED: (
        44999,
        mavlink.MAV_CMD_DO_ORBIT,
        mavlink.MAV_CMD_DO_CHANGE_ALTITUDE,
        mavlink.MAV_CMD_GUIDED_CHANGE_SPEED,
        mavlink.MAV_CMD_GUIDED_CHANGE_ALTITUDE,
        mavlink.MAV_CMD_GUIDED_CHANGE_HEADING,
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_DO_GUIDED_LIMITS,
        mavlink.MAV_CMD_DO_JUMP,
        mavlink.MAV_CMD_DO_REPOSITION,
        mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION,
        mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION,
        mavlink.MAV_CMD_REQUEST_FLIGHT_INFORMATION,
        mavlink.MAV_CMD_REQUEST_STORAGE_INFORMATION,
        mavlink.MAV_CMD_SET_CAMERA_MODE,
        mavlink.MAV_CMD_SET_CAMERA_ZOOM,
        mavlink.MAV_CMD_DO_VTOL_TRANSITION,
        mavlink.MAV_CMD_DO_ENGINE_CONTROL,
        mavlink.MAV_CMD_LOGGING_START,
        mavlink.MAV_CMD_DO_SET_STANDARD_MODE,
    ),
    ACCEPTED: (
        mavlink.MAV_CMD_DO_PAUSE_CONTINUE,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_DO_SET_ROI_SYSID,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        mavlink.MAV_CMD_DO_FENCE_ENABLE,
        mavlink.MAV_CMD_DO_SET_RELAY,
        mavlink.MAV_CMD_DO_PARACHUTE,
        mavlink.MAV_CMD_DO_SPRAYER,
        mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
        mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
        mavlink.MAV_CMD_DO_FOLLOW,
        mavlink.MAV_CMD_CONTROL_HIGH_LATENCY,
        mavlink.MAV_CMD_DO_SEND_BANNER,
    ),
    FAILED: (
        mavlink.MAV_CMD_DO_MOUNT_CONFIGURE,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_VIDEO_START_CAPTURE,
        mavlink.MAV_CMD_VIDEO_STOP_CAPTURE,
        mavlink.MAV_CMD_DO_GRIPPER,
        mavlink.MAV_CMD_DO_WINCH,
        mavlink.MAV_CMD_DO_LAND_START,
    ),
    DENIED: (mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, mavlink.MAV_CMD_PREFLIGHT_STORAGE),
}


def check(client: Client, table: Mapping[Any, tuple[int, ...]]) -> None:
    for result, numbers in table.items():
        for number in numbers:
            if number in (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_MISSION_START):
                continue
            results = client.command(number)
            assert results == ([] if result is None else [result]), number


def test_px4(make: Make) -> None:
    client = make()
    client.fly(5.0)
    check(client, PX4_BOTH)
    assert client.command(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION) == [ACCEPTED]
    assert client.command(mavlink.MAV_CMD_MISSION_START) == [DENIED]
    assert "Mission start denied! No valid mission\t" in client.texts()
    assert client.command(mavlink.MAV_CMD_CONTROL_HIGH_LATENCY, 1) == [FAILED]
    client.airborne()
    check(client, PX4_BOTH)
    check(client, PX4_FLYING)
    assert client.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == [DENIED]
    assert client.vehicle.condition().mode == "AUTO_LOITER"


def test_px4_gripper_takes_its_time(make: Make) -> None:
    """IN_PROGRESS, then ACCEPTED; ACCEPTED alone from then on."""
    client = make()
    client.fly(5.0)
    assert client.command(mavlink.MAV_CMD_DO_GRIPPER, 1, 0) == [IN_PROGRESS]
    assert [message.result for message in of("COMMAND_ACK", client.fly(2.0))] == [ACCEPTED]
    assert client.command(mavlink.MAV_CMD_DO_GRIPPER, 1, 1) == [ACCEPTED]


def test_a_command_in_progress_can_be_cancelled(make: Make) -> None:
    """COMMAND_CANCEL ends the gripper's way with CANCELLED and nothing after it; for what is over, is not
    going on, or is another client's, or to every system, there is no answer.
    """
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


def test_px4_addresses(make: Make) -> None:
    """Messages to another system or an absent component are ignored; 0 is every system."""
    client = make()
    client.fly(5.0)
    for system, component, answered in (
        (42, 1, False),
        (1, 100, False),
        (1, 0, True),
        (0, 0, True),
        (0, 1, True),
    ):
        client.send(
            mavlink.MAVLink_command_long_message(
                system, component, mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, 1, 5, 0, 0, 0, 0, 0
            )
        )
        acks = of("COMMAND_ACK", client.fly(0.1))
        assert bool(acks) is answered, (system, component)
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
    assert copter.command(mavlink.MAV_CMD_DO_FENCE_ENABLE, 7) == [FAILED]
    assert copter.command(mavlink.MAV_CMD_DO_SET_SERVO, 9, 1500) == [ACCEPTED]
    assert copter.command(mavlink.MAV_CMD_DO_SET_SERVO, 1, 1500) == [FAILED]
    assert copter.command(mavlink.MAV_CMD_DO_SET_SERVO, 99, 1500) == [FAILED]
    assert copter.command(mavlink.MAV_CMD_DO_AUX_FUNCTION, 999) == [FAILED]
    assert copter.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0) == [FAILED]
    assert copter.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 9, 5.0) == [ACCEPTED]
    assert copter.command(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 0, 0, 1) == [IN_PROGRESS]
    assert [message.result for message in of("COMMAND_ACK", copter.fly(2.0))] == [ACCEPTED]
    assert {"ServoRelayEvent: Channel 1 is already in use", "Invalid channel option (999)"} <= set(
        copter.texts()
    )


def test_copter_reposition(copter: Client) -> None:
    """COMMAND_INT alone; another mode needs the flag; 0/0, NaN and foreign frames are denied."""
    goal = copter.command(mavlink.MAV_CMD_GET_HOME_POSITION) and copter.vehicle_goal(5.0, 5.0)
    assert goal
    assert copter.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1) == [UNSUPPORTED]
    assert copter.command_int(mavlink.MAV_CMD_DO_REPOSITION, 3, -1, 0, 0, NAN, *goal, 5.0) == [ACCEPTED]
    assert copter.command_int(mavlink.MAV_CMD_DO_REPOSITION, 3, -1, 0, 0, NAN, 0, 0, 5.0) == [DENIED]
    assert copter.command_int(mavlink.MAV_CMD_DO_REPOSITION, 1, -1, 0, 0, NAN, *goal, 5.0) == [DENIED]
    assert copter.command_int(mavlink.MAV_CMD_DO_REPOSITION, 3, -1, 0, 0, NAN, 950_000_000, goal[1], 5.0) == [
        DENIED
    ]
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 5) == [ACCEPTED]
    assert copter.command_int(mavlink.MAV_CMD_DO_REPOSITION, 3, -1, 0, 0, NAN, *goal, 5.0) == [DENIED]
    assert copter.command_int(mavlink.MAV_CMD_DO_REPOSITION, 3, -1, 1, 0, NAN, *goal, 5.0) == [ACCEPTED]
    assert copter.vehicle.condition().mode == "GUIDED"


def test_copter_addresses(copter: Client) -> None:
    """Messages to any component of its system are taken; those to another system are ignored."""
    for system, component, answered in ((42, 1, False), (1, 100, True), (1, 0, True), (0, 0, True)):
        copter.send(
            mavlink.MAVLink_command_long_message(
                system, component, mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST, 0, 0, 0, 0, 0, 0, 0, 0
            )
        )
        assert bool(of("COMMAND_ACK", copter.fly(0.1))) is answered, (
            system,
            component,
        )


def test_px4_modes_without_the_custom_flag(make: Make) -> None:
    """DO_SET_MODE: accepted first, whatever is asked; then rejected where no bit asks for a mode, or as the bits
    ask.
    """
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


def test_copter_auxiliary_functions_and_sources(make: Make) -> None:
    """DO_AUX_FUNCTION enters modes with the switch high; unknown functions fail with their number. The sources of
    the estimator are 1 to 3.
    """
    client = make(simspec("ardupilot"))
    client.fly(5.0)
    aux = mavlink.MAV_CMD_DO_AUX_FUNCTION
    assert client.command(aux, 999, 2) == [FAILED]
    assert client.texts() == ["Invalid channel option (999)"]
    assert client.command(aux, 56, 0) == [ACCEPTED]
    assert client.vehicle.condition().mode == "STABILIZE"
    assert client.command(aux, 56, 2) == [ACCEPTED]
    assert client.vehicle.condition().mode == "LOITER"
    assert client.command(aux, 55, 3) == [DENIED]
    assert client.command(42007, 2) == [ACCEPTED]
    assert client.command(42007, 4) == [DENIED]
    assert client.command(mavlink.MAV_CMD_START_RX_PAIR) == [FAILED]


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
        item = mavlink.MAVLink_mission_item_int_message
        client.send(
            item(1, 1, 0, 3, mavlink.MAV_CMD_NAV_WAYPOINT, 0, 1, 0, 0, 0, 0, 470000000, 80000000, 10, kind)
        )
        client.fly(0.1)
        assert (client.last("MISSION_ACK").type, client.last("MISSION_ACK").mission_type) == (3, kind)
