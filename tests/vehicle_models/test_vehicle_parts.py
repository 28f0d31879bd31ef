"""The parts around the controller: geodesy, contract, rates, stand-alone pacing."""

from __future__ import annotations

import math
import threading

import pymap3d
import pytest
from vehicle_client import simspec

from bench.contracts import LinkSpec, VehiclePlan, load_plugin
from bench.errors import SetupError
from bench.simulation import HostClock, StandalonePlan, fly, run_standalone, standalone_simspec
from vehicle_models import TangentPlane, open_x500
from vehicle_models._jsbsim import StartPose
from vehicle_models.x500 import X500Plant


@pytest.mark.parametrize(("reach_m", "error_m"), [(1000.0, 0.002), (5000.0, 0.06)])
@pytest.mark.parametrize("latitude", [-33.0, 0.0, 47.4, 65.0])
def test_the_tangent_plane_agrees_with_pymap3d(latitude: float, reach_m: float, error_m: float) -> None:
    """Points around an origin, against the rigorous conversion at the ellipsoid's surface."""
    plane = TangentPlane(latitude, 8.5)
    for east, north in ((reach_m, 0.0), (0.0, reach_m), (-reach_m, 0.7 * reach_m)):
        there = plane.geodetic_rad(east, north)
        x, y, _ = pymap3d.geodetic2enu(*map(math.degrees, there), 0.0, latitude, 8.5, 0.0)
        assert math.dist((east, north), (x, y)) < error_m
        assert plane.east_north_m(*there) == pytest.approx((east, north), abs=1e-6)


def test_the_plane_reaches_over_the_date_line() -> None:
    plane = TangentPlane(10.0, 179.9999)
    there = plane.geodetic_rad(100.0, 0.0)
    assert math.degrees(there[1]) < -179.0
    assert plane.east_north_m(*there) == pytest.approx((100.0, 0.0), abs=1e-6)


def test_far_from_the_origin_setpoints_still_mean_the_plane() -> None:
    """JSBSim measures from the start of the flight and we in the plane of the origin, 4 km away."""
    plant = X500Plant(StartPose(47.0, 8.0, 400.0, 4000.0, 3000.0), 0.02)
    assert (plant.motion.east_m, plant.motion.north_m) == pytest.approx((4000.0, 3000.0), abs=1e-3)
    for name in ("armed", "flying", "position-mode", "height-mode"):
        plant.write(name, 1.0)
    for _ in range(1000):
        north, east = plant.shift_ne_m
        plant.write("target-n-m", 3030.0 + north)
        plant.write("target-e-m", 3960.0 + east)
        plant.write("target-u-m", 10.0)
        plant.advance()
    place = (plant.motion.east_m, plant.motion.north_m, plant.motion.up_m)
    assert place == pytest.approx((3960.0, 3030.0, 10.0), abs=0.05)


def test_the_vehicle_is_a_plug_in() -> None:
    """The entry point opens a vehicle that stands at home, in the frames of the contract."""
    spec = simspec(vehicle={"home": {"east_m": 12.0, "north_m": -3.0, "heading_deg": 270.0}})
    plan = VehiclePlan(spec, (LinkSpec("serial0", "tcp_in"),))
    with load_plugin("rebar.vehicles", "x500")(plan) as vehicle:
        truth = vehicle.truth()
        assert truth.position_enu_m == pytest.approx((12.0, -3.0, 0.0), abs=5e-3)
        assert truth.yaw_rad == pytest.approx(-math.pi / 2, abs=1e-6)
        assert vehicle.step_s == 0.02
        vehicle.step()
        assert vehicle.time.ns == vehicle.truth().time.ns == 20_000_000
        assert vehicle.endpoints()["serial0"].startswith("tcp:127.0.0.1:")
        condition = vehicle.condition()
        assert (condition.armed, condition.landed, condition.crashed) == (False, True, False)
        assert condition.mode == "AUTO_LOITER"


@pytest.mark.parametrize("hz", [25, 50, 100, 200])
def test_other_controller_rates(hz: int) -> None:
    with open_x500(VehiclePlan(simspec(), (), controller_hz=hz)) as vehicle:
        for _ in range(hz):
            vehicle.step()
        assert vehicle.time.s == pytest.approx(1.0)


def test_a_rate_that_does_not_divide_the_physics_is_refused() -> None:
    with pytest.raises(SetupError, match="60 Hz"), open_x500(VehiclePlan(simspec(), (), controller_hz=60)):
        pass


def test_pacing_does_not_drift_and_lets_lost_time_go() -> None:
    """At speed 4 a second takes a quarter; an hour's standstill is not made up for."""
    now = 100.0
    waits: list[float] = []

    def clock() -> float:
        return now

    def wait(span: float) -> None:
        nonlocal now
        waits.append(span)
        now += span * 1.1  # a host that oversleeps

    with open_x500(VehiclePlan(simspec(), ())) as vehicle:
        fly(vehicle, 4.0, 2.0, threading.Event(), clock=HostClock(clock, wait))
        assert vehicle.time.s == pytest.approx(2.0)
        assert now == pytest.approx(100.5, abs=0.01)
        now += 3600.0
        begun = now
        fly(vehicle, 1.0, 1.0, threading.Event(), clock=HostClock(clock, wait))
        assert now - begun == pytest.approx(1.0, abs=0.01)
        assert max(waits) < 0.03


def test_standalone_flight_stops_and_names_its_links() -> None:
    """A set event ends it at once; unknown autopilots and parameters are SetupErrors."""
    lines: list[str] = []
    stop = threading.Event()
    stop.set()
    plan = StandalonePlan("ardupilot", [LinkSpec("serial0", "tcp_in")], (10.0, 20.0, 5.0, 90.0))
    run_standalone(plan, lines.append, stop)
    assert len(lines) == 1
    assert "tcp:127.0.0.1:" in lines[0]
    with pytest.raises(SetupError, match="inav"):
        run_standalone(StandalonePlan("inav"))
    with pytest.raises(SetupError, match="NO_SUCH"):
        run_standalone(StandalonePlan("px4", [LinkSpec("a", "tcp_in")], parameters={"NO_SUCH": 1.0}))
    northward = standalone_simspec(StandalonePlan(home=(1.0, 2.0, 3.0, 360.0)))
    assert northward.vehicle.home.heading_deg == 0.0
