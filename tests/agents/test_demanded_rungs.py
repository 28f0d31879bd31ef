"""Which rung an agent gets: what is demanded, what its manifest asks for, and what a host can do."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.agents.confinement import _ladder, rung_of, rungs
from bench.campaign import load_campaign, realizations, takeoff_faults
from bench.contracts import AgentManifest
from bench.errors import SetupError
from bench.simspec import AgentSpec, Isolation

CAMPAIGN = Path(__file__).parents[2] / "campaigns" / "demo.yaml"


def manifest(isolation: Isolation = "auto") -> AgentManifest:
    return AgentManifest(name="agent", command=("true",), isolation=isolation)


def host_with(monkeypatch: pytest.MonkeyPatch, **reasons: str) -> None:
    """A host on which the named rungs cannot start."""

    class Rung:
        def __init__(self, name: str) -> None:
            self.name = name

        def trial(self) -> str | None:
            return reasons.get(self.name)

    monkeypatch.setattr(_ladder, "rungs", lambda: {name: Rung(name) for name in ("landlock", "none")})


def test_auto_is_the_strongest_rung_that_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """On two hosts, of which the last has nothing to confine with."""
    chosen = []
    for reasons in ({}, {"landlock": "old kernel"}):
        host_with(monkeypatch, **reasons)
        chosen.append(rung_of(manifest(), AgentSpec()).name)
    assert chosen == ["landlock", "none"]


def test_a_demand_comes_before_the_manifest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ways; without one the manifest is asked."""
    host_with(monkeypatch)
    assert rung_of(manifest("landlock"), AgentSpec(isolation="none")).name == "none"
    assert rung_of(manifest("none"), AgentSpec(isolation="auto")).name == "landlock"
    assert rung_of(manifest("none"), AgentSpec()).name == "none"


def test_what_cannot_start_is_refused_with_reason_and_alternatives(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error names who asked: the campaign, or the agent's manifest."""
    host_with(monkeypatch, landlock="this kernel has no Landlock")
    with pytest.raises(
        SetupError, match=r"agent\.isolation: landlock cannot start here: this kernel"
    ) as error:
        rung_of(manifest(), AgentSpec(isolation="landlock"))
    assert "here work: none" in str(error.value)
    with pytest.raises(SetupError, match="agent: isolation: landlock cannot start here"):
        rung_of(manifest("landlock"), AgentSpec())


def test_a_campaign_demands_it_of_every_agent_before_anything_is_flown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two agents; one that has a demand of its own keeps it. Without a demand the SimSpecs stay as they were."""
    campaign = load_campaign(CAMPAIGN)
    first, second, *_ = campaign.agents
    agents = (first, second.model_copy(update={"isolation": "none"}))
    demanding = campaign.model_copy(update={"isolation": "landlock", "agents": agents})
    plans = realizations(demanding)
    assert {plan.simspec.agent.isolation for plan in plans} == {"landlock", "none"}
    host_with(monkeypatch, landlock="no namespaces here")
    assert [
        "no namespaces here" in str(fault) for fault in takeoff_faults(plan.simspec for plan in plans)
    ] == [True]
    assert "isolation" not in realizations(campaign)[0].simspec.model_dump_json()


def test_every_rung_has_a_trial() -> None:
    assert rungs()["none"].trial() is None
