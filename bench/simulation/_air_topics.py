"""The topics of a session's air network, and what the session publishes on them: recorded, then sent."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from bench.contracts import CLOCK, TF, TF_STATIC, Record, SimTime, Tap, VehicleTopics, document_text
from bench.simspec import SimSpec
from bench.streams import (
    AP_FROM_AGENT,
    AP_QOS,
    AP_SERVICES,
    AP_TO_AGENT,
    CLOCK_QOS,
    PX4_FROM_AGENT,
    PX4_TO_AGENT,
    RELIABLE_10,
    SENSOR_DATA,
    TF_QOS,
    CameraInfo,
    Clock,
    CompressedImage,
    Detection2DArray,
    Image,
    Publisher,
    QoS,
    RosMessage,
    RosNode,
    Service,
    String,
    Subscription,
    TFMessage,
    ap_message,
    data_key,
    encode,
    json_value,
    px4_message,
    px4_names,
)

from ._allowance import PX4_SAMPLES, TOPIC_SAMPLES, Limit
from ._outbox import Outbox

# Every session has a router of its own, so all of them may use the same ROS domain.
DOMAIN = 1


@dataclass(frozen=True, slots=True)
class AirTopic:
    """A topic of one session's air network, or a `service` of the vehicle's, whose requests are from the agent. `depth` is 0
    for one that is not latched.
    """

    name: str
    kind: type[RosMessage]
    qos: QoS = RELIABLE_10
    depth: int = 0
    from_agent: bool = False
    samples: Limit = TOPIC_SAMPLES
    """How many of the agent's are recorded."""
    service: bool = False

    @property
    def direction(self) -> str:
        if self.service:
            return "a service"
        return "from the agent" if self.from_agent else "to the agent"

    @property
    def key(self) -> str:
        """Where its samples travel."""
        return data_key(DOMAIN, self.name, self.kind)


def air_topics(
    simspec: SimSpec, px4_msgs: str | None = None, ap_dds: str | None = None
) -> tuple[AirTopic, ...]:
    """Every topic that the agent may read, in the order of docs/streams.md, then every one that it may write. With a release
    of `px4_msgs` also those of PX4, and with `ap_dds` those of ArduPilot and its services.
    """
    topics, autopilot = VehicleTopics(simspec.vehicle.name), autopilot_topics(px4_msgs, ap_dds)
    cameras = [
        topic
        for camera in simspec.vehicle.cameras
        for topic in (
            AirTopic(topics.camera_info(camera.name), CameraInfo, SENSOR_DATA),
            AirTopic(topics.image_raw(camera.name), Image, SENSOR_DATA),
            AirTopic(topics.image_compressed(camera.name), CompressedImage, SENSOR_DATA),
        )
    ]
    return (
        AirTopic(CLOCK, Clock, CLOCK_QOS),
        AirTopic(TF, TFMessage, TF_QOS),
        AirTopic(TF_STATIC, TFMessage, depth=1),
        AirTopic(topics.mission, String, depth=1),
        AirTopic(topics.intelligence, String, depth=32),
        AirTopic(topics.orders, String, depth=32),
        AirTopic(topics.consents, String, depth=32),
        AirTopic(topics.operator_link, String, depth=1),
        AirTopic(topics.detections, Detection2DArray, SENSOR_DATA),
        *cameras,
        *(
            AirTopic(topics.camera_detections(camera), Detection2DArray, SENSOR_DATA)
            for camera in simspec.perception.more_cameras
        ),
        *(topic for topic in autopilot if not topic.from_agent),
        *(AirTopic(topic, String, from_agent=True) for topic in topics.from_agent),
        *(topic for topic in autopilot if topic.from_agent),
    )


def px4_to_agent(release: str | None) -> list[AirTopic]:
    """PX4's topics for a companion; none without a release."""
    if release is None:
        return []
    # Whoever comes late still learns home, which is said once; as over uXRCE-DDS.
    return [
        AirTopic(name, px4_message(kind, release), SENSOR_DATA, depth=int(kind == "HomePosition"))
        for topic, kind in PX4_TO_AGENT.items()
        for name in px4_names(topic, release)
    ]


def px4_from_agent(release: str | None) -> list[AirTopic]:
    """PX4's topics that a companion writes; none without a release."""
    if release is None:
        return []
    return [
        AirTopic(name, px4_message(kind, release), from_agent=True, samples=PX4_SAMPLES)
        for topic, kind in PX4_FROM_AGENT.items()
        for name in px4_names(topic, release)
    ]


def autopilot_topics(px4_msgs: str | None, ap_dds: str | None) -> list[AirTopic]:
    """The topics and services of the vehicle's autopilot, in the releases of an agent's manifest."""
    px4 = [*px4_to_agent(px4_msgs), *px4_from_agent(px4_msgs)]
    if ap_dds is None:
        return px4
    out = [
        AirTopic(name, ap_message(kind), qos, depth=qos.depth if qos.latched else 0)
        for (name, kind), qos in zip(AP_TO_AGENT.items(), AP_QOS.values(), strict=True)
    ]
    into = [
        AirTopic(name, ap_message(kind), from_agent=True, samples=PX4_SAMPLES, service=name in AP_SERVICES)
        for name, kind in {**AP_FROM_AGENT, **AP_SERVICES}.items()
    ]
    return [*px4, *out, *into]


@dataclass(slots=True)
class RecordedPublisher:
    """One topic towards the agent, or the answers of a service, which leave whoever counts them.

    Every message is recorded unless `recorded` is false, and published once the topic is `opened` or latched; with
    `while_matched` only while the network knows of a subscription.
    """

    topic: str
    kind: type[RosMessage]
    tap: Tap
    publisher: Publisher | Service | None
    latched: bool = False
    opened: bool = False
    recorded: bool = True
    while_matched: bool = False
    outbox: Outbox | None = None
    """Of a session whose ticks carry the air network: what the next tick takes along."""

    @property
    def listened(self) -> bool:
        """Whether what is published now reaches a reader, as far as the session knows."""
        if self.outbox is not None:
            return self.opened
        if self.publisher is None or not (self.opened or self.latched):
            return False
        return not self.while_matched or self.publisher.matched

    def publish(self, time: SimTime, message: RosMessage) -> None:
        """Encode a message once, record it and publish it."""
        self._publish(time, message, message)

    def publish_document(self, time: SimTime, document: object) -> None:
        """Publish a JSON document as std_msgs/String."""
        self._publish(time, String(document_text(document)), document)

    def _publish(self, time: SimTime, message: RosMessage, value: object) -> None:
        data = encode(message)
        if self.recorded:
            self.tap(Record(time, self.topic, self.kind.TYPE, data, value))
        # What is latched is kept for a reader that has not said yet what it reads.
        if self.outbox is not None and (self.opened or (self.latched and not self.outbox.has_reader)):
            # A String of the air network is a JSON document already.
            content = json.loads(message.data) if isinstance(message, String) else json_value(message)
            self.outbox.add(self.topic, content, len(data), latched=self.latched)
        elif self.publisher is not None and self.listened:
            self.publisher.put_bytes(data)

    @property
    def sent(self) -> int:
        """Samples published so far."""
        return self.publisher.sequence if self.publisher is not None else 0


@dataclass(frozen=True, slots=True)
class CameraPublishers:
    """The topics of one camera."""

    info: RecordedPublisher
    raw: RecordedPublisher
    compressed: RecordedPublisher
    detections: RecordedPublisher | None = None
    """Of a further camera that perception works on."""

    @property
    def all(self) -> tuple[RecordedPublisher, ...]:
        """In the order in which they are advertised."""
        return self.info, *([self.detections] if self.detections else []), self.raw, self.compressed


def recorded_publisher(
    topic: AirTopic, node: RosNode | None, tap: Tap, outbox: Outbox | None
) -> RecordedPublisher:
    """What publishes a topic: on the network where there is a node, with the next tick where there is an outbox."""
    publisher = None
    if node is not None and topic.depth:
        publisher = node.latched(topic.name, topic.kind, depth=topic.depth)
    elif node is not None:
        publisher = node.publisher(topic.name, topic.kind, topic.qos)
    return RecordedPublisher(topic.name, topic.kind, tap, publisher, latched=topic.depth > 0, outbox=outbox)


def answer_publishers(subscriptions: Iterable[Subscription], tap: Tap) -> dict[str, RecordedPublisher]:
    """What publishes the answers of services, by service: whether or not the agent counts them."""
    return {
        service.topic: RecordedPublisher(service.topic, service.response, tap, service, latched=True)
        for service in subscriptions
        if isinstance(service, Service)
    }


def camera_publishers(
    simspec: SimSpec, recorded: Callable[[str], RecordedPublisher]
) -> tuple[CameraPublishers, ...]:
    """The publishers of each camera, made by `recorded` from the name of a topic."""
    topics = VehicleTopics(simspec.vehicle.name)
    cameras = []
    for camera in simspec.vehicle.cameras:
        publishers = CameraPublishers(
            recorded(topics.camera_info(camera.name)),
            recorded(topics.image_raw(camera.name)),
            recorded(topics.image_compressed(camera.name)),
            recorded(topics.camera_detections(camera.name))
            if camera.name in simspec.perception.more_cameras
            else None,
        )
        # A minute of raw pictures is 276 MB; their digests are in the recording, and JPEG when it is asked for.
        publishers.raw.recorded, publishers.compressed.recorded = False, camera.record_frames
        cameras.append(publishers)
    return tuple(cameras)
