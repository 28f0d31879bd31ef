"""The campaign over the whole decomposition: what it promises to contain."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from bench.campaign import load_campaign
from bench.realization import check_placement, place, realize
from bench.simspec import OrderKind

CAMPAIGN = Path(__file__).parents[2] / "campaigns" / "full.yaml"


def test_every_order_and_every_fault_occurs_and_both_agents_fly_every_scene() -> None:
    """Each kind of order, each outage, each fault and each rule about the operator's link is in two scenes at
    least.
    """
    campaign = load_campaign(CAMPAIGN)
    plans = realize(campaign.situation, campaign.design, campaign.agents)
    assert len({plan.agent for plan in plans}) == 2
    scenes = [plan.simspec for plan in plans if plan.agent == "reference-naive"]
    assert len(scenes) == len(plans) / 2 == 24
    kinds = {
        *get_args(OrderKind),
        "operator_link",
        "detections",
        "gps_drift",
        "gps_off",
        "battery_drop",
        "link_loss",
    }
    for kind in kinds:
        matches = [
            scene
            for scene in scenes
            if kind in {event.kind for event in (*scene.orders, *scene.outages, *scene.vehicle.failures)}  # type: ignore[attr-defined]
        ]
        assert len(matches) >= 2, kind
    down = [scene for scene in scenes if any(event.kind == "operator_link" for event in scene.outages)]
    assert {scene.rules.link_lost for scene in down} == {"continue", "hold", "return"}


def test_its_scenes_have_a_place_for_everybody() -> None:
    """Placed as they would be flown, nobody overlaps and every relation holds."""
    campaign = load_campaign(CAMPAIGN)
    plans = realize(campaign.situation, campaign.design, campaign.agents[:1])
    for plan in plans[::6]:
        assert check_placement(place(plan.simspec)) == []
