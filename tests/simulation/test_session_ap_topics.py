"""Agents fly by the topics and services of an ArduPilot: in lockstep twice alike, and what of them is wrong is told."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pydantic import ValidationError
from test_session_px4_topics import fly, unmatched_of
from test_session_px4_topics import manifest as px4_manifest
from test_session_px4_topics import spec as px4_spec

from bench.contracts import AgentManifest, CompanionSample, Outcome, Record
from bench.recording import open_recording
from bench.simspec import Home, SimSpec, VehicleSpec
from bench.simulation import session_faults
from bench.simulation._air_network import open_air_network
from bench.simulation._companion_topics import Companion
from bench.simulation._stop_session import StopSession
from bench.streams import AP_FROM_AGENT, AP_SERVICES, String, ap_message, open_client, type_hash

COMPANION = Path(__file__).with_name("ap_companion.py")
RELEASE = "2025-12"


def manifest(*arguments: str, program: Path = COMPANION) -> AgentManifest:
    return AgentManifest(
        name="companion",
        command=("{python}", str(program), *arguments),
        pace=("lockstep", "warp", "realtime"),
        mavlink=(),
        ap_dds=RELEASE,
        isolation="none",
    )


def spec(
    time_limit_s: float = 90.0, autopilot: str = "ardupilot", model: str = "x500", **pace: object
) -> SimSpec:
    vehicle = VehicleSpec(model=model, autopilot=autopilot, home=Home(east_m=5, north_m=5))
    return px4_spec(time_limit_s, **pace).model_copy(update={"vehicle": vehicle})


def test_a_companion_arms_takes_off_flies_and_lands_by_topics_and_services_twice_alike(
    tmp_path: Path,
) -> None:
    """By a program with Zenoh and the layouts alone; a takeoff that ArduPilot refuses is answered too. Everything is in the
    recording, both directions, decoded by a reader of others; equal flights are equal files.
    """
    flights = [fly(tmp_path / name, manifest("early"), spec()) for name in ("a", "b")]
    end, records, said = flights[0]
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    lines = said.splitlines()
    assert lines == [
        "/ap/experimental/takeoff b'\\x00'",
        "/ap/prearm_check b'\\x01\\x00\\x00\\x00\\x13\\x00\\x00\\x00Vehicle is Armable\\x00'",
        "/ap/mode_switch b'\\x01\\x04'",
        "/ap/arm_motors b'\\x01'",
        "/ap/experimental/takeoff b'\\x01'",
        *("at 7 -3 7", "at 6 -2 7", "at 0 0 8"),
        "/ap/mode_switch b'\\x01\\t'",
        "armed, mode, flying False 9 False",
    ]
    assert records == flights[1][1]
    assert said == flights[1][2]
    check_recordings(tmp_path, records)


def check_recordings(folder: Path, records: list[Record]) -> None:
    files = []
    for name in ("a.mcap", "b.mcap"):
        with open_recording(folder / name, simspec=spec(), versions={}) as recorder:
            for record in records:
                recorder(record)
        files.append((folder / name).read_bytes())
    assert files[0] == files[1]
    with (folder / "a.mcap").open("rb") as file:
        read = make_reader(file, decoder_factories=[DecoderFactory()])
        messages: dict[tuple[str, str], list[Any]] = {}
        for schema, channel, _, message in read.iter_decoded_messages():
            messages.setdefault((channel.topic, schema.name if schema else ""), []).append(message)
    asked = messages["/ap/mode_switch", "ardupilot_msgs/srv/ModeSwitch_Request"]
    answers = messages["/ap/mode_switch", "ardupilot_msgs/srv/ModeSwitch_Response"]
    assert [request.mode for request in asked] == [answer.curr_mode for answer in answers] == [4, 9]
    velocities = messages["/ap/cmd_vel", "geometry_msgs/msg/TwistStamped"]
    assert {velocity.header.frame_id for velocity in velocities} == {"map", "base_link"}
    assert velocities[0].twist.linear.x == 2.0
    states = messages["/ap/status", "ardupilot_msgs/msg/Status"]
    assert {(state.armed, state.mode) for state in states} >= {(False, 4), (True, 4), (True, 9), (False, 9)}


@pytest.mark.parametrize(("model", "autopilot"), [("x500", "px4"), ("still", "ardupilot")])
def test_a_vehicle_without_ardupilots_topics_is_refused_before_takeoff(
    tmp_path: Path, model: str, autopilot: str
) -> None:
    situation = spec(autopilot=autopilot, model=model)
    assert "has no topics of ArduPilot" in " ".join(map(str, session_faults(situation, manifest())))
    end, _, _ = fly(tmp_path, manifest(), situation)
    assert end.outcome is Outcome.SETUP_INVALID
    assert "(autopilot: ardupilot), or leave ap_dds out" in end.reason


def test_a_manifest_that_says_both_switches_fits_no_vehicle() -> None:
    both = px4_manifest().model_copy(update={"ap_dds": RELEASE})
    for autopilot, missing in (("px4", "ArduPilot"), ("ardupilot", "PX4")):
        faults = " ".join(map(str, session_faults(spec(autopilot=autopilot), both)))
        assert f"has no topics of {missing}" in faults
        assert faults.count("has no topics of") == 1


def test_the_manifest_takes_the_month_that_the_bench_knows_and_needs_zenoh() -> None:
    with pytest.raises(ValidationError, match="2025-12"):
        AgentManifest.model_validate({"name": "a", "command": ["b"], "ap_dds": "4.6"})
    for other in ({"air": "tick"}, {"zenoh": False}):
        with pytest.raises(ValidationError, match="ap_dds: ArduPilot's topics come over Zenoh alone"):
            AgentManifest.model_validate({"name": "a", "command": ["b"], "ap_dds": RELEASE, **other})
    assert "ap_dds" not in AgentManifest(name="a", command=("b",)).model_dump()


def test_what_an_agent_gets_wrong_of_ardupilots_topics_is_told_with_what_it_meant() -> None:
    """Another type, an unknown topic, the wrong direction, a service as a topic; what is right is not told."""
    with (
        open_air_network(spec(), lambda record: None, zenoh=True, ap_dds=RELEASE) as air,
        open_client(air.access, "stack") as node,  # type: ignore[arg-type]
    ):
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
    with (
        open_air_network(spec(), lambda record: None, zenoh=True, ap_dds=RELEASE) as air,
        open_client(air.access, "stack") as node,  # type: ignore[arg-type]
    ):
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


def test_an_agent_without_the_switch_is_told_of_it() -> None:
    with (
        open_air_network(spec(), lambda record: None, zenoh=True) as air,
        open_client(air.access, "stack") as node,  # type: ignore[arg-type]
    ):
        node.subscribe("/ap/status", ap_message("ardupilot_msgs/msg/Status"))
        assert f'no ap_dds: write ap_dds: "{RELEASE}"' in unmatched_of(air, 1)[0]


@pytest.mark.parametrize(
    ("release", "topic", "words"),
    [
        (None, "/ap/status", "it cannot read without ap_dds in its manifest"),
        (RELEASE, "/ap/statu", "in any session; did you mean /ap/status?"),
    ],
)
def test_a_hello_with_a_topic_of_ardupilot_that_it_cannot_read_ends_the_session(
    release: str | None, topic: str, words: str
) -> None:
    with (
        open_air_network(spec(), lambda record: None, zenoh=True, ap_dds=release) as air,
        pytest.raises(StopSession, match=re.escape(words)),
    ):
        air.open_for([topic])


def test_requests_reach_the_autopilot_before_what_is_flown_whichever_came_first() -> None:
    class Vehicle:
        def __init__(self) -> None:
            self.taken: list[CompanionSample] = []

        def take_samples(self, samples: Any) -> None:
            self.taken.extend(samples)

        def published_samples(self) -> list[CompanionSample]:
            return []

    request: Any = ap_message("ardupilot_msgs/srv/ModeSwitch_Request")
    velocity: Any = ap_message("geometry_msgs/msg/TwistStamped")
    came: dict[str, list[Any]] = {
        "/ap/cmd_vel": [velocity()],
        "/ap/mode_switch": [request(mode=4), request(mode=9)],
        "/vehicle_1/agent/status": ["{}"],
    }
    orders = []
    for documents in (came, dict(reversed(came.items()))):
        vehicle = Vehicle()
        Companion(vehicle, {}).hand_over(documents)
        orders.append([(topic, fields.get("mode")) for topic, fields in vehicle.taken])
    assert orders[0] == orders[1] == [("/ap/mode_switch", 4), ("/ap/mode_switch", 9), ("/ap/cmd_vel", None)]


def test_the_bench_announces_a_server_of_each_service() -> None:
    """As a node waits for it before it calls."""
    with open_air_network(spec(), lambda record: None, zenoh=True, ap_dds=RELEASE) as air:
        access = air.access
        assert access is not None
        tokens: list[str] = []
        with open_client(access, "stack") as node:
            session: Any = node._session
            watch = session.liveliness().declare_subscriber(
                f"@ros2_lv/{access.domain}/**",
                lambda sample: tokens.append(str(sample.key_expr)),
                history=True,
            )
            deadline_s = time.monotonic() + 30.0
            while sum("/SS/" in token for token in tokens) < len(AP_SERVICES):
                assert time.monotonic() < deadline_s
                time.sleep(0.001)
            watch.undeclare()
    served = {token.split("/")[9].replace("%", "/") for token in tokens if "/SS/" in token}
    assert served == set(AP_SERVICES)
