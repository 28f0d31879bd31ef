"""Ending processes for good, with whatever they started."""

from __future__ import annotations

import os
import select
import signal
from contextlib import suppress
from pathlib import Path


def end_tree(pid: int) -> None:
    """Kill a process, the group that it leads, and every descendant, in whatever session that is by now."""
    for one in descendants(pid):
        with suppress(ProcessLookupError, PermissionError):
            os.kill(one, signal.SIGKILL)
    for end in (os.killpg, os.kill):  # whoever kills itself gets no further than its group
        with suppress(ProcessLookupError, PermissionError):
            end(pid, signal.SIGKILL)


def await_exit(pid: int, span_s: float) -> bool:
    """Wait for a child to end without reaping it; whether it did within the span."""
    watch = os.pidfd_open(pid)
    try:
        return bool(select.select([watch], [], [], span_s)[0])
    finally:
        os.close(watch)


def descendants(pid: int) -> list[int]:
    """Children, grandchildren and so on, as the kernel knows them now; empty where there is no /proc."""
    found: list[int] = []
    waiting = [pid]
    while waiting:
        children = _children(waiting.pop())
        found += children
        waiting += children
    return found


def _children(pid: int) -> list[int]:
    children: list[int] = []
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError):
                children += map(int, (task / "children").read_text().split())
    return children


def marked(variable: str, value: str) -> list[int]:
    """Processes of this user, other than this one, that were started with a variable of that value in their environment."""
    mark = f"{variable}={value}".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if int(folder.name) != os.getpid() and mark in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
    return found
