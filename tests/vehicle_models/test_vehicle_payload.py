"""Gimbal, camera and ground truth: what a vehicle carries, seen over its link."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
from test_vehicle_missions import bare, to, upload
from vehicle_client import NAN, Client, Make, mavlink, of, simspec

from bench.contracts import CarriesCamera, LinkSpec, VehiclePlan
from bench.simulation._standalone import Periodic, StandalonePlan, fly, standalone_simspec
from vehicle_models import open_x500

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
CONFIGURE = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
PITCHYAW = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW
REQUEST, INTERVAL = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
ROI = mavlink.MAV_CMD_DO_SET_ROI_LOCATION
SHOOT = mavlink.MAV_CMD_IMAGE_START_CAPTURE


def carrying(autopilot: str = "px4", **camera: Any) -> Any:
    return simspec(autopilot, vehicle={"camera": {"tilt_deg": 60.0, **camera}})


def tilt_deg(client: Client) -> float:
    tilt = client.vehicle.truth().camera_tilt_rad
    assert tilt is not None
    return math.degrees(tilt)


def pan_deg(client: Client) -> float:
    pan = client.vehicle.truth().camera_pan_rad
    assert pan is not None
    return math.degrees(pan)


def looks(client: Client) -> tuple[float, float]:
    return tilt_deg(client), pan_deg(client)


def at(tilt: float, pan: float) -> Any:
    return pytest.approx((tilt, pan), abs=1e-5)


def test_a_gimbal_turns_the_camera_at_its_rate_once_control_is_taken(make: Make) -> None:
    """PX4: only a controller turns it, by 90 degrees a second; then it stays at the commanded angle."""
    client = make(carrying(gimbal=True))
    assert client.command(PITCHYAW, -20, 30, NAN, NAN) == [DENIED]
    assert client.command(CONFIGURE, -2, -2, -1, -1) == [ACCEPTED]
    assert client.command(PITCHYAW, -20, 30, NAN, NAN) == [ACCEPTED]
    client.fly(0.2)
    assert tilt_deg(client) == pytest.approx(60.0 - 90.0 * 0.22, abs=2.0)
    client.fly(1.0)
    assert looks(client) == at(20.0, 30.0)


def test_the_manager_and_the_device_say_what_they_are(make: Make) -> None:
    """On request the device, its axes and its controller. Its attitude: test_vehicle_streamed_truth."""
    client = make(carrying(gimbal=True))
    assert client.command(REQUEST, mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION) == [ACCEPTED]
    information = client.last("GIMBAL_MANAGER_INFORMATION")
    assert information.gimbal_device_id == 1
    assert information.cap_flags & 32
    assert information.cap_flags & 131072
    assert client.command(CONFIGURE, -2, -2, -1, -1, 0, 0, 1) == [ACCEPTED]
    assert client.command(REQUEST, mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS) == [ACCEPTED]
    client.fly(0.1)
    status = client.last("GIMBAL_MANAGER_STATUS")
    assert (status.primary_control_sysid, status.primary_control_compid) == (245, 190)


def test_control_is_given_back_and_taken_by_another(make: Make) -> None:
    """-3 gives control back only for the present controller, whose messages are ignored from then on."""
    client = make(carrying(gimbal=True))
    level = mavlink.MAVLink_gimbal_manager_set_pitchyaw_message(1, 1, 0, 0, 0.0, 0.0, NAN, NAN)
    client.command(CONFIGURE, 9, 9, -1, -1)
    assert client.command(CONFIGURE, -3, -3, -1, -1) == [ACCEPTED]
    for tilt in (60.0, 0.0):
        client.send(level)
        client.fly(1.0)
        assert tilt_deg(client) == pytest.approx(tilt)
        client.command(CONFIGURE, -2, -2, -1, -1)


def test_a_region_of_interest_is_looked_at_from_wherever_the_vehicle_is(make: Make) -> None:
    client = make(carrying(gimbal=True), streams="onboard")
    client.airborne(10.0)
    assert client.command_int(ROI, 0, 0, 0, 0, 0, *client.vehicle_goal(30.0, 0.0), 488.0) == [ACCEPTED]
    client.fly(2.5)
    assert off_target_deg(client, 30.0, 0.0, 0.0) < 0.5
    assert client.command(mavlink.MAV_CMD_DO_SET_ROI_NONE) == [ACCEPTED]
    client.fly(2.5)
    assert looks(client) == at(60.0, 0.0)


def test_ardupilot_mount_commands_and_messages(make: Make) -> None:
    """Any client turns it, by commands and the MOUNT_CONTROL of older ones; neutral levels; no such mode fails."""
    mount = mavlink.MAV_CMD_DO_MOUNT_CONTROL
    client = make(carrying("ardupilot", gimbal=True))
    assert client.command(PITCHYAW, -45, 0, NAN, NAN) == [ACCEPTED]
    client.fly(1.0)
    assert tilt_deg(client) == pytest.approx(45.0)
    assert client.command(mavlink.MAV_CMD_DO_MOUNT_CONFIGURE, 2, 1, 1, 1) == [ACCEPTED]
    assert client.command(mount, -30, 0, 40, 0, 0, 0, 2) == [ACCEPTED]
    client.fly(1.5)
    assert looks(client) == at(30.0, 40.0)
    client.send(mavlink.MAVLink_mount_control_message(1, 1, -9000, 0, 0, 0))
    client.fly(1.5)
    assert looks(client) == at(90.0, 0.0)
    assert client.command(mount, 0, 0, 0, 0, 0, 0, 1) == [ACCEPTED]
    client.fly(1.5)
    assert tilt_deg(client) == pytest.approx(0.0, abs=1e-5)
    assert client.command(mavlink.MAV_CMD_DO_MOUNT_CONFIGURE, 9) == [FAILED]
    assert make(carrying("ardupilot")).command(mount, -30, 0, 0, 0, 0, 0, 2) == [FAILED]


@pytest.mark.parametrize(("autopilot", "turned"), [("ardupilot", True), ("px4", False)])
def test_an_old_region_of_interest_is_a_place_to_ardupilot_alone(
    make: Make, autopilot: str, turned: bool
) -> None:
    """DO_SET_ROI without a kind."""
    client = make(carrying(autopilot, gimbal=True))
    client.fly(25.0)
    client.learn_home()
    east = (degrees_e7 * 1e-7 for degrees_e7 in client.vehicle_goal(30.0, 0.0))
    assert client.command(mavlink.MAV_CMD_DO_SET_ROI, 0, 0, 0, 0, *east, 0) == [ACCEPTED]
    client.fly(1.5)
    assert (abs(pan_deg(client) - 90.0) < 15.0) is turned


def test_nonsense_leaves_the_gimbal_where_it_is(make: Make) -> None:
    """NaN, infinities, unknown devices and flags are refused or mean nothing."""
    client = make(carrying(gimbal=True))
    client.command(CONFIGURE, -2, -2, -1, -1)
    assert client.command(PITCHYAW, NAN, NAN, NAN, NAN) == [ACCEPTED]
    assert client.command(PITCHYAW, math.inf, -math.inf, math.inf, NAN) == [ACCEPTED]
    for last_params in ((1, 0, 0), (NAN, 0, 0), (0, 0, 77)):
        assert client.command(PITCHYAW, 0, 0, 0, 0, *last_params) == [DENIED]
    assert client.command(CONFIGURE, NAN) == [DENIED]
    assert client.command(ROI, 0, 0, 0, 0, math.inf, NAN, 0) == [DENIED]
    message = mavlink.MAVLink_gimbal_manager_set_attitude_message
    client.send(message(1, 1, 0, 0, [NAN, math.inf, 0.0, 1.0], math.inf, math.inf, NAN))
    client.send(message(1, 1, 0, 0, [2.0, 9e30, 9e30, 1.0], NAN, NAN, NAN))
    client.fly(0.5)
    assert all(map(math.isfinite, looks(client)))


def test_without_a_gimbal_nothing_of_it_exists(make: Make) -> None:
    client = make()
    assert client.command(PITCHYAW) == []
    assert client.command(REQUEST, mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION) == [DENIED]
    assert client.vehicle.truth().camera_pan_rad is None


def camera_command(client: Client, number: int, *params: float) -> list[int]:
    padded = [*params, *[0.0] * (7 - len(params))]
    client.send(mavlink.MAVLink_command_long_message(1, 100, number, 0, *padded))
    messages = client.fly(0.02)
    return [message.result for message in of("COMMAND_ACK", messages) if message.get_srcComponent() == 100]


def expose(client: Client, frames: range) -> None:
    assert isinstance(client.vehicle, CarriesCamera)
    for frame in frames:
        client.fly(0.2)
        client.vehicle.record_exposure(frame, client.vehicle.time)
    client.fly(0.02)


def images(client: Client) -> list[Any]:
    return of("CAMERA_IMAGE_CAPTURED", client.received)


def test_the_camera_is_a_component_of_its_own(make: Make) -> None:
    """A heartbeat a second from component 100, and information that gives back the SimSpec's numbers."""
    client = make(carrying(mavlink=True, gimbal=True))
    client.fly(3.0)
    beats = [message for message in of("HEARTBEAT", client.received) if message.get_srcComponent() == 100]
    assert len(beats) in (3, 4)
    assert (beats[0].type, beats[0].autopilot) == (30, 8)
    assert camera_command(client, REQUEST, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION) == [ACCEPTED]
    information = client.last("CAMERA_INFORMATION")
    assert (information.resolution_h, information.resolution_v) == (1280, 720)
    assert information.gimbal_device_id == 1
    angle = 2.0 * math.degrees(math.atan(information.sensor_size_h / 2.0 / information.focal_length))
    assert angle == pytest.approx(70.0, abs=1e-4)
    for number in (260, 261, 262):
        assert camera_command(client, REQUEST, number) == [ACCEPTED]
    assert client.last("STORAGE_INFORMATION").status == 3
    assert camera_command(client, REQUEST, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT) == [UNSUPPORTED]


def test_a_picture_is_the_next_frame_of_the_scene(make: Make) -> None:
    """Asked for once, taken once, even when the command is repeated; the message names the scene's frame."""
    client = make(carrying(mavlink=True))
    expose(client, range(3))
    assert images(client) == []
    assert camera_command(client, SHOOT, 0, 0, 1, 1) == [0]
    expose(client, range(3, 6))
    assert camera_command(client, SHOOT, 0, 0, 1, 1) == [0]
    expose(client, range(6, 8))
    (image,) = images(client)
    assert (image.image_index, image.capture_result, image.file_url) == (0, 1, "rebar:frame/3")
    captured = mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED
    assert camera_command(client, REQUEST, captured, 0) == [ACCEPTED]
    assert len(images(client)) == 2
    assert camera_command(client, REQUEST, captured, 5) == [DENIED]


def test_a_series_keeps_its_interval_until_it_is_stopped(make: Make) -> None:
    """Every other frame for half the frame rate, without gaps; a second series is turned away meanwhile."""
    client = make(carrying(mavlink=True))
    assert camera_command(client, SHOOT, 0, 0.4, 0) == [0]
    assert camera_command(client, SHOOT, 0, 0.4, 0) == [1]
    expose(client, range(10))
    assert [image.image_index for image in images(client)] == list(range(5))
    assert camera_command(client, mavlink.MAV_CMD_IMAGE_STOP_CAPTURE) == [0]
    expose(client, range(10, 14))
    assert len(images(client)) == 5
    assert client.last("CAMERA_CAPTURE_STATUS").image_count == 5


def test_pictures_asked_for_at_once_are_taken_one_after_the_other(make: Make) -> None:
    """Each from a frame of its own, with a gapless index; the status is idle behind the last."""
    client = make(carrying(mavlink=True))
    for sequence in (1, 2, 3):
        assert camera_command(client, SHOOT, 0, 0, 1, sequence) == [0]
        assert client.last("CAMERA_CAPTURE_STATUS").image_status == 1
    expose(client, range(2))
    assert client.last("CAMERA_CAPTURE_STATUS").image_status == 1
    expose(client, range(2, 6))
    taken = [(image.image_index, image.file_url) for image in images(client)]
    assert taken == [(index, f"rebar:frame/{index}") for index in range(3)]
    status = client.last("CAMERA_CAPTURE_STATUS")
    assert (status.image_status, status.image_count) == (0, 3)


def test_a_picture_is_taken_beside_a_series(make: Make) -> None:
    """The series goes on; too many pictures at once are turned away for the time being."""
    client = make(carrying(mavlink=True))
    assert camera_command(client, SHOOT, 0, 0.4, 0) == [0]
    assert camera_command(client, SHOOT, 0, 0, 1, 7) == [0]
    assert client.last("CAMERA_CAPTURE_STATUS").image_status == 3
    expose(client, range(5))
    assert client.last("CAMERA_CAPTURE_STATUS").image_status & 2
    results = [camera_command(client, SHOOT, 0, 0, 1, 0)[0] for _ in range(101)]
    assert results == [0] * 100 + [1]


def test_the_camera_refuses_what_it_has_not(make: Make) -> None:
    """Video, zoom, storage, another mode, NaN as an interval: DENIED; unknown commands are UNSUPPORTED."""
    client = make(carrying(mavlink=True))
    assert [camera_command(client, number) for number in (2500, 2501, 526, 531)] == [[2]] * 4
    assert camera_command(client, mavlink.MAV_CMD_SET_CAMERA_MODE, 0, 1) == [2]
    assert camera_command(client, mavlink.MAV_CMD_SET_CAMERA_MODE, 0, 0) == [0]
    assert camera_command(client, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [3]
    assert camera_command(client, SHOOT, 0, NAN, 1) == [2]
    assert camera_command(client, SHOOT, 0, 1, math.inf) == [2]
    assert camera_command(client, REQUEST, NAN) == [UNSUPPORTED]
    assert not client.vehicle.condition().armed


def off_target_deg(client: Client, east: float, north: float, up: float) -> float:
    """The angle between where the camera truly looks and the way to a place."""
    state = client.vehicle.truth()
    yaw = state.yaw_rad + math.radians(pan_deg(client))
    tilt = math.radians(tilt_deg(client))
    gaze = (math.sin(yaw) * math.cos(tilt), math.cos(yaw) * math.cos(tilt), -math.sin(tilt))
    way = np.subtract((east, north, up), state.position_enu_m)
    return math.degrees(math.acos(min(gaze @ way / math.hypot(*way), 1.0)))


def in_mission(make: Make, autopilot: str, rows: Callable[[Client], list[Any]], **camera: Any) -> Client:
    """A vehicle at 20 m that has just begun to fly a mission of these items."""
    client = make(carrying(autopilot, **camera), system=255)
    if autopilot == "px4":
        client.airborne(20.0)
        assert upload(client, rows(client)) == 0
        assert client.command(mavlink.MAV_CMD_MISSION_START)[-1] == 0
    else:
        client.learn_home()
        assert upload(client, [to(client, 0, 0, 0), *rows(client)]) == 0
        client.guided(20.0, risen_s=15.0)
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3)
        assert client.command(mavlink.MAV_CMD_MISSION_START)[-1] == 0
    client.fly(0.5)
    return client


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_mission_keeps_the_camera_on_a_region_of_interest(make: Make, autopilot: str) -> None:
    """Flying by, the camera looks within 2 degrees of the place and the nose ahead; NONE lets go."""

    def rows(client: Client) -> list[Any]:
        look = (195, 3, 0, 0, 0, 0, *client.vehicle_goal(20.0, 25.0), 0)
        return [
            bare(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 5, -1),
            look,
            to(client, 0, 60, 20, hold=1.0),
            bare(mavlink.MAV_CMD_DO_SET_ROI_NONE),
            to(client, 0, 65, 20, hold=5.0),
        ]

    client = in_mission(make, autopilot, rows, gimbal=True)
    client.fly(3.0)
    off = []
    while client.vehicle.truth().position_enu_m[1] < 48.0:
        client.fly(0.2)
        off.append(off_target_deg(client, 20.0, 25.0, 0.0))
    assert len(off) > 30
    assert max(off) < 2.0
    assert abs(math.degrees(client.vehicle.truth().yaw_rad)) < 10.0
    client.fly(8.0)
    assert looks(client) == at(60.0, 0.0)


def test_px4_a_region_of_interest_turns_the_nose_where_there_is_no_gimbal(make: Make) -> None:
    """By command: the nose points at it from wherever the vehicle is, until it is let go."""
    client = make()
    client.airborne(10.0)
    assert client.command_int(ROI, 0, 0, 0, 0, 0, *client.vehicle_goal(30.0, 0.0), 488.0) == [ACCEPTED]
    client.fly(4.0)
    assert math.degrees(client.vehicle.truth().yaw_rad) == pytest.approx(90.0, abs=2.0)
    assert client.command(mavlink.MAV_CMD_DO_SET_ROI_NONE) == [0]


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_mission_turns_the_gimbal(make: Make, autopilot: str) -> None:
    """By DO_MOUNT_CONTROL and DO_GIMBAL_MANAGER_PITCHYAW, regardless of the controller."""

    def rows(client: Client) -> list[Any]:
        mount = (mavlink.MAV_CMD_DO_MOUNT_CONTROL, 2, -30.0, 0.0, 40.0, 0.0, 0, 0, 2.0)
        turn = bare(PITCHYAW, -10.0, -20.0, NAN if autopilot == "px4" else 0.0)
        return [mount, to(client, 0, 10, 20, hold=3.0), turn, to(client, 0, 20, 20, hold=9.0)]

    client = in_mission(make, autopilot, rows, gimbal=True)
    client.fly(2.0)
    assert looks(client) == at(30.0, 40.0)
    client.fly(10.0)
    assert looks(client) == at(10.0, -20.0)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_mission_takes_pictures(make: Make, autopilot: str) -> None:
    """One by DO_DIGICAM_CONTROL, one every 10 m, then a series by time until it is stopped."""

    def rows(client: Client) -> list[Any]:
        return [
            (mavlink.MAV_CMD_DO_DIGICAM_CONTROL, 2, 0, 0, 0, 0, 1, 0, 0.0),
            to(client, 0, 5, 20, hold=2.0),
            bare(mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST, 10.0),
            to(client, 0, 55, 20, hold=6.0),
            bare(mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST, 0.0),
            bare(SHOOT, 0, 1.0),
            to(client, 0, 56, 20, hold=4.0),
            bare(mavlink.MAV_CMD_IMAGE_STOP_CAPTURE),
            to(client, 0, 57, 20, hold=9.0),
        ]

    client = in_mission(make, autopilot, rows, mavlink=True)
    expose(client, range(4))
    assert len(images(client)) == 1
    expose(client, range(4, 250))
    taken = images(client)
    north_m = [(image.lat - client.last("HOME_POSITION").latitude) * 1e-7 * 111_200.0 for image in taken]
    by_distance = [north for north in north_m[1:] if north < 54.0]
    assert len(by_distance) in (4, 5)
    assert np.diff(by_distance) == pytest.approx(10.0, abs=2.0)
    assert 4 <= len([north for north in north_m if north > 54.0]) <= 10
    count = len(taken)
    expose(client, range(250, 270))
    assert len(images(client)) == count


def test_truth_is_streamed_only_where_it_is_allowed(make: Make) -> None:
    """Refused by default; with vehicle.ground_truth the true position, not the estimate."""
    number = mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION
    plain = make()
    assert plain.command(INTERVAL, number, 100_000) == [FAILED]
    assert plain.command(REQUEST, number) == [DENIED]
    vehicle = {"ground_truth": True, "gps": {"wander_m": 5.0, "noise_m": 1.0}}
    client = make(simspec(vehicle=vehicle))
    assert client.command(INTERVAL, number, 100_000) == [ACCEPTED]
    client.fly(1.0)
    truth = client.last("HIL_STATE_QUATERNION")
    assert (truth.lat, truth.lon) == (473977000, 85456000)


def test_by_itself_the_vehicle_tells_truth_and_its_camera_takes_pictures() -> None:
    """`rebar fly --camera`: a SITL's ground truth, and frames at the camera's rate without any scene."""
    with ExitStack() as stack:
        client = Client()
        stack.callback(client.socket.close)
        spec = standalone_simspec(StandalonePlan(home=(47.0, 8.0, 400.0, 0.0), camera=True))
        link = LinkSpec("onboard", "udp_out", port=client.port, streams="none")
        client.vehicle = stack.enter_context(open_x500(VehiclePlan(spec, (link,))))
        client.fly(1.1)
        assert client.command(REQUEST, mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION) == [ACCEPTED]
        assert camera_command(client, SHOOT, 0, 0, 1, 1) == [ACCEPTED]
        exposed: list[float] = []
        shutter = Periodic(lambda number, time: exposed.append(time.s), 5.0)
        fly(client.vehicle, 1e6, 2.0, threading.Event(), [shutter])
        assert len(exposed) == 10
