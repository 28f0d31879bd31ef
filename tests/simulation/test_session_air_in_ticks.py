"""The air network in the lines of the tick socket, for an agent that has no library."""

from __future__ import annotations

import json
import math
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from test_session import run, session_simspec

from bench.contracts import AgentManifest, Outcome, Record, SessionResult, UnreadTopics
from bench.simspec import Intelligence, Mission, Pace, PlacedReport
from bench.simulation._outbox import MAX_BYTES, MAX_MESSAGES, Outbox
from bench.streams import String, decode, json_value

SPEAKER = """
import json, os, socket, sys
plan = json.load(open(sys.argv[1]))
host, port = os.environ["REBAR_TICK"].split(":")
lines = socket.create_connection((host, int(port))).makefile("rw")
def say(**document):
    print(json.dumps(document), file=lines, flush=True)
say(kind="hello", protocol=1, agent="speaker", subscribes=plan["reads"], secret=os.environ["REBAR_TICK_SECRET"], **plan.get("hello", {}))
print(json.dumps({"zenoh": "REBAR_ZENOH" in os.environ}))
for line in lines:
    print(line, end="", flush=True)
    tick = json.loads(line)
    if tick["kind"] == "end":
        break
    say(kind="ack", number=tick["number"], **plan["acks"].get(str(tick["number"]), {}))
"""
STATUS, REPORTS = "/vehicle_1/agent/status", "/vehicle_1/agent/reports"


def manifest(program: str = SPEAKER, **changes: Any) -> AgentManifest:
    fields = {"name": "speaker", "pace": ["lockstep"], "air": "tick", "mavlink": []} | changes
    command = [sys.executable, "-I", "-S", "-c", program, "{folder}/plan.json"]
    return AgentManifest.model_validate(fields | {"command": command})


def content(record: Record) -> Any:
    """A record as an agent reads it."""
    message = decode(record.type_name, record.data)
    return json.loads(message.data) if isinstance(message, String) else json_value(message)


def status(phase: str, topic: str = STATUS) -> dict[str, Any]:
    return {"topic": topic, "message": {"time_s": 0.0, "phase": phase}}


def flown(
    folder: Path,
    reads: list[str],
    acks: dict[int, list[dict[str, Any]]] | None = None,
    mode: str = "lockstep",
    hello: dict[str, Any] | None = None,
    program: str = SPEAKER,
    situation: dict[str, Any] | None = None,
    **changes: Any,
) -> tuple[SessionResult, list[Record], list[dict[str, Any]]]:
    """The result, the records, and what the agent read: what it was given first, then the ticks. In its acks it says the
    messages of `acks`; the manifest and the situation may be changed.
    """
    folder.mkdir(exist_ok=True)
    said = {str(number): {"air": messages} for number, messages in (acks or {}).items()}
    # In a file: on its command line a text may not be as long as the longest document.
    (folder / "plan.json").write_text(json.dumps({"reads": reads, "acks": said, "hello": hello or {}}))
    spec = session_simspec(
        intelligence=(Intelligence(id="told", about="target", priority=1, uncertainty_m=20.0),),
        # The host may be as slow as it likes.
        pace=Pace(mode=mode, max_late_share=1.0),
        **(situation or {}),
    )
    assert spec.realized is not None
    reports = (PlacedReport(id="told", east_m=52.0, north_m=49.0),)
    spec = spec.model_copy(update={"realized": spec.realized.model_copy(update={"reports": reports})})
    end, records = run(folder, manifest(program, pace=[mode], **changes), spec)
    lines = (folder / "agent.log").read_text().splitlines()
    return end, records, [json.loads(line) for line in lines if line.startswith("{")]


def test_an_agent_reads_in_its_ticks_what_is_recorded_of_the_topics_that_it_names(tmp_path: Path) -> None:
    """Latched ones of before its hello too, everything in order, and nothing else."""
    reads = ["/clock", "/tf", "/tf_static", "/vehicle_1/mission", "/vehicle_1/intelligence"]
    end, records, (environment, *ticks) = flown(tmp_path, reads)
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    assert environment == {"zenoh": False}
    read = [[message["topic"], message["message"]] for tick in ticks for message in tick.get("air", ())]
    recorded = [(record.topic, content(record)) for record in records if record.topic in reads]
    assert {topic for topic, _ in read} == set(reads)
    # As JSON, which has one kind of list.
    assert json.loads(json.dumps(recorded)) == read
    # By this a program that flies at every pace tells lockstep.
    assert all(tick["topics"].keys() == set(reads) for tick in ticks if tick["kind"] == "tick")
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
    acks = {1: [status("transit"), tracks, status("searching")], 3: [status("complete")]}
    end, records, _ = flown(tmp_path, [], acks)
    assert end.outcome is Outcome.COMPLETED, end.reason
    own = [record for record in records if record.topic.startswith("/vehicle_1/agent/")]
    texts = [(record.topic, json.loads(decode(record.type_name, record.data).data)) for record in own]
    phases = [text["phase"] for topic, text in texts if topic == STATUS]
    assert phases == ["transit", "searching", "complete"]
    assert [topic for topic, _ in texts[:3]] == [STATUS, STATUS, "/vehicle_1/agent/tracks"]


LONGEST = 256 * 1024
TOO_LONG = {"topic": REPORTS, "message": {"reason": "x" * (LONGEST - len(json.dumps({"reason": ""})) + 1)}}
NOT_ITS_OWN = status("transit", "/vehicle_1/orders")


@pytest.mark.parametrize(
    ("message", "changes", "words"),
    [
        (status("transit", "/vehicle_1/agent/state"), {}, "did you mean /vehicle_1/agent/status?"),
        (NOT_ITS_OWN, {}, "a topic that it may not write"),
        (NOT_ITS_OWN, {"mode": "realtime"}, "a topic that it may not write"),
        (TOO_LONG, {}, "at most 262144 are taken"),
        ({"topic": REPORTS, "message": "x" * (LONGEST + 1)}, {}, "at most 262144 are taken"),
        # They would be lost without a word.
        (status("transit"), {"air": "zenoh"}, "its manifest has no `air: tick`"),
    ],
    ids=["unknown", "not its own", "in real time", "too long", "a long text", "on zenoh"],
)
def test_what_it_may_not_say_ends_the_session_with_the_reason(
    tmp_path: Path, message: dict[str, Any], changes: dict[str, Any], words: str
) -> None:
    """The agent is told it too."""
    end, _, lines = flown(tmp_path, [], {2: [message]}, **changes)
    assert end.outcome is Outcome.AGENT_PROTOCOL
    assert words in end.reason
    assert lines[-1] == {"kind": "end", "reason": end.reason}


def test_a_text_is_recorded_to_the_letter(tmp_path: Path) -> None:
    """With blanks of its own, and whether it is a document or not, up to the greatest size."""
    longest = {"reason": "x" * (LONGEST - len(json.dumps({"reason": ""})))}
    texts = ['{ "phase" :"transit","time_s":0}', 'no JSON: "\u0000\u00fc', "", "x" * LONGEST]
    messages = [{"topic": REPORTS, "message": message} for message in (*texts, longest)]
    end, records, _ = flown(tmp_path, [], {2: messages})
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    recorded = [decode(record.type_name, record.data) for record in records if record.topic == REPORTS]
    assert recorded[:-1] == [String(text) for text in texts]
    assert json.loads(recorded[-1].data) == longest


@pytest.mark.parametrize("mode", ["realtime", "warp"])
def test_where_time_does_not_wait_an_agent_reads_the_same_without_counts(mode: str, tmp_path: Path) -> None:
    """Everything from the start in the order of the recording, latched ones of before its hello too."""
    reads = ["/clock", "/tf", "/tf_static", "/vehicle_1/mission", "/vehicle_1/intelligence"]
    acks = {1: [status("transit")], 3: [status("searching")]}
    end, records, (environment, *lines) = flown(tmp_path, reads, acks, mode=mode)
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    assert environment == {"zenoh": False}
    ticks = lines[:-1]
    assert [tick["number"] for tick in ticks] == list(range(len(ticks)))
    assert all(tick["topics"] == tick["links"] == {} for tick in ticks)
    assert lines[-1] == {"kind": "end", "reason": "the session is over"}
    read = [[message["topic"], message["message"]] for tick in ticks for message in tick["air"]]
    recorded = [[record.topic, content(record)] for record in records if record.topic in reads]
    # What came after the last tick is recorded alone.
    assert read == json.loads(json.dumps(recorded[: len(read)]))
    assert {topic for topic, _ in read} == set(reads)
    assert [content(record)["phase"] for record in records if record.topic == STATUS] == [
        "transit",
        "searching",
    ]
    assert (end.counters["tick_strangers"], end.counters["air_untaken"]) == (0, 0)


def test_in_warp_ticks_come_at_their_interval_and_sessions_are_alike(tmp_path: Path) -> None:
    sessions = []
    for name in ("first", "second"):
        end, records, (_, *lines) = flown(tmp_path / name, ["/clock"], {4: [status("transit")]}, mode="warp")
        assert end.outcome is Outcome.TIME_LIMIT, end.reason
        times_ns = [line["time_ns"] for line in lines[:-1]]
        assert times_ns == [number * 100_000_000 for number in range(30)]
        sessions.append([(record.time, record.topic, record.data) for record in records])
    assert sessions[0] == sessions[1]


@pytest.mark.parametrize("interval_s", [0.001, 0.05, 0.5])
def test_a_hello_may_ask_for_other_ticks(interval_s: float, tmp_path: Path) -> None:
    """At the first step of 20 ms at or after each multiple, with all that was published by then."""
    hello = {"interval_s": interval_s}
    end, _, (_, *lines) = flown(tmp_path, ["/clock"], hello=hello, mode="warp")
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    multiples = range(math.ceil(3.0 / interval_s))
    steps = sorted({math.ceil(Fraction(str(interval_s)) * number / Fraction("0.02")) for number in multiples})
    assert [line["time_ns"] for line in lines[:-1]] == [step * 20_000_000 for step in steps if step < 150]
    assert sum(len(line["air"]) for line in lines[:-1]) == steps[-1 if steps[-1] < 150 else -2] + 1


@pytest.mark.parametrize("interval_s", [0.0009, 60.1])
def test_a_hello_with_an_interval_out_of_bounds_is_refused(interval_s: float, tmp_path: Path) -> None:
    end, _, _ = flown(tmp_path, [], hello={"interval_s": interval_s}, mode="warp")
    assert end.outcome is not Outcome.TIME_LIMIT
    assert "interval_s" in end.reason


LATE = """
import json, os, socket, sys, time
time.sleep(1.05)
host, port = os.environ["REBAR_TICK"].split(":")
lines = socket.create_connection((host, int(port))).makefile("rw")
hello = {"kind": "hello", "protocol": 1, "agent": "late", "subscribes": ["/clock", "/vehicle_1/mission"]}
print(json.dumps(hello | {"secret": os.environ["REBAR_TICK_SECRET"]}), file=lines, flush=True)
for line in lines:
    print(line, end="", flush=True)
    tick = json.loads(line)
    if tick["number"] == 5:
        time.sleep(1.0)
    print(json.dumps({"kind": "ack", "number": tick["number"]}), file=lines, flush=True)
    if tick["number"] == 7 and sys.argv[1] == "leaves":
        lines.close()
        time.sleep(3600)
"""


def late(folder: Path, deed: str, limit_s: float) -> tuple[SessionResult, list[dict[str, Any]]]:
    (folder / "late.py").write_text(LATE)
    command = [sys.executable, "-I", "-S", "{folder}/late.py", deed]
    fields = {"name": "late", "pace": ["warp"], "air": "tick", "mavlink": [], "command": command}
    spec = session_simspec(pace=Pace(mode="warp"), mission=Mission(time_limit_s=limit_s))
    end, _ = run(folder, AgentManifest.model_validate(fields), spec)
    lines = (folder / "agent.log").read_text().splitlines()
    return end, [json.loads(line) for line in lines if line.startswith("{")]


def test_an_agent_that_is_late_has_what_is_latched_and_catches_up(tmp_path: Path) -> None:
    """Time goes on while it sleeps: before its hello, and before an answer; then one tick brings everything."""
    end, lines = late(tmp_path, "stays", 4.0)
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    ticks = [line for line in lines if line["kind"] == "tick"]
    times_s = [tick["time_ns"] / 1e9 for tick in ticks[:8]]
    assert times_s == [1.06, 1.1, 1.2, 1.3, 1.4, 1.5, 2.5, 2.6]
    assert ticks[0]["air"][0]["topic"] == "/vehicle_1/mission"
    clocks = [message["message"]["clock"] for tick in ticks[1:8] for message in tick["air"]]
    moments_ns = [clock["sec"] * 10**9 + clock["nanosec"] for clock in clocks]
    assert moments_ns == list(range(moments_ns[0], moments_ns[-1] + 1, 20_000_000))


def test_an_agent_that_leaves_the_socket_and_runs_on_breaks_the_protocol(tmp_path: Path) -> None:
    end, _ = late(tmp_path, "leaves", 60.0)
    assert end.outcome is Outcome.AGENT_PROTOCOL
    assert end.reason == "the agent closed the tick socket and went on running"
    assert 11.0 < end.simulated_s < 13.0


def test_an_outbox_drops_the_oldest_that_is_not_latched() -> None:
    outbox = Outbox()
    outbox.add("/latched", {"n": -1}, 10, latched=True)
    for number in range(MAX_MESSAGES):
        outbox.add("/tf", {"n": number}, 10, latched=False)
    outbox.shrink()
    assert outbox.dropped == 1
    outbox.add("/tf", {"n": MAX_MESSAGES}, MAX_BYTES - 40, latched=False)
    outbox.shrink()
    assert [message.model_dump()["message"]["n"] for message in outbox.take()] == [
        -1,
        *range(MAX_MESSAGES - 3, MAX_MESSAGES + 1),
    ]
    assert outbox.dropped == 1 + MAX_MESSAGES - 4
    assert outbox.take() == ()


@pytest.mark.parametrize("mode", ["lockstep", "warp"])
def test_a_tick_may_be_longer_than_what_a_connection_holds(mode: str, tmp_path: Path) -> None:
    """Raw pictures of several megabytes in one line, for an agent that reads on."""
    speaker = SPEAKER.replace('print(line, end=""', "print(json.dumps({'length': len(line)})")
    vehicle = session_simspec().vehicle
    camera = vehicle.camera.model_copy(update={"width_px": 1920, "height_px": 1080, "rate_hz": 2.0})
    situation = {
        "mission": Mission(time_limit_s=1.0),
        "vehicle": vehicle.model_copy(update={"camera": camera}),
    }
    reads = ["/vehicle_1/camera/front/image_raw"]
    end, _, (_, *lines) = flown(tmp_path, reads, mode=mode, program=speaker, situation=situation)
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    assert max(line["length"] for line in lines) > 8_000_000


@pytest.mark.parametrize("mode", ["lockstep", "realtime", "warp"])
def test_an_ack_ahead_of_its_tick_breaks_the_protocol_at_every_pace(mode: str, tmp_path: Path) -> None:
    # Both in one piece, so that the second is there when the tick is sent.
    ahead = """    if tick["number"] == 3:
        print(json.dumps({"kind": "ack", "number": 3}), json.dumps({"kind": "ack", "number": 4}), sep="\\n", file=lines, flush=True)
        continue
"""
    speaker = SPEAKER.replace('    say(kind="ack"', ahead + '    say(kind="ack"')
    end, _, _ = flown(tmp_path, [], mode=mode, program=speaker)
    assert end.outcome is Outcome.AGENT_PROTOCOL
    assert "on the tick socket before tick 4 was sent" in end.reason


def test_what_an_agent_never_subscribed_to_is_told(tmp_path: Path) -> None:
    reads = ["/vehicle_1/mission", "/vehicle_1/detections", "/tf"]
    end, _, _ = flown(tmp_path, reads)
    fact = end.fact(UnreadTopics)
    assert fact is not None
    rest = ("intelligence", "orders", "consents", "operator_link")
    assert fact.topics == tuple(f"/vehicle_1/{name}" for name in rest)


def test_an_unknown_topic_in_its_hello_is_named_and_nothing_is_told_of_what_it_did_not_read(
    tmp_path: Path,
) -> None:
    end, _, _ = flown(tmp_path, ["/vehicle_1/missions"])
    assert end.outcome is Outcome.AGENT_PROTOCOL
    assert "did you mean /vehicle_1/mission?" in end.reason
    assert end.fact(UnreadTopics) is None
