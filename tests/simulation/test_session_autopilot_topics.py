"""Agents fly by the topics of a PX4, or by topics and services of an ArduPilot: in lockstep twice alike, and what of them is
wrong is told.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pydantic import ValidationError
from test_session import run, session_simspec

from bench.agents import load_manifest
from bench.contracts import (
    AgentManifest,
    CompanionSample,
    Outcome,
    Record,
    SessionResult,
    SimTime,
    Tap,
    UnmatchedTopics,
)
from bench.recording import open_recording
from bench.simspec import AgentSpec, Home, Mission, Pace, SimSpec, VehicleSpec
from bench.simulation import session_faults
from bench.simulation._air_network import AirNetwork, open_air_network
from bench.simulation._companion_topics import Companion
from bench.simulation._stop_session import StopSession
from bench.streams import (
    AP_FROM_AGENT,
    AP_SERVICES,
    PX4_FROM_AGENT,
    PX4_TO_AGENT,
    RosMessage,
    RosNode,
    String,
    ap_message,
    data_key,
    encode,
    open_client,
    px4_message,
    px4_names,
    type_hash,
)

COMPANION = Path(__file__).with_name("px4_companion.py")
AP_COMPANION = COMPANION.with_name("ap_companion.py")
AP_RELEASE = "2025-12"


def manifest(*arguments: str, program: Path = COMPANION, **switch: Any) -> AgentManifest:
    """Of a companion of PX4 1.17 unless a switch says another one."""
    return AgentManifest(
        name="companion",
        command=("{python}", str(program), *arguments),
        pace=("lockstep", "warp", "realtime"),
        mavlink=(),
        isolation="none",
        **(switch or {"px4_msgs": "1.17"}),
    )


def ap_manifest(*arguments: str) -> AgentManifest:
    return manifest(*arguments, program=AP_COMPANION, ap_dds=AP_RELEASE)


def spec(time_limit_s: float = 90.0, autopilot: str = "px4", model: str = "x500", **pace: object) -> SimSpec:
    return session_simspec(
        vehicle=VehicleSpec(model=model, autopilot=autopilot, home=Home(east_m=5, north_m=5)),
        mission=Mission(time_limit_s=time_limit_s),
        agent=AgentSpec(manifest="companion"),
        pace=Pace.model_validate({"mode": "lockstep", "tick_s": 0.1, **pace}),
    )


AP_SPEC = spec(autopilot="ardupilot")


def fly(folder: Path, agent: AgentManifest, situation: SimSpec) -> tuple[SessionResult, list[Record], str]:
    end, records = run(folder, agent, situation)
    log = folder / "agent.log"
    return end, records, log.read_text() if log.exists() else ""


@contextmanager
def stack(
    situation: SimSpec | None = None, tap: Tap = lambda record: None, **switch: str | None
) -> Iterator[tuple[AirNetwork, RosNode]]:
    """An air network and a node of an agent's on it."""
    with (
        open_air_network(situation or spec(), tap, zenoh=True, **switch) as air,  # type: ignore[arg-type]
        open_client(air.access, "stack") as node,  # type: ignore[arg-type]  # there is a router
    ):
        yield air, node


@contextmanager
def tokens_of(air: AirNetwork) -> Iterator[list[str]]:
    """What anybody with the agent's credentials sees of the ROS graph."""
    tokens: list[str] = []
    assert air.access is not None
    with open_client(air.access, "viewer") as node:
        watch = node._session.liveliness().declare_subscriber(
            f"@ros2_lv/{air.access.domain}/**",
            lambda sample: tokens.append(str(sample.key_expr)),
            history=True,
        )
        yield tokens
        watch.undeclare()  # type: ignore[no-untyped-call]


def until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.001)


def test_the_logic_of_px4_ros_coms_example_a_square_and_a_landing_are_flown(tmp_path: Path) -> None:
    """By a program with Zenoh and the layouts of px4_msgs alone. It arms, takes off, holds, flies corners, lands. Both
    directions are in the recording, with schemas. That flights by topics are alike, an external mode shows below.
    """
    end, records, said = fly(tmp_path / "a", manifest(), spec())
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    assert said.splitlines() == [
        *("at 0 0 -5", "at 5 0 -5", "at 5 5 -5", "at 0 5 -5", "at 0 0 -5"),
        "acks (176, 0) (400, 0) (21, 0)",
    ]
    messages = decoded(tmp_path, records)
    setpoints = messages["/fmu/in/trajectory_setpoint", "px4_msgs/msg/TrajectorySetpoint"]
    assert list(setpoints[0].position) == [0.0, 0.0, -5.0]
    states = messages["/fmu/out/vehicle_status", "px4_msgs/msg/VehicleStatus"]
    assert (14, 2) in {(status.nav_state, status.arming_state) for status in states}
    # Of 1.17 and not of 1.18.
    assert hasattr(states[0], "failure_detector_status")


def test_a_companion_of_ardupilot_flies_by_topics_and_services_twice_alike(tmp_path: Path) -> None:
    """By a program with Zenoh and the layouts alone; a takeoff that ArduPilot refuses is answered too. Both directions are
    in the recording, with schemas.
    """
    flights = [fly(tmp_path / name, ap_manifest("early"), AP_SPEC) for name in ("a", "b")]
    end, records, said = flights[0]
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    assert said.splitlines() == [
        "/ap/experimental/takeoff b'\\x00'",
        "/ap/prearm_check b'\\x01\\x00\\x00\\x00\\x13\\x00\\x00\\x00Vehicle is Armable\\x00'",
        "/ap/mode_switch b'\\x01\\x04'",
        "/ap/arm_motors b'\\x01'",
        "/ap/experimental/takeoff b'\\x01'",
        *("at 7 -3 7", "at 6 -2 7", "at 0 0 8"),
        "/ap/mode_switch b'\\x01\\t'",
        "armed, mode, flying False 9 False",
    ]
    assert flights[1][1:] == (records, said)
    messages = decoded(tmp_path, records)
    asked = messages["/ap/mode_switch", "ardupilot_msgs/srv/ModeSwitch_Request"]
    answers = messages["/ap/mode_switch", "ardupilot_msgs/srv/ModeSwitch_Response"]
    assert [request.mode for request in asked] == [answer.curr_mode for answer in answers] == [4, 9]
    velocities = messages["/ap/cmd_vel", "geometry_msgs/msg/TwistStamped"]
    assert {velocity.header.frame_id for velocity in velocities} == {"map", "base_link"}
    assert velocities[0].twist.linear.x == 2.0
    states = messages["/ap/status", "ardupilot_msgs/msg/Status"]
    assert {(state.armed, state.mode) for state in states} >= {(False, 4), (True, 4), (True, 9), (False, 9)}


def test_a_companion_that_falls_silent_is_brought_home_by_the_failsafe(tmp_path: Path) -> None:
    """It sees that offboard (14) is asked for and a return (5) flown."""
    end, records, said = fly(tmp_path, manifest("stop"), spec(240.0))
    assert "asked and flown 14 5 failsafe True" in said
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    assert any(record.topic == "/fmu/out/vehicle_status" for record in records)


def decoded(folder: Path, records: list[Record]) -> dict[tuple[str, str], list[Any]]:
    """Messages by topic and type, as a reader of others decodes them; equal flights are equal files."""
    files = []
    for name in ("a.mcap", "b.mcap"):
        with open_recording(folder / name, simspec=spec(), versions={}) as recorder:
            for record in records:
                recorder(record)
        files.append((folder / name).read_bytes())
    assert files[0] == files[1]
    messages: dict[tuple[str, str], list[Any]] = {}
    with (folder / "a.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, _, message in reader.iter_decoded_messages():
            messages.setdefault((channel.topic, schema.name if schema else ""), []).append(message)
    return messages


NO_PX4 = (manifest(), "has no topics of PX4", "leave px4_msgs out")
NO_AP = (ap_manifest(), "has no topics of ArduPilot", "(autopilot: ardupilot), or leave ap_dds out")


@pytest.mark.parametrize(
    ("model", "autopilot", "agent", "words", "remedy"),
    [
        ("x500", "ardupilot", *NO_PX4),
        ("still", "px4", *NO_PX4),
        ("x500", "px4", *NO_AP),
        ("still", "ardupilot", *NO_AP),
    ],
)
def test_a_vehicle_without_an_autopilots_topics_is_refused_before_takeoff(
    tmp_path: Path, model: str, autopilot: str, agent: AgentManifest, words: str, remedy: str
) -> None:
    situation = spec(model=model, autopilot=autopilot)
    assert words in " ".join(map(str, session_faults(situation, agent)))
    end, _, _ = fly(tmp_path, agent, situation)
    assert end.outcome is Outcome.SETUP_INVALID
    assert remedy in end.reason


def test_a_manifest_that_says_both_switches_fits_no_vehicle() -> None:
    both = manifest(px4_msgs="1.17", ap_dds=AP_RELEASE)
    for autopilot, missing in (("px4", "ArduPilot"), ("ardupilot", "PX4")):
        faults = " ".join(map(str, session_faults(spec(autopilot=autopilot), both)))
        assert f"has no topics of {missing}" in faults
        assert faults.count("has no topics of") == 1


def test_the_manifest_takes_a_release_that_nobody_quoted() -> None:
    assert manifest(px4_msgs=1.18).px4_msgs == "1.18"
    for switch in ("px4_msgs", "ap_dds"):
        assert switch not in AgentManifest(name="a", command=("b",)).model_dump()


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"px4_msgs": "1.15"}, r"'1\.16', '1\.17' or '1\.18'"),
        ({"px4_msgs": "1.17", "air": "tick"}, "come over Zenoh alone"),
        ({"ap_dds": "4.6"}, "2025-12"),
        ({"ap_dds": AP_RELEASE, "air": "tick"}, "ap_dds: ArduPilot's topics come over Zenoh alone"),
        ({"ap_dds": AP_RELEASE, "zenoh": False}, "ap_dds: ArduPilot's topics come over Zenoh alone"),
    ],
)
def test_releases_that_the_bench_does_not_know_and_other_networks_are_refused(
    fields: dict[str, object], words: str
) -> None:
    with pytest.raises(ValidationError, match=words):
        AgentManifest.model_validate({"name": "a", "command": ["b"], **fields})


def unmatched_of(air: AirNetwork, count: int) -> tuple[str, ...]:
    until(lambda: len(air.unmatched) >= count)
    return air.unmatched


def test_what_an_agent_gets_wrong_is_told_with_what_it_meant() -> None:
    """Another release's hash, an unknown topic, the wrong direction, another type; what is right is not told."""
    with stack(px4_msgs="1.17") as (air, node):
        node.subscribe("/fmu/out/vehicle_odometry", px4_message("VehicleOdometry", "1.18"))
        node.subscribe("/fmu/out/vehicle_status", px4_message("VehicleStatus", "1.18"))
        node.publisher("/fmu/in/vehicle_attitude_setpoint", px4_message("VehicleAttitudeSetpoint", "1.16"))
        node.publisher("/fmu/in/trajectory_setpoints", px4_message("TrajectorySetpoint", "1.17"))
        node.publisher("/fmu/out/vehicle_attitude", px4_message("VehicleAttitude", "1.17"))
        node.subscribe("/fmu/out/battery_status", String)
        node.subscribe("/vehicle_1/nothing", String)
        node.subscribe("/fmu/out/vehicle_local_position_v1", px4_message("VehicleLocalPosition", "1.17"))
        node.subscribe("/fmu/out/vehicle_status_v4", px4_message("VehicleStatus", "1.18"))
        node.publisher("/fmu/in/setpoint_config", px4_message("SetpointConfig", "1.18"))
        registration = px4_message("RegisterExtComponentRequest", "1.18")
        node.publisher("/fmu/in/register_ext_component_request", registration)
        texts = {text.split(" /fmu")[1].split()[0].strip(","): text for text in unmatched_of(air, 8)}
    assert sorted(texts) == [
        *("/in/register_ext_component_request", "/in/setpoint_config", "/in/trajectory_setpoints"),
        *("/in/vehicle_attitude_setpoint", "/out/battery_status", "/out/vehicle_attitude"),
        *("/out/vehicle_status", "/out/vehicle_status_v4"),
    ]
    of_another_release = 'a topic of px4_msgs 1.18; the manifest says px4_msgs: "1.17"'
    for topic in ("/in/setpoint_config", "/out/vehicle_status_v4"):
        assert texts[topic].endswith(of_another_release)
    assert "in px4_msgs 1.18 and main;" in texts["/in/register_ext_component_request"]
    status = texts["/out/vehicle_status"]
    assert "subscribes to /fmu/out/vehicle_status with RIHS01_573d6f1a" in status
    assert (
        'in px4_msgs 1.18 and main; the manifest says px4_msgs: "1.17", whose hash is RIHS01_828bddbb'
        in status
    )
    assert "publishes /fmu/in/vehicle_attitude_setpoint" in texts["/in/vehicle_attitude_setpoint"]
    assert "in px4_msgs 1.16;" in texts["/in/vehicle_attitude_setpoint"]
    assert texts["/in/trajectory_setpoints"].endswith("the nearest is /fmu/in/trajectory_setpoint")
    assert texts["/out/vehicle_attitude"].endswith("which it may only read")
    assert texts["/out/battery_status"].endswith("its type is px4_msgs/msg/BatteryStatus")


def test_what_an_agent_gets_wrong_of_ardupilots_topics_is_told_with_what_it_meant() -> None:
    """Another type, an unknown topic, the wrong direction, a service as a topic; what is right is not told."""
    with stack(AP_SPEC, ap_dds=AP_RELEASE) as (air, node):
        node.subscribe("/ap/pose/filtered", ap_message(AP_FROM_AGENT["/ap/cmd_vel"]))
        node.subscribe("/ap/status", ap_message("ardupilot_msgs/msg/Status"))
        node.publisher("/ap/cmd_vels", ap_message("geometry_msgs/msg/TwistStamped"))
        node.publisher("/ap/imu/experimental/data", ap_message("sensor_msgs/msg/Imu"))
        node.subscribe("/ap/arm_motors", String)
        node.subscribe("/ap/rc", String)
        node.subscribe("/vehicle_1/nothing", String)
        texts = {text.split(" /ap")[1].split()[0].strip(","): text for text in unmatched_of(air, 5)}
    assert sorted(texts) == ["/arm_motors", "/cmd_vels", "/imu/experimental/data", "/pose/filtered", "/rc"]
    assert texts["/pose/filtered"].endswith("; its type is geometry_msgs/msg/PoseStamped")
    assert texts["/cmd_vels"].endswith("which this bench does not have; the nearest is /ap/cmd_vel")
    assert texts["/imu/experimental/data"].endswith("which it may only read")
    assert texts["/arm_motors"].endswith("which it may only call")
    assert texts["/rc"].startswith("the agent subscribes to /ap/rc, which this bench does not have; ")


def test_another_hash_and_a_service_of_no_session_are_told() -> None:
    """By tokens of a client that calls a service, as ROS 2 announces it."""
    good = ap_message("ardupilot_msgs/srv/ArmMotors")
    with stack(AP_SPEC, ap_dds=AP_RELEASE) as (air, node):
        session: Any = node._session
        head = f"@ros2_lv/1/{session.zid()}/0"
        tokens = [
            f"{head}/{number}/SC/%/%/stack/%ap%{name}/ardupilot_msgs::srv::dds_::ArmMotors_/{hashed}/::,10:,:,:,,"
            for number, name, hashed in (
                (7, "arm_motors", "RIHS01_" + "0" * 64),
                (8, "arm_motor", "RIHS01_" + "1" * 64),
                (9, "cmd_vel", "RIHS01_" + "2" * 64),
            )
        ]
        held = [session.liveliness().declare_token(token) for token in tokens]
        texts = unmatched_of(air, 3)
        assert held
    assert [text.split(" with RIHS")[0].split(", which")[0] for text in texts] == [
        "the agent calls /ap/arm_motor",
        "the agent calls /ap/arm_motors",
        "the agent calls /ap/cmd_vel",
    ]
    assert texts[0].endswith("the nearest is /ap/arm_motors")
    assert 'the manifest says ap_dds: "2025-12", whose hash is ' + type_hash(good) in texts[1]
    assert texts[2].endswith("which it may only write")


@pytest.mark.parametrize(
    ("situation", "topic", "kind", "remedy"),
    [
        (spec(), "/fmu/out/vehicle_status", px4_message("VehicleStatus", "1.17"), 'write px4_msgs: "1.17"'),
        (AP_SPEC, "/ap/status", ap_message("ardupilot_msgs/msg/Status"), f'write ap_dds: "{AP_RELEASE}"'),
    ],
)
def test_an_agent_without_the_manifests_switch_is_told_of_it(
    situation: SimSpec, topic: str, kind: type[RosMessage], remedy: str
) -> None:
    with stack(situation) as (air, node):
        node.subscribe(topic, kind)
        assert remedy in unmatched_of(air, 1)[0]


@pytest.mark.parametrize(
    ("situation", "switch", "topic", "words"),
    [
        (spec(), {}, "/fmu/out/vehicle_status", "it cannot read without px4_msgs in its manifest"),
        (spec(), {"px4_msgs": "1.17"}, "/fmu/out/vehicle_statu", "did you mean /fmu/out/vehicle_status?"),
        (AP_SPEC, {}, "/ap/status", "it cannot read without ap_dds in its manifest"),
        (AP_SPEC, {"ap_dds": AP_RELEASE}, "/ap/statu", "in any session; did you mean /ap/status?"),
    ],
)
def test_a_hello_with_a_topic_of_an_autopilot_that_it_cannot_read_ends_the_session(
    situation: SimSpec, switch: dict[str, Any], topic: str, words: str
) -> None:
    with stack(situation, **switch) as (air, _), pytest.raises(StopSession, match=re.escape(words)):
        air.open_for([topic])


@pytest.mark.parametrize("release", ["1.16", "1.17"])
def test_the_bench_announces_all_topics_of_px4_with_their_hashes(release: str) -> None:
    """As a stack looks for them before it speaks: a publisher of each topic out, a subscription of each topic in."""
    expected = {
        (way, name.replace("/", "%"), f"px4_msgs::msg::dds_::{kind}_", type_hash(px4_message(kind, release)))
        for way, table in (("MP", PX4_TO_AGENT), ("MS", PX4_FROM_AGENT))
        for topic, kind in table.items()
        for name in px4_names(topic, release)
    }
    assert ("MP", "%fmu%out%vehicle_status_v1") in {token[:2] for token in expected}
    with stack(px4_msgs=release) as (air, _), tokens_of(air) as tokens:
        until(lambda: sum("%fmu%" in token for token in tokens) >= len(expected))
    found = {tuple(token.split("/")[5:6] + token.split("/")[9:12]) for token in tokens if "%fmu%" in token}
    assert found == expected


def test_the_bench_announces_a_server_of_each_service() -> None:
    """As a node waits for it before it calls."""
    with stack(AP_SPEC, ap_dds=AP_RELEASE) as (air, _), tokens_of(air) as tokens:
        until(lambda: sum("/SS/" in token for token in tokens) >= len(AP_SERVICES))
    served = {token.split("/")[9].replace("%", "/") for token in tokens if "/SS/" in token}
    assert served == set(AP_SERVICES)


def test_a_latched_publisher_is_heard_and_a_malformed_sample_is_counted() -> None:
    """As px4-offboard publishes, transient local; a sample of another layout is neither recorded nor handed over."""
    topic, kind = "/fmu/in/vehicle_command", px4_message("VehicleCommand", "1.17")
    records: list[Record] = []
    with stack(tap=records.append, px4_msgs="1.17") as (air, node):
        publisher = node.latched(topic, kind)
        publisher.put_bytes(encode(String("not a command")))
        publisher.put(kind(command=400))  # type: ignore[call-arg]
        documents = air.receive(SimTime(0), {topic: 2}, 30.0)
        assert air.counters()["air_malformed"] == 1
    assert [message.command for message in documents[topic]] == [400]
    assert [(record.topic, record.value) for record in records] == [(topic, documents[topic][0])]


@dataclass
class Vehicle:
    """Notes what is handed over, and says what it is told to."""

    says: list[CompanionSample] = field(default_factory=list)
    taken: list[CompanionSample] = field(default_factory=list)

    def take_samples(self, samples: Sequence[CompanionSample]) -> None:
        self.taken.extend(samples)

    def published_samples(self) -> list[CompanionSample]:
        return self.says


COMMAND: Any = px4_message("VehicleCommand", "1.17")
LIFE: Any = px4_message("OffboardControlMode", "1.17")
MODE: Any = ap_message("ardupilot_msgs/srv/ModeSwitch_Request")
VELOCITY: Any = ap_message("geometry_msgs/msg/TwistStamped")


@pytest.mark.parametrize(
    ("field_name", "first", "second"),
    [
        # Signs of life and setpoints before commands.
        (
            "command",
            {"/fmu/in/offboard_control_mode": [LIFE(position=True)]},
            {"/fmu/in/vehicle_command": [COMMAND(command=176), COMMAND(command=400)]},
        ),
        # Requests before what is flown.
        ("mode", {"/ap/mode_switch": [MODE(mode=4), MODE(mode=9)]}, {"/ap/cmd_vel": [VELOCITY()]}),
    ],
)
def test_samples_reach_the_autopilot_in_one_order_whichever_came_first(
    field_name: str, first: dict[str, list[Any]], second: dict[str, list[Any]]
) -> None:
    """Each topic in its own order, and no document of the agent's."""
    came = {**first, **second, "/vehicle_1/agent/status": ["{}"]}
    for documents in (came, dict(reversed(came.items()))):
        vehicle = Vehicle()
        Companion(vehicle, {}).hand_over(documents)
        assert [(topic, fields.get(field_name)) for topic, fields in vehicle.taken] == [
            (topic, getattr(sample, field_name, None))
            for topic, samples in {**first, **second}.items()
            for sample in samples
        ]


def test_a_sample_under_a_versioned_name_is_handed_over_as_under_its_own() -> None:
    """And what the autopilot says is sent under both names to those who listen, and recorded once."""
    reply, status = px4_message("ArmingCheckReply", "1.17"), px4_message("VehicleStatus", "1.17")
    vehicle = Vehicle([("/fmu/out/vehicle_status", {"nav_state": 23})])
    records: list[Record] = []
    with stack(tap=records.append, px4_msgs="1.17") as (air, node):
        heard = [node.subscribe(f"/fmu/out/vehicle_status{end}", status) for end in ("", "_v1")]
        air.open_for([subscription.topic for subscription in heard])
        for end in ("", "_v1"):
            node.publisher(f"/fmu/in/arming_check_reply{end}", reply).put(reply(registration_id=len(end)))  # type: ignore[call-arg]
        stated = {f"/fmu/in/arming_check_reply{end}": 1 for end in ("", "_v1")}
        companion = Companion(vehicle, air.companion)
        companion.hand_over(air.receive(SimTime(0), stated, 30.0))
        companion.publish(SimTime(0))
        assert all(subscription.wait(1, 30.0) for subscription in heard)
    assert [(topic, fields["registration_id"]) for topic, fields in vehicle.taken] == [
        ("/fmu/in/arming_check_reply", 0),
        ("/fmu/in/arming_check_reply", 3),
    ]
    assert [record.topic for record in records] == [*stated, "/fmu/out/vehicle_status"]


@pytest.mark.parametrize(
    ("pattern", "matches"),
    [
        ("**", ["/fmu/out/vehicle_status", "/vehicle_1/detections"]),
        ("1/fmu/**", ["/fmu/out/vehicle_status"]),
        ("*/fmu/out/vehicle_status/**", ["/fmu/out/vehicle_status"]),
        ("1/vehicle_1/*/**", ["/vehicle_1/detections"]),
    ],
)
def test_a_wildcard_counts_as_a_subscription_of_each_topic_that_it_matches(
    pattern: str, matches: list[str]
) -> None:
    """Inside /fmu and outside; the hello of lockstep names topics, not wildcards."""
    with stack(px4_msgs="1.17") as (air, node):
        wide: Any = node._session.declare_subscriber(pattern)
        air.open_for(matches)
        for publisher in (air.companion["/fmu/out/vehicle_status"], air.detections):
            assert publisher.publisher is not None
            assert publisher.publisher.has_reader is (publisher.topic in matches)
            publisher.publish(SimTime(0), publisher.kind())
        keys = [str(wide.recv().key_expr) for _ in matches]
        assert [key.split("/px4_msgs")[0].split("/vision_msgs")[0] for key in keys] == [
            f"1{topic}" for topic in matches
        ]
        with pytest.raises(StopSession, match="in any session"):
            air.open_for(["/fmu/**"])


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(600)
def test_the_example_in_rclpys_style_flies_on_pyzeros(tmp_path: Path) -> None:
    """Its keys, hashes and encoder are those of pyzeros."""
    pytest.importorskip("pyzeros", reason="pyzeros is not installed: pip install pyzeros==0.1.0")
    agent, folder = load_manifest(Path(__file__).parents[2] / "examples" / "ros2" / "offboard-ros2.yaml")
    end, records = run(tmp_path, agent, spec(120.0, mode="warp"), home=folder)
    assert end.outcome is Outcome.COMPLETED, end.reason
    assert end.fact(UnmatchedTopics) is None
    places: list[Any] = [
        record.value for record in records if record.topic == "/fmu/out/vehicle_local_position"
    ]
    heights = [-place.z for place in places]
    assert max(heights) == pytest.approx(5.0, abs=0.6)


EXTERNAL_MODE = COMPANION.with_name("px4_external_mode.py")


def test_an_external_mode_registers_flies_completes_and_lands_twice_alike(tmp_path: Path) -> None:
    """By a program with Zenoh and the layouts of px4_msgs alone; with the names of uXRCE-DDS the flight is the same."""
    flights = [
        fly(tmp_path / name, manifest(name, program=EXTERNAL_MODE), spec()) for name in ("a", "b", "v1")
    ]
    end, records, said = flights[0]
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    assert said.splitlines() == [
        "version, success, check, mode, executor 1 True 0 23 -1",
        "at 0.0 0.0 -5.0 asked and flown 23 23",
        "at 6.0 3.0 -7.0 asked and flown 23 23",
        "completed (0, 23) (0, 18)",
        "acks (100001, 0) (400, 0) (21, 0)",
        "can be asked for 0",
    ]
    assert records == flights[1][1]
    assert end.fact(UnmatchedTopics) is None
    assert [said for _, _, said in flights] == [said] * 3
    places, versioned = (
        [record for record in flown if record.topic == "/fmu/out/vehicle_local_position"]
        for flown in (records, flights[2][1])
    )
    assert places == versioned != []
    topics = {record.topic for record in flights[2][1]}
    # What the bench says is recorded once, what the agent says under the name that it has said.
    assert "/fmu/in/arming_check_reply_v1" in topics
    assert not topics & {
        "/fmu/in/arming_check_reply",
        "/fmu/out/vehicle_status_v1",
        "/fmu/out/arming_check_request_v1",
    }


def test_a_program_of_another_release_is_ended_with_the_key_that_it_needs(tmp_path: Path) -> None:
    """The layouts of 1.17 under a manifest of 1.18."""
    end, _, said = fly(tmp_path, manifest(program=EXTERNAL_MODE, px4_msgs="1.18"), spec(8.0))
    assert end.outcome is Outcome.AGENT_PROTOCOL
    key = data_key(1, "/fmu/out/vehicle_status", px4_message("VehicleStatus", "1.18"))
    assert key in end.reason
    assert said == ""


def test_a_mode_whose_program_falls_silent_is_brought_home(tmp_path: Path) -> None:
    """Asked for is still the mode (23), flown a return (5)."""
    end, _, said = fly(tmp_path, manifest("silent", program=EXTERNAL_MODE), spec(240.0))
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    assert said.splitlines()[-1] == "failsafe, asked and flown 23 5"
