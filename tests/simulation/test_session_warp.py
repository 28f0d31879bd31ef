"""Sessions in warp: an agent that knows nothing of the bench lives by the session's clock, or is refused."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from rungs import CONFINING, rung_or_skip
from test_session import run, session_simspec
from warp_host import library_or_skip

from bench.contracts import AgentManifest, Outcome, SessionResult, WarpLibrary
from bench.simspec import AgentSpec, Budgets, Environment, Isolation, Mission, OutsideService, Pace, SimSpec

pytestmark = pytest.mark.process

SLEEPER = """
import datetime, subprocess, threading, time
start = time.monotonic()
print(datetime.datetime.fromtimestamp(time.time(), datetime.timezone.utc).isoformat())
for _ in range(3):
    time.sleep(0.123)
    print(f"{time.monotonic() - start:.6f}")
threading.Event().wait(0.25)
print(f"{time.monotonic() - start:.6f}")
subprocess.run(["sleep", "0.5"])
print(f"{time.monotonic() - start:.6f}")
"""


def manifest_of(*command: str, isolation: Isolation = "none") -> AgentManifest:
    return AgentManifest(name="plain", command=command, pace=("warp",), zenoh=False, isolation=isolation)


def warped(limit_s: float, **changes: object) -> SimSpec:
    return session_simspec(pace=Pace(mode="warp"), mission=Mission(time_limit_s=limit_s), **changes)


def flown(folder: Path, manifest: AgentManifest, spec: SimSpec) -> tuple[SessionResult, list[str]]:
    library_or_skip()
    end, _ = run(folder, manifest, spec)
    log = folder / "agent.log"
    return end, log.read_text().splitlines() if log.exists() else []


# LD_PRELOAD is split at spaces and colons. Most rungs show the agent another folder than the host's.
@pytest.mark.parametrize(
    ("rung", "folder"),
    [("none", "plain"), ("none", "a space"), *((rung, "a space:a colon") for rung in CONFINING)],
)
def test_the_clock_of_an_agent_is_the_session_clock_on_every_rung(
    rung: str, folder: str, tmp_path: Path
) -> None:
    """Its sleeps, threads and children last as long as they should to the microsecond, whatever the host does."""
    home = tmp_path / folder
    home.mkdir()
    with rung_or_skip(rung) as isolation:
        end, lines = flown(home, manifest_of("{python}", "-c", SLEEPER, isolation=isolation), warped(3.0))
    started, *spans = lines
    assert started == Environment().start_utc.isoformat()
    assert spans[:4] == ["0.123000", "0.246000", "0.369000", "0.619000"]
    assert float(spans[4]) == pytest.approx(1.119, abs=0.002)
    assert end.outcome is Outcome.COMPLETED
    assert end.simulated_s == pytest.approx(1.12, abs=0.021)
    library = end.fact(WarpLibrary)
    assert library is not None
    assert library.description.startswith("library sha256:")
    assert end.counters["warp_by_cpu_ms"] == 0


def test_an_agent_that_computes_without_end_is_paced_by_its_processor_time(tmp_path: Path) -> None:
    """It never waits, so its clock goes on as fast as it computes: 0.3 s are flown in as much of it."""
    budgets = Budgets(wall_s=3600.0, connect_s=0.1)
    spec = warped(0.3, budgets=budgets)
    end, _ = flown(tmp_path, manifest_of("{python}", "-S", "-c", "while True: pass"), spec)
    assert end.outcome is Outcome.TIME_LIMIT
    assert 260 <= end.counters["warp_by_cpu_ms"] <= 300
    assert end.agent_cpu_s >= 0.3


def test_an_agent_that_only_looks_at_the_time_flies_as_fast_as_others(tmp_path: Path) -> None:
    """Loops that ask the clock or a socket again and again until a moment has come: they wait, and compute nothing."""
    text = (
        "import socket, time\nend = time.monotonic() + 0.3\nwhile time.monotonic() < end: pass\n"
        "mine, _ = socket.socketpair(); mine.setblocking(False)\nsoon = time.monotonic() + 0.2\n"
        "while time.monotonic() < soon:\n try: mine.recv(1)\n except BlockingIOError: pass\n"
        "print(round(time.monotonic() - end, 3))"
    )
    end, lines = flown(tmp_path, manifest_of("{python}", "-S", "-c", text), warped(1.0))
    assert lines == ["0.2"]
    assert end.outcome is Outcome.COMPLETED
    assert end.counters["warp_by_cpu_ms"] == 0


def test_a_program_without_the_library_is_refused_and_not_flown(tmp_path: Path) -> None:
    """A child for which LD_PRELOAD was cleared: the session does not count, since nothing was flown."""
    script = "env -u LD_PRELOAD sleep 1000 & wait"
    end, _ = flown(tmp_path, manifest_of("sh", "-c", script), warped(3.0))
    assert end.outcome is Outcome.SETUP_INVALID
    assert "sleep runs without the library for warp" in end.reason
    assert end.simulated_s == 0.0


def test_a_static_program_is_refused_also_as_what_a_script_becomes(tmp_path: Path) -> None:
    source, program = tmp_path / "wait.c", tmp_path / "wait"
    source.write_text("#include <unistd.h>\nint main(void) { return pause(); }\n")
    compiler = shutil.which("cc")
    if (
        compiler is None
        or subprocess.run(
            [compiler, "-static", "-o", program, source], stderr=subprocess.DEVNULL, check=False
        ).returncode
    ):
        pytest.skip("no static program can be built here")
    end, _ = flown(tmp_path, manifest_of("sh", "-c", f"exec {program}"), warped(3.0))
    assert end.outcome is Outcome.SETUP_INVALID
    assert f"{program} cannot fly in warp: it is statically linked" in end.reason


def test_an_agent_with_services_outside_is_refused(tmp_path: Path) -> None:
    library_or_skip()
    service = OutsideService(name="llm", host="127.0.0.1", port=9)
    spec = warped(3.0, agent=AgentSpec(manifest="fake", services=(service,)))
    end, _ = run(tmp_path, manifest_of("sleep", "1000"), spec)
    assert end.outcome is Outcome.SETUP_INVALID
    assert "agent.services" in end.reason
