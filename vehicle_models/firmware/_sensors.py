"""Sensors that the bench simulates for PX4, which has none of its own in simulation: IMU, magnetometer, barometer.

The noise is what real PX4 was flown with on this aircraft (docs/real-autopilots.md). The biases are chosen, as small as
a calibrated sensor leaves them. They are drawn once for a session. Satellite navigation is `vehicle_models/_navigation.py`,
the magnetic field of a place at a date the World Magnetic Model of NOAA and the British Geological Survey.
"""

from __future__ import annotations

import datetime as dt
import math
from dataclasses import dataclass

import numpy as np
from pygeomag import GeoMag

from bench.contracts import Vector

from ..controller import turned_to_body

_G = 9.80665
_BLOCK = 1024
_DRAWS = 10
# ISA: temperature and pressure at sea level, lapse rate, exponent g M / (R L).
_SEA_LEVEL_K, _SEA_LEVEL_HPA, _LAPSE_KPM, _EXPONENT = 288.15, 1013.25, 0.0065, 5.25588
_KELVIN = 273.15
_GAUSS_PER_NT = 1e-5
# First year and coefficients of each edition. An edition holds for five years.
_EDITIONS = (
    (2025.0, "wmm/WMM_2025.COF"),
    (2020.0, "wmm/WMM_2020.COF"),
    (2015.0, "wmm/WMM_2015v2.COF"),
    (2010.0, "wmm/WMM_2010.COF"),
)
_VALID_YEARS = 5.0


@dataclass(frozen=True, slots=True)
class SensorQuality:
    """White noise (one standard deviation of each sample), bias (likewise, drawn once), and smallest step of a sensor."""

    noise: float
    bias: float
    resolution: float


# 16 bits over +-16 g and +-2000 deg/s, which is also what PX4 turns the readings of its first IMU into.
ACCELEROMETER = SensorQuality(noise=0.03, bias=0.02, resolution=_G / 2048.0)  # m/s2
GYRO = SensorQuality(noise=0.003, bias=0.001, resolution=math.radians(2000.0 / 32768.0))  # rad/s
_MOST_COUNTS = 32767
MAGNETOMETER = SensorQuality(noise=0.001, bias=0.002, resolution=0.0015)  # gauss; 0.15 uT a step
BAROMETER = SensorQuality(noise=0.01, bias=0.05, resolution=0.0012)  # hPa; 1 cm of height a step


@dataclass(frozen=True, slots=True)
class AirReading:
    """What a barometer says."""

    pressure_hpa: float
    pressure_altitude_m: float
    temperature_degc: float


class Sensors:
    """The sensors of one vehicle in a field of `field_ned_gauss`; every draw comes from `random`."""

    def __init__(self, field_ned_gauss: Vector, random: np.random.Generator) -> None:
        self._field = field_ned_gauss
        self._random = random
        self._draws: list[list[float]] = []
        a, b, c, d, e, f, g, h, i, j = random.standard_normal(_DRAWS).tolist()
        self._accelerometer_bias = (a * ACCELEROMETER.bias, b * ACCELEROMETER.bias, c * ACCELEROMETER.bias)
        self._gyro_bias = (d * GYRO.bias, e * GYRO.bias, f * GYRO.bias)
        self._magnetometer_bias = (g * MAGNETOMETER.bias, h * MAGNETOMETER.bias, i * MAGNETOMETER.bias)
        self._barometer_bias = j * BAROMETER.bias
        self._later: list[float] = []

    def read_imu(self, specific_force_mps2: Vector, rates_radps: Vector) -> tuple[float, ...]:
        """Accelerometer (m/s2) and gyro (rad/s), body FRD. Begins a sample: the readings below belong to it."""
        if not self._draws:
            self._draws = self._random.standard_normal((_BLOCK, _DRAWS)).tolist()
        # Every sample takes all its draws, so that the noise of one sensor never depends on the rate of another.
        a, b, c, d, e, f, *self._later = self._draws.pop()
        x, y, z = specific_force_mps2
        p, q, r = rates_radps
        bias_x, bias_y, bias_z = self._accelerometer_bias
        bias_p, bias_q, bias_r = self._gyro_bias
        noise, step = ACCELEROMETER.noise, ACCELEROMETER.resolution
        turn_noise, turn_step = GYRO.noise, GYRO.resolution
        counts = (
            round((x + bias_x + noise * a) / step),
            round((y + bias_y + noise * b) / step),
            round((z + bias_z + noise * c) / step),
            round((p + bias_p + turn_noise * d) / turn_step),
            round((q + bias_q + turn_noise * e) / turn_step),
            round((r + bias_r + turn_noise * f) / turn_step),
        )
        if max(counts) > _MOST_COUNTS or min(counts) < -_MOST_COUNTS:
            # An impact. PX4 turns the readings into 16 bits without a look at their size.
            counts = tuple(min(max(count, -_MOST_COUNTS), _MOST_COUNTS) for count in counts)
        ax, ay, az, turn_x, turn_y, turn_z = counts
        return ax * step, ay * step, az * step, turn_x * turn_step, turn_y * turn_step, turn_z * turn_step

    def read_magnetometer(self, attitude: tuple[float, float, float, float]) -> tuple[float, ...]:
        """The field in the body (FRD), gauss; `attitude` is the quaternion w, x, y, z of the body against NED."""
        return tuple(
            _stepped(value + bias + MAGNETOMETER.noise * draw, MAGNETOMETER.resolution)
            for value, bias, draw in zip(
                turned_to_body(attitude, self._field), self._magnetometer_bias, self._later, strict=False
            )
        )

    def read_barometer(self, altitude_m: float) -> AirReading:
        """Pressure at a height above mean sea level, in the international standard atmosphere."""
        kelvin = _SEA_LEVEL_K - _LAPSE_KPM * altitude_m
        exact_hpa = _SEA_LEVEL_HPA * (kelvin / _SEA_LEVEL_K) ** _EXPONENT
        noisy_hpa = exact_hpa + self._barometer_bias + BAROMETER.noise * self._later[3]
        pressure_hpa = _stepped(noisy_hpa, BAROMETER.resolution)
        ratio = (pressure_hpa / _SEA_LEVEL_HPA) ** (1.0 / _EXPONENT)
        return AirReading(pressure_hpa, _SEA_LEVEL_K / _LAPSE_KPM * (1.0 - ratio), kelvin - _KELVIN)


def _stepped(value: float, resolution: float) -> float:
    return round(value / resolution) * resolution


def magnetic_field_ned_gauss(
    latitude_deg: float, longitude_deg: float, altitude_m: float, date: dt.datetime
) -> Vector:
    """The field, north, east, down, in gauss. A date outside 2010 to 2030 gets the field of the nearest year of those.

    Declination changes by 0.1 to 0.2 degrees a year at most places, so the nearest year is closer than what autopilots
    correct from their own tables.
    """
    year = _decimal_year(date)
    first_year, coefficients = next((edition for edition in _EDITIONS if year >= edition[0]), _EDITIONS[-1])
    year = min(max(year, first_year), first_year + _VALID_YEARS)
    field = GeoMag(coefficients_file=coefficients).calculate(
        glat=latitude_deg, glon=longitude_deg, alt=altitude_m / 1000.0, time=year
    )
    return field.x * _GAUSS_PER_NT, field.y * _GAUSS_PER_NT, field.z * _GAUSS_PER_NT


def _decimal_year(date: dt.datetime) -> float:
    start = dt.datetime(date.year, 1, 1, tzinfo=dt.UTC)
    end = dt.datetime(date.year + 1, 1, 1, tzinfo=dt.UTC)
    return date.year + (date - start) / (end - start)
