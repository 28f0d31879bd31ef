"""Running a campaign: every realization exactly once, whatever happens to sessions, workers or the runner itself."""

from __future__ import annotations

import os
import shutil
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bench.contracts import Outcome, SessionResult
from bench.errors import Fault, SetupError
from bench.simspec import SimSpec

from ._document import Campaign
from ._events import (
    CampaignEvent,
    CampaignPlanned,
    CampaignStopping,
    Observer,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
)
from ._overhead import OVERHEAD, check_fidelity, flown_overhead, job_at
from ._versions import versions
from .early_stopping._decisions import Key, check_stopping, outcome_name
from .early_stopping._early_stopping import Settling
from .execution._pool import Executor, OpenExecutor, open_local_pool
from .execution._stop_request import Stop, open_stop
from .execution._task import FLY, BenchBroken, Ended, Task, WorkerPlan
from .planning._plan import plan_campaign, unflyable
from .storage._folder import RESULT, CampaignFolder, digest_of, open_lock, read_result, write_manifest, write_result
from .storage._journal import Journal, State, open_journal

if TYPE_CHECKING:
    from decompositions import Decomposition

AGAIN = frozenset({Outcome.WORKER_LOST, Outcome.BENCH_ERROR})
"""Faults of the bench's own: flown once more, because the agent is not to answer for them."""

TRIES = 2

FIRST = 5
"""So many sessions at the start of a run that all end by a fault of the bench's own are enough to know that it is broken."""

ASKABLE = AGAIN | {Outcome.WALL_BUDGET, Outcome.SETUP_INVALID}
"""Outcomes that may be asked to be flown again: no doing of the agent's, and another time it may end otherwise."""

ROOM_BYTES = 1024 * 1024
"""With less than this left on the disk, a fault of the bench's own is the disk's, and no result to keep."""

Finish = Callable[[CampaignFolder], None]
"""Makes scores and report of a campaign that has all its results; `manifest.json` is written after it."""


@dataclass(frozen=True, slots=True)
class CampaignSummary:
    """How a run of a campaign ended. `flown` counts the results of this run, `outcomes` all that the folder has."""

    folder: Path
    total: int
    flown: int
    outcomes: Mapping[Outcome, int]
    stopped: str | None
    observer_faults: int
    wall_s: float

    @property
    def done(self) -> int:
        """Realizations that have a result."""
        return sum(self.outcomes.values())

    @property
    def complete(self) -> bool:
        """Whether every realization has a result."""
        return self.done == self.total


def run_campaign(
    campaign: Campaign,
    folder: Path,
    decomposition: Decomposition,
    *,
    workers: int | None = None,
    on_event: Observer | None = None,
    finish: Finish | None = None,
    again: Collection[Outcome] = (),
    job: str = FLY,
    open_executor: OpenExecutor = open_local_pool,
) -> CampaignSummary:
    """Fly whatever of the campaign has no result in `folder` yet, and return when all have one or somebody asked to stop.

    Call it again on the same folder to go on. `workers` overrides the campaign's budget, which overrides the number of
    cores. Realizations that ended as one of `again` are flown once more, their results kept in aside/.

    Raises SetupError for a campaign that cannot be realized and for a folder that is in use or of another campaign,
    WorkersUnusable when no worker process comes up, BenchBroken when the first sessions all end by the bench's own faults.
    Sessions that fail are results, never exceptions.
    """
    place = CampaignFolder(folder)
    began = time.monotonic()
    outcomes_named(again)
    if campaign.stopping is not None:
        check_stopping(campaign.stopping, decomposition)
    with open_lock(folder), open_journal(place.journal) as journal:
        told = _Told(on_event)
        journal.release()
        check_fidelity(campaign, journal)
        plans = plan_campaign(campaign, place, journal, decomposition)
        _reconcile(place, journal)
        _fly_again(place, journal, again)
        run = _Run(place, journal, told, Settling(campaign.stopping, decomposition, place, journal), total=len(plans))
        told(CampaignPlanned(run.total, run.done))
        for result in unflyable(plans, place, journal):
            run.tell_finished(result)
        for result in flown_overhead(place, journal, decomposition) if campaign.fidelity == OVERHEAD else ():
            run.tell_finished(result)
        run.settle_all()
        if run.waiting:
            limit = workers or campaign.budgets.workers or len(os.sched_getaffinity(0))
            shared = WorkerPlan(job_at(campaign.fidelity, job), decomposition)
            with open_stop() as stop, open_executor(shared, min(limit, len(run.waiting)), folder) as executor:
                run.fly(executor, stop, _deadline(campaign, began))
            journal.release()  # what was ended with the executor is planned again
        if run.done == run.total:
            if finish is not None:
                finish(place)
            write_manifest(place, campaign.name, decomposition.digest, _counted(journal), versions())
        return CampaignSummary(
            folder=folder,
            total=run.total,
            flown=run.flown,
            outcomes=_outcomes(journal),
            stopped=run.stopped,
            observer_faults=told.faults,
            wall_s=time.monotonic() - began,
        )


def _deadline(campaign: Campaign, began: float) -> float | None:
    budget = campaign.budgets.total_wall_s
    return None if budget is None else began + budget


def _outcomes(journal: Journal) -> dict[Outcome, int]:
    return dict(Counter(entry.outcome for entry in journal.entries() if entry.outcome is not None))


def _counted(journal: Journal) -> dict[str, int]:
    stops = journal.stops()
    ended = [(entry, entry.outcome) for entry in journal.entries() if entry.outcome is not None]
    return dict(Counter(outcome_name(entry, outcome, stops) for entry, outcome in ended))


def outcomes_named(names: Collection[str]) -> frozenset[Outcome]:
    """The outcomes of these names. Raises SetupError for one that is none, or may not be asked to be flown again."""
    wrong = sorted(set(names) - ASKABLE)
    if wrong:
        remedy = f"give {', '.join(sorted(ASKABLE))}"
        raise SetupError([Fault("again", f"what ended as {one!s} is not flown again", remedy) for one in wrong])
    return frozenset(map(Outcome, names))


def _fly_again(folder: CampaignFolder, journal: Journal, again: Collection[Outcome]) -> None:
    """Plan those that ended so once more. The result is moved first: a crash in between leaves a realization without one."""
    for entry in journal.entries():
        if entry.outcome in again:
            folder.set_aside(entry.id, entry.attempts)
            journal.forget(entry.id)


def _reconcile(folder: CampaignFolder, journal: Journal) -> None:
    """Make journal and run folders say the same: a whole result counts even if the runner died before it could note it,
    and a result that is no longer there, or is not the one that was noted, is flown again."""
    for entry in journal.entries():
        run = folder.run(entry.id)
        result = read_result(run, entry.id)
        if entry.state is State.DONE and (result is None or digest_of(run / RESULT) != entry.result_sha256):
            journal.forget(entry.id)
        elif result is not None and entry.state is not State.DONE:
            journal.finish(result, digest_of(run / RESULT))


class _Told:
    """The observer, whose failures are counted and kept from the run."""

    def __init__(self, observer: Observer | None) -> None:
        self._observer = observer
        self.faults = 0

    def __call__(self, event: CampaignEvent) -> None:
        if self._observer is None:
            return
        try:
            self._observer(event)
        except Exception:
            self.faults += 1


class _Run:
    """One run over the realizations that wait."""

    def __init__(self, folder: CampaignFolder, journal: Journal, told: _Told, settling: Settling, total: int) -> None:
        self._folder, self._journal, self._told, self._settling = folder, journal, told, settling
        self.total = total
        self.flown = 0
        self.stopped: str | None = None
        self._out: dict[str, Key | None] = {}
        self._broken: set[str] | None = set()
        entries = journal.entries()
        self.done = sum(entry.state is State.DONE for entry in entries)
        self._waiting = deque(entry.id for entry in entries if entry.state is not State.DONE)

    @property
    def waiting(self) -> deque[str]:
        """Realizations to begin, in the order of the plan."""
        return self._waiting

    def fly(self, executor: Executor, stop: Stop, deadline: float | None) -> None:
        """Hand out until all are done, somebody asks to stop, or the total budget is spent."""
        while stop.reason is None:
            over = deadline is not None and time.monotonic() >= deadline
            while self._waiting and executor.free and not over:
                self._begin(executor, self._next())
            if not executor.busy:
                break
            left_s = None if deadline is None or over else deadline - time.monotonic()
            for ended in executor.wait(left_s, stop.wake_fd):
                self._settle(ended)
        self.stopped = stop.reason or ("the campaign's total wall budget is spent" if self._waiting else None)
        if self.stopped is not None:
            self._told(CampaignStopping(self.stopped))

    def tell_finished(self, result: SessionResult) -> None:
        """A result was written and noted."""
        self._settling.hear(result)
        self.done += 1
        self.flown += result.outcome is not Outcome.SETTLED
        if result.realization in self._waiting:
            self._waiting.remove(result.realization)
        finished = RealizationFinished(
            result.realization, result.outcome, result.reason, result.wall_s, done=self.done, total=self.total
        )
        self._told(finished)

    def settle_all(self) -> None:
        """Look at every design point."""
        for key in self._settling.keys:
            self._look(key)

    def _look(self, key: Key | None) -> None:
        if key is None:
            return
        reopened = self._settling.reopen(key)
        self._waiting.extend(reopened)
        self.done -= len(reopened)
        for result in self._settling.end(key, self._waiting):
            self.tell_finished(result)

    def _next(self) -> str:
        """Where design points may end early, first one of a design point that nobody is at: it is needed most surely."""
        busy = {key for key in self._out.values() if key is not None}
        idle = (name for name in self._waiting if self._settling.key(name) not in busy and self._settling.may_begin(name))
        chosen = next(idle, None) or next(name for name in self._waiting if self._settling.may_begin(name))
        self._waiting.remove(chosen)
        return chosen

    def _begin(self, executor: Executor, realization: str) -> None:
        self._out[realization] = self._settling.key(realization)
        simspec = self._folder.simspec(realization)
        wall_s = SimSpec.model_validate_json(simspec.read_bytes()).budgets.wall_s
        worker = executor.submit(Task(realization, simspec, self._folder.fresh_run(realization), wall_s))
        attempt = self._journal.start(realization, worker)
        self._told(RealizationStarted(realization, worker, attempt))

    def _settle(self, ended: Ended) -> None:
        result = ended.result
        key = self._out.pop(result.realization)
        if result.outcome is Outcome.BENCH_ERROR and shutil.disk_usage(self._folder.path).free < ROOM_BYTES:
            raise SetupError(Fault(str(self._folder.path), "its disk is full", "make room and run again; nothing is lost"))
        if result.outcome in AGAIN and self._journal.faults(result.realization) + 1 < TRIES:
            self._journal.again(result.realization, result.outcome, result.reason)
            self._waiting.append(result.realization)
            self._told(RealizationRetried(result.realization, result.outcome, result.reason))
        else:
            self._journal.finish(result, write_result(self._folder.run(result.realization), result))
            self.tell_finished(result)
        self._look(key)
        self._check_sound(result)

    def _check_sound(self, result: SessionResult) -> None:
        """A broken bench is not to burn a campaign. One session that went well is enough to believe in it."""
        if self._broken is None or result.outcome not in AGAIN:
            self._broken = None
            return
        self._broken.add(result.realization)
        if len(self._broken) >= FIRST:
            raise BenchBroken(
                f"the first {FIRST} sessions all ended by faults of the bench's own, so no more are begun; the last: "
                f"{result.outcome}: {result.reason} (mend it and run again; what has such a result already is flown again "
                "with --again bench_error)"
            )
