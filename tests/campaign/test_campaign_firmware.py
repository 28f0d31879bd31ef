"""An agent cannot draw session after session by making a real autopilot fail."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_campaign_suspects import attempts, flown

from bench.campaign.execution._firmware_watch import FirmwareWatch, failed_in_flight
from bench.contracts import FIRMWARE_FAILED, Outcome, SessionResult, firmware_ends_of
from bench.reporting import load_report_data

FIRST, SECOND, THIRD = "p001-r1-fake", "p002-r2-fake", "p003-r1-fake"
END = "after 12.5 s: the autopilot's firmware failed: PX4 ended with SIGSEGV"


def test_a_firmware_that_fails_in_flight_is_flown_once_more_and_marked(tmp_path: Path) -> None:
    """One fails each time and is missing after two flights, however long retries may last; one fails once and counts."""
    summary, results = flown(tmp_path, {FIRST: "firmware", SECOND: "firmware-once", THIRD: "raise-once"})
    assert summary.outcomes == {Outcome.COMPLETED: 5, Outcome.BENCH_ERROR: 1}
    assert not summary.complete
    flights = attempts(tmp_path)
    assert (flights[FIRST], flights[SECOND], flights[THIRD]) == (2, 2, 2)
    assert firmware_ends_of(results[FIRST].details) == (END, END)
    assert firmware_ends_of(results[SECOND].details) == (END,)
    assert firmware_ends_of(results[THIRD].details) == ()
    (note,) = [note for note in load_report_data(tmp_path).notes if "real autopilot failed" in note]
    assert f"in {FIRST}, {SECOND}." in note


def ended(realization: str, simulated_s: float, reason: str = f"{FIRMWARE_FAILED}: x") -> SessionResult:
    return SessionResult(
        realization=realization, outcome=Outcome.BENCH_ERROR, reason=reason, simulated_s=simulated_s
    )


@pytest.mark.parametrize(
    ("result", "in_flight"),
    [
        (ended("a", 0.5), True),
        (ended("a", 0.0), False),
        (ended("a", 0.5, "KeyError: 'x'"), False),
        (ended("a", 0.5).model_copy(update={"outcome": Outcome.COMPLETED}), False),
    ],
)
def test_only_failures_that_an_agent_can_reach_are_limited(result: SessionResult, in_flight: bool) -> None:
    assert failed_in_flight(result) is in_flight
    watch = FirmwareWatch()
    verdicts = []
    for _ in range(3):
        watch.record(result)
        verdicts.append(watch.is_exhausted(result))
    assert verdicts == ([False, True, True] if in_flight else [False] * 3)
    assert not watch.is_exhausted(ended("b", 0.0))
