"""The allow-list of the air network, tested from an agent's side: permitted operations work, all others fail.

No test waits for silence. Zenoh keeps the order of samples on a link, so when a permitted sample that was
sent after the attempts arrives, the router has processed the attempts.
"""

from __future__ import annotations

import json
import os
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from bench.errors import LinkLost, SetupError
from bench.streams import (
    CLOCK_QOS,
    MAX_DOCUMENT_BYTES,
    AirAccess,
    AirPlan,
    Clock,
    Publisher,
    RosNode,
    Router,
    String,
    Subscription,
    Time,
    data_key,
    open_client,
    open_router,
)
from bench.streams._keys import write_attachment

STRING_TYPE, CLOCK_TYPE = String.TYPE, Clock.TYPE
PLAN = AirPlan(
    domain=7,
    agent_reads=(("/clock", CLOCK_TYPE), ("/d/mission", STRING_TYPE)),
    agent_writes=(("/d/agent/reports", STRING_TYPE),),
)
READ, LATCHED, WRITE = (
    data_key(7, "/clock", CLOCK_TYPE),
    data_key(7, "/d/mission", STRING_TYPE),
    data_key(7, "/d/agent/reports", STRING_TYPE),
)
SECRET = data_key(7, "/truth/actors", STRING_TYPE)
DETECTIONS = data_key(7, "/d/detections", "vision_msgs/msg/Detection2DArray")
BUDGET_S = 10.0  # only reached when a test fails


class Bench:
    """The bench's side of an air network, with a subscriber to every key that the router passes on."""

    def __init__(self, router: Router) -> None:
        self.router = router
        self.session: zenoh.Session = router._session
        self.watcher: Any = self.session.declare_subscriber("**")
        self.node = router.node("bench")
        self.clock = self.node.publisher("/clock", Clock, CLOCK_QOS)
        self.mission = self.node.latched("/d/mission", String, depth=3)
        self.reports = self.node.subscribe("/d/agent/reports", String)

    def payloads_by_key(self) -> dict[str, bytes]:
        """The last payload on every key that reached the router since the last call."""
        return {str(sample.key_expr): sample.payload.to_bytes() for sample in drain(self.watcher)}


class Agent:
    """A permitted agent whose samples serve as fences."""

    def __init__(self, bench: Bench, node: RosNode) -> None:
        self.bench = bench
        self.node = node
        self.session: zenoh.Session = node._session
        self.reports: Publisher = node.publisher("/d/agent/reports", String)
        self.clock: Subscription = node.subscribe("/clock", Clock)
        bench.reports.highest = 0  # each agent numbers its samples from 1
        self.flush_sent()  # so that the router knows the subscription

    def flush_sent(self) -> None:
        """Return when the router has processed everything that this session has sent."""
        self.reports.put(String("fence"))
        assert self.bench.reports.wait(self.reports.sequence, BUDGET_S)

    def flush_received(self) -> None:
        """Return when this session has received everything that the bench has sent to it."""
        self.bench.clock.put(Clock(Time(1)))
        assert self.clock.wait(self.bench.clock.sequence, BUDGET_S)


def drain(subscriber: Any) -> list[zenoh.Sample]:
    samples = []
    while (sample := subscriber.try_recv()) is not None:
        samples.append(sample)
    return samples


def wait_until(condition: Any) -> bool:
    """Poll until the condition holds; False after BUDGET_S. For network state that has no notification."""
    deadline = time.monotonic() + BUDGET_S
    while not condition():
        if time.monotonic() > deadline:
            return False
        os.sched_yield()
    return True


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with open_router(PLAN) as router:
        yield Bench(router)


@pytest.fixture
def agent(bench: Bench) -> Iterator[Agent]:
    with open_client(bench.router.access, "agent") as node:
        agent = Agent(bench, node)
        bench.payloads_by_key()
        yield agent


@contextmanager
def raw_session(
    access: AirAccess, mode: str = "client", auth: dict[str, str] | None = None
) -> Iterator[zenoh.Session]:
    """A Zenoh session opened without the bench's client, with any credentials."""
    settings: dict[str, Any] = {
        "mode": mode,
        "connect": {"endpoints": [access.locator], "timeout_ms": 300, "exit_on_failure": True},
        "listen": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "delay": 0},
        "timestamping": {"enabled": True},
    }
    if auth:
        settings["transport"] = {"auth": {"usrpwd": auth}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        yield session


def test_the_agent_can_read_and_write_the_topics_of_its_plan(bench: Bench, agent: Agent) -> None:
    agent.reports.put(String("found"))
    assert bench.reports.wait(agent.reports.sequence, BUDGET_S)
    assert [sample.message() for sample in bench.reports.take()][-1] == String("found")
    assert bench.clock.matched
    bench.clock.put(Clock(Time(5)))
    assert agent.clock.wait(bench.clock.sequence, BUDGET_S)
    assert agent.clock.take()[-1].message() == Clock(Time(5))


def test_a_late_subscriber_receives_latched_samples(bench: Bench) -> None:
    for text in "abcde":
        bench.mission.put(String(text))
    with open_client(bench.router.access, "late") as node:
        mission = node.subscribe("/d/mission", String, latched=True, depth=3)
        assert mission.wait(5, BUDGET_S)
        assert [(sample.sequence, sample.message().data) for sample in mission.take()] == [
            (3, "c"),
            (4, "d"),
            (5, "e"),
        ]
        bench.mission.put(String("f"))
        assert mission.wait(6, BUDGET_S)
        assert (mission.received, mission.lost) == (4, 0)


@pytest.mark.parametrize(
    "pattern",
    [
        *("**", "7/**", "*/truth/**", "7/tru$*/**", "7/d/**", "@/**", "*/*/*/*/*", "@ros2_lv/**"),
        *(SECRET, DETECTIONS, f"{READ}/**"),
    ],
)
def test_a_subscription_outside_the_allow_list_receives_nothing(
    bench: Bench, agent: Agent, pattern: str
) -> None:
    """Whatever pattern the bench publishes on."""
    wide: Any = agent.session.declare_subscriber(pattern)
    agent.flush_sent()
    for key in (SECRET, DETECTIONS, "7/**", "**"):
        bench.session.put(key, b"secret")
    agent.flush_received()
    assert b"secret" not in [sample.payload.to_bytes() for sample in drain(wide)]


@pytest.mark.parametrize(
    ("pattern", "topics"),
    [("**", {READ, LATCHED}), ("7/**", {READ, LATCHED}), ("*/clock/**", {READ}), (f"{READ[:-4]}$*", {READ})],
)
def test_a_wildcard_receives_the_topics_on_the_list_that_it_matches(
    bench: Bench, agent: Agent, pattern: str, topics: set[str]
) -> None:
    """And nothing that another client of the same agent writes."""
    with open_client(bench.router.access, "second") as node:
        wide: Any = node._session.declare_subscriber(pattern)
        second = Agent(bench, node)
        # Zenoh gives a session its own samples back, whatever the router does.
        drain(wide)
        agent.flush_sent()
        bench.mission.put(String("order"))
        second.flush_received()
        assert {str(sample.key_expr) for sample in drain(wide)} == topics


def test_a_wildcard_with_history_receives_the_latched_samples(bench: Bench, agent: Agent) -> None:
    for text in "abcd":
        bench.mission.put(String(text))
    history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=3)
    received: list[zenoh.Sample] = []
    wide = zenoh.ext.declare_advanced_subscriber(
        agent.session, "7/**", received.append, history=history, subscriber_detection=True
    )
    assert wait_until(lambda: len(received) >= 3)
    assert [sample.payload.to_bytes()[8:9] for sample in received] == [b"b", b"c", b"d"]
    assert {str(sample.key_expr) for sample in received} == {LATCHED}
    wide.undeclare()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize("pattern", ["7/**", "**", "7/*/**"])
def test_a_permitted_subscription_receives_only_its_key(bench: Bench, agent: Agent, pattern: str) -> None:
    subscriber: Any = agent.session.declare_subscriber(READ)
    agent.flush_sent()
    bench.session.put(pattern, b"secret")
    agent.flush_received()
    assert b"secret" not in [sample.payload.to_bytes() for sample in drain(subscriber)]


@pytest.mark.parametrize(
    "key",
    [
        *(READ, LATCHED, SECRET, DETECTIONS, f"{WRITE}/more", WRITE.replace("7/", "8/", 1)),
        *("7/**", "**", "7/d/agent/*/**"),
    ],
)
def test_no_other_key_can_be_written(bench: Bench, agent: Agent, key: str) -> None:
    attachment = write_attachment(1, 0, bytes(16))
    agent.session.put(key, b"forged", attachment=attachment)
    agent.session.declare_publisher(key).put(b"forged", attachment=attachment)
    agent.session.delete(key)
    agent.flush_sent()
    assert set(bench.payloads_by_key()) == {WRITE}


def test_permitted_keys_cannot_be_deleted(bench: Bench, agent: Agent) -> None:
    """Only puts are allowed, so the deletion of a permitted key does not get through either."""
    malformed = bench.reports.malformed
    agent.session.delete(WRITE)
    agent.flush_sent()
    assert bench.reports.malformed == malformed


@pytest.mark.parametrize("selector", [SECRET, "**", "7/**", "@/**", "@/*/router", "@/router/local/**"])
def test_queries_of_the_agent_get_no_answer(bench: Bench, agent: Agent, selector: str) -> None:
    """The agent reaches neither storages nor the administration space; the empty answer comes at once.

    A Zenoh session answers queries about itself locally; the bench cannot refuse those.
    """
    own_admin_space = f"@/{agent.session.zid()}/"
    with bench.session.declare_queryable(
        selector if "@" not in selector else SECRET, lambda query: query.reply(SECRET, b"secret")
    ):
        replies = agent.session.get(selector, timeout=BUDGET_S)
        keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
    assert [key for key in keys if not key.startswith(own_admin_space)] == []


@pytest.mark.parametrize("key", ["**", SECRET, READ, f"{LATCHED}/@adv/**"])
def test_the_agent_cannot_answer_queries(bench: Bench, agent: Agent, key: str) -> None:
    """A queryable of the agent receives no query, so the agent cannot forge history for others."""
    queries: list[str] = []
    with agent.session.declare_queryable(key, lambda query: queries.append(str(query.key_expr))):
        agent.flush_sent()
        replies = list(bench.session.get(key, timeout=BUDGET_S, target=zenoh.QueryTarget.ALL))
    assert queries == []
    assert all(b"forged" not in reply.ok.payload.to_bytes() for reply in replies if reply.ok)


def test_both_sides_see_the_ros_graph(bench: Bench, agent: Agent) -> None:
    """Each side sees the other's nodes and endpoints, as `ros2 topic list` would show them."""
    agent_view: Any = agent.session.liveliness().declare_subscriber("@ros2_lv/7/**", history=True)
    agent.flush_received()
    tokens: list[str] = []

    def agent_sees(part: str) -> bool:
        tokens.extend(str(token.key_expr) for token in drain(agent_view))
        return any(part in token for token in tokens)

    assert wait_until(lambda: agent_sees("NN/%/%/bench"))
    assert wait_until(lambda: agent_sees("%d%mission"))
    bench_view: Any = bench.session.liveliness().declare_subscriber("@ros2_lv/7/**", history=True)
    agent.flush_sent()
    names = [str(token.key_expr) for token in drain(bench_view)]
    assert any("/NN/%/%/agent" in token for token in names)
    assert any("/MP/%/%/agent/%d%agent%reports/" in token for token in names)


def test_an_agent_disappears_from_the_graph_when_its_session_closes(bench: Bench) -> None:
    watch: Any = bench.session.liveliness().declare_subscriber("@ros2_lv/7/*/*/*/NN/%/%/visitor")
    with open_client(bench.router.access, "visitor"):
        assert wait_until(lambda: any(token.kind == zenoh.SampleKind.PUT for token in drain(watch)))
    assert wait_until(lambda: any(token.kind == zenoh.SampleKind.DELETE for token in drain(watch)))


@pytest.mark.parametrize(
    "token",
    [
        "truth/alive",
        "@ros2_lv/8/a/0/0/NN/%/%/other_domain",
        "@ros2_lv/7/a/0/1/MP/%/%/bench/%clock/" + READ.split("/", 2)[2] + "/::,10:,:,:,,",
        "@ros2_lv/7/a/0/1/MS/%/%/bench/%truth%actors/" + SECRET.split("/", 3)[3] + "/::,10:,:,:,,",
        f"{LATCHED}/@adv/pub/a/1/_",
    ],
)
def test_the_agent_cannot_forge_graph_tokens(bench: Bench, agent: Agent, token: str) -> None:
    """It cannot appear as a publisher of the bench's topics, nor in another domain."""
    watch: Any = bench.session.liveliness().declare_subscriber(token)
    with agent.session.liveliness().declare_token(token):
        agent.flush_sent()
        assert drain(watch) == []


def test_wrong_credentials_are_refused(bench: Bench) -> None:
    """None, a wrong password, another user name and another session's credentials."""
    access = bench.router.access
    wrong = ({"user": access.user, "password": "x"}, {"user": "router", "password": access.password})
    for auth in (None, *wrong):
        with pytest.raises(zenoh.ZError), raw_session(access, auth=auth):
            pytest.fail("was let in")
    with open_router(PLAN) as other:
        stranger = AirAccess(access.locator, other.access.user, other.access.password, access.domain)
        with pytest.raises(LinkLost, match="credentials"), open_client(stranger, "stranger", timeout_s=0.5):
            pytest.fail("was let in")


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_peer_and_router_modes_meet_the_same_allow_list(bench: Bench, agent: Agent, mode: str) -> None:
    """Valid credentials in another Zenoh mode give no more rights."""
    access = bench.router.access
    with raw_session(access, mode, {"user": access.user, "password": access.password}) as session:
        wide: Any = session.declare_subscriber("**")
        session.put(READ, b"forged")
        session.put(SECRET, b"forged")
        # In router mode not even a permitted sample of this session may come through, so closing it serves as
        # the fence.
        bench.session.put(SECRET, b"secret")
        agent.flush_received()
        payloads = [sample.payload.to_bytes() for sample in drain(wide)]
    agent.flush_sent()
    assert b"secret" not in payloads
    assert b"forged" not in bench.payloads_by_key().values()


def test_oversized_samples_stop_at_the_router(bench: Bench, agent: Agent) -> None:
    """A document over the limit is not delivered, and its sequence number counts as lost."""
    lost = bench.reports.lost
    agent.flush_sent()
    agent.reports.put(String("x" * (MAX_DOCUMENT_BYTES + 1)))
    agent.flush_sent()
    assert bench.reports.lost == lost + 1


def test_the_rate_limit_holds_back_a_flood() -> None:
    """With a wall-clock rate limit of 0.01 Hz, a single sample of a thousand arrives."""
    plan = AirPlan(7, PLAN.agent_reads, PLAN.agent_writes, agent_limit_hz=0.01)
    with open_router(plan) as router, open_client(router.access, "agent") as node:
        reports = router.node("bench").subscribe("/d/agent/reports", String)
        publisher = node.publisher("/d/agent/reports", String)
        for _ in range(1000):
            publisher.put(String("flood"))
        assert reports.wait(1, BUDGET_S)
    assert reports.received == 1


def test_the_first_sample_of_a_new_agent_arrives(bench: Bench) -> None:
    """When an agent publishes at once, without waiting for a match, its first sample is not lost."""
    for _ in range(20):
        bench.reports.take()
        bench.reports.highest = 0
        with open_client(bench.router.access, "hasty") as node:
            publisher = node.publisher("/d/agent/reports", String)
            publisher.put(String("first"))
            publisher.put(String("second"))
            assert bench.reports.wait(2, BUDGET_S)
        assert [sample.sequence for sample in bench.reports.take()] == [1, 2]


def test_no_password_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file from which Zenoh reads the credentials is private, and gone once the router is open."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    modes: list[int] = []
    zenoh_open = zenoh.open

    def open_and_note_modes(config: zenoh.Config) -> zenoh.Session:
        modes.extend(stat.S_IMODE(path.stat().st_mode) for path in tmp_path.rglob("*"))
        return zenoh_open(config)

    monkeypatch.setattr(zenoh, "open", open_and_note_modes)
    with open_router(PLAN) as router:
        assert sorted(modes) == [0o600, 0o700]
        assert list(tmp_path.iterdir()) == []
        assert router.access.password not in repr(router.access)


def test_a_port_in_use_is_a_setup_error() -> None:
    """Closing the other listener frees the port at once."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        plan = AirPlan(7, PLAN.agent_reads, PLAN.agent_writes, port=port)
        with pytest.raises(SetupError, match=f"cannot listen on 127.0.0.1:{port}"), open_router(plan):
            pytest.fail("opened on a taken port")
    with open_router(plan) as router:
        assert router.access.locator == f"tcp/127.0.0.1:{port}"


def test_port_0_retries_when_another_process_takes_the_port(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between finding a free port and listening on it, another process may take it."""
    with socket.create_server(("127.0.0.1", 0)) as listener, socket.create_server(("127.0.0.1", 0)) as free:
        ports = [listener.getsockname()[1], free.getsockname()[1]]
        free.close()
        port_offers = iter(ports)
        monkeypatch.setattr("bench.streams._router._free_port", lambda _: next(port_offers))
        with open_router(PLAN) as router:
            assert router.access.locator == f"tcp/127.0.0.1:{ports[1]}"


def test_all_invalid_topics_and_types_are_reported_together() -> None:
    """A pattern in the plan would widen the allow-list, so it is refused, together with every other fault."""
    plan = AirPlan(
        7,
        agent_reads=(("/**", STRING_TYPE), ("/a", "std_msgs/msg/Strong")),
        agent_writes=(("reports", STRING_TYPE),),
    )
    with pytest.raises(SetupError) as caught, open_router(plan):
        pytest.fail("opened")
    assert len(caught.value.faults) == 3


def test_a_client_without_a_router_raises_link_lost() -> None:
    """The message says what to do instead of repeating Zenoh's error."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with (
        pytest.raises(LinkLost, match="start the session first"),
        open_client(AirAccess(f"tcp/127.0.0.1:{port}", "a", "b"), "a", timeout_s=0.2),
    ):
        pytest.fail("opened")


def test_a_router_opens_without_waiting() -> None:
    """Every session opens a router. Zenoh's own delay of scouting alone would be half a second."""

    def opening_time_s() -> float:
        start_s = time.perf_counter()
        with open_router(PLAN):
            return time.perf_counter() - start_s

    # The quickest, since the host may be busy: on a quiet one it takes 20 ms.
    assert min(opening_time_s() for _ in range(5)) < 0.4
