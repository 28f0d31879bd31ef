"""An agent with a mode of its own at a PX4, in whole sessions."""

from __future__ import annotations

from pathlib import Path

from test_session_px4_topics import fly, manifest, spec

from bench.contracts import AgentManifest, Outcome, Record, UnmatchedTopics
from bench.streams import data_key, px4_message

PROGRAM = Path(__file__).with_name("px4_external_mode.py")


def program(*arguments: str) -> AgentManifest:
    return manifest(*arguments, program=PROGRAM)


def test_an_external_mode_registers_flies_completes_and_lands_twice_alike(tmp_path: Path) -> None:
    """By a program with Zenoh and the layouts of px4_msgs alone; with the names of uXRCE-DDS the flight is the same."""
    flights = [fly(tmp_path / name, program(*name.split()), spec()) for name in ("a", "b", "v1")]
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
    assert of_topic(flights[2][1], "/fmu/out/vehicle_local_position") == of_topic(
        records, "/fmu/out/vehicle_local_position"
    )
    topics = {record.topic for record in flights[2][1]}
    # What the bench says is recorded once, what the agent says under the name that it has said.
    assert "/fmu/in/arming_check_reply_v1" in topics
    assert not topics & {
        "/fmu/in/arming_check_reply",
        "/fmu/out/vehicle_status_v1",
        "/fmu/out/arming_check_request_v1",
    }


def of_topic(records: list[Record], topic: str) -> list[Record]:
    found = [record for record in records if record.topic == topic]
    assert found
    return found


def test_a_program_of_another_release_is_ended_with_the_key_that_it_needs(tmp_path: Path) -> None:
    """The layouts of 1.17 under a manifest of 1.18."""
    end, _, said = fly(tmp_path, manifest(program=PROGRAM, release="1.18"), spec(8.0))
    assert end.outcome is Outcome.AGENT_PROTOCOL
    key = data_key(1, "/fmu/out/vehicle_status", px4_message("VehicleStatus", "1.18"))
    assert key in end.reason
    assert said == ""


def test_a_mode_whose_program_falls_silent_is_brought_home(tmp_path: Path) -> None:
    """Asked for is still the mode (23), flown a return (5)."""
    end, _, said = fly(tmp_path, program("silent"), spec(240.0))
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {said}"
    assert said.splitlines()[-1] == "failsafe, asked and flown 23 5"
