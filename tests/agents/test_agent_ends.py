"""How an agent ends that somebody outside kills, or that uses more of the host than its manifest allows: by its own fault
only where nobody can tell, and the session says what it was.
"""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rungs import BARE, CONFINING
from started_agents import end_of_session

from bench.agents import LocalProcess, open_agent
from bench.agents.confinement import this_host
from bench.contracts import (
    AgentExit,
    AgentLimits,
    AgentPlan,
    AgentProcess,
    BenchTraceback,
    Outcome,
    SessionResult,
)


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

    return end_of_session(folder, rung, "import time; time.sleep(600)", open_and_kill)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_box_that_is_killed_is_no_crash_of_its_agent(number: signal.Signals, tmp_path: Path) -> None:
    end = end_of_killed("landlock", outermost, number, tmp_path)
    assert end.outcome is Outcome.BENCH_ERROR, end.reason
    words = "the launcher of landlock was killed by somebody outside, and the agent with it"
    assert end.reason == words
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


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (MEMORY_HOG, "used more than its limit of 96 MB of memory"),
        # No control group is needed; the agent is refused more, and its last words say so.
        (ONE_LARGE_PROCESS, "MemoryError|96 MB of memory"),
        (FORK_BOMB, "temporarily unavailable"),
        (THREADS, "start new thread"),
        # Refused by the file system, or killed by the watch.
        (FILL_DISK, "No space left on device"),
    ],
    ids=["memory of all", "memory of one", "processes", "threads", "disk"],
)
@pytest.mark.parametrize("rung", CONFINING)
def test_who_uses_more_than_its_limits_ends_by_it(code: str, words: str, rung: str, tmp_path: Path) -> None:
    """Refused more or killed, and the outcome names the agent and its limit, not the host."""
    host = this_host(own_network=True)
    if code == MEMORY_HOG and not host.memory_groups:
        pytest.skip("this process may make no control group with a limit on memory")
    if code in (FORK_BOMB, THREADS) and host.root and not host.process_groups:
        pytest.skip("the root user's processes are counted by control groups alone, which it may not make")
    if code == FILL_DISK and rung == BARE:
        words = "used more than its limit of 8 MB in its folder"
    limits = AgentLimits(memory_mb=96, processes=24, scratch_mb=8)
    end = end_of_session(tmp_path, rung, code, limits=limits)
    assert end.outcome is Outcome.AGENT_CRASHED, end.reason
    assert re.search(words, end.reason)
