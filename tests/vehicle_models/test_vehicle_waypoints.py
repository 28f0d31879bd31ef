"""The laws of motion: approaches and lines by themselves; how missions pass their waypoints, also flown."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from test_vehicle_missions import ready_ardupilot, start_ardupilot, start_px4, to, upload
from vehicle_client import Client, Make, simspec

from bench.contracts import Vector
from vehicle_models.controller import ARDUPILOT, PX4, FlightState, ReferencePoint
from vehicle_models.controller.guidance._waypoints import PathSegment, WaypointApproach, WaypointPath
from vehicle_models.controller.state._flight_limits import FlightLimits, PathLimits
from vehicle_models.controller.state._parameter_store import ParameterStore
from vehicle_models.controller.state._shaping import AxisShaping, StraightLine

STEP_NS = 20_000_000


def limits_of(autopilot: str, **parameters: float) -> FlightLimits:
    policy = {"px4": PX4, "ardupilot": ARDUPILOT}[autopilot].parameters
    return policy.limits(ParameterStore(policy.definitions, parameters))


def px4_mps(accel_mps2: float, jerk_mps3: float, distance_m: float, final_mps: float) -> float:
    """The solution of v^2 + 4 a^2 / j v - 2 a d - final^2 = 0, and at least `final_mps`."""
    roots = np.roots([1.0, 4.0 * accel_mps2**2 / jerk_mps3, -2.0 * accel_mps2 * distance_m - final_mps**2])
    return max(float(max(roots.real)), final_mps)


def asked_mps(axis: AxisShaping, distance_m: float) -> float:
    """The velocity that the cascade asks for, as x500.xml computes it."""
    at_m = max(distance_m, axis.near_m)
    speed = math.sqrt(axis.base_m2ps2 + 2.0 * axis.brake_mps2 * at_m) - axis.offset_mps
    return speed / at_m * distance_m


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
        assert asked_mps(px4, distance) == pytest.approx(px4_mps(accel, jerk, distance, 0.0), rel=1e-6)
        ardupilot = AxisShaping.with_square_root(accel, jerk)
        assert asked_mps(ardupilot, distance) == pytest.approx(ardupilot_mps(accel, jerk, distance), rel=1e-6)


def test_a_straight_line_keeps_its_limits_and_arrives() -> None:
    """Over random lengths and limits: way and speed are the integrals of speed and acceleration, nothing exceeds its
    limit, and it ends at rest at its length. Some lines reach the speed and some do not.
    """
    random = np.random.default_rng(2)
    reached = []
    for length, speed, accel, jerk in random.uniform((0.05, 0.5, 0.5, 0.5), (80.0, 12.0, 4.0, 8.0), (24, 4)):
        line = StraightLine(length, speed, accel, jerk)
        times, step = np.linspace(0.0, line.duration_s, 1001, retstep=True)
        ways, speeds, accels = np.array([line.at(time) for time in times]).T
        assert (ways[0], speeds[0]) == (0.0, 0.0)
        assert (ways[-1], speeds[-1]) == pytest.approx((length, 0.0), abs=1e-9)
        moved_m, gained_mps = (0.5 * step * (rates[1:] + rates[:-1]) for rates in (speeds, accels))
        assert np.diff(ways) == pytest.approx(moved_m, abs=0.1 * jerk * step**3)
        assert np.diff(speeds) == pytest.approx(gained_mps, abs=step * step * jerk)
        assert speeds.max() <= speed * (1 + 1e-9)
        assert np.abs(accels).max() <= accel * (1 + 1e-9)
        assert np.abs(np.diff(accels)).max() <= jerk * step * (1 + 1e-6)
        reached.append(speeds.max() > 0.999 * speed)
    assert 3 < sum(reached) < 21


def test_a_line_of_no_length_is_over_at_once() -> None:
    line = StraightLine(0.0, 5.0, 2.5, 1.0)
    assert line.duration_s == 0.0
    assert line.at(0.0) == (0.0, 0.0, 0.0)


def test_px4_passes_a_waypoint_as_fast_as_the_turn_allows() -> None:
    """Over random lines and parameters: on a circle that touches both lines at the radius the acceleration sideways is
    MPC_XY_TRAJ_P of MPC_ACC_HOR; before the waypoint the vehicle brakes to that speed.
    """
    random = np.random.default_rng(1)
    turns = 0
    for _ in range(100):
        accel, jerk, gain, cruise, radius = random.uniform((1, 2, 0.2, 2, 1), (5, 8, 1, 12, 4))
        limits = limits_of("px4", MPC_ACC_HOR=accel, MPC_JERK_AUTO=jerk, MPC_XY_TRAJ_P=gain)
        before_m, behind_m = random.uniform(10.0, 60.0, 2)
        bend = random.uniform(0.1, 3.0)
        place = (before_m, 0.0)
        following = (before_m + behind_m * math.cos(bend), behind_m * math.sin(bend))
        flight = FlightState(0.02, ReferencePoint(0, 0, 0.0), PX4.modes.initial, vn_mps=1.0)
        approach = WaypointApproach(flight, ((0.0, 0.0), place), following, radius)
        distance = random.uniform(radius + 0.1, before_m)
        flight.north_m = before_m - distance
        (north, east), speed = approach.aim(flight, limits, cruise)
        circle_m = radius / math.tan(0.5 * bend)
        turning = min(math.sqrt(gain * accel * circle_m), cruise, px4_mps(accel, jerk, behind_m, 0.0))
        assert speed == pytest.approx(min(cruise, px4_mps(accel, jerk, distance, turning)), rel=1e-6)
        assert (north > before_m, abs(east) < 1e-9) == (True, True)
        turns += turning < cruise
    assert 20 < turns < 100


def test_px4_turns_towards_the_line_at_the_speed_of_the_corner() -> None:
    """Before a corner it steers to a point of the new line 5 m away; once aligned it speeds up."""
    limits = limits_of("px4")
    flight = FlightState(0.02, ReferencePoint(0, 0, 0.0), PX4.modes.initial, north_m=-2.0, vn_mps=1.7)
    approach = WaypointApproach(flight, ((0.0, 0.0), (0.0, 40.0)), None, 2.0)
    (north, east), speed = approach.aim(flight, limits, 5.0)
    assert speed == pytest.approx(1.7)
    assert math.atan2(east, north + 2.0) == pytest.approx(math.acos(2.0 / 5.0))
    flight.vn_mps, flight.ve_mps = 0.1, 1.7
    assert approach.aim(flight, limits, 5.0) == ((0.0, 40.0), 5.0)


def flown_path(
    places: list[Vector], path: PathLimits, limits: FlightLimits, radius_m: float
) -> list[list[Vector]]:
    """Place, velocity and acceleration of every step over all places; a mission hands its legs on likewise."""
    corner_mps2 = limits.waypoint_corner_mps2
    segments = [PathSegment.between(*ends, path, limits) for ends in pairwise(places)]
    now_ns, steps = 0, []
    for number, segment in enumerate(segments):
        previous = segments[number - 1] if number else None
        following = segments[number + 1] if number + 1 < len(segments) else None
        course = WaypointPath(segment, following, radius_m, corner_mps2, now_ns, previous)
        while not (course.over(now_ns) if following else course.is_at_rest(now_ns)):
            steps.append(list(course.target_at(now_ns)))
            now_ns += STEP_NS
            assert now_ns < 500e9
    return steps


def test_ardupilots_path_rounds_its_corners_and_is_smooth() -> None:
    """Over random places: place and velocity have no jumps, every place is passed within the radius, speeds and
    accelerations keep their limits, and it ends at rest. Some corners are rounded, and some are stops.
    """
    random = np.random.default_rng(2)
    limits = limits_of("ardupilot", WPNAV_ACCEL_C=300.0)
    slowest = []
    for _ in range(20):
        steps = random.uniform((-40, -40, -8), (40, 40, 8), (4, 3))
        places = [(float(n), float(e), float(d)) for n, e, d in np.cumsum(steps, axis=0)]
        path = PathLimits(8.0, 2.5, 1.0, float(random.uniform(1.0, 5.0)))
        place, velocity, acceleration = np.array(flown_path(places, path, limits, 2.0)).transpose(1, 0, 2)
        dt = STEP_NS * 1e-9
        assert np.abs(np.diff(place, axis=0) - dt * 0.5 * (velocity[1:] + velocity[:-1])).max() < 1e-3
        # The corner's limit holds in the middle of a turn; both segments together hold twice their own.
        assert np.abs(np.diff(velocity, axis=0) / dt).max() < 5.1
        assert np.hypot(*velocity[:, :2].T).max() < 8.0 + 1e-6
        assert -2.5 - 1e-6 < velocity[:, 2].min() <= velocity[:, 2].max() < 1.5 + 1e-6
        assert np.hypot(*acceleration[:, :2].T).max() < 5.0
        for passed in places[1:-1]:
            offsets = np.linalg.norm(place - passed, axis=1)
            assert offsets.min() < 2.0
            slowest.append(np.linalg.norm(velocity[offsets.argmin()]))
        assert place[-1] == pytest.approx(places[-1], abs=1e-3)
        assert np.linalg.norm(velocity[-1]) < 0.01
    assert min(slowest) < 0.1
    assert max(slowest) > 1.0


def corner(client: Client) -> tuple[float, float, float]:
    """Of the first corner, 30 m north: the speed when it is 2 m away, the least distance and the speed there."""
    entry_mps, least_m, speed_mps = 0.0, math.inf, 0.0
    for _ in range(1500):
        client.fly(0.02)
        truth = client.vehicle.truth()
        distance_m = math.dist(truth.position_enu_m[:2], (0.0, 30.0))
        if distance_m < least_m:
            least_m, speed_mps = distance_m, math.hypot(*truth.velocity_enu_mps[:2])
            if least_m >= 2.0:
                entry_mps = speed_mps
        elif distance_m > least_m + 5.0:
            return entry_mps, least_m, speed_mps
    raise AssertionError("it never came to the corner")


@pytest.mark.parametrize(("gain", "speed_mps"), [(0.5, 1.73), (1.0, 2.45)])
def test_px4_flies_a_corner_of_90_degrees(make: Make, gain: float, speed_mps: float) -> None:
    """Inside NAV_ACC_RAD, with the speed of MPC_XY_TRAJ_P and 3 m/s2."""
    client = make(simspec(vehicle={"parameters": {"MPC_XY_TRAJ_P": gain}}))
    client.airborne()
    start_px4(client, to(client, 0, 30, 10), to(client, 30, 30, 10))
    entry_mps, least_m, _ = corner(client)
    assert least_m < 2.0
    # It brakes behind its trajectory, so it is still a little faster.
    assert entry_mps == pytest.approx(1.1 * speed_mps, rel=0.15)


@pytest.mark.parametrize(("corner_cmss", "speed_mps"), [(0.0, 2.9), (60.0, 0.0)])
def test_ardupilot_flies_a_corner_of_90_degrees(make: Make, corner_cmss: float, speed_mps: float) -> None:
    """Within WPNAV_RADIUS; where WPNAV_ACCEL_C allows no more it nearly stops."""
    parameters = {"WPNAV_ACCEL_C": corner_cmss, "WPNAV_RADIUS": 200.0}
    client = ready_ardupilot(make, parameters=parameters)
    rows = [to(client, 0, 0, 0), to(client, 0, 0, 5, 22), to(client, 0, 30, 5), to(client, 30, 30, 5)]
    assert upload(client, rows) == 0
    start_ardupilot(client)
    client.fly(7.0)
    _, least_m, passing_mps = corner(client)
    assert least_m < 2.0
    assert passing_mps == pytest.approx(speed_mps, abs=0.4)
