"""Simulated time that goes on only when nobody in the agent is due or runnable."""

from __future__ import annotations

import ctypes
import math
import os
import shutil
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench.contracts import Outcome, ProcessRoot, SimTime, WarpAccess
from bench.errors import SetupError
from bench.process_threads import ProcessThreads
from bench.temporary_folders import temporary_folder

from .._agent_time import AgentTime
from .._host_clock import HostClock
from .._stop_session import StopSession
from ._library import FIELD, built_library, library_digest
from ._pages import START_NS, WarpPages, make_pages
from ._programs import Programs

CLOCK_FILE, WAITERS_FILE, LIBRARY_FILE = "warp-clock", "warp-waiters", "librebar-warp.so"
# Of ld.so(8): LD_PRELOAD has no way to quote them.
PRELOAD_SEPARATORS = frozenset(" :")
# Moments for which the agent waits are rounded up to this: programs that sleep for microseconds in a loop would otherwise
# stop the session at each of them. Chosen: below what any of the paces' steps shows.
GRAIN_NS = 1_000_000
# What the agent may compute at one moment of simulated time before its CPU clock takes over, as credit that grows by one
# second with each simulated one: a program that keeps up in real time never uses it up. Chosen.
FREE_CPU_S = 1.0
# Looks at an agent that is at work before the first pause: a millisecond, in which most work is done. In between others get
# the core, which on a busy host takes long, and then pauses are shorter: no such looks for a while. Chosen.
LOOKS_BEFORE_PAUSES, SLOW_YIELD_S, BUSY_S = 30, 0.0005, 1.0
# Between two later looks: a tenth to a fifth of the time waited so far, within these limits. Chosen.
SHORTEST_PAUSE_S, LONGEST_PAUSE_S, PAUSE_GROWTH = 0.00002, 0.001, 1.15
# prctl(2): by how much sleeps of the calling thread may end late. By default 0.05 ms, more than most pauses; 0 restores that.
_PR_SET_TIMERSLACK, _SLACK_NS = 29, 1000
# How often a wait looks at CPU time, budgets and the process itself; more often the less credit is left.
CHECK_S, SHORTEST_CHECK_S = 0.05, 0.002
# How often every process is looked at anew for the program that it runs.
PROGRAMS_S = 0.1


@dataclass(slots=True)
class WarpCounts:
    """How a session in warp was paced, for its counters."""

    looks: int = 0
    waits: int = 0
    by_cpu_ns: int = 0

    def counters(self) -> dict[str, int]:
        """By name, as in a result."""
        return {
            "warp_looks": self.looks,
            "warp_waits": self.waits,
            "warp_by_cpu_ms": self.by_cpu_ns // 1_000_000,
        }


@dataclass(frozen=True, slots=True)
class _Account:
    """The agent's CPU seconds, the host seconds for which the session waited for it, and its clock, at one moment."""

    cpu_s: float
    waited_s: float
    now_ns: int


class Warp:
    """Sets the agent's clock, and waits at each moment until the agent has done all that it does then.

    `check` is called during waits; it raises StopSession when the agent has ended or the session's time is up.
    """

    def __init__(self, pages: WarpPages, access: WarpAccess, clock: HostClock) -> None:
        self.access = access
        self.counts = WarpCounts()
        self.agent_has_spoken = False
        """Whether the agent has said anything yet."""
        self.agent_is_informed = False
        """Whether the agent has been told anything of its situation yet."""
        self.start_budget_s = FREE_CPU_S
        self._pages = pages
        self._clock = clock
        self._threads: ProcessThreads | None = None
        self._programs: Programs | None = None
        self._agent_time: AgentTime | None = None
        self._check: Callable[[], None] = lambda: None
        self._scans = 0
        self._looked_s = 0.0
        self._by_cpu = False
        self._busy_until_s = -math.inf
        self._credit_s = FREE_CPU_S
        self._accounted = _Account(0.0, 0.0, START_NS)

    @property
    def description(self) -> str:
        """The library, for the provenance of a result."""
        return f"library sha256:{library_digest(self.access.library)}"

    def watch(
        self, root: ProcessRoot, check: Callable[[], None], agent_time: AgentTime, *, with_bench: bool
    ) -> None:
        """The started agent. `with_bench`: threads of this process carry the air network, and are waited for too."""
        self._threads = ProcessThreads(root.pid, root_is_box=root.is_box, with_bench=with_bench)
        self._programs = Programs(self._threads)
        self._check, self._agent_time = check, agent_time
        self._credit_s = self.start_budget_s
        # Not before: what the agent starts would inherit it.
        _set_timer_slack(_SLACK_NS)

    def settle(self) -> None:
        """Wait until the agent rests: it has taken in what was sent, done what was due, and waits for more.

        Returns at once while an agent that computes without end is paced by its CPU clock.
        """
        if self._rests():
            self._by_cpu = False
        elif not self._by_cpu:
            self._wait()

    def run_until(self, time: SimTime) -> None:
        """Let the agent live until `time`: its clock goes from one moment for which it waits to the next."""
        until_ns = START_NS + time.ns
        if self._by_cpu:
            self._wait()
            if self._by_cpu:
                self.counts.by_cpu_ns += until_ns - self._pages.now_ns
        while not self._by_cpu:
            earliest_ns = self._pages.earliest_ns()
            if earliest_ns is None or earliest_ns > until_ns:
                break
            moment_ns = -(-max(earliest_ns, self._pages.now_ns) // GRAIN_NS) * GRAIN_NS
            self._pages.set_now(min(moment_ns, until_ns))
            self.settle()
        self._pages.set_now(until_ns)

    def release(self) -> None:
        """The session is over: the agent's time goes on by itself, so that it can end in good order."""
        self._pages.release()

    def close(self) -> None:
        """Let go of the agent's processes and of its page."""
        self._pages.close()
        if self._threads is not None:
            self._threads.close()
            _set_timer_slack(0)

    def _rests(self) -> bool:
        """One look: nobody is due, every process has the library, and all threads sleep."""
        assert self._threads is not None
        assert self._programs is not None
        self.counts.looks += 1
        is_due = self._pages.is_due()
        if is_due:
            self._pages.wake_due()
        rests = not is_due and self._threads.at_rest()
        if not self._threads.processes:
            # It has not started yet, or has ended.
            self._check()
            return False
        # From time to time also where somebody is at work: it may be a program that the library does not reach.
        is_new = self._threads.scans != self._scans or self._clock.now() > self._looked_s + PROGRAMS_S
        if is_new or (rests and not self._programs.unchanged()):
            rests = self._have_entered() and rests
        return rests and not self._pages.is_due()

    def _have_entered(self) -> bool:
        assert self._threads is not None
        assert self._programs is not None
        if self._pages.overflowed:
            raise StopSession(
                Outcome.AGENT_FLOODED,
                "the agent has more processes or waits at once than warp can follow (docs/time.md)",
            )
        now_s = self._clock.now()
        entered = self._pages.entered()
        if entered - self._threads.inner_pids():
            # What is not found after it has entered has ended.
            self._threads.scan()
            self._pages.forget(entered - self._threads.inner_pids())
        unentered = self._programs.unentered(entered)
        for process in unentered:
            if reason := self._programs.refusal(process, now_s):
                # Later it would be a way to drop a run that goes badly: such runs are not scored.
                outcome = Outcome.AGENT_PROTOCOL if self.agent_is_informed else Outcome.SETUP_INVALID
                raise StopSession(outcome, f"{reason} (docs/time.md); fly it with --pace realtime")
        if not unentered:
            self._scans, self._looked_s = self._threads.scans, now_s
        return not unentered

    def _wait(self) -> None:
        """Wait until the agent rests, or has used up what it may compute: then it is paced by its CPU clock."""
        assert self._agent_time is not None
        self.counts.waits += 1
        with self._agent_time.waiting():
            checked_s = self._clock.now()
            pause_s, looks = SHORTEST_PAUSE_S, 0
            while not self._rests():
                now_s = self._clock.now()
                if now_s - checked_s > min(CHECK_S, max(self._credit_s, SHORTEST_CHECK_S)):
                    checked_s = now_s
                    self._check()
                    self._settle_account(self._agent_time.waited_s)
                    if self._credit_s <= 0:
                        self._by_cpu = True
                        return
                looks += 1
                if looks < LOOKS_BEFORE_PAUSES and now_s >= self._busy_until_s:
                    os.sched_yield()
                    if self._clock.now() - now_s > SLOW_YIELD_S:
                        self._busy_until_s = now_s + BUSY_S
                    continue
                self._clock.sleep(pause_s)
                pause_s = min(pause_s * PAUSE_GROWTH, LONGEST_PAUSE_S)
        self._by_cpu = False

    def _settle_account(self, waited_s: float) -> None:
        """Bring the credit up to date: what the agent has computed since the last time against what it has lived."""
        assert self._threads is not None
        last, present = self._accounted, _Account(self._threads.cpu_s(), waited_s, self._pages.now_ns)
        # Of several threads at once the host's clock counts, as it would in real time.
        used_s = min(present.cpu_s - last.cpu_s, present.waited_s - last.waited_s)
        lived_s = (present.now_ns - last.now_ns) / 1e9
        most_s = FREE_CPU_S if self.agent_has_spoken else self.start_budget_s
        self._credit_s = min(self._credit_s + lived_s - used_s, most_s)
        self._accounted = present


def _set_timer_slack(slack_ns: int) -> None:
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, slack_ns, 0, 0, 0)


@contextmanager
def open_warp(scratch: Path, utc_ns: int, clock: HostClock) -> Generator[Warp]:
    """The pages and the library of one session, in the agent's folder.

    Raises SetupError where the library cannot be had, or not be named in LD_PRELOAD.
    """
    scratch.mkdir(parents=True, exist_ok=True)
    library = scratch / LIBRARY_FILE
    # Not bound from the cache: the agent may be a user who cannot look into ours.
    shutil.copyfile(built_library(), library)
    library.chmod(0o755)
    with _preloadable(library) as link:
        access = WarpAccess(library, scratch / CLOCK_FILE, scratch / WAITERS_FILE, link)
        warp = Warp(make_pages(access.clock, access.waiters, utc_ns), access, clock)
        try:
            yield warp
        finally:
            warp.close()


@contextmanager
def _preloadable(library: Path) -> Generator[Path | None]:
    """A link to the library whose name the dynamic linker reads as one; None where the library's own name is such."""
    if not PRELOAD_SEPARATORS.intersection(str(library)):
        yield None
        return
    parent = next(
        (name for name in (tempfile.gettempdir(), "/tmp") if not PRELOAD_SEPARATORS.intersection(name)), None
    )
    if parent is None:
        what = f"LD_PRELOAD cannot name {library}: it has a space or a colon, and so has the folder of temporary files"
        raise SetupError(FIELD, what, "write into another folder (--out), or fly with --pace realtime")
    with temporary_folder("warp", Path(parent)) as folder:
        # An agent under Landlock may be another user. What it may read is decided where the link leads to.
        folder.chmod(0o711)
        link = folder / LIBRARY_FILE
        link.symlink_to(library)
        yield link
