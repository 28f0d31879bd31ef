"""An agent that uses more of the host than its manifest allows loses its own session, which says what it was."""

from __future__ import annotations

from pathlib import Path

import pytest
from rungs import BARE, CONFINING, rung_or_skip

from bench.agents import open_agent
from bench.agents.confinement import Host, this_host
from bench.contracts import AgentLimits, AgentManifest, Outcome, Record, SessionResult
from bench.realization import place
from bench.simspec import load_simspec
from bench.simulation import SessionPlan, run_session

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"

# Each child stays under the limit of one process; all of them together do not. The parent waits for a child that is
# killed, and ends as shells do.
MEMORY_HOG = """
import os, sys, time
for number in range(8):
    if os.fork() == 0:
        held = bytearray(40 << 20)
        time.sleep(60)
        os._exit(0)
status = os.wait()[1]
sys.exit(f"a child ended with {status}")
"""
ONE_LARGE_PROCESS = "held = [bytearray(1 << 20) for _ in range(500)]"
FORK_BOMB = """
import os, time
while True:
    if os.fork() == 0:
        time.sleep(60)
        os._exit(0)
"""
THREADS = """
import threading, time
for number in range(500):
    threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
"""


# Files of half the quota each: not their own limit is tried. It waits to be found.
FILL_DISK = """
import time
for number in range(8):
    with open(f"block-{number}", "wb") as file:
        file.write(bytes(4 << 20))
time.sleep(60)
"""


def flown(code: str, rung: str, folder: Path) -> SessionResult:
    """The end of a session whose agent is this Python code, with room for 96 MB, 24 processes and 8 MB of files."""
    spec = load_simspec(EXAMPLE)
    pace = spec.pace.model_copy(update={"mode": "lockstep"})
    manifest = AgentManifest(
        name="hog",
        command=("{python}", "-I", "-S", "-c", code),
        pace=("lockstep",),
        limits=AgentLimits(memory_mb=96, processes=24, scratch_mb=8),
    )
    records: list[Record] = []
    placed = place(spec.model_copy(update={"pace": pace}))
    with rung_or_skip(rung) as isolation:
        confined = manifest.model_copy(update={"isolation": isolation})
        return run_session(
            SessionPlan(placed, confined, folder, open_agent, folder / "agent", records.append)
        )


def host_of_agents() -> Host:
    return this_host(own_network=True)


@pytest.mark.parametrize("rung", CONFINING)
def test_memory_of_all_processes_together(rung: str, tmp_path: Path) -> None:
    """The kernel kills it, and the outcome names the agent and its limit, not the host."""
    if not host_of_agents().memory_groups:
        pytest.skip("this process may make no control group with a limit on memory")
    end = flown(MEMORY_HOG, rung, tmp_path)
    assert end.outcome is Outcome.AGENT_CRASHED, end.reason
    assert "used more than its limit of 96 MB of memory" in end.reason


@pytest.mark.parametrize("rung", CONFINING)
def test_memory_of_one_process(rung: str, tmp_path: Path) -> None:
    """No control group is needed; the agent is refused more, and its last words say so."""
    end = flown(ONE_LARGE_PROCESS, rung, tmp_path)
    assert end.outcome is Outcome.AGENT_CRASHED, end.reason
    assert "MemoryError" in end.reason or "96 MB of memory" in end.reason


@pytest.mark.parametrize(
    ("code", "words"), [(FORK_BOMB, "temporarily unavailable"), (THREADS, "start new thread")]
)
@pytest.mark.parametrize("rung", CONFINING)
def test_too_many_processes_and_threads(code: str, words: str, rung: str, tmp_path: Path) -> None:
    """The next one is refused, and the agent ends by it."""
    host = host_of_agents()
    if host.root and not host.process_groups:
        pytest.skip(
            "the root user's processes are counted by control groups alone, which this process may not make"
        )
    end = flown(code, rung, tmp_path)
    assert end.outcome is Outcome.AGENT_CRASHED, end.reason
    assert words in end.reason


@pytest.mark.parametrize("rung", CONFINING)
def test_a_full_folder(rung: str, tmp_path: Path) -> None:
    """Refused by the file system, or killed by the watch: the outcome names it."""
    words = "used more than its limit of 8 MB in its folder" if rung == BARE else "No space left on device"
    end = flown(FILL_DISK, rung, tmp_path)
    assert end.outcome is Outcome.AGENT_CRASHED, end.reason
    assert words in end.reason
