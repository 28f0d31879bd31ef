"""Every client once: it finds the vehicle, reads a parameter, arms, takes off, is refused, lands. The rest is `make clients`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

Flown = Callable[..., dict[str, Any]]


@pytest.mark.parametrize("client", ["mavsdk", "mavsdk-asyncio", "mavsdk-grpc"])
def test_a_mavsdk_hops_on_px4(client: str, flown: Flown) -> None:
    told = flown(client, "parameters", "hop", speed=8.0)
    assert told["parameters"]["before"] == 12.0
    assert told["parameters"]["unknown"] == "DOES_NOT_EXIST"
    assert told["hop"]["disarm_in_air"] == "COMMAND_DENIED"
    assert told["hop"]["from_start_m"] < 1.0


def test_pymavlink_hops_on_px4(flown: Flown) -> None:
    told = flown("pymavlink-px4", "parameters", "hop", speed=8.0)
    assert told["parameters"]["float"] == 12.0
    assert told["parameters"]["unknown"] == ["PARAM_ERROR", 1]
    assert told["hop"]["disarm_in_air"] == ["TEMPORARILY_REJECTED"]
    assert told["hop"]["from_start_m"] < 1.0


def test_pymavlink_hops_on_ardupilot(flown: Flown) -> None:
    told = flown("pymavlink-ardupilot", "early", "parameters", "hop", speed=8.0)
    assert told["early"]["arm"] == ["FAILED"]
    assert told["parameters"]["before"] == 1500.0
    assert told["parameters"]["unknown"] is None
    assert told["hop"]["disarm_in_air"] == ["FAILED"]
    assert told["hop"]["from_start_m"] < 1.0


def test_mavproxy_hops_on_ardupilot(flown: Flown) -> None:
    told = flown("mavproxy", "early", "parameters", "hop", speed=8.0)
    assert told["early"]["arm"] == "FAILED"
    assert told["parameters"] == {"before": 1500.0, "after": 1000.0, "unknown": "Unable to find parameter"}
    assert told["hop"]["disarm_in_air"] == "FAILED"
    assert told["hop"]["from_start_m"] < 1.0


def test_dronekit_hops_on_ardupilot(flown: Flown) -> None:
    told = flown("dronekit", "early", "parameters", "hop", speed=5.0)
    assert told["early"]["ack"] == [400, 4]
    assert told["parameters"]["before"] == 1500.0
    assert told["parameters"]["after"] == 1200.0
    assert told["parameters"]["unknown"] is None
    assert told["hop"]["disarm_in_air"] == [400, 4]
    assert told["hop"]["from_start_m"] < 1.0
