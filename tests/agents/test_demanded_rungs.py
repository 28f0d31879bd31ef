"""Which rung an agent gets, and its role: what is demanded, what its manifest asks for, what a host can do; the bench names
no plug-in.
"""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from bench.agents import installed_agents
from bench.agents.confinement import _ladder, rung_of, rungs
from bench.campaign import FloorPlan, load_campaign, realizations, takeoff_faults
from bench.contracts import AgentManifest, plugins
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


ROOT = Path(__file__).parents[2]
DEFAULTS = {"DEFAULT_AGENT": "reference-naive", "DEFAULT_VEHICLE": "x500"}
"""What a SimSpec that says nothing has; constants of its room."""
FIELDS = {"oracle", "px4", "ardupilot"}
"""Fields of a document that are called like a plug-in, and the autopilots that the controller of the house imitates."""


def names_of_plugins() -> set[str]:
    """Entry points of the project that lie outside the bench; not its tables, which are called by words of the field."""
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    del groups["rebar.tables"]
    return {
        name for group in groups.values() for name, place in group.items() if not place.startswith("bench.")
    }


def texts(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Constants with their lines, without docstrings and without the default constants."""
    skipped = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) or (
            isinstance(node, ast.Assign) and {ast.unparse(target) for target in node.targets} <= set(DEFAULTS)
        ):
            skipped.add(node.value)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in skipped:
            yield node.lineno, node.value


def test_the_bench_names_no_plug_in() -> None:
    """Not as a whole text, and those with a hyphen, which are no words, not inside one either."""
    names = names_of_plugins() - FIELDS
    assert len(names) > 100
    hyphened = {name for name in names if "-" in name}
    # Most files hold none of them in any way, and need not be parsed.
    traces = [*hyphened, *(f"{quote}{name}{quote}" for name in names for quote in "'\"")]
    sources = [(path, path.read_text()) for path in sorted((ROOT / "bench").rglob("*.py"))]
    named = [
        f"{path.relative_to(ROOT)}:{line}: {text}"
        for path, source in sources
        if any(trace in source for trace in traces)
        for line, text in texts(ast.parse(source))
        if text in names or any(name in text for name in hyphened)
    ]
    assert named == []


def test_the_defaults_are_what_is_installed() -> None:
    assert DEFAULTS["DEFAULT_AGENT"] in plugins("rebar.agents")
    assert DEFAULTS["DEFAULT_VEHICLE"] in plugins("rebar.vehicles")


def test_agents_from_outside_join_by_their_role(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One for the floor, one ceiling, one under test, and one whose manifest cannot be read."""
    before = FloorPlan()
    for name, line in (
        ("z-lazy", "role: floor"),
        ("a-seer", "role: ceiling"),
        ("b-real", ""),
        ("c-bad", "role: x"),
    ):
        (tmp_path / f"{name}.yaml").write_text(
            f"format: rebar.agent/1\nname: {name}\n{line}\ncommand: [./x]\n"
        )
        entry = EntryPoint(name, "unused", "rebar.agents")
        monkeypatch.setitem(plugins("rebar.agents"), name, entry)
    monkeypatch.setattr(EntryPoint, "load", lambda entry: tmp_path / f"{entry.name}.yaml")
    monkeypatch.setitem(plugins("rebar.agents"), "gone", EntryPoint("gone", "unused", "rebar.agents"))
    installed_agents.cache_clear()
    try:
        # Manifests that another test has read before stay known, so there may be more.
        assert installed_agents("floor")[-1] == "z-lazy"
        assert installed_agents("ceiling")[0] == "a-seer"
        assert "b-real" in installed_agents("tested")
        plan = FloorPlan()
    finally:
        installed_agents.cache_clear()
    assert [spec.manifest for spec in plan.specs][-2:] == ["z-lazy", "a-seer"]
    assert plan != before
