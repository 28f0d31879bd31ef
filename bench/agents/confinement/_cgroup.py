"""Limits on a whole tree of processes, by the kernel's control groups where this process may make them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from itertools import count
from pathlib import Path

from bench.contracts import AgentLimits

from ._rung import wait_until

_PREFIX = "rebar-"
_CPU_PERIOD_US = 100_000
# A group is busy until the kernel has taken its last process apart; chosen, not measured.
_REMOVAL_BUDGET_S = 2.0
_numbers = count()


class ControlGroup:
    """Groups of this process's own groups, with an agent's limits; nothing where none can be made.

    Version 2 where the memory and pids controllers are delegated to us, else version 1 where its folders
    are writable.
    """

    def __init__(self, limits: AgentLimits, root: Path = Path("/sys/fs/cgroup")) -> None:
        self._limits = limits
        self._folders: list[Path] = []
        name = f"{_PREFIX}{os.getpid()}-{next(_numbers)}"
        parents = _parents(root)
        for parent in parents.values():
            _remove_stale(parent)
        if unified := parents.get(""):
            self._make(unified / name, _limits_v2(limits))
        for controller, values in _limits_v1(limits).items():
            if not unified and controller in parents:
                self._make(parents[controller] / name, values)

    def add(self, pid: int) -> None:
        """Put a process in, with what it will start."""
        for folder in self._folders:
            with suppress(OSError):
                (folder / "cgroup.procs").write_text(str(pid), encoding="utf-8")

    def memory_kills(self) -> int:
        """How many processes in here the kernel killed for want of memory."""
        kills = 0
        for folder in self._folders:
            for file in ("memory.events", "memory.oom_control"):
                with suppress(OSError):
                    for line in (folder / file).read_text("utf-8").splitlines():
                        key, _, value = line.partition(" ")
                        kills += int(value) if key == "oom_kill" else 0
        return kills

    def close(self) -> None:
        """Remove the groups; whatever is still in one is killed where the kernel offers that."""
        for folder in self._folders:
            with suppress(OSError):
                (folder / "cgroup.kill").write_text("1", encoding="utf-8")
            wait_until(partial(_removed, folder), _REMOVAL_BUDGET_S, 0.005)
        self._folders.clear()

    def _make(self, folder: Path, values: Mapping[str, int | str]) -> None:
        with suppress(OSError):
            folder.mkdir()
            self._folders.append(folder)
        if folder not in self._folders:
            return
        for file, value in values.items():
            # A controller may lack a file (swap accounting is often compiled out); the others still hold.
            with suppress(OSError):
                (folder / file).write_text(str(value), encoding="utf-8")


def can_limit(controller: str, root: Path = Path("/sys/fs/cgroup")) -> bool:
    """Whether this process may make groups with limits by a controller (`memory`, `pids`, `cpu`)."""
    parents = _parents(root)
    parent = parents.get("") if "" in parents else parents.get(controller)
    return parent is not None and os.access(parent, os.W_OK)


def _parents(root: Path) -> dict[str, Path]:
    """This process's own group by controller, where that is a folder; '' is version 2 with controllers."""
    parents: dict[str, Path] = {}
    with suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text("utf-8").splitlines():
            _, controllers, path = line.split(":", 2)
            if controllers:
                for controller in controllers.split(","):
                    parents[controller] = root / controllers / path.lstrip("/")
            else:
                unified = root / path.lstrip("/")
                delegated = (unified / "cgroup.subtree_control").read_text("utf-8").split()
                if {"memory", "pids"} <= set(delegated):
                    parents[""] = unified
    return {controller: parent for controller, parent in parents.items() if parent.is_dir()}


def _limits_v2(limits: AgentLimits) -> dict[str, int | str]:
    return {
        "memory.max": limits.memory_mb << 20,
        "memory.swap.max": 0,
        "memory.oom.group": 1,
        "pids.max": limits.processes,
        "cpu.max": f"{round(limits.cpus * _CPU_PERIOD_US)} {_CPU_PERIOD_US}",
    }


def _limits_v1(limits: AgentLimits) -> dict[str, dict[str, int | str]]:
    return {
        # What waits in sockets counts apart in version 1, and by no limit at all until this one is set.
        "memory": dict.fromkeys(
            ("memory.limit_in_bytes", "memory.kmem.tcp.limit_in_bytes"), limits.memory_mb << 20
        ),
        "pids": {"pids.max": limits.processes},
        "cpu": {"cpu.cfs_quota_us": round(limits.cpus * _CPU_PERIOD_US)},
    }


def _remove_stale(parent: Path) -> None:
    """Remove groups whose maker was killed before it could: their names have its process id."""
    with suppress(OSError):
        for folder in parent.glob(f"{_PREFIX}[0-9]*-*"):
            maker = folder.name.removeprefix(_PREFIX).partition("-")[0]
            if not Path("/proc", maker).exists():
                _removed(folder)


def _removed(folder: Path) -> bool:
    try:
        folder.rmdir()
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return True
