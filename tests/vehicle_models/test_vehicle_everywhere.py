"""What clients send in degrees is flown alike everywhere on earth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from test_vehicle_missions import Row, bare, to, upload
from vehicle_client import Make, mavlink, simspec

from bench.simspec import SimSpec

Degrees = tuple[float, float]
USUAL = (47.3977, 8.5456)
# Both sides of the date line and on it, the meridian and a pole; the frame that both autopilots share is the same code.
PLACES = {
    "px4": [(0.0, 180.0), (-85.0, -179.9999)],
    "ardupilot": [(-17.0, -180.0), (60.0, 179.9999), (0.0, 0.0)],
}

LOW_RETURN = {"px4": {"RTL_RETURN_ALT": 8.0, "RTL_DESCEND_ALT": 8.0}, "ardupilot": {"RTL_ALT": 800.0}}


def spec_at(origin: Degrees, autopilot: str) -> SimSpec:
    document = simspec(autopilot, vehicle={"parameters": LOW_RETURN[autopilot]}).model_dump(mode="json")
    latitude_deg, longitude_deg = origin
    document["world"]["origin"] = {
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "altitude_m": 488.0,
    }
    return SimSpec.model_validate(document)


def flown(make: Make, origin: Degrees, autopilot: str) -> NDArray[np.float64]:
    """West and east by repositions, a mission across both within a fence, a rally point in the west, and home."""
    client = make(spec_at(origin, autopilot), system=255)
    track: list[tuple[float, ...]] = []

    def fly(seconds: float) -> None:
        client.fly(seconds, lambda: track.append(client.vehicle.truth().position_enu_m))

    client.beat()
    if autopilot == "px4":
        client.airborne(4.0)
        client.learn_home()
    else:
        client.guided(4.0, risen_s=6.0)
    for east_m in (-12.0, 12.0):
        assert client.reposition(east_m, 2.0, 493.0) == [0]
        fly(6.0)
    fence: list[Row] = [
        (5001, 0, 4, 0, 0, 0, *client.vehicle_goal(e, n), 0)
        for e, n in ((-30, -30), (30, -30), (30, 30), (-30, 30))
    ]
    assert upload(client, fence, 1) == 0
    rally: list[Row] = [(5100, 3, 0, 0, 0, 0, *client.vehicle_goal(-6.0, 0.0), 5)]
    assert upload(client, rally, 2) == 0
    rows = [to(client, 12.0, -5.0, 6.0), to(client, -12.0, 5.0, 6.0), bare(20)]
    if autopilot == "ardupilot":
        rows.insert(0, to(client, 0.0, 0.0, 0.0))
    assert upload(client, rows) == 0
    mode = (1, 4, 4) if autopilot == "px4" else (1, 3)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, *mode)[-1] == 0
    fly(22.0)
    return np.array(track)


@pytest.mark.parametrize("autopilot", PLACES)
def test_plans_and_commands_in_degrees_are_flown_alike_everywhere(make: Make, autopilot: str) -> None:
    usual = flown(make, USUAL, autopilot)
    assert usual[:, 0].min() < -10.0
    assert usual[:, 0].max() > 10.0
    assert usual[-1, :2] == pytest.approx((-6.0, 0.0), abs=0.5), (
        "it returns to the rally point, which is nearer"
    )
    for origin in PLACES[autopilot]:
        track = flown(make, origin, autopilot)
        assert np.abs(track - usual).max() < 0.06, origin


@pytest.mark.parametrize("longitude_deg", [180.0, -180.0, 179.9999, -179.9999])
def test_degrees_and_metres_are_inverse_at_the_date_line(make: Make, longitude_deg: float) -> None:
    """Every longitude that the vehicle reports is one that it takes."""
    client = make(spec_at((-17.0, longitude_deg), "px4"))
    frame = client.vehicle._frame  # type: ignore[attr-defined]
    random = np.random.default_rng(11)
    for north_m, east_m in random.uniform(-500.0, 500.0, (200, 2)):
        latitude_e7, longitude_e7 = frame.to_geodetic_e7(north_m, east_m)
        assert abs(longitude_e7) <= 1_800_000_000
        back: Any = frame.to_local_m(latitude_e7 * 1e-7, longitude_e7 * 1e-7)
        assert math.dist(back, (north_m, east_m)) < 0.01
