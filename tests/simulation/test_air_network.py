"""What the air network shows and keeps to itself; and who reads it, also over Zenoh, where a wrong type is silent."""

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


def test_truth_is_not_published_to_the_agent() -> None:
    """No topic that an agent may read carries truth: the allow-list has the mission's alone."""
    with open_air_network(session_simspec(), lambda record: None, zenoh=True) as air:
        topics = {recorded.topic for recorded in air._publishers}
    assert topics
    assert not any(topic.startswith(("/truth", "/session", "/mavlink")) for topic in topics)


PROFILES = {
    # Reliability, durability, depth as rmw_zenoh writes them: 2 is best effort, 1 after it transient local.
    "%clock": "2::,1",
    "%tf": "::,100",
    "%tf_static": ":1:,1",
    "%vehicle_1%mission": ":1:,1",
    "%vehicle_1%orders": ":1:,32",
    "%vehicle_1%detections": "2::,5",
    "%vehicle_1%camera%front%camera_info": "2::,5",
    "%vehicle_1%camera%front%image_raw": "2::,5",
    "%vehicle_1%camera%front%image_raw%compressed": "2::,5",
}


def test_topics_are_advertised_as_ros_users_expect_them() -> None:
    """Sensor topics have the sensor profile (best effort, the last five), so that tools and nodes with that
    profile match them; documents are latched.
    """
    with (
        open_air_network(session_simspec(), lambda record: None, zenoh=True) as air,
        open_client(air.access, "tool") as node,  # type: ignore[arg-type]  # there is a router
    ):
        replies = node._session.liveliness().get("@ros2_lv/1/**", timeout=5.0)
        tokens = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
    published = [token.split("/") for token in tokens if "/MP/" in token]
    shown = {chunks[-4]: chunks[-1].rsplit(":,:,:,,", 1)[0] for chunks in published}
    assert {topic: shown[topic] for topic in PROFILES} == PROFILES
