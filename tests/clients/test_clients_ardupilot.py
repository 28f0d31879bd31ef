"""Whole flights of real clients on ArduPilot: `make clients`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.clients
Flown = Callable[..., dict[str, Any]]


def approximately(place: list[float], north_m: float, east_m: float, within_m: float = 1.5) -> bool:
    return bool(abs(place[0] - north_m) < within_m and abs(place[1] - east_m) < within_m)


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
