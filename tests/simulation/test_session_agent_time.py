"""Whose time a wait for the agent is: its own, or that of a host too busy to let it answer."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass

import pytest
from test_session import session_simspec
from test_session_rounds import LONG, FakeAgent, Host, session_of

from bench.contracts import Ack, AgentUsage, Outcome, Tick
from bench.simulation import HostClock
from bench.simulation._agent_time import AgentTime, Wait, own_time_s
from bench.simulation._stop_session import StopSession
from bench.simulation._tick_server import TickServer


@pytest.mark.parametrize(
    ("usage", "bench_starved_s", "own_s"),
    [
        (AgentUsage(), 0.0, 10.0),  # asleep throughout
        (AgentUsage(cpu_s=10.0), 0.0, 10.0),  # running throughout
        (AgentUsage(cpu_s=1.0, starved_s=9.0), 0.0, 1.0),  # the host let it run for a second
        (AgentUsage(cpu_s=1.0, starved_s=4.0), 0.0, 6.0),  # and it slept for five
        (AgentUsage(cpu_s=20.0, starved_s=500.0), 0.0, 10.0),  # fifty children that keep two cores busy
        (AgentUsage(cpu_s=5.0, starved_s=500.0), 0.0, 5.0),  # the same among as many strangers
        # It sleeps because the air network has no core to bring it what it waits for.
        (AgentUsage(cpu_s=1.0), 6.0, 4.0),
    ],
)
def test_own_time_is_what_the_agent_ran_or_slept(
    usage: AgentUsage, bench_starved_s: float, own_s: float
) -> None:
    """Ten seconds of waiting. Starved time never excuses more than what was not spent running."""
    assert own_time_s(10.0, usage, bench_starved_s) == own_s


def test_a_wait_compares_with_its_first_look() -> None:
    """What the agent was starved before the wait excuses nothing; the waiting thread's own delay does."""
    host = Host()
    host.usage, host.thread_starved_s = AgentUsage(5.0, 300.0), 50.0
    wait = Wait(AgentTime(host.clock, lambda: host.usage))
    host.spend(2.0)
    assert wait.own_s() == 2.0
    host.spend(6.0)
    host.usage = AgentUsage(5.5, 304.5)
    assert wait.own_s() == pytest.approx(3.5)
    host.spend(1.0)
    host.thread_starved_s += 1.0
    assert wait.own_s() == pytest.approx(3.5)


@dataclass(slots=True)
class Connection:
    """Both ends of a tick socket, with a host whose time passes only while the server looks at its agent."""

    server: TickServer
    peer: socket.socket
    host: Host


TICK = Tick(number=3, time_ns=0, topics={}, links={})


@pytest.fixture
def connection() -> Iterator[Connection]:
    listener = socket.create_server(("127.0.0.1", 0))
    with closing(listener), socket.create_connection(listener.getsockname()) as peer:
        host = Host()
        server = TickServer(listener, host.clock, "secret")
        peer.sendall(b'{"kind":"hello","protocol":1,"agent":"fake","subscribes":[],"secret":"secret"}\n')
        server.hello(1.0)
        yield Connection(server, peer, host)
        server.end("over")


def timed_out(
    connection: Connection, look: Callable[[], AgentUsage], check: Callable[[], None]
) -> StopSession:
    connection.server.watch(check, AgentTime(connection.host.clock, look))
    with pytest.raises(StopSession) as end:
        connection.server.exchange(TICK, 0.4)
    return end.value


@pytest.mark.parametrize(
    ("each_s", "looks"),
    [
        (AgentUsage(), 2),  # asleep: out of time at the first look
        (
            AgentUsage(cpu_s=0.0625, starved_s=0.9375),
            8,
        ),  # starved: at the tenth of its running time, no earlier
    ],
)
def test_two_silent_agents_one_asleep_and_one_starved(
    connection: Connection, each_s: AgentUsage, looks: int
) -> None:
    """A second of the host's time passes at each look."""
    looked = 0

    def look() -> AgentUsage:
        nonlocal looked
        looked += 1
        connection.host.spend(1.0)
        return AgentUsage(each_s.cpu_s * looked, each_s.starved_s * looked)

    end = timed_out(connection, look, lambda: None)
    assert (end.outcome, looked) == (Outcome.AGENT_TIMEOUT, looks)
    assert end.reason == "no answer to tick 3 within 0.4 s of the agent's own time"


def test_an_agent_that_never_gets_a_core_is_ended_by_the_session(connection: Connection) -> None:
    """However long it waits, its own time stays below the budget: what ends the wait is the session's."""
    host = connection.host

    def starved() -> AgentUsage:
        host.spend(1.0)
        return AgentUsage(cpu_s=0.01, starved_s=host.now_s)

    def out_of_host_time() -> None:
        if host.now_s > 5.0:
            raise StopSession(Outcome.WALL_BUDGET, "busy")

    assert timed_out(connection, starved, out_of_host_time).outcome is Outcome.WALL_BUDGET


def test_an_answer_that_is_there_counts_however_late_it_is_read(connection: Connection) -> None:
    """The process that waits had no core for an hour while the answer lay in the socket."""
    host = connection.host

    def now_s() -> float:
        # The first look at the clock is the beginning of the wait: the answer comes after it, then the hour passes.
        if host.now_s == 0.0:
            connection.peer.sendall(b'{"kind":"ack","number":3,"topics":{},"links":{}}\n')
        host.spend(3600.0)
        return host.now_s

    connection.server.watch(lambda: None, AgentTime(HostClock(now_s), AgentUsage))
    assert connection.server.exchange(TICK, 0.4) == Ack(number=3, topics={}, links={})


def test_an_answer_that_comes_byte_by_byte_does_not_last_for_ever(connection: Connection) -> None:
    """There is always something to read, and the budget ends it all the same."""
    host = connection.host

    def now_s() -> float:
        # A byte for each look at the clock, and not from a thread: on a fast host that would fill a line before
        # the budget ends.
        connection.peer.send(b" ")
        host.spend(0.01)
        return host.now_s

    connection.server.watch(lambda: None, AgentTime(HostClock(now_s), AgentUsage))
    with pytest.raises(StopSession) as end:
        connection.server.exchange(TICK, 0.4)
    assert end.value.outcome is Outcome.AGENT_TIMEOUT
    assert host.now_s < 2.0


@pytest.mark.parametrize(
    ("starved_share", "outcome"),
    [(0.0, Outcome.AGENT_TIMEOUT), (0.4, Outcome.AGENT_TIMEOUT), (0.9, Outcome.WALL_BUDGET)],
)
def test_the_wall_budget_is_blamed_on_the_agents_own_time(starved_share: float, outcome: Outcome) -> None:
    """The agent answers each tick after two seconds, of which the host starves it for a share."""
    host = Host()

    class BusyHostAgent(FakeAgent):
        def exchange(self, tick: Tick, budget_s: float) -> Ack:
            starved_s = host.usage.starved_s + 2.0 * starved_share
            host.usage = AgentUsage(host.usage.cpu_s + 0.02, starved_s)
            return super().exchange(tick, budget_s)

    agent = BusyHostAgent(host, 2.0)
    with (
        session_of(session_simspec(**LONG), host, agent, []) as (session, _),
        pytest.raises(StopSession) as end,
    ):
        session.run()
    assert end.value.outcome is outcome
    assert ("too busy to let the agent answer" in end.value.reason) is (outcome is Outcome.WALL_BUDGET)
