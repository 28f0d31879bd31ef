# mypy: disable-error-code=func-returns-value
# A fake exchange spends the host's time and answers, in one expression.
"""Rounds of a session without processes or sockets: budgets, counts and events, with two of everything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from test_session import situation

from bench.agents import open_agent
from bench.contracts import Ack, Hello, Outcome, Record, SimTime, Tape, Tick, VehicleCondition, VehiclePlan
from bench.recording import TapeBuilder
from bench.simspec import Budgets, Camera, Mission, Order, Outage, SimSpec
from bench.simulation import HostClock, Session, SessionPlan, open_detector, open_plain_scene
from bench.simulation._air_network import open_air_network
from bench.simulation._mission_information import orders
from bench.simulation._session import SessionProgress
from bench.simulation._stop_session import StopSession
from bench.simulation._truth import TruthRecorder
from bench.testing import StillVehicle, agent_manifest


class Host:
    """A host whose clock moves only when something takes time on it."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.clock = HostClock(lambda: self.now_s, self.spend)

    def spend(self, span_s: float) -> None:
        self.now_s += span_s


class FakeAgent:
    """The agent's end of the tick socket: takes `reply_s` for each answer and states the same links every time."""

    def __init__(self, host: Host, reply_s: float = 0.0, links: Mapping[str, int] | None = None) -> None:
        self._host, self._reply_s, self._links = host, reply_s, dict(links or {})

    def watch(self, check_agent: object) -> None:
        pass

    def hello(self, budget_s: float) -> Hello:
        return Hello(agent="fake")

    def exchange(self, tick: Tick, budget_s: float) -> Ack:
        self._host.spend(self._reply_s)
        return Ack(number=tick.number, links=self._links)


class ScriptedVehicle(StillVehicle):
    """Still, with the failures of a script by the second, and the MAVLink messages that it has received by link."""

    failures_by_s: Mapping[float, tuple[str, ...]] = {}
    received: Mapping[str, int] = {}

    def condition(self) -> VehicleCondition:
        began = [failures for begin_s, failures in self.failures_by_s.items() if begin_s <= self.time.s]
        return replace(super().condition(), failures=began[-1] if began else ())

    def receive(self) -> Mapping[str, int]:
        return self.received


@contextmanager
def session_of(
    spec: SimSpec, host: Host, agent: FakeAgent, records: list[Record], bench_s: float = 0.0
) -> Iterator[tuple[Session, ScriptedVehicle]]:
    """A session over fakes; the bench spends `bench_s` of the host's time in each round."""

    def tap(record: Record) -> None:
        records.append(record)
        if record.topic == "/clock":
            host.spend(bench_s)

    plan = SessionPlan(spec, agent_manifest("idle"), Path(), open_agent, Path(), tap, host.clock)
    vehicle = ScriptedVehicle(VehiclePlan(spec, ()))
    scene = open_plain_scene(spec)
    with open_air_network(spec, tap, zenoh=False, clock=host.clock) as air:
        truth = TruthRecorder(spec.vehicle.name, tap)
        session = Session(plan, vehicle, scene, open_detector(spec, scene.cast), air, truth, SessionProgress())
        session.attach(None, agent)  # type: ignore[arg-type]  # no process: the fake answers in this one
        yield session, vehicle


def end_of(spec: SimSpec, agent: FakeAgent, host: Host, bench_s: float = 0.0) -> StopSession:
    with session_of(spec, host, agent, [], bench_s) as (session, _), pytest.raises(StopSession) as end:
        session.run()
    return end.value


def tape_of(spec: SimSpec, vehicle_script: Mapping[float, tuple[str, ...]] | None = None) -> Tape:
    host, records = Host(), list[Record]()
    with session_of(spec, host, FakeAgent(host), records) as (session, vehicle):
        vehicle.failures_by_s = vehicle_script or {}
        with pytest.raises(StopSession):
            session.run()
    builder = TapeBuilder(spec)
    for record in records:
        builder(record)
    return builder.tape()


LONG = {"mission": Mission(time_limit_s=7200.0), "budgets": Budgets(wall_s=40.0, reply_s=10.0, connect_s=10.0)}


@pytest.mark.parametrize(
    ("agent_s", "bench_s", "outcome"),
    [
        (1.125, 1.0, Outcome.AGENT_TIMEOUT),  # just over half of what was used up
        (1.0, 1.125, Outcome.WALL_BUDGET),  # just under half
        (0.0, 2.0, Outcome.WALL_BUDGET),  # the bench alone
        (2.0, 0.0, Outcome.AGENT_TIMEOUT),  # the agent alone
    ],
)
def test_the_side_that_used_up_the_wall_budget_answers_for_it(agent_s: float, bench_s: float, outcome: Outcome) -> None:
    """An agent cannot get rid of a run by dawdling, and is not blamed for a slow host."""
    host = Host()
    end = end_of(situation(**LONG), FakeAgent(host, agent_s), host, bench_s)
    assert end.outcome is outcome
    assert 40.0 < host.now_s < 45.0
    assert ("the agent took" in end.reason) is (outcome is Outcome.AGENT_TIMEOUT)


@pytest.mark.parametrize(("used_s", "outcome"), [(20.0, Outcome.WALL_BUDGET), (20.5, Outcome.AGENT_TIMEOUT)])
def test_exactly_half_of_the_budget_is_not_too_much(used_s: float, outcome: Outcome) -> None:
    """The agent answers for more than half of the budget; half of it is still its own."""
    host = Host()
    agent = FakeAgent(host)
    replies = iter([used_s])
    agent.exchange = lambda tick, budget_s: (host.spend(next(replies, 0.0)), Ack(number=tick.number))[1]  # type: ignore[method-assign]
    assert end_of(situation(**LONG), agent, host, bench_s=1.0).outcome is outcome


def test_two_links_are_counted_apart() -> None:
    """Of two links in lockstep, the one whose messages did not come is named; the other one's do not make up for it."""
    host = Host()
    agent = FakeAgent(host, links={"onboard": 2, "gcs": 3})
    with session_of(situation(), host, agent, []) as (session, vehicle):
        vehicle.received = {"onboard": 9, "gcs": 2}
        with pytest.raises(StopSession) as end:
            session.run()
    assert end.value.outcome is Outcome.AGENT_PROTOCOL
    assert end.value.reason == "the agent says it sent {'gcs': 3} MAVLink messages; {'onboard': 9, 'gcs': 2} came"
    assert host.now_s == pytest.approx(5.0, abs=0.01)


def test_two_links_that_both_came_are_no_reason_to_wait() -> None:
    """A session goes on at once when each link has what was stated, or more."""
    host = Host()
    with session_of(situation(), host, FakeAgent(host, links={"onboard": 2, "gcs": 3}), []) as (session, vehicle):
        vehicle.received = {"onboard": 2, "gcs": 4}
        with pytest.raises(StopSession) as end:
            session.run()
    assert (end.value.outcome, host.now_s) == (Outcome.TIME_LIMIT, 0.0)


def test_two_outages_that_overlap_are_one_silence() -> None:
    """The link is down from the first outage's begin to the second one's end, and does not come up in between."""
    outages = (
        Outage(kind="operator_link", at_s=0.5, duration_s=1.0),
        Outage(kind="operator_link", at_s=1.0, duration_s=1.0),
    )
    tape = tape_of(situation(outages=outages))
    changes = [(change.time.s, change.value.up) for change in tape.operator_link]
    assert changes == [(0.0, True), (0.5, False), (2.0, True)]


def test_two_outages_of_different_kinds_do_not_touch_each_other() -> None:
    """A silent detector leaves the operator's link up, and a link that is down leaves detections alone."""
    outages = (
        Outage(kind="operator_link", at_s=0.5, duration_s=0.5),
        Outage(kind="detections", at_s=1.5, duration_s=0.5),
    )
    tape = tape_of(situation(outages=outages))
    assert [(change.time.s, change.value.up) for change in tape.operator_link] == [(0.0, True), (0.5, False), (1.0, True)]
    delivered = [frame.published.s for frame in tape.detections]
    assert [time_s for time_s in delivered if 0.5 <= time_s < 1.0]
    assert not [time_s for time_s in delivered if 1.5 <= time_s < 2.0]


def test_two_orders_of_one_moment_are_delivered_in_one_tick_in_their_order() -> None:
    """Orders of the same second keep the order of the SimSpec, and both go out at the tick at which they are due."""
    same = (
        Order(id="second-by-name", at_s=1.0, kind="hold"),
        Order(id="a-first-by-name", at_s=1.0, kind="resume"),
        Order(id="earlier", at_s=0.5, kind="hold"),
    )
    spec = situation(orders=same)
    assert [order.id for order in orders(spec)] == ["earlier", "second-by-name", "a-first-by-name"]
    delivered = [(order.time.s, order.value.id) for order in tape_of(spec).orders]
    assert delivered == [(0.5, "earlier"), (1.0, "second-by-name"), (1.0, "a-first-by-name")]


def test_two_failures_at_once_are_two_events_and_each_ends_on_its_own() -> None:
    """What breaks together is named one by one, and a repair of one says nothing about the other."""
    tape = tape_of(situation(), {1.0: ("gps", "motor 2"), 2.0: ("motor 2",)})
    log = [
        (event.time.s, event.value.name, event.value.text) for event in tape.events if event.value.name in ("failure", "repaired")
    ]
    assert log == [(1.0, "failure", "gps"), (1.0, "failure", "motor 2"), (2.0, "repaired", "gps")]


def test_a_camera_as_fast_as_the_controller_exposes_one_frame_a_step() -> None:
    """Two frames are never due in one step, so none is skipped and none comes twice."""
    spec = situation()
    camera = Camera(rate_hz=50.0)
    fast = spec.model_copy(update={"vehicle": spec.vehicle.model_copy(update={"camera": camera})})
    frames = tape_of(fast).frames
    assert [frame.number for frame in frames] == list(range(150))
    assert [frame.exposed for frame in frames] == [SimTime(20_000_000 * (step + 1)) for step in range(150)]
