"""How the vehicle flies: measured on the truth, commanded over MAVLink as an agent would."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from vehicle_client import NAN, Client, Make, simspec

from vehicle_models.controller.links._dialect import dialect as mavlink


def track(client: Client, seconds: float, each: Callable[[], None] | None = None) -> NDArray[np.float64]:
    """Truth positions (n, 3) ENU at 10 Hz over the next seconds."""
    rows = []
    for _ in range(round(seconds * 10)):
        client.fly(0.1, each)
        rows.append(client.vehicle.truth().position_enu_m)
    return np.array(rows)


@pytest.mark.parametrize(("height_m", "real_s"), [(2.5, 5.0), (10.0, 11.0)])
def test_takeoff_lasts_as_long_as_the_real_one(make: Make, height_m: float, real_s: float) -> None:
    """From the command to AUTO_LOITER within a tenth of what PX4 was seen to take."""
    client = make()
    client.fly(5.0)
    client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 488.0 + height_m)
    begun = client.vehicle.time.s
    while client.vehicle.condition().mode != "AUTO_LOITER":
        client.fly(0.02)
        assert client.vehicle.time.s < 60.0
    assert client.vehicle.time.s - begun == pytest.approx(real_s, rel=0.1)


def test_an_offboard_step_is_that_of_the_real_px4(make: Make) -> None:
    """15 m by position setpoints alone, on this plant, within a tenth."""
    client = make()
    client.airborne(10.0)
    client.offboard(0.0, 0.0, -10.0)
    client.fly(2.0, lambda: client.setpoint(0.0, 0.0, -10.0))
    begun_m = client.vehicle.truth().position_enu_m[1]
    rows = []
    for step in range(300):
        if step % 5 == 0:
            client.setpoint(15.0, 0.0, -10.0)
        client.fly(0.02)
        truth = client.vehicle.truth()
        tilt_deg = math.degrees(math.acos(math.cos(truth.roll_rad) * math.cos(truth.pitch_rad)))
        speed_mps = math.hypot(*truth.velocity_enu_mps[:2])
        rows.append((truth.position_enu_m[1] - begun_m, speed_mps, tilt_deg))
    way_m, speeds_mps, tilts_deg = zip(*rows, strict=True)
    length_m = 15.0 - begun_m
    for share, real_s in ((0.1, 1.0), (0.5, 1.8), (0.95, 2.8)):
        reached_s = 0.02 * next(step for step, m in enumerate(way_m, 1) if m >= share * length_m)
        assert reached_s == pytest.approx(real_s, rel=0.1)
    assert max(speeds_mps) == pytest.approx(8.8, rel=0.1)
    assert max(tilts_deg) == pytest.approx(44.0, rel=0.1)
    assert max(way_m) - length_m == pytest.approx(0.79, rel=0.1)


def copter(make: Make) -> Client:
    """An ArduCopter armed in GUIDED."""
    client = make(simspec("ardupilot"), system=255)
    client.learn_home()
    assert client.command(mavlink.MAV_CMD_GET_HOME_POSITION) == [0]
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    return client


def airborne(make: Make, autopilot: str) -> Client:
    """At 10 m, holding."""
    if autopilot == "ardupilot":
        client = copter(make)
        assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == [0]
        client.fly(14.0)
        return client
    client = make()
    client.airborne()
    return client


@pytest.mark.parametrize(
    ("speed", "greatest_mps", "overshoot_m"), [(5.0, 5.0, 0.0), (10.0, 8.5, 0.7)], ids=["5", "10"]
)
def test_a_copters_leg_of_50_m(make: Make, speed: float, greatest_mps: float, overshoot_m: float) -> None:
    """After DO_CHANGE_SPEED a reposition reaches that speed, or the 8.5 m/s that 50 m leave the real one, and passes
    its goal by 0.4 m more or less than the real one did, which was measured at 10 m/s alone.
    """
    client = airborne(make, "ardupilot")
    assert client.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, speed, -1) == [0]
    assert client.command_int(
        mavlink.MAV_CMD_DO_REPOSITION, 6, -1, 1, 0, NAN, *client.vehicle_goal(0.0, 50.0), 10.0
    ) == [0]
    leg = track(client, 25.0)
    assert leg[:, 1].max() == pytest.approx(50.0 + overshoot_m, abs=0.4)
    assert abs(leg[-1, 1] - 50.0) < 0.1
    assert np.diff(leg[:, 1]).max() * 10 == pytest.approx(greatest_mps, rel=0.1)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_minute_of_hold_without_wind(make: Make, autopilot: str) -> None:
    """Never farther than 0.3 m from its commanded position."""
    client = airborne(make, autopilot)
    assert np.abs(track(client, 60.0) - [0.0, 0.0, 10.0]).max() < 0.3


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(("command", "north_m"), [(20, 0.0), (21, 30.0)], ids=["return", "land"])
def test_it_comes_down_where_it_should(make: Make, autopilot: str, command: int, north_m: float) -> None:
    """Return and landing begun 30 m away end within 1 m of home, of the place; disarmed and whole."""
    client = airborne(make, autopilot)
    altitude = 498.0 if autopilot == "px4" else 10.0
    assert client.command_int(
        mavlink.MAV_CMD_DO_REPOSITION, 6, -1, 1, 0, NAN, *client.vehicle_goal(0.0, 30.0), altitude
    ) == [0]
    client.fly(12.0)
    assert client.command(command, 0, 0, 0, NAN, NAN, NAN, NAN) == [0]
    while client.vehicle.condition().armed:
        client.fly(0.5)
        assert client.vehicle.time.s < 180.0
    assert not client.vehicle.condition().crashed
    assert math.dist(client.vehicle.truth().position_enu_m, (0.0, north_m, 0.0)) < 1.0


@pytest.mark.parametrize("speed", [5.0, 10.0])
def test_a_leg_of_50_m_ends_without_overshoot(make: Make, speed: float) -> None:
    """A reposition at 5 and 10 m/s passes its goal by less than 1 m, reaches the speed, keeps height and
    line.
    """
    client = make(simspec(vehicle={"home": {"east_m": 12.0, "north_m": -7.0}}))
    client.airborne()
    latitude, longitude = client.vehicle_goal(0.0, 50.0)
    assert client.command_int(
        mavlink.MAV_CMD_DO_REPOSITION, 6, speed, 1, 0, NAN, latitude, longitude, 498.0
    ) == [0]
    leg = track(client, 25.0) - [12.0, -7.0, 0.0]
    assert leg[:, 1].max() < 51.0
    assert abs(leg[-1, 1] - 50.0) < 0.1
    assert np.abs(leg[:, 0]).max() < 0.3
    assert np.abs(leg[:, 2] - 10.0).max() < 0.3
    assert np.diff(leg[:, 1]).max() * 10 == pytest.approx(speed, rel=0.05)


def test_setpoints_fly_a_square_in_wind(make: Make) -> None:
    """Offboard corners of 20 m in 8 m/s of wind with gusts are each met within 0.5 m."""
    wind = {"speed_mps": 8.0, "from_deg": 250.0, "turbulence_mps": 8.0}
    client = make(simspec(environment={"wind": wind}))
    client.airborne()
    client.offboard(0, 0, -10)
    for north, east in ((20, 0), (20, 20), (0, 20), (0, 0)):
        client.fly(10.0, lambda n=north, e=east: client.setpoint(n, e, -10))  # type: ignore[misc]
        assert math.dist(client.vehicle.truth().position_enu_m, (east, north, 10.0)) < 0.5


def test_hold_in_wind_with_gusts(make: Make) -> None:
    """Mean distance from the place held in 8 m/s of wind with W20 of 8 m/s stays below 0.3 m; so does
    height.
    """
    wind = {"speed_mps": 8.0, "from_deg": 30.0, "turbulence_mps": 8.0}
    client = make(simspec(environment={"wind": wind}))
    client.airborne()
    client.fly(5.0)
    place = client.last("HOME_POSITION")
    assert place is not None
    flown = track(client, 40.0)
    middle = flown.mean(axis=0)
    assert np.hypot(*(flown - middle)[:, :2].T).mean() < 0.3
    assert abs(middle[2] - 10.0) < 0.1
    assert np.hypot(*(flown - middle)[:, :2].T).max() > 0.01, "the gusts must have done something"


def test_velocity_setpoints_reach_their_speed(make: Make) -> None:
    """A velocity of (3, -2, -1) with a yaw rate is flown as commanded; POSITION_TARGET echoes it with NaN and
    mask 7.
    """
    client = make(streams="onboard")
    client.airborne()
    mask = 0x7 | 0x1C0 | 0x400
    client.setpoint(0, 0, 0, mask, vn=3.0, ve=-2.0, vd=-1.0, yawrate=0.2)
    client.fly(0.1)
    client.setpoint(0, 0, 0, mask, vn=3.0, ve=-2.0, vd=-1.0, yawrate=0.2)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6) == [0, 0]
    client.fly(5.0, lambda: client.setpoint(0, 0, 0, mask, vn=3.0, ve=-2.0, vd=-1.0, yawrate=0.2))
    truth = client.vehicle.truth()
    assert truth.velocity_enu_mps == pytest.approx((-2.0, 3.0, 1.0), rel=0.05, abs=0.1)
    assert truth.rates_body_radps[2] == pytest.approx(0.2, abs=0.05)
    echo = client.last("POSITION_TARGET_LOCAL_NED")
    assert math.isnan(echo.x)
    assert echo.type_mask == 7
    assert echo.vx == pytest.approx(3.0)


def test_the_estimate_meets_the_setpoint_and_truth_pays_for_it(make: Make) -> None:
    """With a wander of 10 m the estimate sits on the setpoint, the truth beside it by the error, metres
    away.
    """
    client = make(
        simspec(
            vehicle={"gps": {"wander_m": 10.0, "noise_m": 0.05, "wander_time_s": 60.0}}, seeds={"root": 3}
        )
    )
    client.airborne()
    client.offboard(0, 0, -10)
    off, aside = [], []
    for _ in range(40):
        client.fly(1.0, lambda: client.setpoint(0, 0, -10))
        estimate = client.vehicle.estimate().position_enu_m
        off.append(math.dist(estimate[:2], (0.0, 0.0)))
        aside.append(math.dist(client.vehicle.truth().position_enu_m[:2], estimate[:2]))
    assert np.mean(off[5:]) < 1.0
    assert np.mean(aside) > 3.0
    assert np.max(aside) > 5.0


@pytest.mark.parametrize("root", range(2))
def test_a_wandering_position_does_not_turn_it_over_on_the_ground(make: Make, root: int) -> None:
    """Ten metres of wander move the landing, not the vehicle that stands on its feet: it disarms whole."""
    client = make(simspec(vehicle={"gps": {"wander_m": 10.0}}, seeds={"root": root}))
    client.airborne()
    client.command(mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, NAN, NAN, NAN, NAN)
    while client.vehicle.condition().armed:
        client.fly(0.5)
        assert client.vehicle.time.s < 90.0
    assert client.vehicle.condition().landed
    assert not client.vehicle.condition().crashed


def test_gps_error_has_the_stated_size() -> None:
    """Over many independent vehicles each axis of the wander has its standard deviation, at the start and
    later, and its rate.
    """
    from bench.simspec import Gps, Seeds, generator
    from vehicle_models._navigation import Navigation

    gps = Gps(wander_m=4.0, wander_time_s=5.0, noise_m=0.0)
    begun, later, rates = [], [], []
    for number in range(300):
        navigation = Navigation(gps, 0.02, generator(Seeds(), "sensors", number))
        begun.append(navigation.error_enu_m[:2])
        for _ in range(500):
            navigation.step()
        later.append(navigation.fix_error_enu_m[:2])
        fixes = navigation.fixes
        while navigation.fixes == fixes:
            navigation.step()
        rates.append((navigation.fix_error_enu_m[0] - later[-1][0]) / 0.125)
    assert np.std(rates) == pytest.approx(4.0 * 2.146 / 5.0, rel=0.15)
    assert np.std(begun) == pytest.approx(4.0, rel=0.1)
    assert np.std(later) == pytest.approx(4.0, rel=0.1)


def test_gusts_have_the_stated_size() -> None:
    """At 20 m with W20 of 5 m/s: sigma 0.86 m/s along and across, 0.5 m/s vertical, whatever the airspeed
    does.
    """
    from bench.simspec import Seeds, Wind, generator
    from vehicle_models._gusts import Gusts

    gusts = Gusts(Wind(speed_mps=5, turbulence_mps=5), 0.02, generator(Seeds(root=1), "gusts"))
    blown = np.array([gusts.step(20.0, 5.0 + 10.0 * (step // 1000 % 2)) for step in range(200_000)])
    k = 0.177 + 0.000823 * 20.0 / 0.3048
    assert blown.std(axis=0) == pytest.approx([0.5 / k**0.4, 0.5 / k**0.4, 0.5], rel=0.1)
    assert np.abs(blown.mean(axis=0)).max() < 0.1


def test_wind_blows_from_where_the_document_says() -> None:
    """A wind from 270 degrees moves air to the east."""
    from bench.simspec import Wind
    from vehicle_models._gusts import mean_wind_ned_mps

    assert mean_wind_ned_mps(Wind(speed_mps=4.0, from_deg=270.0)) == pytest.approx((0.0, 4.0, 0.0), abs=1e-9)


def test_the_battery_empties_by_the_power_drawn(make: Make) -> None:
    """Hovering draws between 150 and 200 W; with a small battery the warnings come and an empty one lets it
    fall.
    """
    client = make(simspec(vehicle={"battery": {"capacity_wh": 3.0, "initial_fraction": 0.6}}), streams="gcs")
    client.airborne()
    before = client.vehicle.condition().battery_fraction
    client.fly(5.0)
    watts = (before - client.vehicle.condition().battery_fraction) * 3.0 * 3600.0 / 5.0
    assert 150.0 < watts < 200.0
    status = client.last("SYS_STATUS")
    assert status.current_battery == pytest.approx(
        100.0 * watts / (status.voltage_battery / 1000.0), rel=0.05
    )
    client.fly(20.0)
    assert any("Low battery" in text for text in client.texts())
    assert client.vehicle.condition().battery_fraction == 0.0
    assert client.vehicle.condition().crashed


def test_landing_in_wind_disarms_near_home(make: Make) -> None:
    """RTL from 40 m away climbs to its height, comes back, lands within 1 m of home and disarms 2 s after
    touching.
    """
    wind = {"speed_mps": 6.0, "from_deg": 120.0, "turbulence_mps": 6.0}
    client = make(simspec(environment={"wind": wind}))
    client.airborne()
    client.offboard(40, 0, -10)
    client.fly(8.0, lambda: client.setpoint(40, 0, -10))
    assert client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [0]
    flown = track(client, 75.0)
    assert flown[:, 2].max() == pytest.approx(30.0, abs=0.5)
    condition = client.vehicle.condition()
    assert (condition.armed, condition.landed, condition.crashed, condition.mode) == (
        False,
        True,
        False,
        "AUTO_LOITER",
    )
    assert math.dist(flown[-1], (0.0, 0.0, 0.0)) < 1.0
    texts = [text.strip() for text in client.texts()]
    assert texts[-3:] == ["RTL: land at destination", "Landing detected", "Disarmed by landing"]


def test_a_hard_landing_is_a_crash(make: Make) -> None:
    """Disarmed by force at 10 m the vehicle falls, and that is a crash: motors off, arming refused from then
    on.
    """
    client = make()
    client.airborne()
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == [0]
    client.fly(3.0)
    condition = client.vehicle.condition()
    assert condition.crashed
    assert not condition.armed
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [1]
