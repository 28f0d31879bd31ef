"""Sensors that the bench simulates for PX4, against the stated figures and against independent formulas."""

from __future__ import annotations

import datetime as dt
import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vehicle_models.controller import turned_to_body
from vehicle_models.controller.telemetry._attitude import turned_to_ned
from vehicle_models.firmware._sensors import (
    ACCELEROMETER,
    BAROMETER,
    GYRO,
    MAGNETOMETER,
    Sensors,
    magnetic_field_ned_gauss,
)

FIELD = (0.2150, 0.0117, 0.4320)


def readings(seed: int, count: int) -> tuple[Any, Any, Any]:
    sensors = Sensors(FIELD, np.random.default_rng(seed))
    imu, magnetic, pressures = [], [], []
    for _ in range(count):
        imu.append(sensors.read_imu((0.5, -0.25, -9.81), (0.1, -0.2, 0.3)))
        magnetic.append(sensors.read_magnetometer((1.0, 0.0, 0.0, 0.0)))
        pressures.append(sensors.read_barometer(489.4).pressure_hpa)
    return np.array(imu), np.array(magnetic), np.array(pressures)


def test_noise_bias_and_resolution_are_as_stated() -> None:
    imu, magnetic, pressures = readings(7, 4000)
    exact = (0.5, -0.25, -9.81, 0.1, -0.2, 0.3)
    qualities = [ACCELEROMETER] * 3 + [GYRO] * 3
    for column, true_value, quality in zip(imu.T, exact, qualities, strict=True):
        # Rounding adds the variance of a uniform draw.
        expected = math.hypot(quality.noise, quality.resolution / math.sqrt(12))
        assert column.std() == pytest.approx(expected, rel=0.06)
        assert 0.0 < abs(column.mean() - true_value) < 4 * quality.bias
        steps = column / quality.resolution
        assert np.abs(steps - steps.round()).max() < 1e-6
    for column, true_value in zip(magnetic.T, FIELD, strict=True):
        expected = math.hypot(MAGNETOMETER.noise, MAGNETOMETER.resolution / math.sqrt(12))
        assert column.std() == pytest.approx(expected, rel=0.06)
        assert abs(column.mean() - true_value) < 4 * MAGNETOMETER.bias
    assert pressures.std() == pytest.approx(BAROMETER.noise, rel=0.06)
    # The standard atmosphere's table: 955.80 hPa at 489.4 m (interpolated between 954.61 at 500 m and 955.75 at 490 m).
    assert abs(pressures.mean() - 955.82) < 4 * BAROMETER.bias


def test_an_impact_is_cut_to_what_the_sensor_holds() -> None:
    """PX4 turns each reading into 16 bits: what is over would come out with the other sign."""
    sensors = Sensors(FIELD, np.random.default_rng(1))
    hard = sensors.read_imu((900.0, -900.0, -100.0), (60.0, -60.0, 0.5))
    assert [round(value / ACCELEROMETER.resolution) for value in hard[:2]] == [32767, -32767]
    assert [round(value / GYRO.resolution) for value in hard[3:5]] == [32767, -32767]
    assert (hard[2], hard[5]) == pytest.approx((-100.0, 0.5), abs=0.2)


def test_the_same_seed_gives_the_same_readings_and_another_seed_others() -> None:
    first, again, other = (
        np.concatenate([part.ravel() for part in readings(seed, 20)]) for seed in (1, 1, 2)
    )
    assert (first == again).all()
    assert (first != other).mean() > 0.8


def test_the_rate_of_one_sensor_leaves_the_noise_of_the_others_alone() -> None:
    one, two = (Sensors(FIELD, np.random.default_rng(3)) for _ in range(2))
    for sample in range(50):
        assert one.read_imu((0, 0, -9.81), (0, 0, 0)) == two.read_imu((0, 0, -9.81), (0, 0, 0))
        one.read_barometer(100.0)
        if sample % 5 == 0:
            assert one.read_magnetometer((1, 0, 0, 0)) == two.read_magnetometer((1, 0, 0, 0))


def test_a_vector_is_turned_into_the_body_and_back_as_rotations_turn_it() -> None:
    random = np.random.default_rng(5)
    for _ in range(50):
        rotation = Rotation.from_euler("ZYX", random.uniform(-1.5, 1.5, 3))
        w, x, y, z = rotation.as_quat(scalar_first=True).tolist()
        north, east, down = random.normal(size=3).tolist()
        body = turned_to_body((w, x, y, z), (north, east, down))
        assert body == pytest.approx(rotation.inv().apply((north, east, down)).tolist(), abs=1e-12)
        assert turned_to_ned((w, x, y, z), body) == pytest.approx((north, east, down), abs=1e-12)


def test_the_magnetic_field_is_the_published_one() -> None:
    """NOAA's test values of the model (WMM2025_TEST_VALUES.txt): nT north, east, down."""
    start, middle = dt.datetime(2025, 1, 1, tzinfo=dt.UTC), dt.datetime(2027, 7, 2, 12, tzinfo=dt.UTC)
    published = {
        (80.0, 0.0, 0.0, start): (6521.6, 145.9, 54791.5),
        (0.0, 120.0, 0.0, start): (39677.8, -109.6, -10580.2),
        (-80.0, -120.0, 0.0, start): (6117.5, 15751.9, -52022.5),
        (80.0, 0.0, 0.0, middle): (6500.8, 294.5, 54869.4),
        (0.0, 120.0, 100e3, middle): (37711.5, -148.7, -9969.8),
    }
    for place_and_date, expected in published.items():
        field = magnetic_field_ned_gauss(*place_and_date)
        # Tenths of a nT are printed; one nT is 1e-5 gauss.
        assert [axis * 1e5 for axis in field] == pytest.approx(expected, abs=0.06)


def test_a_date_beyond_the_model_gets_the_nearest_year() -> None:
    def at(year: int) -> tuple[float, ...]:
        return magnetic_field_ned_gauss(47.4, 8.5, 489.0, dt.datetime(year, 1, 1, tzinfo=dt.UTC))

    assert at(2040) == at(2030)
    assert at(1999) == at(2010)
    assert at(2012) != at(2022) != at(2027)


def test_barometer_heights_are_those_of_the_standard_atmosphere() -> None:
    sensors = Sensors(FIELD, np.random.default_rng(0))
    # ISO 2533, geopotential height.
    table = ((0.0, 1013.25, 15.0), (1000.0, 898.76, 8.5), (3000.0, 701.21, -4.5))
    for height_m, pressure_hpa, temperature_degc in table:
        sensors.read_imu((0, 0, -9.81), (0, 0, 0))
        air = sensors.read_barometer(height_m)
        assert air.pressure_hpa == pytest.approx(pressure_hpa, abs=0.3)
        assert air.temperature_degc == pytest.approx(temperature_degc)
        assert air.pressure_altitude_m == pytest.approx(height_m, abs=4.0)
