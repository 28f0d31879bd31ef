"""The operator's part while the vehicle is handed over, against a vehicle that only stands there."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pymap3d
import pytest
from pymavlink.dialects.v20 import common as mavlink
from test_session import session_simspec

from bench.contracts import (
    OPERATOR_GIVES_BACK,
    OPERATOR_TAKES,
    EventDocument,
    OrderDocument,
    SimTime,
    VehicleCondition,
    VehiclePlan,
    VehicleState,
)
from bench.simspec import Mission, NoFlyArea, Order, Point, Polygon, Rules, SimSpec
from bench.simulation._operator_pilot import MOVE_M, OperatorPilot, open_operator_pilot, operator_links
from bench.testing import StillVehicle

HAND_OVER = Order(id="yours", at_s=20.0, kind="hand_over", within_s=8.0)
TAKE_BACK = Order(id="mine", at_s=50.0, kind="take_back")


def situation(rules: Rules | None = None, orders: tuple[Order, ...] = (HAND_OVER, TAKE_BACK)) -> SimSpec:
    return session_simspec(mission=Mission(time_limit_s=100.0), orders=orders, rules=rules or Rules())


def document(order: Order) -> OrderDocument:
    return OrderDocument(id=order.id, kind=order.kind, issued_s=order.at_s, within_s=order.within_s)


class HoveringVehicle(StillVehicle):
    """Hovers 100 m east of the origin, 60 m up."""

    landed = False
    failsafe = ""

    def condition(self) -> VehicleCondition:
        return replace(super().condition(), armed=True, landed=self.landed, failsafe=self.failsafe)

    def estimate(self) -> VehicleState:
        return replace(super().estimate(), position_enu_m=(100.0, 0.0, 60.0))


@pytest.fixture
def station() -> Iterator[socket.socket]:
    """The vehicle's end of the operator's link."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        yield receiver


def pilot_of(spec: SimSpec, station: socket.socket) -> OperatorPilot:
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.close()
    return OperatorPilot(spec, station, f"udpout:127.0.0.1:{station.getsockname()[1]}")


def reposition(station: socket.socket, spec: SimSpec | None = None) -> tuple[Any, float, float]:
    """The command that came, and its place in metres east and north of the origin."""
    command: Any = mavlink.MAVLink(None).decode(bytearray(station.recv(512)))
    origin = (spec or situation()).world.origin
    place = (command.x * 1e-7, command.y * 1e-7, origin.altitude_m)
    east_m, north_m, _ = pymap3d.geodetic2enu(
        *place, origin.latitude_deg, origin.longitude_deg, origin.altitude_m
    )
    return command, float(east_m), float(north_m)


def handed_over(spec: SimSpec, station: socket.socket) -> tuple[OperatorPilot, HoveringVehicle]:
    """The operator's pilot, who was told at the start that the vehicle is handed over in eight seconds."""
    pilot = pilot_of(spec, station)
    pilot.receive(document(HAND_OVER), SimTime(0))
    return pilot, HoveringVehicle(VehiclePlan(spec, ()))


def test_the_operator_flies_towards_home_once_the_handover_is_due(station: socket.socket) -> None:
    """Nothing before `within_s` is over, one command then, and word of the end when it is taken back."""
    pilot, vehicle = pilot_of(situation(), station), HoveringVehicle(VehiclePlan(situation(), ()))
    assert pilot.receive(document(HAND_OVER), SimTime(20_000_000_000)) is None
    assert pilot.act(SimTime(27_900_000_000), vehicle) is None
    assert pilot.sent == 0
    action = pilot.act(SimTime(28_000_000_000), vehicle)
    assert action is not None
    assert (action.name, action.text[:9]) == (OPERATOR_TAKES, "yours: to")
    command, east_m, north_m = reposition(station)
    assert (command.command, command.frame) == (mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_FRAME_GLOBAL)
    assert command.z == pytest.approx(situation().world.origin.altitude_m + 60.0)
    home = situation().vehicle.home
    assert math.dist((east_m, north_m), (100.0, 0.0)) == pytest.approx(MOVE_M, rel=0.01)
    away_m = math.dist((100.0, 0.0), (home.east_m, home.north_m))
    assert math.dist((east_m, north_m), (home.east_m, home.north_m)) == pytest.approx(
        away_m - MOVE_M, rel=0.01
    )
    assert pilot.act(SimTime(29_000_000_000), vehicle) is None
    assert pilot.receive(document(TAKE_BACK), SimTime(50_000_000_000)) == EventDocument(
        name=OPERATOR_GIVES_BACK, text="mine"
    )
    assert pilot.sent == 1


def rectangle(west: float, east: float, north: float) -> Polygon:
    """As far south as north."""
    corners = ((west, -north), (east, -north), (east, north), (west, north))
    return Polygon(corners=tuple(Point(east_m=e, north_m=n) for e, n in corners))


def test_the_operator_keeps_the_rules(station: socket.socket) -> None:
    """A no-fly area on the way home turns the operator aside; a fence on all sides keeps it in place."""
    clinic = (NoFlyArea(id="clinic", area=rectangle(75, 85, 3)),)
    pilot, vehicle = handed_over(situation(Rules(no_fly=clinic)), station)
    pilot.act(SimTime(10_000_000_000), vehicle)
    _, east_m, north_m = reposition(station)
    assert math.dist((east_m, north_m), (100.0, 0.0)) == pytest.approx(MOVE_M, rel=0.01)
    assert abs(north_m) > 10.0
    fenced = situation(Rules(geofence=rectangle(-20, 110, 10), no_fly=clinic))
    pilot, vehicle = handed_over(fenced, station)
    action = pilot.act(SimTime(10_000_000_000), vehicle)
    assert action is not None
    assert "0 m away" in action.text
    _, east_m, north_m = reposition(station)
    assert math.dist((east_m, north_m), (100.0, 0.0)) < 0.5


@pytest.mark.parametrize(
    ("landed", "failsafe", "words"), [(True, "", "on the ground"), (False, "battery", "battery")]
)
def test_the_operator_leaves_alone_what_it_cannot_fly(
    station: socket.socket, landed: bool, failsafe: str, words: str
) -> None:
    """A vehicle on the ground, or under a failsafe, is not commanded, and the log says why."""
    pilot, vehicle = handed_over(situation(), station)
    vehicle.landed, vehicle.failsafe = landed, failsafe
    action = pilot.act(SimTime(10_000_000_000), vehicle)
    assert action is not None
    assert words in action.text
    assert pilot.sent == 0
    assert pilot.receive(document(TAKE_BACK), SimTime(50_000_000_000)) is None


def test_a_session_without_a_handover_has_no_operator() -> None:
    """No link, no pilot: such a session is what it was."""
    spec = situation(orders=())
    assert operator_links(spec) == ()
    with open_operator_pilot(spec, HoveringVehicle(VehiclePlan(spec, ()))) as pilot:
        assert pilot is None


@pytest.mark.parametrize("longitude_deg", [180.0, -180.0, 179.9999])
def test_the_operator_flies_across_the_date_line(station: socket.socket, longitude_deg: float) -> None:
    """Longitudes stay within 180 degrees: an autopilot refuses others."""
    usual = situation()
    origin = usual.world.origin.model_copy(update={"longitude_deg": longitude_deg})
    spec = usual.model_copy(update={"world": usual.world.model_copy(update={"origin": origin})})
    pilot, vehicle = handed_over(spec, station)
    assert pilot.act(SimTime(8_000_000_000), vehicle) is not None
    command, east_m, north_m = reposition(station, spec)
    assert abs(command.y) <= 1_800_000_000
    assert math.dist((east_m, north_m), (100.0, 0.0)) == pytest.approx(MOVE_M, rel=0.01)
