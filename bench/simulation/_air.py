"""The air network as the session uses it: what the agent hears, and what it says."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterable, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from bench.contracts import CLOCK, TF, TF_STATIC, Outcome, Record, SimTime, Tap, VehicleTopics
from bench.documents import Document
from bench.simspec import SimSpec
from bench.streams import (
    CLOCK_QOS,
    RELIABLE_10,
    TF_QOS,
    AirAccess,
    AirPlan,
    CameraInfo,
    Clock,
    Detection2DArray,
    Publisher,
    QoS,
    RosMessage,
    Router,
    String,
    Subscription,
    TFMessage,
    encode,
    open_router,
)

from ._ending import StopSession

DOMAIN = 1  # each session has a router of its own, so every one may use the same ROS domain
MATCH_BUDGET_S = 5.0
ALLOWED_SAMPLES = (1000, 100.0)  # of the agent, on all topics: at once, and more for each simulated second
ALLOWED_BYTES = (32 * 1024 * 1024, 1024.0 * 1024)
MAX_DOCUMENT_BYTES = 256 * 1024  # the longest valid document, a thousand tracks, and some air


@dataclass(slots=True)
class RecordedPublisher:
    """One topic towards the agent: every message is recorded, and published while `heard`."""

    topic: str
    kind: type[RosMessage]
    tap: Tap
    publisher: Publisher | None
    latched: bool = False
    heard: bool = False

    def publish(self, time: SimTime, message: RosMessage) -> None:
        """Encode once, record, publish."""
        data = encode(message)
        self.tap(Record(time, self.topic, self.kind.TYPE, data))
        if self.publisher is not None and (self.heard or self.latched):
            self.publisher.put_bytes(data)

    def publish_document(self, time: SimTime, document: Document) -> None:
        """A JSON document as std_msgs/String."""
        self.publish(time, String(document.model_dump_json()))

    @property
    def sent(self) -> int:
        """Samples that went out so far."""
        return self.publisher.sequence if self.publisher is not None else 0


@dataclass(slots=True)
class Ear:
    """One topic from the agent."""

    topic: str
    subscription: Subscription


class AirNetwork:
    """Outlets and ears of one session by topic. Without a router (the agent wants none) outlets only record."""

    def __init__(self, simspec: SimSpec, router: Router | None, tap: Tap) -> None:
        self._tap = tap
        self._heard_samples = 0
        self._heard_bytes = 0
        self.access: AirAccess | None = router.access if router else None
        topics = VehicleTopics(simspec.vehicle.name)
        node = router.node("session", f"/{simspec.vehicle.name}") if router else None

        def outlet(topic: str, kind: type[RosMessage], qos: QoS = RELIABLE_10, *, depth: int = 0) -> RecordedPublisher:
            publisher = None
            if node is not None:
                publisher = node.latched(topic, kind, depth=depth) if depth else node.publisher(topic, kind, qos)
            return RecordedPublisher(topic, kind, tap, publisher, latched=depth > 0)

        self.clock = outlet(CLOCK, Clock, CLOCK_QOS)
        self.tf = outlet(TF, TFMessage, TF_QOS)
        self.tf_static = outlet(TF_STATIC, TFMessage, depth=1)
        self.mission = outlet(topics.mission, String, depth=1)
        self.intelligence = outlet(topics.intelligence, String, depth=32)
        self.orders = outlet(topics.orders, String, depth=32)
        self.operator_link = outlet(topics.operator_link, String, depth=1)
        self.camera_info = outlet(topics.camera_info(simspec.vehicle.camera.name), CameraInfo)
        self.detections = outlet(topics.detections, Detection2DArray)
        self._outlets = (
            self.clock,
            self.tf,
            self.tf_static,
            self.mission,
            self.intelligence,
            self.orders,
            self.operator_link,
            self.camera_info,
            self.detections,
        )
        self._ears = tuple(Ear(topic, node.subscribe(topic, String)) for topic in sorted(topics.from_agent)) if node else ()

    def open_for(self, subscribes: Iterable[str]) -> None:
        """Publish to the topics that the agent says it subscribes to, once the network knows of each subscription."""
        wanted = set(subscribes)
        deadline = time.monotonic() + MATCH_BUDGET_S
        for outlet in self._outlets:
            if outlet.topic in wanted:
                outlet.heard = True
                while outlet.publisher is not None and not outlet.publisher.matched:
                    if time.monotonic() > deadline:
                        raise StopSession(Outcome.AGENT_PROTOCOL, f"the agent says it subscribes to {outlet.topic}, but does not")
                    time.sleep(0.001)

    def open_for_all(self) -> None:
        """Publish on every topic, heard or not: the realtime pace, in which nobody introduces himself."""
        for outlet in self._outlets:
            outlet.heard = True

    def sent(self) -> dict[str, int]:
        """Samples sent so far on every topic that the agent listens to."""
        return {outlet.topic: outlet.sent for outlet in self._outlets if outlet.heard}

    def gather(self, time: SimTime, stated: Mapping[str, int] | None, budget_s: float) -> dict[str, list[str | bytes]]:
        """Take in what the agent has said, record it, and return its documents by topic.

        With `stated` (lockstep) exactly as many samples as the agent says that it has sent; otherwise what is here.
        Raises StopSession for an agent that states what does not come, or that floods.
        """
        said: dict[str, list[str | bytes]] = {}
        for ear in self._ears:
            if stated is not None and not ear.subscription.wait(stated.get(ear.topic, 0), budget_s):
                raise StopSession(
                    Outcome.AGENT_PROTOCOL,
                    f"the agent says it sent {stated[ear.topic]} samples on {ear.topic}; {ear.subscription.highest} came",
                )
            if stated is not None and (ear.subscription.lost or ear.subscription.overflowed):
                raise StopSession(Outcome.AGENT_PROTOCOL, f"samples on {ear.topic} were lost: more came at once than can be held")
            for sample in ear.subscription.take():
                self._allow(time, len(sample.data))
                self._tap(Record(time, ear.topic, String.TYPE, sample.data))
                message = sample.message()
                if message is not None:
                    said.setdefault(ear.topic, []).append(message.data)
        return said

    def _allow(self, time: SimTime, size: int) -> None:
        """Count one sample of the agent. One that floods would fill the disk, and the time that its measures take."""
        self._heard_samples += 1
        self._heard_bytes += size
        for heard, (first, each_s), what in (
            (self._heard_samples, ALLOWED_SAMPLES, "samples"),
            (self._heard_bytes, ALLOWED_BYTES, "bytes"),
        ):
            if heard > first + each_s * time.s:
                raise StopSession(
                    Outcome.AGENT_PROTOCOL,
                    f"the agent floods its topics: more than {first:,} {what} and {each_s:,.0f} for each simulated second",
                )

    def counters(self) -> dict[str, int]:
        """What was dropped or malformed on the way in."""
        overflowed = sum(ear.subscription.overflowed for ear in self._ears)
        malformed = sum(ear.subscription.malformed for ear in self._ears)
        lost = sum(ear.subscription.lost for ear in self._ears)
        return {"air_overflowed": overflowed, "air_malformed": malformed, "air_lost": lost}


@contextmanager
def open_air_network(simspec: SimSpec, tap: Tap, *, zenoh: bool) -> Generator[AirNetwork]:
    """The air network of one session: an embedded router with one credential, on which truth never is."""
    topics = VehicleTopics(simspec.vehicle.name)
    camera = topics.camera_info(simspec.vehicle.camera.name)
    plan = AirPlan(
        domain=DOMAIN,
        agent_reads=(
            (CLOCK, Clock.TYPE),
            (TF, TFMessage.TYPE),
            (TF_STATIC, TFMessage.TYPE),
            (topics.mission, String.TYPE),
            (topics.intelligence, String.TYPE),
            (topics.orders, String.TYPE),
            (topics.operator_link, String.TYPE),
            (camera, CameraInfo.TYPE),
            (topics.detections, Detection2DArray.TYPE),
        ),
        agent_writes=tuple((topic, String.TYPE) for topic in topics.from_agent),
        agent_limit_bytes=MAX_DOCUMENT_BYTES,
    )
    with ExitStack() as stack:
        router = stack.enter_context(open_router(plan)) if zenoh else None
        yield AirNetwork(simspec, router, tap)
