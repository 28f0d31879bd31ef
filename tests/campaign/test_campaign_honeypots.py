"""Honeypots in a campaign: a drawn share of the scenes, the same for every agent, and nothing else changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.campaign import load_campaign, question_sha256
from bench.campaign._document import Campaign, Honeypots
from bench.campaign.planning._realizations import realizations
from bench.simspec import AgentSpec

STANDARD = Path(__file__).parents[2] / "campaigns" / "standard.yaml"


def campaign(share: float | None) -> Campaign:
    agents = tuple(AgentSpec(manifest=name) for name in ("reference-naive", "null-hover"))
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
