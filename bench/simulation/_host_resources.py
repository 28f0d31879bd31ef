"""What the host has for a session and its agent: cores, and memory that did not run out."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

_GROUPS = Path("/sys/fs/cgroup")
_OWN_GROUP = Path("/proc/self/cgroup")
_VMSTAT = Path("/proc/vmstat")


def usable_cores(groups: Path = _GROUPS, own_group: Path = _OWN_GROUP) -> float:
    """Cores on which this process may run, less where control groups (version 2) limit its processor time.

    Not those of the machine: a job of Slurm or a container has few of them, and half of the machine would be out of reach.
    """
    cores = float(len(os.sched_getaffinity(0)))
    with suppress(OSError):
        for line in own_group.read_text(encoding="utf-8").splitlines():
            number, _, path = line.split(":", 2)
            if number == "0":
                folder = groups / path.lstrip("/")
                # Each group above limits all below it.
                for parent in (folder, *folder.parents):
                    cores = min(cores, _limit(parent / "cpu.max"))
                    if parent == groups:
                        break
    return cores


def _limit(file: Path) -> float:
    """Cores that a group's `cpu.max` leaves: microseconds of processor time, of so many; infinite without a limit."""
    with suppress(OSError, ValueError):
        quota_us, period_us = file.read_text(encoding="ascii").split()
        if quota_us != "max":
            return float(quota_us) / float(period_us)
    return float("inf")


def count_memory_kills(vmstat: Path = _VMSTAT) -> int:
    """How many processes the kernel killed for want of memory since it started, in containers too.

    0 where the system does not tell (Linux before 4.13, another system).
    """
    with suppress(OSError, ValueError):
        for line in vmstat.read_text(encoding="ascii").splitlines():
            name, _, count = line.partition(" ")
            if name == "oom_kill":
                return int(count)
    return 0
