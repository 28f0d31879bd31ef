"""An agent cannot draw session after session by making a real autopilot fail."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from campaign_fakes import Script, attempts, fly, small_campaign, texts_of
from test_campaign_suspects import flown

from bench.campaign import CampaignAgent, CampaignSummary, open_journal, read_result, request_retry
from bench.campaign.execution._attempts import FirmwareWatch, failed_in_flight
from bench.campaign.storage._firmware_ends import (
    add_firmware_ends,
    drawn_out_realizations,
    firmware_ends,
)
from bench.contracts import FIRMWARE_FAILED, FirmwareEnds, Outcome, SessionResult
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
    assert texts_of(results[FIRST], FirmwareEnds) == (END, END)
    assert texts_of(results[SECOND], FirmwareEnds) == (END,)
    assert texts_of(results[THIRD], FirmwareEnds) == ()
    (note,) = [note for note in load_report_data(tmp_path).notes if "real autopilot failed" in note]
    assert f"in {FIRST}, {SECOND}." in note


def two_agents(folder: Path, acts: dict[str, str], **options: Any) -> CampaignSummary:
    campaign = small_campaign(points=1, replicates=2)
    campaign = campaign.model_copy(
        update={"agents": tuple(CampaignAgent(manifest=name) for name in ("crasher", "steady"))}
    )
    return fly(folder, campaign, Script(acts), **options)


def test_no_run_of_the_campaign_gives_an_agent_further_draws(tmp_path: Path) -> None:
    """One agent's firmware fails in both replicates, once in one of the other's: three resumed runs fly nothing, unless a
    person asks for it, and each such draw is in the result.
    """
    acts = {"p001-r1-crasher": "firmware", "p001-r2-crasher": "firmware", "p001-r2-steady": "firmware-once"}
    assert two_agents(tmp_path, acts).outcomes == {Outcome.COMPLETED: 2, Outcome.BENCH_ERROR: 2}
    flown = {"p001-r1-crasher": 2, "p001-r2-crasher": 2, "p001-r1-steady": 1, "p001-r2-steady": 2}
    for _ in range(2):
        summary = two_agents(tmp_path, acts)
        assert (summary.flown, summary.completeness.drawn_out, attempts(tmp_path)) == (0, 2, flown)
    request_retry(tmp_path)
    assert two_agents(tmp_path, acts).flown == 0
    # One person's word is one flight each, whose end is as final as before.
    summary = two_agents(tmp_path, {"p001-r1-crasher": "firmware"}, rerun={Outcome.BENCH_ERROR})
    assert (summary.flown, summary.completeness.drawn_out) == (2, 1)
    assert attempts(tmp_path) == flown | {"p001-r1-crasher": 3, "p001-r2-crasher": 3}
    ends = {name: texts_of(result, FirmwareEnds) for name, result in results(tmp_path).items()}
    assert ends["p001-r1-crasher"] == (END,) * 3
    assert ends["p001-r2-crasher"] == (END,) * 2, "it went well in the end, and says how often it did not"
    assert (ends["p001-r2-steady"], ends["p001-r1-steady"]) == ((END,), ())
    assert two_agents(tmp_path, {}).flown == 0


def test_what_the_host_spoils_between_two_failures_gives_no_draw(tmp_path: Path) -> None:
    """Counted are failures in flight, whatever came between them; a realization that last failed otherwise is flown."""
    with open_journal(tmp_path / "journal.sqlite") as journal:
        add_firmware_ends(journal, {"p001-r1-crasher": ["in a shard"], "p001-r1-steady": ["x", "y"]})
        add_firmware_ends(journal, {})
        assert firmware_ends(journal) == {"p001-r1-crasher": ["in a shard"], "p001-r1-steady": ["x", "y"]}
        watch = FirmwareWatch(journal)
        for end, exhausted in ((ended("p001-r1-crasher", 0.0), False), (ended("p001-r1-crasher", 3.0), True)):
            watch.record(end)
            assert watch.is_exhausted(end) is exhausted
        assert drawn_out_realizations(journal) == frozenset(), "neither has a result"


def results(folder: Path) -> dict[str, SessionResult]:
    ends = {path.name: read_result(path, path.name) for path in (folder / "runs").iterdir()}
    return {name: result for name, result in ends.items() if result is not None}


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
def test_only_failures_that_an_agent_can_reach_are_limited(
    result: SessionResult, in_flight: bool, tmp_path: Path
) -> None:
    assert failed_in_flight(result) is in_flight
    with open_journal(tmp_path / "journal.sqlite") as journal:
        watch = FirmwareWatch(journal)
        verdicts = []
        for _ in range(3):
            watch.record(result)
            verdicts.append(watch.is_exhausted(result))
        assert verdicts == ([False, True, True] if in_flight else [False] * 3)
        assert not watch.is_exhausted(ended("b", 0.5))
