"""What each streamed message says of the flight: one function a message, values in wire order."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from bench.contracts import Vector

from .._flight import Flight
from .._service_context import ServiceContext
from ..links._frames import KINDS
from ._auxiliary import MoreTelemetry

Values = tuple[Any, ...]
_NAN = math.nan
_NAN4 = (_NAN,) * 4
_COVARIANCES = (_NAN, *(0.0,) * 20) * 2  # of pose and velocity: none is known
_SEA_LEVEL_HPA = 1013.25
_GPS, _XY_CONTROL = 0x20, 0x4000  # MAV_SYS_STATUS_SENSOR
_BY_GPS = 8 | 16 | 256 | 512  # ESTIMATOR_STATUS_FLAGS: horizontal position, and its prediction
# Earth's field over Zurich in gauss, north, east, down; what a magnetometer shows anywhere here. No model of the field.
_FIELD_NED = (0.2146, 0.0133, 0.4329)


def quaternion(flight: Flight) -> tuple[float, float, float, float]:
    """w, x, y, z of the body (FRD) against north-east-down."""
    return attitude_quaternion(flight.roll_rad, flight.pitch_rad, flight.yaw_rad)


def attitude_quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """w, x, y, z of an attitude against north-east-down, radians."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


class Body:
    """How the body lies against north-east-down at one moment, `time_ns`; `quaternion` is w, x, y, z."""

    __slots__ = ("_rows", "quaternion", "time_ns")

    def __init__(self, flight: Flight) -> None:
        self.time_ns = flight.time_ns
        self.quaternion = w, x, y, z = quaternion(flight)
        self._rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
            (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
            (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
        )

    def turned(self, north: float, east: float, down: float) -> Vector:
        """A north-east-down vector in the body's frame."""
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        return (a * north + b * east + c * down, d * north + e * east + f * down, g * north + h * east + i * down)


class Telemetry:
    """The functions by message id. A function returns None when there is nothing to say now."""

    def __init__(self, board: ServiceContext) -> None:
        self._board = board
        self._flight = board.flight
        self._ping = 0
        self._body_now = Body(board.flight)
        by_name: dict[str, Callable[[], Values | None]] = {  # in the order in which a step says them
            "HEARTBEAT": self._heartbeat,
            "ATTITUDE": self._attitude,
            "ATTITUDE_QUATERNION": self._attitude_quaternion,
            "LOCAL_POSITION_NED": self._local_position,
            "GLOBAL_POSITION_INT": self._global_position,
            "ODOMETRY": self._odometry,
            "HIGHRES_IMU": self._highres_imu,
            "RAW_IMU": self._raw_imu,
            "SERVO_OUTPUT_RAW": self._servos,
            "ATTITUDE_TARGET": self._attitude_target,
            "POSITION_TARGET_LOCAL_NED": self._local_target,
            "POSITION_TARGET_GLOBAL_INT": self._global_target,
            "GPS_RAW_INT": self._gps,
            "VFR_HUD": self._hud,
            "ALTITUDE": self._altitude,
            "DISTANCE_SENSOR": self._distance,
            "TIMESYNC": lambda: (0, self._flight.time_ns, 0, 0),
            "SYS_STATUS": self._sys_status,
            "EXTENDED_SYS_STATE": lambda: (board.personality.vtol_state, int(self._flight.landed)),
            "SYSTEM_TIME": lambda: (self._flight.unix_start_us + self._flight.time_us, self._flight.time_ms),
            "PING": self._say_ping,
            "SCALED_PRESSURE": self._pressure,
            "MISSION_CURRENT": lambda: self.mission_current(),
            "FENCE_STATUS": lambda: self.fence_status(),
            "ESTIMATOR_STATUS": self._estimator,
            "BATTERY_STATUS": self._battery,
            "HOME_POSITION": self._home,
            "CURRENT_MODE": self._current_mode,
            "CURRENT_EVENT_SEQUENCE": lambda: (self.event_sequence(), 0),
            "GPS_GLOBAL_ORIGIN": self._origin,
            "ORBIT_EXECUTION_STATUS": lambda: self.orbit(),
            "VIBRATION": lambda: (self._flight.time_us, 0.0, 0.0, 0.0, 0, 0, 0),
            "POWER_STATUS": lambda: (5000, 0, 0),
            "MEMINFO": lambda: (0, 65535, 131072),
            "NAV_CONTROLLER_OUTPUT": self._nav_output,
            "RC_CHANNELS": self._sticks,
            "AHRS": lambda: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            "AHRS2": self._ahrs2,
            "EKF_STATUS_REPORT": lambda: (0.0, 0.0, 0.0, 0.0, 0.0, board.personality.estimator_flags(self._flight), 0.0),
        }
        by_name.update(MoreTelemetry(board, self._raw_imu, self._pressure).says())
        self.say: dict[int, Callable[[], Values | None]] = {KINDS[name].id: do for name, do in by_name.items()}
        self.orbit: Callable[[], Values | None] = lambda: None
        self.has_setpoints: Callable[[], bool] = lambda: False
        self.event_sequence: Callable[[], int] = lambda: 0
        self.mission_current: Callable[[], Values] = lambda: (0, board.personality.no_mission_total, 1, 2, 0, 0, 0)
        self.fence_status: Callable[[], Values | None] = lambda: None
        self.charge_state: Callable[[], int] = lambda: 1

    def _body(self) -> Body:
        """That of the present moment, worked out once for all messages of a step."""
        if self._body_now.time_ns != self._flight.time_ns:
            self._body_now = Body(self._flight)
        return self._body_now

    def _heartbeat(self) -> Values:
        flight, personality = self._flight, self._board.personality
        base, status = personality.heartbeat(flight, self.has_setpoints())
        return (flight.mode.custom, personality.vehicle_type, personality.autopilot, base, status, 3)

    def _attitude(self) -> Values:
        f = self._flight
        return (f.time_ms, f.roll_rad, f.pitch_rad, f.yaw_rad, f.p_radps, f.q_radps, f.r_radps)

    def _attitude_quaternion(self) -> Values:
        f = self._flight
        return (f.time_ms, *self._body().quaternion, f.p_radps, f.q_radps, f.r_radps, 0.0, 0.0, 0.0, 0.0)

    def _local_position(self) -> Values | None:
        f = self._flight
        if f.home is None:
            return None
        return (f.time_ms, f.north_m, f.east_m, f.down_m, f.vn_mps, f.ve_mps, f.vd_mps)

    def _global_position(self) -> Values | None:
        f = self._flight
        if f.home is None:
            return None
        return (
            f.time_ms,
            f.latitude_e7,
            f.longitude_e7,
            round(f.altitude_m * 1000.0),
            round(f.height_m * 1000.0),
            _centi(f.vn_mps),
            _centi(f.ve_mps),
            _centi(f.vd_mps),
            _heading_cdeg(f.yaw_rad),
        )

    def _odometry(self) -> Values | None:
        f = self._flight
        if f.home is None:
            return None
        body = self._body()
        speed = body.turned(f.vn_mps, f.ve_mps, f.vd_mps)
        rates = (f.p_radps, f.q_radps, f.r_radps)
        # frame 1 LOCAL_NED, child 12 BODY_FRD, estimator 8 AUTOPILOT
        return (f.time_us, f.north_m, f.east_m, f.down_m, *body.quaternion, *speed, *rates, *_COVARIANCES, 1, 12, 0, 8, 100)

    def _highres_imu(self) -> Values:
        f = self._flight
        force = self._board.airframe.specific_force_mps2()
        field = self._body().turned(*_FIELD_NED)
        pressure = _pressure_hpa(f.altitude_m)
        return (f.time_us, *force, f.p_radps, f.q_radps, f.r_radps, *field, pressure, 0.0, f.altitude_m, 15.0, 0x1FFF, 0)

    def _raw_imu(self) -> Values:
        f = self._flight
        force = (_int16(one / 9.80665 * 1000.0) for one in self._board.airframe.specific_force_mps2())
        rates = (_int16(one * 1000.0) for one in (f.p_radps, f.q_radps, f.r_radps))
        field = (_int16(one * 1000.0) for one in self._body().turned(*_FIELD_NED))
        return (f.time_us, *force, *rates, *field, 0, 3500)

    def _servos(self) -> Values:
        outputs = [1000 + round(1000.0 * one) for one in self._board.airframe.outputs()]
        return (self._flight.time_us & 0xFFFFFFFF, *outputs, 0, 0, 0, 0, 0, *(0,) * 8)

    def _attitude_target(self) -> Values | None:
        f = self._flight
        roll, pitch, yaw, thrust = self._board.airframe.wanted_attitude()
        attitude = f.target.attitude
        rates = attitude.rates_radps if attitude and attitude.rates_radps else (0.0, 0.0, f.target.yawrate_radps)
        return (f.time_ms, *attitude_quaternion(roll, pitch, yaw), *rates, thrust, 0)

    def _local_target(self) -> Values | None:
        """NaN for what is not controlled, and the mask says so."""
        f, t = self._flight, self._flight.target
        personality = self._board.personality
        if not f.armed and personality.echo_modes is None:
            return (f.time_ms, *(_NAN,) * 11, 7, 1)
        if not f.armed or not self._echoes():
            return None
        place = t.north_east_m or (_NAN, _NAN)
        down = t.down_m if t.down_m is not None else _NAN
        mask = (3 if t.north_east_m is None else 0) | (4 if t.down_m is None else 0)
        fixed = personality.echo_velocity_mask if mask else personality.echo_position_mask
        yaw = t.yaw_rad if t.yaw_rad is not None else _NAN
        motion = (*t.velocity_ned_mps, *t.acceleration_ned_mps2)
        return (f.time_ms, *place, down, *motion, yaw, t.yawrate_radps, mask if fixed is None else fixed, 1)

    def _echoes(self) -> bool:
        modes = self._board.personality.echo_modes
        return modes is None or self._flight.mode.behaviour in modes

    def _global_target(self) -> Values | None:
        f, t = self._flight, self._flight.target
        if not f.armed or t.north_east_m is None or t.down_m is None or not self._echoes():
            return None
        lat, lon = self._board.airframe.to_geodetic_e7(*t.north_east_m)
        altitude = f.origin.altitude_m - t.down_m
        yaw = t.yaw_rad if t.yaw_rad is not None else _NAN
        motion = (*t.velocity_ned_mps, *t.acceleration_ned_mps2)
        return (f.time_ms, lat, lon, altitude, *motion, yaw, t.yawrate_radps, 65016, 0)

    def _gps(self) -> Values:
        f = self._flight
        speed = math.hypot(f.vn_mps, f.ve_mps)
        course = _heading_cdeg(math.atan2(f.ve_mps, f.vn_mps)) if speed > 0.1 else 0
        altitude = round(f.fix_altitude_m * 1000.0)
        fix = self._board.personality.gps_fields
        if not f.gps_ok:
            lost = (65535, 65535, 65535, 65535, self._board.personality.lost_fix_type, 0)
            return (0, *f.fix_e7, altitude, *lost, altitude, *(0,) * 5)
        head = (0, *f.fix_e7, altitude, fix.eph, fix.epv, min(round(speed * 100.0), 65534), course, fix.fix_type, 10)
        return (*head, altitude, fix.h_acc_mm, fix.v_acc_mm, 400, 0, 0)

    def _hud(self) -> Values:
        f = self._flight
        outputs = self._board.airframe.outputs()
        heading = round(math.degrees(f.yaw_rad)) % 360
        throttle = round(100.0 * sum(outputs) / len(outputs))
        return (f.airspeed_mps, math.hypot(f.vn_mps, f.ve_mps), f.altitude_m, -f.vd_mps, heading, throttle)

    def _altitude(self) -> Values:
        f = self._flight
        above = -f.down_m
        return (f.time_us, f.altitude_m, f.altitude_m, above, f.height_m, _NAN, above)

    def _distance(self) -> Values:
        down_cm = min(max(round(-self._flight.down_m * 100.0), 10), 4000)
        return (self._flight.time_ms, 10, 4000, down_cm, 0, 0, 25, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)  # 25: downwards

    def _sys_status(self) -> Values:
        f = self._flight
        bits = self._board.personality.sensors(f)
        current = _centi(f.battery_a)
        remaining = round(100.0 * f.battery_fraction)
        battery = (self._board.personality.load_permille, self._millivolts(), current)
        health = bits.health if f.gps_ok else bits.health & ~(_GPS if f.position_ok else _GPS | _XY_CONTROL)
        return (bits.present, bits.enabled, health, *battery, 0, 0, 0, 0, 0, 0, remaining, 0, 0, 0)

    def _say_ping(self) -> Values:
        self._ping = (self._ping + 1) & 0xFFFFFFFF
        return (self._flight.time_us, self._ping, 0, 0)

    def _pressure(self) -> Values:
        f = self._flight
        return (f.time_ms, _pressure_hpa(f.altitude_m), 0.0, 1500, 0)

    def _estimator(self) -> Values:
        f = self._flight
        return (
            f.time_us,
            0.01,
            0.02,
            0.02,
            _NAN,
            0.0,
            _NAN,
            0.3,
            0.3,
            (1023 if f.position_ok else 1023 & ~_BY_GPS) if f.home else 0,
        )

    def _battery(self) -> Values:
        f = self._flight
        cells = (self._millivolts(), *(65535,) * 9)
        used_mah = round(f.battery_used_wh / 14.8 * 1000.0)
        left, kind = round(100.0 * f.battery_fraction), self._board.personality.battery_type
        return (used_mah, -1, 32767, *cells, _centi(f.battery_a), 0, 0, kind, left, 0, self.charge_state(), 0, 0, 0, 0, 0, 0)

    def _millivolts(self) -> int:
        return max(round(self._board.personality.battery_volts(self._flight, self._board.parameters) * 1000.0), 0)

    def _current_mode(self) -> Values:
        mode = self._flight.mode
        return (mode.custom, mode.custom, self._board.personality.standard_modes.get(mode.name, 0))

    def _home(self) -> Values | None:
        home = self._flight.home
        if home is None:
            return None
        place = (home.latitude_e7, home.longitude_e7, round(home.altitude_m * 1000.0), home.north_m, home.east_m, home.down_m)
        return (*place, *_NAN4, _NAN, _NAN, _NAN, self._flight.time_us)

    def _origin(self) -> Values | None:
        if self._flight.home is None:
            return None
        origin = self._flight.origin
        return (origin.latitude_e7, origin.longitude_e7, round(origin.altitude_m * 1000.0), self._flight.time_us)

    def _nav_output(self) -> Values:
        f, t = self._flight, self._flight.target
        place = t.north_east_m or (f.north_m, f.east_m)
        north, east = place[0] - f.north_m, place[1] - f.east_m
        bearing = round(math.degrees(math.atan2(east, north)))
        rise = f.down_m - t.down_m if t.down_m is not None else 0.0
        attitude = (math.degrees(f.roll_rad), math.degrees(f.pitch_rad), rise, 0.0, 0.0)
        return (*attitude, bearing, bearing, min(round(math.hypot(north, east)), 65535))

    def _sticks(self) -> Values:
        return (self._flight.time_ms, *self._flight.rc_us, *(0,) * 10, 16, 255)

    def _ahrs2(self) -> Values:
        f = self._flight
        return (f.roll_rad, f.pitch_rad, f.yaw_rad, f.altitude_m, f.latitude_e7, f.longitude_e7)


def _heading_cdeg(yaw_rad: float) -> int:
    return round(math.degrees(yaw_rad) * 100.0) % 36000


def _int16(value: float) -> int:
    return round(value) if -32768.0 <= value <= 32767.0 else round(min(max(value, -32768.0), 32767.0))


def _centi(value: float) -> int:
    return _int16(value * 100.0)


def _pressure_hpa(altitude_m: float) -> float:
    """International standard atmosphere below 11 km."""
    return _SEA_LEVEL_HPA * float((1.0 - 2.25577e-5 * altitude_m) ** 5.25588)
