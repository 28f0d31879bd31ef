"""The bridge between the tick socket of a session, which carries the air network, and its agent on a broker."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections import Counter, defaultdict, deque
from collections.abc import Collection, Mapping, Sequence
from operator import itemgetter
from typing import Any

from agent_adapters.client import End, MavlinkLink, Tick, TickLine
from bench.contracts import (
    MAX_AIR_LINE_BYTES,
    MAX_LINE_BYTES,
    MqttAck,
    MqttEnd,
    MqttReady,
    MqttTick,
    parse_document,
)
from bench.errors import LinkLost

from ._connection import Arrival, BrokerConnection
from ._mavlink import MavlinkTranslator
from ._topics import ACK, END, LINK, MAVLINK_TO_AGENT, READY, TICK

# Host time between two looks at agent and broker while the bridge waits. Chosen.
_LOOK_S = 0.2
# In real time: host time between two looks at MAVLink and the agent, the most that the bridge itself adds. Chosen.
REALTIME_LOOK_S = 0.005
# Simulated time between two ticks of the agent's where the session does not wait; as long as pace.tick_s by default.
_TICK_NS = 100_000_000
MAX_PAYLOAD_BYTES = 256 * 1024 - 16
# What an acknowledgement may hold: bench.contracts.Ack. The counts have a line's length for themselves.
MAX_ACK_BYTES, MAX_ACK_MESSAGES = MAX_AIR_LINE_BYTES - MAX_LINE_BYTES, 1024
# In real time: what of one topic goes on after a pause, so that a broker that comes back brings no long past.
NEWEST = 100
_REFUSALS_SHOWN = 5


def latency_summary(spans_s: Collection[float]) -> dict[str, float]:
    """Median, 99th percentile and maximum of spans of host time, in milliseconds; empty without a span."""
    ordered = sorted(spans_s)
    ranks = {"median_ms": 0.5, "p99_ms": 0.99, "max_ms": 1.0} if ordered else {}
    return {
        name: round(1000.0 * ordered[round(rank * (len(ordered) - 1))], 3) for name, rank in ranks.items()
    }


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
        accepted: Collection[str],
        process: subprocess.Popen[bytes] | None,
    ) -> None:
        self.name = ""
        self.ack: MqttAck | None = None
        self.received: Counter[str] = Counter()
        self.refused = 0
        self.broker_latencies_s: list[float] = []
        self.in_lockstep = False
        self._connection, self._accepted, self._process = connection, set(accepted), process
        self._pending: defaultdict[str, deque[bytes]] = defaultdict(deque)
        self._taken: Counter[str] = Counter()
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
            if self.in_lockstep:
                # Nobody knows which of the counted messages the broker has lost with the connection.
                self._connection.check()
            self._connection.wait_for_return()

    def take_stated(self, stated: Mapping[str, int]) -> list[Arrival] | None:
        """What the agent has sent up to these counts, by topic and in order; None while some is to come."""
        topics = sorted(stated.keys() & self._accepted)
        if any(self.received[topic] < stated[topic] for topic in topics):
            return None
        arrivals = []
        for topic in topics:
            while self._taken[topic] < stated[topic]:
                self._taken[topic] += 1
                arrivals.append(Arrival(topic, self._pending[topic].popleft()))
        return arrivals

    def refuse(self, topic: str, reason: str) -> None:
        """Count a message that goes no further, and say so of the first."""
        self.refused += 1
        if self.refused <= _REFUSALS_SHOWN:
            sys.stderr.write(f"mqtt bridge: {topic}: refused: {reason}\n")

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
                self.broker_latencies_s.append(time.monotonic() - sent_s)
        elif topic == READY:
            ready = parse_document(MqttReady, payload)
            if ready is None:
                self.refuse(topic, "it is no mqtt-ready (rebar schema mqtt-ready)")
            else:
                self.name = ready.agent
        else:
            self.refuse(topic, "an agent may not publish there")


class Bridge:
    """Carries one session between the tick socket, the MAVLink link and the agent's side; `allowed` has the topics of the
    air network by MQTT topic. `link` is None where the agent has it for itself.
    """

    def __init__(
        self,
        ticks: TickLine,
        link: MavlinkLink | None,
        connection: BrokerConnection,
        agent: AgentSide,
        allowed: Mapping[str, str],
    ) -> None:
        self._ticks, self._link, self._connection, self._agent = ticks, link, connection, agent
        self._allowed, self._translator = allowed, MavlinkTranslator()
        # For the next acknowledgements, each with its bytes there.
        self._outbox: deque[tuple[dict[str, str], int]] = deque()
        self._sent: Counter[str] = Counter()
        self._number = self._due_ns = 0
        self._answers_s: list[float] = []

    def run(self, first: Tick | End) -> str:
        """Follow the session to its end; why it ended. Raises AgentEnded and LinkLost."""
        end = self._keep_step(first) if self._agent.in_lockstep else self._keep_time(first)
        reason = end.reason or "the session is over"
        self._connection.publish(END, MqttEnd(reason=reason).model_dump_json())
        return reason

    def use(self) -> dict[str, object]:
        """What went through the bridge, and how long broker and agent took."""
        return {
            "ticks": self._number,
            "to_agent": sum(self._sent.values()),
            "from_agent": sum(self._agent.received.values()),
            "refused": self._agent.refused,
            "unsent": self._connection.unsent,
            "unknown_mavlink": self._translator.unknown,
            "broker": latency_summary(self._agent.broker_latencies_s),
            "answer": latency_summary(self._answers_s),
        }

    def _keep_step(self, message: Tick | End) -> End:
        """Time waits for the agent's acknowledgement."""
        while isinstance(message, Tick):
            if self._link is not None:
                self._link.wait(message.links.get(LINK, 0))
            self._mirror(message.air)
            self._send_tick(message)
            self._forward(self._await_ack())
            self._acknowledge(message)
            self._number += 1
            message = self._ticks.next()
        return message

    def _keep_time(self, message: Tick | End | None) -> End:
        """Messages go on as they come."""
        unanswered = None
        while not isinstance(message, End):
            if self._link is not None:
                self._link.poll()
            self._mirror(_newest(message.air) if message is not None else ())
            if message is not None and message.time_ns >= self._due_ns:
                self._due_ns = message.time_ns + _TICK_NS
                self._send_tick(message)
                self._number += 1
            self._agent.look(0.0)
            self._forward(self._agent.take_stated(self._agent.received) or ())
            # One look later: the bench takes in at its next step, in 20 ms, what an agent says at once.
            if message is None and unanswered is not None:
                self._acknowledge(unanswered)
            unanswered = message
            message = self._ticks.poll(REALTIME_LOOK_S)
        return message

    def _mirror(self, air: Sequence[Mapping[str, Any]]) -> None:
        for message in sorted(air, key=itemgetter("topic")):
            self._send(message["topic"].lstrip("/"), message["message"])
        frames = self._link.take() if self._link is not None else ()
        for document in filter(None, map(self._translator.to_json, frames)):
            self._send(MAVLINK_TO_AGENT, document)

    def _send(self, topic: str, document: Mapping[str, Any]) -> None:
        self._sent[topic] += self._connection.publish(topic, json.dumps(document))

    def _send_tick(self, tick: Tick) -> None:
        in_lockstep, topics = self._agent.in_lockstep, dict(self._sent)
        self._agent.send_tick(
            MqttTick(number=self._number, time_ns=tick.time_ns, lockstep=in_lockstep, topics=topics)
        )

    def _await_ack(self) -> list[Arrival]:
        began_s = time.monotonic()
        while True:
            ack = self._agent.ack
            if ack is not None and ack.number >= self._number:
                if ack.number > self._number:
                    raise LinkLost(f"the agent acknowledged tick {ack.number}, ahead of tick {self._number}")
                arrivals = self._agent.take_stated(ack.topics)
                if arrivals is not None:
                    self._answers_s.append(time.monotonic() - began_s)
                    return arrivals
            self._agent.look()

    def _forward(self, arrivals: Sequence[Arrival]) -> None:
        for arrival in arrivals:
            if reason := self._forward_message(arrival):
                self._agent.refuse(arrival.topic, reason)

    def _forward_message(self, arrival: Arrival) -> str:
        """Pass a message on; why not, or nothing."""
        topic, payload = arrival
        if len(payload) > MAX_PAYLOAD_BYTES:
            return f"{len(payload)} bytes are more than {MAX_PAYLOAD_BYTES}"
        try:
            text = payload.decode()
        except UnicodeDecodeError:
            return "it is no UTF-8"
        if topic in self._allowed:
            # As a text: the bench records it to the letter, and judges whether it is a document.
            message = {"topic": self._allowed[topic], "message": text}
            size = len(json.dumps(message, ensure_ascii=False).encode()) + 1
            if size > MAX_ACK_BYTES:  # no JSON, which has no such number of control characters
                return f"{size} bytes with its control characters are more than {MAX_ACK_BYTES}"
            self._outbox.append((message, size))
            return ""
        frame = self._translator.frame_of(text)
        if isinstance(frame, str):
            return frame
        assert self._link is not None  # without it, the topic is none of the accepted ones
        self._link.send(frame)
        return ""

    def _acknowledge(self, tick: Tick) -> None:
        """Answer a tick, with as much of what the agent published as fits; the rest goes with the next ones."""
        air: list[dict[str, str]] = []
        room = MAX_ACK_BYTES
        while self._outbox and self._outbox[0][1] <= room and len(air) < MAX_ACK_MESSAGES:
            message, size = self._outbox.popleft()
            air.append(message)
            room -= size
        self._ticks.ack(tick, {}, {} if self._link is None else {LINK: self._link.sent}, air)


def _newest(air: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """At most `NEWEST` messages of each topic."""
    counts: Counter[str] = Counter()
    kept = []
    for message in reversed(air):
        counts[message["topic"]] += 1
        if counts[message["topic"]] <= NEWEST:
            kept.append(message)
    return kept[::-1]
