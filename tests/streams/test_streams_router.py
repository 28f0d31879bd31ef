# mypy: disable-error-code=func-returns-value
# `collect(...) or condition` reads what came and then looks at it, in one expression that `until` can repeat.
"""The air network's allow-list, tried from outside: what an agent may do works, and nothing else does.

Nothing here waits for silence. Zenoh keeps the order of what goes over one link, so a permitted sample sent after the attempts
is the proof that the attempts have been dealt with when it arrives.
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

TEXT, TICKS = String.TYPE, Clock.TYPE
PLAN = AirPlan(
    domain=7,
    agent_reads=(("/clock", TICKS), ("/d/mission", TEXT)),
    agent_writes=(("/d/agent/reports", TEXT),),
)
READ, LATCHED, WRITE = data_key(7, "/clock", TICKS), data_key(7, "/d/mission", TEXT), data_key(7, "/d/agent/reports", TEXT)
SECRET = data_key(7, "/truth/actors", TEXT)
DETECTIONS = data_key(7, "/d/detections", "vision_msgs/msg/Detection2DArray")
BUDGET_S = 10.0  # never waited out when all is well


class Bench:
    """The bench's side of one air network, with a watcher on all that the router passes."""

    def __init__(self, router: Router) -> None:
        self.router = router
        self.session: zenoh.Session = router._session
        self.watcher: Any = self.session.declare_subscriber("**")
        self.node = router.node("bench")
        self.clock = self.node.publisher("/clock", Clock, CLOCK_QOS)
        self.mission = self.node.latched("/d/mission", String, depth=3)
        self.reports = self.node.subscribe("/d/agent/reports", String)

    def seen(self) -> dict[str, bytes]:
        """The last payload on every key that reached the router since the last call."""
        return {str(sample.key_expr): sample.payload.to_bytes() for sample in drain(self.watcher)}


class Agent:
    """One permitted agent, used as a fence."""

    def __init__(self, bench: Bench, node: RosNode) -> None:
        self.bench = bench
        self.node = node
        self.session: zenoh.Session = node._session
        self.reports: Publisher = node.publisher("/d/agent/reports", String)
        self.clock: Subscription = node.subscribe("/clock", Clock)
        bench.reports.highest = 0  # every agent numbers its own samples
        self.said()  # so that the router knows of the subscription

    def said(self) -> None:
        """Return when the router has dealt with all that this session has sent."""
        self.reports.put(String("fence"))
        assert self.bench.reports.wait(self.reports.sequence, BUDGET_S)

    def heard(self) -> None:
        """Return when this session has received all that the bench has sent to it."""
        self.bench.clock.put(Clock(Time(1)))
        assert self.clock.wait(self.bench.clock.sequence, BUDGET_S)


def drain(subscriber: Any) -> list[zenoh.Sample]:
    samples = []
    while (sample := subscriber.try_recv()) is not None:
        samples.append(sample)
    return samples


def until(condition: Any) -> bool:
    """Poll a state of the network that nothing announces."""
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
        bench.seen()
        yield agent


@contextmanager
def raw_session(access: AirAccess, mode: str = "client", auth: dict[str, str] | None = None) -> Iterator[zenoh.Session]:
    """A session of an agent's own making, with whatever credentials."""
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


def test_the_agent_reads_and_writes_what_its_plan_names(bench: Bench, agent: Agent) -> None:
    """The permitted keys carry data both ways, unchanged."""
    agent.reports.put(String("found"))
    assert bench.reports.wait(agent.reports.sequence, BUDGET_S)
    assert [sample.message() for sample in bench.reports.take()][-1] == String("found")
    assert bench.clock.matched
    bench.clock.put(Clock(Time(5)))
    assert agent.clock.wait(bench.clock.sequence, BUDGET_S)
    assert agent.clock.take()[-1].message() == Clock(Time(5))


def test_a_late_joiner_gets_what_is_latched(bench: Bench) -> None:
    """A subscriber that comes after the fact gets the last samples with the numbers that they were sent with."""
    for text in "abcde":
        bench.mission.put(String(text))
    with open_client(bench.router.access, "late") as node:
        mission = node.subscribe("/d/mission", String, latched=True, depth=3)
        assert mission.wait(5, BUDGET_S)
        assert [(one.sequence, one.message().data) for one in mission.take()] == [(3, "c"), (4, "d"), (5, "e")]
        bench.mission.put(String("f"))
        assert mission.wait(6, BUDGET_S)
        assert (mission.received, mission.lost) == (4, 0)


@pytest.mark.parametrize(
    "asked",
    ["**", "7/**", "*/truth/**", SECRET, "7/tru$*/**", "7/d/**", DETECTIONS, "@/**", "*/*/*/*/*", f"{READ}/**", "@ros2_lv/**"],
)
def test_no_wider_subscription_hears_anything(bench: Bench, agent: Agent, asked: str) -> None:
    """A key or pattern that is not on the list hears neither secrets nor, by a wider pattern, anything."""
    wide: Any = agent.session.declare_subscriber(asked)
    agent.said()
    for key in (SECRET, DETECTIONS, "7/**", "**"):
        bench.session.put(key, b"secret")
    agent.heard()
    assert b"secret" not in [sample.payload.to_bytes() for sample in drain(wide)]


@pytest.mark.parametrize("pattern", ["7/**", "**", "7/*/**"])
def test_a_permitted_subscription_hears_its_own_key_alone(bench: Bench, agent: Agent, pattern: str) -> None:
    """What the bench puts on a pattern that covers the permitted key does not slip through it."""
    own: Any = agent.session.declare_subscriber(READ)
    agent.said()
    bench.session.put(pattern, b"secret")
    agent.heard()
    assert b"secret" not in [sample.payload.to_bytes() for sample in drain(own)]


@pytest.mark.parametrize(
    "key", [READ, LATCHED, SECRET, DETECTIONS, "7/**", "**", "7/d/agent/*/**", f"{WRITE}/more", WRITE.replace("7/", "8/", 1)]
)
def test_no_other_key_can_be_written(bench: Bench, agent: Agent, key: str) -> None:
    """Puts, publishers and deletes beyond the list reach nobody, least of all under the bench's own topics."""
    attachment = write_attachment(1, 0, bytes(16))
    agent.session.put(key, b"forged", attachment=attachment)
    agent.session.declare_publisher(key).put(b"forged", attachment=attachment)
    agent.session.delete(key)
    agent.said()
    assert set(bench.seen()) == {WRITE}


def test_permitted_keys_cannot_be_deleted(bench: Bench, agent: Agent) -> None:
    """Only puts are allowed, so a deletion of the agent's own key is not seen either."""
    malformed = bench.reports.malformed
    agent.session.delete(WRITE)
    agent.said()
    assert bench.reports.malformed == malformed


@pytest.mark.parametrize("asked", [SECRET, "**", "7/**", "@/**", "@/*/router", "@/router/local/**"])
def test_queries_are_answered_by_nobody(bench: Bench, agent: Agent, asked: str) -> None:
    """No store, no administration space: the answer is empty, at once, though the bench holds an answer.

    A Zenoh session answers questions about itself to itself; that is not the bench's to refuse.
    """
    own = f"@/{agent.session.zid()}/"
    with bench.session.declare_queryable(asked if "@" not in asked else SECRET, lambda query: query.reply(SECRET, b"secret")):
        keys = [str(reply.ok.key_expr) for reply in agent.session.get(asked, timeout=BUDGET_S) if reply.ok is not None]
    assert [key for key in keys if not key.startswith(own)] == []


@pytest.mark.parametrize("key", ["**", SECRET, READ, f"{LATCHED}/@adv/**"])
def test_the_agent_cannot_answer_for_the_bench(bench: Bench, agent: Agent, key: str) -> None:
    """A queryable of the agent's is never asked, so it cannot forge history for others."""
    asked: list[str] = []
    with agent.session.declare_queryable(key, lambda query: asked.append(str(query.key_expr))):
        agent.said()
        replies = list(bench.session.get(key, timeout=BUDGET_S, target=zenoh.QueryTarget.ALL))
    assert asked == []
    assert all(b"forged" not in reply.ok.payload.to_bytes() for reply in replies if reply.ok)


def test_the_graph_shows_what_is_there(bench: Bench, agent: Agent) -> None:
    """Both sides see each other's nodes and endpoints, as `ros2 topic list` would."""
    seen: Any = agent.session.liveliness().declare_subscriber("@ros2_lv/7/**", history=True)
    agent.heard()
    tokens: list[str] = []
    assert until(lambda: tokens.extend(str(one.key_expr) for one in drain(seen)) or any("NN/%/%/bench" in one for one in tokens))
    assert until(lambda: tokens.extend(str(one.key_expr) for one in drain(seen)) or any("%d%mission" in one for one in tokens))
    ours: Any = bench.session.liveliness().declare_subscriber("@ros2_lv/7/**", history=True)
    agent.said()
    names = [str(one.key_expr) for one in drain(ours)]
    assert any("/NN/%/%/agent" in one for one in names)
    assert any("/MP/%/%/agent/%d%agent%reports/" in one for one in names)


def test_an_agent_that_leaves_leaves_the_graph(bench: Bench) -> None:
    """Its tokens go with its session."""
    watch: Any = bench.session.liveliness().declare_subscriber("@ros2_lv/7/*/*/*/NN/%/%/visitor")
    with open_client(bench.router.access, "visitor"):
        assert until(lambda: any(one.kind == zenoh.SampleKind.PUT for one in drain(watch)))
    assert until(lambda: any(one.kind == zenoh.SampleKind.DELETE for one in drain(watch)))


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
def test_the_agent_cannot_pose_in_the_graph(bench: Bench, agent: Agent, token: str) -> None:
    """It cannot show itself as a publisher of what the bench publishes, nor elsewhere than in its domain."""
    watch: Any = bench.session.liveliness().declare_subscriber(token)
    with agent.session.liveliness().declare_token(token):
        agent.said()
        assert drain(watch) == []


def test_without_the_credentials_nobody_comes_in(bench: Bench) -> None:
    """No credentials, a wrong password, another name and another session's credentials are refused."""
    access = bench.router.access
    for auth in (None, {"user": access.user, "password": "x"}, {"user": "router", "password": access.password}):
        with pytest.raises(zenoh.ZError), raw_session(access, auth=auth):
            pytest.fail("was let in")
    with open_router(PLAN) as other:
        stranger = AirAccess(access.locator, other.access.user, other.access.password, access.domain)
        with pytest.raises(LinkLost, match="credentials"), open_client(stranger, "stranger", timeout_s=0.5):
            pytest.fail("was let in")


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_posing_as_peer_or_router_changes_nothing(bench: Bench, agent: Agent, mode: str) -> None:
    """Good credentials in another mode meet the same list."""
    access = bench.router.access
    with raw_session(access, mode, {"user": access.user, "password": access.password}) as session:
        wide: Any = session.declare_subscriber("**")
        session.put(READ, b"forged")
        session.put(SECRET, b"forged")
        # Of this session nothing permitted may come through in router mode; closing it is its last word instead.
        bench.session.put(SECRET, b"secret")
        agent.heard()
        heard = [sample.payload.to_bytes() for sample in drain(wide)]
    agent.said()
    assert b"secret" not in heard
    assert b"forged" not in bench.seen().values()


def test_oversized_samples_stop_at_the_router(bench: Bench, agent: Agent) -> None:
    """A document over the limit reaches nobody, and its number shows as lost."""
    lost = bench.reports.lost
    agent.said()
    agent.reports.put(String("x" * (MAX_DOCUMENT_BYTES + 1)))
    agent.said()
    assert bench.reports.lost == lost + 1


def test_the_rate_limit_holds_back_a_flood() -> None:
    """With a limit by the wall clock, of a flood of samples few arrive."""
    plan = AirPlan(7, PLAN.agent_reads, PLAN.agent_writes, agent_limit_hz=0.01)
    with open_router(plan) as router, open_client(router.access, "agent") as node:
        reports = router.node("bench").subscribe("/d/agent/reports", String)
        publisher = node.publisher("/d/agent/reports", String)
        for _ in range(1000):
            publisher.put(String("flood"))
        assert reports.wait(1, BUDGET_S)
    assert reports.received == 1


def test_the_first_sample_of_a_new_agent_arrives(bench: Bench) -> None:
    """An agent that publishes at once, waiting for no match, is heard from its first sample on."""
    for _ in range(20):
        bench.reports.take()
        bench.reports.highest = 0
        with open_client(bench.router.access, "hasty") as node:
            publisher = node.publisher("/d/agent/reports", String)
            publisher.put(String("first"))
            publisher.put(String("second"))
            assert bench.reports.wait(2, BUDGET_S)
        assert [one.sequence for one in bench.reports.take()] == [1, 2]


def test_no_password_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file that Zenoh reads the credentials from is private, and gone before the router is handed over."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    modes: list[int] = []
    opened = zenoh.open

    def look(config: zenoh.Config) -> zenoh.Session:
        modes.extend(stat.S_IMODE(path.stat().st_mode) for path in tmp_path.rglob("*"))
        return opened(config)

    monkeypatch.setattr(zenoh, "open", look)
    with open_router(PLAN) as router:
        assert sorted(modes) == [0o600, 0o700]
        assert list(tmp_path.iterdir()) == []
        assert router.access.password not in repr(router.access)


def test_a_taken_port_is_said_and_a_free_one_found() -> None:
    """A port asked for and taken is the user's to mend; port 0 finds another; closing frees it at once."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        plan = AirPlan(7, PLAN.agent_reads, PLAN.agent_writes, port=port)
        with pytest.raises(SetupError, match=f"cannot listen on 127.0.0.1:{port}"), open_router(plan):
            pytest.fail("opened on a taken port")
    with open_router(plan) as router:
        assert router.access.locator == f"tcp/127.0.0.1:{port}"


def test_port_0_goes_on_when_somebody_was_quicker(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between finding a free port and listening on it, another process may take it."""
    with socket.create_server(("127.0.0.1", 0)) as taken, socket.create_server(("127.0.0.1", 0)) as free:
        ports = [taken.getsockname()[1], free.getsockname()[1]]
        free.close()
        offered = iter(ports)
        monkeypatch.setattr("bench.streams._router._free_port", lambda _: next(offered))
        with open_router(PLAN) as router:
            assert router.access.locator == f"tcp/127.0.0.1:{ports[1]}"


def test_what_is_no_topic_or_type_is_reported_all_at_once() -> None:
    """A pattern in the plan would open the list: it is refused, together with every other fault."""
    plan = AirPlan(7, agent_reads=(("/**", TEXT), ("/a", "std_msgs/msg/Strong")), agent_writes=(("reports", TEXT),))
    with pytest.raises(SetupError) as caught, open_router(plan):
        pytest.fail("opened")
    assert len(caught.value.faults) == 3


def test_no_router_is_a_lost_link() -> None:
    """A client without a router ends in one sentence, not in Zenoh's words."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with (
        pytest.raises(LinkLost, match="start the session first"),
        open_client(AirAccess(f"tcp/127.0.0.1:{port}", "a", "b"), "a", timeout_s=0.2),
    ):
        pytest.fail("opened")


def test_a_router_opens_in_milliseconds() -> None:
    """Every session opens one: the quickest of five takes less than 50 ms."""

    def once() -> float:
        begun = time.perf_counter()
        with open_router(PLAN):
            return time.perf_counter() - begun

    assert min(once() for _ in range(5)) < 0.05
