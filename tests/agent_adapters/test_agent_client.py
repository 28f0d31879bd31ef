"""The client library with a fake bench: ticks, links, samples and malformed lines."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import (
    AgentEnvironment,
    MavlinkLink,
    Tick,
    Wanted,
    open_bench,
    open_link,
    open_tick_line,
    read_environment,
)
from bench.contracts import CLOCK, SimTime
from bench.errors import LinkLost, SetupError
from bench.streams import AirPlan, Clock, Router, String, Time, open_router

ORDERS, REPORTS = "/vehicle_1/mission", "/vehicle_1/agent/reports"
STRING = "std_msgs/msg/String"
TICKLESS = AgentEnvironment("vehicle_1", {}, None, "", "", 1, None, {}, 0)


@contextmanager
def bench_side(play: Callable[[socket.socket], None]) -> Iterator[tuple[str, int]]:
    """A tick socket whose one connection is played by `play` in a thread; what it raises fails the test."""
    raised: list[BaseException] = []

    def serve() -> None:
        try:
            peer, _ = listener.accept()
            with peer:
                peer.settimeout(10.0)
                play(peer)
        except BaseException as error:
            raised.append(error)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(10.0)
        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()[:2]
        thread.join()
    assert raised == []


def send_line(peer: socket.socket, **message: object) -> None:
    peer.sendall(json.dumps(message).encode() + b"\n")


def receive_line(peer: socket.socket) -> dict[str, object]:
    line = b""
    while not line.endswith(b"\n"):
        data = peer.recv(1)
        assert data, "the agent closed"
        line += data
    return dict(json.loads(line))


def heartbeats(count: int) -> list[bytes]:
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    message = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 29, 0, mavlink.MAV_STATE_STANDBY, 3
    )
    frames = []
    for number in range(count):
        mav.seq = number
        frames.append(bytes(message.pack(mav)))
    return frames


@contextmanager
def open_udp_link() -> Iterator[tuple[MavlinkLink, socket.socket, socket.socket]]:
    """A link that listens, and two sockets that send there."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        address = probe.getsockname()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
        open_link("onboard", f"udpin:127.0.0.1:{address[1]}") as link,
    ):
        one.connect(address)
        other.connect(address)
        yield link, one, other


def test_the_tick_protocol_follows_the_contract() -> None:
    """Hello, a tick, its ack, the end: word for word as bench/contracts says."""

    def play(peer: socket.socket) -> None:
        assert receive_line(peer) == {
            "kind": "hello", "protocol": 1, "agent": "probe", "subscribes": [], "secret": "of this session"
        }  # fmt: skip
        send_line(peer, kind="tick", number=0, time_ns=0, topics={"/clock": 1}, links={})
        assert receive_line(peer) == {"kind": "ack", "number": 0, "topics": {}, "links": {}}
        send_line(peer, kind="tick", number=1, time_ns=100_000_000)
        assert receive_line(peer)["number"] == 1
        send_line(peer, kind="end", reason="time is up")

    with bench_side(play) as address:
        environment = replace(TICKLESS, tick=address, tick_secret="of this session")
        with open_bench("probe", environment) as bench:
            times = [moment.time for moment in bench.moments("probe")]
    assert times == [SimTime(0), SimTime(100_000_000)]
    assert bench.ended == "time is up"


def test_malformed_lines_are_counted_and_ignored() -> None:
    """Noise, an unknown kind, a tick with a wrong field, a line beyond all bounds: none is a tick, none an error."""

    def play(peer: socket.socket) -> None:
        peer.sendall(b'good morning\n\n{"kind":"tock"}\n{"kind":"tick","number":-1,"time_ns":0}\n\xff\xfe\n')
        peer.sendall(b'{"kind":"tick","number":7,"time_ns":5,"topics":{"a":' + b"1" * 70_000 + b"}}\n")
        send_line(peer, kind="tick", number=1, time_ns=9)

    with bench_side(play) as address, open_tick_line(address) as line:
        tick = line.next()
        assert isinstance(tick, Tick)
        assert tick.time_ns == 9
        assert line.malformed >= 6


def test_a_closed_tick_socket_raises_link_lost() -> None:
    """A clock that closes without an end, and one that never was, are LinkLost with a sentence."""
    with (
        bench_side(lambda peer: None) as address,
        open_tick_line(address) as line,
        pytest.raises(LinkLost, match="closed without"),
    ):
        line.next()
    with pytest.raises(LinkLost, match="does not answer"), open_tick_line(address):
        pass


def test_udp_frames_of_the_first_sender_are_counted_whole_and_handed_over_once() -> None:
    """Two frames in a datagram and one in another are three messages; noise between is none. The other sender is not the
    vehicle.
    """
    with open_udp_link() as (link, vehicle, stranger):
        assert not link.send(b"nobody there yet")
        frames = heartbeats(3)
        vehicle.send(frames[0] + b"noise!" + frames[1])
        link.wait(2, timeout_s=5.0)
        stranger.send(frames[0])
        vehicle.send(frames[2])
        link.wait(3, timeout_s=5.0)
        link.poll()
        assert [(frame.message_id, frame.system, frame.data) for frame in link.take()] == [
            (mavlink.MAVLINK_MSG_ID_HEARTBEAT, 1, frame_bytes) for frame_bytes in frames
        ]
        assert link.take() == []
        assert (link.received, link.garbage_bytes) == (3, 6)
        assert link.send(b"answer")
        assert vehicle.recv(100) == b"answer"
        assert link.sent == 1


def test_missing_messages_raise_link_lost_after_the_timeout() -> None:
    with open_link("onboard", "udpout:127.0.0.1:9") as link, pytest.raises(LinkLost, match="0 of 4 messages"):
        link.wait(4, timeout_s=0.05)


class Trickle:
    """A wire that brings its bytes in pieces of a few."""

    def __init__(self, data: bytes, step: int) -> None:
        self._pieces = [data[at : at + step] for at in range(0, len(data), step)]

    def receive(self, timeout_s: float) -> bytes | None:
        return self._pieces.pop(0) if self._pieces else None

    def send(self, data: bytes) -> bool:
        return True


@pytest.mark.parametrize("step", [1, 3, 7, 11, 200])
def test_frames_are_cut_wherever_a_stream_breaks(step: int) -> None:
    """Of a byte stream in any pieces the same frames come out, MAVLink 1 and 2 mixed."""
    mav = mavlink.MAVLink(None, srcSystem=9, srcComponent=3)
    first = bytes(mavlink.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0).pack(mav, force_mavlink1=True))
    link = MavlinkLink("onboard", Trickle(first + b"\x00" + b"".join(heartbeats(2)), step))
    link.poll()
    assert [(frame.message_id, frame.system) for frame in link.take()] == [
        (mavlink.MAVLINK_MSG_ID_ATTITUDE, 9),
        (mavlink.MAVLINK_MSG_ID_HEARTBEAT, 1),
        (mavlink.MAVLINK_MSG_ID_HEARTBEAT, 1),
    ]


def test_tcp_end_of_stream_is_lost() -> None:
    """A TCP link hands over what came and then says that the autopilot closed."""
    with (
        bench_side(lambda peer: peer.sendall(heartbeats(1)[0])) as (host, port),
        open_link("gcs", f"tcp:{host}:{port}") as link,
    ):
        link.wait(1, timeout_s=5.0)
        with pytest.raises(LinkLost, match="closed"):
            link.wait(2, timeout_s=5.0)


@pytest.mark.parametrize("text", ["serial:/dev/ttyACM0", "udpin:14540", "tcp:host:port", ""])
def test_an_invalid_connection_string_is_a_setup_error(text: str) -> None:
    with pytest.raises(SetupError, match="is not a MAVLink connection string"), open_link("onboard", text):
        pass


def test_the_environment_is_read_and_every_fault_named() -> None:
    """A complete environment becomes values; a bad one names each variable."""
    valid = {
        "REBAR_VEHICLE": "v", "REBAR_MAVLINK": "udpin:127.0.0.1:1", "REBAR_TICK": "127.0.0.1:4000", "REBAR_SEED": "7",
        "REBAR_OPTIONS": '{"a": 1}', "ROS_DOMAIN_ID": "3",
    }  # fmt: skip
    read = read_environment(valid)
    assert (read.tick, read.seed, read.domain, dict(read.options)) == (("127.0.0.1", 4000), 7, 3, {"a": 1})
    assert read_environment(valid | {"REBAR_TICK_SECRET": "s"}).tick_secret == "s"
    assert read_environment(valid | {"EXTRA": "tcp:h:1"}, {"extra": "EXTRA"}).mavlink == {"extra": "tcp:h:1"}
    wrong = {"REBAR_TICK": "4000", "REBAR_SEED": "x", "REBAR_OPTIONS": "[]", "ROS_DOMAIN_ID": ""}
    with pytest.raises(SetupError) as caught:
        read_environment(wrong)
    assert len(caught.value.faults) == 6


@contextmanager
def open_air() -> Iterator[tuple[Router, AgentEnvironment]]:
    plan = AirPlan(1, agent_reads=((ORDERS, STRING), (CLOCK, Clock.TYPE)), agent_writes=((REPORTS, STRING),))
    with open_router(plan) as router:
        access = router.access
        credentials: dict[str, Any] = {"zenoh_user": access.user, "zenoh_password": access.password}
        yield router, replace(TICKLESS, zenoh=access.locator, **credentials)


WANTED = (Wanted(ORDERS, String, latched=True, depth=4), Wanted(CLOCK, Clock))


def test_a_moment_holds_exactly_the_samples_of_its_tick() -> None:
    """Latched and live samples come by name of topic and in order, and what is published is counted."""
    with open_air() as (router, environment):
        node = router.node("bench")
        orders, clock = node.latched(ORDERS, String, depth=4), node.publisher(CLOCK, Clock)
        reports = node.subscribe(REPORTS, String)
        orders.put(String("before the agent came"))

        def play(peer: socket.socket) -> None:
            assert receive_line(peer)["subscribes"] == [CLOCK, ORDERS]
            while not clock.matched:
                threading.Event().wait(0.001)
            for number in range(3):
                clock.put(Clock(Time.of(number * 10**8)))
                if number == 1:
                    orders.put(String("in flight"))
                topics = {CLOCK: clock.sequence, ORDERS: orders.sequence}
                send_line(peer, kind="tick", number=number, time_ns=number * 10**8, topics=topics)
                ack = receive_line(peer)
                assert ack["topics"] == {REPORTS: number + 1}
                assert reports.wait(number + 1, 5.0)
            send_line(peer, kind="end")

        taken = []
        with (
            bench_side(play) as address,
            open_bench("probe", replace(environment, tick=address), WANTED) as bench,
        ):
            for moment in bench.moments("probe"):
                taken.append([(sample.topic, sample.sequence) for sample in moment.samples])
                bench.publish(REPORTS, f"at {moment.time.ns}")
        assert taken == [[(CLOCK, 1), (ORDERS, 1)], [(CLOCK, 2), (ORDERS, 2)], [(CLOCK, 3)]]
        assert [sample.message().data for sample in reports.take()] == [
            "at 0",
            "at 100000000",
            "at 200000000",
        ]


def test_without_ticks_time_comes_from_the_clock_topic() -> None:
    """In the realtime pace there is no moment before the first /clock, and then time is what it says."""
    with open_air() as (router, environment):
        clock = router.node("bench").publisher(CLOCK, Clock)
        with open_bench("probe", environment, WANTED) as bench:
            while not clock.matched:
                threading.Event().wait(0.001)
            clock.put(Clock(Time.of(5 * 10**9)))
            moments = bench.moments("probe", tick_s=0.001)
            first = next(moments)
            assert first.time == SimTime(5 * 10**9)
            clock.put(Clock(Time.of(6 * 10**9)))
            assert next(moment for moment in moments if moment.time > first.time).time == SimTime(6 * 10**9)


def test_an_agent_without_zenoh_may_not_subscribe() -> None:
    """A MAVLink-only agent that asks for a topic is told which line of its manifest to change."""
    with pytest.raises(SetupError, match="REBAR_ZENOH"), open_bench("probe", TICKLESS, WANTED):
        pass
