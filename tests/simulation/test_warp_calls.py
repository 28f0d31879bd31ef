"""Calls that wait for a moment, under the library and a driven clock: the answers of the real calls, and exact spans."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from warp_host import library_or_skip

from bench.contracts import AgentUsage, ProcessRoot, SimTime
from bench.simulation._agent_time import AgentTime
from bench.simulation._host_clock import HOST_CLOCK
from bench.simulation.warp import Warp, open_warp
from bench.simulation.warp._pace import GRAIN_NS

pytestmark = pytest.mark.process
CALLS = Path(__file__).with_name("waiting_calls.py")
UTC_NS = 1_782_041_400 * 10**9


@dataclass(frozen=True)
class Call:
    """What one call answered, and how long it took by the process's monotonic and wall clocks."""

    answer: Any
    span_ns: int
    wall_ns: int


def parsed(lines: str) -> dict[str, Call]:
    return {name: Call(*values) for name, *values in map(json.loads, lines.splitlines())}


class Ended(Exception):
    """The program has ended."""


def flown(program: list[str], folder: Path, output: Path) -> int:
    """Fly a program under warp, a simulated second at a time, until it ends; its exit code."""
    with (
        open_warp(folder, UTC_NS, HOST_CLOCK) as warp,
        output.open("wb") as file,
        subprocess.Popen(program, env=environment_of(warp), stdout=file) as process,
    ):

        def check() -> None:
            if process.poll() is not None:
                raise Ended

        root = ProcessRoot(process.pid, is_box=False)
        warp.watch(root, check, AgentTime(HOST_CLOCK, AgentUsage), with_bench=False)
        with suppress(Ended):
            for second in range(1, 1000):
                warp.settle()
                warp.run_until(SimTime(second * 10**9))
            process.kill()
        return process.wait()


def environment_of(warp: Warp) -> dict[str, str]:
    return {
        "PATH": os.environ["PATH"],
        "LD_PRELOAD": str(warp.access.library),
        "REBAR_WARP_CLOCK": str(warp.access.clock),
        "REBAR_WARP_WAITERS": str(warp.access.waiters),
    }


def test_each_call_answers_as_the_real_one_and_takes_exactly_its_span(tmp_path: Path) -> None:
    """All in one process: without the library by ten milliseconds of the host's, with it by one simulated second."""
    library_or_skip()
    program = [sys.executable, "-I", "-S", str(CALLS)]
    real = parsed(subprocess.run([*program, "0.01"], stdout=subprocess.PIPE, text=True, check=True).stdout)
    output = tmp_path / "output"
    assert flown([*program, "1"], tmp_path / "scratch", output) == 0
    warped = parsed(output.read_text())
    assert len(warped) >= 40
    # Of these a busy host changes the real answer.
    by_speed = {
        "nanosleep, interrupted": [[-1, 4], 2],
        "timerfd": [[1, 1, 1], 1],
        "an event comes": True,
        "two threads": ["early", "late"],
    }
    expected = {name: call.answer for name, call in real.items()} | by_speed
    assert {name: warped[name].answer for name in real} == expected
    assert (warped["sleep"].answer, warped["alarm"].answer) == (0, [14])
    late = {name: call for name, call in warped.items() if not 10**9 <= call.span_ns <= 10**9 + GRAIN_NS}
    assert not late
    assert all(call.wall_ns == call.span_ns for call in warped.values())


def test_time_goes_on_by_itself_after_the_session(tmp_path: Path) -> None:
    """An agent that is asked to end may still sleep: nobody sets its clock any more."""
    library_or_skip()
    with open_warp(tmp_path, UTC_NS, HOST_CLOCK) as warp:
        text = "import time; t = time.monotonic(); time.sleep(0.02); print(time.monotonic() - t)"
        program = [sys.executable, "-I", "-S", "-c", text]
        with subprocess.Popen(
            program, env=environment_of(warp), stdout=subprocess.PIPE, text=True
        ) as process:
            agent_time = AgentTime(HOST_CLOCK, AgentUsage)
            warp.watch(ProcessRoot(process.pid, is_box=False), lambda: None, agent_time, with_bench=False)
            warp.settle()
            assert process.poll() is None
            warp.release()
            slept, _ = process.communicate(timeout=120)
    assert float(slept) >= 0.02
