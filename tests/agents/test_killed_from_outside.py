"""An agent that somebody outside kills: its own crash only where nobody can tell."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rungs import BARE, CONFINING, rung_or_skip

from bench.agents import LocalProcess, open_agent
from bench.contracts import (
    AgentExit,
    AgentManifest,
    AgentPlan,
    AgentProcess,
    BenchTraceback,
    Outcome,
    SessionResult,
)
from bench.realization import place
from bench.simspec import load_simspec
from bench.simulation import SessionPlan, run_session

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"


def outermost(agent: LocalProcess) -> int:
    return agent.pid


def agent_itself(agent: LocalProcess) -> int:
    """The only child of process 1 of the box, or of the launcher."""
    box = agent.root().pid
    while True:
        children = Path(f"/proc/{box}/task/{box}/children").read_text().split()
        # Until then it is a child that has not become the agent yet.
        if children and Path("/proc", children[0], "comm").read_text().startswith("python"):
            return int(children[0])
        os.sched_yield()


def end_of_killed(
    rung: str, chosen: Callable[[LocalProcess], int], number: signal.Signals, folder: Path
) -> SessionResult:
    """A session whose agent, which waits for ever, or a process around it gets a signal."""

    @contextmanager
    def open_and_kill(plan: AgentPlan) -> Generator[AgentProcess]:
        with open_agent(plan) as agent:
            assert isinstance(agent, LocalProcess)
            os.kill(chosen(agent), number)
            yield agent

    spec = load_simspec(EXAMPLE)
    pace = spec.pace.model_copy(update={"mode": "lockstep"})
    code = "import time; time.sleep(600)"
    placed = place(spec.model_copy(update={"pace": pace}))
    with rung_or_skip(rung) as isolation:
        manifest = AgentManifest(
            name="idle", command=("{python}", "-IS", "-c", code), pace=("lockstep",), isolation=isolation
        )
        plan = SessionPlan(
            placed,
            manifest,
            folder,
            open_and_kill,
            folder / "agent",
            lambda record: None,
            memory_kills=lambda: 0,
        )
        return run_session(plan)


@pytest.mark.parametrize(
    ("rung", "number", "killed"),
    [
        ("landlock", signal.SIGKILL, "the launcher of landlock"),
        ("landlock", signal.SIGTERM, "the launcher of landlock"),
    ],
)
def test_a_box_that_is_killed_is_no_crash_of_its_agent(
    rung: str, number: signal.Signals, killed: str, tmp_path: Path
) -> None:
    end = end_of_killed(rung, outermost, number, tmp_path)
    assert end.outcome is Outcome.BENCH_ERROR, end.reason
    assert end.reason == f"{killed} was killed by somebody outside, and the agent with it"
    assert end.fact(BenchTraceback) is None


def test_without_namespaces_nobody_can_tell(tmp_path: Path) -> None:
    end = end_of_killed(BARE, outermost, signal.SIGKILL, tmp_path)
    assert end.outcome is Outcome.AGENT_CRASHED, end.reason


@pytest.mark.parametrize("rung", CONFINING)
def test_an_agent_that_is_killed_might_have_done_it_itself(rung: str, tmp_path: Path) -> None:
    end = end_of_killed(rung, agent_itself, signal.SIGKILL, tmp_path)
    assert end.outcome is Outcome.AGENT_CRASHED, end.reason
    assert "ended with signal 9" in end.reason
    assert end.fact(AgentExit) == AgentExit(code=-signal.SIGKILL)
