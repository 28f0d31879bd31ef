"""Honeypots in a campaign: a drawn share of the scenes, the same for every agent, and nothing else changes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from campaign_fakes import Script, fly

from bench.campaign import CampaignAgent, CampaignFolder, load_campaign, question_sha256
from bench.campaign._document import Campaign, Honeypots
from bench.campaign.planning._realizations import realizations
from bench.reporting import load_report_data, render_report

STANDARD = Path(__file__).parents[2] / "campaigns" / "standard.yaml"


def campaign(share: float | None) -> Campaign:
    agents = tuple(CampaignAgent(manifest=name) for name in ("reference-naive", "null-hover"))
    honeypots = None if share is None else Honeypots(share=share)
    return load_campaign(STANDARD).model_copy(
        update={"agents": agents, "floor": None, "honeypots": honeypots}
    )


@pytest.mark.parametrize(("share", "least", "most"), [(0.3, 0.1, 0.5), (1.0, 1.0, 1.0)])
def test_a_share_of_the_scenes_has_one_for_every_agent(share: float, least: float, most: float) -> None:
    """The others are as without the option, and those with one differ by it alone."""
    plain, mixed = realizations(campaign(None)), realizations(campaign(share))
    assert [plan.id for plan in plain] == [plan.id for plan in mixed]
    assert {plan.agent for plan in mixed} == {"reference-naive", "null-hover"}
    for before, after in zip(plain, mixed, strict=True):
        assert after.simspec.model_copy(update={"honeypot": False}) == before.simspec
    with_one = {(plan.design_point, plan.replicate) for plan in mixed if plan.simspec.honeypot}
    without = {(plan.design_point, plan.replicate) for plan in mixed if not plan.simspec.honeypot}
    assert not with_one & without
    assert least <= len(with_one) / (len(with_one) + len(without)) <= most


def test_a_larger_share_has_those_of_a_smaller_one() -> None:
    """So a campaign can be flown on with more of them."""
    scenes = [
        {plan.id for plan in realizations(campaign(share)) if plan.simspec.honeypot} for share in (0.2, 0.6)
    ]
    assert scenes[0] < scenes[1]


def test_the_question_stays_the_same() -> None:
    """A published digest is that of the campaign with and without honeypots."""
    assert question_sha256(campaign(0.5)) == question_sha256(campaign(None))
    assert "honeypots" not in campaign(None).model_dump_json()


def test_the_report_names_who_saw_the_truth_first(tmp_path: Path) -> None:
    """Two of six runs reported a honeypot: the first note and the first rows; the reports stand beside them."""
    fly(tmp_path, script=Script({}))
    caught = ("p003-r1-fake", "p003-r2-fake")
    for name in caught:
        path = CampaignFolder(tmp_path).run(name) / "result.json"
        document = json.loads(path.read_text())
        document["facts"] = {"saw_the_truth": {"texts": [f"report of {name}"]}}
        path.write_text(json.dumps(document))
    data = load_report_data(tmp_path)
    assert data.notes[0].startswith("An agent saw the truth")
    assert ", ".join(caught) in data.notes[0]
    page = render_report(data)
    rows = page[page.index('id="all-runs"') :].split("<tr>")[2:8]
    assert ["saw the truth: report of" in row for row in rows] == [True, True, False, False, False, False]
    assert all(f"saw the truth: report of {name}" in row for name, row in zip(caught, rows, strict=False))
