"""Messages of sensors: inertial, pressure, satellite navigation, distance, wind."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..links._frames import heading_cdeg, int16
from ..policies._telemetry import TelemetryPolicy
from ..state._service import Stream, Values
from ..state._service_context import ServiceContext
from ._attitude import AttitudeCache, turned_to_body

_SEA_LEVEL_HPA = 1013.25
_STANDARD_GRAVITY_MPS2 = 9.80665
# Earth's field over Zurich in gauss, north, east, down, shown anywhere: there is no model of it here.
_FIELD_NED = (0.2146, 0.0133, 0.4329)
# HIGHRES_IMU.fields_updated
_ALL_FIELDS_UPDATED = 0x1FFF
_TEMPERATURE_C, _CASE_TEMPERATURE_CDEG, _PRESSURE_TEMPERATURE_CDEG = 15.0, 3500, 1500
# MAV_SENSOR_ORIENTATION
_FACING_DOWN = 25


class SensorTelemetry:
    """Values in wire order. The second and third of a sensor show what the first does."""

    def __init__(self, context: ServiceContext, policy: TelemetryPolicy, attitude: AttitudeCache) -> None:
        self._context = context
        self._flight = context.flight
        self._policy = policy
        self._body = attitude

    def streams(self) -> Mapping[str, Stream]:
        return {
            "HIGHRES_IMU": self._highres_imu,
            "RAW_IMU": self._raw_imu,
            "SCALED_IMU": self._scaled_imu,
            "SCALED_IMU2": self._scaled_imu,
            "SCALED_IMU3": self._scaled_imu,
            "SCALED_PRESSURE": self._pressure,
            "SCALED_PRESSURE2": self._pressure,
            "GPS_RAW_INT": self._gps,
            "DISTANCE_SENSOR": self._distance,
            "WIND": lambda: self._policy.wind(self._flight),
        }

    def _highres_imu(self) -> Values:
        f = self._flight
        force = self._context.airframe.specific_force_mps2()
        field = turned_to_body(self._body.now(), _FIELD_NED)
        air = (_pressure_hpa(f.altitude_m), 0.0, f.altitude_m, _TEMPERATURE_C)
        return (f.time_us, *force, f.p_radps, f.q_radps, f.r_radps, *field, *air, _ALL_FIELDS_UPDATED, 0)

    def _raw_imu(self) -> Values:
        f = self._flight
        force = self._context.airframe.specific_force_mps2()
        force_mg = (int16(axis / _STANDARD_GRAVITY_MPS2 * 1000.0) for axis in force)
        rates = (int16(rate * 1000.0) for rate in (f.p_radps, f.q_radps, f.r_radps))
        field = (int16(axis * 1000.0) for axis in turned_to_body(self._body.now(), _FIELD_NED))
        return (f.time_us, *force_mg, *rates, *field, 0, _CASE_TEMPERATURE_CDEG)

    def _scaled_imu(self) -> Values:
        _, *axes, _, temperature = self._raw_imu()
        return (self._flight.time_ms, *axes, temperature)

    def _pressure(self) -> Values:
        f = self._flight
        return (f.time_ms, _pressure_hpa(f.altitude_m), 0.0, _PRESSURE_TEMPERATURE_CDEG, 0)

    def _gps(self) -> Values:
        f, quality = self._flight, self._policy.gps_quality
        speed = math.hypot(f.vn_mps, f.ve_mps)
        # A slow receiver reports no meaningful course.
        course = heading_cdeg(math.atan2(f.ve_mps, f.vn_mps)) if speed > 0.1 else 0
        altitude = round(f.fix_altitude_m * 1000.0)
        if not f.gps_ok:
            unknown = (65535, 65535, 65535, 65535, self._policy.lost_fix_type, 0)
            return (f.fix_us, *f.fix_e7, altitude, *unknown, altitude, *(0,) * 5)
        motion = (quality.eph, quality.epv, min(round(speed * 100.0), 65534), course)
        head = (f.fix_us, *f.fix_e7, altitude, *motion, quality.fix_type, quality.satellites)
        return (*head, altitude, quality.h_acc_mm, quality.v_acc_mm, 400, 0, 0)

    def _distance(self) -> Values:
        down_cm = min(max(round(-self._flight.down_m * 100.0), 10), 4000)
        return (self._flight.time_ms, 10, 4000, down_cm, 0, 0, _FACING_DOWN, 0, *(0.0,) * 6, 0)


def _pressure_hpa(altitude_m: float) -> float:
    """International standard atmosphere below 11 km."""
    return _SEA_LEVEL_HPA * float((1.0 - 2.25577e-5 * altitude_m) ** 5.25588)
