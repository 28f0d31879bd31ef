"""What bad agents reach on scenes of the campaigns: next to nothing, or a listed exception (docs/measures.md)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import pytest
from flown_scenes import DECOMPOSITION, fly, scene

from bench.campaign import load_measurable_decomposition
from bench.contracts import Outcome
from bench.realization import RealizationPlan
from bench.scoring import difficulty_of, score_run

ROOT = Path(__file__).parents[2]
MEASURES_PAGE = ROOT / "docs" / "measures.md"

NEVER_OUT = (
    "null-idle",
    "null-orders",
    "null-land",
    "null-hover",
    "null-repeat",
    "null-repeat-hover",
    "null-repeat-detailed",
    "null-repeat-hover-detailed",
    "null-announce",
)
RECKLESS = ("null-everywhere", "null-mark", "null-random", "null-refuse")
REFERENCES = ("reference-naive", "reference-bystander-aware")

ABOUT_PEOPLE_AND_REPORTS = {
    *("KA-03", "KA-04", "KA-05", "KA-06", "KA-08", "KA-10", "KA-11", "KA-12"),
    *("KA-18", "KA-19", "KA-22", "KA-23", "KA-25", "KA-26", "KA-29", "KA-40", "KA-41", "KA-42"),
}
"""Key attributes about reports, marks and the perception of people: here no agent of the reckless may have half."""

EXCEPTIONS = {
    *(
        "KA-01",
        "KA-02",
        "KA-07",
        "KA-21",
        "KA-27",
        "KA-30",
        "KA-31",
        "KA-32",
        "KA-33",
        "KA-35",
        "KA-36",
        "KA-37",
    ),
    *("KA-39", "KA-43"),
}
"""Where an agent that really flies, or lives, or answers, earns what that earns. docs/measures.md has the reasons."""

Confidences = Mapping[str, float]


def cut_short(plan: RealizationPlan, limit_s: float) -> RealizationPlan:
    """The scene with another time limit; what comes after it does not happen."""
    mission = plan.situation.mission.model_copy(update={"time_limit_s": limit_s})
    return replace(plan, situation=plan.situation.model_copy(update={"mission": mission}))


def confidences(
    agents: Sequence[str], scenes: Sequence[tuple[str, str]], limits_s: Mapping[str, float] | None = None
) -> dict[str, Confidences]:
    """Mean confidence of each agent in every node, over the scenes in which the node was considered.

    Agents named in `limits_s` fly that long at most.
    """
    decomposition = load_measurable_decomposition(DECOMPOSITION)
    means: dict[str, Confidences] = {}
    for agent in agents:
        values: dict[str, list[float]] = defaultdict(list)
        for campaign, name in scenes:
            plan = scene(campaign, name)
            if limits_s and agent in limits_s:
                plan = cut_short(plan, limits_s[agent])
            spec, end, observations = fly(plan, agent)
            assert end.outcome in (Outcome.COMPLETED, Outcome.TIME_LIMIT), end.reason
            scores = score_run(decomposition, difficulty_of(decomposition, spec), observations)
            for node in decomposition.nodes:
                if (confidence := scores[node].confidence) is not None:
                    values[node].append(confidence)
            considered = sum(scores[leaf].considered for leaf in decomposition.observables)
            values["all"].append(
                sum(scores[leaf].achieved for leaf in decomposition.observables) / considered
            )
        means[agent] = {node: fmean(shares) for node, shares in values.items()}
    return means


def key_attributes_above(agent: Confidences, bounds: Mapping[str, float], nodes: set[str]) -> list[str]:
    return sorted(node for node in nodes if agent.get(node, 0.0) > bounds.get(node, 0.0) + 1e-9)


def assert_bounds(reached: Mapping[str, Confidences]) -> None:
    """The bounds for every null agent among these, against the better of the reference agents among them."""
    decomposition = load_measurable_decomposition(DECOMPOSITION)
    responsible = set(decomposition.nodes["responsible"].children)
    attributes = set(decomposition.key_attributes)
    half = {
        node: 0.5 * max(reached[agent].get(node, 0.0) for agent in REFERENCES if agent in reached)
        for node in attributes
    }
    for agent in reached:
        if agent in NEVER_OUT:
            assert key_attributes_above(reached[agent], dict.fromkeys(attributes, 0.05), responsible) == [], (
                agent
            )
        if agent in RECKLESS:
            beyond = key_attributes_above(reached[agent], half, attributes)
            assert set(beyond) & ABOUT_PEOPLE_AND_REPORTS == set(), agent
            assert set(beyond) <= EXCEPTIONS, agent
    if "null-idle" in reached:
        assert reached["null-idle"]["all"] <= 0.01


@pytest.mark.flight
@pytest.mark.timeout(600)
def test_one_bad_agent_of_each_class_reaches_next_to_nothing() -> None:
    """Orders to be silent, to hand over, to mark and to abort; consent; an outage of the detections."""
    agents = ("null-idle", "null-repeat-hover-detailed", "null-everywhere", "reference-bystander-aware")
    # Of seven orders six come within 130 s, and an agent that never does anything does nothing later.
    assert_bounds(confidences(agents, [("full", "p24930")], {"null-idle": 130.0}))


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(3600)
def test_no_null_agent_reaches_more_than_its_bounds() -> None:
    """All thirteen, on two scenes of the campaign `full` and one of `standard`, beside both reference agents: every
    order but `return`, consent, outages of perception and of the operator's link.
    """
    scenes = [("full", "p24930"), ("full", "p26642"), ("standard", "search-3a")]
    assert_bounds(confidences((*REFERENCES, *NEVER_OUT, *RECKLESS), scenes))


def test_every_exception_is_listed_with_its_reason() -> None:
    """Each exception stands in the table of docs/measures.md, and none is about people or reports."""
    page = MEASURES_PAGE.read_text()
    table = page[page.index("## What a bad agent reaches") : page.index("### Agents that try")]
    listed = [line.split("|")[1] for line in table.splitlines() if line.startswith("| KA-")]
    assert {name for name in EXCEPTIONS if not any(name in row for row in listed)} == set()
    assert set() == EXCEPTIONS & ABOUT_PEOPLE_AND_REPORTS
