"""What clients send in degrees is flown alike everywhere on earth: repositions, global setpoints, missions, fences,
rally points, returns.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from test_vehicle_missions import Row, bare, to, upload
from vehicle_client import NAN, Client, Make, mavlink, simspec

from bench.simspec import SimSpec

USUAL = {"latitude_deg": 47.3977, "longitude_deg": 8.5456, "altitude_m": 488.0}
# Both sides of the date line and on it, the meridian and a pole; the frame that both autopilots share is the same code.
PLACES = {
    "px4": [
        {"latitude_deg": 0.0, "longitude_deg": 180.0, "altitude_m": 488.0},
        {"latitude_deg": -85.0, "longitude_deg": -179.9999, "altitude_m": 488.0},
    ],
    "ardupilot": [
        {"latitude_deg": -17.0, "longitude_deg": -180.0, "altitude_m": 488.0},
        {"latitude_deg": 60.0, "longitude_deg": 179.9999, "altitude_m": 488.0},
        {"latitude_deg": 0.0, "longitude_deg": 0.0, "altitude_m": 488.0},
    ],
}


def spec_at(origin: dict[str, float], autopilot: str) -> SimSpec:
    document = simspec(autopilot).model_dump(mode="json")
    document["world"]["origin"] = origin
    return SimSpec.model_validate(document)


def armed(client: Client, autopilot: str) -> None:
    if autopilot == "px4":
        client.airborne(10.0)
        return
    client.guided()


def flown(make: Make, origin: dict[str, float], autopilot: str) -> NDArray[np.float64]:
    """West and east by repositions, a mission across both within a fence, a rally point in the west, and home."""
    client = make(spec_at(origin, autopilot), streams="onboard", system=255)
    track: list[tuple[float, ...]] = []

    def fly(seconds: float) -> None:
        client.fly(seconds, lambda: track.append(client.vehicle.truth().position_enu_m))

    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    armed(client, autopilot)
    client.command(mavlink.MAV_CMD_GET_HOME_POSITION)
    for east_m in (-30.0, 30.0):
        goal = (*client.vehicle_goal(east_m, 5.0), origin["altitude_m"] + 12.0)
        assert client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, -1, 1, 0, NAN, *goal) == [0]
        fly(12.0)
    fence: list[Row] = [
        (5001, 0, 4, 0, 0, 0, *client.vehicle_goal(e, n), 0)
        for e, n in ((-60, -60), (60, -60), (60, 60), (-60, 60))
    ]
    assert upload(client, fence, 1) == 0
    rally: list[Row] = [(5100, 3, 0, 0, 0, 0, *client.vehicle_goal(-20.0, 0.0), 10)]
    assert upload(client, rally, 2) == 0
    rows = [to(client, -25.0, 10.0, 14.0), to(client, 25.0, -10.0, 14.0), bare(20)]
    if autopilot == "ardupilot":
        rows.insert(0, to(client, 0.0, 0.0, 0.0))
    assert upload(client, rows) == 0
    mode = (1, 4, 4) if autopilot == "px4" else (1, 3)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, *mode)[-1] == 0
    fly(60.0)
    return np.array(track)


@pytest.mark.parametrize("autopilot", PLACES)
def test_plans_and_commands_in_degrees_are_flown_alike_everywhere(make: Make, autopilot: str) -> None:
    usual = flown(make, USUAL, autopilot)
    assert usual[:, 0].min() < -25.0
    assert usual[:, 0].max() > 25.0
    for origin in PLACES[autopilot]:
        track = flown(make, origin, autopilot)
        assert np.abs(track - usual).max() < 0.06, origin


@pytest.mark.parametrize("longitude_deg", [180.0, -180.0, 179.9999, -179.9999])
def test_degrees_and_metres_are_inverse_at_the_date_line(make: Make, longitude_deg: float) -> None:
    """Every longitude that the vehicle reports is one that it takes."""
    origin = {"latitude_deg": -17.0, "longitude_deg": longitude_deg, "altitude_m": 10.0}
    client = make(spec_at(origin, "px4"))
    frame = client.vehicle._frame  # type: ignore[attr-defined]
    random = np.random.default_rng(11)
    for north_m, east_m in random.uniform(-500.0, 500.0, (200, 2)):
        latitude_e7, longitude_e7 = frame.to_geodetic_e7(north_m, east_m)
        assert abs(longitude_e7) <= 1_800_000_000
        back: Any = frame.to_local_m(latitude_e7 * 1e-7, longitude_e7 * 1e-7)
        assert math.dist(back, (north_m, east_m)) < 0.01
