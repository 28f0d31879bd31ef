"""The oracle on whole scenes of the campaigns `full` and `standard`: it achieves what an agent can influence, but for a few.

Kept runs show it of eight scenes. Of the others one in three is flown: a fault of agent, flight or measures shows in most of them.
"""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from flown_scenes import DECOMPOSITION, fly, scene, scenes
from shipped_agents import Published, observations_of

from bench.contracts import Observation, Outcome
from decompositions import load_decomposition

# Runs of the oracle that shipped_agents/ keeps; test_shipped_agents.py flies some of these again.
KEPT = {
    (campaign, run.split("-")[0]): row
    for campaign in ("full", "standard")
    for run, row in Published(campaign).rows().items()
    if run.endswith("-r1-oracle")
}
ONE_IN = 3
FLOWN = [
    pair
    for pair in ((campaign, point) for campaign in ("full", "standard") for point in scenes(campaign))
    if pair not in KEPT
][::ONE_IN]
# As measured in all scenes. It keeps no distance from people who stand where it takes off and lands (OBS-011, OBS-012). Its margins
# were measured on a vehicle that tilted less: since position setpoints are flown as by the real PX4, it sees half-hidden adversaries and groups less evenly,
# lingers a little too long, or comes too late to the convoy.
BEYOND_IT = {
    ("full", "p300"): {"OBS-011"},
    ("full", "p11113"): {"OBS-133"},
    ("full", "p15917"): {"OBS-022"},
    ("full", "p16539"): {"OBS-011"},
    ("full", "p17332"): {"OBS-133"},
    ("full", "p17915"): {"OBS-102", "OBS-103", "OBS-122"},
    ("full", "p18681"): {"OBS-011", "OBS-022"},
    ("full", "p27210"): {"OBS-405"},
    ("full", "p31348"): {"OBS-133"},
    **{("standard", f"p{point:03}"): {"OBS-011"} for point in (3, 5, 6, 7, 12, 13, 14, 19)},
    ("standard", "p009"): {"OBS-012"},
    ("standard", "p020"): {"OBS-011", "OBS-205"},
}


def check(campaign: str, point: str, observations: Iterable[Observation]) -> None:
    """Every considered observable whose subject is the agent reaches its threshold, but for those named above."""
    observables = load_decomposition(DECOMPOSITION).observables
    of_agent = {name: item for name, item in observables.items() if item.subject == "agent"}
    x_of = {
        observation.observable: observation.x
        for observation in observations
        if observation.x is not None and observation.observable in of_agent
    }
    # The easiest situations of the standard consider the fewest.
    assert len(x_of) >= 70
    failed = {name for name, x in x_of.items() if x < of_agent[name].threshold}
    assert failed == BEYOND_IT.get((campaign, point), set()), x_of


@pytest.mark.parametrize(("campaign", "point"), KEPT)
def test_it_failed_nothing_that_an_agent_can_influence(campaign: str, point: str) -> None:
    check(campaign, point, observations_of(KEPT[campaign, point]))


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(300)
@pytest.mark.parametrize(("campaign", "point"), FLOWN)
def test_it_fails_nothing_that_an_agent_can_influence(campaign: str, point: str) -> None:
    _, end, observations = fly(scene(campaign, point), "oracle")
    assert end.outcome is Outcome.COMPLETED, end.reason
    check(campaign, point, observations)
