"""The rung with namespaces of its own for files, processes, memory and users, by bubblewrap."""

from __future__ import annotations

import ctypes
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path

from bench.contracts import AgentUsage, ProcessRoot

from .._process_usage import ProcessTreeUsage
from ._box import AGENT_UID, BOX_PLACE, Box, Place, agent_user, box_files, name_files
from ._cgroup import ControlGroup
from ._limits import allowed_limits, counts_by_namespace, limit_words, process_limits, threads_of
from ._readable_paths import (
    PROCESSORS,
    SYSTEM_FILES,
    SYSTEM_FOLDERS,
    gpu_devices,
    open_to_others,
    with_targets,
)
from ._rung import first_child, killed_name, reaped, wait_until
from ._system_calls import filter_program

PROGRAM = "bwrap"
# From <linux/prctl.h>; Python's standard library has no name for it.
_PR_SET_CHILD_SUBREAPER = 36
# A trial start takes 5 ms of CPU; generous for a busy host.
_TRIAL_BUDGET_S = 20.0
# The box may take so long to be ready for its limits; it took 1 to 20 ms under load.
_LIMITS_BUDGET_S = 10.0
# Shells and bubblewrap report the signal that ended a program as this much more than its number.
_SIGNAL_BASE = 128
_REMEDIES = (
    (
        ("setting up uid map: Permission denied", "RTM_NEWADDR"),
        "Ubuntu 23.10 and later keep user namespaces from programs without an AppArmor profile. Give bwrap "
        "one (`flags=(unconfined) { userns, }`, see bubblewrap issue 505), or run "
        "`sysctl kernel.apparmor_restrict_unprivileged_userns=0`",
    ),
    (
        ("No permissions to create", "Creating new namespace failed", "Operation not permitted"),
        "user namespaces are denied here, as in a container with Docker's default seccomp profile (start that "
        "with `--security-opt seccomp=unconfined --cap-add SYS_ADMIN`) or with "
        "`sysctl kernel.unprivileged_userns_clone=0`",
    ),
    (("Unknown option",), "install bubblewrap 0.7 or later"),
)


class Bubblewrap:
    """Namespaces for mounts, processes, IPC, users, host name and cgroups, a system call filter and limits.

    The box is made in a user namespace for every user. Root becomes another user first, where that one can
    reach what the agent reads; otherwise the agent is, to the kernel, the bench's user without its rights.
    """

    name = "bwrap"

    def __init__(self, program: str | None = None) -> None:
        self._program = program if program is not None else shutil.which(PROGRAM)

    def trial(self) -> str | None:
        return self._reason

    def place(self, scratch: Path) -> Place:
        return BOX_PLACE

    def start(self, box: Box, output: int) -> BubblewrapProcess:
        assert self._program is not None, "the trial was not asked"
        return BubblewrapProcess(self._program, box, output, user=self._user(box))

    @cached_property
    def _reason(self) -> str | None:
        if sys.platform != "linux":
            return "bubblewrap is for Linux; run the bench in a virtual machine or a container"
        if not self._program:
            return "there is no program bwrap; install the package bubblewrap"
        return self._failure_as(None)

    @cached_property
    def _may_change_user(self) -> bool:
        return os.getuid() == 0 and self._reason is None and self._failure_as(agent_user()) is None

    def _user(self, box: Box) -> int | None:
        paths = [*box.read, *box.files, *box.shared]
        return agent_user() if self._may_change_user and all(map(open_to_others, paths)) else None

    def _failure_as(self, user: int | None) -> str | None:
        assert self._program is not None
        true = shutil.which("true") or "/bin/true"
        with tempfile.TemporaryFile() as output:
            try:
                process = BubblewrapProcess(
                    self._program, Box((true,), {}, Path("/")), output.fileno(), user=user
                )
                try:
                    code = process.wait(_TRIAL_BUDGET_S)
                finally:
                    process.end()
                failure = "" if code == 0 else f"a trial start of {true} ended with {code}"
            except (OSError, NotImplementedError, _StartError) as error:
                failure = str(error)
            output.seek(0)
            text = output.read().decode(errors="replace").strip()
        return _with_remedy(text or failure) if failure else None


class _StartError(Exception):
    """Bubblewrap ended before the box stood."""


class BubblewrapProcess:
    """An agent in its box. Three processes: bubblewrap outside, bubblewrap as process 1 inside, the agent.

    Process 1 reaps orphans and lets signals reach the agent, which a process 1 without handlers ignores.
    """

    # A namespace of processes holds what is started in it, and a fork comes from outside.
    is_forked = False

    def __init__(self, program: str, box: Box, output: int, *, user: int | None = None) -> None:
        # The inner bubblewrap becomes our child when the outer one ends, so that we can wait for it: when
        # it is gone, everything of the box is, and the kernel tells the CPU time of all of it.
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        self.own_user = user is not None
        self._limits = box.limits
        present = 0 if counts_by_namespace() else threads_of(os.getuid() if user is None else user)
        self._process_limits = process_limits(box.limits, present)
        self._agent_pid: int | None = None
        self._code: int | None = None
        self._reaped_cpu_s = 0.0
        self._inner_reaped = False
        self._outer: subprocess.Popen[bytes]
        self._status_text = b""
        self._usage = AgentUsage()
        self._group = ControlGroup(box.limits)
        try:
            self._start(program, box, output, user)
        except BaseException:
            self._group.close()
            raise
        self._tree = ProcessTreeUsage(self._outer.pid, home=None)

    @property
    def pid(self) -> int:
        return self._outer.pid

    def root(self) -> ProcessRoot:
        return ProcessRoot(self._inner_pid, is_box=True)

    def poll(self) -> int | None:
        if self._code is None:
            self._reap(waits=False)
        return self._code

    def wait(self, budget_s: float) -> int | None:
        """Wait for the agent's end, at most so long."""
        wait_until(lambda: self.poll() is not None, budget_s)
        return self._code

    def start_failure(self) -> str:
        # Bubblewrap states an exit code only of a program that did start; its reason is in the output.
        started = self.poll() is None or b'"exit-code"' in self._read_status()
        return "" if started else "cannot be started"

    def usage(self) -> AgentUsage:
        if self.poll() is None:
            self._usage = self._tree.read()
        cpu_s = max(self._usage.cpu_s, self._reaped_cpu_s)
        return AgentUsage(cpu_s, self._usage.starved_s)

    def exceeded_limit(self) -> str:
        return f"{self._limits.memory_mb} MB of memory" if self._group.memory_kills() else ""

    def killed_from_outside(self) -> str:
        self.poll()
        # An agent that is killed is an exit code of the outer process, which is in no namespace of the agent's.
        return killed_name("the outer process of bubblewrap", self._outer.returncode)

    def ask_to_end(self) -> None:
        if self._agent_pid is None:
            self._agent_pid = first_child(self._inner_pid)
        # Only while the box stands: the number may be another's later.
        if self._agent_pid is not None and self.poll() is None:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(self._agent_pid, signal.SIGTERM)

    def end(self) -> None:
        if not self._inner_reaped:
            with suppress(ProcessLookupError):
                os.kill(self._inner_pid, signal.SIGKILL)
        if self._code is None:
            self._reap(waits=True)
        self._read_status()
        os.close(self._status)
        self._group.close()

    def _start(self, program: str, box: Box, output: int, user: int | None) -> None:
        self._status, status_write = os.pipe()
        block_read, self._block = os.pipe()
        try:
            with _Options(status_write, block_read) as options:
                options.describe(box)
                self._outer = options.start(program, box.command, output, user)
        except BaseException:
            os.close(self._status)
            os.close(self._block)
            raise
        try:
            self._inner_pid = self._read_inner_pid()
            self._group.add(self._outer.pid)
            self._group.add(self._inner_pid)
            self._set_limits(user)
        except BaseException:
            self._outer.kill()
            self._outer.wait()
            os.close(self._status)
            raise
        finally:
            # The agent starts now.
            os.close(self._block)

    def _read_inner_pid(self) -> int:
        while b"}" not in self._status_text:
            text = os.read(self._status, 4096)
            if not text:
                self._outer.wait()
                raise _StartError(f"bwrap ended with {self._outer.returncode}")
            self._status_text += text
        os.set_blocking(self._status, False)
        return int(json.loads(self._status_text.partition(b"}")[0] + b"}")["child-pid"])

    def _set_limits(self, user: int | None) -> None:
        """Limits on process 1 of the box, which the agent inherits."""
        deadline = time.monotonic() + _LIMITS_BUDGET_S
        # While bubblewrap sets up the box its process is not ours to limit.
        while not (self._limit_as(user) if user is not None else self._limit()):
            if not Path(f"/proc/{self._inner_pid}").exists():
                return
            if time.monotonic() > deadline:
                raise _StartError("the limits of the agent's process could not be set")
            time.sleep(0.0005)

    def _limit(self) -> bool:
        try:
            for kind, value in allowed_limits(self._process_limits).items():
                resource.prlimit(self._inner_pid, kind, (value, value))
        except PermissionError:
            return False
        except ProcessLookupError:
            return True
        return True

    def _limit_as(self, user: int) -> bool:
        """By a program of the agent's user: for root it takes a capability that containers do not have."""
        options = [f"--{limit}" for limit in limit_words(self._process_limits)]
        command = ["prlimit", "--pid", str(self._inner_pid), *options]
        # As the agent's user it must not find a prlimit that others have put into our PATH.
        done = subprocess.run(
            command,
            env={"PATH": os.defpath},
            cwd="/",
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            user=user,
            group=user,
            extra_groups=[],
            check=False,
        )
        return done.returncode == 0

    def _read_status(self) -> bytes:
        with suppress(OSError):
            self._status_text += os.read(self._status, 4096)
        return self._status_text

    def _reap(self, *, waits: bool) -> None:
        """As Popen.poll, but waits for both processes of bubblewrap and keeps their CPU time."""
        ended = reaped(self._outer.pid, waits=waits)
        if ended is None:
            return
        code, self._reaped_cpu_s = ended
        self._outer.returncode = code
        self._code = _SIGNAL_BASE - code if code > _SIGNAL_BASE else code
        # It dies with the outer one, whose child it was; but not where that one was killed before it could say so.
        if code < 0:
            with suppress(ProcessLookupError):
                os.kill(self._inner_pid, signal.SIGKILL)
        if inner := reaped(self._inner_pid, waits=True):
            self._reaped_cpu_s += inner[1]
        self._inner_reaped = True


class _Options:
    """What bubblewrap is to do, in order (later mounts lie on top), and the descriptors that it needs."""

    def __init__(self, status: int, block: int) -> None:
        self._words: list[str] = []
        self._descriptors = [status, block]

    def __enter__(self) -> _Options:
        return self

    def __exit__(self, *_: object) -> None:
        for descriptor in self._descriptors:
            os.close(descriptor)

    def describe(self, box: Box) -> None:
        """Everything about the box; nothing may be added afterwards, because the root is read-only then."""
        status, block = self._descriptors[:2]
        self._add("--unshare-user", "--uid", AGENT_UID, "--gid", AGENT_UID, "--cap-drop", "ALL")
        self._add("--unshare-ipc", "--unshare-pid", "--unshare-uts", "--unshare-cgroup-try")
        self._add("--die-with-parent", "--new-session", "--hostname", "agent")
        self._add("--json-status-fd", status, "--block-fd", block)
        self._mount(box)
        for variable, value in box.environment.items():
            self._add("--setenv", variable, value)
        self._add("--seccomp", self._file(filter_program(shares_ipc=False)), "--remount-ro", "/")

    def start(
        self, program: str, command: Sequence[str], output: int, user: int | None
    ) -> subprocess.Popen[bytes]:
        """Start bubblewrap as `user`, or as ours when None."""
        # Not on the command line, where the agent would read paths of the host: /proc/1/cmdline.
        arguments = self._file(b"".join(word.encode() + b"\0" for word in self._words))
        return subprocess.Popen(
            [program, "--args", str(arguments), "--", *command],
            cwd="/",
            # Empty because the agent reads /proc/1/environ; the agent's own is among the options.
            env={},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            pass_fds=self._descriptors,
            start_new_session=True,
            user=user,
            group=user,
            extra_groups=None if user is None else [],
        )

    def _mount(self, box: Box) -> None:
        size = box.limits.scratch_mb << 20
        for folder in SYSTEM_FOLDERS:
            if folder.is_symlink():
                self._add("--symlink", folder.readlink(), folder)
            elif folder.is_dir():
                self._add("--ro-bind", folder, folder)
        # Read-only: the kernel lets its root user write /proc/sys without any capability.
        self._add("--proc", "/proc", "--remount-ro", "/proc")
        self._add("--dev", "/dev", "--perms", "1777", "--size", size, "--tmpfs", "/dev/shm")
        for device in gpu_devices() if box.gpu else ():
            self._add("--dev-bind", device, device)
        # Without a size each of these could hold half of the host's memory.
        self._add("--remount-ro", "/dev", "--perms", "1777", "--size", size, "--tmpfs", "/tmp")
        self._add("--size", size, "--tmpfs", BOX_PLACE.home, "--chdir", BOX_PLACE.home)
        # After /tmp, because they may lie in there.
        for path in with_targets([*SYSTEM_FILES, *box.read, PROCESSORS]):
            self._add("--ro-bind", path, path)
        for source, inside in box_files(box.files).items():
            self._add("--ro-bind", source, inside)
        for source, inside in box_files(box.shared).items():
            self._add("--bind", source, inside)
        for name, text in name_files(box.hosts).items():
            self._add("--perms", "0644", "--ro-bind-data", self._file(text.encode()), f"/etc/{name}")

    def _add(self, *words: str | int | Path) -> None:
        self._words += map(str, words)

    def _file(self, content: bytes) -> int:
        """A descriptor of a file in memory."""
        descriptor = os.memfd_create("box", os.MFD_CLOEXEC)
        self._descriptors.append(descriptor)
        os.write(descriptor, content)
        os.lseek(descriptor, 0, os.SEEK_SET)
        return descriptor


def _with_remedy(text: str) -> str:
    for signs, remedy in _REMEDIES:
        if any(sign in text for sign in signs):
            return f"{text}; {remedy}"
    return text
