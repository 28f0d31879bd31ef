"""The oracle on whole scenes of campaign `full`: it achieves whatever an agent can influence."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.agents import load_manifest, open_agent
from bench.campaign import load_campaign, measure_all
from bench.contracts import Outcome
from bench.realization import place, realize
from bench.recording import TapeBuilder
from bench.simspec import AgentSpec
from bench.simulation import SessionPlan, run_session
from decompositions import load_decomposition

CAMPAIGN = Path(__file__).parents[2] / "campaigns" / "full.yaml"
# One goes with every run, the others with `make slow`: people at home for the start (p300, p16539), a battery that drops
# (p10796), links and GPS that fail on the way to the last target (p26642).
SLOW_SCENES = ("p11367", "p300", "p16539", "p10796", "p26642")
SCENES = ("p5062", *(pytest.param(point, marks=pytest.mark.slow) for point in SLOW_SCENES))


@pytest.mark.flight
@pytest.mark.timeout(300)
@pytest.mark.parametrize("point", SCENES)
def test_it_fails_nothing_that_an_agent_can_influence(point: str, tmp_path: Path) -> None:
    """Every considered observable whose subject is the agent reaches its threshold."""
    campaign = load_campaign(CAMPAIGN)
    plans = realize(campaign.situation, campaign.design, [AgentSpec(manifest="oracle")])
    spec = place(next(plan.simspec for plan in plans if plan.design_point == point))
    agent, at = load_manifest(spec.agent.manifest)
    tape = TapeBuilder(spec)
    end = run_session(SessionPlan(spec, agent, at, open_agent, tmp_path, tape))
    assert end.outcome is Outcome.COMPLETED, end.reason

    observables = load_decomposition("search-and-report-full").observables
    of_agent = {name: item for name, item in observables.items() if item.subject == "agent"}
    requests = {name: (item.measure, item.options) for name, item in of_agent.items()}
    x_of = {
        observation.observable: observation.x
        for observation in measure_all(requests, tape.tape(), spec)
        if observation.x is not None
    }
    assert len(x_of) >= 80
    assert {name: x for name, x in x_of.items() if x < of_agent[name].threshold} == {}
