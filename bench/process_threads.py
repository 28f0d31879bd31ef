"""Whether any thread of a tree of processes runs, is about to, or waits for the disk, from Linux's /proc.

Warp waits for agents by it, and the pace `quiet` for PX4.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

# States of proc_pid_stat(5). Stopped, traced or ended, a thread does nothing of itself. D waits for the disk, and X is about
# to tell its parent that it has ended: both are at work.
_STOPPED, _RESTING = frozenset(b"TtZ"), frozenset(b"TtZS")
# Of /proc/PID/wchan, when the thread is on a run queue.
_NOWHERE = b"0"
# Where the kernel lets a thread sleep until something happens, and never wait for the disk: locks and conditions, poll, epoll
# and nanosleep, by the names of all kernels since 4.9.
_SLEEPING_PLACES = (b"futex_", b"poll_schedule_timeout", b"ep_poll", b"do_epoll_wait", b"hrtimer_nanosleep")
_WCHAN_BYTES = 64
# Long enough for the state behind a name of up to 15 characters, which may hold brackets and spaces.
_STAT_BYTES = 64
_SCHEDSTAT_BYTES = 64
_CPUCLOCK_SCHED = 2
_LAST_PID = Path("/proc/loadavg")
# Host time within which a thread that waits must be seen asleep, on a busy host too. Chosen.
_PROBE_S = 10.0


@dataclass(slots=True, eq=False)
class _Thread:
    stat: int
    schedstat: int
    wchan: int
    cpu_ns: int = 0
    # `history` when it was last seen asleep: with the same one it has slept since.
    asleep_history: bytes = b""

    def state(self) -> int:
        text = os.pread(self.stat, _STAT_BYTES, 0)
        return text[text.rindex(b")") + 2]

    def rests(self) -> bool:
        """Whether it calls itself asleep, stopped or ended now, or did so when it last had a core."""
        # Its state costs three to six times as much to read as the rest, so only threads that ran are asked for it.
        history = self.history()
        if history == self.asleep_history:
            return True
        if self.state() not in _RESTING:
            return False
        self.asleep_history = history
        return True

    def sleeps(self) -> bool:
        """Whether it is on no run queue and waits for no disk. Most threads say so in one read."""
        place = os.pread(self.wchan, _WCHAN_BYTES, 0)
        if place.startswith(_SLEEPING_PLACES):
            return True
        return (place != _NOWHERE or self.state() in _STOPPED) and self.rests()

    def still_rests(self) -> bool:
        """Whether it is off every run queue, and had no core since `rests` read its state."""
        return self.off_the_queues() and self.history() == self.asleep_history

    def off_the_queues(self) -> bool:
        """Whether it is on no run queue.

        Its state alone does not say so: a thread that is about to wait calls itself asleep already, and may be kept from its
        core for long before it is, or finds that it need not wait.
        """
        return os.pread(self.wchan, 1, 0) != _NOWHERE or self.state() in _STOPPED

    def history(self) -> bytes:
        """CPU time, run delay and how often it was given a core; the same bytes as long as it has not run."""
        return os.pread(self.schedstat, _SCHEDSTAT_BYTES, 0)

    def close(self) -> None:
        os.close(self.stat)
        os.close(self.schedstat)
        os.close(self.wchan)


@dataclass(slots=True)
class WatchedProcess:
    """One process of the tree. `inner_pid` is its number as it sees itself, in the innermost of its namespaces."""

    pid: int
    folder: int
    inner_pid: int
    # Of the kernel, as clock_getcpuclockid(3) makes it: the CPU time of all its threads.
    cpu_clock: int
    threads: dict[int, _Thread] = field(default_factory=dict)
    # The program in which the library was last seen: there is another one after an exec.
    program: tuple[int, int] | None = None
    unentered_since_s: float | None = None

    def close(self) -> None:
        for thread in self.threads.values():
            thread.close()
        os.close(self.folder)


class ProcessThreads:
    """All threads of the processes below `root`, and of `root` itself unless it is only the box around them.

    With `with_bench` the threads of this process besides the calling one must rest too: they carry the air network, and what
    they have in hand is on its way to the agent. While `with_group` is set the processes of `root`'s group belong to the
    tree too, also those whose parents have ended.
    """

    def __init__(self, root: int, *, root_is_box: bool, with_bench: bool) -> None:
        self._root, self._root_is_box, self._with_bench = root, root_is_box, with_bench
        self.with_group = False
        self.processes: dict[int, WatchedProcess] = {}
        self._box: dict[int, WatchedProcess] = {}
        self._bench: dict[int, _Thread] = {}
        self._order: list[_Thread] = []
        self._clocks: list[int] = []
        self._ended_cpu_ns = 0
        self._last_pid = os.open(_LAST_PID, os.O_RDONLY | os.O_CLOEXEC)
        self._seen_pid = b""
        self.scans = 0

    def close(self) -> None:
        """Let go of everything that is watched."""
        for process in (*self.processes.values(), *self._box.values()):
            process.close()
        for thread in self._bench.values():
            thread.close()
        self.processes, self._box, self._bench, self._order, self._clocks = {}, {}, {}, [], []
        if self._last_pid >= 0:
            os.close(self._last_pid)
            self._last_pid = -1

    def at_rest(self) -> bool:
        """Whether there was a moment during this call at which every thread was asleep, and none about to run.

        Each thread is found asleep and off the run queues, between two looks at the CPU time of all. Where no time was used, nobody ran
        between them, and so nobody woke another behind its look, and went to sleep before its own: at the moment of the first
        look all slept. The bench's threads have no clock without the calling one, so each is looked at before and behind that
        moment: one that called itself asleep before, is off the run queues behind, and was given no core between has slept all
        the time. Whoever could still wake one of them is outside: the clock, and what the bench sends.
        """
        try:
            if self._newest_pid() != self._seen_pid:
                self.scan()
            if not all(thread.rests() for thread in self._bench.values()):
                return False
            cpu_ns = self._cpu_ns()
            for thread in self._order:
                if not thread.sleeps():
                    self._put_first(thread)
                    return False
            if self._cpu_ns() != cpu_ns or not all(thread.still_rests() for thread in self._bench.values()):
                return False
            # A process or thread that began meanwhile was not looked at.
            return self._newest_pid() == self._seen_pid
        except OSError:
            self._seen_pid = b""
            return False

    def cpu_s(self) -> float:
        """CPU seconds of all threads of the tree so far, as far as they were seen."""
        total_ns = self._ended_cpu_ns
        for process in self.processes.values():
            for thread in process.threads.values():
                with suppress(OSError, ValueError, IndexError):
                    thread.cpu_ns = int(thread.history().split()[0])
                total_ns += thread.cpu_ns
        return total_ns / 1e9

    def inner_pids(self) -> set[int]:
        """The processes as they see themselves."""
        return {process.inner_pid for process in self.processes.values()}

    def scan(self) -> None:
        """Find processes and threads that are new, and forget those that have ended."""
        self.scans += 1
        self._seen_pid = self._newest_pid()
        group = _group_members(self._root) if self.with_group else ()
        waiting = [self._root, *self.processes, *group]
        scanned: set[int] = set()
        while waiting:
            pid = waiting.pop()
            if pid in scanned:
                continue
            scanned.add(pid)
            is_box = pid == self._root and self._root_is_box
            known = self._box if is_box else self.processes
            process = known.get(pid) or _open_process(pid)
            if process is None:
                continue
            known[pid] = process
            if self._refresh(process):
                waiting += _children(process)
            else:
                self._forget(known, process)
        if self._with_bench:
            self._refresh_bench()
        self._order = [
            *(thread for process in self.processes.values() for thread in process.threads.values()),
            # The box takes note of the agent's end, and of what its children leave behind.
            *(thread for process in self._box.values() for thread in process.threads.values()),
        ]
        self._clocks = [process.cpu_clock for process in (*self.processes.values(), *self._box.values())]

    def _put_first(self, thread: _Thread) -> None:
        """Who is at work now is probably at work at the next look, which ends with the first of them."""
        self._order.remove(thread)
        self._order.insert(0, thread)

    def _cpu_ns(self) -> int:
        return sum(map(time.clock_gettime_ns, self._clocks))

    def _newest_pid(self) -> bytes:
        """The number that was given to a process or thread last, in the namespace of this process."""
        return os.pread(self._last_pid, 128, 0).rpartition(b" ")[2]

    def _refresh(self, process: WatchedProcess) -> bool:
        """Whether the process still runs; its threads are up to date afterwards."""
        try:
            present = {int(name) for name in os.listdir(process.folder)}
        except OSError:
            return False
        for tid in process.threads.keys() - present:
            thread = process.threads.pop(tid)
            self._ended_cpu_ns += thread.cpu_ns
            thread.close()
        for tid in present - process.threads.keys():
            with suppress(OSError):
                process.threads[tid] = _open_thread(process.folder, tid)
        return any(_lives(thread) for thread in process.threads.values())

    def _refresh_bench(self) -> None:
        present = {int(name) for name in os.listdir("/proc/self/task")} - {threading.get_native_id()}
        for tid in self._bench.keys() - present:
            self._bench.pop(tid).close()
        new = present - self._bench.keys()
        if new:
            folder = os.open("/proc/self/task", os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            for tid in new:
                with suppress(OSError):
                    self._bench[tid] = _open_thread(folder, tid)
            os.close(folder)

    def _forget(self, known: dict[int, WatchedProcess], process: WatchedProcess) -> None:
        self._ended_cpu_ns += sum(thread.cpu_ns for thread in process.threads.values())
        process.close()
        del known[process.pid]


def _open_process(pid: int) -> WatchedProcess | None:
    with suppress(OSError, ValueError, IndexError):
        folder = os.open(f"/proc/{pid}/task", os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            return WatchedProcess(pid, folder, _inner_pid(pid), _cpu_clock(pid))
        except BaseException:
            os.close(folder)
            raise
    return None


def _cpu_clock(pid: int) -> int:
    return ~pid << 3 | _CPUCLOCK_SCHED


def _inner_pid(pid: int) -> int:
    # Replaced: a process may call itself what is no UTF-8, and is to be watched all the same.
    for line in Path(f"/proc/{pid}/status").read_text(encoding="utf-8", errors="replace").splitlines():
        if line.startswith("NSpid:"):
            return int(line.split()[-1])
    return pid


def _open_thread(folder: int, tid: int) -> _Thread:
    opened: list[int] = []
    try:
        for name in ("stat", "schedstat", "wchan"):
            opened.append(os.open(f"{tid}/{name}", os.O_RDONLY | os.O_CLOEXEC, dir_fd=folder))
    except OSError:
        for descriptor in opened:
            os.close(descriptor)
        raise
    stat, schedstat, wchan = opened
    return _Thread(stat, schedstat, wchan)


def _lives(thread: _Thread) -> bool:
    with suppress(OSError, ValueError):
        return thread.state() not in b"ZX"
    return False


def _children(process: WatchedProcess) -> Generator[int]:
    for tid in process.threads:
        with suppress(OSError, ValueError):
            descriptor = os.open(f"{tid}/children", os.O_RDONLY | os.O_CLOEXEC, dir_fd=process.folder)
            try:
                yield from map(int, os.read(descriptor, 65536).split())
            finally:
                os.close(descriptor)


def _group_members(group: int) -> Generator[int]:
    for name in os.listdir("/proc"):
        if name.isdigit():
            with suppress(OSError):
                if os.getpgid(int(name)) == group:
                    yield int(name)


@cache
def unseen_reason() -> str:
    """Why this system does not show whether a thread is asleep; empty where it does."""
    try:
        time.clock_gettime_ns(_cpu_clock(os.getpid()))
    except OSError as error:
        return f"the CPU clock of a process cannot be read ({error.strerror})"
    woken = threading.Event()
    sleeper = threading.Thread(target=woken.wait, daemon=True)
    sleeper.start()
    try:
        folder = os.open("/proc/self/task", os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            thread = _open_thread(folder, sleeper.native_id or 0)
        finally:
            os.close(folder)
        deadline_s = time.monotonic() + _PROBE_S
        while not (asleep := thread.rests() and thread.still_rests()) and time.monotonic() < deadline_s:
            time.sleep(0.001)
        has_history = thread.history().split()[-1:] not in ([], [b"0"])
        thread.close()
    except OSError as error:
        return f"{error.filename} cannot be read"
    finally:
        woken.set()
        sleeper.join()
    if not asleep:
        return "/proc/PID/wchan says nothing here (the kernel needs CONFIG_KALLSYMS and CONFIG_STACKTRACE)"
    if not has_history:
        return "/proc/PID/schedstat says nothing here (the kernel needs CONFIG_SCHED_INFO)"
    return ""
