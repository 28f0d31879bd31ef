"""The air network of one session: an embedded Zenoh router that lets the agent do what its plan names, and
nothing else.

Truth is not here at all; the allow-list below is the second wall, for the bench's own streams. A session
inside the router's process is not filtered (Zenoh filters what comes over a link), which is how the bench
itself speaks.
"""

from __future__ import annotations

import itertools
import json
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh

from bench.errors import Fault, SetupError
from bench.temporary_folders import temporary_folder

from ._keys import GRAPH, data_key, dds_name, is_name, mangle
from ._node import AirAccess, RosNode, session_settings
from ._schemas import type_hash
from ._types import message_class

MAX_DOCUMENT_BYTES = 64 * 1024
_AGENT, _COMPANION = "agent", "companion"
# Chosen: a race for a free port is rare, and 16 lost in a row mean something else.
_ATTEMPTS = 16
# Zenoh's own number of keep-alives within a lease.
KEEP_ALIVES = 4
# The fastest that an agent's clock is reckoned to run beside the host's; sessions in warp reach some tens.
WARP_LEASE_FACTOR = 1000
# Every topic of a PX4 begins so, and every topic and service of an ArduPilot.
PX4_PREFIX, AP_PREFIX = "/fmu/", "/ap/"
# Kinds of tokens: publishers, subscriptions, clients of services.
_ENDS = ("MP", "MS", "SC")
# Of a token; ROS 2 may append more to the QoS.
_TOKEN_PARTS = 13
# Far more than one stack has.
_MAX_ENDPOINTS = 1000

Topic = tuple[str, str | type[Any]]
"""A topic's full name, and its ROS 2 type by name or as a message class."""


@dataclass(frozen=True, slots=True)
class AirPlan:
    """What the agent may read, write and call on the air network of one session.

    `agent_limit_hz` caps the rate of each of the agent's topics by the wall clock: not for lockstep, whose
    count of samples must come out. A sample of the agent's over `agent_limit_bytes` is dropped at the router.
    `large_sample_wait_s`: how long the next fragment of a sample over 64 KiB waits for a slow reader before the sample is
    dropped, and the publisher with it; Zenoh's own choice, 0.05 s, when None. With a `companion_token` a second user,
    `companion`, has the agent's rights and that password. `in_warp`: the agent's clock runs up to a thousand times as fast as
    this router's, and stops for as long.
    """

    domain: int
    agent_reads: tuple[Topic, ...]
    agent_writes: tuple[Topic, ...]
    host: str = "127.0.0.1"
    port: int = 0
    agent_limit_hz: float | None = None
    agent_limit_bytes: int = MAX_DOCUMENT_BYTES
    large_sample_wait_s: float | None = None
    companion_token: str = field(default="", repr=False)
    in_warp: bool = False
    agent_calls: tuple[Topic, ...] = ()


@dataclass(frozen=True, slots=True, order=True)
class Endpoint:
    """What an agent announces: a topic that it `publishes` or reads, or a service that it `calls`, with DDS type
    (`px4_msgs::msg::dds_::VehicleStatus_`) and type hash as they stand in its token.
    """

    publishes: bool
    topic: str
    dds_type: str
    type_hash: str
    calls: bool = False


class Router:
    """The bench's end of the air network."""

    def __init__(self, session: zenoh.Session, access: AirAccess) -> None:
        self.access = access
        self._session = session
        self._ids = itertools.count()
        # Zenoh withdraws what nobody holds: a latched topic must outlive its caller's interest.
        self._nodes: list[RosNode] = []
        self._endpoints: set[Endpoint] = set()
        self._graph: Any = session.liveliness().declare_subscriber(
            f"{GRAPH}/{access.domain}/**", self._take_token, history=True
        )

    @property
    def endpoints(self) -> list[Endpoint]:
        """What the agent has announced so far, in alphabetical order; of a flood only the first."""
        return sorted(self._endpoints.copy())

    def _take_token(self, sample: zenoh.Sample) -> None:
        """Note an endpoint of another session; called by Zenoh's thread."""
        parts = str(sample.key_expr).split("/")
        # As `endpoint_token` makes it: the session is part 2, kind 5, topic 9, type and hash 10 and 11.
        if len(parts) < _TOKEN_PARTS or parts[5] not in _ENDS or parts[2] == str(self._session.zid()):
            return
        if len(self._endpoints) < _MAX_ENDPOINTS:
            topic = parts[9].replace("%", "/")
            self._endpoints.add(Endpoint(parts[5] == "MP", topic, parts[10], parts[11], parts[5] == "SC"))

    def node(self, name: str, namespace: str = "/") -> RosNode:
        """A node in this process, which may read and write everything; it lives as long as the router."""
        node = RosNode(self._session, self.access.domain, self._ids, name, namespace)
        self._nodes.append(node)
        return node

    def close(self) -> None:
        """Close all nodes. Before the session: what it still holds then is never freed."""
        self._graph.undeclare()
        while self._nodes:
            self._nodes.pop().close()


@contextmanager
def open_router(plan: AirPlan) -> Iterator[Router]:
    """Open the air network; leaving the block closes it and everything on it.

    Raises SetupError when the plan names something that is no topic or type, or when its port is taken.
    """
    _check(plan)
    # Fresh for each session, so that an agent left over from an earlier one cannot join.
    password = secrets.token_urlsafe(24)
    session, port = _open(plan, password)
    with session:
        router = Router(session, AirAccess(f"tcp/{plan.host}:{port}", _AGENT, password, plan.domain))
        try:
            yield router
        finally:
            router.close()


def _check(plan: AirPlan) -> None:
    faults = [
        Fault("air network", f"{topic!r} is no ROS 2 topic name", "write it in full, as /drone_1/detections")
        for topic, _ in (*plan.agent_reads, *plan.agent_writes, *plan.agent_calls)
        if not is_name(topic)
    ]
    faults += [
        Fault(
            "air network",
            f"{topic}: the bench does not speak {type_name!r}",
            "use a type of bench.streams.MESSAGES",
        )
        for topic, type_name in (*plan.agent_reads, *plan.agent_writes)
        if isinstance(type_name, str) and message_class(type_name) is None
    ]
    if faults:
        raise SetupError(faults)


def _open(plan: AirPlan, password: str) -> tuple[zenoh.Session, int]:
    """A router session and its port.

    Of free ports several are tried: between finding and taking one, others may be quicker.
    """
    refusal: zenoh.ZError | None = None
    for _ in range(1 if plan.port else _ATTEMPTS):
        port = plan.port or _free_port(plan.host)
        try:
            return _open_at(plan, port, password), port
        except zenoh.ZError as error:
            refusal = error
    fault = Fault(
        "air network", f"cannot listen on {plan.host}:{port}: {refusal}", "choose a free port, or 0"
    )
    raise SetupError(fault) from refusal


def _open_at(plan: AirPlan, port: int, password: str) -> zenoh.Session:
    """The file with the password is gone before anybody can connect who might look for it: Zenoh reads it
    once.
    """
    with temporary_folder("air") as folder:
        users = folder / "users"
        users.touch(mode=0o600)
        companion = f"{_COMPANION}:{plan.companion_token}\n" if plan.companion_token else ""
        users.write_text(f"{_AGENT}:{password}\n{companion}", encoding="utf-8")
        return zenoh.open(zenoh.Config.from_json5(json.dumps(_router_settings(plan, port, users))))


def _free_port(host: str) -> int:
    with socket.create_server((host, 0)) as listener:
        port: int = listener.getsockname()[1]
        return port


def _router_settings(plan: AirPlan, port: int, users: Path) -> dict[str, Any]:
    settings = session_settings()
    settings["transport"]["auth"] = {
        "usrpwd": {"user": "router", "password": secrets.token_urlsafe(24), "dictionary_file": str(users)}
    }
    settings["mode"] = "router"
    settings["listen"] = {"endpoints": [f"tcp/{plan.host}:{port}"], "exit_on_failure": True}
    settings["access_control"] = _access_control(plan)
    sending = settings["transport"]["link"]["tx"]
    if plan.large_sample_wait_s is not None:
        wait = {"max_wait_before_drop_fragments": round(plan.large_sample_wait_s * 1e6)}
        sending["queue"]["congestion_control"] = {"drop": wait}
    if plan.in_warp:
        # The agent drops a link on which nothing came for the router's lease, by its own clock.
        sending["lease"] *= WARP_LEASE_FACTOR
        sending["keep_alive"] = sending.get("keep_alive", KEEP_ALIVES) * WARP_LEASE_FACTOR
        # Otherwise a small sample waits up to a millisecond for others, and nobody can see that it is on its way.
        sending["queue"]["batching"] = {"enabled": False}
    written, called = _keys(plan, plan.agent_writes), _keys(plan, plan.agent_calls)
    if written or called:
        # Only what comes in: the samples of the bench have no limit.
        everything = {"flows": ["ingress"], "messages": ["put", "query"]}
        settings["low_pass_filter"] = [
            {**everything, "key_exprs": [*written, *called], "size_limit": plan.agent_limit_bytes}
        ]
        if written and plan.agent_limit_hz is not None:
            rules = [{"key_expr": key, "freq": plan.agent_limit_hz} for key in written]
            settings["downsampling"] = [{"flows": ["ingress"], "messages": ["put"], "rules": rules}]
    return settings


def _keys(plan: AirPlan, topics: tuple[Topic, ...]) -> list[str]:
    return sorted({data_key(plan.domain, topic, kind) for topic, kind in topics})


def _access_control(plan: AirPlan) -> dict[str, Any]:
    rules = list(_rules(plan))
    return {
        "enabled": True,
        # An allow-list: a kind of message that a later Zenoh adds is refused.
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": _AGENT, "usernames": [_AGENT, *([_COMPANION] if plan.companion_token else [])]}],
        "policies": [{"rules": [rule["id"] for rule in rules], "subjects": [_AGENT]}],
    }


def _rules(plan: AirPlan) -> Iterator[dict[str, Any]]:
    """The agent's allow-list.

    `ingress` is agent to router, `egress` router to agent; a rule must include the asked key.
    """
    reads, writes = _keys(plan, plan.agent_reads), _keys(plan, plan.agent_writes)
    # Beside each latched key Zenoh keeps a cache that answers queries, and tokens that tell of late
    # publishers.
    caches = [f"{key}/@adv/**" for key in reads]
    graph = [f"{GRAPH}/{plan.domain}/**"]
    if reads:
        # A wildcard may ask for more than the list; what is answered is the list alone.
        yield _rule("read-ask", "ingress", ["declare_subscriber"], ["**"])
        yield _rule("read", "egress", ["put", "reply"], reads)
        asks = ["query", "declare_liveliness_subscriber", "liveliness_query"]
        yield _rule("history-ask", "ingress", asks, ["**/@adv/**"])
        yield _rule("history", "egress", ["declare_queryable", "liveliness_token"], caches)
    if calls := _keys(plan, plan.agent_calls):
        yield _rule("call", "ingress", ["query"], calls)
        yield _rule("answer", "egress", ["declare_queryable", "reply"], calls)
    if writes:
        yield _rule("write", "ingress", ["put"], writes)
        yield _rule("write-match", "egress", ["declare_subscriber"], writes)
    yield _rule("graph-ask", "ingress", ["declare_liveliness_subscriber", "liveliness_query"], graph)
    yield _rule("graph", "egress", ["liveliness_token"], graph)
    yield _rule("graph-tell", "ingress", ["liveliness_token"], _agent_tokens(plan))


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}


def _agent_tokens(plan: AirPlan) -> list[str]:
    """The tokens that the agent may show: nodes of any name, endpoints of exactly the topics that it may use, and any of
    an autopilot's topics, of which a wrong one is to be told.

    So it cannot appear as a publisher of what the bench publishes under the vehicle's name.
    """
    node = f"{GRAPH}/{plan.domain}/*/*/*"
    ends = [("MS", endpoint) for endpoint in plan.agent_reads] + [
        ("MP", endpoint) for endpoint in plan.agent_writes
    ]
    tokens = {
        f"{node}/{kind}/*/*/*/{mangle(topic)}/{dds_name(type_name)}/{type_hash(type_name)}/**"
        for kind, (topic, type_name) in ends
    }
    autopilots = [
        f"{node}/{kind}/*/*/*/{mangle(prefix)}$*/**" for prefix in (PX4_PREFIX, AP_PREFIX) for kind in _ENDS
    ]
    return [f"{node}/NN/*/*/*", *autopilots, *sorted(tokens)]
