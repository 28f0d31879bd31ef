# mypy: disable-error-code=func-returns-value
# A fake exchange spends the host's time and answers, in one expression.
"""Rounds of a session without processes or sockets: budgets, counts and events."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from air_documents import valid
from fake_agents import agent_manifest
from test_session import session_simspec, tape_from

from bench.agents import open_agent
from bench.contracts import (
    Ack,
    AgentStatus,
    AgentUsage,
    Hello,
    OnProgress,
    Outcome,
    ProgressUpdate,
    Record,
    SimTime,
    Tape,
    Tick,
    VehicleCondition,
    VehiclePlan,
    VehicleTopics,
    document_text,
    ignore_progress,
)
from bench.perception import open_detector
from bench.simspec import Budgets, Camera, DetectionModel, Mission, Order, Outage, Perception, SimSpec
from bench.simulation import HostClock, Session, SessionPlan, open_plain_scene
from bench.simulation._air_network import open_air_network
from bench.simulation._lockstep import Lockstep
from bench.simulation._mission_information import orders
from bench.simulation._pace import Documents, Pace
from bench.simulation._progress_updates import UPDATE_PERIOD_S
from bench.simulation._real_time import RealTime
from bench.simulation._session_parts import SessionParts, SessionProgress
from bench.simulation._session_watch import SessionWatch
from bench.simulation._stop_session import StopSession
from bench.simulation._truth import TruthRecorder
from bench.simulation._unpaced_air import UnpacedAir
from bench.testing import StillVehicle


class Host:
    """A host whose clock moves when something takes time; starved time and usage are set."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.thread_starved_s = 0.0
        self.others_starved_s = 0.0
        self.thread_cpu_s = 0.0
        self.air_readers_cpu_s = 0.0
        self.usage = AgentUsage()
        self.clock = HostClock(
            lambda: self.now_s,
            self.spend,
            lambda: self.thread_starved_s,
            lambda: self.others_starved_s,
            lambda: self.thread_cpu_s,
            lambda: self.air_readers_cpu_s,
        )

    def spend(self, span_s: float) -> None:
        self.now_s += span_s


class IdleProcess:
    """An agent's process that lives, and whose usage is the host's."""

    def __init__(self, host: Host) -> None:
        self._host = host

    def exit_code(self) -> int | None:
        return None

    def usage(self) -> AgentUsage:
        return self._host.usage


class FakeAgent:
    """The agent's end of the tick socket: `reply_s` for each ack, the same counts every time."""

    def __init__(self, host: Host, reply_s: float = 0.0, links: Mapping[str, int] | None = None) -> None:
        self._host, self._reply_s, self._links = host, reply_s, dict(links or {})
        self.strangers = 0

    def watch(self, check_agent: object, agent_time: object) -> None:
        pass

    def hello(self, budget_s: float) -> Hello:
        return Hello(agent="fake")

    def exchange(self, tick: Tick, budget_s: float) -> Ack:
        self._host.spend(self._reply_s)
        return Ack(number=tick.number, links=self._links)

    def end(self, reason: str) -> None:
        """The reason is in the outcome."""


class ScriptedVehicle(StillVehicle):
    """A still vehicle with scripted failures; `received` has MAVLink messages by link."""

    failures_by_s: Mapping[float, tuple[str, ...]] = {}
    received: Mapping[str, int] = {}

    def condition(self) -> VehicleCondition:
        began = [failures for begin_s, failures in self.failures_by_s.items() if begin_s <= self.time.s]
        return replace(super().condition(), failures=began[-1] if began else ())

    def receive(self) -> Mapping[str, int]:
        return self.received


@contextmanager
def session_of(
    spec: SimSpec,
    host: Host,
    agent: FakeAgent,
    records: list[Record],
    bench_s: float = 0.0,
    on_progress: OnProgress = ignore_progress,
    make_pace: Callable[[SessionParts, SessionWatch], Pace] | None = None,
) -> Iterator[tuple[Session, ScriptedVehicle]]:
    """A session with fakes, in which the bench spends `bench_s` of host time in each round."""

    def tap(record: Record) -> None:
        records.append(record)
        if record.topic == "/clock":
            host.spend(bench_s)

    nowhere = Path()
    agents = (agent_manifest("idle"), nowhere, open_agent, nowhere)
    plan = SessionPlan(spec, *agents, tap, host.clock, on_progress=on_progress)
    vehicle = ScriptedVehicle(VehiclePlan(spec, ()))
    scene = open_plain_scene(spec)
    with open_air_network(spec, tap, zenoh=False, clock=host.clock) as air:
        truth = TruthRecorder(spec.vehicle.name, tap)
        detectors = (open_detector(spec, scene.cast),)
        parts = SessionParts(plan, SessionProgress(), vehicle, scene, detectors, air, truth)
        watch = SessionWatch(parts)
        if make_pace:
            pace = make_pace(parts, watch)
        elif spec.pace.mode == "realtime":
            pace = RealTime(parts, watch, UnpacedAir(parts))
        else:
            pace = Lockstep(parts, watch, agent)  # type: ignore[arg-type]  # the fake answers in this process
        pace.follow(IdleProcess(host))  # type: ignore[arg-type]
        yield Session(parts, watch, pace), vehicle


class Paced(Pace):
    """A pace of the test's own: it notes its beats, and judges the end."""

    def __init__(self, parts: SessionParts, watch: SessionWatch) -> None:
        super().__init__(parts, watch, span_s=0.5)
        self.acts: list[tuple[str, float]] = []

    def begin(self) -> None:
        self.acts.append(("begin", self._parts.progress.now.s))
        self._parts.air.open_for_all()

    def exchange(self, now: SimTime) -> Documents:
        self.acts.append(("exchange", now.s))
        return {}

    def judged(self, end: StopSession) -> StopSession:
        return StopSession(Outcome.BENCH_TOO_SLOW, f"{end.outcome} is not believed")

    def counters(self) -> dict[str, int]:
        return {"beats": len(self.acts) - 1}


def test_a_pace_is_one_class() -> None:
    """It says how long a beat is and what the agent does in it, and has the last word on the end; twice, with two limits."""
    for limit_s, beats in ((1.0, [0.0, 0.5]), (1.5, [0.0, 0.5, 1.0])):
        host, records, paces = Host(), list[Record](), list[Paced]()
        spec = session_simspec(mission=Mission(time_limit_s=limit_s))

        def make_pace(parts: SessionParts, watch: SessionWatch, paces: list[Paced] = paces) -> Pace:
            paces.append(Paced(parts, watch))
            return paces[-1]

        with session_of(spec, host, FakeAgent(host), records, make_pace=make_pace) as (session, _):
            with pytest.raises(StopSession) as end:
                session.run()
            counters = session._progress.counters
        assert paces[0].acts == [("begin", 0.0), *(("exchange", at_s) for at_s in beats)]
        assert end.value.reason == "time_limit is not believed"
        assert counters["beats"] == len(beats)
        assert b"bench_too_slow" in records[-1].data


def end_of(spec: SimSpec, agent: FakeAgent, host: Host, bench_s: float = 0.0) -> StopSession:
    with session_of(spec, host, agent, [], bench_s) as (session, _), pytest.raises(StopSession) as end:
        session.run()
    return end.value


@pytest.mark.parametrize(("late_s", "outcome"), [(1.125, Outcome.AGENT_TIMEOUT), (0.0, Outcome.WALL_BUDGET)])
def test_samples_that_come_long_after_the_ack_are_the_agents_time(late_s: float, outcome: Outcome) -> None:
    """The session waits for them, in every tick: an agent could use up the wall budget that way."""
    host = Host()
    with session_of(session_simspec(**LONG), host, FakeAgent(host), [], 1.0) as (session, _):
        receive = session._parts.air.receive

        def receive_late(*arguments: object) -> dict[str, list[str | bytes]]:
            host.spend(late_s)
            return receive(*arguments)  # type: ignore[arg-type]

        session._parts.air.receive = receive_late  # type: ignore[method-assign, assignment]
        with pytest.raises(StopSession) as end:
            session.run()
    assert end.value.outcome is outcome


def tape_of(spec: SimSpec, vehicle_script: Mapping[float, tuple[str, ...]] | None = None) -> Tape:
    host, records = Host(), list[Record]()
    with session_of(spec, host, FakeAgent(host), records) as (session, vehicle):
        vehicle.failures_by_s = vehicle_script or {}
        with pytest.raises(StopSession):
            session.run()
    return tape_from(records, spec)


LONG = {
    "mission": Mission(time_limit_s=7200.0),
    "budgets": Budgets(wall_s=40.0, reply_s=10.0, connect_s=10.0),
}


@pytest.mark.parametrize(
    ("agent_s", "bench_s", "outcome"),
    [
        (1.125, 1.0, Outcome.AGENT_TIMEOUT),  # the agent used just over half
        (1.0, 1.125, Outcome.WALL_BUDGET),  # the agent used just under half
        (0.0, 2.0, Outcome.WALL_BUDGET),  # the bench alone
        (2.0, 0.0, Outcome.AGENT_TIMEOUT),  # the agent alone
    ],
)
def test_the_side_that_used_most_of_the_wall_budget_is_blamed(
    agent_s: float, bench_s: float, outcome: Outcome
) -> None:
    host = Host()
    end = end_of(session_simspec(**LONG), FakeAgent(host, agent_s), host, bench_s)
    assert end.outcome is outcome
    assert 40.0 < host.now_s < 45.0
    assert ("the agent took" in end.reason) is (outcome is Outcome.AGENT_TIMEOUT)


@pytest.mark.parametrize(("used_s", "outcome"), [(20.0, Outcome.WALL_BUDGET), (20.5, Outcome.AGENT_TIMEOUT)])
def test_an_agent_may_use_exactly_half_of_the_wall_budget(used_s: float, outcome: Outcome) -> None:
    host = Host()
    agent = FakeAgent(host)
    replies = iter([used_s])
    agent.exchange = lambda tick, budget_s: (host.spend(next(replies, 0.0)), Ack(number=tick.number))[1]  # type: ignore[method-assign]
    assert end_of(session_simspec(**LONG), agent, host, bench_s=1.0).outcome is outcome


def test_messages_are_counted_separately_for_each_link() -> None:
    """Surplus messages on one link do not make up for missing ones on others, of which one does not exist."""
    host = Host()
    agent = FakeAgent(host, links={"onboard": 2, "gcs": 3, "payload": 1})
    with session_of(session_simspec(), host, agent, []) as (session, vehicle):
        vehicle.received = {"onboard": 9, "gcs": 2}
        with pytest.raises(StopSession) as end:
            session.run()
    assert end.value.outcome is Outcome.AGENT_PROTOCOL
    for words in (
        "since the start: 3 on link 'gcs', of which 2 came",
        "1 on link 'payload', which does not exist (links: gcs, onboard)",
        "Count each whole frame that went out on the link once (docs/time.md)",
    ):
        assert words in end.value.reason
    assert host.now_s == pytest.approx(5.0, abs=0.01)


def test_a_session_continues_at_once_when_every_link_count_is_reached() -> None:
    """A link may also have received more messages than the agent stated."""
    host = Host()
    agent = FakeAgent(host, links={"onboard": 2, "gcs": 3})
    with session_of(session_simspec(), host, agent, []) as (session, vehicle):
        vehicle.received = {"onboard": 2, "gcs": 4}
        with pytest.raises(StopSession) as end:
            session.run()
    assert (end.value.outcome, host.now_s) == (Outcome.TIME_LIMIT, 0.0)


def test_outages_of_one_kind_merge_and_those_of_different_kinds_are_independent() -> None:
    """Two that overlap are one. Detections due in the detector's outage are lost, not delayed; camera frames continue."""
    outages = (
        Outage(kind="operator_link", at_s=0.25, duration_s=0.5),
        Outage(kind="operator_link", at_s=0.5, duration_s=0.5),
        Outage(kind="detections", at_s=1.5, duration_s=0.5),
    )
    tape = tape_of(session_simspec(outages=outages))
    changes = [(change.time.s, change.value.up) for change in tape.operator_link]
    assert changes == [(0.0, True), (pytest.approx(0.3), False), (1.0, True)]
    delivered = [frame.published.s for frame in tape.detections]
    assert [time_s for time_s in delivered if 0.25 <= time_s < 1.0]
    assert not [time_s for time_s in delivered if 1.5 <= time_s < 2.0]
    assert [time_s for time_s in delivered if time_s >= 2.0]
    assert len(tape.frames) == 16
    lost = {frame.exposed for frame in tape.frames} - {frame.exposed for frame in tape.detections}
    assert sorted(time.s for time in lost if time.s < 2.5) == pytest.approx([1.4, 1.6, 1.8])


def test_a_deactivated_agent_need_not_declare_its_end() -> None:
    """With the deactivation order delivered, a landed, disarmed vehicle ends the session."""
    host = Host()
    orders = (Order(id="off", at_s=1.2, kind="deactivate"),)
    end = end_of(session_simspec(orders=orders), FakeAgent(host), host)
    assert (end.outcome, end.reason.count("ordered to deactivate")) == (Outcome.COMPLETED, 1)


def test_orders_due_at_the_same_time_keep_the_order_of_the_simspec() -> None:
    """Both orders go out in the tick at which they are due."""
    same = (
        Order(id="second-by-name", at_s=1.0, kind="hold"),
        Order(id="a-first-by-name", at_s=1.0, kind="resume"),
        Order(id="earlier", at_s=0.5, kind="hold"),
    )
    spec = session_simspec(orders=same)
    assert [order.id for order in orders(spec)] == ["earlier", "second-by-name", "a-first-by-name"]
    delivered = [(order.time.s, order.value.id) for order in tape_of(spec).orders]
    assert delivered == [(0.5, "earlier"), (1.0, "second-by-name"), (1.0, "a-first-by-name")]


def updates_of(
    spec: SimSpec, reply_s: float, monkeypatch: pytest.MonkeyPatch
) -> tuple[list[ProgressUpdate], list[Record]]:
    """The progress of a session whose agent takes `reply_s` for each tick, and what was recorded of it."""
    host, records, updates = Host(), list[Record](), list[ProgressUpdate]()
    phases = iter(["starting", "taking_off", *["searching"] * 10_000])

    def receive(now: SimTime, topics: object, budget_s: float) -> dict[str, list[str | bytes]]:
        status = valid(AgentStatus, {"time_s": now.s, "phase": next(phases)})
        return {VehicleTopics(spec.vehicle.name).status: [document_text(status)]}

    with session_of(spec, host, FakeAgent(host, reply_s), records, on_progress=updates.append) as (
        session,
        _,
    ):
        monkeypatch.setattr(session._parts.air, "receive", receive)
        with pytest.raises(StopSession):
            session.run()
    return updates, records


@pytest.mark.parametrize("reply_s", [0.25, 1.5])
def test_progress_comes_at_a_bounded_rate_of_the_hosts_time(
    reply_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However fast simulated time passes; the recording knows nothing of it."""
    spec = session_simspec(mission=Mission(time_limit_s=3.0))
    updates, records = updates_of(spec, reply_s, monkeypatch)
    # The last tick ends the session, and has no progress.
    ticks = round(3.0 / spec.pace.tick_s) - 1
    period_s = reply_s * math.ceil(UPDATE_PERIOD_S / reply_s)
    assert [update.wall_s for update in updates] == pytest.approx(
        [period_s * (number + 1) for number in range(int((ticks * reply_s) / period_s))]
    )
    assert {update.time_limit_s for update in updates} == {3.0}
    for update in updates:
        assert update.speed == pytest.approx(spec.pace.tick_s / reply_s, abs=5e-4)
        assert update.simulated_s == pytest.approx(update.wall_s * update.speed, rel=1e-2)
    assert updates[-1].phase == "searching"
    if reply_s > 1.0:
        assert updates[0].phase == "taking_off"
    quick, same_records = updates_of(spec, 0.0, monkeypatch)
    assert (quick, same_records) == ([], records)


def test_simultaneous_failures_are_separate_events() -> None:
    """Each failure gets an event, and the repair of one failure does not end the other."""
    tape = tape_of(session_simspec(), {1.0: ("gps", "motor 2"), 2.0: ("motor 2",)})
    log = [
        (event.time.s, event.value.name, event.value.text)
        for event in tape.events
        if event.value.name in ("failure", "repaired")
    ]
    assert log == [(1.0, "failure", "gps"), (1.0, "failure", "motor 2"), (2.0, "repaired", "gps")]


def test_a_camera_at_the_controller_rate_exposes_one_frame_per_step() -> None:
    spec = session_simspec()
    camera = Camera(rate_hz=50.0)
    fast = spec.model_copy(update={"vehicle": spec.vehicle.model_copy(update={"camera": camera})})
    frames = tape_of(fast).frames
    assert [frame.number for frame in frames] == list(range(150))
    assert [frame.exposed for frame in frames] == [SimTime(20_000_000 * (step + 1)) for step in range(150)]


def test_a_degradation_loses_its_share_of_detections_and_lowers_the_rest() -> None:
    """Inside the span a share is gone and scores are scaled; outside everything is as without it."""
    # A vehicle on the ground sees nobody; two false detections in each frame do as well.
    perception = Perception(model=DetectionModel(false_per_frame=2.0))
    long = {"mission": Mission(time_limit_s=60.0), "perception": perception}
    plain = tape_of(session_simspec(**long))
    outages = (Outage(kind="detections_degraded", at_s=10.0, duration_s=40.0, lost_share=0.4),)
    degraded = tape_of(session_simspec(**long, outages=outages))
    assert [frame.exposed for frame in degraded.detections] == [frame.exposed for frame in plain.detections]
    kept_count = total = 0
    for frame, whole in zip(degraded.detections, plain.detections, strict=True):
        if not 10.0 <= frame.published.s < 50.0:
            assert frame == whole
            continue
        boxes = {detection.box: detection.score for detection in whole.detections}
        kept_count, total = kept_count + len(frame.detections), total + len(boxes)
        assert all(
            detection.score == pytest.approx(0.8 * boxes[detection.box]) for detection in frame.detections
        )
    # Three standard deviations of a share of 0.6 among 300 are 0.085.
    assert total >= 300
    assert kept_count / total == pytest.approx(0.6, abs=0.09)
    repeated = tape_of(session_simspec(**long, outages=outages))
    assert repeated.detections == degraded.detections
