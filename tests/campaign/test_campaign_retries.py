"""When sessions that the host may have cost are flown again, by a clock that no test waits for."""

from __future__ import annotations

import signal
from itertools import pairwise
from pathlib import Path

import pytest
from campaign_fakes import Script, attempts, fly, small_campaign
from in_process_executor import HostClock, open_in_process

from bench.campaign import (
    CampaignSummary,
    RealizationRetried,
)
from bench.campaign.execution._attempts import FIRST_PAUSE_S, JITTER, MAX_PAUSE_S, Retries
from bench.contracts import Outcome, SessionResult

FAULTY = ("p001-r1-fake", "p002-r2-fake")
OTHERS = 4


class FaultUntil(dict[str, str]):
    """What realizations do: two of them fail until the clock reaches the moment at which the host is repaired."""

    def __init__(self, clock: HostClock, repaired_s: float) -> None:
        super().__init__(dict.fromkeys(FAULTY, "raise"))
        self._clock, self._repaired_s = clock, repaired_s

    def get(self, key: str, default: str | None = None) -> str | None:  # type: ignore[override]
        return super().get(key, default) if self._clock.now_s < self._repaired_s else default


def flown(
    folder: Path, repaired_s: float, total_wall_s: float | None = None
) -> tuple[CampaignSummary, HostClock, list[object]]:
    """A campaign on a host with two workers that fails two sessions at first, and its events."""
    clock = HostClock()
    events: list[object] = []
    summary = fly(
        folder,
        small_campaign(retry_s=60.0, total_wall_s=total_wall_s),
        Script(FaultUntil(clock, repaired_s)),
        workers=2,
        observers=[events.append],
        clock=clock,
        open_executor=open_in_process(clock=clock),
    )
    return summary, clock, events


def pauses_s(events: list[object], realization: str) -> list[float]:
    return [
        event.pause_s
        for event in events
        if isinstance(event, RealizationRetried) and event.realization == realization
    ]


def test_a_fault_of_a_minute_costs_no_run(tmp_path: Path) -> None:
    """Two of six sessions fail for a minute. The others end before the first pause does; the pauses double up to
    the cap, differ by their jitter, and are the same in a repetition.
    """
    summary, clock, events = flown(tmp_path / "first", repaired_s=60.0)

    assert summary.complete
    assert summary.outcomes == {Outcome.COMPLETED: 6}
    assert 60.0 <= clock.now_s <= 65.0 * (1.0 + JITTER)
    assert [time for time, name in clock.ends if name not in FAULTY] == [0.0] * OTHERS
    assert sum(attempts(tmp_path / "first").values()) == OTHERS + sum(
        len(pauses_s(events, name)) + 1 for name in FAULTY
    )
    for name in FAULTY:
        nominal_s = [5.0, 10.0, 20.0, 30.0][: len(pauses_s(events, name))]
        assert len(nominal_s) >= 3
        for pause_s, least_s in zip(pauses_s(events, name), nominal_s, strict=True):
            assert least_s <= pause_s <= least_s * (1.0 + JITTER)
        starts_s = [time for time, started in clock.starts if started == name]
        # Nothing else runs by then, so each attempt starts as soon as its pause is over.
        assert [b - a for a, b in pairwise(starts_s)] == pytest.approx(pauses_s(events, name))
    assert pauses_s(events, FAULTY[0]) != pauses_s(events, FAULTY[1])
    _, _, again = flown(tmp_path / "second", repaired_s=60.0)
    assert [pauses_s(again, name) for name in FAULTY] == [pauses_s(events, name) for name in FAULTY]


def test_a_fault_that_stays_ends_after_the_span_and_the_next_run_has_attempts_of_its_own(
    tmp_path: Path,
) -> None:
    """Final for this run once a minute has passed since the first failure, and not before."""
    for run in (1, 2):
        summary, clock, events = flown(tmp_path, repaired_s=1e9)
        assert summary.completeness.missing == {Outcome.BENCH_ERROR: 2}
        assert 60.0 <= clock.now_s <= 90.0 * (1.0 + JITTER)
        for name in FAULTY:
            assert sum(pauses_s(events, name)) >= 60.0 > sum(pauses_s(events, name)[:-1])
            assert attempts(tmp_path)[name] == run * (len(pauses_s(events, name)) + 1)


def test_the_total_budget_ends_a_pause(tmp_path: Path) -> None:
    """Nothing runs, two realizations pause, and the campaign stops on time. The next run flies them."""
    summary, clock, _ = flown(tmp_path, repaired_s=60.0, total_wall_s=3.0)

    assert (summary.stopped, clock.now_s) == ("the campaign's total wall budget is spent", 3.0)
    assert summary.done == OTHERS
    assert flown(tmp_path, repaired_s=0.0)[0].complete


def test_a_request_to_stop_is_not_kept_waiting_by_a_pause(tmp_path: Path) -> None:
    """SIGTERM arrives when the last session has failed: no time passes until the campaign has stopped."""
    clock = HostClock()

    class Stopped(dict[str, str]):
        def get(self, key: str, default: str | None = None) -> str | None:  # type: ignore[override]
            signal.raise_signal(signal.SIGTERM)
            return super().get(key, default)

    summary = fly(
        tmp_path,
        small_campaign(1, 1, retry_s=60.0),
        Script(Stopped({"p001-r1-fake": "raise"})),
        clock=clock,
        open_executor=open_in_process(clock=clock),
    )
    assert (summary.stopped, summary.done, clock.now_s) == ("received SIGTERM", 0, 0.0)


def ended(outcome: Outcome, simulated_s: float = 0.0, realization: str = "r1") -> SessionResult:
    return SessionResult(realization=realization, outcome=outcome, simulated_s=simulated_s)


@pytest.mark.parametrize(
    ("outcome", "session_s", "expected"),
    [
        (Outcome.SETUP_INVALID, 0.5, 5),
        (Outcome.WORKER_LOST, 30.0, 3),
        (Outcome.WALL_BUDGET, 120.0, 2),
        (Outcome.AGENT_NEVER_CONNECTED, 0.5, 2),
        (Outcome.AGENT_CRASHED, 0.5, 1),
        (Outcome.COMPLETED, 120.0, 1),
    ],
)
def test_long_sessions_and_agents_that_say_no_hello_are_tried_twice(
    outcome: Outcome, session_s: float, expected: int
) -> None:
    """A span and not a number of attempts: a session that always fails after minutes is not flown five times."""
    retries, now, flights = Retries(60.0), 1000.0, 0
    while True:
        flights += 1
        now += session_s
        pause_s = retries.pause_s(ended(outcome), now)
        if pause_s is None:
            break
        assert not retries.is_due("r1", now)
        assert retries.next_due_s(["r1"], now) == pytest.approx(pause_s)
        now += pause_s
        assert retries.is_due("r1", now + 1e-6)
    assert flights == expected


def test_without_a_span_one_retry_comes_at_once_and_what_no_longer_waits_is_not_waited_for() -> None:
    retries = Retries(0.0)
    for name in ("r1", "r2"):
        assert retries.pause_s(ended(Outcome.BENCH_ERROR, realization=name), 7.0) == 0.0
        assert retries.is_due(name, 7.0)
        assert retries.pause_s(ended(Outcome.BENCH_ERROR, realization=name), 7.0) is None
    slow = Retries(60.0)
    first_s = slow.pause_s(ended(Outcome.BENCH_ERROR), 0.0)
    assert first_s is not None
    assert slow.next_due_s(["r1", "r2"], 0.0) == first_s
    assert slow.next_due_s(["r2"], 0.0) is None
    assert slow.next_due_s(["r1"], first_s) is None


def test_pauses_stay_below_the_cap() -> None:
    """Also over a day of failures."""
    retries, now = Retries(86400.0), 0.0
    pauses = []
    while (pause_s := retries.pause_s(ended(Outcome.SETUP_INVALID), now)) is not None:
        pauses.append(pause_s)
        now += pause_s
    assert len(pauses) > 86400.0 / (MAX_PAUSE_S * (1.0 + JITTER))
    assert FIRST_PAUSE_S <= pauses[0] < pauses[1] < max(pauses) <= MAX_PAUSE_S * (1.0 + JITTER)
