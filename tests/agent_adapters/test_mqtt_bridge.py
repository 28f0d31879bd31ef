"""The bridge to agents that speak MQTT: what it mirrors, what it refuses, and brokers that fail."""

from __future__ import annotations

import gc
import json
import math
import re
import shutil
import socket
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from functools import partial
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any, cast

import pytest
from air_documents import valid
from embedded_broker import open_laboratory, until
from host_servers import server
from made_run import simspec
from mosquitto import PROGRAM, certificate, needs_mosquitto, open_mosquitto
from mqtt_flights import fly_manifest
from own_network import call_in_own_network
from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import MavlinkFrame, Tick
from agent_adapters.client._protocol import ack_line
from agent_adapters.mqtt.__main__ import _open_agent, _parser, _run
from agent_adapters.mqtt._bridge import MAX_ACK_BYTES, MAX_PAYLOAD_BYTES, AgentSide, Bridge, _newest
from agent_adapters.mqtt._broker import Account, BrokerAddress, broker_address, open_own_broker
from agent_adapters.mqtt._connection import Arrival, open_connection
from agent_adapters.mqtt._mavlink import MavlinkTranslator
from agent_adapters.mqtt._topics import topics_from_agent, topics_to_agent
from bench.cli._app import run
from bench.contracts import (
    MAX_AIR_LINE_BYTES,
    Ack,
    AgentManifest,
    MissionOrder,
    Outcome,
    Record,
    SessionResult,
    VehicleTopics,
    read_line,
)
from bench.errors import LinkLost, SetupError
from bench.simspec import PaceMode
from bench.simulation import air_topics
from bench.streams import Detection2DArray, String, decode

# amqtt leaves a connection open whose client says nothing, as the look at a service before the flight does.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
AGENT = Path(__file__).with_name("mqtt_agents.py")
STATUS = VehicleTopics("vehicle_1").status
NODE_AGENT = Path(__file__).parents[2] / "examples" / "mqtt" / "mqtt_agent.js"


@pytest.fixture(autouse=True)
def _collected() -> Iterator[None]:
    """What a broker leaves open is found here, where the filters above hold, and not in another test."""
    yield
    gc.collect()


def flown(
    folder: Path,
    port: int | None,
    *manner: str,
    options: tuple[str, ...] = (),
    command: tuple[str, ...] = ("{python}", str(AGENT)),
    home: Path | None = None,
    pace: PaceMode = "lockstep",
    **changes: Any,
) -> tuple[SessionResult, list[Record], str]:
    """A session of one second behind a bridge: how it ended, its records, and what bridge and agent printed.

    `port`: of a broker that the SimSpec lets in; None for one of the bridge's own. `options`: of the bridge. `command`: of
    the agent, whose manifest lies in `home` and flies at `pace`.
    """
    broker = [] if port is None else ["--broker", "service:bus"]
    bridge = ("{python}", "-m", "agent_adapters.mqtt", *broker, *options, "--")
    manifest = AgentManifest(name="tester", command=(*bridge, *command, *manner), air="tick", pace=(pace,))
    services = [] if port is None else [{"name": "bus", "host": "127.0.0.1", "port": port}]
    document = {
        "vehicle": {"model": "still"},
        "agent": {"manifest": "fake", "services": services},
        "mission": {"kind": "search_and_report", "time_limit_s": 1.0},
        # So long that no test meets one by a slow host.
        "budgets": {"wall_s": 3600.0, "reply_s": 600.0, "connect_s": 600.0},
        "pace": {"mode": pace, "max_late_share": 1.0},
    }
    spec = simspec(**{**document, **changes})
    # A network of the session's own: the bridge reaches itself over TCP.
    return call_in_own_network(folder, fly_manifest, manifest, spec, home or folder, folder / "scratch")


def use_of(output: str) -> dict[str, Any]:
    """The bridge's last line."""
    (line,) = (line for line in output.splitlines() if line.startswith("mqtt bridge: {"))
    use: dict[str, Any] = json.loads(line.removeprefix("mqtt bridge: "))
    return use


def address_of(port: int) -> BrokerAddress:
    return BrokerAddress("127.0.0.1", port, "bay", Account(), Account())


@pytest.mark.flight
def test_two_sessions_through_two_brokers_are_one_and_the_same(tmp_path: Path) -> None:
    """The agent gets all that the bench sends, in its order; its own words are recorded at its ticks, twice alike. The second
    broker is the bridge's own where this host has a mosquitto.
    """
    cameras: dict[str, Any] = {
        "options": ("--camera", "front", "--camera", "down"),
        "vehicle": {"model": "still", "more_cameras": [{"name": "down", "tilt_deg": 90.0}]},
        "perception": {"more_cameras": ["down"]},
    }
    with open_laboratory() as laboratory:
        laboratory.listen()
        end, records, output = flown(tmp_path / "first", laboratory.port, **cameras)
        until(lambda: any(topic.endswith("/bridge/end") for topic in laboratory.topics()))
        heard = list(laboratory.heard)
        second = flown(tmp_path / "second", None if PROGRAM else laboratory.port, **cameras)
    for ended, recorded_again, printed in ((end, records, output), second):
        assert ended.outcome is Outcome.TIME_LIMIT
        assert recorded_again == records
        assert use_of(printed)["ticks"] == 10
    statuses = [record.time.s for record in records if record.topic == STATUS]
    assert statuses == pytest.approx([0.1 * n for n in range(10)])
    # Under the session's prefix stand the names of the air network.
    prefix = next(m.topic.removesuffix("/bridge/ready") for m in heard if "ready" in m.topic)
    seen = Counter(m.topic.removeprefix(f"{prefix}/") for m in heard if m.topic.startswith(f"{prefix}/"))
    recorded = Counter(record.topic.lstrip("/") for record in records)
    down = ("camera/down/detections", "camera/down/camera_info")
    of_vehicle = [f"vehicle_1/{name}" for name in ("mission", "detections", "agent/status", *down)]
    for name in ("clock", "tf", *of_vehicle):
        assert seen[name] == recorded[name] > 0, name
    order = next(m.payload for m in heard if m.topic == f"{prefix}/vehicle_1/mission")
    assert valid(MissionOrder, order).time_limit_s == 1.0
    assert use_of(output)["to_agent"] == sum(
        count for name, count in seen.items() if not name.startswith("bridge/") and "agent" not in name
    )


@pytest.mark.flight
def test_an_agent_may_no_more_than_over_zenoh(tmp_path: Path) -> None:
    """Forged and unknown topics, text that is none, and what is too large go no further; what is counted is right."""
    with open_laboratory() as laboratory:
        end, records, output = flown(tmp_path, laboratory.port, "unruly")
    assert end.outcome is Outcome.TIME_LIMIT
    said = Counter(record.topic for record in records if "/agent/" in record.topic)
    # The tracks that are no document are the bench's to judge, as they are over Zenoh.
    assert said == {"/vehicle_1/agent/status": 10, "/vehicle_1/agent/tracks": 10}
    (mission,) = texts_of(records, "/vehicle_1/mission")
    assert "forged" not in mission
    assert use_of(output)["refused"] == 30
    for words in ("it is no UTF-8", "300000 bytes are more than", "the dialect common has no message"):
        assert words in output


class FakeTicks:
    """Keeps the acknowledgements as the bench gets them."""

    def __init__(self) -> None:
        self.lines: list[bytes] = []

    def ack(self, tick: Tick, topics: Any, links: Any, air: Any) -> None:
        self.lines.append(ack_line(tick.number, topics, links, air))


def test_what_does_not_fit_into_one_acknowledgement_goes_with_the_next() -> None:
    """Texts at random, long and with much to write out, then many short ones: every line is one that the bench takes."""
    random = Random(7)
    signs = ('"', "ü", "x", "\n", "\x01", "😀")
    texts = ["".join(random.choices(signs, k=random.choice((10, 30_000, 60_000)))) for _ in range(60)]
    texts += [str(number) for number in range(2500)]
    topic = "vehicle_1/agent/reports"
    agent, ticks = AgentSide(cast(Any, None), [topic], None), FakeTicks()
    bridge = Bridge(cast(Any, ticks), None, cast(Any, None), agent, {topic: f"/{topic}"})
    bridge._forward([Arrival(topic, text.encode()) for text in texts])
    # A text that no line takes is no JSON.
    assert bridge._forward_message(Arrival(topic, b"\1" * MAX_PAYLOAD_BYTES)).endswith(f"{MAX_ACK_BYTES}")
    assert bridge._forward_message(Arrival(topic, b'"' * MAX_PAYLOAD_BYTES)) == ""
    assert "bytes are more than" in bridge._forward_message(Arrival(topic, b"x" * (MAX_PAYLOAD_BYTES + 1)))
    for number in range(40):
        bridge._acknowledge(Tick(number, 0))
    assert max(map(len, ticks.lines)) <= MAX_AIR_LINE_BYTES
    acks = [read_line(line) for line in ticks.lines]
    messages = [message for ack in acks if isinstance(ack, Ack) for message in ack.air]
    assert [message.message for message in messages] == [*texts, '"' * MAX_PAYLOAD_BYTES]
    assert agent.refused == 0
    # As much as fits: two of these lines are more than one.
    full = [len(line) for line in ticks.lines[:3]]
    assert all(one + other > MAX_ACK_BYTES for one, other in pairwise(full))


@pytest.mark.flight
def test_in_real_time_messages_go_on_as_they_come(tmp_path: Path) -> None:
    """The agent has what is recorded, in ticks that wait for nobody, and learns of the end; its words are recorded."""
    with open_laboratory() as laboratory:
        laboratory.listen()
        end, records, output = flown(tmp_path, laboratory.port, pace="realtime")
        until(lambda: any(topic.endswith("/bridge/end") for topic in laboratory.topics()))
        heard = laboratory.heard
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    assert json.loads(texts_of(records, STATUS)[0])["phase"] == "searching"
    ticks = [message.payload for message in heard if message.topic.endswith("/bridge/tick")]
    assert [tick["number"] for tick in ticks] == list(range(len(ticks)))
    assert not any(tick["lockstep"] for tick in ticks)
    assert all(later["time_ns"] - tick["time_ns"] >= 100_000_000 for tick, later in pairwise(ticks))
    clocks = [message.payload["clock"] for message in heard if message.topic.endswith("/clock")]
    moments_ns = [clock["sec"] * 1_000_000_000 + clock["nanosec"] for clock in clocks]
    # Every step of 20 ms from the first: nothing is left out, whatever the host does.
    assert moments_ns == [number * 20_000_000 for number in range(len(moments_ns))]
    assert use_of(output)["ticks"] == len(ticks) > 0
    assert len(texts_of(records, "/vehicle_1/mission")) == 1


def texts_of(records: list[Record], topic: str) -> list[str]:
    return [decode(record.type_name, record.data).data for record in records if record.topic == topic]


def begin_lockstep(connection: socket.socket) -> None:
    """As the bench at the tick socket: hears a hello, and sends a tick that counts a topic."""
    connection.makefile().readline()
    tick = {"kind": "tick", "number": 0, "time_ns": 0, "topics": {"/clock": 1}}
    connection.sendall(f"{json.dumps(tick)}\n".encode())
    connection.recv(1)


def test_lockstep_without_the_mavlink_links_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with open_laboratory() as laboratory, server(begin_lockstep) as port:
        laboratory.say("bay/bridge/ready", '{"agent": "elsewhere"}', retain=True)
        bridge_is_refused(
            "--no-mavlink: lockstep counts the messages of all links",
            f"mqtt://127.0.0.1:{laboratory.port}/bay",
            {"REBAR_TICK": f"127.0.0.1:{port}"},
            monkeypatch,
        )


def test_another_air_network_than_the_tick_socket_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    words = "air: is not tick, and the bridge has the air network from the tick socket (write air: tick"
    both = {"REBAR_TICK": "127.0.0.1:9", "REBAR_ZENOH": "tcp/127.0.0.1:9"}
    bridge_is_refused(words, "mqtt://127.0.0.1:9", both, monkeypatch)
    command = [sys.executable, "-m", "agent_adapters.mqtt", "--broker", "mqtt://127.0.0.1:9"]
    environment = {"REBAR_VEHICLE": "vehicle_1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"mqtt bridge: {words}")


def bridge_is_refused(
    words: str, url: str, variables: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Started in this process, for an agent elsewhere."""
    for name in ("REBAR_TICK", "REBAR_ZENOH"):
        monkeypatch.delenv(name, raising=False)
    for name, value in ({"REBAR_VEHICLE": "vehicle_1"} | variables).items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SetupError, match=re.escape(words)):
        _run(_parser().parse_args(["--broker", url, "--no-mavlink"]))


def test_after_a_pause_the_newest_of_each_topic_go_on() -> None:
    """A hundred of each; what is rare is not pushed out by what is not."""
    air = [{"topic": f"/{number % 3}", "message": {"number": number}} for number in range(400)]
    rare = {"topic": "/rare", "message": {}}
    assert _newest([rare, *air]) == [rare, *air[100:]]
    assert _newest(air[:300]) == air[:300]
    assert _newest([]) == []


@pytest.mark.flight
def test_an_agent_that_ends(tmp_path: Path) -> None:
    """Behind the bridge it ends as it would without."""
    with open_laboratory() as laboratory:
        end, _, output = flown(tmp_path, laboratory.port, "exit")
    assert end.outcome is Outcome.AGENT_CRASHED
    assert "mqtt bridge: the agent ended with exit code 1" in end.reason
    assert use_of(output)["ticks"] == 5


@pytest.mark.flight
def test_a_broker_that_goes_away_in_flight_is_named(tmp_path: Path) -> None:
    """In lockstep nobody knows what it lost, so the session ends, and its reason says why."""
    with open_laboratory() as laboratory, ExitStack() as way:
        # A broker that is stopped may leave connections open; those of this way to it end with the way.
        port = way.enter_context(server(partial(carry, laboratory.port)))
        laboratory.listen()

        def leave() -> None:
            until(lambda: any(topic.endswith("/agent/status") for topic in laboratory.topics()))
            way.close()

        thread = threading.Thread(target=leave)
        thread.start()
        end, _, _ = flown(tmp_path, port, mission={"kind": "search_and_report", "time_limit_s": 600.0})
        thread.join()
    assert end.outcome is Outcome.AGENT_CRASHED
    assert "MQTT broker 127.0.0.1:" in end.reason
    assert "the connection is lost" in end.reason


def carry(port: int, connection: socket.socket) -> None:
    """Pass on all bytes between a connection and a server, in both directions."""
    with socket.create_connection(("127.0.0.1", port)) as far:
        threading.Thread(target=copy, args=(far, connection), daemon=True).start()
        copy(connection, far)


def copy(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(1 << 16):
            target.sendall(data)
        target.shutdown(socket.SHUT_WR)


def listen_and_say_nothing(connection: socket.socket) -> None:
    while connection.recv(1 << 16):
        pass


def test_brokers_that_do_not_answer() -> None:
    """Away and deaf are told apart; a broker that refuses has its own test below."""
    with server(lambda _: None) as gone:
        pass
    refuses(address_of(gone), f"127.0.0.1:{gone} does not answer: .*refused")
    with server(listen_and_say_nothing) as deaf:
        said = r"took the connection, and did not answer within 0\.3 s"
        refuses(address_of(deaf), said, patience_s=0.3)


def refuses(address: BrokerAddress, words: str, **options: Any) -> None:
    with pytest.raises(LinkLost, match=words), open_connection(address, ["a"], **options):
        pass


def test_a_restarted_broker_is_found_again() -> None:
    """In real time: what would have been sent meanwhile is counted, and what comes afterwards is heard."""
    with (
        open_laboratory() as laboratory,
        open_connection(address_of(laboratory.port), ["a", "b"], 60.0) as bridge,
    ):
        laboratory.say("bay/a", "1")
        assert [arrival.payload for arrival in bridge.take(60.0)] == [b"1"]
        laboratory.stop()
        until(lambda: bool(bridge.lost))
        assert not bridge.publish("x", "lost")
        with pytest.raises(LinkLost, match="the connection is lost"):
            bridge.check()
        laboratory.start()
        bridge.wait_for_return()
        assert bridge.publish("x", "goes out")
        laboratory.say("bay/b", "2")
        assert [(arrival.topic, arrival.payload) for arrival in bridge.take(60.0)] == [("b", b"2")]
        assert bridge.unsent == 1


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("service:other", "the SimSpec lets no service 'other' in"),
        ("http://broker", "no address of a broker"),
        ("mqtt://", "no address of a broker"),
        ("mqtt://a:secret@broker", "visible to all users"),
        ("mqtt://broker:none", "Port could not be cast"),
        ("mqtt://broker/a+b", "no topic to send to"),
        ("mqtt://broker/a?b=c", "query"),
        ("mqtt://::1", "an IPv6 address stands in brackets"),
    ],
)
def test_addresses_that_cannot_be_meant(url: str, words: str) -> None:
    with pytest.raises(SetupError, match=words):
        broker_address(url, None, None, {"REBAR_SERVICE_BUS": "127.0.0.1:5"})


def test_addresses_and_passwords(tmp_path: Path) -> None:
    """A service with and without a prefix, and TLS with a user; what the agent is given bears no password."""
    (tmp_path / "password").write_text("secret words\nanother line\n")
    variables = {"REBAR_SERVICE_BUS": "127.0.0.1:5", "REBAR_SERVICE_OTHER": "127.0.0.1:6"}
    first = broker_address("service:me@bus/bay-2/x", tmp_path / "password", None, variables)
    assert (first.host, first.port, first.prefix) == ("127.0.0.1", 5, "bay-2/x")
    assert first.agent == Account("me", "secret words")
    assert first.agent_url == "mqtt://me@127.0.0.1:5/bay-2/x"
    other, another = (broker_address("service:other", None, None, variables) for _ in range(2))
    assert other.port == 6
    assert other.prefix.startswith("rebar/")
    assert other.prefix != another.prefix
    secure = broker_address("mqtts://me@broker.lab", None, None, {})
    assert secure.agent_url.startswith("mqtts://me@broker.lab:8883/")
    for address in ("mqtt://[::1]:1884/bay", "mqtts://me@[fe80::1]:8884/bay"):
        assert broker_address(address, None, None, {}).agent_url == address
    with pytest.raises(SetupError, match="there is no such file"):
        broker_address("mqtt://broker", tmp_path / "none", None, {})
    with pytest.raises(SetupError, match="mqtt:// has no TLS"):
        broker_address("mqtt://broker", None, tmp_path / "password", {})


def test_a_missing_broker_names_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with (
        pytest.raises(SetupError, match=r"there is no program 'mosquitto'.*Debian"),
        open_own_broker(tmp_path, places=str(tmp_path)),
    ):
        pass


@needs_mosquitto
@pytest.mark.process
def test_a_mosquitto_by_tls_and_those_whom_it_or_the_bridge_refuses(tmp_path: Path) -> None:
    """Its certificate must be the one that is vouched for, and the password right; the agent learns both."""
    authority, key = certificate(tmp_path, "broker")
    stranger, _ = certificate(tmp_path, "stranger")
    right, wrong = tmp_path / "right", tmp_path / "wrong"
    right.write_text("secret\n")
    wrong.write_text("guessed\n")
    with open_mosquitto(tmp_path, {"rig": "secret"}, authority, key) as broker:
        url = f"mqtts://rig@localhost:{broker.port}/bay"
        address = broker_address(url, right, authority, {})
        with open_connection(address, ["#"]) as first, open_connection(address, ["b"]) as second:
            second.publish("a", "one")
            first.publish("b", "two")
            assert [arrival.payload for arrival in second.take(60.0)] == [b"two"]
            assert {arrival.payload for arrival in first.take(60.0)} <= {b"one", b"two"}
        for password, trusted, reason in (
            (right, stranger, "certificate verify failed"),
            (wrong, authority, "Not authorized"),
        ):
            refuses(broker_address(url, password, trusted, {}), reason)
        names = ("REBAR_MQTT", "REBAR_MQTT_PASSWORD", "REBAR_MQTT_CA")
        printed = tmp_path / "printed"
        code = (
            f"import os; open({str(printed)!r}, 'w').write(' '.join(os.environ[name] for name in {names!r}))"
        )
        with _open_agent(address, [sys.executable, "-c", code]) as process:
            assert process is not None
            process.wait()
        assert printed.read_text() == f"{url} secret {authority}"


@needs_mosquitto
@pytest.mark.process
def test_a_broker_of_ones_own_knows_bridge_and_agent_alone(tmp_path: Path) -> None:
    """Strangers are refused, and the agent's account may write what an agent may, and nothing of the bench's."""
    with open_own_broker(tmp_path) as address:
        stranger = BrokerAddress("127.0.0.1", address.port, "rebar", Account(), Account())
        agent = BrokerAddress("127.0.0.1", address.port, "rebar", address.agent, address.agent)
        wrong = BrokerAddress("127.0.0.1", address.port, "rebar", Account("agent", "guessed"), address.agent)
        for refused in (stranger, wrong):
            refuses(refused, "it refuses the bridge: Not authorized")
        with open_connection(address, ["#"]) as bridge:
            for forged in ("vehicle_1/mission", "bridge/tick", "mavlink/onboard/to_agent"):
                # This mosquitto closes the connection of who writes where it may not; others only drop it.
                with open_connection(agent, ["a"]) as client:
                    client.publish(forged, "forged")
            with open_connection(agent, ["#"]) as client:
                client.publish("vehicle_1/agent/status", "true")
                bridge.publish("vehicle_1/mission", "true")
                heard = bridge.take(60.0)
                while len(heard) < 2:
                    heard += bridge.take(60.0)
                assert {arrival.payload for arrival in heard} == {b"true"}
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", address.port))


@needs_mosquitto
@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
@pytest.mark.skipif(
    not (NODE_AGENT.parent / "node_modules" / "mqtt").is_dir(),
    reason=f"the npm package mqtt is not installed: npm install --no-package-lock in {NODE_AGENT.parent}",
)
@pytest.mark.flight
def test_the_agent_in_node_answers_every_tick(tmp_path: Path) -> None:
    """The example, at its first steps: what it says is recorded at the ticks that it answers."""
    command = ("node", "{folder}/mqtt_agent.js")
    end, records, output = flown(tmp_path, None, command=command, home=NODE_AGENT.parent)
    assert end.outcome is Outcome.TIME_LIMIT
    use = use_of(output)
    assert (use["ticks"], use["refused"], use["unsent"]) == (10, 0, 0)
    assert [record.time.s for record in records if record.topic == STATUS] == [0.0]


def test_the_page_has_every_topic_with_its_type() -> None:
    """What the bridge mirrors, no more and no less, under the type that `rebar schema` knows."""
    page = (Path(__file__).parents[2] / "docs" / "mqtt-agents.md").read_text()
    table = page.partition("<!-- topics -->")[2].partition("<!-- end -->")[0]
    rows = [re.findall(r"`([^`]+)`", line) for line in table.splitlines()[3:]]
    stated = {topic: names[-1] for names in rows for topic in names if "/msg/" not in topic}
    kinds = {topic.name: topic.kind for topic in air_topics(simspec(vehicle={"model": "still"}))}
    for topic in topics_to_agent("{v}", ("{c}",), pictures=True):
        name = stated.pop(topic.lstrip("/"))
        kind = kinds.get(topic.replace("{v}", "vehicle_1").replace("{c}", "front"), Detection2DArray)
        assert name == kind.TYPE or (kind is String and "/msg/" not in name)
    mirrored = {topic for topic in stated if topic.startswith("{v}")}
    assert mirrored - {"{v}"} == topics_from_agent("{v}").keys()
    for name in {names[-1] for names in rows}:
        assert run(["schema", name]) == 0


# MAVLink as JSON, against pymavlink's own classes.

MESSAGES = [
    mavlink.MAVLink_heartbeat_message(2, 12, 81, 65536, 3, 3),
    mavlink.MAVLink_command_long_message(1, 1, 22, 0, 0.0, 0.5, 1.0, math.nan, 47.5, 8.25, 30.0),
    mavlink.MAVLink_statustext_message(6, b"Takeoff detected"),
    mavlink.MAVLink_set_actuator_control_target_message(
        7, 0, 1, 1, [0.5, -0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.25]
    ),
]


def frame_of(message: Any, system: int = 7, component: int = 3) -> MavlinkFrame:
    data = bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component)))
    return MavlinkFrame(message.get_msgId(), system, component, data)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: str(message.msgname))
def test_both_ways_give_the_same_frame(message: Any) -> None:
    """Numbers, NaN, text and arrays; sender included."""
    document = MavlinkTranslator().to_json(frame_of(message))
    assert document is not None
    text = json.dumps(document, allow_nan=False)
    assert (document["system"], document["component"], document["name"]) == (7, 3, message.msgname)
    assert MavlinkTranslator().frame_of(text) == frame_of(message).data


def test_fields_that_are_left_out_are_zero_and_null_is_nan() -> None:
    text = '{"name": "COMMAND_LONG", "fields": {"command": 22, "param4": null}}'
    frame = MavlinkTranslator().frame_of(text)
    assert isinstance(frame, bytes)
    message = mavlink.MAVLink(None).decode(bytearray(frame))
    assert (message.command, message.param1, message.target_system) == (22, 0.0, 0)
    assert math.isnan(message.param4)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (246, 191)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("no JSON", "no mavlink-message"),
        ('{"name": "HEARTBEAT", "more": 1}', "no mavlink-message"),
        ('{"name": "HEART"}', "no message 'HEART'"),
        ('{"name": "HEARTBEAT", "fields": {"kind": 1}}', "no field 'kind'"),
        ('{"name": "HEARTBEAT", "fields": {"type": 256}}', "HEARTBEAT: "),
        ('{"name": "HEARTBEAT", "fields": {"type": "two"}}', "HEARTBEAT: "),
        ('{"name": "SET_ACTUATOR_CONTROL_TARGET", "fields": {"controls": [1.0]}}', "TARGET: "),
    ],
)
def test_what_is_no_message_says_why(text: str, words: str) -> None:
    """And the next message goes out all the same."""
    translator = MavlinkTranslator()
    answer = translator.frame_of(text)
    assert isinstance(answer, str)
    assert words in answer
    assert isinstance(translator.frame_of('{"name": "HEARTBEAT"}'), bytes)


def test_frames_of_other_dialects_and_damaged_ones_are_counted() -> None:
    translator = MavlinkTranslator()
    good = frame_of(MESSAGES[0])
    damaged = MavlinkFrame(0, 7, 3, good.data[:-1] + bytes([good.data[-1] ^ 1]))
    assert translator.to_json(damaged) is None
    assert translator.to_json(MavlinkFrame(150_000, 7, 3, good.data)) is None
    assert translator.unknown == 2
    assert translator.to_json(good) is not None
