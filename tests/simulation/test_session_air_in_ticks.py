"""The air network in the lines of the tick socket, for an agent that has no library."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from test_session import run, session_simspec

from bench.contracts import AgentManifest, Outcome, Record, SessionResult
from bench.simspec import Intelligence, PlacedReport
from bench.streams import String, decode, json_value

SPEAKER = """
import json, os, socket, sys
plan = json.load(open(sys.argv[1]))
host, port = os.environ["REBAR_TICK"].split(":")
lines = socket.create_connection((host, int(port))).makefile("rw")
def say(**document):
    print(json.dumps(document), file=lines, flush=True)
say(kind="hello", protocol=1, agent="speaker", subscribes=plan["reads"], secret=os.environ["REBAR_TICK_SECRET"])
print(json.dumps({"zenoh": "REBAR_ZENOH" in os.environ}))
for line in lines:
    print(line, end="", flush=True)
    tick = json.loads(line)
    if tick["kind"] == "end":
        break
    say(kind="ack", number=tick["number"], **plan["acks"].get(str(tick["number"]), {}))
"""
STATUS, REPORTS = "/vehicle_1/agent/status", "/vehicle_1/agent/reports"


def manifest(**changes: Any) -> AgentManifest:
    fields = {"name": "speaker", "pace": ["lockstep"], "air": "tick", "mavlink": []} | changes
    command = [sys.executable, "-I", "-S", "-c", SPEAKER, "{folder}/plan.json"]
    return AgentManifest.model_validate(fields | {"command": command})


def status(phase: str, topic: str = STATUS) -> dict[str, Any]:
    return {"topic": topic, "message": {"time_s": 0.0, "phase": phase}}


def flown(
    folder: Path, reads: list[str], acks: dict[int, dict[str, Any]] | None = None, **changes: Any
) -> tuple[SessionResult, list[Record], list[dict[str, Any]]]:
    """The result, the records, and what the agent read: what it was given first, then the ticks."""
    # In a file: on its command line a text may not be as long as the longest document.
    plan = {"reads": reads, "acks": {str(number): ack for number, ack in (acks or {}).items()}}
    (folder / "plan.json").write_text(json.dumps(plan))
    spec = session_simspec(
        intelligence=(Intelligence(id="told", about="target", priority=1, uncertainty_m=20.0),)
    )
    assert spec.realized is not None
    reports = (PlacedReport(id="told", east_m=52.0, north_m=49.0),)
    spec = spec.model_copy(update={"realized": spec.realized.model_copy(update={"reports": reports})})
    end, records = run(folder, manifest(**changes), spec)
    lines = (folder / "agent.log").read_text().splitlines()
    return end, records, [json.loads(line) for line in lines if line.startswith("{")]


def test_an_agent_reads_in_its_ticks_what_is_recorded_of_the_topics_that_it_names(tmp_path: Path) -> None:
    """Latched ones of before its hello too, everything in order, and nothing else."""
    reads = ["/clock", "/tf", "/tf_static", "/vehicle_1/mission", "/vehicle_1/intelligence"]
    end, records, (environment, *ticks) = flown(tmp_path, reads)
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    assert environment == {"zenoh": False}
    read = [[message["topic"], message["message"]] for tick in ticks for message in tick.get("air", ())]
    recorded = []
    for record in records:
        if record.topic in reads:
            message = decode(record.type_name, record.data)
            value = json.loads(message.data) if isinstance(message, String) else json_value(message)
            recorded.append((record.topic, value))
    assert {topic for topic, _ in read} == set(reads)
    # As JSON, which has one kind of list.
    assert json.loads(json.dumps(recorded)) == read
    # A message comes with the tick of its own moment.
    clocks = [
        (tick["time_ns"], message["message"]["clock"])
        for tick in ticks
        for message in tick.get("air", ())
        if message["topic"] == "/clock"
    ]
    assert all(at == clock["sec"] * 10**9 + clock["nanosec"] for at, clock in clocks)


def test_what_its_acks_bring_is_recorded_and_ends_the_mission(tmp_path: Path) -> None:
    """By topic, and in the order of each."""
    tracks = {"topic": "/vehicle_1/agent/tracks", "message": {"time_s": 0.0, "tracks": []}}
    acks = {1: {"air": [status("transit"), tracks, status("searching")]}, 3: {"air": [status("complete")]}}
    end, records, _ = flown(tmp_path, [], acks)
    assert end.outcome is Outcome.COMPLETED, end.reason
    own = [record for record in records if record.topic.startswith("/vehicle_1/agent/")]
    texts = [(record.topic, json.loads(decode(record.type_name, record.data).data)) for record in own]
    phases = [text["phase"] for topic, text in texts if topic == STATUS]
    assert phases == ["transit", "searching", "complete"]
    assert [topic for topic, _ in texts[:3]] == [STATUS, STATUS, "/vehicle_1/agent/tracks"]


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (
            status("transit", "/vehicle_1/agent/state"),
            "publishes on '/vehicle_1/agent/state', a topic that it may not write; did you mean /vehicle_1/agent/status?",
        ),
        (status("transit", "/vehicle_1/orders"), "a topic that it may not write"),
        ({"topic": REPORTS, "message": {"reason": "x" * 300_000}}, "at most 262144 are taken"),
    ],
)
def test_what_it_may_not_say_ends_the_session_with_the_reason(
    tmp_path: Path, message: dict[str, Any], words: str
) -> None:
    end, _, _ = flown(tmp_path, [], {2: {"air": [message]}})
    assert end.outcome is Outcome.AGENT_PROTOCOL
    assert words in end.reason


def test_a_document_of_just_the_greatest_size_is_taken(tmp_path: Path) -> None:
    longest = 256 * 1024 - len(json.dumps({"reason": ""}))
    for extra, outcome in ((0, Outcome.TIME_LIMIT), (1, Outcome.AGENT_PROTOCOL)):
        folder = tmp_path / str(extra)
        folder.mkdir()
        long = {"topic": REPORTS, "message": {"reason": "x" * (longest + extra)}}
        end, _, _ = flown(folder, [], {2: {"air": [long]}})
        assert end.outcome is outcome, end.reason


def test_messages_of_an_agent_on_zenoh_are_refused_in_its_acks(tmp_path: Path) -> None:
    """They would be lost without a word."""
    end, _, _ = flown(tmp_path, [], {2: {"air": [status("transit")]}}, air="zenoh")
    assert end.outcome is Outcome.AGENT_PROTOCOL
    assert "its manifest has no `air: tick`" in end.reason


def test_an_unknown_topic_in_its_hello_is_named(tmp_path: Path) -> None:
    end, _, _ = flown(tmp_path, ["/vehicle_1/missions"])
    assert end.outcome is Outcome.AGENT_PROTOCOL
    assert "did you mean /vehicle_1/mission?" in end.reason


@pytest.mark.parametrize("pace", [["realtime"], ["lockstep", "warp"]])
def test_other_paces_have_no_tick_socket(pace: list[str]) -> None:
    with pytest.raises(ValidationError, match=r"air: tick needs pace: \[lockstep\]"):
        manifest(pace=pace)
    assert "air" not in AgentManifest(name="a", command=("b",)).model_dump()
