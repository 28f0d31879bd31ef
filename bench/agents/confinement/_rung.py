"""The contract of a rung: one way to start an agent with less than the rights of the bench."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from bench.contracts import AgentUsage, ProcessRoot

from ._box import Box, Place


class ConfinedProcess(Protocol):
    """A started agent and the box around it."""

    @property
    def pid(self) -> int:
        """The process that the host started: the box, or the agent where there is no box."""

    def root(self) -> ProcessRoot:
        """The process below which all of the agent runs; it may wait until there is one."""

    @property
    def own_user(self) -> bool:
        """Whether the kernel has the agent as another user than the bench."""

    def poll(self) -> int | None:
        """The agent's exit code, None while it runs; negative for the signal that ended it."""

    def start_failure(self) -> str:
        """Why the agent's program could not be started; empty when it was, or is about to be."""

    def usage(self) -> AgentUsage:
        """Host time so far, of all that the agent started; never less than before."""

    def exceeded_limit(self) -> str:
        """The limit for which the kernel killed the agent, in words; empty if there is none."""

    def killed_from_outside(self) -> str:
        """Which process around the agent, out of its reach, a signal has ended; empty if none, or if nobody can tell."""

    def ask_to_end(self) -> None:
        """Send SIGTERM to the agent."""

    def end(self) -> None:
        """Kill what still runs and leave nothing behind: no process, shared memory, folder or cgroup."""


def killed_name(process: str, code: int | None) -> str:
    """A process in words if a signal ended it, else nothing."""
    return f"{process} ({signal.Signals(-code).name})" if code is not None and code < 0 else ""


def first_child(pid: int) -> int | None:
    """The agent below the process that keeps its box; None where it has not started, or has ended."""
    with suppress(OSError, ValueError, IndexError):
        return int(Path(f"/proc/{pid}/task/{pid}/children").read_text("utf-8").split()[0])
    return None


def reaped(pid: int, *, waits: bool) -> tuple[int, float] | None:
    """Exit code and CPU seconds of a child that has ended, with `waits` once it has; else None.

    The kernel tells them once: a child that another thread has reaped counts as killed.
    """
    try:
        waited, status, usage = os.wait4(pid, 0 if waits else os.WNOHANG)
    except ChildProcessError:
        return -signal.SIGKILL, 0.0
    return (os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime) if waited else None


def wait_until(holds: Callable[[], object], budget_s: float, pause_s: float = 0.001) -> None:
    """Look again and again until something holds, for so many host seconds at most."""
    deadline = time.monotonic() + budget_s
    while not holds() and time.monotonic() < deadline:
        time.sleep(pause_s)


class Rung(Protocol):
    """One way to confine an agent. Stateless but for what its trial has shown."""

    @property
    def name(self) -> str:
        """As in manifests and on the command line."""

    def trial(self) -> str | None:
        """Start a program in a box: None if that works here, else the reason and what to do about it."""

    def place(self, scratch: Path) -> Place:
        """Where an agent finds things whose folder on the host is `scratch`."""

    def start(self, box: Box, output: int) -> ConfinedProcess:
        """Start the agent; stdout and stderr go to the descriptor `output`.

        The calling thread must outlive the agent: the kernel ends the agent with it.
        """
