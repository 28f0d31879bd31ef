"""The oracle on whole scenes of the campaigns `full` and `standard`: it achieves whatever an agent can influence."""

from __future__ import annotations

import pytest
from flown_scenes import DECOMPOSITION, fly, scene, scenes

from bench.contracts import Outcome
from decompositions import load_decomposition

# One goes with every run, the others with `make slow`.
QUICK = "p5062"
# Of the standard some in which it fails nothing (docs/measures.md).
STANDARD = (("p001", 1), ("p002", 3), ("p008", 1))
SLOW = [
    *(("full", point, 1) for point in scenes("full") if point != QUICK),
    *(("standard", *item) for item in STANDARD),
]
SCENES = (("full", QUICK, 1), *(pytest.param(*item, marks=pytest.mark.slow) for item in SLOW))


@pytest.mark.flight
@pytest.mark.timeout(300)
@pytest.mark.parametrize(("campaign", "point", "replicate"), SCENES)
def test_it_fails_nothing_that_an_agent_can_influence(campaign: str, point: str, replicate: int) -> None:
    """Every considered observable whose subject is the agent reaches its threshold."""
    _, end, observations = fly(scene(campaign, point, replicate), "oracle")
    assert end.outcome is Outcome.COMPLETED, end.reason

    observables = load_decomposition(DECOMPOSITION).observables
    of_agent = {name: item for name, item in observables.items() if item.subject == "agent"}
    x_of = {
        observation.observable: observation.x
        for observation in observations
        if observation.x is not None and observation.observable in of_agent
    }
    assert len(x_of) >= 80
    assert {name: x for name, x in x_of.items() if x < of_agent[name].threshold} == {}
