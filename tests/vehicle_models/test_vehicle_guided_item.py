"""Going somewhere by a mission item that is none."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import Client, simspec

Make = Callable[..., Client]


def test_a_waypoint_that_is_flown_at_once(make: Make) -> None:
    """MISSION_ITEM with current 2, DroneKit's way to go somewhere: acknowledged, flown, and no part of a
    mission.
    """
    client = make(simspec("ardupilot"))
    client.guided(20.0, risen_s=20.0)
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    latitude, longitude = (angle * 1e-7 for angle in client.vehicle_goal(0.0, 15.0))
    client.send(
        mavlink.MAVLink_mission_item_message(1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, latitude, longitude, 18)
    )
    client.fly(15.0)
    assert client.last("MISSION_ACK").type == 0
    east, north, up = client.vehicle.truth().position_enu_m
    assert (east, north, up) == pytest.approx((0.0, 15.0, 18.0), abs=1.0)
