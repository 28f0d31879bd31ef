"""The operator's part while the vehicle is handed over: a ground station on a MAVLink link of its own.

It takes the vehicle when an order to hand over falls due and flies it a short way, so that the agent finds it
elsewhere when it takes it back.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from bench.contracts import (
    OPERATOR_GIVES_BACK,
    OPERATOR_LINK,
    OPERATOR_TAKES,
    EventDocument,
    LinkSpec,
    OrderDocument,
    SimTime,
    Vehicle,
)
from bench.geodesy import metres_of_degree, wrapped
from bench.simspec import Point, SimSpec

# pymavlink takes 0.2 s to import; only sessions with an order to hand over pay it.
if TYPE_CHECKING:
    from pymavlink.dialects.v20 import common as mavlink

MOVE_M, MOVE_MPS = 30.0, 5.0
"""How far and how fast the operator flies: the camera sees other ground, and no sub-area is left behind.

Chosen, not measured.
"""

# The MAVLink convention for ground stations (MAV_COMP_ID_MISSIONPLANNER of system 255).
_SYSTEM, _COMPONENT = 255, 190
# Points on the operator's way that are checked against the rules.
_STEPS = 10
# Directions that are tried, from the way home on: home is inside the geofence.
_TURNS_DEG = (0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0)


class OperatorPilot:
    """Flies the vehicle from the moment at which an order to hand over falls due to the order to take back."""

    def __init__(self, simspec: SimSpec, sender: socket.socket, endpoint: str) -> None:
        from pymavlink.dialects.v20 import common

        self.sent = 0
        self._dialect = common
        self._mav = common.MAVLink(None, srcSystem=_SYSTEM, srcComponent=_COMPONENT)
        self._simspec = simspec
        self._socket = sender
        host, port = endpoint.removeprefix("udpout:").rsplit(":", 1)
        self._address = host, int(port)
        self._due: tuple[float, OrderDocument] | None = None
        self._flying = ""

    def receive(self, order: OrderDocument, now: SimTime) -> EventDocument | None:
        """Note an order as it is delivered; what the operator does because of it, or None."""
        if order.kind == "hand_over":
            self._due = now.s + order.within_s, order
        elif order.kind == "take_back":
            self._due = None
            if self._flying:
                self._flying = ""
                return EventDocument(name=OPERATOR_GIVES_BACK, text=order.id)
        return None

    def act(self, now: SimTime, vehicle: Vehicle) -> EventDocument | None:
        """Take the vehicle when that is due; what the operator did, or None."""
        if self._due is None or now.s < self._due[0]:
            return None
        order, self._due = self._due[1], None
        condition = vehicle.condition()
        # An operator does not take off with somebody else's mission, nor argue with a failsafe.
        if condition.landed or condition.crashed:
            return _left_alone(order, "it is on the ground")
        if condition.failsafe:
            return _left_alone(order, f"a failsafe flies it ({condition.failsafe})")
        self._flying = order.id
        east_m, north_m, up_m = vehicle.estimate().position_enu_m
        goal = self._goal(east_m, north_m, now.s)
        self._reposition(goal, up_m)
        moved_m = math.dist((east_m, north_m), goal)
        text = f"{order.id}: to {goal[0]:.1f} m east, {goal[1]:.1f} m north, {moved_m:.0f} m away"
        return EventDocument(name=OPERATOR_TAKES, text=text)

    def _goal(self, east_m: float, north_m: float, now_s: float) -> tuple[float, float]:
        """`MOVE_M` away towards home, or turned from there as little as the rules ask; else where it is."""
        home = self._simspec.vehicle.home
        bearing_rad = math.atan2(home.east_m - east_m, home.north_m - north_m)
        for turn_deg in _TURNS_DEG:
            angle_rad = bearing_rad + math.radians(turn_deg)
            goal = east_m + MOVE_M * math.sin(angle_rad), north_m + MOVE_M * math.cos(angle_rad)
            if self._permitted((east_m, north_m), goal):
                return goal
        return east_m, north_m

    def _permitted(self, start: tuple[float, float], goal: tuple[float, float]) -> bool:
        """Whether the way lies inside the geofence and outside every no-fly area, whatever its times."""
        rules = self._simspec.rules
        for step in range(_STEPS + 1):
            share = step / _STEPS
            place = Point(
                east_m=start[0] + share * (goal[0] - start[0]),
                north_m=start[1] + share * (goal[1] - start[1]),
            )
            if rules.geofence is not None and not rules.geofence.contains(place):
                return False
            if any(no_fly.area.contains(place) for no_fly in rules.no_fly):
                return False
        return True

    def _reposition(self, goal: tuple[float, float], up_m: float) -> None:
        origin = self._simspec.world.origin
        east_m, north_m = metres_of_degree(origin.latitude_deg, origin.altitude_m)
        # A vehicle has the system id that its parameters give it, 1 by default in both autopilots.
        parameters = self._simspec.vehicle.parameters
        system = int(parameters.get("MAV_SYS_ID", parameters.get("SYSID_THISMAV", 1)))
        dialect = self._dialect
        self._send(
            dialect.MAVLink_command_int_message(
                system,
                1,
                dialect.MAV_FRAME_GLOBAL,
                dialect.MAV_CMD_DO_REPOSITION,
                0,
                0,
                MOVE_MPS,
                dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE,
                0.0,
                math.nan,
                round((origin.latitude_deg + goal[1] / north_m) * 1e7),
                round(wrapped(origin.longitude_deg + goal[0] / east_m) * 1e7),
                origin.altitude_m + up_m,
            )
        )

    def _send(self, message: mavlink.MAVLink_message) -> None:
        self._socket.sendto(message.pack(self._mav), self._address)
        self._mav.seq = (self._mav.seq + 1) % 256
        self.sent += 1


def _left_alone(order: OrderDocument, reason: str) -> EventDocument:
    return EventDocument(name="operator leaves the vehicle alone", text=f"{order.id}: {reason}")


def operator_links(simspec: SimSpec) -> tuple[LinkSpec, ...]:
    """The operator's link, where the operator is to fly; a session without such an order has none."""
    if not any(order.kind == "hand_over" for order in simspec.orders):
        return ()
    return (LinkSpec(OPERATOR_LINK, "udp_in", streams="none"),)


@contextmanager
def open_operator_pilot(simspec: SimSpec, vehicle: Vehicle) -> Generator[OperatorPilot | None]:
    """The operator's ground station; None where nothing is ever handed over."""
    if not operator_links(simspec):
        yield None
        return
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        yield OperatorPilot(simspec, sender, vehicle.endpoints()[OPERATOR_LINK])
