"""The MQTT topics of a session, without the prefix: the names of the air network's own, and the bridge's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.contracts import CLOCK, TF, TF_STATIC, VehicleTopics

TICK, READY, ACK, END = "bridge/tick", "bridge/ready", "bridge/ack", "bridge/end"


@dataclass(frozen=True, slots=True)
class MirroredTopics:
    """What one vehicle's agent may see and say. The bench refuses everything else, whatever stands here."""

    vehicle: str
    cameras: Sequence[str] = ("front",)
    pictures: bool = False

    def streams(self) -> dict[str, int]:
        """Topics to the agent of which only what is new counts, each with how many messages may wait in real time. Of
        pictures the compressed ones alone.
        """
        topics = VehicleTopics(self.vehicle)
        pictured = self.cameras if self.pictures else ()
        of_cameras = (
            *map(topics.camera_info, self.cameras),
            # Those of a further camera; the main one's are the vehicle's.
            *map(topics.camera_detections, self.cameras),
            *map(topics.image_compressed, pictured),
        )
        return {TF: 100, **dict.fromkeys((CLOCK, topics.detections, *of_cameras), 10)}

    def to_agent(self) -> list[str]:
        """All topics to the agent: what it is told, and the streams."""
        topics = VehicleTopics(self.vehicle)
        told = topics.mission, topics.intelligence, topics.orders, topics.consents, topics.operator_link
        return [TF_STATIC, *told, *self.streams()]

    def from_agent(self) -> dict[str, str]:
        """The topics of the air network on which the agent may publish, by MQTT topic."""
        return {topic.lstrip("/"): topic for topic in VehicleTopics(self.vehicle).from_agent}


def mavlink_to_agent(link: str) -> str:
    """The MQTT topic of what the vehicle sends on a link."""
    return f"mavlink/{link}/to_agent"


def mavlink_from_agent(link: str) -> str:
    """The MQTT topic of what the agent sends on a link."""
    return f"mavlink/{link}/from_agent"
