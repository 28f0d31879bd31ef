"""TIMESYNC and PING: which messages are answered, and how."""

from __future__ import annotations

from typing import Any

import pytest
from vehicle_client import Client, Make, mavlink, simspec

AUTOPILOTS = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


def answers_to(client: Client, message: Any) -> list[Any]:
    """Messages of the same kind that come back in the same step."""
    client.send(message)
    return [answer for answer in client.fly(0.02) if answer.get_type() == message.get_type()]


@AUTOPILOTS
@pytest.mark.parametrize("target", [(0, 0), (1, 1), (1, 0)])
def test_a_request_for_the_time_is_answered(make: Make, autopilot: str, target: tuple[int, int]) -> None:
    """tc1 is the time since boot in nanoseconds, ts1 the asker's own as it came, and the answer is for the
    asker. ArduCopter has booted 50 s before the session.
    """
    client = make(simspec(autopilot))
    ahead_ns = client.vehicle.time.ns + (50_000_000_000 if autopilot == "ardupilot" else 0)
    (answer,) = answers_to(client, mavlink.MAVLink_timesync_message(0, 2**62 + 1, *target))
    assert (answer.tc1, answer.ts1) == (ahead_ns, 2**62 + 1)
    assert (answer.target_system, answer.target_component) == (245, 190)


@AUTOPILOTS
def test_answers_and_requests_for_others_are_not_answered(make: Make, autopilot: str) -> None:
    client = make(simspec(autopilot))
    assert answers_to(client, mavlink.MAVLink_timesync_message(5, 77)) == []
    assert answers_to(client, mavlink.MAVLink_timesync_message(0, 77, 42, 1)) == []


def test_px4_answers_a_ping_to_everybody(make: Make) -> None:
    """With its number and time, for the sender alone.

    A ping for the vehicle itself is an answer to its own.
    """
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
