"""A whole session in lockstep with an agent that sends more in a tick than its vehicle handles in one."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

import pytest
from vehicle_client import mavlink, simspec

from bench.agents import open_agent
from bench.contracts import AgentManifest, MavlinkNeed, Outcome, Record
from bench.simspec import Mission, Realized
from bench.simulation import SessionPlan, run_session

TALKER = """
import json, os, socket, sys
frame, first, each = bytes.fromhex(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
kind, host, port = os.environ["REBAR_MAVLINK"].split(":")
link = socket.socket(socket.AF_INET, socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM)
link.connect((host, int(port)))
host, port = os.environ["REBAR_TICK"].rsplit(":", 1)
ticks = socket.create_connection((host, int(port)))
say = lambda message: ticks.sendall((json.dumps(message) + "\\n").encode())
say({"kind": "hello", "protocol": 1, "agent": "talker", "subscribes": [], "secret": os.environ["REBAR_TICK_SECRET"]})
sent = 0
for line in ticks.makefile("rb"):
    message = json.loads(line)
    if message["kind"] == "end":
        break
    for _ in range(first // 20 if message["number"] == 0 else 0):
        link.sendall(frame * 20)
        sent += 20
    for _ in range(each):
        link.sendall(frame)
        sent += 1
    say({"kind": "ack", "number": message["number"], "topics": {}, "links": {"onboard": sent}})
"""


@pytest.mark.parametrize("kind", ["udp_in", "tcp_in"])
def test_messages_beyond_those_of_a_tick_wait_and_are_not_lost(
    tmp_path: Path, kind: Literal["udp_in", "tcp_in"]
) -> None:
    """1300 messages in the first tick and 150 in each that follows do not hold the session up; all are recorded."""
    frame = bytes(
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mavlink.MAVLink(None, srcSystem=245))
    )
    manifest = AgentManifest(
        name="talker",
        command=(sys.executable, "-c", TALKER, frame.hex(), "1300", "150"),
        pace=("lockstep",),
        zenoh=False,
        mavlink=(MavlinkNeed(kind=kind),),
    )
    spec = simspec().model_copy(
        update={"realized": Realized(actors=()), "mission": Mission(time_limit_s=3.0)}
    )
    records: list[Record] = []
    end = run_session(SessionPlan(spec, manifest, tmp_path, open_agent, tmp_path / "scratch", records.append))
    assert end.outcome is Outcome.TIME_LIMIT, f"{end.reason} {end.facts}"
    assert end.wall_s < 5.0
    assert end.counters["mavlink_dropped"] == 0
    recorded = b"".join(bytes(record.data) for record in records if record.topic.endswith("from_agent"))
    assert recorded.count(frame) == 1300 + 150 * 30
