"""TIMESYNC and PING: which messages are answered, and how."""

from __future__ import annotations

from typing import Any

import pytest
from vehicle_client import Client, Make, mavlink, simspec


def answers_to(client: Client, message: Any) -> list[Any]:
    """Messages of the same kind that come back in the same step."""
    client.send(message)
    return [answer for answer in client.fly(0.02) if answer.get_type() == message.get_type()]


@pytest.mark.parametrize(("autopilot", "booted_s"), [("px4", 0), ("ardupilot", 50)])
def test_a_request_for_the_time_is_answered(make: Make, autopilot: str, booted_s: int) -> None:
    """tc1 is the time since boot in nanoseconds, ts1 the asker's own. ArduCopter has booted before the session."""
    client = make(simspec(autopilot))
    for target in ((0, 0), (1, 1), (1, 0)):
        now_ns = client.vehicle.time.ns + booted_s * 1_000_000_000
        (answer,) = answers_to(client, mavlink.MAVLink_timesync_message(0, 2**62 + 1, *target))
        assert (answer.tc1, answer.ts1) == (now_ns, 2**62 + 1)
        assert (answer.target_system, answer.target_component) == (245, 190)
    assert answers_to(client, mavlink.MAVLink_timesync_message(5, 77)) == []
    assert answers_to(client, mavlink.MAVLink_timesync_message(0, 77, 42, 1)) == []


def test_px4_answers_a_ping_to_everybody(make: Make) -> None:
    """With its number and time, for the sender alone; a ping for the vehicle itself is an answer to its own."""
    client = make()
    (answer,) = answers_to(client, mavlink.MAVLink_ping_message(123456, 9, 0, 0))
    assert (answer.time_usec, answer.seq) == (123456, 9)
    assert (answer.target_system, answer.target_component) == (245, 190)
    for target in ((1, 1), (42, 1), (42, 0)):
        assert answers_to(client, mavlink.MAVLink_ping_message(123456, 9, *target)) == []


def test_ardupilot_answers_no_ping(make: Make) -> None:
    client = make(simspec("ardupilot"))
    for target in ((0, 0), (1, 1)):
        assert answers_to(client, mavlink.MAVLink_ping_message(123456, 9, *target)) == []
