"""Host time of a process and of everything that it started, from Linux's /proc.

Run delay is the time that a thread was ready to run and had no core (field 2 of schedstat;
Documentation/scheduler/sched-stats.rst of the kernel). It tells an agent that is slow from one that a busy
host holds up.
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from bench.contracts import AgentUsage

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
# Fields of /proc/<pid>/stat as positions after the command's closing bracket, which may itself hold spaces;
# proc_pid_stat(5) counts from 1 and has two fields before these.
_PARENT, _SESSION, _CPU, _NICE, _START, _POLICY = 1, 3, slice(11, 15), 16, 19, 38
# SCHED_OTHER and SCHED_BATCH. An idle or real-time thread chose its own place in the queue.
_ORDINARY_POLICIES = (0, 3)

# Fifty-two numbers and a name of 16 bytes, escaped.
_STAT_BYTES = 4096

_Key = tuple[int, bytes]
"""A process or thread: its id and when it started, as the kernel writes it."""


@dataclass(slots=True)
class _Process:
    """One process of the tree as it was last seen; `cpu_s` includes the children that it has waited for."""

    parent: int
    cpu_s: float = 0.0


@dataclass(slots=True)
class ProcessTreeUsage:
    """Adds up the host time of the session that `root` leads and of all its descendants, at each `read`.

    `home` recognises processes that left the session and lost their parents between two readings: they still
    have the agent's HOME. It is None where everything that `root` starts stays below it. What ended between two readings is counted in the CPU time of whoever waited for
    it; its run delay since the last reading is lost, so that short-lived children never excuse an agent.
    """

    root: int
    home: str | None
    proc: Path = Path("/proc")
    nice: int = field(default_factory=lambda: os.getpriority(os.PRIO_PROCESS, 0))
    _processes: dict[_Key, _Process] = field(default_factory=dict)
    _strangers: set[_Key] = field(default_factory=set)
    _delays_s: dict[_Key, float] = field(default_factory=dict)
    _ended_cpu_s: float = 0.0
    _cpu_s: float = 0.0

    def read(self) -> AgentUsage:
        """The usage so far; never less than at the reading before."""
        stats = self._stats()
        members = self._members(stats)
        self._keep_ended(set(members), {pid for pid, _ in members})
        for key in members:
            fields = stats[key]
            cpu_s = sum(int(ticks) for ticks in fields[_CPU]) / _TICKS_PER_S
            self._processes[key] = _Process(int(fields[_PARENT]), cpu_s)
            self._read_delays(key[0])
        living_s = sum(process.cpu_s for process in self._processes.values())
        self._cpu_s = max(self._cpu_s, living_s + self._ended_cpu_s)
        return AgentUsage(self._cpu_s, sum(self._delays_s.values()))

    def _stats(self) -> dict[_Key, list[bytes]]:
        """Fields of every process, by its id and start: ids are reused."""
        stats = {}
        with suppress(OSError):
            for entry in os.scandir(self.proc):
                if entry.name.isdigit() and (fields := _stat(entry.path)):
                    stats[int(entry.name), fields[_START]] = fields
        return stats

    def _members(self, stats: dict[_Key, list[bytes]]) -> list[_Key]:
        """Processes of the tree: once a member, always a member, whatever session it moved to."""
        children: dict[int, list[_Key]] = {}
        for key, fields in stats.items():
            children.setdefault(int(fields[_PARENT]), []).append(key)
        waiting = [
            key
            for key, fields in stats.items()
            if key in self._processes or self.root in (key[0], int(fields[_SESSION])) or self._has_home(key)
        ]
        members: dict[_Key, None] = {}
        while waiting:
            key = waiting.pop()
            if key not in members:
                members[key] = None
                waiting += children.get(key[0], ())
        self._strangers = (self._strangers & stats.keys()) | (stats.keys() - members.keys())
        return list(members)

    def _has_home(self, key: _Key) -> bool:
        # The environment of a process is read once; a session lasts longer than most processes of a host.
        return (
            self.home is not None
            and key not in self._strangers
            and has_home(self.proc / str(key[0]), self.home)
        )

    def _keep_ended(self, members: set[_Key], pids: set[int]) -> None:
        """Forget processes that ended, and keep the CPU time that no living parent has taken over."""
        for key in self._processes.keys() - members:
            ended = self._processes.pop(key)
            if ended.parent not in pids:
                self._ended_cpu_s += ended.cpu_s

    def _read_delays(self, pid: int) -> None:
        with suppress(OSError):
            for task in os.scandir(self.proc / str(pid) / "task"):
                fields = _stat(task.path)
                # A thread that gave itself a lower priority waits by its own choice. Without this an agent
                # could sleep while a child that never gets a core excuses it.
                if (
                    fields is None
                    or int(fields[_NICE]) > self.nice
                    or int(fields[_POLICY]) not in _ORDINARY_POLICIES
                ):
                    continue
                key = int(task.name), fields[_START]
                self._delays_s[key] = max(
                    self._delays_s.get(key, 0.0), run_delay_s(Path(task.path, "schedstat"))
                )


def has_home(process: Path, home: str) -> bool:
    """Whether a process, by its folder in /proc, was started with this HOME; False where nobody may know."""
    with suppress(OSError):
        return f"HOME={home}".encode() in (process / "environ").read_bytes().split(b"\0")
    return False


def run_delay_s(schedstat: Path) -> float:
    """Seconds that a thread was ready to run without a core; 0 where the system does not tell."""
    with suppress(OSError, ValueError, IndexError):
        return int(schedstat.read_text("utf-8").split()[1]) / 1e9
    return 0.0


def _stat(folder: str) -> list[bytes] | None:
    """Fields of a process or thread after its name; None where it has ended."""
    # Without objects of paths and files: a reading opens this file of every process of the host.
    with suppress(OSError):
        descriptor = os.open(f"{folder}/stat", os.O_RDONLY)
        try:
            fields = os.read(descriptor, _STAT_BYTES).rpartition(b")")[2].split()
        finally:
            os.close(descriptor)
        return fields if len(fields) > _POLICY else None
    return None
