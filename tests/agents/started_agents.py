"""Agents that tests start by themselves or in a session, and wait for."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rungs import rung_or_skip

from bench.agents import open_agent
from bench.contracts import AgentEndpoints, AgentManifest, AgentPlan, AgentProcess, OpenAgent, SessionResult
from bench.realization import place
from bench.simspec import load_simspec
from bench.simulation import SessionPlan, run_session

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"
PATIENCE_S = 60.0


def plan_of(manifest: AgentManifest, folder: Path, scratch: Path, **options: Any) -> AgentPlan:
    """An agent whose manifest lies in `folder`, with one link."""
    endpoints = AgentEndpoints({"REBAR_MAVLINK": "udpin:127.0.0.1:14540"}, None, "", "", 1, None)
    return AgentPlan(manifest, folder, load_simspec(EXAMPLE), endpoints, scratch, **options)


def until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def exit_code(agent: AgentProcess) -> int | None:
    """That of an agent which ends by itself."""
    until(lambda: agent.exit_code() is not None)
    return agent.exit_code()


def end_of_session(
    folder: Path,
    rung: str,
    code: str,
    start: OpenAgent = open_agent,
    **manifest: Any,
) -> SessionResult:
    """The end of a session in lockstep whose agent is this Python code, on a host that kills nothing for its memory."""
    spec = load_simspec(EXAMPLE)
    placed = place(spec.model_copy(update={"pace": spec.pace.model_copy(update={"mode": "lockstep"})}))
    command = ("{python}", "-I", "-S", "-c", code)
    with rung_or_skip(rung) as isolation:
        confined = AgentManifest(
            name="alone", command=command, pace=("lockstep",), isolation=isolation, **manifest
        )
        scratch = folder / "agent"
        return run_session(
            SessionPlan(placed, confined, folder, start, scratch, lambda _: None, memory_kills=lambda: 0)
        )
