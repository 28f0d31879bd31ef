"""The oracle on whole scenes of the campaigns `full` and `standard`: it achieves whatever an agent can influence."""

from __future__ import annotations

import pytest
from flown_scenes import DECOMPOSITION, fly, scene, scenes

from bench.contracts import Outcome
from decompositions import load_decomposition

# One goes with every run, the others with `make slow`. In p012 an order sends it elsewhere at full speed.
QUICK = ("standard", "p012")
EVERY = [(campaign, point) for campaign in ("full", "standard") for point in scenes(campaign)]
# The autopilot lands for twenty seconds without satellites, which it needs on the way: one report is due as the place comes into
# view, and rests on frames from one side.
TOO_LATE = {("full", "p20578"): {"OBS-083"}}
SCENES = [
    pytest.param(campaign, point, marks=[] if (campaign, point) == QUICK else pytest.mark.slow)
    for campaign, point in EVERY
]


@pytest.mark.flight
@pytest.mark.timeout(300)
@pytest.mark.parametrize(("campaign", "point"), SCENES)
def test_it_fails_nothing_that_an_agent_can_influence(campaign: str, point: str) -> None:
    """Every considered observable whose subject is the agent reaches its threshold, but for one for which there is no time."""
    _, end, observations = fly(scene(campaign, point), "oracle")
    assert end.outcome is Outcome.COMPLETED, end.reason

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
    assert failed == TOO_LATE.get((campaign, point), set()), x_of
