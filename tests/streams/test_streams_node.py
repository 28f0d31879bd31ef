"""Publishers and subscriptions: the numbers that lockstep stands on."""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from bench.errors import SetupError
from bench.streams import AirPlan, Clock, QoS, Router, String, Subscription, Time, decode, encode, open_client, open_router
from bench.streams._keys import write_attachment
from bench.streams._node import INBOX_BYTES

BUDGET_S = 10.0  # never waited out when all is well
PLAN = AirPlan(
    domain=1,
    agent_reads=(("/clock", Clock.TYPE), ("/mission", String.TYPE)),
    agent_writes=(("/agent/status", String.TYPE),),
)


@pytest.fixture(scope="module")
def router() -> Iterator[Router]:
    with open_router(PLAN) as router:
        yield router


def arrive(subscription: Subscription, *sequences: int) -> None:
    for sequence in sequences:
        subscription.take_in(encode(String(str(sequence))), write_attachment(sequence, 0, bytes(16)))


def test_an_inbox_counts_what_it_gets() -> None:
    """Received, highest and lost are what the numbers say; a first number above 1 (a late subscriber) loses nothing."""
    inbox = Subscription("/a", String, capacity=10)
    arrive(inbox, 4, 5, 8)
    assert (inbox.highest, inbox.received, inbox.lost) == (8, 3, 2)
    assert [sample.sequence for sample in inbox.take()] == [4, 5, 8]
    assert inbox.take() == []


def test_a_full_inbox_keeps_what_came_first() -> None:
    """A flood cannot push out what was said before it, and is counted; `highest` goes on, so that nobody waits in vain."""
    inbox = Subscription("/a", String, capacity=2)
    arrive(inbox, 1, 2, 3, 4)
    assert [sample.message() for sample in inbox.take()] == [String("1"), String("2")]
    assert (inbox.overflowed, inbox.highest, inbox.received) == (2, 4, 4)


def test_a_few_huge_samples_fill_an_inbox_too() -> None:
    """What waits is bounded in bytes; once it is taken there is room again."""
    inbox = Subscription("/a", String, capacity=4096)
    huge = bytes(INBOX_BYTES // 2)
    for sequence in (1, 2, 3):
        inbox.take_in(huge, write_attachment(sequence, 0, bytes(16)))
    assert (inbox.overflowed, len(inbox.take())) == (1, 2)
    inbox.take_in(huge, write_attachment(4, 0, bytes(16)))
    assert (inbox.overflowed, len(inbox.take())) == (1, 1)


@pytest.mark.parametrize("attachment", [None, b"", bytes(33), b"x" * 33])
def test_samples_without_a_proper_attachment_are_counted_and_dropped(attachment: bytes | None) -> None:
    """What has no number cannot be part of a lockstep."""
    inbox = Subscription("/a", String, capacity=2)
    inbox.take_in(encode(String("x")), attachment)
    assert (inbox.malformed, inbox.received, inbox.take()) == (1, 0, [])


def test_a_sample_of_other_bytes_has_no_message() -> None:
    """The attachment is good, the payload is not: the sample is there, its message is None."""
    inbox = Subscription("/a", String, capacity=2)
    inbox.take_in(b"noise", write_attachment(1, 0, bytes(16)))
    assert [sample.message() for sample in inbox.take()] == [None]


def test_waiting_ends_with_the_number_or_the_budget() -> None:
    """True as soon as the number is there, also when it is there already; False when the budget is used up."""
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
    arrive(inbox, 1, 2)
    thread.join(BUDGET_S)
    assert outcome == [True]


def test_a_thousand_ticks_in_step(router: Router) -> None:
    """Each side holds exactly what the other says it has sent, a thousand times over, with nothing lost."""
    clock = router.node("bench").publisher("/clock", Clock)
    status = router.node("ear").subscribe("/agent/status", String)
    with open_client(router.access, "agent") as node:
        heard, said = node.subscribe("/clock", Clock), node.publisher("/agent/status", String)
        while not clock.matched:
            threading.Event().wait(0.001)
        for tick in range(1, 1001):
            clock.put(Clock(Time.of(tick)))
            assert heard.wait(tick, BUDGET_S)
            assert [sample.message().clock.ns for sample in heard.take()] == [tick]
            said.put(String(str(tick)))
            assert status.wait(tick, BUDGET_S)
            assert [sample.message().data for sample in status.take()] == [str(tick)]
        assert (heard.lost, status.lost) == (0, 0)


def test_publishers_know_whether_anybody_listens(router: Router) -> None:
    """Unheard topics need no encoding; latched ones count as heard, for they are kept for those to come."""
    publisher = router.node("bench").publisher("/mission", String)
    assert not publisher.matched
    assert router.node("keeper").publisher("/mission", String, QoS(latched=True, depth=1)).matched


def test_a_publisher_returns_the_bytes_that_it_sent(router: Router) -> None:
    """The recording holds the bytes of the wire."""
    ear = router.node("ear").subscribe("/mission", String)
    publisher = router.node("bench").publisher("/mission", String)
    data = publisher.put(String("go"))
    assert ear.wait(1, BUDGET_S)
    assert [sample.data for sample in ear.take()] == [data]
    assert publisher.sequence == 1
    assert decode(String, data) == String("go")


def test_a_latched_subscriber_meets_a_late_publisher(router: Router) -> None:
    """An agent that starts before the mission is published gets it once it is."""
    with open_client(router.access, "early") as node:
        mission = node.subscribe("/mission", String, latched=True)
        router.node("bench").latched("/mission", String).put(String("go"))
        assert mission.wait(1, BUDGET_S)
        assert [sample.message() for sample in mission.take()] == [String("go")]


def test_a_latched_topic_outlives_the_callers_interest() -> None:
    """Nobody has to hold the node or the publisher: what was latched is there for as long as the router."""
    with open_router(PLAN) as router:
        router.node("bench").latched("/mission", String).put(String("go"))
        gc.collect()
        with open_client(router.access, "late") as node:
            mission = node.subscribe("/mission", String, latched=True)
            assert mission.wait(1, BUDGET_S)


@pytest.mark.parametrize(("name", "namespace"), [("a/b", "/"), ("", "/"), ("a", "drone"), ("a", "/*"), ("**", "/")])
def test_names_that_would_break_the_graph_are_refused(router: Router, name: str, namespace: str) -> None:
    """Names become chunks of tokens."""
    with pytest.raises(SetupError, match="no ROS 2 node name"):
        router.node(name, namespace)


def test_topics_are_full_names(router: Router) -> None:
    """There is no guessing of namespaces: a relative name is a fault with its mend."""
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


def test_an_agent_in_a_process_of_its_own_keeps_step(router: Router) -> None:
    """The same over a real process boundary, as every agent is run."""
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


def test_the_package_stays_light_for_agents() -> None:
    """An agent imports the streams alone: neither ROS nor scientific packages, nor other rooms of the bench, come along."""
    code = "import sys, bench.streams; print(sorted({name.split('.')[0] for name in sys.modules} & {'rosbags', 'scipy', 'mcap'}))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
