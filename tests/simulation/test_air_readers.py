"""The session knows who subscribes to what it tells, also over Zenoh, where a wrong type or hash is silent."""

from __future__ import annotations

import time

import pytest
from test_session import session_simspec

from bench.contracts import START
from bench.simulation import HostClock
from bench.simulation._air_network import AirNetwork, open_air_network
from bench.simulation._air_topics import DOMAIN
from bench.simulation._stop_session import StopSession
from bench.streams import Detection2DArray, String, data_key, open_client

MISSION, INTELLIGENCE = "/vehicle_1/mission", "/vehicle_1/intelligence"
PATIENCE_S = 30.0  # only reached when the test fails


def waits_until_read(air: AirNetwork, topic: str) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while topic in air.unread:
        assert time.monotonic() < deadline_s
        air.receive(START, None, 0.0)


def test_a_subscription_of_another_type_is_none() -> None:
    with open_air_network(session_simspec(), lambda record: None, zenoh=True) as air:
        air.open_for_all()
        assert air.access is not None
        assert {MISSION, INTELLIGENCE} < set(air.unread)
        with open_client(air.access, "agent") as node:
            node.subscribe(INTELLIGENCE, Detection2DArray, latched=True)
            node.subscribe(MISSION, String, latched=True)
            # Zenoh keeps the order on a link: the other subscription has come by then.
            waits_until_read(air, MISSION)
        # It was there, though it is gone.
        assert MISSION not in air.unread
        assert INTELLIGENCE in air.unread


def test_in_lockstep_a_hello_is_held_to_latched_topics_as_well() -> None:
    class Clock:
        now_s = 0.0

        def now(self) -> float:
            self.now_s += 1.0
            return self.now_s

    clock = HostClock(Clock().now, lambda span_s: time.sleep(0.0))
    with open_air_network(session_simspec(), lambda record: None, zenoh=True, clock=clock) as air:
        assert air.access is not None
        with open_client(air.access, "agent") as node:
            node.subscribe(MISSION, Detection2DArray, latched=True)
            with pytest.raises(
                StopSession, match="says it subscribes to /vehicle_1/mission, but does not"
            ) as end:
                air.open_for([MISSION])
    assert data_key(DOMAIN, MISSION, String.TYPE) in end.value.reason


def test_an_agent_without_the_air_network_is_told_nothing_of_it() -> None:
    with open_air_network(session_simspec(), lambda record: None, zenoh=False) as air:
        air.open_for_all()
        assert air.unread == ()
