"""Clients of other makers in warp: unmodified, faster than real time, and twice the same. The rest is `make clients`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from client_programs import PROGRAMS, SCRIPTS, Program

from bench.agents import open_agent
from bench.agents.confinement import rungs
from bench.campaign.execution._flight import AgentStarter
from bench.contracts import AgentManifest, MavlinkNeed, Outcome, Record, SessionResult
from bench.simspec import SimSpec
from bench.simulation import SessionPlan, run_session
from bench.simulation.warp import warp_fault


def simspec(autopilot: str, limit_s: float) -> SimSpec:
    """A vehicle alone on a field."""
    corners = [{"east_m": e, "north_m": n} for e, n in ((0, 0), (100, 0), (100, 100), (0, 100))]
    home = {"east_m": 50.0, "north_m": 50.0}
    return SimSpec.model_validate(
        {
            "name": "clients",
            "world": {"area": {"corners": corners}},
            "vehicle": {"model": "x500", "autopilot": autopilot, "home": home},
            "mission": {"time_limit_s": limit_s},
            "agent": {"manifest": "client"},
            "pace": {"mode": "warp"},
            "budgets": {"wall_s": 3600.0},
            "realized": {"actors": ()},
        }
    )


def manifest_of(program: Program, *chapters: str) -> AgentManifest:
    """The client as an agent; a shell hands it the port in its own words."""
    url = program.url.format("${REBAR_MAVLINK##*:}")
    script = str(SCRIPTS / program.script)
    line = f'exec {program.python} {script} "{url}" {" ".join(chapters)}'
    kind = "udp_out" if program.autopilot == "px4" else "tcp_in"
    return AgentManifest(
        name="client",
        command=("sh", "-c", line),
        pace=("warp",),
        mavlink=(MavlinkNeed.model_validate({"kind": kind}),),
        zenoh=False,
        isolation="none",
        read=(str(SCRIPTS), str(program.python)),
    )


def flown(
    manifest: AgentManifest, spec: SimSpec, folder: Path
) -> tuple[SessionResult, list[Record], dict[str, Any]]:
    """A session in warp: its end, its records, and what the client told last."""
    if fault := warp_fault():
        pytest.skip(str(fault))
    records: list[Record] = []
    starter = AgentStarter(open_agent)
    end = run_session(SessionPlan(spec, manifest, folder, starter.open, folder / "scratch", records.append))
    lines = (starter.output or b"").decode().splitlines()
    logbook: dict[str, Any] = json.loads(lines[-1]) if lines and lines[-1].startswith("{") else {}
    return end, records, logbook


def available(client: str) -> Program:
    if not PROGRAMS[client].python.exists():
        pytest.skip("its environment is built by `make clients`")
    return PROGRAMS[client]


def test_pymavlink_on_two_rungs_gives_the_same_records(tmp_path: Path) -> None:
    """On a host that is as busy as it is: six seconds in which it connects, arms and climbs."""
    spec = simspec("px4", 6.0)
    taken: list[list[Record]] = []
    for isolation in ("none", "landlock"):
        if rungs()[isolation].trial():
            pytest.skip(f"{isolation} cannot start here")
        manifest = manifest_of(PROGRAMS["pymavlink-px4"], "hop").model_copy(update={"isolation": isolation})
        end, records, _ = flown(manifest, spec, tmp_path / isolation)
        assert end.outcome is Outcome.TIME_LIMIT, end.reason
        assert end.counters["warp_by_cpu_ms"] == 0
        taken.append(records)
    assert len(taken[0]) > 500
    assert taken[0] == taken[1]


@pytest.mark.clients
@pytest.mark.parametrize("client", ["pymavlink-px4", "pymavlink-ardupilot", "dronekit"])
def test_a_client_hops_and_comes_home_twice_the_same(client: str, tmp_path: Path) -> None:
    program = available(client)
    spec = simspec(program.autopilot, 300.0)
    first, second = (flown(manifest_of(program, "hop"), spec, tmp_path / name) for name in ("a", "b"))
    assert first[0].outcome is Outcome.COMPLETED, first[0].reason
    assert first[2]["hop"]["from_start_m"] < 1.0
    assert first[2] == second[2]
    assert first[1] == second[1]


@pytest.mark.clients
@pytest.mark.parametrize("client", ["mavsdk", "mavsdk-asyncio"])
def test_a_mavsdk_hops_and_comes_home_twice_alike(client: str, tmp_path: Path) -> None:
    """Which of its threads comes first, where one message wakes two, is its own affair: a step more or less."""
    spec = simspec("px4", 300.0)
    ends = [flown(manifest_of(available(client), "hop"), spec, tmp_path / name) for name in ("a", "b")]
    for end, _, logbook in ends:
        assert end.outcome is Outcome.COMPLETED, end.reason
        assert logbook["hop"]["disarm_in_air"] == "COMMAND_DENIED"
        assert logbook["hop"]["from_start_m"] < 1.0
    first, second = (end.simulated_s for end, _, _ in ends)
    assert first == pytest.approx(second, abs=0.5)


@pytest.mark.clients
def test_node_hops_with_timers_of_exactly_a_second(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("there is no program node")
    command = {"command": (node, str(SCRIPTS / "node_flight.js"))}
    manifest = manifest_of(PROGRAMS["pymavlink-px4"]).model_copy(update=command)
    end, _, logbook = flown(manifest, simspec("px4", 120.0), tmp_path)
    assert end.outcome is Outcome.COMPLETED, end.reason
    assert logbook["highest_m"] > 2.0
    assert logbook["seconds"] > 10
    assert logbook["longest_ms"] == pytest.approx(1000.0, abs=1.5)


@pytest.mark.clients
def test_the_static_server_of_mavsdk_grpc_is_refused(tmp_path: Path) -> None:
    manifest = manifest_of(available("mavsdk-grpc"), "hop")
    end, _, _ = flown(manifest, simspec("px4", 60.0), tmp_path)
    # Its Python starts the server when it is told where the vehicle is: from then on an agent could mean to be rid of the session.
    assert end.outcome is Outcome.AGENT_PROTOCOL
    assert "mavsdk_server cannot fly in warp: it is statically linked" in end.reason
