"""The rung that needs no package: rules on files, connections and signals by Landlock, and namespaces where this user gets them."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from bench.contracts import AgentUsage, ProcessRoot
from bench.network_namespace import namespace_fault

from .._process_usage import ProcessTreeUsage
from . import _landlock_launch
from ._box import AGENT_UID, BOX_PLACE, Box, Place, agent_user, box_files, host_place, name_files
from ._cgroup import ControlGroup
from ._landlock_launch import MAX_FOLDER_DEPTH
from ._limits import counts_by_namespace, process_limits, threads_of
from ._readable_paths import (
    PROCESSORS,
    SYSTEM_FILES,
    SYSTEM_FOLDERS,
    gpu_devices,
    reachable_by_others,
    readable_by_others,
    with_targets,
)
from ._rung import first_child, reaped, wait_until
from ._system_calls import filter_program

_TRIAL_BUDGET_S = 20.0
# For the launcher to kill what the agent has left; chosen, not measured.
_END_BUDGET_S = 5.0
# A server linked with TCP wrappers, as Debian's mosquitto is, refuses everybody where it may not read the last two.
_NAME_FILES = tuple(
    Path("/etc", name) for name in ("passwd", "group", "hosts", "nsswitch.conf", "hosts.allow", "hosts.deny")
)
# What libraries ask about the machine: nothing of it is about a process.
HARMLESS_FILES = tuple(
    Path("/proc", name)
    for name in ("cpuinfo", "filesystems", "loadavg", "meminfo", "stat", "uptime", "version")
)


def landlock_version() -> int:
    """The version of Landlock's interface that the kernel offers; 0 where there is none."""
    number = _landlock_launch.LANDLOCK_CREATE_RULESET
    return max(int(ctypes.CDLL(None).syscall(number, None, 0, 1)), 0) if sys.platform == "linux" else 0


class Landlock:
    """Rules on files, TCP connections, abstract sockets and signals, a system call filter and limits.

    Needs no package. Where this user may make namespaces, the agent has a root folder, processes, shared memory and a
    host name of its own; elsewhere the rules alone hold it, and a watch its folder on the disk.
    Root becomes another user where that one can reach what the agent reads.
    """

    name = "landlock"

    def trial(self) -> str | None:
        return self._reason

    def place(self, scratch: Path) -> Place:
        return host_place(scratch) if namespaces_fault() else BOX_PLACE

    def start(self, box: Box, output: int) -> LandlockedProcess:
        namespaces = namespaces_fault() is None
        # The bench mounts what it reads into a root of its own, from wherever that lies.
        readable = all(map(readable_by_others, [*box.read, *box.files]))
        reachable = namespaces or all(map(reachable_by_others, [*box.read, *box.shared, box.scratch]))
        return LandlockedProcess(
            box,
            output,
            namespaces=namespaces,
            user=agent_user() if os.getuid() == 0 and readable and reachable else None,
        )

    @cached_property
    def _reason(self) -> str | None:
        if sys.platform != "linux":
            return "Landlock is for Linux; run the bench in a virtual machine or a container"
        if not landlock_version():
            return "this kernel has no Landlock (Linux 5.13 and later, with landlock in its lsm= list)"
        return None if namespaces_fault() is None else _trial_failure(namespaces=False)


@cache
def namespaces_fault() -> str | None:
    """Why agents get no namespaces from this process; None where they do. Starts a program, once a process."""
    if not sys.platform.startswith("linux") or not landlock_version():
        return "namespaces come with Landlock here"
    return _trial_failure(namespaces=True)


def _trial_failure(*, namespaces: bool) -> str | None:
    true = shutil.which("true") or "/bin/true"
    with tempfile.TemporaryDirectory() as scratch, tempfile.TemporaryFile() as output:
        try:
            box = Box((true,), {"HOME": scratch}, Path(scratch))
            process = LandlockedProcess(box, output.fileno(), namespaces=namespaces)
            code = process.wait(_TRIAL_BUDGET_S)
            process.end()
        except (OSError, NotImplementedError) as error:
            return str(error)
        output.seek(0)
        text = output.read().decode(errors="replace").strip()
    return None if code == 0 else text or f"a trial start of {true} ended with {code}"


class LandlockedProcess:
    """An agent under its rules, and the launcher above it."""

    def __init__(self, box: Box, output: int, *, namespaces: bool, user: int | None = None) -> None:
        settings = _settings(box, user, namespaces=namespaces)
        if not namespaces:
            home = Path(host_place(box.scratch).home)
            home.mkdir(exist_ok=True)
            if user is not None:
                # It must reach its HOME and the files beside it, whose names it is told.
                box.scratch.chmod(0o711)
                os.chown(home, user, user)
        self.own_user = user is not None
        self._namespaces = namespaces
        self._limits = box.limits
        self._usage = AgentUsage()
        self._text = ""
        self._ended = False
        self._group = ControlGroup(box.limits)
        self._status, status_write = os.pipe()
        os.set_blocking(self._status, False)
        settings_read, settings_write = os.pipe()
        try:
            self._launcher = Launcher(settings_read, status_write, output)
        except BaseException:
            os.close(settings_write)
            os.close(self._status)
            self._group.close()
            raise
        finally:
            os.close(settings_read)
            os.close(status_write)
        # Before it has its settings, and starts the agent by them.
        self._group.add(self._launcher.pid)
        with suppress(BrokenPipeError), open(settings_write, "wb") as file:
            file.write(settings)
        self._tree = ProcessTreeUsage(self._launcher.pid, home=None)

    @property
    def pid(self) -> int:
        return self._launcher.pid

    def root(self) -> ProcessRoot:
        # The keeper above the agent takes in its orphans.
        while (keeper := self._stated("pid")) is None and self.poll() is None:
            time.sleep(0.001)
        return ProcessRoot(self.pid if keeper is None else int(keeper), is_box=True)

    def poll(self) -> int | None:
        self._launcher.reap(waits=False)
        status = self._stated("ended")
        if status is not None:
            return os.waitstatus_to_exitcode(int(status))
        # A launcher that ends without a statement was killed, and the agent with it.
        return None if self._launcher.returncode is None else -signal.SIGKILL

    def wait(self, budget_s: float) -> int | None:
        """Wait for the agent's end, at most so long."""
        wait_until(lambda: self.poll() is not None, budget_s)
        return self.poll()

    def start_failure(self) -> str:
        return "" if self._stated("failed") is None else "cannot be started"

    def usage(self) -> AgentUsage:
        if self._launcher.returncode is None:
            self._usage = self._tree.read()
            self._launcher.reap(waits=False)
        return AgentUsage(max(self._usage.cpu_s, self._launcher.cpu_s), self._usage.starved_s)

    def exceeded_limit(self) -> str:
        match self._stated("exceeded"):
            case "scratch":
                return f"{self._limits.scratch_mb} MB in its folder"
            case "folders":
                return f"{MAX_FOLDER_DEPTH} folders in one another"
        return f"{self._limits.memory_mb} MB of memory" if self._group.memory_kills() else ""

    def killed_from_outside(self) -> str:
        # Without namespaces the agent could itself kill what is around it.
        if not self._namespaces or self.poll() is None or self._stated("ended") or self._stated("failed"):
            return ""
        return "the launcher of landlock"

    def ask_to_end(self) -> None:
        keeper = self._stated("pid")
        agent = None if keeper is None else first_child(int(keeper))
        # Only while the keeper holds its number: nobody else reaps the agent.
        if agent is not None and self.poll() is None:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(agent, signal.SIGTERM)

    def end(self) -> None:
        if not self._ended:
            self._ended = True
            self._end_launcher()
            self._read_status()
            os.close(self._status)
            # Forgotten with the close: the number may soon be that of another file of this process.
            self._status = -1
            self._group.close()

    def _end_launcher(self) -> None:
        launcher = self._launcher

        def has_ended() -> bool:
            launcher.reap(waits=False)
            return launcher.returncode is not None

        # It kills everything below it, and ends.
        launcher.signal(signal.SIGTERM)
        wait_until(has_ended, _END_BUDGET_S)
        launcher.signal(signal.SIGKILL)
        launcher.reap(waits=True)

    def _stated(self, key: str) -> str | None:
        """What the launcher stated under a key; None if it did not."""
        self._read_status()
        for line in self._text.splitlines():
            word, _, value = line.partition(" ")
            if word == key:
                return value
        return None

    def _read_status(self) -> None:
        with suppress(OSError):
            self._text += os.read(self._status, 65536).decode(errors="replace")


class Launcher:
    """The program above a landlocked agent. It reads its settings from one descriptor and writes to two others."""

    def __init__(self, settings_fd: int, status_fd: int, output: int) -> None:
        launch = [_landlock_launch.__file__, str(settings_fd), str(status_fd), str(os.getpid())]
        self._started = subprocess.Popen(
            [sys.executable, "-I", "-S", *launch],
            cwd="/",
            env={},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            pass_fds=(settings_fd, status_fd),
            start_new_session=True,
        )
        self.pid = self._started.pid
        self.returncode: int | None = None
        self.cpu_s = 0.0

    def reap(self, *, waits: bool) -> None:
        """Keep how it ended, if it has; with `waits` once it has."""
        if self.returncode is None and (ended := reaped(self.pid, waits=waits)):
            self.returncode, self.cpu_s = ended
            self._started.returncode = self.returncode

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to it, if it has not ended."""
        if self.returncode is None:
            self._started.send_signal(number)


def _settings(box: Box, user: int | None, *, namespaces: bool) -> bytes:
    # An ordinary user's agent gets a user namespace of its own, in which nobody else is counted.
    alone = namespaces and os.getuid() != 0 and counts_by_namespace()
    present = 0 if alone else threads_of(os.getuid() if user is None else user)
    view = _root_settings(box, user) if namespaces else _host_settings(box)
    return json.dumps(
        {
            "command": box.command,
            "namespaces": namespaces,
            # A network of the session's own has nothing else to connect to, and agents may run servers in it.
            "tcp_ports": None if namespace_fault() is None else sorted(box.tcp_ports),
            "scratch_bytes": box.limits.scratch_mb << 20,
            "limits": list(process_limits(box.limits, present).items()),
            "user": user,
            # Another user's agent changes nothing of the bench's files, whose owner it is not.
            "filter": filter_program(
                shares_ipc=not namespaces, shares_files=not namespaces and user is None
            ).hex(),
            "devices": [str(path) for path in gpu_devices()] if box.gpu else [],
            **view,
        }
    ).encode()


def _root_settings(box: Box, user: int | None) -> dict[str, Any]:
    """What the agent finds in a root of its own, all of which it may read."""
    mounted = with_targets([*SYSTEM_FILES, *box.read, PROCESSORS])
    return {
        "environment": dict(box.environment),
        "home": BOX_PLACE.home,
        "read": ["/"],
        "listed": [],
        "writable": [BOX_PLACE.home, "/tmp", "/dev/shm", "/dev/pts", *box_files(box.shared).values()],
        "system": [str(folder) for folder in SYSTEM_FOLDERS],
        "mounted": [str(path) for path in mounted],
        "etc": name_files(box.hosts, AGENT_UID if user is None else user),
        "files": box_files(box.files),
        "shared": box_files(box.shared),
    }


def _host_settings(box: Box) -> dict[str, Any]:
    """What the agent may read and write in the root of the host."""
    home = host_place(box.scratch).home
    read = [*SYSTEM_FOLDERS, *SYSTEM_FILES, *_NAME_FILES, *HARMLESS_FILES, PROCESSORS, *box.read, *box.files]
    return {
        # The host's /tmp is not among what it may write.
        "environment": {"TMPDIR": home, **box.environment},
        "home": home,
        "read": [str(path) for path in read],
        # Python lists a folder before it imports a package from it. A rule goes for all below, so names of
        # files there show, and nothing of what is in them.
        "listed": sorted({str(path.parent) for path in box.read if (path / "__init__.py").is_file()}),
        "writable": [home, *(str(path) for path in box.shared)],
    }
