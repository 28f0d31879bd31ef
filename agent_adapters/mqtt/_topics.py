"""The MQTT topics of a session, without the prefix: the names of the air network's own, and the bridge's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from agent_adapters.client import Wanted
from bench.contracts import CLOCK, TF, TF_STATIC, VehicleTopics
from bench.streams import CameraInfo, Clock, CompressedImage, Detection2DArray, String, TFMessage

TICK, READY, ACK, END = "bridge/tick", "bridge/ready", "bridge/ack", "bridge/end"


@dataclass(frozen=True, slots=True)
class MirroredTopics:
    """What one vehicle's agent may see and say. The router refuses everything else, whatever stands here."""

    vehicle: str
    cameras: Sequence[str] = ("front",)
    pictures: bool = False

    def wanted(self) -> list[Wanted]:
        """The subscriptions to the air network; of pictures the compressed ones alone."""
        topics = VehicleTopics(self.vehicle)
        return [
            Wanted(CLOCK, Clock),
            Wanted(TF, TFMessage, depth=100),
            Wanted(TF_STATIC, TFMessage, latched=True, depth=1),
            Wanted(topics.mission, String, latched=True, depth=1),
            Wanted(topics.intelligence, String, latched=True, depth=32),
            Wanted(topics.orders, String, latched=True, depth=32),
            Wanted(topics.consents, String, latched=True, depth=32),
            Wanted(topics.operator_link, String, latched=True, depth=1),
            Wanted(topics.detections, Detection2DArray),
            *(Wanted(topics.camera_info(camera), CameraInfo) for camera in self.cameras),
            # Those of a further camera; the main one's are above.
            *(Wanted(topics.camera_detections(camera), Detection2DArray) for camera in self.cameras),
            *(
                Wanted(topics.image_compressed(camera), CompressedImage)
                for camera in (self.cameras if self.pictures else ())
            ),
        ]

    def from_agent(self) -> dict[str, str]:
        """The topics of the air network on which the agent may publish, by MQTT topic."""
        return {topic.lstrip("/"): topic for topic in VehicleTopics(self.vehicle).from_agent}


def mavlink_to_agent(link: str) -> str:
    """The MQTT topic of what the vehicle sends on a link."""
    return f"mavlink/{link}/to_agent"


def mavlink_from_agent(link: str) -> str:
    """The MQTT topic of what the agent sends on a link."""
    return f"mavlink/{link}/from_agent"
