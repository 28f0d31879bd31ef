"""The agent put together: what came by one moment goes in, what is due goes out."""

from __future__ import annotations

from agent_adapters.client import AgentEnvironment, Moment, Wanted, open_bench
from bench.contracts import CLOCK, TF_STATIC, IntelligenceDocument, MissionOrder, VehicleTopics, parse_document
from bench.streams import CameraInfo, Clock, Detection2DArray, Sample, String, TFMessage

from ._log import Log, Publish
from ._mission import Mission
from ._perception import Perception
from ._pose import PoseHistory
from ._settings import PolicyName, Settings
from ._vehicle import Sender, Vehicle

LINK = "onboard"


def run(environment: AgentEnvironment, policy: PolicyName) -> str:
    """Fly one session; returns why it ended. Raises SetupError, LinkLost or MissionOrderMissing."""
    settings = Settings.of(environment.options)
    name = f"reference-{policy.replace('_', '-')}"
    with open_bench(name.replace("-", "_"), environment, wanted(environment, settings.camera)) as bench:
        agent = Agent(environment.vehicle, bench.links[LINK], bench.publish, policy, settings)
        for moment in bench.moments(name):
            agent.act(moment)
        return bench.ended


def wanted(environment: AgentEnvironment, camera: str) -> list[Wanted]:
    """What the agent listens to. Its pose it takes from MAVLink; the clock only where no tick tells the time."""
    topics = VehicleTopics(environment.vehicle)
    listened = [
        Wanted(topics.mission, String, latched=True, depth=1),
        Wanted(topics.intelligence, String, latched=True, depth=32),
        Wanted(topics.detections, Detection2DArray),
        Wanted(topics.camera_info(camera), CameraInfo),
        Wanted(TF_STATIC, TFMessage, latched=True, depth=1),
    ]
    return listened if environment.tick is not None else [*listened, Wanted(CLOCK, Clock)]


class Agent:
    """One mission's worth of agent."""

    def __init__(self, name: str, link: Sender, publish: Publish, policy: PolicyName, settings: Settings) -> None:
        poses = PoseHistory()
        self._topics = VehicleTopics(name)
        self._vehicle = Vehicle(link, poses)
        self._eyes = Perception(poses, settings.mount)
        self._log = Log(publish, name)
        self._mission = Mission(self._vehicle, self._eyes, self._log, policy, settings)
        self._flight = self._mission.fly()

    def act(self, moment: Moment) -> None:
        """Hear, see, decide, speak: always in this order."""
        self._log.at(moment.time.s)
        self._vehicle.hear(moment.time.s, moment.frames[LINK])
        for sample in moment.samples:
            self._take(sample)
        next(self._flight)
        self._vehicle.speak()
        self._log.speak(self._eyes.tracks)

    def _take(self, sample: Sample) -> None:
        topic = sample.topic
        if topic == self._topics.detections:
            message = sample.message()
            if isinstance(message, Detection2DArray) and self._eyes.see(message):
                self._mission.look()
        elif topic == self._topics.mission:
            order = parse_document(MissionOrder, _text(sample))
            if order is not None:
                self._mission.order(order)
        elif topic == self._topics.intelligence:
            intelligence = parse_document(IntelligenceDocument, _text(sample))
            if intelligence is not None:
                self._mission.tell(intelligence)
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
