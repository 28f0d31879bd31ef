"""The limits of one process."""

from __future__ import annotations

import os
import platform
import resource
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from bench.contracts import AgentLimits


def process_limits(limits: AgentLimits, present: int = 0) -> dict[int, int]:
    """The limits of one process, by number of the resource. `present` processes and threads count as others'.

    RLIMIT_DATA and not RLIMIT_AS: Node, Go and Java reserve much more address space than they use.
    """
    return {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_FSIZE: limits.file_mb << 20,
        resource.RLIMIT_NOFILE: limits.open_files,
        resource.RLIMIT_NPROC: present + limits.processes,
        resource.RLIMIT_DATA: limits.memory_mb << 20,
        resource.RLIMIT_MSGQUEUE: 0,
        # io_uring is denied, and locked memory is not swapped: none of an agent's needs. Node asks for some.
        resource.RLIMIT_MEMLOCK: 1 << 20,
        # Each timer of timer_create takes one, of what the kernel gives all programs of the user together; chosen.
        resource.RLIMIT_SIGPENDING: 4096,
    }


_NAMES = {
    resource.RLIMIT_CORE: "core",
    resource.RLIMIT_FSIZE: "fsize",
    resource.RLIMIT_NOFILE: "nofile",
    resource.RLIMIT_NPROC: "nproc",
    resource.RLIMIT_DATA: "data",
    resource.RLIMIT_MSGQUEUE: "msgqueue",
    resource.RLIMIT_MEMLOCK: "memlock",
    resource.RLIMIT_SIGPENDING: "sigpending",
}


def allowed_limits(limits: Mapping[int, int]) -> dict[int, int]:
    """The limits, none above this process's own hard limit, which a process without rights may not raise."""
    hard = {kind: resource.getrlimit(kind)[1] for kind in limits}
    return {
        kind: value if hard[kind] == resource.RLIM_INFINITY else min(value, hard[kind])
        for kind, value in limits.items()
    }


def limit_words(limits: Mapping[int, int]) -> list[str]:
    """The allowed limits as prlimit and container engines take them: `nofile=1024:1024`."""
    return [f"{_NAMES[kind]}={value}:{value}" for kind, value in allowed_limits(limits).items()]


def threads_of(user: int) -> int:
    """Processes and threads of a user that the kernel counts towards RLIMIT_NPROC in this process's user namespace."""
    namespace = _user_namespace("self") if counts_by_namespace() else ""
    count = 0
    for entry in os.scandir("/proc"):
        with suppress(OSError):
            if not entry.name.isdigit() or entry.stat().st_uid != user:
                continue
            # Those of another namespace may not be looked at.
            if not namespace or _user_namespace(entry.name) == namespace:
                count += len(os.listdir(Path(entry.path, "task")))
    return count


def _user_namespace(pid: str) -> str:
    return os.readlink(f"/proc/{pid}/ns/user")


def counts_by_namespace() -> bool:
    """Whether the kernel counts processes for each user namespace by itself: from Linux 5.14."""
    major, minor = (int("".join(filter(str.isdigit, part))) for part in platform.release().split(".")[:2])
    return (major, minor) >= (5, 14)
