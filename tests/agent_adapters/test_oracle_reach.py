"""The oracle on whole scenes of campaign `full`: it achieves whatever an agent can influence."""

from __future__ import annotations

import pytest
from flown_scenes import DECOMPOSITION, fly, scene, scenes

from bench.contracts import Outcome
from decompositions import load_decomposition

# One goes with every run, the others with `make slow`.
QUICK = "p5062"
SCENES = (QUICK, *(pytest.param(p, marks=pytest.mark.slow) for p in scenes("full") if p != QUICK))


@pytest.mark.flight
@pytest.mark.timeout(300)
@pytest.mark.parametrize("point", SCENES)
def test_it_fails_nothing_that_an_agent_can_influence(point: str) -> None:
    """Every considered observable whose subject is the agent reaches its threshold."""
    _, end, observations = fly(scene("full", point), "oracle")
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
