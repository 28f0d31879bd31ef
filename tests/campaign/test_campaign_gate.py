"""A gate before each session: a test stand that takes its time."""

from __future__ import annotations

from pathlib import Path

import pytest
from campaign_fakes import Script, fly, small_campaign
from in_process_executor import HostClock, open_in_process

from bench.campaign import RealizationRetried, RealizationStarted


class SlowStand:
    """Opens for a realization at the third time that it is asked."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def __call__(self, realization: str) -> bool:
        self.asked.append(realization)
        return self.asked.count(realization) % 3 == 0


@pytest.mark.parametrize("workers", [1, 2])
def test_each_session_waits_for_the_gate_and_also_a_second_attempt(tmp_path: Path, workers: int) -> None:
    """One realization at a time is asked for, until it may start; a retried one is asked for again."""
    events: list[object] = []
    stand = SlowStand()
    clock = HostClock()
    names = sorted(_names(tmp_path / "first"))
    summary = fly(
        tmp_path / "second",
        script=Script({names[0]: "raise-once"}),
        workers=workers,
        observers=[events.append],
        open_executor=open_in_process(3, clock=clock),
        clock=clock,
        gate=stand,
    )
    assert summary.complete
    started = [event.realization for event in events if isinstance(event, RealizationStarted)]
    retried = [event.realization for event in events if isinstance(event, RealizationRetried)]
    assert retried == [names[0]]
    assert sorted(started) == sorted([*names, names[0]])
    assert stand.asked == [name for name in started for _ in range(3)]


def test_a_gate_that_stays_closed_ends_with_the_budget_of_the_campaign(tmp_path: Path) -> None:
    """Nothing is started, and nothing is lost: the same campaign goes on once the gate opens."""
    clock = HostClock()
    questions: list[str] = []

    def closed(realization: str) -> bool:
        questions.append(realization)
        clock.now_s += 100.0
        return False

    campaign = small_campaign()
    campaign = campaign.model_copy(
        update={"budgets": campaign.budgets.model_copy(update={"total_wall_s": 1000.0})}
    )
    first = fly(tmp_path, campaign, open_executor=open_in_process(1, clock=clock), clock=clock, gate=closed)
    assert (first.flown, first.complete) == (0, False)
    assert first.stopped is not None
    assert "budget" in first.stopped
    assert len(questions) > 5
    assert fly(tmp_path, campaign, open_executor=open_in_process(1, clock=clock), clock=clock).complete


def _names(folder: Path) -> list[str]:
    """The realizations of the small campaign."""
    events: list[object] = []
    fly(folder, open_executor=open_in_process(1), observers=[events.append])
    return [event.realization for event in events if isinstance(event, RealizationStarted)]
