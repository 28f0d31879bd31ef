"""Fences and rally points."""

from __future__ import annotations

import math
import random

import pytest
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_vehicle_missions import Row, download, step, to, upload
from vehicle_client import Client, Make, of, simspec

from vehicle_models._geodesy import LocalFrame, TangentPlane
from vehicle_models.controller.ardupilot import ARDUPILOT
from vehicle_models.controller.guidance._fence_boundary import FenceBoundary, fence_areas
from vehicle_models.controller.policies._safety import Breach
from vehicle_models.controller.px4 import PX4
from vehicle_models.controller.safety._rally import Rally
from vehicle_models.controller.state._flight_state import (
    Behaviour,
    FlightMode,
    FlightState,
    FlightTarget,
    ReferencePoint,
)
from vehicle_models.controller.state._parameter_store import ParameterStore
from vehicle_models.controller.state._plan_store import MissionItem, StoredPlan


def corner(client: Client, east: float, north: float, count: int = 4, command: int = 5001) -> Row:
    return (command, 0, count, 0, 0, 0, *client.vehicle_goal(east, north), 0)


def square(client: Client, middle: tuple[float, float], half: float, command: int = 5001) -> list[Row]:
    east, north = middle
    return [
        corner(client, east + e * half, north + n * half, 4, command)
        for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]


@pytest.fixture
def guided(make: Make) -> Client:
    """An ArduCopter in GUIDED at 10 m."""
    client = make(simspec("ardupilot"), system=255)
    client.guided()
    return client


def outwards(client: Client, seconds: float) -> None:
    """A velocity of 5 m/s to the north."""
    client.fly(seconds, lambda: client.setpoint(0, 0, 0, mask=0b110111000111, vn=5.0))


def test_px4_reposition_outside_is_a_text(make: Make) -> None:
    """Accepted with a text and not flown; a place inside is flown to."""
    client = make(simspec(vehicle={"parameters": {"GF_MAX_HOR_DIST": 40.0}}))
    client.airborne()
    assert client.reposition(0, 60, 498.0) == [0]
    client.fly(8.0)
    assert "Reposition is outside geofence\t" in client.texts()
    assert client.vehicle.truth().position_enu_m[1] < 0.5
    assert client.reposition(0, 30, 498.0) == [0]
    client.fly(12.0)
    assert client.vehicle.truth().position_enu_m[1] == pytest.approx(30.0, abs=0.5)


ACTIONS = {  # GF_ACTION: mode soon after the breach, mode after the Hold, failsafe shown
    0: ("OFFBOARD", "OFFBOARD", ""),
    1: ("OFFBOARD", "OFFBOARD", ""),
    2: ("AUTO_LOITER", "AUTO_LOITER", "fence"),
    3: ("AUTO_LOITER", "AUTO_RTL", "fence"),
    4: ("TERMINATION", "TERMINATION", "fence"),
    5: ("AUTO_LOITER", "AUTO_LAND", "fence"),
}


def flight_texts(client: Client) -> list[str]:
    return [text.strip() for text in client.texts() if "Geofence" in text or "Failsafe" in text]


@pytest.mark.parametrize("action", ACTIONS)
def test_px4_polygon_and_its_action(make: Make, action: int) -> None:
    """Flying out of a polygon under offboard control leads to GF_ACTION; return and landing hold for 5 s first."""
    soon, then, failsafe = ACTIONS[action]
    client = make(simspec(vehicle={"parameters": {"GF_ACTION": action}}))
    client.airborne()
    rows = square(client, (0, 0), 10.0)
    assert upload(client, rows, 1) == 0
    assert [item.frame for item in download(client, 1)] == [5] * 4
    client.offboard(0, 0, -10)
    while client.vehicle.truth().position_enu_m[1] < 11.5:  # two looks at the fence
        client.fly(0.1, lambda: client.setpoint(50, 0, -10))
    assert client.state() == (soon, failsafe)
    hold = ["Failsafe activated: entering Hold for 5 seconds"] if action in (3, 5) else []
    acts = [] if hold or not action else ["Failsafe activated"]
    breach = ["Geofence: approaching or outside geofence"] if action else []
    assert flight_texts(client) == [*breach, *hold, *acts]
    client.fly(5.5, lambda: client.setpoint(50, 0, -10))
    assert client.state() == (then, failsafe)
    assert flight_texts(client) == [*breach, *hold, *(acts or (["Failsafe activated"] if hold else []))]


def test_px4_termination_by_the_fence_is_for_good(make: Make) -> None:
    """GF_ACTION 4: the rotors stop, it falls, status 8; no mode, command or setpoint brings it back."""
    client = make(simspec(vehicle={"parameters": {"GF_ACTION": 4, "GF_MAX_HOR_DIST": 15.0}}))
    client.airborne(30.0)
    client.offboard(0, 0, -30)
    while client.vehicle.condition().mode != "TERMINATION":
        client.fly(0.1, lambda: client.setpoint(30, 0, -30))
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)[-1] == 1
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    client.setpoint(0, 0, -30)
    client.fly(1.5)
    assert client.state() == ("TERMINATION", "fence")
    assert client.vehicle.truth().velocity_enu_mps[2] < -8.0
    assert client.last("HEARTBEAT").system_status == 8
    assert "Geofence: exceeding maximum distance to Home" in flight_texts(client)


def test_px4_ceiling_and_a_way_back_in(make: Make) -> None:
    """It holds at once; the operator may fly on, and the next breach counts after a way back inside."""
    client = make(simspec(vehicle={"parameters": {"GF_ACTION": 2, "GF_MAX_VER_DIST": 15.0}}))
    client.airborne()
    client.offboard(0, 0, -10)
    client.fly(6.0, lambda: client.setpoint(0, 0, -25))
    assert client.state() == ("AUTO_LOITER", "fence")
    breach = "Geofence: exceeding maximum altitude above Home"
    assert flight_texts(client)[-2:] == [breach, "Failsafe activated"]
    assert client.last("HEARTBEAT").system_status == 5
    count = len(flight_texts(client))
    client.offboard(0, 0, -18)
    client.fly(2.0, lambda: client.setpoint(0, 0, -18))
    assert client.state() == ("OFFBOARD", "")
    assert len(flight_texts(client)) == count
    client.fly(5.0, lambda: client.setpoint(0, 0, -10))
    client.fly(5.0, lambda: client.setpoint(0, 0, -18))
    assert client.state() == ("AUTO_LOITER", "fence")
    assert len(flight_texts(client)) == count + 2


def test_px4_the_stronger_failsafe_wins(make: Make) -> None:
    """A battery's landing is not undone by a fence that returns; the fence's return gives way to a landing."""
    parameters = {"GF_ACTION": 3, "COM_LOW_BAT_ACT": 2}
    client = make(simspec(vehicle={"parameters": {**parameters, "COM_FAIL_ACT_T": 0.0}}))
    client.airborne()
    client.put(BAT_LOW_THR=0.9999, BAT_CRIT_THR=0.9999)
    client.fly(1.0)
    assert client.state() == ("AUTO_LAND", "battery")
    client.put(GF_MAX_VER_DIST=5.0)
    client.fly(0.5)
    assert "Geofence: exceeding maximum altitude above Home" in flight_texts(client)
    assert client.vehicle.condition().mode == "AUTO_LAND"

    client = make(simspec(vehicle={"parameters": parameters}))
    client.airborne()
    client.put(GF_MAX_VER_DIST=5.0)
    client.fly(6.0)
    assert client.state() == ("AUTO_RTL", "fence")
    client.put(BAT_LOW_THR=0.9999, BAT_CRIT_THR=0.9999)
    client.fly(6.0)
    assert client.state() == ("AUTO_LAND", "battery")


COPTER_ACTIONS = {0: "GUIDED", 1: "RTL", 2: "LAND", 3: "RTL", 4: "BRAKE", 5: "RTL"}


@pytest.mark.parametrize("action", COPTER_ACTIONS)
def test_ardupilot_fence_actions(guided: Client, action: int) -> None:
    """To its mode at once, with the text of the breach; a report alone changes no mode; no failsafe is shown."""
    guided.put(FENCE_ALT_MAX=5.0, FENCE_ACTION=float(action), FENCE_ENABLE=1.0)
    guided.fly(0.3)
    assert guided.state() == (COPTER_ACTIONS[action], "")
    texts = [text for text in guided.texts() if "breached" in text or "recovery" in text]
    assert texts == ["Max Alt fence breached", *(["Manual recovery started"] if action else [])]


def test_ardupilot_recovers_and_breaches_again(guided: Client) -> None:
    """Ten seconds are left to a new mode; 20 m farther out is another breach; over 100 m outside it lands."""
    guided.put(FENCE_RADIUS=30.0, FENCE_ENABLE=1.0)
    guided.fly(0.1)
    outwards(guided, 9.0)
    assert guided.vehicle.condition().mode == "RTL"
    assert guided.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    assert guided.texts()[-1] == "Manual recovery started"
    outwards(guided, 9.0)
    assert guided.vehicle.condition().mode == "GUIDED"
    outwards(guided, 2.0)
    assert guided.vehicle.condition().mode == "RTL"
    assert guided.texts().count("Circle fence breached") == 2
    guided.fly(25.0)
    assert guided.texts()[-1] == "Fence breach cleared"
    guided.put(FENCE_ENABLE=0.0)
    guided.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    outwards(guided, 30.0)
    guided.put(FENCE_ENABLE=1.0)
    guided.fly(0.3)
    assert guided.vehicle.condition().mode == "LAND"


def test_px4_exclusions_and_missions(make: Make) -> None:
    """A mission with a waypoint inside an exclusion is none, until the fence is gone."""
    client = make()
    client.fly(5.0)
    assert upload(client, [(5004, 0, 10, 0, 0, 0, *client.vehicle_goal(0, 30), 0)], 1) == 0
    assert upload(client, [to(client, 0, 30, 10)]) == 0
    assert "Geofence violation for waypoint 1\t" in client.texts()
    assert client.command(mavlink.MAV_CMD_MISSION_START) == [2]
    client.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 1))
    step(client)
    assert client.command(mavlink.MAV_CMD_MISSION_START) == [0]


def test_ardupilot_circle_as_observed(guided: Client) -> None:
    """It slows down, and is turned back at 40.1 m; GUIDED set outside is granted."""
    guided.put(FENCE_RADIUS=40.0, FENCE_ENABLE=1.0)
    guided.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_FENCE_STATUS, 200_000)
    guided.fly(0.1)
    farthest: list[float] = []
    for _ in range(18):
        outwards(guided, 1.0)
        farthest.append(guided.vehicle.truth().position_enu_m[1])
    assert guided.vehicle.condition().mode == "RTL"
    assert guided.texts()[-2:] == ["Circle fence breached", "Manual recovery started"]
    assert 40.0 < max(farthest) < 41.0
    status = of("FENCE_STATUS", guided.received)
    assert {(statu.breach_status, statu.breach_type) for statu in status} == {(0, 0), (1, 3)}
    assert {statu.breach_mitigation for statu in status} == {1, 2}
    assert status[-1].breach_count == 1
    assert guided.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    assert guided.last("HEARTBEAT").system_status == 4


def test_ardupilot_ceiling_and_enabling(guided: Client) -> None:
    """It climbs to the margin below the ceiling and no higher, and a ceiling far below it leads home."""

    def climb() -> None:
        guided.setpoint(0, 0, 0, mask=0b110111000111, vd=-2.0)

    guided.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_FENCE_STATUS, 200_000)
    guided.put(FENCE_ALT_MAX=15.0, FENCE_ENABLE=1.0)
    guided.fly(8.0, climb)
    assert guided.vehicle.condition().mode == "GUIDED"
    assert guided.vehicle.truth().position_enu_m[2] == pytest.approx(13.1, abs=0.3)
    assert guided.last("FENCE_STATUS").breach_mitigation == 2
    assert guided.command(mavlink.MAV_CMD_DO_FENCE_ENABLE, 7) == [4]
    assert guided.command(mavlink.MAV_CMD_DO_FENCE_ENABLE, 0) == [0]
    guided.fly(6.0, climb)
    assert guided.vehicle.truth().position_enu_m[2] > 16.0
    assert guided.command(mavlink.MAV_CMD_DO_FENCE_ENABLE, 1) == [0]
    guided.fly(0.3)
    assert guided.texts()[-2:] == ["Max Alt fence breached", "Manual recovery started"]
    assert guided.vehicle.condition().mode == "RTL"


def test_ardupilot_polygons(guided: Client) -> None:
    """Two corners are no fence, four are one; a setpoint beyond it is not flown to, without a text."""
    assert upload(guided, [corner(guided, 0, 0, 2), corner(guided, 9, 9, 2)], 1) == 1
    assert guided.texts()[-2:] == ["Invalid vertex count (2)", "Fence validation failed"]
    assert upload(guided, square(guided, (0, 0), 20.0), 1) == 0
    assert guided.texts()[-1] == "Fence Indexed OK"
    assert guided.command(mavlink.MAV_CMD_DO_FENCE_ENABLE, 1) == [0]
    assert guided.reposition(0, 60, 10.0, frame=6) == [4]
    text_count = len(guided.texts())
    message = mavlink.MAVLink_set_position_target_global_int_message
    place = guided.vehicle_goal(0, 80)
    guided.send(message(0, 1, 1, 6, 0b110111111000, *place, 10, 0, 0, 0, 0, 0, 0, 0, 0))
    guided.fly(8.0)
    assert math.hypot(*guided.vehicle.truth().position_enu_m[:2]) < 1.0
    assert len(guided.texts()) == text_count
    outwards(guided, 7.0)
    assert "Polygon fence breached" in guided.texts()


@pytest.mark.parametrize(("kind", "east"), [(0, 24.0), (3, 0.0)])
def test_px4_returns_to_the_nearest_rally_point(make: Make, kind: int, east: float) -> None:
    """RTL_TYPE 0 counts rally points and home; another type goes home."""
    low = {"RTL_RETURN_ALT": 12.0, "RTL_DESCEND_ALT": 8.0}
    client = make(simspec(vehicle={"parameters": {"RTL_TYPE": kind, **low}}))
    client.airborne()
    rally = (5100, 3, 0, 0, 0, 0, *client.vehicle_goal(24, 0), 12)
    assert upload(client, [rally], 2) == 0
    client.reposition(18, 0, 498.0)
    client.fly(7.0)
    assert client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [0]
    client.fly(40.0)
    assert client.vehicle.condition().landed
    assert math.dist(client.vehicle.truth().position_enu_m[:2], (east, 0.0)) < 1.0


def test_ardupilot_rally_points(guided: Client) -> None:
    """Accepted without a text; RTL goes to the nearest, home among them."""
    text_count = len(guided.texts())
    assert upload(guided, [(5100, 3, 0, 0, 0, 0, *guided.vehicle_goal(0, 24), 15)], 2) == 0
    assert len(guided.texts()) == text_count
    outwards(guided, 4.0)
    assert guided.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [0]
    guided.fly(50.0)
    assert guided.vehicle.condition().landed
    assert math.dist(guided.vehicle.truth().position_enu_m[:2], (0.0, 24.0)) < 1.0


# The rest calls the boundary without a flight: hundreds of random places against shapely.
FRAME = LocalFrame(TangentPlane(47.4, 8.5), 12.0, -7.0)
INSIDE_POLYGON, OUTSIDE_POLYGON, INSIDE_CIRCLE, OUTSIDE_CIRCLE = 5001, 5002, 5003, 5004
# Places are stored to about a centimetre.
STORED_M = 0.05

Place = tuple[float, float]


def row(command: int, place: Place, first: float, frame: LocalFrame = FRAME) -> MissionItem:
    return MissionItem(command, 0, (first, 0.0, 0.0, 0.0), *frame.to_geodetic_e7(*place), 0.0)


def random_place(generator: random.Random) -> Place:
    return generator.uniform(-100.0, 100.0), generator.uniform(-100.0, 100.0)


def random_area(generator: random.Random, kind: int) -> tuple[list[MissionItem], shapely.Geometry]:
    """Rows of a circle or of a polygon without a crossing, and its shape in (north, east)."""
    middle = random_place(generator)
    if kind in (INSIDE_CIRCLE, OUTSIDE_CIRCLE):
        radius_m = generator.uniform(0.5, 90.0)
        return [row(kind, middle, radius_m)], shapely.Point(middle).buffer(radius_m, quad_segs=512)
    turns = sorted(generator.uniform(0.0, math.tau) for _ in range(generator.randint(3, 7)))
    arms_m = [generator.uniform(20.0, 90.0) for _ in turns]
    corners = [
        (middle[0] + arm_m * math.cos(turn), middle[1] + arm_m * math.sin(turn))
        for turn, arm_m in zip(turns, arms_m, strict=True)
    ]
    return [row(kind, place, len(corners)) for place in corners], shapely.Polygon(corners)


def incomplete_area(generator: random.Random) -> list[MissionItem]:
    """Rows that make no area, whatever follows them."""
    place, other = random_place(generator), random_place(generator)
    off_earth = MissionItem(INSIDE_POLYGON, 0, (3.0, 0.0, 0.0, 0.0), 910_000_000, 0, 0.0)
    return generator.choice(
        [
            [row(INSIDE_POLYGON, place, 2), row(INSIDE_POLYGON, other, 2)],
            [row(OUTSIDE_POLYGON, place, math.nan)],
            [row(INSIDE_CIRCLE, place, 0.0)],
            [row(OUTSIDE_CIRCLE, place, -40.0)],
            [row(INSIDE_POLYGON, place, 3), off_earth, row(INSIDE_POLYGON, other, 3)],
        ]
    )


@pytest.mark.parametrize("seed", range(12))
def test_areas_are_those_of_the_plan(seed: int) -> None:
    """In the order of the plan, without incomplete ones; inside, and the distance to the edge, as shapely has them."""
    generator = random.Random(seed)
    rows: list[MissionItem] = []
    shapes: list[shapely.Geometry] = []
    kinds = [generator.randint(INSIDE_POLYGON, OUTSIDE_CIRCLE) for _ in range(4)]
    for kind in kinds:
        rows += incomplete_area(generator)
        of_area, shape = random_area(generator, kind)
        rows += of_area
        shapes.append(shape)
    # A last polygon without its last vertices.
    rows += random_area(generator, INSIDE_POLYGON)[0][:2]
    areas = fence_areas(StoredPlan(tuple(rows)), FRAME)
    assert [area.inclusion for area in areas] == [kind in (INSIDE_POLYGON, INSIDE_CIRCLE) for kind in kinds]
    for area, shape in zip(areas, shapes, strict=True):
        for _ in range(40):
            place = random_place(generator)
            edge_m = shape.exterior.distance(shapely.Point(place))
            edge = area.nearest_edge(place)
            assert math.dist(edge, place) == pytest.approx(edge_m, abs=STORED_M)
            assert shape.exterior.distance(shapely.Point(edge)) < STORED_M
            if edge_m > STORED_M:
                assert area.contains(place) == shape.contains(shapely.Point(place))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("any_inclusion", [True, False])
def test_the_boundary_is_that_of_all_its_limits(seed: int, any_inclusion: bool) -> None:
    """Which limit is passed, and by how much. PX4 flies in any inclusion, ArduPilot in the common part of all."""
    generator = random.Random(seed)
    ceiling_m, radius_m = generator.uniform(20.0, 80.0), generator.uniform(60.0, 120.0)
    autopilot = PX4 if any_inclusion else ARDUPILOT
    limits = (
        {"GF_ACTION": 2, "GF_MAX_HOR_DIST": radius_m, "GF_MAX_VER_DIST": ceiling_m}
        if any_inclusion
        else {"FENCE_ENABLE": 1, "FENCE_TYPE": 7, "FENCE_RADIUS": radius_m, "FENCE_ALT_MAX": ceiling_m}
    )
    home = ReferencePoint(0, 0, 0.0, *random_place(generator), -3.0)
    flight = FlightState(0.01, home, FlightMode("HOLD", 0, 0, Behaviour.HOLD), home)
    plan = StoredPlan()
    parameters = ParameterStore(autopilot.parameters.definitions, limits)
    boundary = FenceBoundary(autopilot.safety.fence, flight, FRAME, parameters, plan)
    kinds = [INSIDE_POLYGON, OUTSIDE_CIRCLE, INSIDE_CIRCLE, OUTSIDE_POLYGON][: generator.randint(0, 4)]
    areas = [(kind, *random_area(generator, kind)) for kind in kinds]
    plan.put(tuple(item for _, rows, _ in areas for item in rows))
    inclusions = [shape for kind, _, shape in areas if kind in (INSIDE_POLYGON, INSIDE_CIRCLE)]
    exclusions = [shape for kind, _, shape in areas if kind in (OUTSIDE_POLYGON, OUTSIDE_CIRCLE)]
    for _ in range(60):
        place, height_m = random_place(generator), generator.uniform(0.0, 100.0)
        point = shapely.Point(place)
        # Too close to an edge for the centimetres of a stored place.
        if any(shape.exterior.distance(point) < STORED_M for shape in inclusions + exclusions):
            continue
        from_home_m = math.dist(place, (home.north_m, home.east_m))
        edges_m = [
            shape.exterior.distance(point)
            for shapes, inside in ((inclusions, True), (exclusions, False))
            for shape in shapes
            if shape.contains(point) is not inside
        ]
        within = [shape.contains(point) for shape in inclusions]
        allowed = not inclusions or (any(within) if any_inclusion else all(within))
        if height_m > ceiling_m:
            expected, outside_m = Breach.CEILING, height_m - ceiling_m
        elif from_home_m > radius_m:
            expected, outside_m = Breach.CIRCLE, from_home_m - radius_m
        elif not allowed or any(shape.contains(point) for shape in exclusions):
            expected, outside_m = Breach.POLYGON, min(edges_m)
        else:
            expected, outside_m = Breach.NONE, 0.0
        assert boundary.breach(place, height_m, 0.0) is expected
        assert boundary.allows(*place, home.down_m - height_m) is (expected is Breach.NONE)
        if expected is not Breach.NONE:
            assert boundary.outside_m(expected, place, height_m) == pytest.approx(outside_m, abs=STORED_M)
        distances_m = sorted(math.dist(edge, place) for edge in boundary.nearest_edges(place))
        assert distances_m == pytest.approx(
            sorted([abs(radius_m - from_home_m), *(shape.exterior.distance(point) for _, _, shape in areas)]),
            abs=STORED_M,
        )


@pytest.mark.parametrize("counts_home", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_a_return_goes_to_the_nearest_of_several_points(seed: int, counts_home: bool) -> None:
    """To the nearest rally point that is not too far away, or home where that counts and is nearer."""
    generator = random.Random(seed)
    limit_m = generator.uniform(30.0, 120.0)
    limits = {"RALLY_LIMIT_KM": limit_m / 1000.0, "RALLY_INCL_HOME": float(counts_home)}
    parameters = ParameterStore(ARDUPILOT.parameters.definitions, limits)
    home = ReferencePoint(0, 0, 0.0, *random_place(generator))
    flight = FlightState(0.01, home, FlightMode("HOLD", 0, 0, Behaviour.HOLD), home)
    plan = StoredPlan()
    rally = Rally(ARDUPILOT.safety.fence, FRAME, parameters, plan)
    places = [random_place(generator) for _ in range(3)]
    off_earth = MissionItem(5100, 3, (0.0, 0.0, 0.0, 0.0), 910_000_000, 0, 0.0)
    plan.put((off_earth, *(row(5100, place, 0.0) for place in places)))
    for _ in range(30):
        flight.north_m, flight.east_m = here = random_place(generator)
        expected = min(places, key=lambda place: math.dist(place, here))
        home_place = (home.north_m, home.east_m)
        nearest_m = math.dist(expected, here)
        if nearest_m > limit_m or (counts_home and math.dist(home_place, here) < nearest_m):
            expected = home_place
        point = rally.return_point(flight)
        assert point is not None
        assert (point.north_m, point.east_m) == pytest.approx(expected, abs=STORED_M)


def test_ardupilot_slows_down_before_every_edge(make: Make) -> None:
    """Towards two edges at a right angle, each speed is what 1 m/s2 can still stop, and 0.5 m/s at least; the
    second edge counts on the first one too. Away from them and upwards nothing changes.
    """
    client = make(simspec("ardupilot", vehicle={"parameters": {"FENCE_ENABLE": 1, "FENCE_TYPE": 4}}))
    controller = client.vehicle._controller  # type: ignore[attr-defined]
    frame: LocalFrame = controller._context.frame
    flight: FlightState = controller._context.flight
    to_the_north = ((-900, -900), (-900, 800), (100, 800), (100, -900))
    to_the_east = ((-900, -900), (-900, 70), (900, 70), (900, -900))
    corners = (*to_the_north, *to_the_east)
    controller._plans.fence.put(tuple(row(INSIDE_POLYGON, place, 4.0, frame) for place in corners))
    generator = random.Random(1)
    for number in range(60):
        flight.north_m = 100.0 - generator.uniform(0.1, 60.0)
        flight.east_m = 70.0 - generator.uniform(0.1, 60.0)
        if number % 4 == 0:
            northern_edge = controller._boundary.nearest_edges((flight.north_m, flight.east_m))[0]
            flight.north_m, flight.east_m = northern_edge
        wanted = generator.uniform(-9.0, 9.0), generator.uniform(-9.0, 9.0), generator.uniform(-2.0, 2.0)
        allowed = [
            speed if distance_m < 1e-3 else min(speed, max(math.sqrt(2.0 * distance_m), 0.5))
            for speed, distance_m in zip(wanted, (100.0 - flight.north_m, 70.0 - flight.east_m), strict=False)
        ]
        flown = controller._fence.constrained(flight, FlightTarget(velocity_ned_mps=wanted))
        assert flown.velocity_ned_mps == pytest.approx((*allowed, wanted[2]), abs=0.05)
