"""An agent as a process: what it is given, what is kept of it, and that it ends."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rungs import EVERY, rung_or_skip

from bench.agents import LocalProcess, load_manifest, open_agent, program_faults
from bench.agents._program import expand_command, expand_placeholders
from bench.agents.confinement import rungs
from bench.contracts import AgentEndpoints, AgentManifest, AgentPlan
from bench.errors import SetupError
from bench.simspec import Isolation, SimSpec

PATIENCE_S = 20.0


@pytest.fixture(params=EVERY)
def isolation(request: pytest.FixtureRequest) -> Iterator[Isolation]:
    """Each rung that starts on this host; what a test says of agents holds on all."""
    with rung_or_skip(request.param) as isolation:
        yield isolation


def plan(
    scratch: Path,
    *command: str,
    environment: dict[str, str] | None = None,
    isolation: Isolation = "none",
    **options: str | float | int | bool,
) -> AgentPlan:
    corners = [{"east_m": e, "north_m": n} for e, n in ((0, 0), (100, 0), (100, 100))]
    spec = SimSpec.model_validate(
        {"name": "meadow", "world": {"area": {"corners": corners}}, "agent": {"options": options}}
    )
    endpoints = AgentEndpoints(
        {"REBAR_MAVLINK": "udpin:127.0.0.1:14540"}, "tcp/127.0.0.1:7447", "agent", "secret", 1, "127.0.0.1:9"
    )
    manifest = AgentManifest(
        name="probe", command=command, environment=environment or {}, isolation=isolation
    )
    return AgentPlan(manifest, scratch.parent, spec, endpoints, scratch)


def python(scratch: Path, code: str, **options: Any) -> AgentPlan:
    return plan(scratch, "{python}", "-c", code, **options)


def wait_for(what: str, holds: Callable[[], Any]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline, f"no {what} in {PATIENCE_S} s"
        time.sleep(0.002)


def wait_for_end(agent: LocalProcess) -> int | None:
    wait_for("end", lambda: agent.exit_code() is not None)
    return agent.exit_code()


def wait_for_output(agent: LocalProcess) -> None:
    wait_for("output", agent.output_tail)


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def test_an_agent_gets_only_the_documented_environment(
    tmp_path: Path, isolation: Isolation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No variable of the bench's own process leaks into it."""
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


@pytest.mark.parametrize(
    ("code", "ended"),
    [
        ("raise ValueError('lost the plot')", 1),
        ("import os; os.kill(os.getpid(), 6)", -signal.SIGABRT),
        # The code of a missing program, from one that did start.
        ("raise SystemExit(127)", 127),
    ],
)
def test_an_end_leaves_its_code_and_last_words(
    code: str, ended: int, tmp_path: Path, isolation: Isolation
) -> None:
    with open_agent(python(tmp_path, code, isolation=isolation)) as agent:
        assert wait_for_end(agent) == ended
    assert ("lost the plot" in agent.output_tail()) is (ended == 1)


def test_a_program_that_is_not_there_says_so(tmp_path: Path, isolation: Isolation) -> None:
    """A program that cannot be started is a wrong set-up, and none of the agent's doing."""
    with (
        open_agent(plan(tmp_path, "/nowhere/agent", isolation=isolation)) as agent,
        pytest.raises(SetupError, match="/nowhere/agent cannot be started: No such file"),
    ):
        wait_for_end(agent)
    assert agent.output_tail().endswith("No such file or directory\n")


def test_missing_programs_scripts_and_modules_are_known_without_starting_them(tmp_path: Path) -> None:
    """Each of two kinds of command with and without its files; nothing is run or imported."""
    (tmp_path / "agent.py").touch()

    def faults(*command: str, **options: str) -> list[str]:
        manifest = AgentManifest(name="agent", command=command, environment={"MODE": "{option:mode}"})
        return [fault.what for fault in program_faults(manifest, tmp_path, options or {"mode": "x"})]

    no_file, no_program = f"there is no file {tmp_path}", "there is no program"
    no_module, not_executable = "there is no Python module", f"{tmp_path}/agent.py is not executable"
    # Relative ones to the manifest's folder, whatever the present one is.
    for line, fault in {
        "sh -c true": None,
        "{python} {folder}/agent.py": None,
        "{python} agent.py": None,
        "{python} -m bench.cli": None,
        "{folder}/agent.py": not_executable,
        "./agent.py": not_executable,
        "{folder}/gone": f"{no_program} '{tmp_path}/gone'",
        "bin/agent": f"{no_program} '{tmp_path}/bin/agent'",
        "no-such-program": f"{no_program} 'no-such-program'",
        "{python} {folder}/gone.py": f"{no_file}/gone.py",
        "{python} -u gone.py": f"{no_file}/gone.py",
        "{python} -m bench.no_such": f"{no_module} 'bench.no_such'",
        "{python} -m no_such.agent": f"{no_module} 'no_such.agent'",
    }.items():
        assert faults(*line.split()) == ([] if fault is None else [fault]), line
    assert "needs the option 'mode'" in faults("sh", other="y")[0]
    (tmp_path / "agent.py").chmod(0o755)
    assert faults("./agent.py") == []
    os.mkfifo(tmp_path / "pipe", 0o755)
    assert faults("./pipe") == [f"{no_program} '{tmp_path}/pipe'"]


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
        ("./run.sh ./x", "{here}/run.sh ./x"),
        ("bin/run x", "{here}/bin/run x"),
        ("/bin/sh a/b", "/bin/sh a/b"),
        ("sh ./x", "sh ./x"),
        ("{python} agent.py agent.py", "{python} {here}/agent.py agent.py"),
        ("{python} -u -X dev a/agent.py", "{python} -u -X dev {here}/a/agent.py"),
        ("{python} -Wdefault agent.py", "{python} -Wdefault {here}/agent.py"),
        ("{python} -W ignore {folder}/a.py", "{python} -W ignore {here}/a.py"),
        ("{python} -m agent x.py", "{python} -m agent x.py"),
        ("{python} -Bum agent x.py", "{python} -Bum agent x.py"),
        ("{python} -c pass x.py", "{python} -c pass x.py"),
        ("{python} - x.py", "{python} - x.py"),
        ("{python} -u", "{python} -u"),
    ],
)
def test_relative_programs_and_scripts_are_of_the_manifests_folder(
    command: str, looked_up: str, tmp_path: Path
) -> None:
    """In an image, they are the image's."""
    words = command.split()
    manifest = AgentManifest(name="agent", command=tuple(words))
    expected = looked_up.replace("{python}", sys.executable).replace("{here}", str(tmp_path)).split()
    assert list(expand_command(manifest, tmp_path, {})) == expected
    in_image = manifest.model_copy(update={"image": "mine"})
    unchanged = expand_placeholders(
        manifest, tmp_path, {}, dict(zip(map(str, range(9)), words, strict=False))
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
    for path, command in (
        (program, ("./own tools/my_agent", "--verbose")),
        (script, ("{python}", "-u", "agent.py", "--verbose")),
    ):
        agent_plan = plan(tmp_path / path.stem, *command, isolation=isolation)
        assert program_faults(agent_plan.manifest, agent_plan.folder, {}) == []
        with open_agent(agent_plan) as agent:
            assert wait_for_end(agent) == 0, agent.output_tail()
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
    wait_for("end of all", lambda: not any(map(is_running, pids)))


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


def test_the_reference_manifests_are_installed() -> None:
    """Both agents are found by name, can be paced, and differ by their policy alone."""
    for name, policy in (("reference-naive", "naive"), ("reference-bystander-aware", "bystander_aware")):
        manifest, _ = load_manifest(name)
        assert (manifest.name, manifest.command[-1]) == (name, policy)
        assert "lockstep" in manifest.pace
