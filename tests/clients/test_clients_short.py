"""Every client once: it finds the vehicle, reads a parameter, arms, takes off, is refused, lands.

The rest is `make clients`, with MAVSDK's other interface, which speaks by the same library.
"""

from __future__ import annotations

import pytest
from client_programs import Flown


@pytest.mark.parametrize("client", ["mavsdk", "mavsdk-grpc"])
def test_a_mavsdk_hops_on_px4(client: str, flown: Flown) -> None:
    logbook = flown(client, "parameters", "hop", speed=8.0)
    assert logbook["parameters"]["before"] == 12.0
    assert logbook["parameters"]["unknown"] == "DOES_NOT_EXIST"
    assert logbook["hop"]["disarm_in_air"] == "COMMAND_DENIED"
    assert logbook["hop"]["from_start_m"] < 1.0


def test_pymavlink_hops_on_px4(flown: Flown) -> None:
    logbook = flown("pymavlink-px4", "parameters", "hop", speed=8.0)
    assert logbook["parameters"]["listed"] > 600
    assert logbook["parameters"]["float"] == 12.0
    assert logbook["parameters"]["wrong_type"] == ["PARAM_ERROR", 7]
    assert logbook["parameters"]["unknown"] == ["PARAM_ERROR", 1]
    assert logbook["hop"]["disarm_in_air"] == ["TEMPORARILY_REJECTED"]
    assert logbook["hop"]["from_start_m"] < 1.0


def test_pymavlink_hops_on_ardupilot(flown: Flown) -> None:
    logbook = flown("pymavlink-ardupilot", "early", "parameters", "hop", speed=8.0)
    assert logbook["early"]["arm"] == logbook["early"]["takeoff"] == ["FAILED"]
    assert any(text.startswith("Arm: ") for text in logbook["early"]["texts"])
    parameters = logbook["parameters"]
    assert parameters["listed"] > 700
    assert parameters["before"] == 1500.0
    assert (parameters["after"], parameters["restored"], parameters["whole"]) == (999999.0, 1500.0, 0.0)
    assert parameters["unknown"] is None
    assert logbook["hop"]["disarm_in_air"] == ["FAILED"]
    assert logbook["hop"]["from_start_m"] < 1.0


def test_mavproxy_hops_on_ardupilot(flown: Flown) -> None:
    logbook = flown("mavproxy", "early", "parameters", "hop", speed=4.0)
    assert logbook["early"]["arm"] == "FAILED"
    assert logbook["parameters"] == {"before": 1500.0, "after": 1000.0, "unknown": "Unable to find parameter"}
    assert logbook["hop"]["disarm_in_air"] == "FAILED"
    assert logbook["hop"]["from_start_m"] < 1.0


def test_dronekit_hops_on_ardupilot(flown: Flown) -> None:
    logbook = flown("dronekit", "parameters", "hop", speed=5.0)
    assert logbook["parameters"]["before"] == 1500.0
    assert logbook["parameters"]["after"] == 1200.0
    assert logbook["parameters"]["unknown"] is None
    assert logbook["hop"]["disarm_in_air"] == [400, 4]
    assert logbook["hop"]["from_start_m"] < 1.0
