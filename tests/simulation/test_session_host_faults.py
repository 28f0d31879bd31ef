"""Ends of sessions that the host caused are not put down to the agent."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from test_session import run

from bench.contracts import AgentManifest, Outcome
from bench.simulation._host_resources import count_memory_kills


def counts(*readings: int) -> Callable[[], int]:
    """A counter that is read once at the start and once at the end of a session."""
    remaining = iter(readings)
    return lambda: next(remaining)


@pytest.mark.parametrize(
    ("number", "kills", "outcome"),
    [
        (9, counts(4, 5), Outcome.BENCH_ERROR),
        (9, counts(4, 4), Outcome.AGENT_CRASHED),
        (15, counts(4, 5), Outcome.AGENT_CRASHED),
    ],
)
def test_an_agent_that_the_kernel_killed_for_memory_is_not_blamed(
    tmp_path: Path, number: int, kills: Callable[[], int], outcome: Outcome
) -> None:
    """Only SIGKILL counts, and only while the kernel's count of such kills rose."""
    code = f"import os; os.kill(os.getpid(), {number})"
    manifest = AgentManifest(name="killed", command=("{python}", "-c", code), pace=("lockstep",))
    end, _ = run(tmp_path, manifest, memory_kills=kills)
    assert end.outcome is outcome, end.reason
    assert ("out of memory" in end.reason) is (outcome is Outcome.BENCH_ERROR)


def test_memory_kills_are_read_from_the_kernel(tmp_path: Path) -> None:
    """The line of that name alone; 0 without the file, the line or a number."""
    vmstat = tmp_path / "vmstat"
    assert count_memory_kills(vmstat) == 0
    for text, kills in (
        ("oom_kill_disable 7\nnr_free_pages 12\n", 0),
        ("nr_free_pages 12\noom_kill 3\n", 3),
        ("oom_kill many\n", 0),
    ):
        vmstat.write_text(text)
        assert count_memory_kills(vmstat) == kills
