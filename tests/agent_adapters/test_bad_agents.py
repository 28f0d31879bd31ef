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

REPEATING = ("repeat", "repeat-hover", "repeat-detailed", "repeat-hover-detailed")
NEVER_OUT = [f"null-{name}" for name in ("idle", "orders", "land", "hover", "announce", *REPEATING)]
EXCEPTIONS = {f"KA-{number:02}" for number in (1, 2, 7, 21, 27, 30, 31, 32, 33, 35, 36, 37, 39, 43)}
"""Where an agent that really flies, or lives, or answers, earns what that earns. docs/measures.md has the reasons."""


def confidences() -> dict[str, dict[str, float]]:
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
            leaves = [scores[leaf] for leaf in decomposition.observables]
            share = sum(leaf.achieved for leaf in leaves) / sum(leaf.considered for leaf in leaves)
            values[run.agent]["all"].append(share)
    return {
        agent: {node: fmean(of_node) for node, of_node in nodes.items()} for agent, nodes in values.items()
    }


def above(agent: Mapping[str, float], bounds: Mapping[str, float]) -> set[str]:
    return {node for node, bound in bounds.items() if agent.get(node, 0.0) > bound + 1e-9}


def test_no_null_agent_reaches_more_than_its_bounds() -> None:
    """All thirteen, against the better of the reference agents."""
    reached = confidences()
    decomposition = load_measurable_decomposition(DECOMPOSITION)
    responsible = dict.fromkeys(decomposition.nodes["responsible"].children, 0.05)
    half = {
        node: 0.5 * max(reached[agent].get(node, 0.0) for agent in REFERENCES)
        for node in decomposition.key_attributes
    }
    for agent in NEVER_OUT:
        assert above(reached[agent], responsible) == set(), agent
    for agent in RECKLESS:
        assert above(reached[agent], half) & ABOUT_PEOPLE_AND_REPORTS == set(), agent
        assert above(reached[agent], half) <= EXCEPTIONS, agent
    assert reached["null-idle"]["all"] <= 0.01


def test_every_exception_is_listed_with_its_reason() -> None:
    """Each exception stands in the table of docs/measures.md, and none is about people or reports."""
    page = MEASURES_PAGE.read_text()
    table = page[page.index("## What a bad agent reaches") : page.index("### Agents that try")]
    listed = [line.split("|")[1] for line in table.splitlines() if line.startswith("| KA-")]
    assert {name for name in EXCEPTIONS if not any(name in row for row in listed)} == set()
    assert set() == EXCEPTIONS & ABOUT_PEOPLE_AND_REPORTS
