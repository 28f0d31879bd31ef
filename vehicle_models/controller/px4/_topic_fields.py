"""The fields of PX4's messages to a companion, as px4_msgs names them, made of the state of the flight.

What is not here is zero: reset counters, most variances, and the reasons for arming, whose numbers differ between releases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from bench.contracts import Vector

from ..state._flight_state import (
    Behaviour,
    Cause,
    FlightMode,
    FlightState,
    GpsQuality,
    ReferencePoint,
    StickControl,
)
from ..telemetry._attitude import Quaternion, turned_to_ned
from ._modes import MODES, NAV_STATES, is_placed, knows_position

Fields = dict[str, Any]

_GRAVITY_MPS2 = 9.80665
_NAN, _INFINITY = math.nan, math.inf
# As ESTIMATOR_STATUS over MAVLink.
_POSITION_SIGMA_M, _SPEED_SIGMA_MPS = 0.3, 0.1
_SIGMAS = {"eph": _POSITION_SIGMA_M, "epv": _POSITION_SIGMA_M}
_NO_LIMITS = dict.fromkeys(("vxy_max", "vz_max", "hagl_min", "hagl_max_z", "hagl_max_xy"), _INFINITY)
# VehicleOdometry.POSE_FRAME_NED and VELOCITY_FRAME_NED
_NED = 1
_NO_TURN = (1.0, 0.0, 0.0, 0.0)
# What of a flag_control_NAME_enabled is set: by level of OffboardControlMode, and by what the sticks control.
_ALL = ("position", "velocity", "altitude", "climb_rate", "acceleration", "attitude", "rates")
_BY_LEVEL = {
    "position": _ALL,
    "velocity": _ALL[1:],
    "acceleration": _ALL[4:],
    "attitude": _ALL[5:],
    "body_rate": _ALL[6:],
}
_BY_STICK = {
    StickControl.POSITION: _ALL,
    StickControl.ALTITUDE: (*_ALL[2:4], *_ALL[5:]),
    StickControl.ATTITUDE: _ALL[5:],
    StickControl.RATES: _ALL[6:],
}
_MOVES_MPS = 0.5


def _mask(holds: Callable[[FlightMode], bool]) -> int:
    """Bits of the nav_states of PX4's own modes for which something holds."""
    own = (mode for mode in MODES.modes if mode.behaviour is not Behaviour.EXTERNAL)
    return sum(1 << NAV_STATES[mode.name] for mode in own if holds(mode))


def _behaves(*behaviours: Behaviour) -> int:
    return _mask(lambda mode: mode.behaviour in behaviours)


def _sticks(*controls: StickControl) -> int:
    return _mask(lambda mode: mode.stick in controls)


_TERMINATION, _OFFBOARD = _behaves(Behaviour.TERMINATE), _behaves(Behaviour.OFFBOARD)
_FLYING = _mask(lambda mode: True) & ~_TERMINATION
_PLACED = _mask(lambda mode: mode.needs_position) & ~_OFFBOARD | _sticks(StickControl.POSITION)
# Which modes need what, as far as it follows from the table of modes.
_REQUIREMENTS = {
    "mode_req_angular_velocity": _FLYING,
    "mode_req_attitude": _FLYING & ~_sticks(StickControl.RATES),
    "mode_req_local_alt": _PLACED | _sticks(StickControl.ALTITUDE),
    "mode_req_local_position": _PLACED,
    "mode_req_global_position": _behaves(Behaviour.MISSION, Behaviour.RETURN),
    "mode_req_mission": _behaves(Behaviour.MISSION),
    "mode_req_offboard_signal": _OFFBOARD,
    "mode_req_home_position": _behaves(Behaviour.RETURN),
    "mode_req_prevent_arming": _behaves(Behaviour.RETURN, Behaviour.LAND) | _TERMINATION,
    "mode_req_manual_control": _behaves(Behaviour.PILOT),
}


def status_masks(flight: FlightState) -> dict[str, int]:
    """Which nav_states there are, and which can be asked for."""
    # PX4 counts all eight, registered or not: a switch of a radio may ask for one that is yet to come.
    return {
        "valid_nav_states_mask": sum(1 << state for state in NAV_STATES.values()),
        "can_set_nav_states_mask": _FLYING | sum(1 << NAV_STATES[name] for name in flight.external_modes),
    }


def control_mode(flight: FlightState, level: str, wing: bool) -> Fields:
    """VehicleControlMode, with the level at which the companion controls."""
    mode = flight.mode
    behaviour = mode.behaviour
    names = _BY_STICK[mode.stick] if mode.stick else _ALL
    by_companion = behaviour in (Behaviour.OFFBOARD, Behaviour.EXTERNAL)
    if by_companion:
        names = _BY_LEVEL.get(level, ())
    terminated = behaviour is Behaviour.TERMINATE
    names = () if terminated else names
    by_itself = not by_companion and behaviour is not Behaviour.PILOT and not terminated
    return {
        **{f"flag_control_{name}_enabled": name in names for name in _ALL},
        "flag_armed": flight.armed,
        "flag_multicopter_position_control_enabled": not wing and any(name in names for name in _ALL[:5]),
        "flag_control_manual_enabled": behaviour is Behaviour.PILOT,
        "flag_control_auto_enabled": by_itself,
        "flag_control_offboard_enabled": behaviour is Behaviour.OFFBOARD,
        "flag_control_allocation_enabled": not terminated,
        "flag_control_termination_enabled": terminated,
    }


def failsafe_flags(flight: FlightState, alive: bool, warning: int, external: Mapping[str, int]) -> Fields:
    """FailsafeFlags; `alive`: the companion's sign of life is good enough for the offboard mode; `external`: what its own
    modes require.
    """
    lost = not is_placed(flight)
    names = ("local_position", "local_velocity", "global_position")
    return {
        **_REQUIREMENTS,
        **{name: _REQUIREMENTS.get(name, 0) | mask for name, mask in external.items()},
        **{f"{name}_invalid": lost for name in names},
        "local_position_invalid_relaxed": lost,
        "global_position_invalid_relaxed": lost,
        "auto_mission_missing": not flight.mission_ready,
        "offboard_control_signal_lost": not alive,
        "home_position_invalid": flight.home is None,
        "manual_control_signal_lost": flight.sticks is None,
        "battery_warning": warning,
        "geofence_breached": flight.failsafe is Cause.FENCE,
        "gnss_lost": not flight.gps_ok,
    }


def land_detected(flight: FlightState) -> Fields:
    landed = not flight.flying
    return {
        **dict.fromkeys(("maybe_landed", "landed", "at_rest", "has_low_throttle"), landed),
        "ground_contact": landed or flight.on_ground,
        "vertical_movement": not landed and abs(flight.vd_mps) > _MOVES_MPS,
        "horizontal_movement": not landed and math.hypot(flight.vn_mps, flight.ve_mps) > _MOVES_MPS,
        "close_to_ground_or_skipped_check": True,
    }


def attitude(body: Quaternion) -> Fields:
    return {"q": body, "delta_q_reset": _NO_TURN}


def local_position(flight: FlightState, body: Quaternion, force_mps2: Vector) -> Fields:
    """VehicleLocalPosition; `force_mps2` is what the accelerometer measures."""
    north, east, down = turned_to_ned(body, force_mps2)
    placed, known, origin = is_placed(flight), knows_position(flight), flight.origin
    return {
        **dict.fromkeys(("xy_valid", "v_xy_valid", "xy_global"), placed),
        **dict.fromkeys(("z_valid", "v_z_valid", "z_global"), known),
        **dict(zip("xyz", _position_ned(flight), strict=True)),
        **dict(zip(("vx", "vy", "vz"), _velocity_ned(flight), strict=True)),
        "z_deriv": flight.vd_mps,
        **dict(zip(("ax", "ay", "az"), (north, east, down + _GRAVITY_MPS2), strict=True)),
        "heading": flight.yaw_rad,
        "unaided_heading": _NAN,
        "heading_good_for_control": True,
        "ref_lat": origin.latitude_e7 * 1e-7,
        "ref_lon": origin.longitude_e7 * 1e-7,
        "ref_alt": origin.altitude_m,
        "dist_bottom": -flight.down_m,
        **_SIGMAS,
        "evh": _SPEED_SIGMA_MPS,
        "evv": _SPEED_SIGMA_MPS,
        "dead_reckoning": not flight.gps_ok,
        **_NO_LIMITS,
    }


def odometry(flight: FlightState, body: Quaternion) -> Fields:
    placed = is_placed(flight)
    return {
        "pose_frame": _NED,
        "position": _position_ned(flight) if placed else (_NAN,) * 3,
        "q": body,
        "velocity_frame": _NED,
        "velocity": _velocity_ned(flight) if placed else (_NAN,) * 3,
        "angular_velocity": _rates(flight),
        "position_variance": (_POSITION_SIGMA_M**2,) * 3,
        "velocity_variance": (_SPEED_SIGMA_MPS**2,) * 3,
    }


def global_position(flight: FlightState) -> Fields:
    return {
        "lat": flight.latitude_e7 * 1e-7,
        "lon": flight.longitude_e7 * 1e-7,
        "alt": flight.altitude_m,
        "alt_ellipsoid": flight.altitude_m,
        "lat_lon_valid": is_placed(flight),
        "alt_valid": True,
        **_SIGMAS,
        "terrain_alt": _NAN,
        "dead_reckoning": not flight.gps_ok,
    }


def sensor_combined(flight: FlightState, force_mps2: Vector) -> Fields:
    interval_us = round(flight.step_s * 1e6)
    return {
        "gyro_rad": _rates(flight),
        "gyro_integral_dt": interval_us,
        "accelerometer_m_s2": force_mps2,
        "accelerometer_integral_dt": interval_us,
    }


def gps_position(flight: FlightState, quality: GpsQuality, lost_fix_type: int) -> Fields:
    """SensorGps: the receiver's last fix."""
    ok = flight.gps_ok
    return {
        "latitude_deg": flight.fix_e7[0] * 1e-7,
        "longitude_deg": flight.fix_e7[1] * 1e-7,
        "altitude_msl_m": flight.fix_altitude_m,
        "altitude_ellipsoid_m": flight.fix_altitude_m,
        "fix_type": quality.fix_type if ok else lost_fix_type,
        "eph": quality.h_acc_mm * 1e-3,
        "epv": quality.v_acc_mm * 1e-3,
        "hdop": quality.eph * 1e-2,
        "vdop": quality.epv * 1e-2,
        "vel_m_s": math.hypot(flight.vn_mps, flight.ve_mps),
        **dict(zip(("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"), _velocity_ned(flight), strict=True)),
        "cog_rad": math.atan2(flight.ve_mps, flight.vn_mps),
        "vel_ned_valid": ok,
        "time_utc_usec": flight.unix_start_us + flight.time_us,
        "satellites_used": quality.satellites if ok else 0,
        "heading": _NAN,
        "heading_offset": _NAN,
    }


def battery_status(flight: FlightState, volts: float, used_mah: float, warning: int) -> Fields:
    return {
        "connected": True,
        "voltage_v": volts,
        "current_a": flight.battery_a,
        "current_average_a": flight.battery_a,
        "discharged_mah": used_mah,
        "remaining": flight.battery_fraction,
        "scale": 1.0,
        "time_remaining_s": _NAN,
        "temperature": _NAN,
        "id": 1,
        "warning": warning,
    }


def home_position(home: ReferencePoint) -> Fields:
    return {
        "lat": home.latitude_e7 * 1e-7,
        "lon": home.longitude_e7 * 1e-7,
        "alt": home.altitude_m,
        "x": home.north_m,
        "y": home.east_m,
        "z": home.down_m,
        "yaw": home.yaw_rad,
        **dict.fromkeys(("valid_alt", "valid_hpos", "valid_lpos"), True),
    }


def _position_ned(flight: FlightState) -> Vector:
    return flight.north_m, flight.east_m, flight.down_m


def _velocity_ned(flight: FlightState) -> Vector:
    return flight.vn_mps, flight.ve_mps, flight.vd_mps


def _rates(flight: FlightState) -> Vector:
    return flight.p_radps, flight.q_radps, flight.r_radps
