# mypy: disable-error-code="func-returns-value, arg-type"
# Two calls in one lambda are a tuple of None; naming a function for each pair would hide the script of the
# flight.
"""Manoeuvres by command and by stick: orbits, headings, pauses, speeds, and loss of the sticks."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import NAN, Client, Make, simspec

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
HERE = 2**31 - 1


def joystick(client: Client, ahead: int = 0, right: int = 0, up: int = 500, turn: int = 0) -> None:
    client.send(mavlink.MAVLink_manual_control_message(1, ahead, right, up, turn, 0))


def channels(client: Client, *us: int) -> None:
    values = [*us, *[65535] * (8 - len(us))]
    client.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *values))


def speed(client: Client) -> float:
    return math.dist(client.vehicle.truth().velocity_enu_mps, (0, 0, 0))


def reposition(client: Client, yaw: float, east: float, north: float, altitude: float) -> None:
    goal = (*client.vehicle_goal(east, north), altitude)
    assert client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, -1, 1, 0, yaw, *goal) == [ACCEPTED]


def test_a_leg_to_the_north_turns_the_nose(px4: Client) -> None:
    """Without a heading it looks where it goes when that is far, and ends within 0.3 m; with one it keeps that."""
    reposition(px4, NAN, 50.0, 0.0, 498.0)
    px4.fly(6.0)
    assert px4.vehicle.truth().yaw_rad == pytest.approx(math.pi / 2, abs=0.05)
    px4.fly(10.0)
    assert math.dist(px4.vehicle.truth().position_enu_m, (50.0, 0.0, 10.0)) < 0.3
    reposition(px4, 0.5, 20.0, 0.0, 498.0)
    px4.fly(5.0)
    assert px4.vehicle.truth().yaw_rad == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("radius", [20.0, -10.0])
def test_orbit(px4: Client, radius: float) -> None:
    """Mode 3.1, on the circle within 0.5 m at its speed and sense, nose inwards, status streamed."""
    px4.ask_for("ORBIT_EXECUTION_STATUS")
    place = px4.vehicle_goal(5.0, 15.0)
    assert px4.command_int(mavlink.MAV_CMD_DO_ORBIT, 3, radius, 4.0, 0, 0, *place, 500.0) == [ACCEPTED]
    px4.fly(15.0)
    for _ in range(20):
        px4.fly(0.5)
        truth = px4.vehicle.truth()
        east, north = truth.position_enu_m[0] - 5.0, truth.position_enu_m[1] - 15.0
        assert math.hypot(east, north) == pytest.approx(abs(radius), abs=0.5)
        assert truth.position_enu_m[2] == pytest.approx(12.0, abs=0.3)
        turning = north * truth.velocity_enu_mps[0] - east * truth.velocity_enu_mps[1]
        assert math.copysign(1.0, turning) == math.copysign(1.0, radius)
        assert math.hypot(*truth.velocity_enu_mps[:2]) == pytest.approx(4.0, abs=0.3)
        assert abs(math.remainder(truth.yaw_rad - math.atan2(-east, -north), math.tau)) < 0.2
    beat, status = px4.last("HEARTBEAT"), px4.last("ORBIT_EXECUTION_STATUS")
    assert (beat.custom_mode, beat.base_mode) == (1 << 24 | 3 << 16, 157)
    assert (status.radius, status.x, status.frame) == (pytest.approx(radius), place[0], 5)
    assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == [ACCEPTED, ACCEPTED]
    px4.fly(6.0)
    assert speed(px4) < 0.1


def test_orbit_of_the_wrong_size(px4: Client) -> None:
    """Accepted, a text, and nothing flown."""
    for radius in (0.5, 2000.0):
        assert px4.command_int(mavlink.MAV_CMD_DO_ORBIT, 3, radius, 4.0, 0, 0, HERE, HERE, NAN) == [ACCEPTED]
    assert px4.vehicle.condition().mode == "AUTO_LOITER"
    assert px4.texts().count("Orbit radius limit exceeded\t") == 2


def test_change_altitude_and_speed(px4: Client) -> None:
    """DO_CHANGE_ALTITUDE moves the height that is held; DO_CHANGE_SPEED the speed of the leg being flown."""
    assert px4.command(mavlink.MAV_CMD_DO_CHANGE_ALTITUDE, 503.0, 0) == [ACCEPTED]
    px4.fly(6.0)
    assert px4.vehicle.truth().position_enu_m == pytest.approx((0.0, 0.0, 15.0), abs=0.3)
    reposition(px4, NAN, 0.0, 200.0, 503.0)
    px4.fly(6.0)
    assert speed(px4) == pytest.approx(5.0, abs=0.2)
    assert px4.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 9.0, -1) == [ACCEPTED]
    px4.fly(8.0)
    assert speed(px4) == pytest.approx(9.0, abs=0.3)


def test_px4_position_mode_by_joystick(make: Make) -> None:
    """Full throttle takes off, sticks move it, their middle holds it, throttle at zero lands and disarms."""
    client = make()
    client.fly(5.0, lambda: joystick(client))
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3) == [ACCEPTED, ACCEPTED]
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    client.fly(5.0, lambda: joystick(client, up=1000))
    assert client.vehicle.truth().position_enu_m[2] > 5.0
    client.fly(4.0, lambda: joystick(client, ahead=500))
    assert client.vehicle.truth().velocity_enu_mps[1] == pytest.approx(10.0 * 0.4 / 0.9, abs=0.4)
    client.fly(5.0, lambda: joystick(client))
    assert speed(client) < 0.1
    client.fly(2.0, lambda: joystick(client, turn=1000))
    assert abs(client.vehicle.truth().rates_body_radps[2]) > 0.8
    client.fly(20.0, lambda: joystick(client, up=0))
    condition = client.vehicle.condition()
    assert (condition.armed, condition.crashed) == (False, False)


@pytest.mark.parametrize(
    ("bits", "follows", "mode"),
    [(1, False, "POSCTL"), (0, False, "AUTO_RTL"), (1, True, "OFFBOARD"), (3, True, "POSCTL")],
)
def test_px4_sticks_take_over(make: Make, bits: int, follows: bool, mode: str) -> None:
    """COM_RC_OVERRIDE: bit 0 the automatic modes, bit 1 offboard; sticks that tremble take nothing over."""
    client = make(simspec(vehicle={"parameters": {"COM_RC_OVERRIDE": bits}}))
    client.airborne()
    if follows:
        client.offboard(0, 0, -10)
    else:
        client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    before = client.vehicle.condition().mode
    client.fly(1.0, lambda: (joystick(client, ahead=400), client.setpoint(0, 0, -10)))
    client.fly(1.0, lambda: (joystick(client, ahead=415), client.setpoint(0, 0, -10)))
    assert client.vehicle.condition().mode == before
    client.fly(0.3, lambda: (joystick(client, ahead=-300), client.setpoint(0, 0, -10)))
    assert client.vehicle.condition().mode == mode
    assert ("Pilot took over using sticks\t" in client.texts()) is (mode == "POSCTL")
    client.fly(3.0, lambda: (joystick(client, ahead=-300), client.setpoint(0, 0, -10)))
    assert (client.vehicle.truth().velocity_enu_mps[1] < -1.0) is (mode == "POSCTL")


def test_px4_sticks_take_over_from_a_failsafe_once_it_acts(make: Make) -> None:
    """Not from the Hold before the return, but from the return; and the failsafe is over with that."""
    client = make(simspec(vehicle={"parameters": {"NAV_DLL_ACT": 2}}))
    client.airborne()
    client.is_station = False
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    client.fly(13.0)
    client.fly(1.0, lambda: joystick(client))
    client.fly(1.0, lambda: joystick(client, right=700))
    assert (client.vehicle.condition().mode, client.vehicle.condition().failsafe) == ("AUTO_LOITER", "link")
    client.fly(4.0, lambda: joystick(client))
    assert client.vehicle.condition().mode == "AUTO_RTL"
    client.fly(0.3, lambda: joystick(client, right=700))
    assert (client.vehicle.condition().mode, client.vehicle.condition().failsafe) == ("POSCTL", "")


@pytest.mark.parametrize(("main", "up"), [(2, 500), (7, 520), (1, 520)])
def test_px4_tilts_by_joystick(px4: Client, main: int, up: int) -> None:
    """ALTCTL keeps the height; STABILIZED and MANUAL hold the tilt: half a stick of 35 degrees."""
    px4.fly(0.2, lambda: joystick(px4))
    assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main) == [ACCEPTED, ACCEPTED]
    px4.fly(1.5, lambda: joystick(px4, right=500, up=up))
    truth = px4.vehicle.truth()
    assert truth.roll_rad == pytest.approx(math.radians(17.5), abs=0.05)
    assert truth.velocity_enu_mps[0] > 2.0
    if main == 2:
        assert truth.position_enu_m[2] == pytest.approx(10.0, abs=0.3)


def test_px4_stick_modes_need_sticks(px4: Client) -> None:
    """Refused without a joystick, had with one."""
    for main, label in ((1, "Manual"), (2, "Altitude"), (3, "Position"), (5, "Acro"), (7, "Stabilized")):
        assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main) == [ACCEPTED, REJECTED]
        assert f"Switching to {label} is currently not available" in "".join(px4.texts())
    px4.fly(0.5, lambda: joystick(px4))
    assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3) == [ACCEPTED, ACCEPTED]
    assert px4.vehicle.condition().mode == "POSCTL"


@pytest.mark.parametrize("mode", [2, 5, 16])
def test_copter_descends_without_a_held_throttle(copter: Client, mode: int) -> None:
    """The radio's throttle lies at zero, so it lands, and disarms after DISARM_DELAY."""
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode) == [ACCEPTED]
    copter.fly(3.0)
    assert copter.vehicle.truth().position_enu_m[2] < 6.5
    copter.fly(6.0)
    assert copter.vehicle.condition().landed
    assert copter.vehicle.condition().armed
    copter.fly(10.0)
    assert not copter.vehicle.condition().armed
    assert not copter.vehicle.condition().crashed


def test_copter_flies_by_overrides(copter: Client) -> None:
    """Mid throttle holds, pitch low is nose down; three seconds of silence give the radio back."""
    channels(copter, 1500, 1500, 1500, 1500)
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 5) == [ACCEPTED]
    copter.fly(3.0, lambda: channels(copter, 1500, 1250, 1500, 1500))
    assert copter.vehicle.truth().velocity_enu_mps[1] > 4.0
    copter.fly(6.0, lambda: channels(copter, 1500, 1500, 1500, 1500))
    assert speed(copter) < 0.1
    assert copter.vehicle.truth().position_enu_m[2] == pytest.approx(10.0, abs=0.5)
    copter.fly(2.0, lambda: joystick(copter, up=1000))
    assert copter.vehicle.truth().velocity_enu_mps[2] > 1.5
    copter.fly(7.0)
    assert copter.vehicle.truth().velocity_enu_mps[2] < -1.0


def test_copter_sticks_of_a_stranger(make: Make) -> None:
    """Overrides count from SYSID_MYGCS alone."""
    client = make(simspec("ardupilot"), streams="onboard", system=7)
    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_RC_CHANNELS, 100_000)
    channels(client, 1900)
    client.fly(1.0)
    assert client.last("RC_CHANNELS").chan1_raw == 1500


def test_copter_brake_and_circle(copter: Client) -> None:
    """CIRCLE goes around a point 10 m ahead at 20 degrees a second while the throttle is held."""
    copter.setpoint(0, 0, 0, 0xDC7, vn=5.0)
    copter.fly(2.5)
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 17) == [ACCEPTED]
    copter.fly(6.0)
    assert speed(copter) < 0.1
    assert copter.vehicle.truth().position_enu_m[2] == pytest.approx(10.0, abs=0.5)
    (east, north, _), yaw = copter.vehicle.truth().position_enu_m, copter.vehicle.truth().yaw_rad
    centre = (east + 10 * math.sin(yaw), north + 10 * math.cos(yaw))
    channels(copter, 1500, 1500, 1500, 1500)
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 7) == [ACCEPTED]
    copter.fly(20.0, lambda: channels(copter, 1500, 1500, 1500, 1500))
    assert math.dist(copter.vehicle.truth().position_enu_m[:2], centre) == pytest.approx(10.0, abs=0.5)
    assert speed(copter) == pytest.approx(10.0 * math.radians(20.0), abs=0.3)


def test_copter_heading_commands(copter: Client) -> None:
    """Absolute, relative and refused; a region of interest keeps the nose on it; NONE lets go."""
    assert copter.command(mavlink.MAV_CMD_CONDITION_YAW, 90, 30, 1, 0) == [ACCEPTED]
    copter.fly(1.0)
    assert copter.vehicle.truth().yaw_rad < math.radians(45.0), "no faster than asked"
    copter.fly(4.0)
    assert copter.vehicle.truth().yaw_rad == pytest.approx(math.pi / 2, abs=0.05)
    assert copter.command(mavlink.MAV_CMD_CONDITION_YAW, 45, 60, -1, 1) == [ACCEPTED]
    copter.fly(3.0)
    assert copter.vehicle.truth().yaw_rad == pytest.approx(math.pi / 4, abs=0.05)
    assert copter.command(mavlink.MAV_CMD_CONDITION_YAW, 400, 30, 1, 0) == [FAILED]
    assert copter.command(mavlink.MAV_CMD_CONDITION_YAW, 10, 30, 5, 0) == [ACCEPTED]
    place = copter.vehicle_goal(-40.0, 0.0)
    roi = mavlink.MAV_CMD_DO_SET_ROI_LOCATION
    assert copter.command_int(roi, 0, 0, 0, 0, 0, *place, 0.0) == [ACCEPTED]
    copter.fly(5.0)
    assert copter.vehicle.truth().yaw_rad == pytest.approx(-math.pi / 2, abs=0.05)
    assert copter.command(mavlink.MAV_CMD_DO_SET_ROI_NONE) == [ACCEPTED]


def test_copter_pauses_and_goes_on(copter: Client) -> None:
    copter.setpoint(60, 0, -10, 0xDF8)
    copter.fly(3.0)
    assert copter.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == [ACCEPTED]
    copter.fly(8.0)
    assert speed(copter) < 0.1
    assert copter.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1) == [ACCEPTED]
    copter.fly(12.0)
    assert copter.vehicle.truth().position_enu_m[1] == pytest.approx(60.0, abs=0.3)


def test_copter_speeds(copter: Client) -> None:
    """DO_CHANGE_SPEED holds for the way to a position; type 2 is the climb."""
    assert copter.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 4.0) == [ACCEPTED]
    copter.setpoint(60, 0, -10, 0xDF8)
    copter.fly(5.0)
    assert speed(copter) == pytest.approx(4.0, abs=0.2)
    assert copter.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 2, 1.0) == [ACCEPTED]
    copter.setpoint(60, 0, -30, 0xDF8)
    copter.fly(3.0)
    assert copter.vehicle.truth().velocity_enu_mps[2] == pytest.approx(1.0, abs=0.1)
    for wrong in (0.0, -1.0):
        assert copter.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, wrong) == [FAILED]


def test_copter_return_keeps_its_heading_and_lands_at_home(copter: Client) -> None:
    copter.setpoint(30, 0, -10, 0xDF8)
    copter.fly(8.0)
    assert copter.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [ACCEPTED]
    copter.fly(8.0)
    assert abs(copter.vehicle.truth().yaw_rad) < 0.1
    copter.fly(45.0)
    assert math.dist(copter.vehicle.truth().position_enu_m, (0, 0, 0)) < 1.0
    assert not copter.vehicle.condition().armed


def lead(client: Client, north: float, east: float, capabilities: int = 1, vn: float = 0.0) -> None:
    """FOLLOW_TARGET, so far from home."""
    place = (0, 0) if capabilities == 2 else client.vehicle_goal(east, north)
    still = (0.0, 0.0, 0.0)
    motion = ((vn, 0.0, 0.0), still, (1, 0, 0, 0), still, still)
    client.send(mavlink.MAVLink_follow_target_message(0, capabilities, *place, 488.0, *motion, 0))


def test_px4_follows_a_leader(px4: Client) -> None:
    """Eight metres behind one that walks at 2 m/s, eight above home, looking at it; when it stops, it stops."""
    assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 8) == [ACCEPTED, ACCEPTED]
    px4.fly(2.0, lambda: lead(px4, 0, 0, capabilities=2, vn=5.0))
    assert speed(px4) < 0.1, "a velocity alone leads nowhere"
    begun = px4.vehicle.time.s
    px4.fly(20.0, lambda: lead(px4, 2.0 * (px4.vehicle.time.s - begun), 0.0, capabilities=3, vn=2.0))
    east, north, up = px4.vehicle.truth().position_enu_m
    assert (east, north, up) == pytest.approx((0.0, 32.0, 8.0), abs=0.7)
    assert px4.vehicle.truth().yaw_rad == pytest.approx(0.0, abs=0.1)
    assert speed(px4) == pytest.approx(2.0, abs=0.2)
    px4.fly(5.0)
    assert speed(px4) < 0.2, "three seconds without news"
    assert px4.vehicle.condition().mode == "AUTO_FOLLOW"


def test_px4_sticks_adjust_how_it_follows(px4: Client) -> None:
    """Up the height, forward the distance, right the angle, clockwise; less than half a stick nothing."""

    def sticks(seconds: float, **moved: int) -> None:
        px4.fly(seconds, lambda: (lead(px4, 20.0, 0.0), joystick(px4, **moved)))

    assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 8) == [ACCEPTED, ACCEPTED]
    sticks(8.0, ahead=400, right=-400, up=600)
    assert px4.vehicle.truth().position_enu_m == pytest.approx((0.0, 12.0, 8.0), abs=0.5)
    sticks(2.0, up=1000)
    sticks(3.0, ahead=1000)
    sticks(3.0)
    assert px4.vehicle.truth().position_enu_m == pytest.approx((0.0, 6.0, 11.0), abs=0.5)
    sticks(2.0, right=1000)
    sticks(4.0)
    east, north, _ = px4.vehicle.truth().position_enu_m
    assert math.hypot(east, north - 20.0) == pytest.approx(14.0, abs=0.5)
    assert east < -5.0
    assert px4.vehicle.condition().mode == "AUTO_FOLLOW"
