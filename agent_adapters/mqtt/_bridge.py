"""The bridge between a session's air network and its agent on a broker."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from bisect import insort
from collections import Counter, defaultdict, deque
from collections.abc import Mapping

from agent_adapters.client import Bench, Moment
from bench.clock import SimTime
from bench.contracts import MqttAck, MqttEnd, MqttReady, MqttTick, parse_document
from bench.errors import LinkLost
from bench.streams import Sample, String, json_value

from ._connection import Arrival, BrokerConnection
from ._mavlink import MavlinkTranslator
from ._topics import ACK, END, READY, TICK, mavlink_from_agent, mavlink_to_agent

# Host time between two looks at agent and broker while the bridge waits. Chosen.
_LOOK_S = 0.2
# In real time: host time between two looks at the air network, the most that the bridge itself adds. Chosen.
REALTIME_LOOK_S = 0.005
# Simulated time between two ticks where the session has none of its own; as long as pace.tick_s by default.
_TICK_S = 0.1
# The router drops a larger sample without a word; a String adds 9 bytes to its text, and the token its padding.
MAX_PAYLOAD_BYTES = 256 * 1024 - 16
_REFUSALS_SHOWN = 5


class Latencies:
    """Spans of host time, and their median and 99th percentile in milliseconds."""

    def __init__(self) -> None:
        self._sorted_s: list[float] = []

    def add(self, span_s: float) -> None:
        insort(self._sorted_s, span_s)

    def summary(self) -> dict[str, float]:
        """Empty without a span."""
        if not self._sorted_s:
            return {}
        last = len(self._sorted_s) - 1
        ranks = {"median_ms": 0.5, "p99_ms": 0.99, "max_ms": 1.0}
        return {name: round(1000.0 * self._sorted_s[round(rank * last)], 3) for name, rank in ranks.items()}


class AgentEnded(Exception):
    """The agent behind the bridge has ended, with this exit code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class AgentSide:
    """The agent as the bridge hears it on the broker; `process` is None for one that was started elsewhere."""

    def __init__(
        self,
        connection: BrokerConnection,
        allowed: Mapping[str, str],
        links: tuple[str, ...],
        process: subprocess.Popen[bytes] | None,
        *,
        lockstep: bool,
    ) -> None:
        self.name = ""
        self.ack: MqttAck | None = None
        self.received: Counter[str] = Counter()
        self.refused = 0
        self.broker_latencies = Latencies()
        self._pending: defaultdict[str, deque[bytes]] = defaultdict(deque)
        self._taken: Counter[str] = Counter()
        self._connection, self._process = connection, process
        self._lockstep = lockstep
        self._accepted = {*allowed, *(mavlink_from_agent(link) for link in links)}
        self._sent_at_s: dict[int, float] = {}

    def send_tick(self, tick: MqttTick) -> None:
        """Publish a tick. The bridge hears it too, which tells how fast the broker is."""
        self._sent_at_s[tick.number] = time.monotonic()
        self._connection.publish(TICK, tick.model_dump_json())

    def look(self, timeout_s: float = _LOOK_S) -> None:
        """Take in what comes within a span of host time. Raises AgentEnded, and LinkLost without a broker."""
        for arrival in self._connection.take(timeout_s):
            self._take_in(arrival)
        if self._process is not None and (code := self._process.poll()) is not None:
            raise AgentEnded(code)
        if self._connection.lost:
            if self._lockstep:
                # Nobody knows which of the counted messages the broker has lost with the connection.
                self._connection.check()
            self._connection.wait_for_return()

    def take_stated(self, stated: Mapping[str, int]) -> list[tuple[str, bytes]] | None:
        """What the agent has sent up to these counts, by topic and in order; None while some is to come."""
        topics = sorted(stated.keys() & self._accepted)
        if any(self.received[topic] < stated[topic] for topic in topics):
            return None
        return [
            (topic, self._pending[topic].popleft())
            for topic in topics
            for _ in range(self._count(topic, stated[topic]))
        ]

    def take_all(self) -> list[tuple[str, bytes]]:
        """What has come since the last call."""
        return self.take_stated(self.received) or []

    def refuse(self, topic: str, reason: str) -> None:
        """Count a message that goes no further, and say so of the first."""
        self.refused += 1
        if self.refused <= _REFUSALS_SHOWN:
            sys.stderr.write(f"mqtt bridge: {topic}: refused: {reason}\n")

    def _count(self, topic: str, stated: int) -> int:
        count = max(0, stated - self._taken[topic])
        self._taken[topic] += count
        return count

    def _take_in(self, arrival: Arrival) -> None:
        topic, payload = arrival
        if topic in self._accepted:
            self.received[topic] += 1
            self._pending[topic].append(payload)
        elif topic == ACK:
            self.ack = parse_document(MqttAck, payload) or self.ack
        elif topic == TICK:
            tick = parse_document(MqttTick, payload)
            if tick is not None and (sent_s := self._sent_at_s.pop(tick.number, None)) is not None:
                self.broker_latencies.add(time.monotonic() - sent_s)
        elif topic == READY:
            ready = parse_document(MqttReady, payload)
            if ready is None:
                self.refuse(topic, "it is no mqtt-ready (rebar schema mqtt-ready)")
            else:
                self.name = ready.agent
        else:
            self.refuse(topic, "an agent may not publish there")


class Bridge:
    """Carries one session between the air network and the agent's side."""

    def __init__(
        self,
        bench: Bench,
        connection: BrokerConnection,
        agent: AgentSide,
        allowed: Mapping[str, str],
        *,
        lockstep: bool,
    ) -> None:
        self._bench, self._connection, self._agent = bench, connection, agent
        self._allowed = allowed
        self._lockstep = lockstep
        self._links = {mavlink_from_agent(name): link for name, link in bench.links.items()}
        self._translators = {name: MavlinkTranslator() for name in bench.links}
        self._sent: Counter[str] = Counter()
        self._number = 0
        self._tick_due = SimTime(0)
        self._answers = Latencies()

    def run(self) -> str:
        """Follow the session to its end; why it ended. Raises AgentEnded and LinkLost."""
        for moment in self._bench.moments(self._agent.name, REALTIME_LOOK_S):
            self._mirror(moment)
            if self._lockstep:
                self._tick(moment.time)
                self._forward(self._await_ack())
            else:
                if moment.time >= self._tick_due:
                    self._tick_due = moment.time.after(_TICK_S)
                    self._tick(moment.time)
                self._agent.look(0.0)
                self._forward(self._agent.take_all())
            self._number += self._lockstep
        self._connection.publish(END, MqttEnd(reason=self._bench.ended).model_dump_json())
        return self._bench.ended

    def use(self) -> dict[str, object]:
        """What went through the bridge, and how long broker and agent took."""
        return {
            "ticks": self._number,
            "to_agent": sum(self._sent.values()),
            "from_agent": sum(self._agent.received.values()),
            "refused": self._agent.refused,
            "unsent": self._connection.unsent,
            "unknown_mavlink": sum(translator.unknown for translator in self._translators.values()),
            "broker": self._agent.broker_latencies.summary(),
            "answer": self._answers.summary(),
        }

    def _mirror(self, moment: Moment) -> None:
        for sample in moment.samples:
            if (text := _text_of(sample)) is not None:
                self._send(sample.topic.lstrip("/"), text)
        for link, frames in moment.frames.items():
            translator = self._translators[link]
            for message in filter(None, map(translator.to_json, frames)):
                self._send(mavlink_to_agent(link), json.dumps(message))

    def _send(self, topic: str, text: str) -> None:
        self._sent[topic] += self._connection.publish(topic, text)

    def _tick(self, now: SimTime) -> None:
        self._agent.send_tick(
            MqttTick(number=self._number, time_ns=now.ns, lockstep=self._lockstep, topics=dict(self._sent))
        )
        if not self._lockstep:
            self._number += 1

    def _await_ack(self) -> list[tuple[str, bytes]]:
        began_s = time.monotonic()
        while True:
            ack = self._agent.ack
            if ack is not None and ack.number >= self._number:
                if ack.number > self._number:
                    raise LinkLost(f"the agent acknowledged tick {ack.number}, ahead of tick {self._number}")
                arrivals = self._agent.take_stated(ack.topics)
                if arrivals is not None:
                    self._answers.add(time.monotonic() - began_s)
                    return arrivals
            self._agent.look()

    def _forward(self, arrivals: list[tuple[str, bytes]]) -> None:
        for topic, payload in arrivals:
            if reason := self._forward_message(topic, payload):
                self._agent.refuse(topic, reason)

    def _forward_message(self, topic: str, payload: bytes) -> str:
        """Pass a message on; why not, or nothing."""
        if len(payload) > MAX_PAYLOAD_BYTES:
            return f"{len(payload)} bytes are more than {MAX_PAYLOAD_BYTES}"
        try:
            text = payload.decode()
        except UnicodeDecodeError:
            return "it is no UTF-8"
        if topic in self._allowed:
            self._bench.publish(self._allowed[topic], text)
            return ""
        link = self._links[topic]
        frame = self._translators[link.name].frame_of(text)
        if isinstance(frame, str):
            return frame
        link.send(frame)
        return ""


def _text_of(sample: Sample) -> str | None:
    """A sample as JSON. A String of the air network is a JSON document already."""
    message = sample.message()
    if isinstance(message, String):
        return message.data
    return None if message is None else json.dumps(json_value(message))
