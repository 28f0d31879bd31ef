"""The rung `container`: with a stand-in for the engine, which is strict, and with the engine of the host if it has one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from host_image import PYTHON, image_or_skip
from started_agents import exit_code, plan_of, until

from bench.agents import open_agent, program_faults
from bench.agents.confinement import _container as container_module
from bench.agents.confinement import _ladder, rung_of, rungs
from bench.agents.confinement._container import Container
from bench.contracts import AgentLimits, AgentManifest, AgentPlan
from bench.errors import SetupError
from bench.simspec import AgentSpec

FOLDER = Path(__file__).parent
# Each stays under the limit of one process, both together do not. Whichever the kernel kills, the code is the same.
TWO_HOGS = """
import os, time
child = os.fork()
held = bytearray(b"1") * (90 << 20)
if child:
    os.wait()
    os._exit(137)
time.sleep(60)
"""


@pytest.fixture
def engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The stand-in as `podman`, and the rung that uses it."""
    folder = tmp_path / "bin"
    folder.mkdir()
    shutil.copy(FOLDER / "engine.py", folder / "engine.py")
    program = folder / "podman"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "{folder}/engine.py" "$@"\n')
    program.chmod(0o755)
    chosen = dict(rungs()) | {"container": Container(str(program))}
    monkeypatch.setattr(_ladder, "rungs", lambda: chosen)
    return folder / "engine-state"


def plan(scratch: Path, *command: str, image: str = "agents/one:1", **environment: str) -> AgentPlan:
    manifest = AgentManifest(
        name="boxed",
        command=command,
        environment=environment,
        isolation="container",
        image=image,
        zenoh=False,
    )
    return plan_of(manifest, FOLDER, scratch)


def test_two_agents_in_two_images(engine: Path, tmp_path: Path) -> None:
    """Exit codes and output are their own; the environment holds nothing of the bench's, and the engine's nothing of the manifest's."""
    for number, image in enumerate(("agents/one:1", "agents/two:2"), start=3):
        scratch = tmp_path / f"agent{number}"
        show = (
            f"echo $REBAR_MAVLINK $HOME $MODE $CONTAINERS_CONF; test -z $PYTEST_CURRENT_TEST; exit {number}"
        )
        stated = {"MODE": "fast", "CONTAINERS_CONF": "mine"}
        with open_agent(plan(scratch, "sh", "-c", show, image=image, **stated)) as agent:
            assert exit_code(agent) == number
            assert agent.exceeded_limit() == ""
        assert agent.output().decode() == "udpin:127.0.0.1:14540 /scratch fast mine\n"
    assert list(engine.glob("*.json")) == []


def test_what_cannot_start_says_why(engine: Path, tmp_path: Path) -> None:
    """An image that is not here, and a program that is not in the image; an agent may end with the same code."""
    for part, command, image, words in (
        ("a", ("sh",), "agents/none:9", "image not known"),
        ("b", ("/nowhere/agent",), "agents/one:1", "No such file"),
    ):
        with (
            open_agent(plan(tmp_path / part, *command, image=image)) as agent,
            pytest.raises(SetupError, match=words),
        ):
            exit_code(agent)
    with open_agent(plan(tmp_path / "c", "sh", "-c", "exit 127")) as agent:
        assert exit_code(agent) == 127


def test_the_engine_ends_what_still_runs(engine: Path, tmp_path: Path) -> None:
    """Asked first, and then removed by name; its usage is counted meanwhile. A container of a dead bench goes too."""
    gone = subprocess.Popen(["true"])
    gone.wait()
    engine.mkdir()
    (engine / f"rebar-agent-{gone.pid}-0.json").write_text('{"Pid": 0}')
    (engine / f"rebar-agent-{os.getpid()}-999999.json").write_text('{"Pid": 0}')
    with open_agent(
        plan(tmp_path / "a", "sh", "-c", "trap 'echo asked; exit 0' TERM; while :; do :; done")
    ) as agent:
        until(lambda: agent.usage().cpu_s > 0.02)
        assert [path.stem for path in engine.glob("*-999999.json")]
        assert not (engine / f"rebar-agent-{gone.pid}-0.json").exists()
    assert agent.output() == b"asked\n"
    assert len(list(engine.glob("*.json"))) == 1


def test_memory_is_named(engine: Path, tmp_path: Path) -> None:
    """What the engine states of two that were killed: one for its memory, one for another reason."""
    named = {}
    for part, environment in (("a", {"OOM": "1"}), ("b", {})):
        with open_agent(plan(tmp_path / part, "sh", "-c", "kill -9 $$", **environment)) as agent:
            exit_code(agent)
            named[part] = agent.exceeded_limit()
    assert named == {"a": "2048 MB of memory", "b": ""}


def test_a_manifest_without_an_image_is_refused(engine: Path) -> None:
    """Asked for by the manifest, and demanded by the campaign."""
    manifest = AgentManifest(name="bare", command=("true",), isolation="container")
    with pytest.raises(SetupError, match=r"bare: isolation: the manifest of bare names no image.*add image"):
        rung_of(manifest, AgentSpec())
    with pytest.raises(SetupError, match=r"agent\.isolation: the manifest"):
        rung_of(manifest.model_copy(update={"isolation": "auto"}), AgentSpec(isolation="container"))
    assert rung_of(manifest.model_copy(update={"image": "agents/one:1"}), AgentSpec()).name == "container"


def test_programs_of_an_image_are_not_looked_for_on_the_host(tmp_path: Path) -> None:
    """With and without an image."""
    manifest = AgentManifest(name="far", command=("/in/the/image/agent",), image="agents/one:1")
    assert program_faults(manifest, tmp_path, {}) == []
    assert len(program_faults(manifest.model_copy(update={"image": ""}), tmp_path, {})) == 1


def test_a_host_that_cannot_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No engine, one that does not answer, and docker beside a network of the session's own."""
    assert "no engine" in (Container("").trial() or "")
    program = tmp_path / "docker"
    program.write_text("#!/bin/sh\necho 'Cannot connect to the Docker daemon' >&2\nexit 1\n")
    program.chmod(0o755)
    assert "Cannot connect" in (Container(str(program)).trial() or "")
    monkeypatch.setattr(container_module, "namespace_fault", lambda: None)
    assert "network of their own" in (Container(str(program)).trial() or "")


def test_the_engine_of_this_host(tmp_path: Path) -> None:
    """Exit codes, both reasons not to start, all its memory, and what is left: nothing. The escape probe tries its walls."""
    image = image_or_skip()
    engine = shutil.which("podman") or "docker"

    def ended(part: str, *command: str, image: str = image) -> tuple[int | None, str, str]:
        agent_plan = plan(tmp_path / part, *command, image=image)
        small = agent_plan.manifest.model_copy(update={"limits": AgentLimits(memory_mb=128)})
        with open_agent(replace(agent_plan, manifest=small)) as agent:
            end = exit_code(agent), agent.exceeded_limit()
        return *end, agent.output().decode()

    assert ended("a", "/bin/sh", "-c", "echo $REBAR_MAVLINK $HOME; exit 3") == (
        3,
        "",
        "udpin:127.0.0.1:14540 /scratch\n",
    )
    assert ended("b", "/bin/sh", "-c", "exit 127") == (127, "", "")
    assert ended("c", PYTHON, "-I", "-S", "-c", TWO_HOGS)[:2] == (137, "128 MB of memory")
    with pytest.raises(SetupError, match=r"not known|[Nn]o such image"):
        ended("d", "/bin/sh", image="localhost/rebar-tests/none:9")
    with pytest.raises(SetupError, match="cannot be started in the image"):
        ended("e", "/nowhere/agent")
    listed = subprocess.run(
        [engine, "ps", "--all", "--format", "{{.Names}}"], capture_output=True, text=True, check=True
    )
    assert f"rebar-agent-{os.getpid()}-" not in listed.stdout
