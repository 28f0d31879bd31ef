"""Agents fly by the topics of a PX4: in lockstep twice alike, and what of them is wrong is told."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import zenoh
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pydantic import ValidationError
from test_session import session_simspec

from bench.agents import load_manifest, open_agent
from bench.campaign.execution._flight import AgentStarter
from bench.contracts import (
    AgentManifest,
    CompanionSample,
    Outcome,
    Record,
    SessionResult,
    SimTime,
    UnmatchedTopics,
)
from bench.recording import open_recording
from bench.simspec import AgentSpec, Home, Mission, Pace, SimSpec, VehicleSpec
from bench.simulation import SessionPlan, run_session, session_faults
from bench.simulation._air_network import AirNetwork, open_air_network
from bench.simulation._companion_topics import Companion
from bench.simulation._stop_session import StopSession
from bench.streams import (
    PX4_FROM_AGENT,
    PX4_TO_AGENT,
    String,
    encode,
    open_client,
    px4_message,
    px4_names,
    type_hash,
)

COMPANION = Path(__file__).with_name("px4_companion.py")


def manifest(*arguments: str, release: str = "1.17", program: Path = COMPANION) -> AgentManifest:
    return AgentManifest(
        name="companion",
        command=("{python}", str(program), *arguments),
        pace=("lockstep", "warp", "realtime"),
        mavlink=(),
        px4_msgs=release,
        isolation="none",
    )


def spec(time_limit_s: float = 90.0, **pace: object) -> SimSpec:
    return session_simspec(
        vehicle=VehicleSpec(model="x500", home=Home(east_m=5, north_m=5)),
        mission=Mission(time_limit_s=time_limit_s),
        agent=AgentSpec(manifest="companion"),
        pace=Pace.model_validate({"mode": "lockstep", "tick_s": 0.1, **pace}),
    )


def fly(folder: Path, agent: AgentManifest, situation: SimSpec) -> tuple[SessionResult, list[Record], str]:
    records: list[Record] = []
    starter = AgentStarter(open_agent)
    plan = SessionPlan(situation, agent, folder, starter.open, folder / "scratch", records.append)
    end = run_session(plan)
    return end, records, (starter.output or b"").decode()


def test_the_logic_of_px4_ros_coms_example_a_square_and_a_landing_are_flown_twice_alike(
    tmp_path: Path,
) -> None:
    """By a program with Zenoh and the layouts of px4_msgs alone. It arms, takes off, holds, flies corners, lands."""
    flights = [fly(tmp_path / name, manifest(), spec()) for name in ("a", "b")]
    end, records, said = flights[0]
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    assert said.splitlines() == [
        *("at 0 0 -5", "at 5 0 -5", "at 5 5 -5", "at 0 5 -5", "at 0 0 -5"),
        "acks (176, 0) (400, 0) (21, 0)",
    ]
    assert records == flights[1][1]
    assert said == flights[1][2]


def test_a_companion_that_falls_silent_is_brought_home_by_the_failsafe(tmp_path: Path) -> None:
    """It sees that offboard (14) is asked for and a return (5) flown."""
    end, records, said = fly(tmp_path, manifest("stop"), spec(240.0))
    assert "asked and flown 14 5 failsafe True" in said
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    assert any(record.topic == "/fmu/out/vehicle_status" for record in records)


def test_what_is_flown_by_px4s_topics_is_in_the_recording_with_schemas(tmp_path: Path) -> None:
    """Both directions, decoded by a reader of others; equal flights are equal files."""
    _, records, _ = fly(tmp_path, manifest(), spec(8.0))
    files = []
    for name in ("a.mcap", "b.mcap"):
        with open_recording(tmp_path / name, simspec=spec(), versions={}) as recorder:
            for record in records:
                recorder(record)
        files.append((tmp_path / name).read_bytes())
    assert files[0] == files[1]
    with (tmp_path / "a.mcap").open("rb") as file:
        messages = {
            (channel.topic, schema.name if schema else ""): message
            for schema, channel, _, message in make_reader(
                file, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages()
            if channel.topic.startswith("/fmu/")
        }
    setpoint = messages["/fmu/in/trajectory_setpoint", "px4_msgs/msg/TrajectorySetpoint"]
    assert list(setpoint.position) == [0.0, 0.0, -5.0]
    status = messages["/fmu/out/vehicle_status", "px4_msgs/msg/VehicleStatus"]
    assert (status.nav_state, status.arming_state) == (14, 2)
    # Of 1.17 and not of 1.18.
    assert hasattr(status, "failure_detector_status")


@pytest.mark.parametrize(("vehicle", "autopilot"), [("x500", "ardupilot"), ("still", "px4")])
def test_a_vehicle_without_px4s_topics_is_refused_before_takeoff(
    tmp_path: Path, vehicle: str, autopilot: str
) -> None:
    other = VehicleSpec(model=vehicle, autopilot=autopilot, home=Home(east_m=5, north_m=5))
    situation = spec().model_copy(update={"vehicle": other})
    assert "has no topics of PX4" in " ".join(map(str, session_faults(situation, manifest())))
    end, _, _ = fly(tmp_path, manifest(), situation)
    assert end.outcome is Outcome.SETUP_INVALID
    assert "leave px4_msgs out" in end.reason


def test_the_manifest_takes_a_release_that_nobody_quoted() -> None:
    assert manifest(release=1.18).px4_msgs == "1.18"  # type: ignore[arg-type]
    with pytest.raises(ValidationError, match=r"'1\.16', '1\.17' or '1\.18'"):
        manifest(release="1.15")
    with pytest.raises(ValidationError, match="come over Zenoh alone"):
        AgentManifest(name="a", command=("b",), px4_msgs="1.17", air="tick")
    assert "px4_msgs" not in AgentManifest(name="a", command=("b",)).model_dump()


def unmatched_of(air: AirNetwork, count: int) -> tuple[str, ...]:
    deadline_s = time.monotonic() + 30.0
    while len(air.unmatched) < count:
        assert time.monotonic() < deadline_s
        time.sleep(0.001)
    return air.unmatched


def test_what_an_agent_gets_wrong_is_told_with_what_it_meant() -> None:
    """Another release's hash, an unknown topic, the wrong direction, another type; what is right is not told."""
    with (
        open_air_network(spec(), lambda record: None, zenoh=True, px4_msgs="1.17") as air,
        open_client(air.access, "stack") as node,  # type: ignore[arg-type]
    ):
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


def test_an_agent_without_the_manifests_release_is_told_of_it() -> None:
    with (
        open_air_network(spec(), lambda record: None, zenoh=True) as air,
        open_client(air.access, "stack") as node,  # type: ignore[arg-type]
    ):
        node.subscribe("/fmu/out/vehicle_status", px4_message("VehicleStatus", "1.17"))
        assert 'write px4_msgs: "1.17"' in unmatched_of(air, 1)[0]


@pytest.mark.parametrize(
    ("release", "topic", "words"),
    [
        (None, "/fmu/out/vehicle_status", "it cannot read without px4_msgs in its manifest"),
        ("1.17", "/fmu/out/vehicle_statu", "in any session; did you mean /fmu/out/vehicle_status?"),
    ],
)
def test_a_hello_with_a_topic_of_px4_that_it_cannot_read_ends_the_session(
    release: str | None, topic: str, words: str
) -> None:
    with (
        open_air_network(spec(), lambda record: None, zenoh=True, px4_msgs=release) as air,
        pytest.raises(StopSession, match=re.escape(words)),
    ):
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
    with open_air_network(spec(), lambda record: None, zenoh=True, px4_msgs=release) as air:
        access = air.access
        assert access is not None
        tokens: list[str] = []
        config = zenoh.Config()
        for name, value in (
            ("mode", "client"),
            ("connect/endpoints", [access.locator]),
            ("transport/auth/usrpwd/user", access.user),
            ("transport/auth/usrpwd/password", access.password),
        ):
            config.insert_json5(name, json.dumps(value))
        with zenoh.open(config) as session:
            watch = session.liveliness().declare_subscriber(
                f"@ros2_lv/{access.domain}/**",
                lambda sample: tokens.append(str(sample.key_expr)),
                history=True,
            )
            deadline_s = time.monotonic() + 30.0
            while sum("%fmu%" in token for token in tokens) < len(expected):
                assert time.monotonic() < deadline_s
                time.sleep(0.001)
            watch.undeclare()  # type: ignore[no-untyped-call]
    found = {tuple(token.split("/")[5:6] + token.split("/")[9:12]) for token in tokens if "%fmu%" in token}
    assert found == expected


def test_a_latched_publisher_is_heard_and_a_malformed_sample_is_counted() -> None:
    """As px4-offboard publishes, transient local; a sample of another layout is neither recorded nor handed over."""
    topic, kind = "/fmu/in/vehicle_command", px4_message("VehicleCommand", "1.17")
    records: list[Record] = []
    with (
        open_air_network(spec(), records.append, zenoh=True, px4_msgs="1.17") as air,
        open_client(air.access, "stack") as node,  # type: ignore[arg-type]
    ):
        publisher = node.latched(topic, kind)
        publisher.put_bytes(encode(String("not a command")))
        publisher.put(kind(command=400))  # type: ignore[call-arg]
        documents = air.receive(SimTime(0), {topic: 2}, 30.0)
        assert air.counters()["air_malformed"] == 1
    assert [message.command for message in documents[topic]] == [400]
    assert [(record.topic, record.value) for record in records] == [(topic, documents[topic][0])]


def test_samples_reach_the_autopilot_in_one_order_whichever_came_first() -> None:
    """Signs of life and setpoints before commands, each topic in its own order."""

    class Vehicle:
        def __init__(self) -> None:
            self.taken: list[CompanionSample] = []

        def take_samples(self, samples: Sequence[CompanionSample]) -> None:
            self.taken.extend(samples)

        def published_samples(self) -> list[CompanionSample]:
            return []

    command, life = px4_message("VehicleCommand", "1.17"), px4_message("OffboardControlMode", "1.17")
    came: dict[str, list[Any]] = {
        "/fmu/in/vehicle_command": [command(command=176), command(command=400)],  # type: ignore[call-arg]
        "/fmu/in/offboard_control_mode": [life(position=True)],  # type: ignore[call-arg]
        "/vehicle_1/agent/status": ["{}"],
    }
    orders = []
    for documents in (came, dict(reversed(came.items()))):
        vehicle = Vehicle()
        Companion(vehicle, {}).hand_over(documents)
        orders.append([(topic, fields.get("command")) for topic, fields in vehicle.taken])
    assert orders[0] == orders[1]
    assert orders[0] == [
        ("/fmu/in/offboard_control_mode", None),
        ("/fmu/in/vehicle_command", 176),
        ("/fmu/in/vehicle_command", 400),
    ]


def test_a_sample_under_a_versioned_name_is_handed_over_as_under_its_own() -> None:
    """And what the autopilot says is sent under both names to those who listen, and recorded once."""
    reply, status = px4_message("ArmingCheckReply", "1.17"), px4_message("VehicleStatus", "1.17")
    taken: list[CompanionSample] = []

    class Vehicle:
        def take_samples(self, samples: Sequence[CompanionSample]) -> None:
            taken.extend(samples)

        def published_samples(self) -> list[CompanionSample]:
            return [("/fmu/out/vehicle_status", {"nav_state": 23})]

    records: list[Record] = []
    with (
        open_air_network(spec(), records.append, zenoh=True, px4_msgs="1.17") as air,
        open_client(air.access, "stack") as node,  # type: ignore[arg-type]
    ):
        heard = [node.subscribe(f"/fmu/out/vehicle_status{end}", status) for end in ("", "_v1")]
        air.open_for([subscription.topic for subscription in heard])
        for end in ("", "_v1"):
            node.publisher(f"/fmu/in/arming_check_reply{end}", reply).put(reply(registration_id=len(end)))  # type: ignore[call-arg]
        stated = {f"/fmu/in/arming_check_reply{end}": 1 for end in ("", "_v1")}
        companion = Companion(Vehicle(), air.companion)
        companion.hand_over(air.receive(SimTime(0), stated, 30.0))
        companion.publish(SimTime(0))
        assert all(subscription.wait(1, 30.0) for subscription in heard)
    assert [(topic, fields["registration_id"]) for topic, fields in taken] == [
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
    with (
        open_air_network(spec(), lambda record: None, zenoh=True, px4_msgs="1.17") as air,
        open_client(air.access, "stack") as node,  # type: ignore[arg-type]
    ):
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
    records: list[Record] = []
    situation = spec(120.0, mode="warp")
    end = run_session(SessionPlan(situation, agent, folder, open_agent, tmp_path / "scratch", records.append))
    assert end.outcome is Outcome.COMPLETED, end.reason
    assert end.fact(UnmatchedTopics) is None
    places: list[Any] = [
        record.value for record in records if record.topic == "/fmu/out/vehicle_local_position"
    ]
    heights = [-place.z for place in places]
    assert max(heights) == pytest.approx(5.0, abs=0.6)
