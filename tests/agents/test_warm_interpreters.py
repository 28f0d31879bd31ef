"""An agent that is forked from a warm interpreter is what a fresh process would be, but sooner."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from rungs import BARE, rung_or_skip

from agent_adapters.manifests import null_random
from bench.agents import LocalProcess, open_agent
from bench.agents.confinement import _landlock, rungs
from bench.agents.confinement._landlock_launch import children_of
from bench.campaign import load_measurable_decomposition
from bench.campaign.execution._flight import fly_here
from bench.contracts import AgentEndpoints, AgentManifest, AgentPlan, AgentStart, Outcome
from bench.errors import AgentBoxKilled
from bench.realization import place
from bench.simspec import Point, Polygon, SimSpec, World, load_simspec

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"

# Long enough for a loaded host; no test waits so long unless it fails.
PATIENCE_S = 60.0
STATE = """
import json, os, random, sys, threading
import numpy
def is_open(number):
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
state = {
    "environment": dict(os.environ), "arguments": sys.argv[1:], "path": sys.path, "folder": os.getcwd(),
    "descriptors": [number for number in range(256) if is_open(number)],
    "user": (os.getuid(), os.getgid(), os.getgroups()), "name": __name__, "hash": hash("a word"),
    "session": os.getsid(0) == os.getpid(), "threads": threading.active_count(), "unbuffered": sys.stdout.write_through,
    "signals": [str(signal) for signal in __import__("signal").pthread_sigmask(0, [])],
    "left": [name for name in ("left_behind",) if hasattr(numpy, name)],
}
numpy.left_behind = True
draws = random.random(), float(numpy.random.random())
print(json.dumps({"state": state, "draws": draws}))
"""


@pytest.fixture(autouse=True, params=["landlock", BARE])
def _rung(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with rung_or_skip(request.param):
        # The first agent of this process is not forked.
        run(plan(tmp_path_factory.mktemp("first"), ""))
        yield


def plan(folder: Path, script: str, reset: str = "fork", **fields: Any) -> AgentPlan:
    (folder / "agent.py").write_text(script)
    command = ("{python}", str(folder / "agent.py"), "one", "two")
    manifest = AgentManifest(
        name="warm", command=command, isolation="landlock", zenoh=False, **{"reset": reset, **fields}
    )
    corners = tuple(Point(east_m=e, north_m=n) for e, n in ((0, 0), (100, 0), (100, 100)))
    spec = SimSpec(name="warm", world=World(area=Polygon(corners=corners)))
    ends = AgentEndpoints({}, None, "", "", 0, None)
    return AgentPlan(manifest, folder, spec, ends, folder / "home")


def awaited_code(agent: LocalProcess) -> int:
    deadline = time.monotonic() + PATIENCE_S
    while (code := agent.exit_code()) is None:
        assert time.monotonic() < deadline, agent.output_tail()
        time.sleep(0.005)
    return code


def run(started: AgentPlan) -> tuple[int, str, bool]:
    """Exit code, output, and whether it was forked."""
    with open_agent(started) as agent:
        code, is_forked = awaited_code(agent), agent.is_forked
    return code, agent.output().decode(), is_forked


def test_a_forked_agent_finds_what_a_fresh_one_finds_each_time(tmp_path: Path) -> None:
    """Environment, arguments, search path, descriptors, user; and nothing of the session before but no random draw."""
    found = []
    for reset in ("process", "fork", "fork"):
        code, output, is_forked = run(plan(tmp_path, STATE, reset, environment={"MODE": "two words"}))
        assert (code, is_forked) == (0, reset == "fork"), output
        found.append(json.loads(output))
    states = [answer["state"] for answer in found]
    assert states[1] == states[2] == states[0]
    assert states[0]["environment"]["MODE"] == "two words"
    assert states[0]["left"] == []
    for draws in zip(*(answer["draws"] for answer in found), strict=True):
        assert len(set(draws)) == 3


def test_nothing_of_a_manifest_runs_outside_of_the_walls(tmp_path: Path) -> None:
    """The dynamic linker and Python run code that their variables name: the interpreter starts without the manifest's."""
    for name in ("LD_PRELOAD", "LD_DEBUG_OUTPUT", "PYTHONPATH", "PYTHONPYCACHEPREFIX"):
        with pytest.raises(ValidationError, match=f"environment: {name} would come too late for reset: fork"):
            plan(tmp_path, "", environment={name: "x"})
        plan(tmp_path, "", "process", environment={name: "x"})
    script = "import os, time; print(os.environ['MODE'], flush=True); time.sleep(600)"
    with open_agent(plan(tmp_path, script, environment={"MODE": "manifest"})) as agent:
        parent = Path(f"/proc/{agent.pid}/stat").read_text().rpartition(")")[2].split()[1]
        assert b"MODE=" not in Path(f"/proc/{parent}/environ").read_bytes()
        deadline = time.monotonic() + PATIENCE_S
        while agent.output() != b"manifest\n":
            assert time.monotonic() < deadline, agent.output_tail()
            time.sleep(0.005)


def test_its_end_is_known_as_that_of_a_process(tmp_path: Path) -> None:
    """Exit codes, a traceback, a signal; and the CPU time of an agent that has ended."""
    ends = {
        "import sys; sys.exit(3)": (3, ""),
        "import sys; sys.exit('no place to land')": (1, "no place to land"),
        "raise OSError('broken')": (1, "OSError: broken"),
        "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)": (-signal.SIGSEGV, ""),
        "import atexit; atexit.register(print, 'last words')": (0, "last words"),
    }
    for script, (expected, words) in ends.items():
        code, output, is_forked = run(plan(tmp_path, script))
        assert (code, is_forked) == (expected, True), output
        assert words in output


def test_an_interpreter_that_was_killed_is_replaced(tmp_path: Path) -> None:
    """And its agent ends with it, as one whose launcher was killed."""
    with open_agent(plan(tmp_path, "import time; time.sleep(600)")) as agent:
        parent = int(Path(f"/proc/{agent.pid}/stat").read_text().rpartition(")")[2].split()[1])
        assert parent != os.getpid()
        os.kill(parent, signal.SIGKILL)
        if _landlock.namespaces_fault() is None:
            with pytest.raises(AgentBoxKilled, match="the launcher of landlock"):
                awaited_code(agent)
        else:
            assert awaited_code(agent) == -signal.SIGKILL
    assert run(plan(tmp_path, "print('here')")) == (0, "here\n", True)


def test_a_process_that_starts_one_agent_starts_no_interpreter(tmp_path: Path) -> None:
    rungs.cache_clear()
    begun = set(children_of(os.getpid()))
    assert run(plan(tmp_path, "print('here')")) == (0, "here\n", False)
    assert set(children_of(os.getpid())) == begun
    for _ in range(2):
        assert run(plan(tmp_path, "print('here')")) == (0, "here\n", True)
    assert len(set(children_of(os.getpid())) - begun) == 1


def test_a_collection_in_a_fork_leaves_alone_what_the_interpreter_has_loaded(tmp_path: Path) -> None:
    """It would write to every page of it."""
    script = "import gc, sys; print('numpy' in sys.modules, gc.get_freeze_count() > 10_000, len(gc.get_objects()) < 10_000)"
    assert run(plan(tmp_path, script)) == (0, "True True True\n", True)


def test_only_python_programs_can_be_forked() -> None:
    for command in (("./agent",), ("{python}",), ("{python}", "-m"), ("{python}", "-O", "agent.py")):
        with pytest.raises(ValidationError, match="reset: fork needs a command of the bench's Python"):
            AgentManifest(name="warm", command=command, reset="fork")
    AgentManifest(name="warm", command=("{python}", "-m", "agent"), reset="fork")


def test_a_session_of_a_fork_is_the_session_and_says_so(tmp_path: Path) -> None:
    """The recording is that of a fresh process, to the byte; the result names the fork."""
    shipped = null_random.read_text()
    simspec = load_simspec(EXAMPLE)
    mission = simspec.mission.model_copy(update={"time_limit_s": 1.0})
    placed = place(simspec.model_copy(update={"mission": mission}))
    decomposition = load_measurable_decomposition("search-and-report")
    for reset in ("process", "fork"):
        manifest = tmp_path / reset / "random.yaml"
        manifest.parent.mkdir()
        manifest.write_text(shipped.replace("reset: fork", f"reset: {reset}\nisolation: landlock"))
        agent = placed.agent.model_copy(update={"manifest": str(manifest)})
        flown = placed.model_copy(update={"agent": agent})
        result = fly_here(flown, decomposition, tmp_path / reset, reset)
        assert result.outcome is Outcome.TIME_LIMIT, result.reason
        start = AgentStart(reset="fork", forked=True) if reset == "fork" else None
        assert result.fact(AgentStart) == start
    fresh, forked = (tmp_path / reset / "recording.mcap" for reset in ("process", "fork"))
    assert forked.read_bytes() == fresh.read_bytes()
