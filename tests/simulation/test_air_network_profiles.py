"""The profiles that the bench's topics show in the ROS 2 graph."""

from __future__ import annotations

from test_session import session_simspec

from bench.simulation._air_network import open_air_network
from bench.streams import open_client

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
