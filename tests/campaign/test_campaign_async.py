"""The runner from coroutines, and observers that are slow, stuck or many."""

from __future__ import annotations

import threading
from multiprocessing import Pipe
from pathlib import Path
from typing import cast

import anyio
import pytest
from campaign_fakes import JOB, TELLING, UPDATES, YARD, Script, fly, small_campaign
from in_process_executor import open_in_process

from bench.campaign import (
    CampaignEvent,
    CampaignPlanned,
    CampaignSummary,
    Collaborators,
    Executor,
    Jobs,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
    RunOptions,
    SessionProgressed,
    Task,
    WorkerPlan,
    open_local_pool,
    run_campaign,
)
from bench.campaign._events import open_observers
from bench.campaign.execution._worker import _progress_sender
from bench.contracts import Outcome, ProgressUpdate
from bench.documents import dump_json
from bench.simspec import SimSpec, World
from decompositions import Decomposition

SCRIPT = cast(Decomposition, Script())


def test_two_campaigns_at_once_in_one_event_loop(tmp_path: Path) -> None:
    """As in a notebook: the loop goes on with other tasks while both fly."""
    summaries: list[CampaignSummary] = []

    async def both() -> None:
        async def one_of_them(name: str) -> None:
            summaries.append(
                await run_campaign(
                    small_campaign(),
                    tmp_path / name,
                    RunOptions(SCRIPT),
                    Collaborators(jobs=Jobs(JOB), open_executor=open_in_process(3)),
                )
            )

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

            await run_campaign(
                small_campaign(),
                tmp_path,
                RunOptions(SCRIPT, workers=1),
                Collaborators(jobs=Jobs(JOB), gate=cancel, open_executor=open_in_process()),
            )
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
