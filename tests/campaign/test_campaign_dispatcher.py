"""The runner with jobs in the test's own process: repeated reports, random orders, two agents, handed-in clocks."""

from __future__ import annotations

import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from campaign_fakes import Script, entries, fly, small_campaign
from early_stopping_fakes import fly_drawn, made_up_decomposition, passes, stopping_campaign
from in_process_executor import HostClock, InProcessExecutor, open_in_process

from bench.campaign import (
    CampaignAgent,
    CampaignFolder,
    CampaignStopping,
    OnStart,
    RealizationStarted,
    Task,
    WorkerPlan,
    digest_of,
    open_journal,
)
from bench.contracts import OnProgress, Outcome, SessionResult, ignore_progress
from bench.errors import SetupError
from bench.statistics import StoppingRule


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


def test_two_results_that_the_journal_does_not_have(tmp_path: Path) -> None:
    """Both are there while the journal says planned and running: both are taken up, and neither is flown again."""
    fly(tmp_path, workers=2)
    planned, running = "p001-r1-fake", "p002-r2-fake"
    with open_journal(tmp_path / "journal.sqlite") as journal:
        journal.forget(planned)
        journal.forget(running)
        journal.start(running, "w1")

    assert fly(tmp_path, workers=2).flown == 0
    after = entries(tmp_path)
    assert {after[name].outcome for name in (planned, running)} == {Outcome.COMPLETED}
    assert (after[planned].attempts, after[running].attempts) == (1, 2)


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


def reference_stops(
    campaign_points: tuple[str, ...], agents: tuple[str, ...], replicates: int
) -> dict[tuple[str, str], int]:
    """Where the rule stops, from the passes of all replicates in order.

    The second replicate is never considered.
    """
    stops = {}
    for point in campaign_points:
        for agent in agents:
            order = [replicate for replicate in range(1, replicates + 1) if replicate != 2]
            after = StoppingRule(0.5).decided_after(
                [passes(f"{point}-r{replicate}-{agent}") for replicate in order]
            )
            if after is not None:
                stops[point, agent] = order[after - 1]
    return stops


@pytest.mark.parametrize(("seed", "workers"), [(1, 1), (2, 3), (3, 5)])
def test_two_agents_at_two_points_stop_by_their_own_results(tmp_path: Path, seed: int, workers: int) -> None:
    """Any number of workers and any order of ends: each agent stops at each point where its own results say."""
    agents = (CampaignAgent(manifest="fake"), CampaignAgent(manifest="other"))
    campaign = stopping_campaign(made_up_decomposition(tmp_path), 12, 2).model_copy(update={"agents": agents})

    summary = fly_drawn(
        tmp_path / "out", campaign, workers, finish=lambda paths: None, open_executor=open_in_process(seed)
    )

    expected = reference_stops(("p001", "p002"), ("fake", "other"), 12)
    assert len(expected) >= 3
    with open_journal(tmp_path / "out" / "journal.sqlite") as journal:
        assert journal.stops() == expected
    assert summary.complete
    for name, entry in entries(tmp_path / "out").items():
        stop = expected.get((entry.design_point, entry.agent), 12)
        if entry.replicate <= stop:
            assert entry.outcome is Outcome.COMPLETED, name
        else:
            assert entry.outcome is Outcome.SETTLED or entry.attempts == 1, (
                "after the stop: closed, or under way already"
            )


def test_new_replicates_wait_for_a_lost_result(tmp_path: Path) -> None:
    """A result before the stop is lost, and replicates are added: the second worker waits until the first one is back."""
    decomposition = made_up_decomposition(tmp_path)
    fly_drawn(tmp_path / "out", stopping_campaign(decomposition, 14, 1), 1, finish=lambda paths: None)
    (CampaignFolder(tmp_path / "out").run("p001-r3-fake") / "result.json").unlink()
    events: list[Any] = []

    summary = fly_drawn(
        tmp_path / "out",
        stopping_campaign(decomposition, 16, 1),
        2,
        finish=lambda paths: None,
        observers=[events.append],
        open_executor=open_in_process(),
    )

    assert summary.complete
    assert [event.realization for event in events if isinstance(event, RealizationStarted)] == [
        "p001-r3-fake"
    ]
    assert entries(tmp_path / "out")["p001-r16-fake"].outcome is Outcome.SETTLED


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
