"""docs/streams.md agrees with the code."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from bench.cli._app import run as run_app
from bench.simspec import Camera, Home, Perception, VehicleSpec, load_simspec
from bench.simulation import air_topics
from bench.streams import (
    AP_FROM_AGENT,
    AP_SERVICES,
    AP_TO_AGENT,
    PX4_FROM_AGENT,
    PX4_TO_AGENT,
    String,
    data_key,
    encode,
)

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"
PAGE = (Path(__file__).parents[2] / "docs" / "streams.md").read_text()


def test_the_page_lists_every_topic_of_the_air_network() -> None:
    """A topic that is added to a session is added to the page, and the page has no other."""
    cameras = {"camera": Camera(name="c"), "more_cameras": (Camera(name="d"),)}
    vehicle = VehicleSpec.model_validate({"name": "v", "home": Home(east_m=0, north_m=0), **cameras})
    spec = load_simspec(EXAMPLE).model_copy(
        update={"vehicle": vehicle, "perception": Perception(more_cameras=("d",))}
    )
    topics = {topic.name for topic in air_topics(spec)}
    assert "/v/camera/d/detections" in topics
    assert "/v/camera/c/detections" not in topics
    in_page = {re.sub("camera/[cd]/", "camera/{c}/", name.replace("/v/", "/{v}/")) for name in topics}
    assert in_page == set(re.findall(r"^\| `(/\S+)` \|", PAGE, re.MULTILINE))


Capture = pytest.CaptureFixture[str]


def rows_of(scene: Path, capsys: Capture) -> dict[str, dict[str, Any]]:
    """What `rebar schema --keys` prints of a SimSpec's topics."""
    run_app(["schema", "--keys", str(scene), "--json"])
    return {row["topic"]: row for row in json.loads(capsys.readouterr().out)}


def with_ardupilot(path: Path) -> Path:
    text = EXAMPLE.read_text().replace("  model: x500\n", "  model: x500\n  autopilot: ardupilot\n")
    path.write_text(text)
    return path


def test_the_keys_of_a_session_are_printed(capsys: Capture) -> None:
    """As text that can be copied and as JSON; the hash is that of ROS 2 for std_msgs/msg/String."""
    hashed = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    key = f"1/vehicle_1/agent/reports/std_msgs::msg::dds_::String_/{hashed}"
    rows = rows_of(EXAMPLE, capsys)
    report = rows["/vehicle_1/agent/reports"]
    assert (report["key"], report["direction"]) == (key, "from the agent")
    assert rows["/vehicle_1/orders"]["latched"] == 32
    assert rows["/clock"]["reliable"] is False
    run_app(["schema", "--keys", str(EXAMPLE)])
    lines = capsys.readouterr().out.splitlines()
    assert f"  {key}" in lines
    assert len(lines) == 2 * len(rows)


def test_the_page_lists_every_topic_of_a_px4() -> None:
    section = PAGE.partition("## PX4's topics")[2].partition("\n## ")[0]
    out, _, into = section.partition("From the agent")
    for text, table in ((out, PX4_TO_AGENT), (into, PX4_FROM_AGENT)):
        names = {topic.rpartition("/")[2] for topic in table}
        assert names == {
            name for name in re.findall(r"`([a-z_]+)`", text) if name not in ("announced", "facts")
        }


def test_the_page_lists_every_topic_and_service_of_an_ardupilot() -> None:
    section = PAGE.partition("## ArduPilot's topics")[2].partition("\n## ")[0]
    out, _, rest = section.partition("From the agent")
    into, _, rest = rest.partition("Services, with")
    services = rest.partition("Stamps, ")[0]
    for text, table in ((out, AP_TO_AGENT), (into, AP_FROM_AGENT), (services, AP_SERVICES)):
        names = set(re.findall(r"`([a-z_/]+)`", text)) - {"map", "base_link", "setpoints_ignored"}
        assert names - {"/ap/v", "ap_dds"} == {name.removeprefix("/ap/") for name in table}


def test_the_keys_of_ardupilots_topics_and_services_are_printed(tmp_path: Path, capsys: Capture) -> None:
    rows = rows_of(with_ardupilot(tmp_path / "scene.yaml"), capsys)
    service, status = rows["/ap/arm_motors"], rows["/ap/status"]
    assert (service["direction"], service["ap_dds"]) == ("a service", "2025-12")
    assert "1/ap/arm_motors/ardupilot_msgs::srv::dds_::ArmMotors_/RIHS01_99849cee" in service["key"]
    assert (status["direction"], status["latched"], status["reliable"]) == ("to the agent", 1, True)
    assert rows["/ap/cmd_vel"]["direction"] == "from the agent"
    assert rows["/ap/pose/filtered"]["reliable"] is False
    assert not any(topic.startswith("/fmu/") or "px4_msgs" in row for topic, row in rows.items())


@pytest.mark.parametrize(
    ("given", "release", "hashed"),
    [("", "1.17", "RIHS01_828bddbb"), ("px4_msgs: 1.18\n", "1.18", "RIHS01_573d6f1a")],
)
def test_the_keys_of_px4s_topics_are_printed_in_the_release_of_the_manifest(
    tmp_path: Path, capsys: Capture, given: str, release: str, hashed: str
) -> None:
    """1.17 for an agent that has none."""
    topic, scene = "/fmu/out/vehicle_status", tmp_path / "scene.yaml"
    (tmp_path / "mine.yaml").write_text(f"name: mine\ncommand: [true_]\n{given}")
    scene.write_text(EXAMPLE.read_text().replace("manifest: reference-naive", "manifest: mine.yaml"))
    rows = rows_of(scene, capsys)
    assert (rows[topic]["px4_msgs"], rows[topic]["direction"]) == (release, "to the agent")
    assert f"1{topic}/px4_msgs::msg::dds_::VehicleStatus_/{hashed}" in rows[topic]["key"]
    assert rows["/fmu/in/vehicle_command"]["direction"] == "from the agent"
    assert rows["/fmu/out/home_position"]["latched"] == 1
    assert "px4_msgs" not in rows["/clock"]
    run_app(["schema", "--keys", str(scene)])
    line = f'{topic}  px4_msgs/msg/VehicleStatus  to the agent, best effort, with px4_msgs: "{release}" in'
    assert line in capsys.readouterr().out


def test_a_key_is_made_of_a_class_or_of_a_name() -> None:
    assert data_key(1, "/v/x", String) == data_key(1, "/v/x", "std_msgs/msg/String")
    with pytest.raises(KeyError):
        data_key(1, "/v/x", "std_msgs/msg/Text")


def test_the_encoding_example_of_the_page_is_correct() -> None:
    """The bytes that the page shows for other languages are the bytes that the bench sends."""
    shown = "00010000 03000000 686900"
    assert shown in PAGE
    assert encode(String("hi")) == bytes.fromhex(shown)
