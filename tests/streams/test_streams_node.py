"""Publishers and subscriptions: the sequence numbers on which lockstep depends."""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from bench.errors import SetupError
from bench.streams import (
    AirPlan,
    Clock,
    QoS,
    Router,
    String,
    Subscription,
    Time,
    decode,
    encode,
    open_client,
    open_router,
)
from bench.streams._keys import write_attachment
from bench.streams._node import INBOX_BYTES

BUDGET_S = 10.0  # only reached when a test fails
PLAN = AirPlan(
    domain=1,
    agent_reads=(("/clock", Clock.TYPE), ("/mission", String.TYPE)),
    agent_writes=(("/agent/status", String.TYPE),),
)


@pytest.fixture(scope="module")
def router() -> Iterator[Router]:
    with open_router(PLAN) as router:
        yield router


def deliver(subscription: Subscription, *sequences: int) -> None:
    for sequence in sequences:
        subscription.take_in(encode(String(str(sequence))), write_attachment(sequence, 0, bytes(16)))


@pytest.mark.parametrize(
    ("sequences", "taken", "highest", "lost"),
    [
        ((4, 5, 8), [4, 5, 8], 8, 2),  # a late subscriber loses nothing by its first number
        ((1, 2, 3, 5), [1, 2, 3, 5], 5, 1),
        ((0, 1, 2, 4), [1, 2, 3, 5], 5, 1),  # from 0 or from 1 alike
        ((1, 2, 0, 3), None, 3, 0),  # only the first sample says where its publisher starts
    ],
)
def test_an_inbox_counts_received_and_lost_samples(
    sequences: tuple[int, ...], taken: list[int] | None, highest: int, lost: int
) -> None:
    """Gaps in the sequence count as lost."""
    inbox = Subscription("/a", String, capacity=10)
    deliver(inbox, *sequences)
    assert (inbox.highest, inbox.received, inbox.lost, inbox.malformed) == (highest, len(sequences), lost, 0)
    assert inbox.wait(highest, 0.0)
    assert not inbox.wait(highest + 1, 0.0)
    if taken is not None:
        assert [sample.sequence for sample in inbox.take()] == taken
        assert inbox.take() == []


def test_a_full_inbox_keeps_the_oldest_samples() -> None:
    """Overflowing samples are dropped and counted; `highest` still rises, so a waiter is not left waiting."""
    inbox = Subscription("/a", String, capacity=2)
    deliver(inbox, 1, 2, 3, 4)
    assert [sample.message() for sample in inbox.take()] == [String("1"), String("2")]
    assert (inbox.overflowed, inbox.highest, inbox.received) == (2, 4, 4)


def test_an_inbox_is_bounded_in_bytes() -> None:
    """A few huge samples fill an inbox; taking them makes room again."""
    inbox = Subscription("/a", String, capacity=4096)
    huge = bytes(INBOX_BYTES // 2)
    for sequence in (1, 2, 3):
        inbox.take_in(huge, write_attachment(sequence, 0, bytes(16)))
    assert (inbox.overflowed, len(inbox.take())) == (1, 2)
    inbox.take_in(huge, write_attachment(4, 0, bytes(16)))
    assert (inbox.overflowed, len(inbox.take())) == (1, 1)


@pytest.mark.parametrize("attachment", [None, b"", bytes(33), b"x" * 33])
def test_samples_with_a_malformed_attachment_are_counted_and_dropped(attachment: bytes | None) -> None:
    """A sample without a sequence number cannot take part in lockstep."""
    inbox = Subscription("/a", String, capacity=2)
    inbox.take_in(encode(String("x")), attachment)
    assert (inbox.malformed, inbox.received, inbox.take()) == (1, 0, [])


def test_a_sample_with_an_invalid_payload_has_no_message() -> None:
    inbox = Subscription("/a", String, capacity=2)
    inbox.take_in(b"noise", write_attachment(1, 0, bytes(16)))
    assert [sample.message() for sample in inbox.take()] == [None]


def test_waiting_ends_when_the_number_arrives_or_the_budget_is_used_up() -> None:
    """Also if it arrived earlier."""
    inbox = Subscription("/a", String, capacity=9)
    assert inbox.wait(0, 0.0)
    assert not inbox.wait(1, 0.0)
    waiting = threading.Event()
    outcome: list[bool] = []

    def wait() -> None:
        waiting.set()
        outcome.append(inbox.wait(2, BUDGET_S))

    thread = threading.Thread(target=wait)
    thread.start()
    assert waiting.wait(BUDGET_S)
    deliver(inbox, 1, 2)
    thread.join(BUDGET_S)
    assert outcome == [True]


def test_a_thousand_lockstep_ticks_lose_nothing(router: Router) -> None:
    """In each of 1000 ticks, each side receives exactly what the other side has sent."""
    clock = router.node("bench").publisher("/clock", Clock)
    status = router.node("ear").subscribe("/agent/status", String)
    with open_client(router.access, "agent") as node:
        ticks, reports = node.subscribe("/clock", Clock), node.publisher("/agent/status", String)
        while not clock.matched:
            threading.Event().wait(0.001)
        for tick in range(1, 1001):
            clock.put(Clock(Time.of(tick)))
            assert ticks.wait(tick, BUDGET_S)
            assert [sample.message().clock.ns for sample in ticks.take()] == [tick]
            reports.put(String(str(tick)))
            assert status.wait(tick, BUDGET_S)
            assert [sample.message().data for sample in status.take()] == [str(tick)]
        assert (ticks.lost, status.lost) == (0, 0)


def test_publishers_know_whether_they_have_subscribers(router: Router) -> None:
    """A topic without them needs no encoding; a latched one counts as matched: it is kept for later ones."""
    publisher = router.node("bench").publisher("/mission", String)
    assert not publisher.matched
    assert router.node("keeper").publisher("/mission", String, QoS(latched=True, depth=1)).matched


def test_a_publisher_returns_the_bytes_that_it_sent(router: Router) -> None:
    """The recording stores the bytes that went over the network."""
    subscription = router.node("ear").subscribe("/mission", String)
    publisher = router.node("bench").publisher("/mission", String)
    data = publisher.put(String("go"))
    assert subscription.wait(1, BUDGET_S)
    assert [sample.data for sample in subscription.take()] == [data]
    assert publisher.sequence == 1
    assert decode(String, data) == String("go")


def test_a_latched_subscriber_receives_from_a_later_publisher(router: Router) -> None:
    """An agent that starts before the mission is published receives it later."""
    with open_client(router.access, "early") as node:
        mission = node.subscribe("/mission", String, latched=True)
        router.node("bench").latched("/mission", String).put(String("go"))
        assert mission.wait(1, BUDGET_S)
        assert [sample.message() for sample in mission.take()] == [String("go")]


def test_a_latched_topic_lives_as_long_as_the_router() -> None:
    """The caller need not keep a reference to the node or the publisher."""
    with open_router(PLAN) as router:
        router.node("bench").latched("/mission", String).put(String("go"))
        gc.collect()
        with open_client(router.access, "late") as node:
            mission = node.subscribe("/mission", String, latched=True)
            assert mission.wait(1, BUDGET_S)


@pytest.mark.parametrize(
    ("name", "namespace"), [("a/b", "/"), ("", "/"), ("a", "drone"), ("a", "/*"), ("**", "/")]
)
def test_invalid_node_names_and_namespaces_are_refused(router: Router, name: str, namespace: str) -> None:
    """A name becomes a chunk of a liveliness token, so it must not contain separators or wildcards."""
    with pytest.raises(SetupError, match="no ROS 2 node name"):
        router.node(name, namespace)


def test_relative_topic_names_are_refused(router: Router) -> None:
    with pytest.raises(SetupError, match="write it in full"):
        router.node("bench").publisher("mission", String)


AGENT = """
import sys
from bench.streams import AirAccess, Clock, String, open_client

access = AirAccess(sys.argv[1], "agent", sys.stdin.readline().strip(), 1)
with open_client(access, "agent") as node:
    clock, status = node.subscribe("/clock", Clock), node.publisher("/agent/status", String)
    print("ready", flush=True)
    for tick in range(1, 101):
        assert clock.wait(tick, 10.0)
        status.put(String(str(clock.take()[0].message().clock.ns)))
    sys.stdin.readline()
"""


def test_lockstep_works_with_an_agent_in_another_process(router: Router) -> None:
    clock = router.node("bench").publisher("/clock", Clock)
    status = router.node("ear").subscribe("/agent/status", String)
    command = [sys.executable, "-c", AGENT, router.access.locator]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as agent:
        assert agent.stdin is not None
        assert agent.stdout is not None
        print(router.access.password, file=agent.stdin, flush=True)
        assert agent.stdout.readline() == "ready\n"
        while not clock.matched:
            threading.Event().wait(0.001)
        for tick in range(1, 101):
            clock.put(Clock(Time.of(tick)))
            assert status.wait(tick, BUDGET_S)
        print(file=agent.stdin, flush=True)
    assert agent.returncode == 0
    assert [sample.message().data for sample in status.take()] == [str(tick) for tick in range(1, 101)]


def test_importing_streams_does_not_import_heavy_packages() -> None:
    code = "import sys, bench.streams; print(sorted({name.split('.')[0] for name in sys.modules} & {'rosbags', 'scipy', 'mcap'}))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "[]\n"
