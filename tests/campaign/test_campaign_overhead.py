"""A campaign at the overhead fidelity: the same folder, scores and report as any other, and nobody can mistake it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bench.campaign import (
    Campaign,
    CampaignAgent,
    CampaignFolder,
    Collaborators,
    estimate_campaign,
    finish_campaign,
    load_campaign,
    load_measurable_decomposition,
    read_runs,
    run_campaign_sync,
    verify_folder,
)
from bench.cli._scores import campaign_report
from bench.contracts import Outcome, OverheadFidelity, SessionResult, facts_of
from bench.errors import SetupError
from bench.simspec import Role

DEMO = Path(__file__).parents[2] / "campaigns" / "demo.yaml"


WITH_SCORES = Collaborators(finish=lambda paths: finish_campaign(paths.path) and None)


def overhead(**changes: Any) -> Campaign:
    """Two scenes of the demo, at the overhead fidelity."""
    demo = load_campaign(DEMO)
    method = demo.design.method.model_copy(update={"take": 2})
    design = demo.design.model_copy(update={"method": method})
    return demo.model_copy(update={"design": design, "fidelity": "overhead", **changes})


def test_a_campaign_is_flown_scored_and_reported_without_a_session(tmp_path: Path) -> None:
    campaign, folder = overhead(), CampaignFolder(tmp_path)
    decomposition = load_measurable_decomposition(campaign.decomposition)

    summary = run_campaign_sync(campaign, tmp_path, collaborators=WITH_SCORES)

    assert summary.outcomes == {Outcome.COMPLETED: 4}
    for realization in tmp_path.joinpath("runs").iterdir():
        result = SessionResult.model_validate_json(
            (folder.run(realization.name) / "result.json").read_bytes()
        )
        assert result.facts == facts_of(OverheadFidelity(not_computed=()))
        assert {observation.observable for observation in result.observations} == set(
            decomposition.observables
        )
        assert all(observation.considered for observation in result.observations)
    assert verify_folder(tmp_path) == []
    body = (tmp_path / "report.html").read_text().partition("</main>")[0]
    notices = body.count("Overhead fidelity: surrogates on a ground plan")
    # Each table, the head of the appendix, and of each agent the page to sign and the paragraph to quote.
    assert notices == body.count("<table") + 1 + 2 * len(campaign.agents) > 10
    assert run_campaign_sync(campaign, tmp_path).flown == 0


def test_a_folder_holds_results_of_one_fidelity(tmp_path: Path) -> None:
    campaign = overhead()
    run_campaign_sync(campaign, tmp_path)

    with pytest.raises(SetupError, match="the folder's results are overhead"):
        run_campaign_sync(campaign.model_copy(update={"fidelity": "full"}), tmp_path)


def test_an_agent_without_a_surrogate_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    campaign = overhead(
        agents=(CampaignAgent(manifest="mine.yaml"), CampaignAgent(manifest="reference-naive"))
    )

    with pytest.raises(SetupError, match="'mine' has no surrogate"):
        run_campaign_sync(campaign, tmp_path)

    assert not (tmp_path / "campaign.yaml").exists()


def test_a_situation_with_somebody_sought_is_refused(tmp_path: Path) -> None:
    campaign = overhead()
    assert campaign.base is not None
    groups = tuple(
        group.model_copy(update={"role": Role.SOUGHT}) if group.role is Role.ADVERSARY else group
        for group in campaign.base.actors
    )
    changed = campaign.model_copy(update={"base": campaign.base.model_copy(update={"actors": groups})})

    with pytest.raises(SetupError, match="role: sought: is beyond the overhead simulation"):
        run_campaign_sync(changed, tmp_path)


def test_what_breaks_in_one_scene_alone_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    campaign = load_campaign(DEMO.with_name("full.yaml"))
    faults = next(factor for factor in campaign.design.factors if factor.name == "fault")
    broken = {"vehicle.failures": [{"at_s": 90.0, "kind": "motor_off", "instance": 1}]}
    changed = faults.model_copy(update={"patches": {**faults.patches, "blind-grave": broken}})
    factors = tuple(changed if factor is faults else factor for factor in campaign.design.factors)
    design = campaign.design.model_copy(update={"factors": factors})
    changed_campaign = campaign.model_copy(update={"design": design, "fidelity": "overhead"})

    with pytest.raises(SetupError, match=r"rotor \d stops: that is beyond the overhead simulation"):
        run_campaign_sync(changed_campaign, tmp_path)

    assert not (tmp_path / "simspecs").exists()


def test_the_scores_for_a_machine_name_the_fidelity(tmp_path: Path) -> None:
    campaign = overhead()
    run_campaign_sync(campaign, tmp_path, collaborators=WITH_SCORES)

    assert campaign_report(tmp_path).fidelity == "overhead"
    assert read_runs(tmp_path).fidelity == "overhead"


@pytest.mark.parametrize("name", ["full", "rescue"])
def test_campaigns_with_orders_failures_and_rules_can_be_estimated(name: str) -> None:
    campaign = load_campaign(DEMO.with_name(f"{name}.yaml"))

    estimate = estimate_campaign(campaign, workers=2)

    assert estimate.outcomes == {"completed": estimate.realizations}
    naive, careful = (
        [node.pass_rate for node in estimate.nodes if node.agent == agent.label] for agent in campaign.agents
    )
    assert naive != careful
