"""Failsafes of both autopilots: when they come, what they do and say, and what ends them."""

from __future__ import annotations

import math

import pytest
from vehicle_client import Client, Make, of, simspec

from vehicle_models.controller.links._dialect import dialect as mavlink


def px4(make: Make, **parameters: float) -> Client:
    return make(simspec(vehicle={"parameters": parameters}))


def copter(make: Make, height_m: float = 10.0, **parameters: float) -> Client:
    """An ArduCopter in GUIDED at a height, with a ground station."""
    client = make(simspec("ardupilot", vehicle={"parameters": parameters}), system=255)
    client.beat()
    client.guided(height_m, each=client.beat)
    return client


beat = Client.beat


def flying(make: Make, autopilot: str, height_m: float = 10.0) -> Client:
    if autopilot == "ardupilot":
        return copter(make, height_m)
    client = make()
    client.airborne(height_m)
    return client


def until(client: Client, mode: str, most_s: float) -> float:
    """Seconds until the vehicle is in a mode."""
    for tenth in range(round(most_s * 10)):
        if client.vehicle.condition().mode == mode:
            return tenth / 10
        client.fly(0.1)
    raise AssertionError(f"still {client.vehicle.condition().mode} after {most_s} s")


def test_a_station_that_comes_back_ends_the_hold_and_not_the_return(make: Make) -> None:
    """NAV_DLL_ACT 2: the Hold before the action is the station's time to come back; the mode before goes on. Once
    it has acted, the failsafe lasts until another mode is chosen.
    """
    client = px4(make, NAV_DLL_ACT=2)
    client.airborne(3.0)
    client.is_station = False
    client.beat()
    client.fly(13.2)
    assert client.state() == ("AUTO_LOITER", "link")
    assert client.last("HEARTBEAT").system_status == 5
    client.beat()
    client.fly(6.0)
    assert client.state() == ("AUTO_LOITER", "")
    client.beat()
    client.fly(17.2)
    assert client.state() == ("AUTO_RTL", "link")
    # There is no station that could read of it.
    assert not [text for text in client.texts() if "Failsafe" in text]
    client.beat()
    client.fly(0.5)
    assert client.state() == ("AUTO_RTL", "link")
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)[-1] == 0
    assert client.state() == ("AUTO_LOITER", "")


def test_px4_lands_with_an_emergency_battery(make: Make) -> None:
    """COM_LOW_BAT_ACT 3: warning, Hold for 5 s, and a landing because the emergency came meanwhile."""
    battery = {"capacity_wh": 6.0, "initial_fraction": 0.32}
    client = make(simspec(vehicle={"parameters": {"COM_LOW_BAT_ACT": 3}, "battery": battery}))
    client.airborne(3.0)
    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, 100_000)
    assert client.vehicle.condition().battery_fraction > 0.16
    until(client, "AUTO_LAND", 60.0)
    told = ["Low battery", "Failsafe activated: entering Hold for 5 seconds", "Emergency battery level"]
    texts = [text.strip() for text in client.texts()]
    assert [text for text in texts if text in (*told, "Critical battery")] == told
    states = [message.charge_state for message in of("BATTERY_STATUS", client.received)]
    assert sorted(set(states)) == [1, 2, 3, 4]


def test_copter_needs_ten_seconds_of_low_voltage(make: Make) -> None:
    """BATT_LOW_VOLT 11 with action 2: after BATT_LOW_TIMER RTL and CRITICAL; at 9.5 V with action 1 LAND."""
    client = copter(make, BATT_LOW_VOLT=11.0, BATT_FS_LOW_ACT=2, BATT_CRT_VOLT=10.0, BATT_FS_CRT_ACT=1)
    client.put(SIM_BATT_VOLTAGE=10.5)
    client.fly(9.8)
    assert client.state() == ("GUIDED", "")
    client.fly(1.3)
    assert client.state() == ("RTL", "battery")
    assert client.last("HEARTBEAT").system_status == 5
    assert any(text.startswith("Battery 1 is low 10.") and text.endswith(" mAh") for text in client.texts())
    client.put(SIM_BATT_VOLTAGE=9.5)
    client.fly(10.3)
    assert client.state() == ("LAND", "battery")
    assert client.texts().count("Battery Failsafe") == 2


def test_copter_says_that_the_battery_is_low_and_flies_on_by_default(make: Make) -> None:
    client = copter(make)
    client.put(SIM_BATT_VOLTAGE=9.0)
    client.fly(11.0)
    assert client.state() == ("GUIDED", "battery")
    assert "Battery Failsafe" in client.texts()


def test_copter_counts_the_charge_from_where_a_client_says(make: Make) -> None:
    """MAV_CMD_BATTERY_RESET of the first battery, within 0 and 100 %; what the battery has stays as it is."""
    client = copter(make)
    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_SYS_STATUS, 500_000)
    client.fly(1.0)
    before = client.last("SYS_STATUS").battery_remaining
    # A mask without the first battery changes nothing.
    resets = ((1, 40.0, 40), (3, -5.0, 0), (1, 140.0, 100), (1, math.nan, 50), (2, 40.0, 50))
    for mask, percent, told in resets:
        assert client.command(mavlink.MAV_CMD_BATTERY_RESET, mask, percent) == [0]
        client.fly(1.0)
        assert client.last("SYS_STATUS").battery_remaining == pytest.approx(told, abs=1)
        assert round(100.0 * client.vehicle.condition().battery_fraction) == pytest.approx(before, abs=2)


def test_copter_is_critical_until_its_radio_is_back(make: Make) -> None:
    """SIM_RC_FAIL 1: 0.8 s later RTL and CRITICAL, also on the ground; back: the text, and the mode stays."""
    client = copter(make)
    client.put(SIM_RC_FAIL=1)
    client.fly(0.7)
    assert client.state() == ("GUIDED", "")
    client.fly(0.2)
    assert client.state() == ("RTL", "radio")
    fly_until_disarmed(client, 60.0)
    assert status(client) == (False, 81, 5)
    client.put(SIM_RC_FAIL=0)
    assert status(client) == (False, 81, 3)
    assert client.state() == ("RTL", "")
    texts = [text for text in client.texts() if "Radio" in text]
    assert texts == ["Radio Failsafe", "Radio Failsafe Cleared"]


def test_copter_stays_critical_while_the_station_is_lost(make: Make) -> None:
    """SYSID_MYGCS is the station, no other. GUIDED can be chosen, but the failsafe lasts until it is back."""
    client = copter(make, FS_GCS_ENABLE=1)
    client.mav.srcSystem = 42
    client.fly(5.2, client.beat)
    assert client.state() == ("RTL", "link")
    client.mav.srcSystem = 255
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
    assert client.state() == ("GUIDED", "link")
    client.beat()
    client.fly(1.1)
    assert client.state() == ("GUIDED", "")
    assert client.last("HEARTBEAT").system_status == 4
    assert [text for text in client.texts() if "GCS" in text] == ["GCS Failsafe", "GCS Failsafe Cleared"]


@pytest.mark.parametrize(
    ("autopilot", "mode", "acts_s"), [("px4", "AUTO_LAND", 5.1), ("ardupilot", "LAND", 8.0)]
)
def test_without_satellites_it_lands(make: Make, autopilot: str, mode: str, acts_s: float) -> None:
    """The position is given up as late as by the real ones, and modes that need one end in a landing."""
    client = flying(make, autopilot)
    navigation = client.vehicle._navigation  # type: ignore[attr-defined]
    navigation.set_off(True)
    client.fly(acts_s - 0.1)
    assert client.vehicle.condition().failsafe == ""
    client.fly(0.2)
    assert client.state() == (mode, "position")
    navigation.set_off(False)
    client.fly(0.1 if autopilot == "px4" else 0.9)
    assert client.state() == (mode, "position")
    client.fly(0.2)
    assert client.state() == (("AUTO_LOITER", "") if autopilot == "px4" else ("LAND", ""))


def fly_until_disarmed(client: Client, limit_s: float) -> tuple[float, float]:
    """Seconds until the vehicle says that it has landed, and until it is disarmed."""
    landed_s = 0.0
    for step in range(round(limit_s * 50)):
        condition = client.vehicle.condition()
        if not landed_s and condition.landed:
            landed_s = step / 50
        if not condition.armed:
            return landed_s, step / 50
        client.fly(0.02)
    raise AssertionError(f"still armed after {limit_s} s: {client.vehicle.condition()}")


def lose_satellites(client: Client, drift_mps2: tuple[float, float]) -> None:
    """Take the satellites away, with the error of the accelerometers east and north."""
    navigation = client.vehicle._navigation  # type: ignore[attr-defined]
    navigation.set_off(True)
    navigation._bias_en_mps2 = drift_mps2


def status(client: Client) -> tuple[bool, int, int]:
    """Whether armed, base_mode and system_status of the next heartbeat."""
    client.fly(1.1)
    heartbeat = client.last("HEARTBEAT")
    return client.vehicle.condition().armed, heartbeat.base_mode, heartbeat.system_status


# Ten standard deviations make the estimate move at 10 m/s before the landing.
@pytest.mark.parametrize("drift_mps2", [(0.0, 0.0), (-0.3, 0.3)])
@pytest.mark.parametrize(
    ("autopilot", "disarmed_s", "after_s"), [("px4", 22.4, 2.0), ("ardupilot", 35.0, 0.3)]
)
def test_a_landing_without_satellites_ends_disarmed(
    make: Make, autopilot: str, disarmed_s: float, after_s: float, drift_mps2: tuple[float, float]
) -> None:
    """From 10 m, as late as the real ones on this aircraft, however fast the estimate moves away; and where it
    was, since without wind a level vehicle stays. On the ground the failsafe of a PX4 is over, and that of a copter
    lasts as long as its cause.
    """
    client = flying(make, autopilot)
    lose_satellites(client, drift_mps2)
    landed_s, off_s = fly_until_disarmed(client, 45.0)
    assert off_s == pytest.approx(disarmed_s, abs=0.7)
    assert off_s - landed_s == pytest.approx(after_s, abs=0.15)
    assert not client.vehicle.condition().crashed
    east_m, north_m, _ = client.vehicle.truth().position_enu_m
    if drift_mps2 == (0.0, 0.0):
        assert math.hypot(east_m, north_m) < 0.1
    client.fly(2.0)
    if autopilot == "px4":
        assert status(client)[2] != 5
        assert client.vehicle.condition().failsafe == ""
        return
    assert status(client) == (False, 81, 5)
    begun = len(client.texts())
    client.vehicle._navigation.set_off(False)  # type: ignore[attr-defined]
    client.fly(1.0)
    assert status(client) == (False, 89, 3)
    assert client.texts()[begun:][-1] == "EKF Failsafe Cleared"


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_landing_without_a_position_drifts_with_the_wind(make: Make, autopilot: str) -> None:
    """Level, as the real ones, which hold no place against the wind."""
    wind = {"wind": {"speed_mps": 2.0, "from_deg": 270.0}}
    client = make(simspec(autopilot, environment=wind), system=255)
    client.airborne() if autopilot == "px4" else client.guided()
    lose_satellites(client, (0.0, 0.0))
    fly_until_disarmed(client, 45.0)
    east_m, north_m, _ = client.vehicle.truth().position_enu_m
    assert east_m > 5.0
    assert abs(north_m) < 0.5


def test_copter_tells_of_a_lost_position_and_steers_none(make: Make) -> None:
    """EKF variance, the failsafe, and 15 s after the loss the end of aiding, as EKF3 tells it; base_mode 209, status
    critical. Satellites that are back clear the failsafe, and the landing stays one without a position.
    """
    client = copter(make)
    begun = len(client.texts())
    lose_satellites(client, (0.0, 0.0))
    client.fly(14.9, client.beat)
    failsafe = ["EKF variance", "EKF Failsafe: changed to LAND Mode"]
    assert client.texts()[begun:] == failsafe
    heartbeat = client.last("HEARTBEAT")
    assert (heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status) == (209, 9, 5)
    client.fly(0.2, client.beat)
    aiding = [f"EKF3 IMU{number} stopped aiding" for number in (0, 1)]
    assert client.texts()[begun:] == [*failsafe, *aiding]
    client.vehicle._navigation.set_off(False)  # type: ignore[attr-defined]
    client.fly(1.2, client.beat)
    back = [*(f"EKF3 IMU{number} is using GPS" for number in (0, 1)), "EKF Failsafe Cleared"]
    assert client.texts()[begun:] == [*failsafe, *aiding, *back]
    assert client.state() == ("LAND", "")
    assert client.vehicle._controller._guidance.manoeuvre._place is None  # type: ignore[attr-defined]


@pytest.mark.parametrize("cause", ["station", "battery"])
def test_a_copter_that_a_failsafe_disarms_stays_critical(make: Make, cause: str) -> None:
    """On the ground, until the station is back or the battery charged; then it may be armed again."""
    parameters = {"FS_GCS_ENABLE": 1, "BATT_FS_LOW_ACT": 2, "BATT_LOW_TIMER": 1, "DISARM_DELAY": 60}
    client = make(simspec("ardupilot", vehicle={"parameters": parameters}), system=255)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.beat() if cause == "station" else client.put(SIM_BATT_VOLTAGE=9.0)
    client.fly(6.0)
    assert status(client) == (False, 89, 5)
    assert ("GCS Failsafe - Disarming" in client.texts()) is (cause == "station")
    client.beat() if cause == "station" else client.put(SIM_BATT_VOLTAGE=12.6)
    assert status(client) == (False, 89, 3)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]


def test_a_failsafe_of_a_copter_waits_before_it_lands(make: Make) -> None:
    """Four seconds, also for a battery or a station; a landing that is ordered, or for the fence, begins at once."""
    client = copter(make, FS_GCS_ENABLE=5)
    client.fly(5.2)
    assert client.state() == ("LAND", "link")
    client.fly(3.5)
    assert client.vehicle.truth().position_enu_m[2] == pytest.approx(10.0, abs=0.1)
    client.fly(2.0)
    assert client.vehicle.truth().position_enu_m[2] < 9.5
    client = copter(make)
    client.command(mavlink.MAV_CMD_NAV_LAND)
    client.fly(2.0)
    assert client.vehicle.truth().position_enu_m[2] < 9.5
