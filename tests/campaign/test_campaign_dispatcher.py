"""The runner with jobs in the test's own process: repeated reports, random orders, handed-in clocks, coroutines, and
observers that are slow, stuck or many.
"""

from __future__ import annotations

import random
import threading
from collections.abc import AsyncIterator, Awaitable
from contextlib import asynccontextmanager
from multiprocessing import Pipe
from pathlib import Path
from typing import Any, cast

import anyio
import pytest
from campaign_fakes import JOB, TELLING, UPDATES, YARD, Script, entries, fly, small_campaign
from in_process_executor import HostClock, InProcessExecutor, open_in_process

from bench.campaign import (
    CampaignEvent,
    CampaignFolder,
    CampaignPlanned,
    CampaignStopping,
    CampaignSummary,
    Collaborators,
    Executor,
    Jobs,
    OnStart,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
    RunOptions,
    SessionProgressed,
    Task,
    WorkerPlan,
    digest_of,
    open_journal,
    open_local_pool,
    run_campaign,
)
from bench.campaign._events import open_observers
from bench.campaign.execution._worker import _progress_sender
from bench.contracts import OnProgress, Outcome, ProgressUpdate, SessionResult, ignore_progress
from bench.documents import dump_json
from bench.errors import SetupError
from bench.simspec import SimSpec, World
from decompositions import Decomposition


def files(folder: Path) -> dict[str, str]:
    """Digests of everything that a refused run must leave as it is."""
    names = [
        path
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith((".lock", "journal"))
    ]
    return {str(path.relative_to(folder)): digest_of(path) for path in names}


def test_a_result_of_another_realization_is_refused(tmp_path: Path) -> None:
    """An executor that mixes two tasks up ends the run, and no result is noted under a wrong name."""

    class Mixed(InProcessExecutor):
        async def fly(
            self, task: Task, on_start: OnStart, on_progress: OnProgress = ignore_progress
        ) -> SessionResult:
            result = await super().fly(task, on_start, on_progress)
            return result.model_copy(update={"realization": "p003-r2-fake"})

    @asynccontextmanager
    async def open_mixed(plan: WorkerPlan, workers: int, folder: Path) -> AsyncIterator[Mixed]:
        yield Mixed(plan, workers, random.Random(1))

    with pytest.raises(TypeError, match="the result of p003-r2-fake, not that of p001-r2-fake"):
        fly(tmp_path, workers=2, open_executor=open_mixed)

    assert {entry.outcome for entry in entries(tmp_path).values()} == {None}
    assert fly(tmp_path).complete


def test_results_that_the_journal_does_not_have(tmp_path: Path) -> None:
    """As after a kill between writing a result and noting it: one is planned in the journal and one running. Both are
    taken up; a third, whose recording is damaged, is flown again.
    """
    fly(tmp_path, workers=2)
    planned, running, damaged = "p001-r1-fake", "p002-r2-fake", "p003-r1-fake"
    with open_journal(tmp_path / "journal.sqlite") as journal:
        for name in (planned, running, damaged):
            journal.forget(name)
        journal.start(running, "w1")
    CampaignFolder(tmp_path).run(damaged).joinpath("recording.mcap").write_bytes(b"cut off")

    assert fly(tmp_path, workers=2).flown == 1
    after = entries(tmp_path)
    assert {after[name].outcome for name in (planned, running, damaged)} == {Outcome.COMPLETED}
    assert [after[name].attempts for name in (planned, running, damaged)] == [1, 2, 2]


def test_two_campaigns_in_one_folder(tmp_path: Path) -> None:
    """Another campaign with another decomposition is refused with both faults, and leaves every file as it was."""
    fly(tmp_path, workers=2)
    before, journal_before = files(tmp_path), entries(tmp_path)

    with pytest.raises(SetupError) as refusal:
        fly(
            tmp_path,
            small_campaign(wall_s=5.0),
            Script(digest="1" * 64),
            workers=2,
        )

    faults = [fault.what for fault in refusal.value.faults]
    assert len(faults) == 2
    assert "another decomposition" in faults[0]
    assert "p001-r1-fake, p001-r2-fake, p002-r1-fake and 3 more" in faults[1]
    assert (files(tmp_path), entries(tmp_path)) == (before, journal_before)


def test_the_total_budget_starts_nothing_after_it(tmp_path: Path) -> None:
    """By a clock on which every result takes five seconds: a budget of eight is spent after the second."""
    events: list[object] = []

    class ResultClock(HostClock):
        def __call__(self) -> float:
            return 5.0 * len(list(tmp_path.glob("runs/*/result.json")))

    summary = fly(
        tmp_path,
        small_campaign(total_wall_s=8.0),
        workers=1,
        observers=[events.append],
        clock=ResultClock(),
    )

    assert (summary.flown, summary.done, summary.wall_s) == (2, 2, 10.0)
    assert summary.stopped == "the campaign's total wall budget is spent"
    assert sum(isinstance(event, RealizationStarted) for event in events) == 2
    assert sum(isinstance(event, CampaignStopping) for event in events) == 1
    assert fly(tmp_path, small_campaign(), workers=2).flown == 4


SCRIPT = cast(Decomposition, Script())


def fly_here(folder: Path, workers: int, **collaborators: Any) -> Awaitable[CampaignSummary]:
    together = Collaborators(jobs=Jobs(JOB), open_executor=open_in_process(3), **collaborators)
    return run_campaign(small_campaign(), folder, RunOptions(SCRIPT, workers), together)


def test_two_campaigns_at_once_in_one_event_loop(tmp_path: Path) -> None:
    """As in a notebook: the loop goes on with other tasks while both fly."""
    summaries: list[CampaignSummary] = []

    async def one_of_them(name: str) -> None:
        summaries.append(await fly_here(tmp_path / name, workers=2))

    async def both() -> None:
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(one_of_them, "first")
            tasks.start_soon(one_of_them, "second")

    anyio.run(both)
    assert [summary.outcomes for summary in summaries] == [{Outcome.COMPLETED: 6}] * 2


def test_the_plain_function_inside_a_running_loop(tmp_path: Path) -> None:
    """It runs in a thread of its own, where no signal is heard."""

    async def cell() -> CampaignSummary:
        return fly(tmp_path, open_executor=open_in_process(1))

    assert anyio.run(cell).complete


@pytest.mark.parametrize("finished", [1, 4])
def test_a_cancelled_campaign_is_resumed(tmp_path: Path, finished: int) -> None:
    """Cancelled from outside, it ends at once; the next run flies what has no result, and nothing else."""

    async def cancel_after(results: int) -> None:
        with anyio.CancelScope() as scope:

            def cancel(realization: str) -> bool:
                if len(list(tmp_path.glob("runs/*/result.json"))) == results:
                    scope.cancel()
                return True

            await fly_here(tmp_path, workers=1, gate=cancel)
        assert scope.cancelled_caught

    anyio.run(cancel_after, finished)
    assert fly(tmp_path).flown == 6 - finished


def test_an_observer_that_is_stuck_costs_its_own_events_alone(tmp_path: Path) -> None:
    """A second one gets every event, and the run ends without waiting for the first."""
    stuck = threading.Event()
    events: list[CampaignEvent] = []
    finished: list[bool] = []

    def wait(event: CampaignEvent) -> None:
        stuck.wait()

    def collect(event: CampaignEvent) -> None:
        events.append(event)
        if isinstance(event, RealizationFinished) and event.done == event.total:
            # Released only once all sessions have ended: had the run waited for it, it would wait still.
            finished.append(True)
            stuck.set()

    summary = fly(tmp_path, observers=[wait, collect])

    assert finished == [True]
    assert (summary.complete, summary.observer_faults, summary.events_dropped) == (True, 0, 0)
    assert sum(isinstance(event, RealizationFinished) for event in events) == 6


class StuckObserver:
    """Takes an event, and waits with it until it is released."""

    def __init__(self) -> None:
        self.released, self.started, self.progressed = (threading.Event() for _ in range(3))
        self.delivered: list[CampaignEvent] = []

    def __call__(self, event: CampaignEvent) -> None:
        self.delivered.append(event)
        self.started.set()
        if isinstance(event, SessionProgressed):
            self.progressed.set()
        self.released.wait()


def test_events_beyond_the_limit_drop_the_oldest() -> None:
    """Counted; what is delivered keeps its order. An observer that never comes back loses what waits for it."""
    stuck = StuckObserver()
    planned = [CampaignPlanned(total=6, done=number) for number in range(6)]
    with open_observers(stuck, limit=2) as observers:
        observers.notify(planned[0])
        stuck.started.wait()
        for event in planned[1:]:
            observers.notify(event)
        assert observers.dropped == 3
        observers.close(span_s=0.0)
        assert observers.dropped == 5
        stuck.released.set()
    assert stuck.delivered == planned[:1]


def test_a_slow_observer_gets_the_newest_progress_after_all_other_events() -> None:
    """Progress pushes nothing out, and none comes of an attempt that has ended."""
    stuck = StuckObserver()
    events: list[CampaignEvent] = [
        CampaignPlanned(total=3, done=0),
        *(RealizationStarted(realization, "w1", 1) for realization in "abc"),
        RealizationRetried("b", Outcome.WORKER_LOST, "", 0.0),
        RealizationFinished("c", Outcome.COMPLETED, "", 1.0, 1, 3),
    ]
    with open_observers(stuck, limit=5) as observers:
        observers.notify(events[0])
        stuck.started.wait()
        for event in events[1:4]:
            observers.notify(event)
        for update in UPDATES * 10:
            for realization in "abc":
                observers.notify(SessionProgressed(realization, update))
        for event in events[4:]:
            observers.notify(event)
        stuck.released.set()
        assert stuck.progressed.wait(60.0)
        assert observers.dropped == 0
    assert stuck.delivered == [*events, SessionProgressed("a", UPDATES[-1])]


def test_sessions_of_a_local_worker_tell_their_progress(tmp_path: Path) -> None:
    """Two sessions of one worker process, each between its start and its result; a job that tells nothing flies too."""
    calls: list[tuple[str, object]] = []
    simspec = tmp_path / "simspec.json"
    simspec.write_text(dump_json(SimSpec(name="yard", world=World(area=YARD))))

    async def fly_two() -> None:
        async with open_local_pool(WorkerPlan(TELLING, None, own_network=False), 1, tmp_path) as pool:
            for name, job in (("first", None), ("second", None), ("silent", "campaign_fakes:mixed_ends")):
                await fly_one(pool, name, job)

    async def fly_one(pool: Executor, name: str, job: str | None) -> None:
        folder = tmp_path / name
        folder.mkdir()
        result = await pool.fly(
            Task(name, simspec, folder, 60.0, job),
            lambda worker: calls.append((name, worker)),
            lambda update: calls.append((name, update)),
        )
        calls.append((name, result.outcome))

    anyio.run(fly_two)
    ends = Outcome.COMPLETED
    assert calls == [
        *(("first", item) for item in ("w1", *UPDATES, ends)),
        *(("second", item) for item in ("w1", *UPDATES, ends)),
        *(("silent", item) for item in ("w1", ends)),
    ]


def test_a_runner_that_does_not_read_holds_no_session_up() -> None:
    """Updates that find no room are dropped; what comes first is whole, and a runner that is gone is no error."""
    runner, worker = Pipe()
    with runner, worker:
        send = _progress_sender(worker)
        updates = [ProgressUpdate(float(number), 600.0, 1.0, 1.0) for number in range(5000)]
        for update in updates:
            send(update)
        received = []
        while runner.poll():
            received.append(runner.recv().update)
        assert received == updates[: len(received)]
        assert 10 < len(received) < len(updates)
        runner.close()
        send(updates[0])
