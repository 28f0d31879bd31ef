"""Hands the realizations that wait to an executor, and takes in their results."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import anyio
from anyio.abc import TaskGroup

from bench.contracts import Outcome, ProgressUpdate, SessionResult
from bench.errors import SetupError
from bench.realization import RealizationPlan

from .._events import (
    CampaignStopping,
    MissingRunsRetried,
    Observers,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
    SessionProgressed,
)
from ..early_stopping._decisions import PointKey
from ..early_stopping._early_stopping import EarlyStopping
from ..storage._completeness import PROVISIONAL_OUTCOMES
from ..storage._folder import CampaignFolder
from ..storage._journal import Journal, RealizationState
from ..storage._pause import take_retry_request
from ..storage._recovery import reset_for_rerun
from ..storage._results import ResultStore
from ._attempts import Attempts
from ._event_loop import HostClock, StopRequest
from ._executor import Executor, Task

MIN_FREE_BYTES = 1024 * 1024
"""With less free space on the disk a failed session is taken for one that a full disk stopped."""

# The agent's scratch folder is on the same disk as the campaign's: an agent that cannot write crashes or
# hangs.
_STOPPED_BY_A_FULL_DISK = PROVISIONAL_OUTCOMES | {
    Outcome.AGENT_CRASHED,
    Outcome.AGENT_TIMEOUT,
    Outcome.AGENT_NEVER_CONNECTED,
}


StartGate = Callable[[str], bool]
"""Whether a realization may start now. Asked again and again, a few times a second, until it may."""
GATE_S = 0.2
"""Host seconds between two questions to a closed gate. Chosen: a test stand takes longer than that to get ready."""


def no_gate(realization: str) -> bool:
    """Let every realization start at once."""
    del realization
    return True


@dataclass(frozen=True, slots=True)
class Deadline:
    """A reading of `clock`, in host seconds, after which no further session is started."""

    clock: HostClock
    at: float

    @property
    def left_s(self) -> float:
        """Host seconds until the deadline; zero or less once it has passed."""
        return self.at - self.clock()


@dataclass(frozen=True, slots=True)
class OpenCampaign:
    """A campaign's folder and journal while they are open, and what its events go to."""

    folder: CampaignFolder
    journal: Journal
    observers: Observers


class Dispatcher:
    """One run over the realizations of a campaign that have no result yet."""

    def __init__(
        self,
        campaign: OpenCampaign,
        plans: Sequence[RealizationPlan],
        early_stopping: EarlyStopping,
        attempts: Attempts,
        results: ResultStore,
        clock: HostClock,
        gate: StartGate = no_gate,
    ) -> None:
        self._folder, self._journal = campaign.folder, campaign.journal
        self._observers, self._early_stopping = campaign.observers, early_stopping
        self._attempts, self._results = attempts, results
        self._clock, self._gate, self._gate_is_closed = clock, gate, False
        self._running: dict[str, PointKey | None] = {}
        self._session_ended = anyio.Event()
        self.total = len(plans)
        # Planning compared the files in simspecs/ with the journal's digests: none has to be read again for
        # its budget.
        self._wall_s = {plan.id: plan.situation.budgets.wall_s for plan in plans}
        self.flown = 0
        self.stopped: str | None = None
        entries = self._journal.entries()
        self.done = sum(entry.state is RealizationState.DONE for entry in entries)
        # Realizations to start, in the order of the plan.
        self.waiting = deque(entry.id for entry in entries if entry.state is not RealizationState.DONE)

    async def fly(
        self, executor: Executor, workers: int, stop: StopRequest, deadline: Deadline | None
    ) -> None:
        """Fly realizations, `workers` at a time, until all are done, a stop is requested, or the total budget is spent.

        A stop cancels the sessions that fly; a spent budget lets them end by their own.
        """
        with stop.scope:
            async with anyio.create_task_group() as flights:
                await self._start_all(executor, workers, flights, deadline)
        self.stopped = stop.reason or ("the campaign's total wall budget is spent" if self.waiting else None)
        if self.stopped is not None:
            self._observers.notify(CampaignStopping(self.stopped))

    async def _start_all(
        self, executor: Executor, workers: int, flights: TaskGroup, deadline: Deadline | None
    ) -> None:
        """Start realizations as long as there are any, or may be after a retry, and the budget lasts."""
        while deadline is None or deadline.left_s > 0.0:
            if take_retry_request(self._folder.path):
                self._retry_missing()
            # Read once: a pause that ended between two readings would be neither due nor waited for.
            now = self._clock()
            while len(self._running) < workers and (realization := self._next_realization(now)) is not None:
                self._running[realization] = self._early_stopping.key(realization)
                flights.start_soon(self._fly_one, executor, realization)
            # Without room a pause that is over starts nothing; the end of a session does.
            pause_s = self._pause_s(now) if len(self._running) < workers else None
            if not self._running and (pause_s is None or not self.waiting):
                return
            spans_s = [pause_s if self.waiting else None, None if deadline is None else deadline.left_s]
            await self._wait(min((span_s for span_s in spans_s if span_s is not None), default=None))

    async def _wait(self, span_s: float | None) -> None:
        """Wait until a session ends, for `span_s` host seconds at most."""
        async with anyio.create_task_group() as race:
            if span_s is not None:
                race.start_soon(self._cancel_after, span_s, race.cancel_scope)
            await self._session_ended.wait()
            race.cancel_scope.cancel()
        # Nothing awaits between here and the next look at what waits: no end of a session is missed.
        self._session_ended = anyio.Event()

    async def _cancel_after(self, span_s: float, scope: anyio.CancelScope) -> None:
        await self._clock.sleep(span_s)
        scope.cancel()

    async def _fly_one(self, executor: Executor, realization: str) -> None:
        """Fly a realization once, as a task of its own."""
        task = self._task(realization)
        result = await executor.fly(
            task, partial(self._note_start, realization), partial(self._tell_progress, realization)
        )
        # It would replace a result that may be in scores already.
        if result.realization != realization:
            raise TypeError(
                f"the executor returned the result of {result.realization}, not that of {realization}"
            )
        self._take_in(result)
        self._session_ended.set()

    def _retry_missing(self) -> None:
        """Plan again what ended by a fault of the host or the bench, and end the pauses of what waits for a retry."""
        missing = reset_for_rerun(self._folder, self._journal)
        for realization in missing:
            self._early_stopping.forget(realization)
        self.waiting.extend(missing)
        self.done -= len(missing)
        self._attempts.retries.restart(self.waiting)
        self._observers.notify(MissingRunsRetried(tuple(missing), done=self.done, total=self.total))

    def _pause_s(self, now: float) -> float | None:
        """Host seconds until something may be startable that is not now; None if only the end of a session helps."""
        pauses_s = [
            self._attempts.retries.next_due_s(self.waiting, now),
            GATE_S if self._gate_is_closed else None,
        ]
        return min((pause_s for pause_s in pauses_s if pause_s is not None), default=None)

    def finish(self, result: SessionResult) -> None:
        """Count a result that was written and noted, and notify the observers."""
        self._early_stopping.record(result)
        self.done += 1
        self.flown += result.outcome is not Outcome.SETTLED
        if result.realization in self.waiting:
            self.waiting.remove(result.realization)
        self._observers.notify(
            RealizationFinished(
                result.realization,
                result.outcome,
                result.reason,
                result.wall_s,
                done=self.done,
                total=self.total,
            )
        )

    def stop_decided_points(self) -> None:
        """Stop every design point that the results so far decide, and reopen those that they do not."""
        for key in self._early_stopping.keys:
            self._decide(key)

    def _decide(self, key: PointKey) -> None:
        reopened = self._early_stopping.reopen(key)
        self.waiting.extend(reopened)
        self.done -= len(reopened)
        for result in self._early_stopping.stop(key, self.waiting):
            self.finish(result)

    def _next_realization(self, now: float) -> str | None:
        """Take the next realization out of `waiting`. None if none can be started before a running one ends.

        With early stopping a design point of which nothing is running comes first: its next replicate is the
        one that is most surely needed.
        """
        running = {key for key in self._running.values() if key is not None}

        # One after another, up to the first that fits: at each start a look at all would be the square of them.
        def startable() -> Iterator[str]:
            for name in self.waiting:
                if self._attempts.retries.is_due(name, now) and self._early_stopping.may_start(name):
                    yield name

        idle = (name for name in startable() if self._early_stopping.key(name) not in running)
        realization = next(idle, None) or next(startable(), None)
        self._gate_is_closed = realization is not None and not self._gate(realization)
        if realization is None or self._gate_is_closed:
            return None
        self.waiting.remove(realization)
        return realization

    def _task(self, realization: str) -> Task:
        simspec = self._folder.simspec(realization)
        run = self._folder.fresh_run(realization)
        return Task(realization, simspec, run, self._wall_s[realization], self._attempts.job(realization))

    def _note_start(self, realization: str, worker: str) -> None:
        self._attempts.start(realization)
        attempt = self._journal.start(realization, worker)
        self._observers.notify(RealizationStarted(realization, worker, attempt))

    def _tell_progress(self, realization: str, update: ProgressUpdate) -> None:
        self._observers.notify(SessionProgressed(realization, update))

    def _take_in(self, result: SessionResult) -> None:
        key = self._running.pop(result.realization)
        if result.outcome in _STOPPED_BY_A_FULL_DISK and _is_full(self._folder.path):
            raise SetupError(
                self._folder.path, "the disk is full", "free some space and run again; no result is lost"
            )
        pause_s = self._attempts.pause_s(result, self._clock())
        if pause_s is not None:
            self._journal.retry(result.realization, result.outcome, result.reason)
            self.waiting.append(result.realization)
            self._observers.notify(
                RealizationRetried(result.realization, result.outcome, result.reason, pause_s)
            )
        else:
            result = self._attempts.marked(result)
            self._results.add(result)
            self.finish(result)
        if key is not None:
            self._decide(key)
        self._attempts.check_bench(result)


def _is_full(folder: Path) -> bool:
    """Whether the disk has no room for another session, in bytes or in files."""
    disk = os.statvfs(folder)
    # Some file systems state no number of files at all.
    out_of_files = disk.f_files > 0 and disk.f_favail == 0
    return disk.f_bavail * disk.f_frsize < MIN_FREE_BYTES or out_of_files
