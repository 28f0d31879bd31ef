"""What an agent says beyond a stated rate is counted and dropped, by simulated time; beyond a total it ends the session."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from fake_agents import agent_manifest
from test_session import patient_clock, run, session_simspec

from bench.contracts import Outcome, Record, SimTime, VehicleTopics
from bench.simulation._air_network import AirNetwork, open_air_network
from bench.simulation._allowance import (
    MAVLINK_FROM_AGENT_BYTES,
    MAVLINK_TO_AGENT_BYTES,
    MAX_DROPPED_BYTES,
    MAX_DROPPED_SAMPLES,
    TOPIC_BYTES,
    TOPIC_SAMPLES,
    Limit,
    TopicAllowance,
)
from bench.simulation._host_clock import HOST_CLOCK, _AirReaders
from bench.simulation._stop_session import StopSession
from bench.simulation._truth import TruthRecorder
from bench.streams import Publisher, String, open_client

SPEC = session_simspec()
TOPICS = VehicleTopics(SPEC.vehicle.name)
LONG_CHARACTERS = 10_000


def at(time_s: float) -> SimTime:
    return SimTime(round(time_s * 1e9))


@dataclass
class Air:
    """An air network with an agent's publishers of two topics, and what the bench made of it."""

    network: AirNetwork
    publishers: dict[str, Publisher]
    records: list[Record]
    drops: list[tuple[SimTime, str]]
    sent: dict[str, int] = field(default_factory=dict)

    def send(self, topic: str, count: int, text: str = "{}") -> None:
        (subscription,) = (one for one in self.network._subscriptions if one.topic == topic)
        for _ in range(count):
            self.publishers[topic].put(String(text))
            self.sent[topic] = self.sent.get(topic, 0) + 1
            # One after the other where they are long: on a busy host Zenoh drops what its queue cannot hold.
            if len(text) > LONG_CHARACTERS:
                assert subscription.wait(self.sent[topic], 60.0)

    def receive(self, time_s: float) -> dict[str, int]:
        """Documents taken in, by topic."""
        documents = self.network.receive(at(time_s), self.sent, 60.0)
        return {topic: len(texts) for topic, texts in documents.items()}


@contextmanager
def opened() -> Iterator[Air]:
    records: list[Record] = []
    drops: list[tuple[SimTime, str]] = []
    with open_air_network(
        SPEC, records.append, zenoh=True, on_drop=lambda time, topic: drops.append((time, topic))
    ) as network:
        assert network.access is not None
        with open_client(network.access, "agent") as node:
            publishers = {
                topic: node.publisher(topic, String) for topic in (TOPICS.decisions, TOPICS.reports)
            }
            yield Air(network, publishers, records, drops)


@pytest.fixture
def air() -> Iterator[Air]:
    with opened() as network:
        yield network


def test_two_topics_have_limits_of_their_own(air: Air) -> None:
    """Decisions beyond the limit are dropped and noted once; reports are all taken in, at the same moment and later."""
    air.send(TOPICS.decisions, 700)
    air.send(TOPICS.reports, 300)
    assert air.receive(0.0) == {TOPICS.decisions: 500, TOPICS.reports: 300}
    assert air.drops == [(at(0.0), TOPICS.decisions)]
    air.send(TOPICS.decisions, 200)
    air.send(TOPICS.reports, 200)
    # Two seconds later there is room for two seconds' worth, whatever was dropped before.
    assert air.receive(2.0) == {TOPICS.decisions: 100, TOPICS.reports: 200}
    assert len(air.drops) == 1
    assert air.network.counters()["air_dropped"] == 300
    assert len(air.records) == 1100


def test_what_the_air_network_reads_for_an_agent_is_counted(air: Air) -> None:
    """By the CPU time of the threads that read its connection, which goes on rising also where a thread of theirs ends."""
    readings = [HOST_CLOCK.air_readers_cpu()]
    for topic in (TOPICS.decisions, TOPICS.reports):
        air.send(topic, 200)
        air.receive(0.0)
        readings.append(HOST_CLOCK.air_readers_cpu())
    assert 0.0 <= readings[0] < readings[1] < readings[2]


def test_a_reader_that_has_ended_keeps_its_part() -> None:
    """Two threads with a reader's name and one without, which end one after the other."""
    libc, readers, ending = ctypes.CDLL(None), _AirReaders(), [threading.Event() for _ in range(3)]
    named = threading.Barrier(4)

    def work(name: bytes, over: threading.Event) -> None:
        libc.prctl(15, name)  # PR_SET_NAME
        sum(range(200_000))
        named.wait()
        over.wait()

    threads = [
        threading.Thread(target=work, args=(name, over))
        for name, over in zip((b"rx-7", b"acc-7", b"tx-7"), ending, strict=True)
    ]
    before_s = _AirReaders().cpu_s()
    for thread in threads:
        thread.start()
    named.wait()
    readings = [readers.cpu_s()]
    for over, thread in zip(ending, threads, strict=True):
        over.set()
        thread.join()
        readings.append(readers.cpu_s())
    assert readings[0] > before_s
    assert readings == sorted(readings)


def test_long_documents_use_up_the_bytes(air: Air) -> None:
    """Eight MiB at once, and 256 KiB a second, of one topic."""
    text = "x" * (250 * 1024)
    air.send(TOPICS.reports, 34, text)
    assert air.receive(0.0) == {TOPICS.reports: 32}
    air.send(TOPICS.reports, 2, text)
    # 192 KiB were left of the eight MiB.
    assert air.receive(1.0) == {TOPICS.reports: 1}
    assert air.drops == [(at(0.0), TOPICS.reports)]


def test_beyond_a_total_the_session_ends(air: Air) -> None:
    """Two topics together; up to the total everything else goes on."""
    air.send(TOPICS.decisions, 3500)
    air.send(TOPICS.reports, 3500)
    air.receive(0.0)
    air.send(TOPICS.decisions, 4000)
    air.receive(0.0)
    assert air.network.dropped[0] == MAX_DROPPED_SAMPLES
    air.send(TOPICS.reports, 1)
    with pytest.raises(StopSession, match="floods its topics: 10,001 samples") as end:
        air.receive(0.0)
    assert end.value.outcome is Outcome.AGENT_FLOODED
    assert end.value.outcome.counts


def test_more_at_once_than_an_inbox_holds_is_a_flood(air: Air) -> None:
    air.send(TOPICS.decisions, 5000)
    with pytest.raises(StopSession, match="more came at once") as end:
        air.receive(0.0)
    assert end.value.outcome is Outcome.AGENT_FLOODED


def test_samples_that_no_ack_states_wait_for_one_that_does(air: Air) -> None:
    """They may have come or not when the ack does, and the recording must not depend on it."""
    air.send(TOPICS.decisions, 3)
    air.send(TOPICS.reports, 1)
    air.receive(0.0)
    for _ in range(2):
        air.publishers[TOPICS.decisions].put(String("{}"))
    air.send(TOPICS.reports, 1)
    assert air.receive(0.1) == {TOPICS.reports: 1}
    # Both are there by now: the bench has waited for them on the same connection.
    air.sent[TOPICS.decisions] = 4
    assert air.receive(0.2) == {TOPICS.decisions: 1}
    air.sent[TOPICS.decisions] = 5
    assert air.receive(0.3) == {TOPICS.decisions: 1}
    assert air.network.counters()["air_unstated"] == 0


def test_limits_go_by_simulated_time_to_the_nanosecond() -> None:
    """Both at once and later; equal sequences drop the same samples."""
    limit = Limit(3, 2)
    assert [limit.reached(amount, at(0.0)) for amount in (3, 4)] == [False, True]
    assert [limit.reached(4, SimTime(ns)) for ns in (499_999_999, 500_000_000)] == [True, False]
    assert [limit.reached(amount, at(10.0)) for amount in (23, 24)] == [False, True]
    first, second = TopicAllowance(), TopicAllowance()
    moments = [at(number / 90.0) for number in range(3000)]
    assert [first.admits(time, 10) for time in moments] == [second.admits(time, 10) for time in moments]
    assert first.samples + first.dropped == 3000
    # 500 at once and 50 a second: of 90 a second in 33.3 s, that leaves no more than this.
    assert first.samples == 500 + int(50 * moments[-1].s)


def test_a_busy_agent_loses_nothing_and_a_talkative_one_goes_on(tmp_path: Path) -> None:
    """1,500 documents in the first tick: 500 are recorded, one event says so, and the session flies to its end."""
    end, records = run(tmp_path, agent_manifest("spam"), clock=patient_clock())
    assert end.outcome is Outcome.TIME_LIMIT, f"{end.reason} {end.facts}"
    assert end.counters["air_dropped"] == 1000
    assert sum(record.topic == TOPICS.status for record in records) == 500
    dropping = [record for record in records if b'"dropping"' in record.data]
    assert [TOPICS.status.encode() in record.data for record in dropping] == [True]


def test_what_flies_the_vehicle_is_always_recorded() -> None:
    """Two links: from the agent everything is recorded until the flood has an end of its own; to it, a share is."""
    records: list[Record] = []
    truth = TruthRecorder("vehicle_1", records.append)
    second = MAVLINK_TO_AGENT_BYTES.at_once // 2 + 1
    for moment in (0.0, 0.1):
        truth.keep_mavlink("onboard", "to_agent", b"x" * second)
        truth.keep_mavlink("gcs", "to_agent", b"x")
        truth.keep_mavlink("onboard", "from_agent", b"y" * (MAVLINK_FROM_AGENT_BYTES.at_once // 2))
        truth.write_mavlink(at(moment), at(moment))
    assert truth.flooded_link(at(0.1)) is None
    assert truth.unrecorded_bytes == 0, "0.1 s adds more than the two bytes"
    for _ in range(2):
        truth.keep_mavlink("onboard", "to_agent", b"x" * 1024 * 1024)
        truth.keep_mavlink("gcs", "to_agent", b"x")
        truth.keep_mavlink("gcs", "from_agent", b"z")
        truth.keep_mavlink("onboard", "from_agent", b"y" * 4096)
        truth.write_mavlink(at(0.1), at(0.1))
    assert truth.unrecorded_bytes == 2 * 1024 * 1024
    assert truth.flooded_link(at(0.1)) == "onboard"
    assert truth.flooded_link(at(1.0)) is None
    topics = [record.topic for record in records]
    assert topics.count("/mavlink/onboard/from_agent") == 4
    assert topics.count("/mavlink/gcs/to_agent") == 4
    assert topics.count("/mavlink/onboard/to_agent") == 2
    assert sum(b"dropping" in record.data for record in records) == 1


def test_the_page_states_the_limits() -> None:
    page = (Path(__file__).parents[2] / "docs" / "streams.md").read_text("utf-8")
    mib, kib = 1024 * 1024, 1024
    rows = (
        f"| samples of each topic | {TOPIC_SAMPLES.at_once} | {TOPIC_SAMPLES.each_s} |",
        f"| bytes of each topic | {TOPIC_BYTES.at_once // mib} MiB | {TOPIC_BYTES.each_s // kib} KiB |",
        f"| MAVLink from the agent, each link | {MAVLINK_FROM_AGENT_BYTES.at_once // mib} MiB | "
        f"{MAVLINK_FROM_AGENT_BYTES.each_s // kib} KiB |",
        f"| MAVLink to the agent, each link | {MAVLINK_TO_AGENT_BYTES.at_once // mib} MiB | "
        f"{MAVLINK_TO_AGENT_BYTES.each_s // kib} KiB |",
    )
    assert [row for row in rows if row not in page] == []
    assert f"{MAX_DROPPED_SAMPLES:,} samples or {MAX_DROPPED_BYTES // mib} MiB" in page
