"""The laws of motion by themselves, beside another way to write them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vehicle_models.controller.state._shaping import AxisShaping, StraightLine


def asked_mps(axis: AxisShaping, distance_m: float) -> float:
    """The velocity that the cascade asks for, as x500.xml computes it."""
    at_m = max(distance_m, axis.near_m)
    speed = math.sqrt(axis.base_m2ps2 + 2.0 * axis.brake_mps2 * at_m) - axis.offset_mps
    return speed / at_m * distance_m


def px4_mps(accel_mps2: float, jerk_mps3: float, distance_m: float) -> float:
    """The solution of v^2 + 4 a^2 / j v - 2 a d = 0."""
    return float(max(np.roots([1.0, 4.0 * accel_mps2**2 / jerk_mps3, -2.0 * accel_mps2 * distance_m]).real))


def ardupilot_mps(accel_mps2: float, jerk_mps3: float, distance_m: float) -> float:
    """In proportion up to where the square root has the same value and slope."""
    gain, brake = 0.5 * jerk_mps3 / accel_mps2, 0.5 * accel_mps2
    linear_m = brake / gain**2
    if distance_m <= linear_m:
        return gain * distance_m
    return math.sqrt(2.0 * brake * (distance_m - 0.5 * linear_m))


def test_both_autopilots_approaches_are_those_of_their_sources() -> None:
    random = np.random.default_rng(1)
    for accel, jerk, distance in random.uniform((0.5, 1.0, 0.01), (6.0, 12.0, 40.0), (200, 3)):
        px4 = AxisShaping.with_braking_delay(accel, jerk)
        assert asked_mps(px4, distance) == pytest.approx(px4_mps(accel, jerk, distance), rel=1e-6)
        ardupilot = AxisShaping.with_square_root(accel, jerk)
        assert asked_mps(ardupilot, distance) == pytest.approx(ardupilot_mps(accel, jerk, distance), rel=1e-6)


def test_a_straight_line_keeps_its_limits_and_arrives() -> None:
    """Over random lengths and limits: way and speed are the integrals of speed and acceleration, nothing exceeds its
    limit, and it ends at rest at its length. Some lines reach the speed and some do not.
    """
    random = np.random.default_rng(2)
    reached = []
    for length, speed, accel, jerk in random.uniform((0.05, 0.5, 0.5, 0.5), (80.0, 12.0, 4.0, 8.0), (60, 4)):
        line = StraightLine(length, speed, accel, jerk)
        times, step = np.linspace(0.0, line.duration_s, 1001, retstep=True)
        ways, speeds, accels = np.array([line.at(time) for time in times]).T
        assert (ways[0], speeds[0]) == (0.0, 0.0)
        assert (ways[-1], speeds[-1]) == pytest.approx((length, 0.0), abs=1e-9)
        assert np.diff(ways) == pytest.approx(
            0.5 * step * (speeds[1:] + speeds[:-1]), abs=0.1 * jerk * step**3
        )
        assert np.diff(speeds) == pytest.approx(
            0.5 * step * (accels[1:] + accels[:-1]), abs=step * step * jerk
        )
        assert speeds.max() <= speed * (1 + 1e-9)
        assert np.abs(accels).max() <= accel * (1 + 1e-9)
        assert np.abs(np.diff(accels)).max() <= jerk * step * (1 + 1e-6)
        reached.append(speeds.max() > 0.999 * speed)
    assert 5 < sum(reached) < 55


def test_a_line_of_no_length_is_over_at_once() -> None:
    line = StraightLine(0.0, 5.0, 2.5, 1.0)
    assert line.duration_s == 0.0
    assert line.at(0.0) == (0.0, 0.0, 0.0)
