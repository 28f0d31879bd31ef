"""A campaign at the overhead fidelity: the same folder, scores and report as any other, and nobody can mistake it."""

from __future__ import annotations

from pathlib import Path

import pytest
from campaign_fakes import demo, known, to_scores

from bench.campaign import (
    CampaignAgent,
    CampaignFolder,
    Collaborators,
    estimate_campaign,
    load_campaign,
    load_measurable_decomposition,
    read_result,
    read_runs,
    run_campaign_sync,
    verify_folder,
)
from bench.cli._scores import campaign_report
from bench.contracts import Outcome, OverheadFidelity, facts_of
from bench.errors import SetupError
from bench.realization import FullFactorial
from bench.simspec import Role

DEMO = Path(__file__).parents[2] / "campaigns" / "demo.yaml"


def test_a_campaign_is_flown_scored_and_reported_without_a_session(tmp_path: Path) -> None:
    """Its folder holds results of one fidelity, which scores for a machine name too."""
    campaign, folder = demo(), CampaignFolder(tmp_path)
    observables = load_measurable_decomposition(campaign.decomposition).observables

    summary = run_campaign_sync(campaign, tmp_path, collaborators=Collaborators(finish=to_scores))

    assert summary.outcomes == {Outcome.COMPLETED: 4}
    for name in (path.name for path in tmp_path.joinpath("runs").iterdir()):
        result = known(read_result(folder.run(name), name))
        assert result.facts == facts_of(OverheadFidelity(not_computed=()))
        assert {observation.observable for observation in result.observations} == {*observables}
        assert all(observation.considered for observation in result.observations)
    assert verify_folder(tmp_path) == []
    body = (tmp_path / "report.html").read_text().partition("</main>")[0]
    notices = body.count("Overhead fidelity: surrogates on a ground plan")
    # Each table, the head of the appendix, and of each agent the page to sign and the paragraph to quote.
    assert notices == body.count("<table") + 1 + 2 * len(campaign.agents) > 10
    assert campaign_report(tmp_path).fidelity == read_runs(tmp_path).fidelity == "overhead"
    assert run_campaign_sync(campaign, tmp_path).flown == 0
    with pytest.raises(SetupError, match="the folder's results are overhead"):
        run_campaign_sync(campaign.model_copy(update={"fidelity": "full"}), tmp_path)


def test_what_no_surrogate_can_fly_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    """An agent that has none, and a situation with somebody who is sought."""
    agents = (CampaignAgent(manifest="mine.yaml"), CampaignAgent(manifest="reference-naive"))
    base = known(demo().base)
    groups = tuple(
        group.model_copy(update={"role": Role.SOUGHT}) if group.role is Role.ADVERSARY else group
        for group in base.actors
    )
    sought = base.model_copy(update={"actors": groups})
    for campaign, words in (
        (demo(agents=agents), "'mine' has no surrogate"),
        (demo(base=sought), "role: sought: is beyond the overhead simulation"),
    ):
        with pytest.raises(SetupError, match=words):
            run_campaign_sync(campaign, tmp_path)
        assert not (tmp_path / "campaign.yaml").exists()


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


@pytest.mark.parametrize("name", ["full", "rescue"])
def test_campaigns_with_orders_failures_and_rules_can_be_estimated(name: str) -> None:
    campaign = load_campaign(DEMO.with_name(f"{name}.yaml"))
    if isinstance(campaign.design.method, FullFactorial) and (campaign.design.method.take or 0) > 8:
        method = campaign.design.method.model_copy(update={"take": 8})
        campaign = campaign.model_copy(
            update={"design": campaign.design.model_copy(update={"method": method})}
        )

    estimate = estimate_campaign(campaign, workers=1)

    assert estimate.outcomes == {"completed": estimate.realizations}
    naive, careful = (
        [node.pass_rate for node in estimate.nodes if node.agent == agent.label] for agent in campaign.agents
    )
    assert naive != careful
