"""The flight that PX4 and ArduCopter flew on this plant, flown by the vehicle, and the figures that describe it.

Take off to 10 m, go 20 m north by DO_REPOSITION, then return or land; 25 s for each of the first two. The real
autopilots moved the rotors of this very plant (`vehicle_models/x500/x500.xml` without its cascade). Their figures
and these are both of the physics' truth, read at 10 Hz.

Run: python tests/vehicle_models/flight_qualities.py
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from vehicle_client import NAN, Client, simspec

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_x500
from vehicle_models.controller.links._dialect import dialect as mavlink

Track = NDArray[np.float64]
"""Rows of north, east, up (m), their rates (m/s) and the tilt (rad), ten a second."""

ROWS_HZ = 10
LEG_S = 25.0
HEIGHT_M, STEP_M = 10.0, 20.0
PARAMETERS = {"px4": {"MIS_TAKEOFF_ALT": 10.0}, "ardupilot": {}}


@dataclass(frozen=True)
class Quality:
    """One row: what the real autopilot did, and how far the vehicle may be from it."""

    unit: str
    real: float
    tolerance: float
    decimals: int


@dataclass(frozen=True)
class _About:
    """For a value near zero, of which a tenth is less than two runs of the real autopilot differ."""

    real: float
    tolerance: float


# Unit and decimals, and what PX4 and ArduCopter did; the vehicle may differ by a tenth where no tolerance stands.
_ROWS: dict[str, tuple[str, int, float | _About, float | _About]] = {
    "takeoff to 10 %": ("s", 1, 4.5, 4.3),
    "takeoff to 95 %": ("s", 1, 11.2, 9.2),
    "greatest climb of the takeoff": ("m/s", 2, 1.50, 2.58),
    "overshoot of the takeoff": ("m", 2, _About(0.03, 0.1), _About(0.0, 0.1)),
    "20 m step to 10 %": ("s", 1, 1.8, 1.6),
    "20 m step to 50 %": ("s", 1, 3.5, 3.3),
    "20 m step to 95 %": ("s", 1, 7.2, 5.6),
    "overshoot of the step": ("m", 2, _About(0.06, 0.1), 0.31),
    "top speed of the step": ("m/s", 2, 5.05, 5.70),
    "greatest tilt of the step": ("deg", 1, 19.6, 18.5),
    "off the line of the step": ("m", 2, _About(0.04, 0.1), _About(0.05, 0.1)),
    "off the height of the step": ("m", 2, _About(0.05, 0.1), _About(0.05, 0.1)),
    "deviation of the hold, north": ("cm", 1, _About(2.5, 3.0), _About(0.7, 3.0)),
    "deviation of the hold, east": ("cm", 1, _About(2.1, 3.0), _About(0.5, 3.0)),
    "deviation of the hold, height": ("cm", 1, _About(1.4, 3.0), _About(1.1, 3.0)),
    "return to disarmed": ("s", 1, 46.0, 46.0),
    "top height of the return": ("m", 1, 29.9, 15.0),
    "top speed of the return": ("m/s", 2, 5.07, 4.36),
    "landing to disarmed": ("s", 1, 16.0, 23.0),
    "descent of the last 2 m": ("m/s", 2, 0.70, 0.50),
}


def _quality(unit: str, decimals: int, real: float | _About) -> Quality:
    about = real if isinstance(real, _About) else _About(real, 0.1 * real)
    return Quality(unit, about.real, about.tolerance, decimals)


QUALITIES = {
    "px4": {name: _quality(unit, places, real) for name, (unit, places, real, _) in _ROWS.items()},
    "ardupilot": {name: _quality(unit, places, real) for name, (unit, places, _, real) in _ROWS.items()},
}


class _Flight:
    """One flight of the script; `end` is its last part."""

    def __init__(self, client: Client, autopilot: str) -> None:
        self._client, self._autopilot = client, autopilot

    def take_off(self) -> Track:
        if self._autopilot == "px4":
            self._client.fly(4.0)
        else:
            self._client.learn_home()
            self._command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
        self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        self._client.fly(1.0)
        height_m = NAN if self._autopilot == "px4" else HEIGHT_M
        self._command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, height_m)
        return self._rows(LEG_S)

    def step_north(self) -> Track:
        assert self._client.reposition(0.0, STEP_M, 488.0 + HEIGHT_M) == [0]
        return self._rows(LEG_S)

    def come_down(self, end: Literal["return", "land"]) -> Track:
        """Rows until the heartbeat shows the vehicle disarmed, which it does once a second."""
        number = mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH if end == "return" else mavlink.MAV_CMD_NAV_LAND
        self._command(number, 0, 0, 0, NAN, NAN, NAN, NAN)
        rows = []
        while self._client.last("HEARTBEAT").base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED:
            rows.append(self._rows(1.0 / ROWS_HZ))
            assert len(rows) < 1000, "it never disarmed"
        return np.concatenate(rows)

    def _command(self, number: int, *params: float) -> None:
        results = self._client.command(number, *params)
        assert 0 in results, (number, results)

    def _rows(self, seconds: float) -> Track:
        rows = []
        for _ in range(round(seconds * ROWS_HZ)):
            self._client.fly(1.0 / ROWS_HZ)
            state = self._client.vehicle.truth()
            (east, north, up), (ve, vn, vu) = state.position_enu_m, state.velocity_enu_mps
            tilt = math.acos(math.cos(state.roll_rad) * math.cos(state.pitch_rad))
            rows.append((north, east, up, vn, ve, vu, tilt))
        return np.array(rows)


def fly(autopilot: str, end: Literal["return", "land"]) -> tuple[Track, Track, Track]:
    """Fly the script in still air; the rows of takeoff, step and end."""
    client = Client(255)
    link = LinkSpec("onboard", "udp_out", port=client.port, streams="none")
    spec = simspec(autopilot, vehicle={"parameters": PARAMETERS[autopilot]})
    with closing(client.socket), open_x500(VehiclePlan(spec, (link,))) as vehicle:
        client.vehicle = vehicle
        client.fly(1.1)
        flight = _Flight(client, autopilot)
        return flight.take_off(), flight.step_north(), flight.come_down(end)


def _reached_s(rising: NDArray[np.float64], level: float) -> float:
    return float(np.argmax(rising >= level) + 1) / ROWS_HZ


def figures(autopilot: str) -> dict[str, float]:
    """The figures of QUALITIES as the vehicle flies them, from a flight that returns and one that lands."""
    up, step, back = fly(autopilot, "return")
    *_, landing = fly(autopilot, "land")
    height = up[-10:, 2].mean()
    north = step[:, 0] - step[0, 0]
    length = north[-10:].mean()
    hold = 100.0 * step[-80:, :3].std(axis=0)
    low = back[(back[:, 2] < 2.0) & (back[:, 5] < -0.05)]
    return {
        "takeoff to 10 %": _reached_s(up[:, 2], 0.1 * height),
        "takeoff to 95 %": _reached_s(up[:, 2], 0.95 * height),
        "greatest climb of the takeoff": up[:, 5].max(),
        "overshoot of the takeoff": up[:, 2].max() - height,
        "20 m step to 10 %": _reached_s(north, 0.1 * length),
        "20 m step to 50 %": _reached_s(north, 0.5 * length),
        "20 m step to 95 %": _reached_s(north, 0.95 * length),
        "overshoot of the step": north.max() - length,
        "top speed of the step": np.hypot(step[:, 3], step[:, 4]).max(),
        "greatest tilt of the step": math.degrees(step[:, 6].max()),
        "off the line of the step": np.abs(step[:, 1] - step[0, 1]).max(),
        "off the height of the step": np.abs(step[:, 2] - step[0, 2]).max(),
        "deviation of the hold, north": hold[0],
        "deviation of the hold, east": hold[1],
        "deviation of the hold, height": hold[2],
        "return to disarmed": len(back) / ROWS_HZ,
        "top height of the return": back[:, 2].max(),
        "top speed of the return": np.hypot(back[:, 3], back[:, 4]).max(),
        "landing to disarmed": len(landing) / ROWS_HZ,
        "descent of the last 2 m": -low[:, 5].mean(),
    }


def table(flown: Mapping[str, Mapping[str, float]]) -> str:
    """Real and simulated, autopilot by autopilot; docs/vehicle.md has some of the rows."""
    lines = [
        "| | PX4 real | PX4 here | ArduCopter real | ArduCopter here |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for name in QUALITIES["px4"]:
        cells = []
        for autopilot, qualities in QUALITIES.items():
            quality = qualities[name]
            cells += [f"{value:.{quality.decimals}f}" for value in (quality.real, flown[autopilot][name])]
        lines.append(f"| {name}, {QUALITIES['px4'][name].unit} | {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table({autopilot: figures(autopilot) for autopilot in QUALITIES}))
