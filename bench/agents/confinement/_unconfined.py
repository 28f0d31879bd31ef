"""The rung without walls: the agent has the rights of the bench."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from bench.contracts import AgentUsage, ProcessRoot

from .._process_usage import ProcessTreeUsage, has_home
from . import _launch
from ._box import Box, Place, host_place
from ._rung import reaped

_READ_BYTES = 65536


class Unconfined:
    """No walls; a clean environment, bounded files, and an end that includes what the agent started."""

    name = "none"

    def trial(self) -> str | None:
        return None

    def place(self, scratch: Path) -> Place:
        return host_place(scratch)

    def start(self, box: Box, output: int) -> UnconfinedProcess:
        return UnconfinedProcess(box, output)


class UnconfinedProcess:
    """One local process and its group; what left the group is found by the agent's HOME."""

    own_user = False

    def __init__(self, box: Box, output: int) -> None:
        self._failure, launcher_end = os.pipe()
        self._failure_text = b""
        file_bytes = box.limits.file_mb << 20
        # A manifest may set HOME to anything.
        self._home = box.environment["HOME"]
        home = host_place(box.scratch).home
        Path(home).mkdir(exist_ok=True)
        try:
            # Through a launcher and not a preexec_fn, because this process has threads; see _launch.
            launch = [_launch.__file__, str(os.getpid()), str(file_bytes), str(launcher_end)]
            self._started = subprocess.Popen(
                [sys.executable, "-I", "-S", *launch, *box.command],
                cwd=home,
                env=dict(box.environment),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                pass_fds=(launcher_end,),
                start_new_session=True,
            )
        except BaseException:
            os.close(self._failure)
            raise
        finally:
            os.close(launcher_end)
        self._tree = ProcessTreeUsage(self._started.pid, self._home)
        self._usage = AgentUsage()
        # Set once the process has ended.
        self._reaped_cpu_s = 0.0

    @property
    def pid(self) -> int:
        return self._started.pid

    def root(self) -> ProcessRoot:
        # The launcher becomes the agent.
        return ProcessRoot(self.pid, is_box=False)

    def poll(self) -> int | None:
        if self._started.returncode is None and (ended := reaped(self.pid, waits=False)):
            self._started.returncode, self._reaped_cpu_s = ended
        return self._started.returncode

    def start_failure(self) -> str:
        # An agent may end with this code too; the launcher states a failure besides.
        if self.poll() == _launch.NOT_FOUND and not self._failure_text and self._failure >= 0:
            self._failure_text = os.read(self._failure, _READ_BYTES)
        return "cannot be started" if self._failure_text else ""

    def usage(self) -> AgentUsage:
        # Not after the end: the kernel may give the id to a stranger.
        if self.poll() is None:
            self._usage = self._tree.read()
        return AgentUsage(max(self._usage.cpu_s, self._reaped_cpu_s), self._usage.starved_s)

    def exceeded_limit(self) -> str:
        return ""

    def killed_from_outside(self) -> str:
        return ""

    def ask_to_end(self) -> None:
        self._signal(signal.SIGTERM)

    def end(self) -> None:
        self._signal(signal.SIGKILL)
        for pid in _processes_with_home(self._home):
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        if self.poll() is None and (ended := reaped(self.pid, waits=True)):
            self._started.returncode, self._reaped_cpu_s = ended
        # Forgotten with the close: the number may soon be that of another file of this process.
        if self._failure >= 0:
            os.close(self._failure)
            self._failure = -1

    def _signal(self, number: signal.Signals) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, number)


def _processes_with_home(home: str) -> Iterator[int]:
    """Other processes that were started with this HOME: the agent's own, wherever they moved."""
    for entry in os.scandir("/proc"):
        if entry.name.isdigit() and int(entry.name) != os.getpid() and has_home(Path(entry.path), home):
            yield int(entry.name)
