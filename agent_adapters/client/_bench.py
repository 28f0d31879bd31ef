"""The air network as an agent meets it: subscriptions, publishers, MAVLink links, and the moments at which it
acts.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from bench.clock import CLOCK, SimTime
from bench.errors import LinkLost, SetupError
from bench.streams import AirAccess, Clock, String, open_client
from bench.values import value_class

from ._environment import AgentEnvironment
from ._link import MavlinkFrame, MavlinkLink, open_link
from ._protocol import End, Tick
from ._ticks import TickLine, open_tick_line

if TYPE_CHECKING:
    from bench.streams import Publisher, RosNode, Sample, Subscription

# Host time for what a tick states to come in. Chosen, not measured.
ARRIVAL_S = 10.0
# Host time without a clock, in the realtime pace, after which the session is taken for gone. Chosen, not
# measured.
SILENCE_S = 30.0


@value_class(frozen=True, slots=True)
class Wanted:
    """One topic that an agent listens to. `kind` is a message class of bench.streams."""

    topic: str
    kind: type[Any]
    latched: bool = False
    depth: int = 10


@value_class(frozen=True, slots=True)
class Moment:
    """What had come by one simulated moment: samples by name of topic and then in order, MAVLink frames by
    link in order.
    """

    time: SimTime
    samples: tuple[Sample, ...]
    frames: Mapping[str, tuple[MavlinkFrame, ...]]


class Bench:
    """An open connection to the air network. Made by `open_bench`."""

    def __init__(
        self,
        environment: AgentEnvironment,
        node: RosNode | None,
        links: Mapping[str, MavlinkLink],
        wanted: Sequence[Wanted],
    ) -> None:
        self.environment = environment
        self.links = links
        self.ended = ""
        self._node = node
        self._publishers: dict[str, Publisher] = {}
        self._subscriptions: dict[str, Subscription] = {}
        # Sorted, because the order of subscriptions is the order of the samples in a Moment.
        for topic_wanted in sorted(wanted, key=lambda topic_wanted: topic_wanted.topic):
            if node is None:
                raise SetupError(
                    "REBAR_ZENOH", "is not set, but this agent subscribes", "set zenoh: true in its manifest"
                )
            self._subscriptions[topic_wanted.topic] = node.subscribe(
                topic_wanted.topic, topic_wanted.kind, latched=topic_wanted.latched, depth=topic_wanted.depth
            )

    def publish(self, topic: str, document: str) -> None:
        """Publish a JSON document as std_msgs/String."""
        if self._node is None:
            raise SetupError(
                "REBAR_ZENOH", "is not set, but this agent publishes", "set zenoh: true in its manifest"
            )
        if topic not in self._publishers:
            self._publishers[topic] = self._node.publisher(topic, String)
        self._publishers[topic].put(String(document))

    def moments(self, name: str, tick_s: float = 0.1) -> Iterator[Moment]:
        """The moments at which to act, until the session ends; going on to the next says that this one is
        dealt with.

        In lockstep one for each tick, holding exactly what the bench says it sent. In the realtime pace one
        every `tick_s` seconds with what has come, timed by /clock (which must be among the subscriptions).
        Raises LinkLost when the bench falls silent or what it stated never arrives.
        """
        address = self.environment.tick
        return self._by_ticks(name, address) if address is not None else self._by_clock(tick_s)

    def _by_ticks(self, name: str, address: tuple[str, int]) -> Iterator[Moment]:
        with open_tick_line(address) as line:
            # Only now, when links are bound and topics subscribed: the bench starts to publish after the
            # hello.
            line.hello(name, tuple(self._subscriptions), self.environment.tick_secret)
            while True:
                message = line.next()
                if isinstance(message, End):
                    self.ended = message.reason or "the session is over"
                    return
                self._await(message)
                yield self._gather(SimTime(message.time_ns))
                self._acknowledge(line, message)

    def _acknowledge(self, line: TickLine, tick: Tick) -> None:
        topics = {topic: publisher.sequence for topic, publisher in self._publishers.items()}
        line.ack(tick, topics, {name: link.sent for name, link in self.links.items()})

    def _await(self, tick: Tick) -> None:
        for topic, subscription in self._subscriptions.items():
            stated = tick.topics.get(topic, 0)
            if not subscription.wait(stated, ARRIVAL_S):
                raise LinkLost(f"{topic}: {subscription.highest} of {stated} samples came in {ARRIVAL_S:g} s")
        for name, link in self.links.items():
            link.wait(tick.links.get(name, 0), ARRIVAL_S)

    def _by_clock(self, tick_s: float) -> Iterator[Moment]:
        if CLOCK not in self._subscriptions:
            raise SetupError(
                CLOCK, "is not among the subscriptions", "the realtime pace takes its time from it"
            )
        due = advanced = time.monotonic()
        last = SimTime(-1)
        while True:
            # An agent that is late skips the moments it missed, instead of acting on them in a burst.
            due = max(due + tick_s, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
            for link in self.links.values():
                link.poll()
            moment = self._gather(last)
            now = _latest_clock(moment.samples)
            if now is not None and now > last:
                last, advanced = now, time.monotonic()
            if last.ns >= 0:
                yield Moment(last, moment.samples, moment.frames)
            if time.monotonic() - advanced > SILENCE_S:
                raise LinkLost(f"{CLOCK} has been silent for {SILENCE_S:g} s")

    def _gather(self, now: SimTime) -> Moment:
        samples = tuple(
            sample for subscription in self._subscriptions.values() for sample in subscription.take()
        )
        return Moment(now, samples, {name: tuple(link.take()) for name, link in self.links.items()})


def _latest_clock(samples: Sequence[Sample]) -> SimTime | None:
    clocks = [sample for sample in samples if sample.topic == CLOCK]
    message = clocks[-1].message() if clocks else None
    return SimTime(message.clock.ns) if isinstance(message, Clock) else None


@contextmanager
def open_bench(name: str, environment: AgentEnvironment, wanted: Sequence[Wanted] = ()) -> Generator[Bench]:
    """Connect to the air network: bind the MAVLink links, open the Zenoh session, declare the subscriptions.

    `name` names the agent's node in the graph. Raises LinkLost when something does not answer.
    """
    with ExitStack() as stack:
        links = {
            link: stack.enter_context(open_link(link, text))
            for link, text in sorted(environment.mavlink.items())
        }
        node = stack.enter_context(open_client(_access(environment), name)) if environment.zenoh else None
        yield Bench(environment, node, links, wanted)


def _access(environment: AgentEnvironment) -> AirAccess:
    assert environment.zenoh is not None
    return AirAccess(
        locator=environment.zenoh,
        user=environment.zenoh_user,
        password=environment.zenoh_password,
        domain=environment.domain,
    )
