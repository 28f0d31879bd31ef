"""The fields of ArduPilot's messages to a companion (AP_DDS), made of the state of the flight.

They follow libraries/AP_DDS, with what looks wrong there: earth quantities whose frame is `base_link`, and an IMU whose
quaternion has its w in x.
"""

from __future__ import annotations

import math
from typing import Any

from bench.contracts import Vector

from ..links._enums import GPS_FIX_TYPE
from ..state._flight_state import Cause, FlightState, GpsQuality
from ..telemetry._attitude import Quaternion

Fields = dict[str, Any]

_BODY, _SENSOR = "base_link", "base_link_ned"
_NAN = math.nan
# NavSatStatus by the receiver's fix: SBAS for a differential one, ground based for RTK.
_STATUS = {GPS_FIX_TYPE.DGPS: 1, GPS_FIX_TYPE.RTK_FLOAT: 2, GPS_FIX_TYPE.RTK_FIXED: 2}
_GPS_SERVICE, _DIAGONAL_KNOWN = 1, 2
# BatteryState
_DISCHARGING, _NOT_CHARGING, _FULL, _GOOD = 2, 3, 4, 1
_COVARIANCE_UNKNOWN = (-1.0, *(0.0,) * 8)
_COPTER = 2
# Status.FS_*
_FAILSAFES = {
    Cause.RADIO: 21,
    Cause.STICKS: 21,
    Cause.BATTERY: 22,
    Cause.GROUND_STATION: 23,
    Cause.POSITION: 24,
}


def stamp(flight: FlightState) -> Fields:
    """The present moment in UTC."""
    sec, us = divmod(flight.unix_start_us + flight.time_us, 1_000_000)
    return {"sec": sec, "nanosec": us * 1000}


def header(flight: FlightState, frame: str = _BODY) -> Fields:
    return {"stamp": stamp(flight), "frame_id": frame}


def tf_static(flight: FlightState) -> Fields:
    """The receiver's antenna, which is where the body's origin is."""
    return {"transforms": [{"header": header(flight), "child_frame_id": "GPS_0"}]}


def navsat(flight: FlightState, quality: GpsQuality) -> Fields:
    """NavSatFix: the receiver's last fix."""
    level, vertical = (quality.h_acc_mm * 1e-3) ** 2, (quality.v_acc_mm * 1e-3) ** 2
    return {
        "header": header(flight, "0"),
        "status": {"status": _STATUS.get(GPS_FIX_TYPE(quality.fix_type), 0), "service": _GPS_SERVICE},
        **geo_point(*flight.fix_e7, flight.fix_altitude_m),
        "position_covariance": (level, 0.0, 0.0, 0.0, level, 0.0, 0.0, 0.0, vertical),
        "position_covariance_type": _DIAGONAL_KNOWN,
    }


def battery(flight: FlightState, volts: float, capacity_mah: float) -> Fields:
    """BatteryState; the charge is whole percents, as ArduPilot counts it."""
    percent, capacity_ah = round(100.0 * flight.battery_fraction), capacity_mah * 1e-3
    status = _FULL if percent == 100 else _DISCHARGING if flight.battery_a > 0.0 else _NOT_CHARGING
    return {
        "header": header(flight, "0"),
        "voltage": volts,
        "temperature": _NAN,
        "current": -flight.battery_a,
        "charge": percent * capacity_ah * 0.01,
        "capacity": _NAN,
        "design_capacity": capacity_ah,
        "percentage": percent * 0.01,
        "power_supply_status": status,
        "power_supply_health": _GOOD,
        "present": True,
    }


def imu(flight: FlightState, body: Quaternion, force_mps2: Vector) -> Fields:
    """Imu, of body FRD; `force_mps2` is what the accelerometer measures."""
    rates = flight.p_radps, flight.q_radps, flight.r_radps
    return {
        "header": header(flight, _SENSOR),
        "orientation": dict(zip("xyzw", body, strict=True)),
        "orientation_covariance": _COVARIANCE_UNKNOWN,
        "angular_velocity": dict(zip("xyz", rates, strict=True)),
        "angular_velocity_covariance": _COVARIANCE_UNKNOWN,
        "linear_acceleration": dict(zip("xyz", force_mps2, strict=True)),
        "linear_acceleration_covariance": _COVARIANCE_UNKNOWN,
    }


def pose(flight: FlightState, body: Quaternion) -> Fields:
    """PoseStamped: east, north and up of home."""
    home = flight.home or flight.origin
    position = {
        "x": flight.east_m - home.east_m,
        "y": flight.north_m - home.north_m,
        "z": home.down_m - flight.down_m,
    }
    return {"header": header(flight), "pose": {"position": position, "orientation": _enu(body)}}


def twist(flight: FlightState) -> Fields:
    """TwistStamped: velocity to east, north and up; rates of forward, left and up."""
    linear = {"x": flight.ve_mps, "y": flight.vn_mps, "z": -flight.vd_mps}
    angular = {"x": flight.p_radps, "y": -flight.q_radps, "z": -flight.r_radps}
    return {"header": header(flight), "twist": {"linear": linear, "angular": angular}}


def geopose(flight: FlightState, body: Quaternion) -> Fields:
    position = geo_point(flight.latitude_e7, flight.longitude_e7, flight.altitude_m)
    return {"header": header(flight), "pose": {"position": position, "orientation": _enu(body)}}


def geo_point(latitude_e7: int, longitude_e7: int, altitude_m: float) -> Fields:
    """A place above mean sea level, to the centimetre that ArduPilot has."""
    altitude_m = round(altitude_m * 100.0) * 0.01
    return {"latitude": latitude_e7 * 1e-7, "longitude": longitude_e7 * 1e-7, "altitude": altitude_m}


def status(flight: FlightState) -> Fields:
    """Status, without its header."""
    failsafe = _FAILSAFES.get(flight.failsafe) if flight.failsafe else None
    return {
        "vehicle_type": _COPTER,
        "armed": flight.armed,
        "mode": flight.mode.custom,
        "flying": flight.flying,
        "external_control": True,
        "failsafe": b"" if failsafe is None else bytes([failsafe]),
    }


def _enu(body: Quaternion) -> Fields:
    """The attitude of forward, left, up against east, north, up: first the axes of the earth are exchanged, which leaves the
    nose a quarter turn off, then the body is turned by it.
    """
    w, x, y, z = body
    half = math.sqrt(0.5)
    return {"w": half * (w + z), "x": half * (x + y), "y": half * (x - y), "z": half * (w - z)}
