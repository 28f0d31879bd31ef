"""The rung with an image of its own: a container by podman or docker."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import tempfile
import time
from contextlib import suppress
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any

from bench.contracts import AgentLimits, AgentUsage, ProcessRoot
from bench.network_namespace import namespace_fault

from .._process_usage import ProcessTreeUsage
from ._box import AGENT_UID, BOX_PLACE, Box, Place, box_files
from ._limits import limit_words, process_limits
from ._readable_paths import gpu_devices, with_targets
from ._rung import killed_name, wait_until
from ._system_calls import engine_profile

# In this order: podman's containers can share the network namespace of the bench, docker's daemon has its own.
ENGINES = ("podman", "docker")
# The codes by which both engines say that the command did not start; an agent may end with the last two as well.
_ENGINE_FAILED, _NOT_EXECUTABLE, _NOT_FOUND = 125, 126, 127
# For a command of the engine other than the run itself; chosen, not measured.
_COMMAND_BUDGET_S = 30.0
_PREFIX = "rebar-agent-"
_PID_MAX = Path("/proc/sys/kernel/pid_max")
_numbers = count()


class Container:
    """One container a session, from the image of the manifest: read-only, without capabilities or new rights."""

    name = "container"

    def __init__(self, program: str | None = None) -> None:
        found = (shutil.which(engine) for engine in ENGINES)
        self._program = program if program is not None else next(filter(None, found), None)

    def trial(self) -> str | None:
        return self._reason

    def place(self, scratch: Path) -> Place:
        return BOX_PLACE

    def start(self, box: Box, output: int) -> ContainerProcess:
        assert self._program is not None, "the trial was not asked"
        return ContainerProcess(self._program, box, output)

    @cached_property
    def _reason(self) -> str | None:
        if not self._program:
            return "no engine: there is neither podman nor docker; install podman"
        if Path(self._program).name == "docker" and namespace_fault() is None:
            return (
                "docker starts containers on the host's network, and sessions have a network of their own here; "
                "install podman"
            )
        try:
            done = _run(self._program, "version")
        except (OSError, subprocess.TimeoutExpired) as error:
            return f"{self._program} version: {error}"
        if done.returncode:
            said = done.stderr.strip().splitlines() or [f"it ended with {done.returncode}"]
            return f"{self._program} version: {said[-1]}; start its service, or let this user use it"
        return None


class ContainerProcess:
    """A container, and the engine's client that started it and passes its output on."""

    own_user = True

    def __init__(self, program: str, box: Box, output: int) -> None:
        self._program = program
        self._limits = box.limits
        self._name = f"{_PREFIX}{os.getpid()}-{next(_numbers)}"
        self._note = box.scratch / "oom"
        self._usage = AgentUsage()
        self._tree: ProcessTreeUsage | None = None
        self._final: dict[str, Any] | None = None
        self._ended = False
        _remove_stale(program)
        client, options = _environment_options(box)
        # Read by the engine's client at the start; engines take no profile by a pipe. Removed by `end`.
        self._profile = tempfile.NamedTemporaryFile("w", encoding="utf-8", prefix=_PREFIX, suffix=".json")  # noqa: SIM115
        json.dump(engine_profile(), self._profile)
        self._profile.flush()
        options += ["--security-opt", f"seccomp={self._profile.name}"]
        self._client = subprocess.Popen(
            [
                program,
                "run",
                "--name",
                self._name,
                *_options(box, program),
                *options,
                box.image,
                *box.command,
            ],
            env=client,
            # Podman's monitor leaves its note on memory in its working folder, where `exceeded_limit` looks.
            cwd=box.scratch,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
        )

    @property
    def pid(self) -> int:
        return self._client.pid

    def root(self) -> ProcessRoot:
        deadline = time.monotonic() + _COMMAND_BUDGET_S
        # The engine states the number once the container stands.
        while not (pid := int(self._inspect().get("Pid") or 0)):
            if self.poll() is not None or time.monotonic() > deadline:
                return ProcessRoot(self.pid, is_box=True)
            time.sleep(0.02)
        return ProcessRoot(pid, is_box=False)

    def poll(self) -> int | None:
        return self._client.poll()

    def start_failure(self) -> str:
        code = self.poll()
        if code == _ENGINE_FAILED:
            return "cannot be started by the container engine"
        # An agent may end with these codes too; a container whose program never ran is still "created".
        never_ran = code in (_NOT_EXECUTABLE, _NOT_FOUND) and self._state().get("Status") == "created"
        return "cannot be started in the image" if never_ran else ""

    def usage(self) -> AgentUsage:
        if self.poll() is None:
            if self._tree is None and (pid := int(self._inspect().get("Pid") or 0)):
                self._tree = ProcessTreeUsage(pid, home=None)
            if self._tree is not None:
                self._usage = self._tree.read()
        return self._usage

    def exceeded_limit(self) -> str:
        if self.poll() is None:
            return ""
        # Podman 4.3 states nothing with version 1 of control groups. The agent cannot see the note.
        killed = self._state().get("OOMKilled") or self._note.exists()
        return f"{self._limits.memory_mb} MB of memory" if killed else ""

    def killed_from_outside(self) -> str:
        return killed_name("the client of the container engine", self.poll())

    def ask_to_end(self) -> None:
        if self.poll() is None:
            self._command("kill", "--signal", "TERM", self._name)

    def end(self) -> None:
        if self._ended:
            return
        self._state()
        self._ended = True
        self._profile.close()
        # By name: the engine owns the processes, and ending its client would leave them.
        self._command("rm", "--force", "--volumes", self._name)
        wait_until(lambda: self._client.poll() is not None, _COMMAND_BUDGET_S)
        if self._client.poll() is None:
            self._client.kill()
            self._client.wait()

    def _state(self) -> dict[str, Any]:
        """The state of a container that has ended, asked once; empty while it runs."""
        if self._final is None and not self._ended and self._client.poll() is not None:
            self._final = self._inspect()
        return self._final or {}

    def _inspect(self) -> dict[str, Any]:
        done = self._command("inspect", "--format", "{{json .State}}", self._name)
        with suppress(ValueError):
            state = json.loads(done.stdout) if done is not None and done.returncode == 0 else {}
            return state if isinstance(state, dict) else {}
        return {}

    def _command(self, *words: str) -> subprocess.CompletedProcess[str] | None:
        with suppress(OSError, subprocess.TimeoutExpired):
            return _run(self._program, *words)
        return None


def _options(box: Box, program: str) -> list[str]:
    limits = box.limits
    size = f"{limits.scratch_mb}m"
    memory = f"{limits.memory_mb}m"
    podman = Path(program).name == "podman"
    # Podman copies what the image has in a folder into the tmpfs over it, where it may not fit into the quota.
    tmpfs = f"rw,mode=1777,size={size}{',notmpcopyup' if podman else ''}"
    options = [
        # The session's endpoints are on the loopback of the bench's network; podman starts containers in that.
        *("--network", "host", "--hostname", "agent", "--ipc", "private"),
        # A flight must not wait for a download, nor fly another version than the last one.
        *("--pull", "never", "--entrypoint", ""),
        *("--read-only", "--cap-drop", "ALL", "--security-opt", "no-new-privileges"),
        *("--user", f"{AGENT_UID}:{AGENT_UID}"),
        *("--pids-limit", str(limits.processes), "--cpus", f"{limits.cpus:g}"),
        # Swap included: as much again would be allowed otherwise.
        *("--memory", memory, "--memory-swap", memory, "--shm-size", size),
        *_ulimits(limits),
        *("--tmpfs", f"/tmp:{tmpfs}", "--tmpfs", f"{BOX_PLACE.home}:exec,{tmpfs}"),
        *("--workdir", BOX_PLACE.home, "--log-driver", "none"),
        # The agent was asked to end before its container is removed: no second wait of ten seconds.
        *("--stop-timeout", "0"),
    ]
    if podman:
        # Otherwise podman adds writable /run and /var/tmp, which have no quota.
        options.append("--read-only-tmpfs=false")
    for path in with_targets(box.read):
        options += ["--volume", f"{path}:{path}:ro"]
    for source, inside in box_files(box.files).items():
        options += ["--volume", f"{source}:{inside}:ro"]
    for source, inside in box_files(box.shared).items():
        options += ["--volume", f"{source}:{inside}:rw"]
    for name, address in box.hosts.items():
        options += ["--add-host", f"{name}:{address}"]
    for device in gpu_devices() if box.gpu else ():
        options += ["--device", str(device)]
    return options


def _ulimits(limits: AgentLimits) -> list[str]:
    """The limits of one process, none above the bench's own hard limit.

    Engines ask for 1,048,576 processes where nothing is stated, and a root user without CAP_SYS_RESOURCE (a build
    machine, a container in a container) may not raise a limit: no container would start there.
    """
    wanted = process_limits(limits)
    # Counted over all containers of a user, so this is no limit for one agent: `--pids-limit` is. The highest
    # process id is what podman gives itself, and no host runs more processes than that.
    wanted[resource.RLIMIT_NPROC] = int(_PID_MAX.read_text("utf-8"))
    return [word for limit in limit_words(wanted) for word in ("--ulimit", limit)]


def _environment_options(box: Box) -> tuple[dict[str, str], list[str]]:
    """The environment of the engine's client, and options that hand the agent's over.

    The bench's own by name, where the client's environment leaves room: command lines are read by every user of the host,
    and the agent's password is among them. What the manifest states goes by value: the client itself heeds some of it
    (CONTAINERS_CONF names programs that podman starts).
    """
    client = dict(os.environ)
    options = []
    for variable, value in box.environment.items():
        if variable.startswith("REBAR_") and variable not in os.environ:
            client[variable] = value
            options += ["--env", variable]
        else:
            options += ["--env", f"{variable}={value}"]
    return client, options


def _run(program: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [program, *words],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        encoding="utf-8",
        errors="replace",
        check=False,
        timeout=_COMMAND_BUDGET_S,
    )


def _remove_stale(program: str) -> None:
    """Remove containers whose bench was killed before it could: their names have its process id."""
    with suppress(OSError, subprocess.TimeoutExpired):
        listed = _run(program, "ps", "--all", "--filter", f"name={_PREFIX}", "--format", "{{.Names}}")
        for name in listed.stdout.split():
            maker = name.removeprefix(_PREFIX).partition("-")[0]
            if maker.isdigit() and not Path("/proc", maker).exists():
                _run(program, "rm", "--force", "--volumes", name)
