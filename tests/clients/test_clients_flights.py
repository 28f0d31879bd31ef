"""Whole flights of real clients on PX4 and on ArduPilot: `make clients`."""

from __future__ import annotations

import pytest
from client_programs import Flown

pytestmark = pytest.mark.clients


def approximately(place: list[float], north_m: float, east_m: float, within_m: float = 1.5) -> bool:
    return bool(abs(place[0] - north_m) < within_m and abs(place[1] - east_m) < within_m)


@pytest.mark.parametrize("client", ["mavsdk", "mavsdk-asyncio", "mavsdk-grpc"])
def test_arming_while_it_starts_is_refused(client: str, flown: Flown) -> None:
    """At half the speed of the clock: a client takes a second or two to find the vehicle, which is ready after 4.2."""
    assert flown(client, "early", speed=0.5)["early"]["arm"] == "COMMAND_DENIED"


def test_pymavlink_is_told_why_it_may_not_arm_yet(flown: Flown) -> None:
    early = flown("pymavlink-px4", "early", speed=0.5)["early"]
    assert early["arm"] == ["TEMPORARILY_REJECTED"]
    assert "".join(early["texts"]).startswith("Arming denied: Resolve system health failures")


def test_places_orbits_and_the_return(flown: Flown) -> None:
    travel = flown("mavsdk", "travel", speed=5.0)["travel"]
    assert approximately(travel["reached"], 25, 15)
    assert 10.9 < travel["radii_m"][0] <= travel["radii_m"][1] < 13.0
    assert travel["from_start_m"] < 1.0


def test_offboard_needs_a_setpoint_and_flies_velocities_and_positions(flown: Flown) -> None:
    setpoints = flown("mavsdk", "setpoints", speed=5.0)["setpoints"]
    assert setpoints["unfed"] == "NO_SETPOINT_SET"
    assert approximately(setpoints["landed_at"], 10, -10)


def test_mavsdk_flies_every_kind_of_setpoint(flown: Flown) -> None:
    assert flown("mavsdk", "every_setpoint", speed=4.0)["every_setpoint"]["from_start_m"] < 1.0


def test_mavsdk_finds_no_logs(flown: Flown) -> None:
    assert flown("mavsdk", "logs", speed=4.0)["logs"]["listed"] == "NO_LOGFILES"


def test_mavsdk_flies_by_stick_and_follows_a_leader(flown: Flown) -> None:
    logbook = flown("mavsdk", "sticks", "follow", speed=3.0)
    assert logbook["sticks"]["unheld"] != "SUCCESS"
    assert approximately(logbook["sticks"]["moved"], 11, 0)
    assert 3.0 < logbook["follow"]["behind_m"] < 16.0
    assert logbook["sticks"]["from_start_m"] < 1.0
    assert logbook["follow"]["from_start_m"] < 1.0


def test_mavsdk_flies_a_fixed_wing(flown: Flown) -> None:
    wing = flown("mavsdk", "wing", speed=6.0, options=["--vehicle", "wing"])["wing"]
    assert 8.0 < wing["airspeed_mps"] < 30.0
    assert wing["from_start_m"] < 50.0


def test_a_mission_goes_up_is_flown_and_returns(flown: Flown) -> None:
    """It watches its speed on the second and third leg."""
    plan = flown("mavsdk", "plan", speed=5.0)["plan"]
    assert plan["downloaded"] == 3
    assert plan["finished"]
    assert plan["from_start_m"] < 1.0
    assert plan["cleared"] == "SUCCESS"
    second, third = plan["speeds_mps"]
    assert 2.5 < second < 3.5
    assert 5.0 < third < 6.5


def test_mavsdk_raw_items_are_judged_as_they_go_up(flown: Flown) -> None:
    assert flown("mavsdk", "raw", speed=5.0)["raw"] == {
        "cleared": "SUCCESS",
        # The mode is granted to whoever is disarmed; arming in it is not.
        "nothing_to_fly": ["SUCCESS", "COMMAND_DENIED"],
        "good": "SUCCESS",
        "commands": [22, 16, 20],
        "unknown_command": "UNSUPPORTED",
        "bad_frame": "UNSUPPORTED",
        "after_refusal": [22, 16, 20],
        "rally": "SUCCESS",
        "rally_points": 1,
    }


def test_leaving_a_fence_ends_in_its_action(flown: Flown) -> None:
    fence = flown("mavsdk", "fence", speed=5.0)["fence"]
    assert fence["uploaded"] == fence["cleared"] == "SUCCESS"
    assert 39.0 < fence["breached_at_m"] < 50.0  # seen in the next heartbeat
    assert fence["from_start_m"] < 1.0
    assert fence["kept"] == [1, 1]
    assert fence["two_corners"] == "INVALID_ARGUMENT"


def test_the_gimbal_turns_and_the_camera_takes_pictures(flown: Flown) -> None:
    payload = flown("mavsdk", "payload", speed=3.0, options=["--camera"])["payload"]
    assert payload.pop("angles") == pytest.approx([-45.0, 30.0], abs=1.0)
    assert payload == {
        "uncontrolled": "ERROR",
        "control": "SUCCESS",
        "turned": "SUCCESS",
        "released": "SUCCESS",
        "camera": 100,
        "vendor": "REBAR",
        "photo": "SUCCESS",
        "pictures": [0],
        "video": "DENIED",
        "no_such_camera": "TIMEOUT",
    }


def test_mavsdk_reads_and_writes_parameters(flown: Flown) -> None:
    parameters = flown("mavsdk", "parameters", speed=4.0)["parameters"]
    assert parameters["listed"] > 600
    assert (parameters["before"], parameters["after"], parameters["restored"]) == (12.0, 9.5, "SUCCESS")
    assert parameters["unknown_set"] == "DOES_NOT_EXIST"
    assert parameters["wrong_type"] == "WRONG_TYPE"


def test_mavproxy_travels_and_flies_velocities(flown: Flown) -> None:
    logbook = flown("mavproxy", "early", "travel", "setpoints", speed=5.0)
    assert logbook["early"]["detected"] == "1:1"
    assert logbook["early"]["arm"] == "FAILED"
    assert logbook["early"]["parameters"] > 700
    assert approximately(logbook["travel"]["reached"], 14, -10)
    assert logbook["travel"]["from_start_m"] < 1.0
    assert approximately(logbook["setpoints"]["moved"], 7, 0, 2.0)
    assert logbook["setpoints"]["from_start_m"] < 1.0


def test_mavproxy_loads_a_mission_and_breaks_a_fence(flown: Flown) -> None:
    logbook = flown("mavproxy", "plan", "fence", speed=5.0)
    plan, fence = logbook["plan"], logbook["fence"]
    assert (plan["refused"], plan["loaded"]) == ("UNSUPPORTED", "ACCEPTED")
    assert (plan["listed"], plan["left"]) == (6, 0)
    assert plan["reached"] == ["3", "4"]
    assert plan["from_start_m"] < 1.0
    assert (fence["points"], fence["rally"]) == (0, 0)
    assert 25.0 < fence["farthest_m"] < 36.0
    assert fence["from_start_m"] < 1.0
    assert fence["disabled"] == "ACCEPTED"


def test_dronekit_travels_and_flies_velocities(flown: Flown) -> None:
    logbook = flown("dronekit", "early", "travel", "setpoints", speed=5.0)
    assert not logbook["early"]["armable"]
    assert logbook["early"]["ack"] == [400, 4]
    assert any(text.startswith("Arm: ") for text in logbook["early"]["texts"])
    travel, setpoints = logbook["travel"], logbook["setpoints"]
    assert approximately(travel["reached"], 16, -12)
    assert 3.5 < travel["fastest_mps"] < 4.5
    assert travel["from_start_m"] < 1.0
    assert 1.8 < setpoints["speed_mps"] < 2.3
    assert setpoints["stopped_at"][1] > 8.0
    assert setpoints["from_start_m"] < 1.0


def test_dronekit_flies_a_mission_and_breaks_a_fence(flown: Flown) -> None:
    logbook = flown("dronekit", "plan", "fence", speed=5.0)
    plan, fence = logbook["plan"], logbook["fence"]
    assert plan["verdict"] == 3  # UNSUPPORTED; DroneKit itself does not look at the verdict
    assert plan["kept"] == [22, 178, 16, 178, 16, 20]
    slow, fast = plan["fastest_mps"]
    assert 2.5 < slow < 3.5
    assert 5.5 < fast < 6.5
    assert plan["from_start_m"] < 1.0
    assert 28.0 < fence["breached_at_m"] < 36.0
    assert "Circle fence breached" in fence["texts"]
    assert fence["from_start_m"] < 1.0


def test_dronekit_turns_a_gimbal(flown: Flown) -> None:
    """By DO_MOUNT_* messages, its only way."""
    payload = flown("dronekit", "payload", speed=5.0, options=["--camera"])["payload"]
    assert payload["pitch_deg"] == pytest.approx(-50.0, abs=1.0)


def test_mavproxy_finds_no_logs(flown: Flown) -> None:
    assert flown("mavproxy", "logs", speed=4.0)["logs"]["listed"] == "No logs"


def test_mavproxy_turns_a_gimbal(flown: Flown) -> None:
    payload = flown("mavproxy", "payload", speed=4.0, options=["--camera"])["payload"]
    assert payload["turned"] == "ACCEPTED"
    assert payload["pitch_deg"] == pytest.approx(-40.0, abs=1.0)
