"""Killing processes together with everything that they started."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path

import anyio


def kill_tree(pid: int) -> None:
    """Kill a process, the group that it leads, and every descendant, whatever session each is in by now."""
    for descendant in descendants(pid):
        with suppress(ProcessLookupError, PermissionError):
            os.kill(descendant, signal.SIGKILL)
    # The group comes before the process: a process that kills itself this way does not get further than its
    # group.
    for kill in (os.killpg, os.kill):
        with suppress(ProcessLookupError, PermissionError):
            kill(pid, signal.SIGKILL)


async def await_exit(pid: int, span_s: float) -> bool:
    """Wait for a child process to end, without reaping it. Returns whether it ended within `span_s`."""
    # Not waitpid: reaping would free the id, and the kill that follows could reach a stranger.
    exit_fd = os.pidfd_open(pid)
    try:
        with anyio.move_on_after(span_s):
            await anyio.wait_readable(exit_fd)
            return True
        return False
    finally:
        os.close(exit_fd)


def descendants(pid: int) -> list[int]:
    """Children, grandchildren and so on, as the kernel knows them now. Empty on a system without /proc."""
    known: list[int] = []
    waiting = [pid]
    while waiting:
        children = _children(waiting.pop())
        known += children
        waiting += children
    return known


def _children(pid: int) -> list[int]:
    children: list[int] = []
    # Processes end while they are listed, so any of these files may be gone.
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError):
                children += map(int, (task / "children").read_text(encoding="ascii").split())
    return children


def processes_marked(variable: str, value: str) -> list[int]:
    """Other processes of this user that were started with this environment variable at this value."""
    mark = f"{variable}={value}".encode()
    marked = []
    for folder in Path("/proc").glob("[0-9]*"):
        # Other users' processes cannot be read, and are never the bench's.
        with suppress(OSError):
            if int(folder.name) != os.getpid() and mark in (folder / "environ").read_bytes().split(b"\0"):
                marked.append(int(folder.name))
    return marked
