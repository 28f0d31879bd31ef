"""An agent that reports nothing in any run is known by name: its scores hold nothing that it found."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import pytest
from campaign_fakes import small_campaign

from bench.campaign import CampaignAgent, CampaignFolder
from bench.campaign.planning._realizations import realizations
from bench.campaign.results._campaign_results import CampaignResults
from bench.campaign.storage._journal import PlannedRealization
from bench.campaign.storage._journal_file import open_journal
from bench.campaign.storage._results import write_result
from bench.contracts import (
    Fact,
    Observation,
    Outcome,
    OverheadFidelity,
    ReportStatement,
    ReportStatements,
    SessionResult,
)

REPORT = ReportStatements(reports=(ReportStatement(confidence=0.9, error_m=1.0, sigma_m=None),))
MEASURED = (Observation(observable="OBS-201", considered=True, x=0.0),)


@pytest.mark.parametrize(
    ("fact", "observations", "silent"),
    [
        (None, MEASURED, ("mute",)),
        # A surrogate has no reports of its own, and a run that was not measured says nothing.
        (OverheadFidelity(not_computed=()), MEASURED, ()),
        (None, (), ()),
    ],
)
def test_an_agent_is_silent_if_none_of_its_flights_has_a_report(
    fact: Fact | None, observations: tuple[Observation, ...], silent: tuple[str, ...], tmp_path: Path
) -> None:
    """Beside another, which reports in the last of its two runs alone."""
    folder = CampaignFolder(tmp_path)
    agents = (CampaignAgent(manifest="mute"), CampaignAgent(manifest="late"))
    plans = realizations(small_campaign(points=2, replicates=1).model_copy(update={"agents": agents}))
    reporting = [plan.id for plan in plans if plan.agent == "late"][-1]
    with open_journal(folder.journal) as journal:
        journal.add(PlannedRealization(plan, "0" * 64, "1" * 64) for plan in plans)
        for plan in plans:
            facts = (REPORT,) if plan.id == reporting else (fact,) if fact else ()
            measured = MEASURED if plan.id == reporting else observations
            result = SessionResult(
                realization=plan.id, outcome=Outcome.COMPLETED, observations=measured
            ).with_facts(*facts)
            journal.finish(result, write_result(folder.fresh_run(plan.id), result))
    results = CampaignResults.read(folder)
    deque(results.ends(), maxlen=0)
    assert results.silent == silent
