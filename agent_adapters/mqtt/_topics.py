"""The MQTT topics of a session, without the prefix: the names of the air network's own, and the bridge's."""

from __future__ import annotations

from collections.abc import Sequence

from bench.contracts import CLOCK, TF, TF_STATIC, VehicleTopics

TICK, READY, ACK, END = "bridge/tick", "bridge/ready", "bridge/ack", "bridge/end"
LINK = "onboard"
MAVLINK_TO_AGENT, MAVLINK_FROM_AGENT = f"mavlink/{LINK}/to_agent", f"mavlink/{LINK}/from_agent"


def topics_to_agent(vehicle: str, cameras: Sequence[str], *, pictures: bool) -> list[str]:
    """What one vehicle's agent may see of the air network; of pictures the compressed ones alone."""
    topics = VehicleTopics(vehicle)
    return [
        *(CLOCK, TF, TF_STATIC, topics.mission, topics.intelligence, topics.orders, topics.consents),
        *(topics.operator_link, topics.detections),
        *map(topics.camera_info, cameras),
        # Those of a further camera; the main one's are above.
        *map(topics.camera_detections, cameras),
        *map(topics.image_compressed, cameras if pictures else ()),
    ]


def topics_from_agent(vehicle: str) -> dict[str, str]:
    """The topics of the air network on which the agent may publish, by MQTT topic."""
    return {topic.lstrip("/"): topic for topic in VehicleTopics(vehicle).from_agent}
