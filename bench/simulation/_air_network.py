"""The air network as the session uses it: recorded publishers towards the agent, and subscriptions to what it
sends.
"""

from __future__ import annotations

import difflib
import json
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from operator import attrgetter
from typing import Any, NoReturn

from bench.contracts import (
    CLOCK,
    TF,
    TF_STATIC,
    AirMessage,
    Outcome,
    Record,
    SimTime,
    Tap,
    VehicleTopics,
)
from bench.simspec import SimSpec
from bench.streams import (
    AirAccess,
    AirPlan,
    RosNode,
    Router,
    Sample,
    String,
    Subscription,
    data_key,
    encode,
    open_router,
)

from ._air_topics import (
    DOMAIN,
    AirTopic,
    RecordedPublisher,
    air_topics,
    answer_publishers,
    autopilot_topics,
    camera_publishers,
    recorded_publisher,
)
from ._allowance import MAX_DROPPED_BYTES, MAX_DROPPED_SAMPLES, TopicAllowance
from ._companion_topics import need_of, unmatched_topics
from ._host_clock import HOST_CLOCK, HostClock
from ._outbox import Outbox
from ._outside_air import open_outside_air, read_token
from ._stop_session import StopSession

# Host time until a subscription that the agent declared is matched. Chosen, not measured.
MATCH_BUDGET_S = 5.0
MATCH_POLL_S = 0.001
# Host time that a sample of many fragments, such as a raw picture, waits for its reader. Chosen, not measured.
LARGE_SAMPLE_WAIT_S = 5.0
# The longest valid document is AgentTracks with a thousand tracks; this leaves room above it.
MAX_DOCUMENT_BYTES = 256 * 1024
# Beats of a pace that does not wait, between two looks for subscriptions: half a second. Chosen.
LOOKS_FOR_READERS = 25
# Of a topic in a reason; the line of a hello may be a thousand times as long.
_SHOWN_CHARACTERS = 80


class AirNetwork:
    """Publishers and subscriptions of one session.

    Without a router (the agent wants none) publishers only record; with `in_ticks` the next tick takes along what they
    publish, and acknowledgements bring what the agent sends. `on_drop` is called with the topic when the first
    of its samples is dropped. `releases` are the manifest's, of the topics of each autopilot.
    """

    def __init__(
        self,
        simspec: SimSpec,
        router: Router | None,
        tap: Tap,
        clock: HostClock,
        on_drop: Callable[[SimTime, str], None],
        in_ticks: bool,
        releases: Mapping[str, str | None],
    ) -> None:
        self._tap = tap
        self._router = router
        self._releases = releases
        self.outbox = Outbox() if in_ticks else None
        self._clock = clock
        self._on_drop = on_drop
        self.access: AirAccess | None = router.access if router else None
        self._topics = topics = VehicleTopics(simspec.vehicle.name)
        node = router.node("session", f"/{simspec.vehicle.name}") if router else None

        table = {topic.name: topic for topic in air_topics(simspec, **releases)}

        def recorded(name: str) -> RecordedPublisher:
            return recorded_publisher(table[name], node, tap, self.outbox)

        self.clock = recorded(CLOCK)
        self.tf = recorded(TF)
        self.tf_static = recorded(TF_STATIC)
        self.mission = recorded(topics.mission)
        self.intelligence = recorded(topics.intelligence)
        self.orders = recorded(topics.orders)
        self.consents = recorded(topics.consents)
        self.operator_link = recorded(topics.operator_link)
        self.detections = recorded(topics.detections)
        self.cameras = camera_publishers(simspec, recorded)
        # Sorted, because the order in which topics are read is the order of their records within a moment.
        written = sorted((topic for topic in table.values() if topic.from_agent), key=attrgetter("name"))
        self._subscriptions = _subscribe(node, written)
        self._autopilot_topics = autopilot_topics(**releases)
        self.companion = {
            topic.name: recorded(topic.name) for topic in self._autopilot_topics if not topic.from_agent
        }
        self.companion |= answer_publishers(self._subscriptions, tap)
        # What an agent is told in words, and the detections.
        told = (
            self.mission,
            self.intelligence,
            self.orders,
            self.consents,
            self.operator_link,
            self.detections,
        )
        self._publishers = (
            self.clock,
            self.tf,
            self.tf_static,
            *told,
            *(publisher for publishers in self.cameras for publisher in publishers.all),
            *self.companion.values(),
        )
        self._unread = {recorded.topic: recorded for recorded in told} if router or in_ticks else {}
        self._beats = 0
        self._keys = {topic.name: topic.key for topic in written}
        self._allowances = {topic.name: TopicAllowance(topic.samples) for topic in written}
        # In lockstep: samples that have come and that no ack has stated yet.
        self._unstated: dict[str, deque[Sample]] = {topic: deque() for topic in self._allowances}

    def open_for(self, subscribes: Iterable[str]) -> None:
        """Publish from now on to the topics that the agent declares, once the network knows of each of its
        subscriptions.
        """
        declared = set(subscribes)
        self._check_known(declared)
        if self.outbox is not None:
            self.outbox.open_for(declared)
        self._unread = {topic: recorded for topic, recorded in self._unread.items() if topic not in declared}
        deadline_s = self._clock.now() + MATCH_BUDGET_S
        for recorded in self._publishers:
            if recorded.topic in declared:
                recorded.opened = True
                while recorded.publisher is not None and not recorded.publisher.has_reader:
                    if self._clock.now() > deadline_s:
                        key = data_key(DOMAIN, recorded.topic, recorded.kind)
                        raise StopSession(
                            Outcome.AGENT_PROTOCOL,
                            f"the agent says it subscribes to {recorded.topic}, but does not: the key is {key}",
                        )
                    self._clock.sleep(MATCH_POLL_S)

    def _check_known(self, declared: set[str]) -> None:
        """Raise StopSession for topics that no session has: what is misspelt stays silent, and the agent waits for ever."""
        # Cameras of other names are let pass: an agent may be made for vehicles with more of them.
        published = [recorded.topic for recorded in self._publishers]
        known = {*published, *self._allowances}
        for topic in sorted(declared - known):
            if not self._topics.is_of_camera(topic):
                field, _ = need_of(topic) or ("", "")
                lacking = field and self._releases[field] is None
                without = f"without {field} in its manifest" if lacking else "in any session"
                self._refuse_topic(
                    topic, published, "the agent's hello subscribes to", f"it cannot read {without}"
                )

    def _refuse_topic(self, topic: str, known: Sequence[str], deed: str, reason: str) -> NoReturn:
        """End the session over a topic, with the one that was probably meant."""
        close = difflib.get_close_matches(topic, known, n=1)
        remedy = f"did you mean {close[0]}?" if close else f"there are {', '.join(known)}"
        raise StopSession(
            Outcome.AGENT_PROTOCOL,
            f"{deed} {topic[:_SHOWN_CHARACTERS]!r}, a topic that {reason}; {remedy}",
        )

    def open_for_all(self) -> None:
        """Publish on every topic, subscribed or not: at the realtime pace an agent sends no hello that names
        its topics.
        """
        for recorded in self._publishers:
            recorded.opened = True
        # In lockstep the hello alone decides: what the network knows at a moment depends on the host.
        for publishers in self.cameras:
            publishers.raw.while_matched = publishers.compressed.while_matched = True

    def sent(self) -> dict[str, int]:
        """Samples published so far on every topic that the agent subscribes to."""
        return {recorded.topic: recorded.sent for recorded in self._publishers if recorded.opened}

    def receive(
        self, time: SimTime, stated: Mapping[str, int] | None, budget_s: float
    ) -> dict[str, list[Any]]:
        """Record what the agent has sent and return its documents by topic; of PX4's topics the messages.

        With `stated` (lockstep) exactly as many samples as the agent says that it has sent; otherwise what
        has arrived. What is beyond the limits of its topic is dropped: neither recorded nor returned. Raises
        StopSession for an agent that states samples that do not come, or that floods.
        """
        if stated is None:
            self._look_for_readers()
        documents: dict[str, list[Any]] = {}
        dropped = False
        for subscription in self._subscriptions:
            topic = subscription.topic
            count = None if stated is None else stated.get(topic, 0)
            # Most topics have nothing new in most ticks, and are asked in each.
            if count is not None and (
                subscription.highest < count or subscription.overflowed or subscription.lost
            ):
                self._await_stated(subscription, count, budget_s)
            for sample in self._due(subscription, count):
                if not self._admits(time, topic, len(sample.data)):
                    dropped = True
                    continue
                message = sample.message()
                if subscription.kind is String:
                    self._tap(Record(time, topic, String.TYPE, sample.data))
                elif message is not None:
                    # With its value, because the layout of its type is that of a release.
                    self._tap(Record(time, topic, subscription.kind.TYPE, sample.data, message))
                else:
                    subscription.malformed += 1
                if message is not None:
                    subscription.accept(sample.sequence)
                    content = message.data if isinstance(message, String) else message
                    documents.setdefault(topic, []).append(content)
        if dropped:
            self._check_flood()
        return documents

    def receive_messages(self, time: SimTime, messages: Iterable[AirMessage]) -> dict[str, list[Any]]:
        """Record what an acknowledgement brought, and return it as `receive` does. Raises StopSession for a topic that the
        agent may not write.
        """
        documents: dict[str, list[Any]] = {}
        dropped = False
        # As over Zenoh: by topic, and in the order of each.
        for message in sorted(messages, key=lambda message: message.topic):
            topic, content = message.topic, message.message
            text = content if isinstance(content, str) else json.dumps(content)
            if topic not in self._allowances:
                self._refuse_topic(
                    topic, sorted(self._allowances), "the agent publishes on", "it may not write"
                )
            size = len(text.encode())
            if size > MAX_DOCUMENT_BYTES:
                raise StopSession(
                    Outcome.AGENT_PROTOCOL,
                    f"the agent publishes {size} bytes on {topic}; at most {MAX_DOCUMENT_BYTES} are taken",
                )
            if not self._admits(time, topic, size):
                dropped = True
                continue
            self._tap(Record(time, topic, String.TYPE, encode(String(text))))
            documents.setdefault(topic, []).append(text)
        if dropped:
            self._check_flood()
        return documents

    @property
    def unread(self) -> tuple[str, ...]:
        """What the agent was told and never subscribed to."""
        return tuple(self._unread)

    @property
    def unmatched(self) -> tuple[str, ...]:
        """What the agent announced of an autopilot's topics and this session does not have."""
        if self._router is None:
            return ()
        return unmatched_topics(self._router.endpoints, self._autopilot_topics, self._releases)

    def _look_for_readers(self) -> None:
        """Note who subscribes now: at the end it may be gone. In lockstep the hello has said it."""
        if self._beats % LOOKS_FOR_READERS == 0:
            for topic, recorded in list(self._unread.items()):
                if recorded.publisher is not None and recorded.publisher.has_reader:
                    del self._unread[topic]
        self._beats += 1

    def _await_stated(self, subscription: Subscription, count: int, budget_s: float) -> None:
        topic = subscription.topic
        if not subscription.wait(count, budget_s):
            raise StopSession(
                Outcome.AGENT_PROTOCOL,
                f"the agent says it sent {count} samples on {topic}; {subscription.highest} came, on the key "
                f"{self._keys[topic]}",
            )
        if subscription.overflowed:
            raise StopSession(
                Outcome.AGENT_FLOODED, f"samples on {topic} were lost: more came at once than can be held"
            )
        if subscription.lost:
            raise StopSession(
                Outcome.AGENT_PROTOCOL, f"samples on {topic} were lost: its sequence numbers have gaps"
            )

    def _due(self, subscription: Subscription, count: int | None) -> Iterable[Sample]:
        """What the session takes in now: with a `count`, nothing that the agent does not count as sent.

        A sample beyond that may have come or not, by the host's speed; it is taken in once an ack states it.
        """
        taken = subscription.take()
        if count is None:
            return taken
        waiting = self._unstated[subscription.topic]
        if not taken and not waiting:
            return ()
        waiting.extend(taken)
        due = []
        while waiting and waiting[0].sequence <= count:
            due.append(waiting.popleft())
        return due

    def _admits(self, time: SimTime, topic: str, size: int) -> bool:
        allowance = self._allowances[topic]
        admitted = allowance.admits(time, size)
        if allowance.dropped == 1 and not admitted:
            self._on_drop(time, topic)
        return admitted

    def _check_flood(self) -> None:
        samples, size = self.dropped
        if samples > MAX_DROPPED_SAMPLES or size > MAX_DROPPED_BYTES:
            raise StopSession(
                Outcome.AGENT_FLOODED,
                f"the agent floods its topics: {samples:,} samples with {size:,} bytes were dropped beyond what is recorded "
                "of each topic (docs/streams.md)",
            )

    @property
    def dropped(self) -> tuple[int, int]:
        """Samples of the agent beyond the limits of their topics so far, and their bytes."""
        allowances = self._allowances.values()
        return sum(topic.dropped for topic in allowances), sum(topic.dropped_bytes for topic in allowances)

    def counters(self) -> dict[str, int]:
        """Samples of the agent that were dropped, malformed or never stated."""
        overflowed = sum(subscription.overflowed for subscription in self._subscriptions)
        malformed = sum(subscription.malformed for subscription in self._subscriptions)
        lost = sum(subscription.lost for subscription in self._subscriptions)
        unstated = sum(len(waiting) for waiting in self._unstated.values())
        return {
            "air_overflowed": overflowed,
            "air_malformed": malformed,
            "air_lost": lost,
            "air_dropped": self.dropped[0],
            "air_unstated": unstated,
        }


def _subscribe(node: RosNode | None, topics: Iterable[AirTopic]) -> tuple[Subscription, ...]:
    if node is None:
        return ()
    return tuple(
        node.serve(topic.name, topic.kind) if topic.service else node.subscribe(topic.name, topic.kind)
        for topic in topics
    )


@contextmanager
def open_air_network(
    simspec: SimSpec,
    tap: Tap,
    *,
    zenoh: bool,
    in_ticks: bool = False,
    px4_msgs: str | None = None,
    ap_dds: str | None = None,
    clock: HostClock = HOST_CLOCK,
    on_drop: Callable[[SimTime, str], None] = lambda time, topic: None,
) -> Generator[AirNetwork]:
    """The air network of one session: an embedded router on which truth never is, with one credential, and one more
    where a companion computer comes from outside.
    """
    releases = {"px4_msgs": px4_msgs, "ap_dds": ap_dds}
    outside, topics = simspec.agent.outside_air, air_topics(simspec, **releases)
    plan = AirPlan(
        domain=DOMAIN,
        agent_reads=tuple((topic.name, topic.kind) for topic in topics if not topic.from_agent),
        agent_writes=tuple(
            (topic.name, topic.kind) for topic in topics if topic.from_agent and not topic.service
        ),
        agent_calls=tuple((topic.name, topic.kind) for topic in topics if topic.service),
        agent_limit_bytes=MAX_DOCUMENT_BYTES,
        # In lockstep and warp the session waits for its agent anyway, and a lost picture would end or change it.
        large_sample_wait_s=None if simspec.pace.mode == "realtime" else LARGE_SAMPLE_WAIT_S,
        companion_token=read_token(outside) if outside else "",
        in_warp=simspec.pace.mode == "warp",
    )
    with ExitStack() as stack:
        router = stack.enter_context(open_router(plan)) if zenoh or outside else None
        if router and outside:
            stack.enter_context(open_outside_air(outside, router.access.locator))
        yield AirNetwork(simspec, router, tap, clock, on_drop, in_ticks, releases)
