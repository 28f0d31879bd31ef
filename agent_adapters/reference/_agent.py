"""The agent put together: what came by one moment goes in, what is due goes out."""

from __future__ import annotations

from dataclasses import dataclass

from agent_adapters.client import AgentEnvironment, Moment, Wanted, open_bench
from bench.contracts import (
    CLOCK,
    TF_STATIC,
    ConsentAnswer,
    IntelligenceDocument,
    MissionOrder,
    OperatorLinkDocument,
    OrderDocument,
    VehicleTopics,
    parse_document,
)
from bench.streams import CameraInfo, Clock, Detection2DArray, Sample, String, TFMessage

from ._log import Log, Publish
from ._settings import PolicyName, Settings
from ._watch import Watch
from .flight._vehicle import PilotedVehicle, Sender
from .mission._mission import SearchMission
from .perception._perception import ObjectPerception
from .perception._pose import PoseHistory

LINK = "onboard"


def run(environment: AgentEnvironment, policy: PolicyName) -> str:
    """Fly one session; returns why it ended. Raises SetupError, LinkLost or MissionOrderMissing."""
    settings = Settings.of(environment.options, policy)
    name = f"reference-{policy.replace('_', '-')}"
    with open_bench(name.replace("-", "_"), environment, wanted(environment, settings.camera)) as bench:
        vehicle = environment.vehicle
        agent = Agent(vehicle, AgentParts.of(vehicle, bench.links[LINK], bench.publish, policy, settings))
        for moment in bench.moments(name):
            agent.act(moment)
        return bench.ended


def wanted(environment: AgentEnvironment, camera: str) -> list[Wanted]:
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
        Wanted(topics.detections, Detection2DArray),
        Wanted(topics.camera_info(camera), CameraInfo),
        Wanted(TF_STATIC, TFMessage, latched=True, depth=1),
    ]
    return listened if environment.tick is not None else [*listened, Wanted(CLOCK, Clock)]


@dataclass(frozen=True, slots=True)
class AgentParts:
    """What an agent is made of; parts share the vehicle, the perception and the log."""

    vehicle: PilotedVehicle
    eyes: ObjectPerception
    log: Log
    watch: Watch
    mission: SearchMission

    @classmethod
    def of(
        cls, name: str, link: Sender, publish: Publish, policy: PolicyName, settings: Settings
    ) -> AgentParts:
        """The parts of the reference agent."""
        poses = PoseHistory()
        vehicle, eyes = PilotedVehicle(link, poses), ObjectPerception(poses, settings.mount)
        log = Log(publish, name)
        watch = Watch(vehicle, eyes, log)
        return cls(vehicle, eyes, log, watch, SearchMission(vehicle, eyes, log, watch, policy, settings))


class Agent:
    """One mission's worth of agent."""

    def __init__(self, name: str, parts: AgentParts) -> None:
        self._topics = VehicleTopics(name)
        self._vehicle, self._eyes, self._log = parts.vehicle, parts.eyes, parts.log
        self._watch, self._mission = parts.watch, parts.mission
        self._flight = self._mission.fly()

    def act(self, moment: Moment) -> None:
        """Receive, perceive, decide, send: always in this order."""
        self._log.at(moment.time.s)
        self._vehicle.receive(moment.time.s, moment.frames[LINK])
        # The operator's link first: whether what follows can be heard depends on it.
        for sample in sorted(moment.samples, key=lambda sample: sample.topic != self._topics.operator_link):
            self._take(sample)
        self._watch.update()
        self._mission.send_messages()
        next(self._flight)
        self._vehicle.send_setpoint()
        self._log.publish_due(self._eyes.tracks)

    def _take(self, sample: Sample) -> None:
        topic = sample.topic
        if topic == self._topics.detections:
            message = sample.message()
            self._eyes.process_detections(self._log.now_s)
            if isinstance(message, Detection2DArray) and self._eyes.see(message, self._watch.doubt_m()):
                self._mission.update()
        elif topic == self._topics.mission:
            order = parse_document(MissionOrder, _text(sample))
            if order is not None:
                self._mission.order(order)
        elif topic == self._topics.intelligence:
            intelligence = parse_document(IntelligenceDocument, _text(sample))
            if intelligence is not None:
                self._mission.add_intelligence(intelligence)
        elif topic == self._topics.orders:
            ordered = parse_document(OrderDocument, _text(sample))
            if ordered is not None:
                self._mission.obey(ordered)
        elif topic == self._topics.consents:
            answer = parse_document(ConsentAnswer, _text(sample))
            if answer is not None:
                self._mission.take_consent(answer)
        elif topic == self._topics.operator_link:
            link = parse_document(OperatorLinkDocument, _text(sample))
            if link is not None:
                self._watch.operator_link(link.up)
        elif topic == TF_STATIC:
            message = sample.message()
            if isinstance(message, TFMessage):
                self._eyes.take_mount(message)
        elif topic != CLOCK and not self._eyes.knows_camera:
            message = sample.message()
            if isinstance(message, CameraInfo):
                self._eyes.take_info(message)


def _text(sample: Sample) -> str:
    message = sample.message()
    return message.data if isinstance(message, String) else ""
