"""The warm interpreter as the bench sees it, which forks a launcher for each session."""

from __future__ import annotations

import atexit
import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress

from . import _warm_launch

# Loaded by the bench and by Python agents alike. Agents' own modules would run outside of the walls.
WARM_MODULES = (
    "json",
    "socket",
    "numpy",
    "pydantic",
    "zenoh",
    "zenoh.ext",
    "pymavlink.dialects.v20.common",
    "bench.contracts",
    "bench.simspec",
    "bench.streams",
)
# Nothing of a manifest, such as LD_PRELOAD and PYTHONPATH: the interpreter is outside of the walls.
INTERPRETER_ENVIRONMENT = {"LANG": "C.UTF-8", "PYTHONHASHSEED": "0", "PYTHONUNBUFFERED": "1"}
_END_BUDGET_S = 2.0
_READ_BYTES = 4096


class ForkedLauncher:
    """A launcher that a warm interpreter has forked. The interpreter reaps it and reports."""

    def __init__(self, report: int) -> None:
        self._report = report
        self._text = b""
        while b"\n" not in self._text:
            if not (data := os.read(report, _READ_BYTES)):
                raise BrokenPipeError("the warm interpreter has ended")
            self._text += data
        head, _, self._text = self._text.partition(b"\n")
        self.pid = int(head)
        self.returncode: int | None = None
        self.cpu_s = 0.0

    def reap(self, *, waits: bool) -> None:
        """Take in the report of its end, where there is one; with `waits` once there is one."""
        if self.returncode is not None:
            return
        os.set_blocking(self._report, waits)
        try:
            data = os.read(self._report, _READ_BYTES)
        except BlockingIOError:
            return
        self._text += data
        if data and b"\n" not in self._text:
            return
        # An interpreter that ended without a report was killed, and its launchers with it.
        status, cpu_s = self._text.split() if data else (str(int(signal.SIGKILL)).encode(), b"0")
        self.returncode, self.cpu_s = os.waitstatus_to_exitcode(int(status)), float(cpu_s)
        os.close(self._report)

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to it, if it has not ended."""
        self.reap(waits=False)
        if self.returncode is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)


class WarmInterpreter:
    """One warm interpreter. Used by one thread at a time."""

    def __init__(self) -> None:
        self._link, other = socket.socketpair()
        with other:
            other.set_inheritable(True)
            command = [_warm_launch.__file__, str(other.fileno()), str(os.getpid()), *WARM_MODULES]
            self._process = subprocess.Popen(
                [sys.executable, *command],
                cwd="/",
                env=INTERPRETER_ENVIRONMENT,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=(other.fileno(),),
                start_new_session=True,
            )

    def fork(self, settings_fd: int, status_fd: int, output: int) -> ForkedLauncher:
        """A launcher that reads its settings from one descriptor and writes to two others, all of them the caller's.

        Raises OSError where the interpreter has ended.
        """
        report, report_write = os.pipe()
        try:
            socket.send_fds(self._link, [b"f"], [settings_fd, status_fd, output, report_write])
        except OSError:
            os.close(report)
            raise
        finally:
            os.close(report_write)
        try:
            return ForkedLauncher(report)
        except OSError:
            os.close(report)
            raise

    def close(self) -> None:
        """End it."""
        self._link.close()
        try:
            self._process.wait(_END_BUDGET_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class WarmInterpreters:
    """The warm interpreter of this process, from the second agent on that is forked.

    Its start costs what a dozen forks of a light agent save: a command that flies one session does without.
    """

    def __init__(self) -> None:
        self._interpreters: dict[int, WarmInterpreter] = {}
        self._asked: set[int] = set()
        atexit.register(self._close)

    def fork(self, settings_fd: int, status_fd: int, output: int) -> ForkedLauncher | None:
        """A launcher from the interpreter; None for the first one asked for, and where it cannot start."""
        # A process that was forked from this one has an interpreter of its own.
        key = os.getpid()
        if key not in self._asked:
            self._asked.add(key)
            return None
        for _ in range(2):
            if key not in self._interpreters:
                self._interpreters[key] = WarmInterpreter()
            try:
                return self._interpreters[key].fork(settings_fd, status_fd, output)
            except OSError:
                # It ends with the thread that started it.
                self._interpreters.pop(key).close()
        return None

    def _close(self) -> None:
        if interpreter := self._interpreters.pop(os.getpid(), None):
            interpreter.close()
