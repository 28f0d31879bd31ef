"""The agent put together: what came by one moment goes in, what is due goes out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any
from zlib import crc32

from agent_adapters.client import AgentEnvironment, Moment, Wanted, open_bench
from agent_adapters.client.documents import parse_document
from bench.contracts import (
    CLOCK,
    TF_STATIC,
    ConsentAnswer,
    IntelligenceDocument,
    MissionOrder,
    OperatorLinkDocument,
    OrderDocument,
    VehicleTopics,
)
from bench.streams import CameraInfo, Clock, CompressedImage, Detection2DArray, Sample, String, TFMessage
from bench.values import value_class

from ._log import Log, Publish
from ._settings import DEFAULTS, Eyes, PolicyName, Settings
from ._watch import Watch
from .flight._piloted_vehicle import PilotedVehicle, Sender
from .mission._mission import SearchMission
from .perception._perception import ObjectPerception
from .perception._pose import PoseHistory

if TYPE_CHECKING:
    from bench.contracts import PixelDetector

    from .perception._pictures import PictureDetections

LINK = "onboard"


def run(environment: AgentEnvironment, policy: PolicyName, eyes: Eyes = "detections") -> str:
    """Fly one session; returns why it ended. Raises SetupError and LinkLost."""
    settings = Settings.of(environment.options, policy)
    name = f"reference-{'pictures' if eyes == 'pictures' else policy.replace('_', '-')}"
    detector: PixelDetector | None = None
    if eyes == "pictures":
        # Imported only by an agent that sees for itself: OpenCV, scipy and the network cost the others a second at the start.
        from .perception._pictures import open_shipped_detector

        detector = open_shipped_detector()
    if policy == "bystander_aware":
        # It asks for many places in many views: NumPy is imported before the flight, not in the middle of it.
        import_module("numpy")
    topics = wanted(environment, settings.camera, eyes)
    with open_bench(name.replace("-", "_"), environment, topics) as bench:
        vehicle = environment.vehicle
        parts = AgentParts.of(vehicle, bench.links[LINK], bench.publish, policy, settings, detector)
        agent = Agent(vehicle, parts)
        for moment in bench.moments(name):
            agent.act(moment)
        return bench.ended


def wanted(environment: AgentEnvironment, camera: str, eyes: Eyes = "detections") -> list[Wanted]:
    """What the agent listens to.

    Its pose it takes from MAVLink; the clock only where no tick tells the time.
    """
    topics = VehicleTopics(environment.vehicle)
    listened = [
        Wanted(topics.mission, String, latched=True, depth=1),
        Wanted(topics.intelligence, String, latched=True, depth=32),
        Wanted(topics.orders, String, latched=True, depth=32),
        Wanted(topics.consents, String, latched=True, depth=32),
        Wanted(topics.operator_link, String, latched=True, depth=1),
        Wanted(topics.detections, Detection2DArray)
        if eyes == "detections"
        else Wanted(topics.image_compressed(camera), CompressedImage),
        Wanted(topics.camera_info(camera), CameraInfo),
        Wanted(TF_STATIC, TFMessage, latched=True, depth=1),
    ]
    return listened if environment.tick is not None else [*listened, Wanted(CLOCK, Clock)]


@value_class(frozen=True, slots=True)
class AgentParts:
    """What an agent is made of; parts share the vehicle, the perception and the log."""

    vehicle: PilotedVehicle
    eyes: ObjectPerception
    log: Log
    watch: Watch
    mission: SearchMission
    pictures: PictureDetections | None = None  # None: it gets the bench's detections
    settings: Settings = DEFAULTS

    @classmethod
    def of(
        cls,
        name: str,
        link: Sender,
        publish: Publish,
        policy: PolicyName,
        settings: Settings,
        detector: PixelDetector | None = None,
    ) -> AgentParts:
        """The parts of the reference agent. With a detector it makes its detections itself, from pictures."""
        poses = PoseHistory()
        vehicle = PilotedVehicle(link, poses)
        eyes = ObjectPerception(poses, settings.mount, own_identities=detector is not None)
        pictures: PictureDetections | None = None
        if detector is not None:
            from .perception._pictures import PictureDetections  # see `run`

            pictures = PictureDetections(detector, poses, lambda: eyes.camera)
        log = Log(publish, name)
        watch = Watch(vehicle, eyes, log)
        mission = SearchMission(vehicle, eyes, log, watch, policy, settings)
        return cls(vehicle, eyes, log, watch, mission, pictures, settings)


class Agent:
    """One mission's worth of agent."""

    def __init__(self, name: str, parts: AgentParts) -> None:
        self._topics = VehicleTopics(name)
        self._vehicle, self._eyes, self._log = parts.vehicle, parts.eyes, parts.log
        self._watch, self._mission, self._pictures = parts.watch, parts.mission, parts.pictures
        self._flight = self._mission.fly()
        self._settings = parts.settings
        self._unread: deque[tuple[float, OrderDocument]] = deque()  # orders, each with when it is read
        # What reads each topic of documents.
        self._documents: dict[str, tuple[type[Any], Callable[[Any], object]]] = {
            self._topics.mission: (MissionOrder, self._mission.order),
            self._topics.intelligence: (IntelligenceDocument, self._mission.add_intelligence),
            self._topics.orders: (OrderDocument, self._receive_order),
            self._topics.consents: (ConsentAnswer, self._mission.take_consent),
            self._topics.operator_link: (OperatorLinkDocument, self._watch.operator_link),
        }

    def act(self, moment: Moment) -> None:
        """Receive, perceive, decide, send: always in this order."""
        self._log.at(moment.time.s)
        self._vehicle.receive(moment.time.s, moment.frames[LINK])
        # The operator's link first: whether what follows can be heard depends on it.
        for sample in sorted(moment.samples, key=lambda sample: sample.topic != self._topics.operator_link):
            self._take(sample)
        while self._unread and self._unread[0][0] <= moment.time.s:
            self._mission.obey(self._unread.popleft()[1])
        self._watch.update()
        self._mission.send_messages()
        next(self._flight)
        self._vehicle.send_setpoint()
        self._log.publish_due(self._eyes.published)

    def _take(self, sample: Sample) -> None:
        if sample.topic == self._topics.detections:
            message = sample.message()
            self._see(message if isinstance(message, Detection2DArray) else None)
        elif sample.topic in self._documents:
            kind, take = self._documents[sample.topic]
            message = sample.message()
            document = parse_document(kind, message.data if isinstance(message, String) else "")
            if document is not None:
                take(document)
        elif sample.topic == TF_STATIC:
            message = sample.message()
            if isinstance(message, TFMessage):
                self._eyes.take_mount(message)
        elif sample.topic != CLOCK:
            self._take_camera(sample)

    def _receive_order(self, order: OrderDocument) -> None:
        if self._settings.order_delay_s > 0.0:
            self._unread.append((self._log.now_s + self._settings.order_delay_s, order))
        else:
            self._mission.obey(order)

    def _take_camera(self, sample: Sample) -> None:
        """A picture, or what the camera is like."""
        if self._pictures is None and self._eyes.knows_camera:
            return
        message = sample.message()
        if isinstance(message, CameraInfo) and not self._eyes.knows_camera:
            self._eyes.take_info(message)
        elif isinstance(message, CompressedImage) and self._pictures is not None:
            self._see(self._pictures.detections(message))

    def _see(self, detections: Detection2DArray | None) -> None:
        """What a detector says; None when it says nothing that can be understood."""
        self._eyes.process_detections(self._log.now_s)
        if detections is None:
            return
        if self._settings.kept_detections < 1.0:
            detections = kept_detections(detections, self._settings.kept_detections)
        if self._eyes.see(detections, self._watch.doubt_m()):
            self._mission.update()


# A tracker bridges single frames, so what is lost is lost for longer. Chosen, not measured.
_LOST_NS = 3_000_000_000


def kept_detections(frame: Detection2DArray, share: float) -> Detection2DArray:
    """The frame with this share of its objects. Each stays or is lost for three seconds, by a hash of its id and
    the time: an agent has no seed, and a hash repeats as the session does.
    """
    window = frame.header.stamp.ns // _LOST_NS
    return replace(
        frame,
        detections=tuple(
            detection
            for detection in frame.detections
            if crc32(f"{detection.id} {window}".encode()) < share * 2**32
        ),
    )
