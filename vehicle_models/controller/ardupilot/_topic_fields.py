"""What ArduPilot tells a companion (AP_DDS), as quantities by the names that `topics.json` puts into the fields of messages.

The table follows libraries/AP_DDS, with what looks wrong there: earth quantities whose frame is `base_link`, and an IMU
whose quaternion has its w in x. A text there is a quantity's name or, behind an apostrophe, itself. Altitudes are above mean
sea level, to the centimetre that ArduPilot has.
"""

from __future__ import annotations

import math
from typing import Any

from ..._geodesy import LocalFrame
from ..links._enums import GPS_FIX_TYPE
from ..state._flight_state import Behaviour, Cause, FlightState, GpsQuality, LandedState
from ..telemetry._attitude import quaternion

Quantities = dict[str, Any]

# NavSatStatus by the receiver's fix: SBAS for a differential one, ground based for RTK.
_FIX_STATUS: dict[int, int] = {GPS_FIX_TYPE.DGPS: 1, GPS_FIX_TYPE.RTK_FLOAT: 2, GPS_FIX_TYPE.RTK_FIXED: 2}
# BatteryState
_DISCHARGING, _NOT_CHARGING, _FULL = 2, 3, 4
# Status.FS_*
_FAILSAFES = {
    Cause.RADIO: 21,
    Cause.STICKS: 21,
    Cause.BATTERY: 22,
    Cause.GROUND_STATION: 23,
    Cause.POSITION: 24,
}
# Modes that fly to a place.
_GOES = (Behaviour.OFFBOARD, Behaviour.MISSION, Behaviour.RETURN)


def filled(template: Any, quantities: Quantities) -> Any:
    """The fields of a message: a template with quantities in place of their names."""
    if isinstance(template, dict):
        return {name: filled(part, quantities) for name, part in template.items()}
    if isinstance(template, str):
        return template[1:] if template.startswith("'") else quantities[template]
    return template


def quantities_of(flight: FlightState) -> Quantities:
    """What the state of the flight says; SI units, degrees for places, amperes and ampere hours."""
    home, origin = flight.home or flight.origin, flight.origin
    sec, us = divmod(flight.unix_start_us + flight.time_us, 1_000_000)
    failsafe = _FAILSAFES.get(flight.failsafe) if flight.failsafe else None
    stamp = {"sec": sec, "nanosec": us * 1000}
    # The receiver's antenna is where the body's origin is.
    frame = {"header": {"stamp": stamp, "frame_id": "base_link"}, "child_frame_id": "GPS_0"}
    return {
        "stamp": stamp,
        "antennas": 1,
        "frames": [frame],
        "nan": math.nan,
        **_attitude(flight),
        "east_of_home": flight.east_m - home.east_m,
        "north_of_home": flight.north_m - home.north_m,
        "above_home": home.down_m - flight.down_m,
        **dict(
            zip(("v_east", "v_north", "v_up"), (flight.ve_mps, flight.vn_mps, -flight.vd_mps), strict=True)
        ),
        **dict(zip(("p", "q", "r"), (flight.p_radps, flight.q_radps, flight.r_radps), strict=True)),
        "minus_q": -flight.q_radps,
        "minus_r": -flight.r_radps,
        **place_of("", flight.latitude_e7, flight.longitude_e7, flight.altitude_m),
        **place_of("origin_", origin.latitude_e7, origin.longitude_e7, origin.altitude_m),
        "armed": flight.armed,
        "mode": flight.mode.custom,
        "flying": flight.flying,
        "failsafe": b"" if failsafe is None else bytes([failsafe]),
    }


def fix_of(flight: FlightState, quality: GpsQuality) -> Quantities:
    """The receiver's last fix; `fix` is its number, None before the first."""
    level, vertical = (quality.h_acc_mm * 1e-3) ** 2, (quality.v_acc_mm * 1e-3) ** 2
    return {
        "fix": flight.gps_epoch or None,
        "fix_status": _FIX_STATUS.get(quality.fix_type, 0),
        **place_of("fix_", *flight.fix_e7, flight.fix_altitude_m),
        "fix_covariance": (level, 0.0, 0.0, 0.0, level, 0.0, 0.0, 0.0, vertical),
    }


def battery_of(flight: FlightState, volts: float, capacity_mah: float) -> Quantities:
    """The battery; its charge is whole percents, as ArduPilot counts it."""
    percent, capacity_ah = round(100.0 * flight.battery_fraction), capacity_mah * 1e-3
    status = _FULL if percent == 100 else _DISCHARGING if flight.battery_a > 0.0 else _NOT_CHARGING
    return {
        "voltage": volts,
        "current": -flight.battery_a,
        "capacity": capacity_ah,
        "charge": percent * capacity_ah * 0.01,
        "charged": percent * 0.01,
        "supply_status": status,
    }


def goal_of(flight: FlightState, frame: LocalFrame) -> Quantities:
    """The place that it flies to, None where it follows none."""
    place, down_m = flight.target.north_east_m, flight.target.down_m
    going = flight.landed is LandedState.IN_AIR and flight.mode.behaviour in _GOES
    if not going or place is None or down_m is None:
        return dict.fromkeys(("goal_latitude", "goal_longitude", "goal_altitude"))
    return place_of("goal_", *frame.to_geodetic_e7(*place), flight.origin.altitude_m - down_m)


def place_of(prefix: str, latitude_e7: int, longitude_e7: int, altitude_m: float) -> Quantities:
    values = (latitude_e7 * 1e-7, longitude_e7 * 1e-7, round(altitude_m * 100.0) * 0.01)
    return dict(zip((f"{prefix}latitude", f"{prefix}longitude", f"{prefix}altitude"), values, strict=True))


def _attitude(flight: FlightState) -> Quantities:
    """The quaternion of body FRD against NED, and of forward, left, up against ENU: first the axes of the earth are exchanged,
    which leaves the nose a quarter turn off, then the body is turned by it.
    """
    w, x, y, z = quaternion(flight)
    half = math.sqrt(0.5)
    enu = half * (w + z), half * (x + y), half * (x - y), half * (w - z)
    names = [f"{prefix}_{axis}" for prefix in ("q", "enu") for axis in "wxyz"]
    return dict(zip(names, (w, x, y, z, *enu), strict=True))
