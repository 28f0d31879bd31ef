"""A campaign at the overhead fidelity: the same folder, scores and report as any other, and nobody can mistake it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bench.campaign import Campaign, CampaignFolder, finish_campaign, load_asked, load_campaign, run_campaign, verify_folder
from bench.contracts import Outcome, SessionResult
from bench.errors import SetupError
from bench.simspec import AgentSpec

DEMO = Path(__file__).parents[2] / "campaigns" / "demo.yaml"


def overhead(**changes: Any) -> Campaign:
    """Two scenes of the demo, at the overhead fidelity."""
    demo = load_campaign(DEMO)
    method = demo.design.method.model_copy(update={"take": 2})
    design = demo.design.model_copy(update={"method": method})
    return demo.model_copy(update={"design": design, "fidelity": "overhead", **changes})


def test_a_campaign_is_flown_scored_and_reported_without_a_session(tmp_path: Path) -> None:
    campaign, folder = overhead(), CampaignFolder(tmp_path)
    asked = load_asked(campaign.decomposition)

    summary = run_campaign(campaign, tmp_path, asked, finish=lambda place: finish_campaign(place.path) and None)

    assert summary.outcomes == {Outcome.COMPLETED: 4}
    for realization in tmp_path.joinpath("runs").iterdir():
        result = SessionResult.model_validate_json((folder.run(realization.name) / "result.json").read_bytes())
        assert result.details == {"fidelity": "overhead", "not_computed": ["OBS-093"]}
        assert {one.observable for one in result.observations} == set(asked.observables)
        assert [one.observable for one in result.observations if not one.considered] == ["OBS-093"]
    assert verify_folder(tmp_path) == []
    body = (tmp_path / "report.html").read_text().partition("</main>")[0]
    told = body.count("Overhead fidelity: surrogates on a ground plan")
    assert told == body.count("<table") + 1 > 10  # each table, and the head
    assert run_campaign(campaign, tmp_path, asked).flown == 0


def test_a_folder_holds_results_of_one_fidelity(tmp_path: Path) -> None:
    campaign = overhead()
    asked = load_asked(campaign.decomposition)
    run_campaign(campaign, tmp_path, asked)

    with pytest.raises(SetupError, match="the folder's results are overhead"):
        run_campaign(campaign.model_copy(update={"fidelity": "full"}), tmp_path, asked)


def test_an_agent_without_a_surrogate_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    campaign = overhead(agents=(AgentSpec(manifest="mine.yaml"), AgentSpec(manifest="reference-naive")))

    with pytest.raises(SetupError, match="'mine' has no surrogate"):
        run_campaign(campaign, tmp_path, load_asked(campaign.decomposition))

    assert not (tmp_path / "campaign.yaml").exists()
