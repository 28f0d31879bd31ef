"""What the pages state about the shipped agents is what their runs measured, and what they measure when they fly again.

shipped_agents.py makes both: run it when a test here fails.
"""

from __future__ import annotations

import zlib
from collections import Counter
from pathlib import Path

import pytest
from flown_scenes import DECOMPOSITION, fly
from shipped_agents import (
    BLOCK,
    BLOCKS,
    OUTCOME,
    PAGES,
    WITH_FLOOR,
    Published,
    numbers_of,
    observations_of,
    row_of,
    written,
)
from test_unruly_agent import FAILED as FAILED_BY_THE_UNRULY
from witness_runs import Witness, listed, verdicts

from bench.campaign import load_measurable_decomposition

STALE = "the page is not what the runs give: .venv/bin/python tests/agent_adapters/shipped_agents.py"
ONE_IN = 32
"""One run in so many is flown again, drawn by its name: what changes agent, flight or measures changes most runs."""
RUNS = [(name, run) for name in WITH_FLOOR for run in Published(name).rows()]


def drawn() -> list[tuple[str, str]]:
    """That share of the runs, and a run of each agent of which it has none."""
    number = {pair: zlib.crc32("/".join(pair).encode()) for pair in RUNS}
    pairs = [pair for pair in RUNS if number[pair] % ONE_IN == 0]
    agent_of = {pair: pair[1].split("-", 2)[2] for pair in RUNS}
    missing = set(agent_of.values()) - {agent_of[pair] for pair in pairs}
    return pairs + [
        min((pair for pair in RUNS if agent_of[pair] == agent), key=number.__getitem__)
        for agent in sorted(missing)
    ]


# The shortest mission with a reference agent, of which 109 measures consider something, goes with every run of the tests.
QUICK = ("standard_2", "p019-r1-reference-naive")
# And with the long ones the run that shows more of the measures than any other.
RICH = (listed()[0].campaign, listed()[0].run)


@pytest.mark.parametrize("name", WITH_FLOOR)
def test_every_run_of_the_plan_is_kept(name: str) -> None:
    published = Published(name)
    rows = published.rows()
    assert sorted(rows) == sorted(published.plans)
    columns = [OUTCOME, *published.decomposition.observables]
    assert all(list(row) == columns for row in rows.values())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_states_what_the_runs_give(page: Path) -> None:
    text = page.read_text()
    assert tuple(BLOCK.findall(text)) == PAGES[page]
    assert written(text) == text, STALE


def test_every_part_stands_on_a_page() -> None:
    assert sorted(name for names in PAGES.values() for name in names) == sorted(BLOCKS)


def test_a_changed_number_is_noticed() -> None:
    page = next(iter(PAGES))
    text = page.read_text()
    changed = text.replace("`null-idle` | 6 | 0 ", "`null-idle` | 6 | 1 ")
    assert changed != text
    assert written(changed) == text


def test_the_agents_of_the_demo_differ_where_the_readme_says() -> None:
    numbers = numbers_of("demo")
    naive, aware = (
        Counter(
            row["node"]
            for row in numbers.scores.filter(agent=agent.label).iter_rows(named=True)
            if row["confidence"] == 1.0
        )
        for agent in numbers.campaign.agents
    )
    # Of twelve scenes.
    assert aware["KA-18"] - naive["KA-18"] >= 6
    assert max(abs(naive[node] - aware[node]) for node in ("KA-03", "KA-05", "KA-09", "KA-20")) <= 3


def test_every_observable_has_a_run_that_achieves_it_and_one_that_fails_it() -> None:
    shown = {verdict for witness in listed() for verdict in witness.verdicts}
    shown |= {(name, False) for name in FAILED_BY_THE_UNRULY}
    names = set(load_measurable_decomposition(DECOMPOSITION).observables)
    assert {(name, achieved) for name in names for achieved in (True, False)} - shown == set()


@pytest.mark.parametrize("witness", listed(), ids=lambda witness: f"{witness.campaign}-{witness.run}")
def test_a_witness_shows_what_the_list_says(witness: Witness) -> None:
    """It is one of the runs that are kept, of which the last test flies a sample again."""
    row = Published(witness.campaign).rows()[witness.run]
    assert witness.verdicts - verdicts(observations_of(row)) == set()


@pytest.mark.flight
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("name", "run"),
    [QUICK, *(pytest.param(*pair, marks=pytest.mark.slow) for pair in sorted({RICH, *drawn()} - {QUICK}))],
)
def test_a_run_that_is_flown_again_measures_the_same(name: str, run: str) -> None:
    published = Published(name)
    plan = published.plans[run]
    _, end, observations = fly(plan, plan.agent, published.campaign.decomposition)
    assert row_of(end.outcome, observations) == published.rows()[run], STALE
