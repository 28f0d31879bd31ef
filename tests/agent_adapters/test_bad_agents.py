"""What bad agents reach on scenes of the campaigns: next to nothing, or a listed exception (docs/measures.md).

Their runs are those of shipped_agents/, of which test_shipped_agents.py flies a sample again.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from statistics import fmean

from flown_scenes import DECOMPOSITION
from shipped_agents import ABOUT_PEOPLE_AND_REPORTS, RECKLESS, REFERENCES, numbers_of

from bench.campaign import load_measurable_decomposition
from bench.scoring import score_run

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


def confidences() -> dict[str, Confidences]:
    """Mean confidence of each agent in every node, over the scenes in which the node was considered: those of the campaigns
    `full` and `standard` that the null agents fly, with every kind of order, consent and outage.
    """
    decomposition = load_measurable_decomposition(DECOMPOSITION)
    values: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for name in ("full", "standard"):
        for run in numbers_of(name).on_floor_scenes():
            scores = score_run(decomposition, run.difficulty, run.observations)
            for node in decomposition.nodes:
                if (confidence := scores[node].confidence) is not None:
                    values[run.agent][node].append(confidence)
            considered = sum(scores[leaf].considered for leaf in decomposition.observables)
            values[run.agent]["all"].append(
                sum(scores[leaf].achieved for leaf in decomposition.observables) / considered
            )
    return {
        agent: {node: fmean(shares) for node, shares in of_agent.items()}
        for agent, of_agent in values.items()
    }


def key_attributes_above(agent: Confidences, bounds: Mapping[str, float], nodes: set[str]) -> list[str]:
    return sorted(node for node in nodes if agent.get(node, 0.0) > bounds.get(node, 0.0) + 1e-9)


def test_no_null_agent_reaches_more_than_its_bounds() -> None:
    """All thirteen, against the better of the reference agents."""
    reached = confidences()
    decomposition = load_measurable_decomposition(DECOMPOSITION)
    responsible = set(decomposition.nodes["responsible"].children)
    attributes = set(decomposition.key_attributes)
    half = {node: 0.5 * max(reached[agent].get(node, 0.0) for agent in REFERENCES) for node in attributes}
    for agent in NEVER_OUT:
        above = key_attributes_above(reached[agent], dict.fromkeys(attributes, 0.05), responsible)
        assert above == [], agent
    for agent in RECKLESS:
        beyond = set(key_attributes_above(reached[agent], half, attributes))
        assert beyond & ABOUT_PEOPLE_AND_REPORTS == set(), agent
        assert beyond <= EXCEPTIONS, agent
    assert reached["null-idle"]["all"] <= 0.01


def test_every_exception_is_listed_with_its_reason() -> None:
    """Each exception stands in the table of docs/measures.md, and none is about people or reports."""
    page = MEASURES_PAGE.read_text()
    table = page[page.index("## What a bad agent reaches") : page.index("### Agents that try")]
    listed = [line.split("|")[1] for line in table.splitlines() if line.startswith("| KA-")]
    assert {name for name in EXCEPTIONS if not any(name in row for row in listed)} == set()
    assert set() == EXCEPTIONS & ABOUT_PEOPLE_AND_REPORTS
