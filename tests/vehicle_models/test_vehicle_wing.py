"""The fixed wing: the same flight controller around an aircraft that cannot stand still."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from test_vehicle_missions import start_px4, to
from vehicle_client import NAN, Client, mavlink, of, simspec

from bench.contracts import LinkSpec, VehiclePlan, load_plugin
from bench.errors import SetupError
from bench.simspec import SimSpec
from vehicle_models import open_wing

TRIM_MPS = 15.0
WIND = {"wind": {"speed_mps": 5.0, "from_deg": 240.0, "turbulence_mps": 3.0}}
MakeWing = Callable[..., Client]


def wing_spec(autopilot: str = "px4", parameters: dict[str, float] | None = None, **changes: Any) -> SimSpec:
    return simspec(autopilot, vehicle={"model": "wing", "parameters": parameters or {}}, **changes)


@pytest.fixture
def make_wing() -> Iterator[MakeWing]:
    """Build a client and the fixed wing that talks to it."""
    with ExitStack() as stack:

        def build(spec: SimSpec | None = None, streams: str = "none") -> Client:
            client = Client()
            stack.callback(client.socket.close)
            link = LinkSpec("onboard", "udp_out", port=client.port, streams=streams)
            client.vehicle = stack.enter_context(open_wing(VehiclePlan(spec or wing_spec(), (link,))))
            client.fly(1.1)
            return client

        yield build


def take_off(client: Client, height_m: float = 50.0) -> None:
    """Arm, off the catapult, up to a height, and around there."""
    client.fly(4.0)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 488.0 + height_m) == [0]
    for _ in range(60):
        client.fly(1.0)
        if client.vehicle.condition().mode == "AUTO_LOITER":
            return
    raise AssertionError("it did not get up")


def circle(client: Client, east_m: float, north_m: float, radius_m: float, height_m: float = 60.0) -> None:
    """DO_REPOSITION with a radius."""
    goal = (*client.vehicle_goal(east_m, north_m), 488.0 + height_m)
    assert client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, -1, 1, radius_m, NAN, *goal) == [0]


def away_m(client: Client, east_m: float, north_m: float) -> float:
    east, north, _ = client.vehicle.truth().position_enu_m
    return math.hypot(east - east_m, north - north_m)


def watch(client: Client, seconds: float, look: Callable[[], float]) -> list[float]:
    values: list[float] = []
    client.fly(seconds, lambda: values.append(look()))
    return values


def airspeed_mps(client: Client) -> float:
    assert client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_VFR_HUD) == [0]
    return float(client.last("VFR_HUD").airspeed)


def test_it_is_a_plugin_and_says_that_it_is_a_fixed_wing(make_wing: MakeWing) -> None:
    """The entry point opens it; the heartbeat has MAV_TYPE_FIXED_WING."""
    with load_plugin("rebar.vehicles", "wing")(VehiclePlan(wing_spec(), ())) as vehicle:
        assert vehicle.condition().landed
    client = make_wing()
    assert client.last("HEARTBEAT").type == 1
    assert client.last("HEARTBEAT").autopilot == 12


def test_an_autopilot_that_it_does_not_carry_is_a_fault_of_the_setup() -> None:
    """There is no ArduPlane: ardupilot is a SetupError instead of a plane that flies as a copter."""
    with pytest.raises(SetupError, match="ardupilot"), open_wing(VehiclePlan(wing_spec("ardupilot"), ())):
        pass


@pytest.mark.parametrize("from_deg", [90.0, 180.0])
def test_takes_off_from_the_catapult_and_climbs_to_height(make_wing: MakeWing, from_deg: float) -> None:
    """Across and with a wind of 5 m/s; it does not touch again, and holds its height within 2 m."""
    client = make_wing(wing_spec(environment={"wind": {"speed_mps": 5.0, "from_deg": from_deg}}))
    assert client.vehicle.truth().position_enu_m[2] < 0.02
    take_off(client)
    client.fly(12.0)
    assert client.vehicle.truth().position_enu_m[2] == pytest.approx(50.0, abs=2.0)
    condition = client.vehicle.condition()
    assert condition.mode == "AUTO_LOITER"
    assert not condition.landed
    assert not condition.crashed


@pytest.mark.parametrize("radius_m", [80.0, -60.0])
def test_circles_within_a_tenth_of_its_radius_in_wind(make_wing: MakeWing, radius_m: float) -> None:
    """In gusts height within 2 m, airspeed within 2 m/s; the sign of the radius is the direction."""
    client = make_wing(wing_spec(environment=WIND))
    take_off(client)
    circle(client, 150.0, 100.0, radius_m)
    client.fly(40.0)
    truth = client.vehicle.truth()
    east, north = truth.position_enu_m[0] - 150.0, truth.position_enu_m[1] - 100.0
    clockwise = north * truth.velocity_enu_mps[0] - east * truth.velocity_enu_mps[1]
    assert math.copysign(1.0, clockwise) == math.copysign(1.0, radius_m)
    for _ in range(50):
        client.fly(0.5)
        assert away_m(client, 150.0, 100.0) == pytest.approx(abs(radius_m), rel=0.1)
        assert client.vehicle.truth().position_enu_m[2] == pytest.approx(60.0, abs=2.0)
        assert airspeed_mps(client) == pytest.approx(TRIM_MPS, abs=2.0)


def test_a_change_of_speed_is_flown(make_wing: MakeWing) -> None:
    """DO_CHANGE_SPEED sets the airspeed of the circle, and it is held within 1 m/s."""
    client = make_wing()
    take_off(client)
    assert client.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, 18.0, -1) == [0]
    client.fly(15.0)
    for _ in range(30):
        client.fly(0.5)
        assert airspeed_mps(client) == pytest.approx(18.0, abs=1.0)


def test_velocity_setpoints_are_a_course_and_a_climb(make_wing: MakeWing) -> None:
    """A course within 3 degrees at its sink rate; silence ends in a return."""
    client = make_wing()
    take_off(client)
    mask = 0b0000_1101_1100_0111

    def give() -> None:
        client.setpoint(0, 0, 0, mask=mask, vn=10.6, ve=10.6, vd=-1.0)

    client.fly(0.3, give)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6) == [0, 0]
    client.fly(15.0, give)
    begun = client.vehicle.truth()
    client.fly(5.0, give)
    now = client.vehicle.truth()
    east, north, up = (now.position_enu_m[axis] - begun.position_enu_m[axis] for axis in range(3))
    assert math.degrees(math.atan2(east, north)) == pytest.approx(45.0, abs=3.0)
    assert up == pytest.approx(5.0, abs=1.0)
    client.fly(2.0)
    assert client.vehicle.condition().mode == "AUTO_RTL"


def test_an_orbit_is_a_circle_around_its_centre(make_wing: MakeWing) -> None:
    """DO_ORBIT holds its radius within a tenth, as a loiter does."""
    client = make_wing()
    take_off(client)
    place = client.vehicle_goal(100.0, 50.0)
    assert client.command_int(mavlink.MAV_CMD_DO_ORBIT, 5, -70.0, 15.0, 0, NAN, *place, NAN) == [0]
    client.fly(45.0)
    assert watch(client, 25.0, lambda: away_m(client, 100.0, 50.0)) == pytest.approx([70.0] * 250, abs=7.0)


def test_attitude_setpoints_are_flown(make_wing: MakeWing) -> None:
    """Offboard with roll 20 and pitch 5 degrees: held within 2 degrees."""
    client = make_wing()
    take_off(client)
    roll, pitch = math.radians(20.0) / 2, math.radians(5.0) / 2
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)

    def give() -> None:
        q = (cr * cp, sr * cp, cr * sp, -sr * sp)
        client.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, q, 0, 0, 0, 0.4))

    client.fly(0.3, give)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6) == [0, 0]
    client.fly(3.0, give)
    truth = client.vehicle.truth()
    assert math.degrees(truth.roll_rad) == pytest.approx(20.0, abs=2.0)
    assert math.degrees(truth.pitch_rad) == pytest.approx(5.0, abs=2.0)


def test_returns_and_lands_near_home_against_the_wind(make_wing: MakeWing) -> None:
    """It glides in against 5 m/s of gusty wind, flares, stops within 50 m of home, disarms."""
    client = make_wing(wing_spec(parameters={"RTL_LAND_DELAY": 0.0}, environment=WIND))
    take_off(client)
    circle(client, 250.0, 150.0, 80.0)
    client.fly(30.0)
    assert client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [0]
    sinking = 0.0
    for _ in range(300):
        before = client.vehicle.truth()
        client.fly(1.0)
        if client.vehicle.truth().position_enu_m[2] < 0.05 and not sinking:
            sinking = -before.velocity_enu_mps[2]
        if not client.vehicle.condition().armed:
            break
    condition = client.vehicle.condition()
    assert condition.landed
    assert not condition.armed
    assert not condition.crashed
    assert 0.0 < sinking < 1.2
    assert away_m(client, 0.0, 0.0) < 50.0
    yaw_deg = math.degrees(client.vehicle.truth().yaw_rad) % 360.0
    assert yaw_deg == pytest.approx(240.0, abs=25.0)


def test_lands_and_disarms_without_satellites(make_wing: MakeWing) -> None:
    """Also where its estimate moves away at several metres a second."""
    client = make_wing()
    take_off(client, 25.0)
    navigation = client.vehicle._navigation  # type: ignore[attr-defined]
    navigation.set_off(True)
    navigation._bias_en_mps2 = (0.1, 0.05)
    for _ in range(120):
        client.fly(1.0)
        if not client.vehicle.condition().armed:
            break
    condition = client.vehicle.condition()
    assert (condition.armed, condition.landed, condition.crashed) == (False, True, False)


def test_returns_and_circles_where_no_landing_is_wanted(make_wing: MakeWing) -> None:
    """By default (RTL_LAND_DELAY -1) it circles over home at RTL_DESCEND_ALT and RTL_LOITER_RAD."""
    client = make_wing(wing_spec(parameters={"RTL_LOITER_RAD": 60.0, "RTL_DESCEND_ALT": 45.0}))
    take_off(client)
    assert client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [0]
    client.fly(60.0)
    assert watch(client, 20.0, lambda: away_m(client, 0.0, 0.0)) == pytest.approx([60.0] * 200, abs=6.0)
    assert client.vehicle.truth().position_enu_m[2] == pytest.approx(45.0, abs=1.0)
    assert client.vehicle.condition().mode == "AUTO_RTL"


def test_a_mission_from_takeoff_to_landing(make_wing: MakeWing) -> None:
    """In gusts: each waypoint is passed within 25 m, 25 s of loitering, a landing at home."""
    client = make_wing(wing_spec(parameters={"NAV_LOITER_RAD": 60.0}, environment=WIND))
    client.fly(5.0)
    places = ((150.0, 0.0), (120.0, 180.0), (-80.0, 120.0))
    waypoints = [to(client, *place, 50.0) for place in places]
    turn, landing = to(client, 0.0, 100.0, 50.0, 19, hold=25.0), to(client, 0.0, 0.0, 0.0, 21)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    start_px4(client, to(client, 0.0, 0.0, 40.0, 22), *waypoints, turn, landing)
    nearest, turned = dict.fromkeys(places, math.inf), 0
    for _ in range(350):
        for place in places * 2:
            client.fly(1.0 / 6)
            nearest[place] = min(nearest[place], away_m(client, *place))
        turned += abs(away_m(client, 0.0, 100.0) - 60.0) < 6.0
        if not client.vehicle.condition().armed:
            break
    condition = client.vehicle.condition()
    assert not condition.armed
    assert not condition.crashed
    assert max(nearest.values()) < 26.0
    assert turned > 15  # seconds on the circle
    assert away_m(client, 0.0, 0.0) < 50.0
    reached = {message.seq for message in of("MISSION_ITEM_REACHED", client.received)}
    assert {0, 1, 2, 3, 4} <= reached


def test_a_leg_is_flown_along_its_line_in_a_side_wind(make_wing: MakeWing) -> None:
    """Once settled, never 10 m beside the line between the waypoints."""
    wind = {"speed_mps": 5.0, "from_deg": 270.0, "turbulence_mps": 2.0}
    client = make_wing(wing_spec(environment={"wind": wind}))
    take_off(client)
    start_px4(client, *[to(client, 150.0, north, 50.0) for north in (0.0, 400.0, 800.0)])
    beside, north = [], -math.inf
    while client.vehicle.time.s < 200.0 and north < 370.0:
        client.fly(0.5)
        east, north, _ = client.vehicle.truth().position_enu_m
        reached = {message.seq for message in of("MISSION_ITEM_REACHED", client.received)}
        if 0 in reached and north > 150.0:
            beside.append(abs(east - 150.0))
    assert north >= 370.0
    assert max(beside) < 10.0
    assert beside[-1] < 3.0


def test_two_flights_are_the_same_to_the_last_bit(make_wing: MakeWing) -> None:
    """Same SimSpec and same words: the same trajectory and the same messages."""

    def flown() -> tuple[Any, list[bytes]]:
        client = make_wing(wing_spec(environment=WIND), streams="gcs")
        take_off(client, 20.0)
        circle(client, 100.0, 100.0, 70.0)
        client.fly(10.0)
        return client.vehicle.truth(), [message.get_msgbuf() for message in client.received]

    assert flown() == flown()
