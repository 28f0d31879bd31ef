"""An agent as a process: what it is given, what is kept of it, and that it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rungs import EVERY, rung_or_skip

from bench.agents import LocalProcess, load_manifest, open_agent, program_faults
from bench.agents._program import expand_command, expand_placeholders
from bench.agents.confinement import rungs
from bench.contracts import AgentEndpoints, AgentManifest, AgentPlan
from bench.errors import SetupError
from bench.simspec import AgentSpec, Isolation, Point, Polygon, SimSpec, World

PATIENCE_S = 20.0


@pytest.fixture(params=EVERY)
def isolation(request: pytest.FixtureRequest) -> Iterator[Isolation]:
    """Each rung that starts on this host; what a test says of agents holds on all."""
    with rung_or_skip(request.param) as isolation:
        yield isolation


def simspec(**options: str | float | int | bool) -> SimSpec:
    corners = tuple(Point(east_m=e, north_m=n) for e, n in ((0, 0), (100, 0), (100, 100)))
    return SimSpec(
        name="meadow", world=World(area=Polygon(corners=corners)), agent=AgentSpec(options=options)
    )


def plan(
    scratch: Path,
    *command: str,
    environment: dict[str, str] | None = None,
    isolation: Isolation = "none",
    **options: str | float | int | bool,
) -> AgentPlan:
    endpoints = AgentEndpoints(
        {"REBAR_MAVLINK": "udpin:127.0.0.1:14540"}, "tcp/127.0.0.1:7447", "agent", "secret", 1, "127.0.0.1:9"
    )
    manifest = AgentManifest(
        name="probe", command=command, environment=environment or {}, isolation=isolation
    )
    return AgentPlan(manifest, scratch.parent, simspec(**options), endpoints, scratch)


def python(scratch: Path, code: str, **options: Any) -> AgentPlan:
    return plan(scratch, "{python}", "-c", code, **options)


def wait_for_end(agent: LocalProcess) -> int:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        code = agent.exit_code()
        if code is not None:
            return code
        os.sched_yield()
    raise AssertionError("the agent did not end")


def wait_for_output(agent: LocalProcess) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not agent.output_tail():
        assert time.monotonic() < deadline, "the agent wrote nothing"
        time.sleep(0.002)


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def has_ended(pid: int) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while is_running(pid) and time.monotonic() < deadline:
        os.sched_yield()
    return not is_running(pid)


def test_an_agent_gets_only_the_documented_environment(
    tmp_path: Path, isolation: Isolation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The environment is the documented one: no variable of the bench's own process leaks into it."""
    monkeypatch.setenv("SECRET_OF_THE_BENCH", "1")
    code = "import os, json; print(json.dumps(dict(os.environ)))"
    with open_agent(python(tmp_path / "agent", code, height=40, gentle=True, isolation=isolation)) as agent:
        assert wait_for_end(agent) == 0
    environment = json.loads(agent.output())

    assert environment.pop("LC_CTYPE", "C.UTF-8") == "C.UTF-8"
    # A landlocked agent may not write to the host's /tmp.
    assert environment.pop("TMPDIR", environment["HOME"]) == environment["HOME"]
    assert set(environment) == {
        "PATH", "HOME", "LANG", "PYTHONHASHSEED", "PYTHONUNBUFFERED", "ROS_DOMAIN_ID",
        "REBAR_VEHICLE", "REBAR_OPTIONS", "REBAR_SEED", "REBAR_ZENOH", "REBAR_ZENOH_USER", "REBAR_ZENOH_PASSWORD",
        "REBAR_TICK", "REBAR_TICK_SECRET", "REBAR_MAVLINK",
    }  # fmt: skip
    assert environment["HOME"] == rungs()[isolation].place(tmp_path / "agent").home
    assert json.loads(environment["REBAR_OPTIONS"]) == {"height": 40, "gentle": True}
    assert environment["REBAR_MAVLINK"] == "udpin:127.0.0.1:14540"


def test_placeholders_are_filled_in(tmp_path: Path, isolation: Isolation) -> None:
    """{folder} and {option:NAME} reach the command and the environment, booleans as true and false."""
    code = "import os, sys; print(*sys.argv[1:], os.environ['MODE'])"
    agent_plan = plan(
        tmp_path / "agent", "{python}", "-c", code, "{folder}/x", "{option:speed}", environment={"MODE": "{option:fast}"}, isolation=isolation,
        speed=3.5, fast=True,
    )  # fmt: skip
    with open_agent(agent_plan) as agent:
        assert wait_for_end(agent) == 0
    assert agent.output().decode().split() == [f"{tmp_path}/x", "3.5", "true"]


def test_every_missing_option_is_named(tmp_path: Path) -> None:
    """A manifest that needs options the SimSpec lacks is a setup error that lists all of them."""
    with pytest.raises(SetupError) as caught, open_agent(plan(tmp_path, "{option:a}", "{option:b}", c=1)):
        pass
    assert len(caught.value.faults) == 2
    assert "there now: c" in str(caught.value)


def test_a_crash_leaves_its_code_and_last_words(tmp_path: Path, isolation: Isolation) -> None:
    """What a crashing agent said last is there for the report, and its exit code or signal."""
    with open_agent(
        python(tmp_path / "a", "raise ValueError('lost the plot')", isolation=isolation)
    ) as agent:
        assert wait_for_end(agent) == 1
    assert "lost the plot" in agent.output_tail()
    with open_agent(
        python(tmp_path / "b", "import os; os.kill(os.getpid(), 6)", isolation=isolation)
    ) as agent:
        assert wait_for_end(agent) == -signal.SIGABRT


def test_a_program_that_is_not_there_says_so(tmp_path: Path, isolation: Isolation) -> None:
    """A program that cannot be started is a wrong set-up, and none of the agent's doing."""
    with (
        open_agent(plan(tmp_path, "/nowhere/agent", isolation=isolation)) as agent,
        pytest.raises(SetupError, match="/nowhere/agent cannot be started: No such file"),
    ):
        wait_for_end(agent)
    assert agent.output_tail().endswith("No such file or directory\n")


def test_an_agent_may_end_with_the_code_of_a_missing_program(tmp_path: Path, isolation: Isolation) -> None:
    """127 from a program that did start is an exit code as any other."""
    with open_agent(python(tmp_path, "raise SystemExit(127)", isolation=isolation)) as agent:
        assert wait_for_end(agent) == 127


def test_missing_programs_scripts_and_modules_are_known_without_starting_them(tmp_path: Path) -> None:
    """Each of two kinds of command with and without its files; nothing is run or imported."""
    (tmp_path / "agent.py").touch()

    def faults(*command: str, **options: str) -> list[str]:
        manifest = AgentManifest(name="agent", command=command, environment={"MODE": "{option:mode}"})
        return [fault.what for fault in program_faults(manifest, tmp_path, options or {"mode": "x"})]

    for command in (("sh", "-c", "true"), ("{python}", "{folder}/agent.py"), ("{python}", "-m", "bench.cli")):
        assert faults(*command) == []
    assert faults("{folder}/agent.py") == [f"{tmp_path}/agent.py is not executable"]
    assert faults("{folder}/gone") == [f"there is no program '{tmp_path}/gone'"]
    assert faults("no-such-program") == ["there is no program 'no-such-program'"]
    assert faults("{python}", "{folder}/gone.py") == [f"there is no file {tmp_path}/gone.py"]
    assert faults("{python}", "-m", "bench.no_such") == ["there is no Python module 'bench.no_such'"]
    assert faults("{python}", "-m", "no_such.agent") == ["there is no Python module 'no_such.agent'"]
    assert "needs the option 'mode'" in faults("sh", other="y")[0]
    # Relative to the manifest's folder, whatever the present one is.
    assert faults("{python}", "agent.py") == []
    assert faults("./agent.py") == [f"{tmp_path}/agent.py is not executable"]
    assert faults("bin/agent") == [f"there is no program '{tmp_path}/bin/agent'"]
    assert faults("{python}", "-u", "gone.py") == [f"there is no file {tmp_path}/gone.py"]
    (tmp_path / "agent.py").chmod(0o755)
    assert faults("./agent.py") == []
    os.mkfifo(tmp_path / "pipe", 0o755)
    assert faults("./pipe") == [f"there is no program '{tmp_path}/pipe'"]


@pytest.mark.parametrize(
    ("file", "command", "build"),
    [
        ("Makefile", ("./agent",), "`make -C {folder}`"),
        (
            "Cargo.toml",
            ("target/release/agent",),
            "`cargo build --release --manifest-path {folder}/Cargo.toml`",
        ),
        ("Cargo.toml", ("./target/debug/agent",), "`cargo build --manifest-path {folder}/Cargo.toml`"),
        (
            "package.json",
            ("sh", "{folder}/dist/agent.js"),
            "`cd {folder} && npm install && npm run build --if-present`",
        ),
        ("Makefile", ("{python}", "made/agent.py"), "`make -C {folder}`"),
    ],
)
def test_a_program_that_was_not_built_says_how(
    tmp_path: Path, file: str, command: tuple[str, ...], build: str
) -> None:
    """Without such a file, elsewhere, or once it is there, nothing of the kind is said."""
    folder = tmp_path / "a folder"
    folder.mkdir()

    def remedies(*words: str) -> list[str]:
        return [
            fault.remedy for fault in program_faults(AgentManifest(name="agent", command=words), folder, {})
        ]

    assert not any("build it" in remedy for remedy in remedies(*command))
    (folder / file).write_text("")
    quoted = build.replace("{folder}/Cargo.toml", f"'{folder}/Cargo.toml'").replace("{folder}", f"'{folder}'")
    assert remedies(*command) == [f"build it: {quoted}"]
    assert remedies("no-such-program") == ["install it, or correct the command in the manifest"]
    program = folder / command[-1].removeprefix("{folder}/")
    program.parent.mkdir(parents=True, exist_ok=True)
    program.touch(0o755)
    assert remedies(*command) == []


@pytest.mark.parametrize(
    ("command", "looked_up"),
    [
        (("./run.sh", "./x"), ("{here}/run.sh", "./x")),
        (("bin/run", "x"), ("{here}/bin/run", "x")),
        (("/bin/sh", "a/b"), ("/bin/sh", "a/b")),
        (("sh", "./x"), ("sh", "./x")),
        (("{python}", "agent.py", "agent.py"), ("{python}", "{here}/agent.py", "agent.py")),
        (("{python}", "-u", "-X", "dev", "a/agent.py"), ("{python}", "-u", "-X", "dev", "{here}/a/agent.py")),
        (("{python}", "-Wdefault", "agent.py"), ("{python}", "-Wdefault", "{here}/agent.py")),
        (("{python}", "-W", "ignore", "{folder}/a.py"), ("{python}", "-W", "ignore", "{here}/a.py")),
        (("{python}", "-m", "agent", "x.py"), ("{python}", "-m", "agent", "x.py")),
        (("{python}", "-Bum", "agent", "x.py"), ("{python}", "-Bum", "agent", "x.py")),
        (("{python}", "-c", "pass", "x.py"), ("{python}", "-c", "pass", "x.py")),
        (("{python}", "-", "x.py"), ("{python}", "-", "x.py")),
        (("{python}", "-u"), ("{python}", "-u")),
    ],
)
def test_relative_programs_and_scripts_are_of_the_manifests_folder(
    command: tuple[str, ...], looked_up: tuple[str, ...], tmp_path: Path
) -> None:
    """Before, both were looked for in the agent's empty scratch folder. In an image, they are the image's."""
    manifest = AgentManifest(name="agent", command=command)
    known = {"{python}": sys.executable, "{here}": str(tmp_path)}
    expected = [re.sub(r"\{\w+\}", lambda match: known[match[0]], word) for word in looked_up]
    assert list(expand_command(manifest, tmp_path, {})) == expected
    in_image = manifest.model_copy(update={"image": "mine"})
    unchanged = expand_placeholders(
        manifest, tmp_path, {}, {str(place): word for place, word in enumerate(command)}
    )
    assert expand_command(in_image, tmp_path, {}) == tuple(unchanged.values())


def test_a_relative_program_and_a_relative_script_run(tmp_path: Path, isolation: Isolation) -> None:
    """On every rung: the file itself is readable, beside its folder's others that are not."""
    code = (
        "import os, sys\ntry:\n    open(os.path.dirname(__file__) + '/secret.txt')\n    read = True\n"
        "except OSError:\n    read = False\nprint(*sys.argv, read)\n"
    )
    (tmp_path / "own tools").mkdir()
    program, script = tmp_path / "own tools" / "my_agent", tmp_path / "agent.py"
    program.write_text(f"#!{sys.executable}\n{code}")
    program.chmod(0o755)
    script.write_text(code)
    for secret in (tmp_path / "secret.txt", tmp_path / "own tools" / "secret.txt"):
        secret.touch()
    for name, command in {
        "program": ("./own tools/my_agent", "--verbose"),
        "script": ("{python}", "-u", "agent.py", "--verbose"),
    }.items():
        agent_plan = plan(tmp_path / name, *command, isolation=isolation)
        assert program_faults(agent_plan.manifest, agent_plan.folder, {}) == []
        with open_agent(agent_plan) as agent:
            assert wait_for_end(agent) == 0, agent.output_tail()
        path = {"program": program, "script": script}[name]
        assert agent.output_tail().strip() == f"{path} --verbose {isolation == 'none'}"


def test_an_agent_that_ignores_sigterm_is_killed(
    tmp_path: Path, isolation: Isolation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither a hang nor an ignored SIGTERM outlives the block."""
    monkeypatch.setattr("bench.agents._process.GRACE_S", 0.05)
    code = "import signal; signal.signal(15, signal.SIG_IGN); print('ready')\nwhile True: signal.pause()"
    with open_agent(python(tmp_path, code, isolation=isolation)) as agent:
        wait_for_output(agent)
        assert agent.exit_code() is None
    assert agent.exit_code() == -signal.SIGKILL


def test_an_agent_asked_to_end_may_do_so_itself(tmp_path: Path, isolation: Isolation) -> None:
    """SIGTERM comes first, so that an agent can close what it holds."""
    code = (
        "import signal, sys\nsignal.signal(15, lambda *_: (print('goodbye'), sys.exit(0)))\n"
        "print('ready')\nwhile True: signal.pause()"
    )
    with open_agent(python(tmp_path, code, isolation=isolation)) as agent:
        wait_for_output(agent)
    assert agent.exit_code() == 0
    assert agent.output_tail() == "ready\ngoodbye\n"


def descendants(root: int) -> list[int]:
    """Ids of the living processes below one, seen from the host."""
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        children.setdefault(parent, []).append(int(stat.parent.name))
    waiting, found = [root], []
    while waiting:
        waiting += children.get(waiting[0], [])
        found.append(waiting.pop(0))
    return found


def test_child_processes_end_with_the_agent(tmp_path: Path, isolation: Isolation) -> None:
    """A child in the group ends with it, and so does one that made a session of its own."""
    code = (
        "import subprocess, sys, time\n"
        "nap = [sys.executable, '-S', '-c', 'import time; time.sleep(600)']\n"
        "subprocess.Popen(nap); subprocess.Popen(nap, start_new_session=True)\n"
        "print('ready'); time.sleep(600)\n"
    )
    with open_agent(python(tmp_path, code, isolation=isolation)) as agent:
        wait_for_output(agent)
        pids = descendants(agent.pid)
        assert len(pids) >= 3
        assert all(is_running(pid) for pid in pids)
    assert all(has_ended(pid) for pid in pids)


def test_endless_output_is_truncated_in_the_log(tmp_path: Path, isolation: Isolation) -> None:
    """Of endless output the beginning and the end are kept, and the file says how much is not there."""
    code = "import os\nfor n in range(40): os.write(1, b'%06d' % n + b'x' * 65530)\nprint('the end')"
    with open_agent(python(tmp_path, code, isolation=isolation)) as agent:
        assert wait_for_end(agent) == 0
    log = agent.output()
    assert len(log) < 512 * 1024
    assert log.startswith(b"000000x")
    assert log.endswith(b"the end\n")
    assert b"bytes left out" in log


def test_an_endless_flood_does_not_hold_up_the_end(tmp_path: Path, isolation: Isolation) -> None:
    """Leaving the block ends an agent that never stops writing."""
    code = "import os\nprint('ready')\nwhile True: os.write(2, b'x' * 65536)"
    with open_agent(python(tmp_path, code, isolation=isolation)) as agent:
        wait_for_output(agent)
    assert agent.exit_code() == -signal.SIGTERM


def test_cpu_time_counts_the_agent_and_is_kept(tmp_path: Path, isolation: Isolation) -> None:
    """CPU time can be asked while the agent runs and after it has gone, and does not shrink."""
    code = "import time\nwhile time.process_time() < 0.15: pass\nprint('ready')\ntime.sleep(600)"
    with open_agent(python(tmp_path, code, isolation=isolation)) as agent:
        wait_for_output(agent)
        running = agent.usage().cpu_s
    assert 0.1 <= running <= agent.usage().cpu_s < 5.0


def test_manifest_by_path_and_by_wrong_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path gives the document and its folder; a wrong name lists what there is; a bad field is named."""
    file = tmp_path / "mine.yaml"
    file.write_text("name: mine\ncommand: [run-me]\n")
    monkeypatch.chdir(tmp_path)
    manifest, folder = load_manifest("./mine.yaml")
    assert (manifest.name, folder) == ("mine", tmp_path.resolve())
    with pytest.raises(SetupError, match="no plug-in named 'nobody'"):
        load_manifest("nobody")
    file.write_text("name: mine\ncommand: []\nspeed: 3\n")
    with pytest.raises(SetupError) as caught:
        load_manifest(file)
    assert len(caught.value.faults) == 2


@pytest.mark.parametrize("name", ["reference-naive", "reference-bystander-aware"])
def test_the_reference_manifests_are_installed(name: str) -> None:
    """Both agents are found by name, can be paced, and differ by their policy alone."""
    manifest, _ = load_manifest(name)
    assert manifest.name == name
    assert "lockstep" in manifest.pace
    assert manifest.command[-1] == name.removeprefix("reference-").replace("-", "_")
