"""The floor of a campaign: which scenes null agents fly, in the same folder, and apart in every result."""

from __future__ import annotations

from pathlib import Path

import pytest
from campaign_fakes import Script, fly, small_campaign

from bench.campaign import (
    Campaign,
    CampaignAgent,
    FloorPlan,
    load_campaign,
    open_journal,
    realizations,
    with_floor,
)
from bench.campaign.planning._realizations import floor_scenes
from bench.contracts import Outcome, plugins
from bench.errors import SetupError
from bench.simspec import AgentSpec

TWO = FloorPlan(
    agents=(AgentSpec(manifest="null-one"), AgentSpec(manifest="null-two")),
    oracle=AgentSpec(manifest="seer"),
    share=0.5,
    least_scenes=1,
)


def floored(floor: FloorPlan = TWO, points: int = 3, replicates: int = 2) -> Campaign:
    return small_campaign(points, replicates).model_copy(update={"floor": floor})


def test_a_share_of_the_scenes_is_flown_by_every_agent_of_the_floor() -> None:
    """Half of six scenes, each by all three, with the seeds of the agent under test."""
    plans = realizations(floored())

    scenes = {
        agent: {(p.design_point, p.replicate, p.simspec.seeds.root) for p in plans if p.agent == agent}
        for agent in ("fake", "null-one", "null-two", "seer")
    }
    assert len(scenes["fake"]) == 6
    assert len(scenes["seer"]) == 3
    assert scenes["null-one"] == scenes["null-two"] == scenes["seer"]
    assert scenes["seer"] < scenes["fake"]


def test_the_draw_is_seeded_and_grows_with_the_share() -> None:
    """The same seed draws the same scenes, another seed others; a larger share keeps those of a smaller one."""
    scenes = [(f"p{point:03d}", replicate) for point in range(20) for replicate in range(2)]

    def draw(share: float, seed: int = 7, least: int = 1) -> set[tuple[str, int]]:
        return floor_scenes(scenes, seed, FloorPlan(share=share, least_scenes=least))

    assert draw(0.25) == draw(0.25)
    assert len(draw(0.25)) == 10
    assert draw(0.1) < draw(0.25) < draw(1.0) == set(scenes)
    assert len({frozenset(draw(0.25, seed)) for seed in range(5)}) > 1
    assert len(draw(0.01, least=5)) == 5
    assert len(draw(0.01, least=500)) == 40


def test_a_floor_can_come_later_and_stays(tmp_path: Path) -> None:
    """Flown without a floor, then with one, then resumed without naming it: nothing is flown twice or lost."""
    assert fly(tmp_path, small_campaign()).flown == 6
    assert fly(tmp_path, floored()).flown == 9
    again = fly(tmp_path, small_campaign())

    assert (again.flown, again.total) == (0, 15)
    assert load_campaign(tmp_path / "campaign.yaml").floor == TWO
    with open_journal(tmp_path / "journal.sqlite") as journal:
        assert {entry.agent for entry in journal.entries()} == {"fake", "null-one", "null-two", "seer"}


def test_a_bench_error_of_the_floor_costs_only_itself(tmp_path: Path) -> None:
    plans = [plan.id for plan in realizations(floored()) if plan.agent == "null-one"]
    summary = fly(tmp_path, floored(), Script({plans[0]: "raise"}))

    assert summary.completeness.missing == {Outcome.BENCH_ERROR: 1}
    assert summary.outcomes == {Outcome.BENCH_ERROR: 1, Outcome.COMPLETED: 14}


def test_a_campaign_file_asks_for_it(tmp_path: Path) -> None:
    """`floor: true` is the shipped agents, a document names others, and files lie beside the campaign."""
    text = "name: c\nbase: {name: b, world: {area: {corners: [{east_m: 0, north_m: 0}, {east_m: 9, north_m: 0}, {east_m: 9, north_m: 9}]}}}\nagents: [{manifest: mine}]\n"
    (tmp_path / "own-null.yaml").touch()
    floors = {}
    for name, floor in (
        ("true", "true"),
        ("false", "false"),
        ("own", "{agents: [{manifest: own-null.yaml}]}"),
    ):
        (tmp_path / f"{name}.yaml").write_text(f"{text}floor: {floor}\n")
        floors[name] = load_campaign(tmp_path / f"{name}.yaml").floor

    assert floors["true"] == FloorPlan()
    assert floors["false"] is None
    named = floors["own"]
    assert named is not None
    assert named.agents[0].manifest == str(tmp_path / "own-null.yaml")


def test_the_shipped_agents_are_there() -> None:
    """Every default name is an entry point, so that `--floor` works after an installation."""
    plan = FloorPlan()
    null = sorted(name for name in plugins("rebar.agents") if name.startswith("null-"))
    assert [spec.manifest for spec in plan.agents] == null
    assert len(null) == 13
    assert plan.oracle == AgentSpec(manifest="oracle")
    assert with_floor(small_campaign()).floor == FloorPlan()


def test_an_agent_is_under_test_or_of_the_floor() -> None:
    """One agent in both would mix its results, and surrogates fly no null agent."""
    both = small_campaign().model_copy(update={"agents": (CampaignAgent(manifest="null-hover"),)})
    with pytest.raises(SetupError, match="null-hover"):
        with_floor(both)
    with pytest.raises(SetupError, match="fidelity: full"):
        with_floor(small_campaign().model_copy(update={"fidelity": "overhead"}))
