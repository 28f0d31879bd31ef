"""A ROS 2 node on a Zenoh session: typed publishers and subscriptions, and the client that an agent opens.

Nothing here ever blocks a publisher: congestion means a lost sample (counted by the numbers that samples
carry), because a bench that waits for an agent's inbox is a bench that an agent can stop.
"""

from __future__ import annotations

import itertools
import json
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import field
from typing import Any

import zenoh
import zenoh.ext

from bench.errors import LinkLost, SetupError
from bench.values import value_class

from ._cdr import decode, encode
from ._keys import (
    RELIABLE_10,
    QoS,
    answer_attachment,
    data_key,
    endpoint_gid,
    endpoint_token,
    is_name,
    node_token,
    read_sequence,
    write_attachment,
)
from ._schemas import service_parts

# The lease in the session file of rmw_zenoh: a link that dies silently is noticed after this time.
_LEASE_MS = 60_000
# Of one inbox, however few the samples: what a flooding agent can cost in memory.
INBOX_BYTES = 32 * 1024 * 1024
# The most that Zenoh allows: samples are dropped when a reader is this far behind.
_QUEUED_BATCHES = 16


@value_class(frozen=True, slots=True)
class AirAccess:
    """Where the air network is, and the credentials of this session's agent."""

    locator: str
    user: str
    password: str = field(repr=False)
    domain: int = 0


@value_class(frozen=True, slots=True)
class Sample:
    """One sample as it came: its publisher's sequence number and its CDR bytes."""

    topic: str
    kind: type[Any]
    sequence: int
    data: bytes

    def message(self) -> Any:
        """The message, of class `kind`, or None when the bytes are not one."""
        return decode(self.kind, self.data)


class Publisher:
    """One topic that a node writes. For one thread at a time. Samples are numbered from 1."""

    def __init__(
        self, topic: str, kind: type[Any], zenoh_publisher: Any, gid: bytes, plain: Any = None
    ) -> None:
        """`plain` is a publisher of the same key where the other is a latched one, which does not tell who subscribes."""
        self.topic = topic
        self.kind = kind
        self.sequence = 0
        self._publisher: Any = zenoh_publisher
        self._gid = gid
        self._latched = plain is not None
        self._plain: Any = plain or zenoh_publisher

    def put(self, message: object) -> bytes:
        """Send a message; returns its CDR bytes, which the recorder wants too."""
        data = encode(message)
        self.put_bytes(data)
        return data

    def put_bytes(self, data: bytes) -> None:
        """Send a message that is already encoded."""
        self.sequence += 1
        # Wall clock by the contract of rmw_zenoh; stamps inside messages are simulated time.
        self._publisher.put(data, attachment=write_attachment(self.sequence, time.time_ns(), self._gid))

    @property
    def matched(self) -> bool:
        """Whether anybody subscribes; always true of a latched topic, which keeps its samples for those to
        come.
        """
        return self._latched or self.has_reader

    @property
    def has_reader(self) -> bool:
        """Whether anybody subscribes now."""
        return bool(self._plain.matching_status.matching)


class Subscription:
    """One topic that a node reads, with an inbox of `capacity` samples and `INBOX_BYTES`. A full inbox
    refuses what is new and counts it.

    `highest` is the highest sequence number seen, `received` counts good samples, `lost` the numbers that were skipped,
    `overflowed` the good samples that found the inbox full, `malformed` those without a proper attachment.
    Numbers are those of the publisher, counted from 1 also where it counts from 0, so there is to be one publisher a
    topic. Of a latched topic the history comes
    with the numbers that it was sent with: a late subscriber's first may be any number, and counts nothing as lost.
    """

    def __init__(self, topic: str, kind: type[Any], capacity: int) -> None:
        self.topic = topic
        self.kind = kind
        self.highest = 0
        self.received = 0
        self.lost = 0
        self.overflowed = 0
        self.malformed = 0
        self._capacity = capacity
        self._inbox: deque[Sample] = deque()
        self._inbox_bytes = 0
        self._arrival = threading.Condition()
        self._waiting = 0
        # What the publisher's numbers lack to count samples: 1 if its first sample has number 0.
        self._shift = 0

    def take(self) -> list[Sample]:
        """Everything in the inbox, in order of arrival; the inbox is empty afterwards."""
        # Without the lock: whether a deque is empty can be read safely from any thread.
        if not self._inbox:
            return []
        with self._arrival:
            taken = list(self._inbox)
            self._inbox.clear()
            self._inbox_bytes = 0
        return taken

    def wait(self, sequence: int, timeout_s: float) -> bool:
        """Block until a sample with this number or a higher one has come; False when it has not within
        `timeout_s`.
        """
        # Without the lock: the number only grows.
        if self.highest >= sequence:
            return True
        with self._arrival:
            self._waiting += 1
            try:
                return self._arrival.wait_for(lambda: self.highest >= sequence, timeout_s)
            finally:
                self._waiting -= 1

    def accept(self, number: int) -> None:
        """The sample of this number is used: what it asks for is going to be answered, after what was accepted before."""

    def take_in(self, data: bytes, attachment: bytes | None) -> None:
        """Put one sample into the inbox; called by Zenoh's thread."""
        sequence = read_sequence(attachment) if attachment is not None else None
        with self._arrival:
            if sequence is None:
                self.malformed += 1
                return
            if sequence == 0 and not self.received:
                self._shift = 1
            sequence += self._shift
            self.received += 1
            if len(self._inbox) < self._capacity and self._inbox_bytes + len(data) <= INBOX_BYTES:
                self._inbox.append(Sample(self.topic, self.kind, sequence, data))
                self._inbox_bytes += len(data)
            else:
                self.overflowed += 1
            if sequence > self.highest:
                self.lost += sequence - self.highest - 1 if self.highest else 0
                self.highest = sequence
                if self._waiting:
                    self._arrival.notify_all()


class Service(Subscription):
    """One service that a node answers, and its inbox of requests, numbered in the order in which they come, whoever asks.

    Each request that `accept` names gets one answer by `put_bytes`, in that order; the others get none. `sequence` counts
    the answers.
    """

    matched = has_reader = True

    def __init__(self, name: str, kind: type[Any], key: str, capacity: int) -> None:
        request, self.response = service_parts(kind)
        super().__init__(name, request, capacity)
        self.sequence = 0
        self._key = key
        self._asking = threading.Lock()
        self._queries: dict[int, tuple[zenoh.Query, bytes]] = {}
        self._accepted: deque[tuple[zenoh.Query, bytes]] = deque()

    def take_query(self, query: zenoh.Query) -> None:
        """Put one request into the inbox; called by Zenoh's thread."""
        attachment = query.attachment.to_bytes() if query.attachment is not None else b""
        if read_sequence(attachment) is None or query.payload is None:
            self.malformed += 1
            return
        with self._asking:
            number = self.received + 1
            self._queries[number] = query, attachment
            self.take_in(query.payload.to_bytes(), write_attachment(number, 0, bytes(16)))

    def accept(self, number: int) -> None:
        self._accepted.append(self._queries.pop(number))

    def put_bytes(self, data: bytes) -> None:
        """Answer the oldest of the accepted requests."""
        query, attachment = self._accepted.popleft()
        self.sequence += 1
        # Whoever asked may have left, or waited long enough.
        with suppress(zenoh.ZError):
            query.reply(self._key, data, attachment=answer_attachment(attachment, time.time_ns()))


class RosNode:
    """A node of the graph; lives as long as its Zenoh session. Made by `Router.node` or `open_client`."""

    def __init__(
        self, session: zenoh.Session, domain: int, ids: Iterator[int], name: str, namespace: str
    ) -> None:
        if "/" in name or not is_name(f"/{name}") or (namespace != "/" and not is_name(namespace)):
            raise SetupError(
                "node", f"{namespace!r} {name!r} is no ROS 2 node name", "give a /namespace and a name"
            )
        self._session = session
        self._domain = domain
        self._ids = ids
        self._name = (namespace, name)
        self._zid = str(session.zid())
        self._id = next(ids)
        # Zenoh withdraws what nobody holds, so the node holds it.
        self._held: list[Any] = []
        self._show(node_token(domain, self._zid, self._id, namespace, name))

    def publisher(self, topic: str, kind: type[object], qos: QoS = RELIABLE_10) -> Publisher:
        """Announce a topic that this node writes."""
        if qos.latched:
            return self.latched(topic, kind, qos.depth)
        token = self._token("MP", topic, kind, qos)
        publisher = self._session.declare_publisher(
            data_key(self._domain, topic, kind),
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT,
        )
        return self._announce(Publisher(topic, kind, publisher, endpoint_gid(token)), token, publisher)

    def latched(self, topic: str, kind: type[object], depth: int = 1) -> Publisher:
        """Announce a topic whose last `depth` samples also reach whoever subscribes later
        (transient_local).
        """
        token = self._token("MP", topic, kind, QoS(latched=True, depth=depth))
        key = data_key(self._domain, topic, kind)
        plain = self._session.declare_publisher(key)
        self._held.append(plain)
        publisher = zenoh.ext.declare_advanced_publisher(
            self._session,
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE,
            cache=zenoh.ext.CacheConfig(
                depth, replies_config=zenoh.ext.RepliesConfig(congestion_control=zenoh.CongestionControl.DROP)
            ),
            # Numbered, but without rmw_zenoh's heartbeat: Zenoh sends heartbeats BLOCKing, at the wall
            # clock's pace.
            sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        return self._announce(Publisher(topic, kind, publisher, endpoint_gid(token), plain), token, publisher)

    def subscribe(
        self, topic: str, kind: type[object], latched: bool = False, depth: int = 10, capacity: int = 4096
    ) -> Subscription:
        """Listen to a topic. `latched` also asks for the last `depth` samples that were sent before."""
        token = self._token("MS", topic, kind, QoS(latched=latched, depth=depth))
        subscription = Subscription(topic, kind, capacity)
        key = data_key(self._domain, topic, kind)

        def arrived(sample: zenoh.Sample) -> None:
            attachment = sample.attachment
            subscription.take_in(
                sample.payload.to_bytes(), attachment.to_bytes() if attachment is not None else None
            )

        if latched:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=depth)
            self._held.append(
                zenoh.ext.declare_advanced_subscriber(
                    self._session, key, arrived, history=history, subscriber_detection=True
                )
            )
        else:
            self._held.append(self._session.declare_subscriber(key, arrived))
        self._show(token)
        return subscription

    def serve(self, name: str, kind: type[object], capacity: int = 4096) -> Service:
        """Answer a service; `kind` is the class of its type."""
        token = self._token("SS", name, kind, RELIABLE_10)
        key = data_key(self._domain, name, kind)
        service = Service(name, kind, key, capacity)
        self._held.append(self._session.declare_queryable(key, service.take_query, complete=True))
        self._show(token)
        return service

    def close(self) -> None:
        """Withdraw everything that this node declared, the newest first. Only once nobody uses it any more."""
        # Closing the session alone leaves a publisher's memory behind, 156 KiB for a session of the bench: a
        # worker flies thousands.
        while self._held:
            # Zenoh's own name for a thing that its session has withdrawn already.
            with suppress(zenoh.ZError):
                self._held.pop().undeclare()

    def _token(self, kind: str, topic: str, message: type[object], qos: QoS) -> str:
        if not is_name(topic):
            raise SetupError(
                "topic", f"{topic!r} is no ROS 2 topic name", "write it in full, as /drone_1/detections"
            )
        ids = (self._id, next(self._ids))
        return endpoint_token(self._domain, self._zid, ids, kind, self._name, topic, message, qos)

    def _announce(self, publisher: Publisher, token: str, zenoh_publisher: Any) -> Publisher:
        self._held.append(zenoh_publisher)
        self._show(token)
        return publisher

    def _show(self, token: str) -> None:
        self._held.append(self._session.liveliness().declare_token(token))


@contextmanager
def open_client(
    access: AirAccess, name: str, namespace: str = "/", timeout_s: float = 5.0
) -> Iterator[RosNode]:
    """Join the air network as one node; leaving the block leaves the network.

    Raises LinkLost when the router cannot be reached within `timeout_s` or refuses the credentials.
    """
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(_client_settings(access, timeout_s))))
    except zenoh.ZError as error:
        raise LinkLost(
            f"the air network at {access.locator} did not answer within {timeout_s:g} s, or refused user {access.user!r}; "
            "start the session first, and take the credentials that it hands over"
        ) from error
    with session:
        node = RosNode(session, access.domain, itertools.count(), name, namespace)
        try:
            yield node
        finally:
            node.close()


def _client_settings(access: AirAccess, timeout_s: float) -> dict[str, Any]:
    settings = session_settings()
    settings["transport"]["auth"] = {"usrpwd": {"user": access.user, "password": access.password}}
    connect = {"endpoints": [access.locator], "timeout_ms": round(timeout_s * 1000), "exit_on_failure": True}
    return {"mode": "client", "connect": connect, **settings}


def session_settings() -> dict[str, Any]:
    """What every session of the bench has in common: it looks for nobody, and is found at its address
    alone.
    """
    everywhere: Mapping[str, bool] = {"router": True, "peer": True, "client": True}
    return {
        # No search: other sessions may run on this host, and their networks must stay apart.
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "adminspace": {"enabled": False},
        "timestamping": {"enabled": everywhere, "drop_future_timestamp": False},
        "transport": {
            "shared_memory": {"enabled": False},
            "link": {
                "protocols": ["tcp"],
                "tx": {"lease": _LEASE_MS, "keep_alive": 2, "queue": {"size": {"data": _QUEUED_BATCHES}}},
            },
        },
    }
