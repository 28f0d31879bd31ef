"""The null agents: each flies a short session to its end, and does its one trick."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import pytest
from flown_scenes import run_scene, small_scene

from agent_adapters.null._behaviours import BEHAVIOURS
from agent_adapters.null._session import CAMERA, INTELLIGENCE, MISSION, OPERATOR_LINK, ORDERS
from bench.agents import load_manifest
from bench.contracts import (
    AgentStatus,
    AgentTracks,
    Decision,
    OrderAnswer,
    Outcome,
    Record,
    SessionResult,
    TargetReport,
    VehicleDocument,
    VehicleTopics,
    parse_document,
)
from bench.realization import place
from bench.simspec import Pace, SimSpec
from bench.simulation import HostClock
from bench.streams import String, decode

GROUNDED_S, HOVER_S, TOUR_S = 25.0, 75.0, 110.0
TOURS = ("everywhere", "mark")
# Of the four that repeat what they are told: each way to repeat and each way to stay once. All that hover do so alike.
FLOWN = sorted(BEHAVIOURS.keys() - {"repeat", "repeat-hover-detailed", "hover"})
TOPICS = VehicleTopics("vehicle_1")
VEHICLE = "/truth/vehicle"
KINDS: dict[str, type[Any]] = {
    TOPICS.reports: TargetReport,
    TOPICS.decisions: Decision,
    TOPICS.status: AgentStatus,
    TOPICS.tracks: AgentTracks,
    TOPICS.answers: OrderAnswer,
    VEHICLE: VehicleDocument,
}


@dataclass(frozen=True)
class Flight:
    """One session: its end, the documents of the agent by kind, and whether the vehicle left the ground."""

    end: SessionResult
    reports: list[TargetReport]
    decisions: list[Decision]
    phases: list[str]
    tracks: list[AgentTracks]
    answers: list[OrderAnswer]
    flown: bool
    landed: bool


def simspec(agent: str, limit_s: float, ordered: bool = True) -> SimSpec:
    """Two targets and two intelligence reports, two orders if `ordered`, an outage of the operator's link."""
    orders = [
        {"id": "quiet", "at_s": 8.0, "kind": "stop_reporting"},
        {"id": "mark-it", "at_s": 20.0, "kind": "mark", "intelligence": "one"},
    ]
    spec = small_scene(
        agent,
        ("radar", "radar-vehicle", 30.0, 20.0),
        ("truck", "military-truck", -30.0, 20.0),
        name="null",
        intelligence=[
            {"id": "one", "about": "radar", "uncertainty_m": 20.0},
            {"id": "two", "about": "truck", "uncertainty_m": 20.0, "delivered_s": 5.0},
        ],
        orders=orders if ordered else [],
        outages=[{"kind": "operator_link", "at_s": 14.0, "duration_s": 4.0}],
        mission={"altitude_m": 20.0, "time_limit_s": limit_s},
    )
    return place(spec)


def fly(behaviour: str, limit_s: float, manifest: str = "", real_time: HostClock | None = None) -> Flight:
    """In lockstep, or in real time by the clock given."""
    spec = simspec(manifest or f"null-{behaviour}", limit_s, ordered=not manifest)
    if real_time is not None:
        spec = spec.model_copy(update={"pace": Pace(mode="realtime", max_late_share=1.0)})
    documents: dict[str, list[Any]] = {topic: [] for topic in KINDS}

    def read(record: Record) -> None:
        if record.topic in KINDS:
            document = parse_document(KINDS[record.topic], decode(String.TYPE, record.data).data)
            assert document is not None, record
            documents[record.topic].append(document)

    end = run_scene(spec, read, real_time)
    return Flight(
        end,
        documents[TOPICS.reports],
        documents[TOPICS.decisions],
        list(dict.fromkeys(status.phase for status in documents[TOPICS.status])),
        documents[TOPICS.tracks],
        documents[TOPICS.answers],
        any(not state.landed for state in documents[VEHICLE]),
        documents[VEHICLE][-1].landed,
    )


@pytest.fixture(scope="module")
def flights() -> dict[str, Flight]:
    """One short flight of each of them. Those that stay on the ground need less time to show it."""
    return {
        name: fly(name, TOUR_S if name in TOURS else HOVER_S if BEHAVIOURS[name].flies else GROUNDED_S)
        for name in FLOWN
    }


@pytest.mark.flight
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", FLOWN)
def test_it_lasts_to_the_end_of_the_session(flights: dict[str, Flight], name: str) -> None:
    """An order, an outage and a forbidden order: no null agent gives up or breaks the bench's rules."""
    flight = flights[name]

    assert flight.end.outcome in (Outcome.COMPLETED, Outcome.TIME_LIMIT), flight.end.reason
    assert flight.flown is BEHAVIOURS[name].flies
    assert flight.landed
    # One that flies comes down in time and declares its end.
    assert (flight.end.outcome is Outcome.COMPLETED) is BEHAVIOURS[name].flies, flight.end.reason


@pytest.mark.flight
def test_each_does_its_trick(flights: dict[str, Flight]) -> None:
    """What each publishes, and what it does not."""
    idle = flights["idle"]
    assert not any((idle.reports, idle.decisions, idle.phases, idle.tracks, idle.answers))
    for name, accepted in (("orders", True), ("refuse", False)):
        answers = [(answer.order, answer.accepted) for answer in flights[name].answers]
        assert answers == [("quiet", accepted), ("mark-it", accepted)]
    assert not flights["orders"].reports
    assert not flights["orders"].phases
    assert flights["land"].phases == ["starting", "taking_off", "landing", "complete"]
    assert flights["land"].end.simulated_s < flights["refuse"].end.simulated_s - 10.0
    assert flights["refuse"].phases == ["starting", "taking_off", "holding", "landing", "complete"]
    subjects = {decision.subject for decision in flights["announce"].decisions}
    assert {"gps", "battery", "motor", "link", "operator_link", "detections"} <= subjects


@pytest.mark.flight
@pytest.mark.parametrize("name", ["repeat-hover", "repeat-detailed"])
def test_the_told_places_are_repeated(flights: dict[str, Flight], name: str) -> None:
    """Both intelligence reports, at their own places and with their own classes; never marked."""
    reports = flights[name].reports

    places = {(round(report.east_m / 60), report.class_label) for report in reports}
    assert len(reports) >= 2
    assert len(places) == 2
    assert not any(report.mark for report in reports)
    assert all(bool(report.evidence) is name.endswith("detailed") for report in reports)
    assert bool(flights[name].tracks) is name.endswith("detailed")


@pytest.mark.flight
def test_the_reckless_mark_and_report(flights: dict[str, Flight]) -> None:
    """`mark` marks both places and once more by order, `everywhere` and `random` report again and again."""
    assert all(report.mark for report in flights["mark"].reports)
    assert {report.intelligence_id for report in flights["mark"].reports} == {"one", "two"}
    assert len(flights["everywhere"].reports) > 20
    assert len({(report.east_m, report.north_m) for report in flights["everywhere"].reports}) > 20
    marked = {report.mark for report in flights["random"].reports}
    assert marked == {True, False}


def hurried(times: float) -> HostClock:
    """A host's clock that is so many times faster than the host's own."""
    began_s = time.monotonic()
    return HostClock(lambda: times * (time.monotonic() - began_s), lambda span_s: time.sleep(span_s / times))


@pytest.mark.flight
def test_without_ticks_it_takes_its_time_from_the_clock_topic() -> None:
    """It flies its hop to the end, by a clock ten times as fast as the host's, so that the test waits less. A slow
    host costs no more than some of the 290 simulated seconds that it has.
    """
    flight = fly("land", 290.0, real_time=hurried(10.0))
    assert flight.end.outcome is Outcome.COMPLETED, flight.end.reason
    assert flight.flown
    assert flight.landed


def test_without_ticks_the_idle_one_stays() -> None:
    """It has no clock to go by, and lives until the bench ends it."""
    flight = fly("idle", GROUNDED_S, real_time=hurried(10.0))
    assert flight.end.outcome is Outcome.TIME_LIMIT, flight.end.reason


def test_topics_are_those_of_the_contract() -> None:
    """The agents write the names of topics by hand; these are the bench's."""
    topics = VehicleTopics("v")
    named = [topics.mission, topics.intelligence, topics.orders, topics.operator_link]
    written = [f"/v/{name}" for name in (MISSION, INTELLIGENCE, ORDERS, OPERATOR_LINK, CAMERA)]
    assert written == [*named, topics.camera_info("front")]


def test_every_behaviour_has_a_manifest() -> None:
    for name, behaviour in BEHAVIOURS.items():
        manifest, _ = load_manifest(f"null-{name}")
        assert manifest.name == f"null-{name}"
        assert manifest.command[-1] == name
        assert bool(manifest.mavlink) is behaviour.flies
        assert manifest.zenoh is bool(behaviour.listens)
