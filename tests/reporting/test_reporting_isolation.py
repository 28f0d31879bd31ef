"""The report says how each agent was confined, and what an unconfined one could have done."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from made_campaign import AGENTS, Made, make_campaign
from test_reporting_page import Page, page_of

from bench.agents.confinement import HOLDINGS, Wall, wall_name
from bench.contracts import Outcome
from bench.reporting import load_report_data
from bench.reporting.text._answer import answer_paragraph
from bench.reporting.text._isolation import confinement_note

NAIVE, AWARE = AGENTS
BOXED: dict[str, Any] = {"confinement": {"isolation": "landlock", "network": "own"}}
ON_HOST = {"isolation": "landlock", "network": "the host's: no permission", "open_walls": ["udp"]}
SHARED: dict[str, Any] = {"confinement": ON_HOST}
MAP = {"name": "map", "host": "10.0.0.5", "port": 80, "connections": 1, "bytes_sent": 7, "bytes_received": 9}
LLM = {
    "name": "llm",
    "host": "api.example.org",
    "port": 443,
    "connections": 1200,
    "failed": 2,
    "bytes_sent": 5,
}
SERVED = SHARED | {"services": {"uses": [LLM, MAP]}}
SERVED_AGAIN = SHARED | {"services": {"uses": [MAP | {"bytes_sent": 1000}, LLM | {"counted": False}]}}
MISSING = [wall for wall, holding in HOLDINGS["none"].items() if holding.text != "yes"]
# Its services are none: somebody has edited the result.
FREE = {
    "confinement": {
        "isolation": "none",
        "network": "own",
        "open_walls": [wall_name(wall) for wall in MISSING],
    },
    "services": {"uses": [{"name": "odd"}]},
}


def ids(agent: str) -> list[str]:
    return [f"p{scene:03d}-r0-{agent}" for scene in range(3)]


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One agent once in a network of its own, twice on the host's; the other once free, once boxed, once unknown."""
    facts = dict(zip(ids(NAIVE) + ids(AWARE), (BOXED, SERVED, SERVED_AGAIN, FREE, BOXED, {}), strict=True))
    return make_campaign(tmp_path_factory.mktemp("isolation") / "c", Made(scenes=3, facts=facts))


@pytest.fixture(scope="module")
def page(mixed: Path) -> tuple[Page, str]:
    return page_of(mixed)


def test_the_head_names_rung_network_and_what_is_open(mixed: Path, page: tuple[Page, str]) -> None:
    """In red for the agent that once flew free, with every wall that `none` does not hold."""
    head = page[1][page[1].index('id="confinement"') :].split("</ul>")[0].split("</li>")
    boxed, free = head[0], head[1]
    for words in (
        NAIVE,
        "confined by landlock in 1 run, with a network of its own.",
        "confined by landlock in 2 runs, on the host’s network. Walls that were missing: ",
        Wall.UDP,
        "Services from outside were let in, in 2 runs: llm (api.example.org:443), not counted; ",
        "map (10.0.0.5:80), 2 connections, 1,007 bytes sent and 18 received. Nobody",
    ):
        assert words in boxed
    assert 'class="bad"' not in boxed
    assert Wall.FILES not in boxed
    assert AWARE in free
    assert 'class="bad">It was NOT CONFINED in 1 run (isolation none)' in free
    assert "is not recorded for 1 run." in free
    assert "Services from outside" not in free
    assert [wall for wall in HOLDINGS["none"] if wall in free] == MISSING


def test_the_paragraph_to_quote_says_it(mixed: Path) -> None:
    data = load_report_data(mixed)
    for agent, words in ((NAIVE, "confined by landlock in 2 runs"), (AWARE, "NOT CONFINED in 1 run")):
        assert words in answer_paragraph(data, agent).replace("\u00a0", " ")


def test_the_list_of_runs_says_it_for_each(page: tuple[Page, str]) -> None:
    head, *rows = page[0].tables["all-runs"]
    place = head.index("Confined by")
    cells = {row[0]: row[place] for row in rows}
    shared = "landlock, host’s network, 1 wall open, let in:"
    naive = [cells[name] for name in ids(NAIVE)]
    assert naive == ["landlock", f"{shared} llm and map", f"{shared} map and llm"]
    assert [cells[name] for name in ids(AWARE)] == ["none", "landlock", "not recorded"]


def test_open_walls_of_each_host_stand_beside_the_rung_the_worst_first(tmp_path: Path) -> None:
    """Runs of one agent on three hosts, and of another on one that holds all; a name that a later table may know."""
    walls: tuple[list[str], ...] = (["host_name"], ["tcp", "later_wall", "disk"], ["host_name"], [], [], [])
    boxed = ({"confinement": BOXED["confinement"] | {"open_walls": names}} for names in walls)
    facts = dict(zip(ids(NAIVE) + ids(AWARE), boxed, strict=True))
    folder = make_campaign(tmp_path / "c", Made(scenes=3, facts=facts))
    data = load_report_data(folder)
    naive, aware = (confinement_note(data, agent) for agent in (NAIVE, AWARE))
    assert naive is not None
    assert aware is not None
    network = "with a network of its own"
    gaps = f"{Wall.TCP}; later_wall; {Wall.DISK}"
    assert naive.text == (
        f"It was confined by landlock in 1 run, {network}. Walls that were missing: {gaps}. "
        f"It was confined by landlock in 2 runs, {network}. Walls that were missing: {Wall.HOST_NAME}."
    )
    assert aware.text == f"It was confined by landlock, {network}. No wall was missing."
    page, text = page_of(folder)
    assert naive.text in text
    head, *rows = page.tables["all-runs"]
    cells = [row[head.index("Confined by")] for row in rows]
    assert sorted(cells) == ["landlock"] * 3 + ["landlock, 1 wall open"] * 2 + ["landlock, 3 walls open"]


def test_older_campaigns_and_single_ways(tmp_path: Path) -> None:
    """Nothing recorded, one way of many runs, and a lost run, of which nothing is asked."""
    boxed, broken, lost = ids(AWARE)
    facts = {boxed: BOXED}
    endings = {broken: (Outcome.AGENT_BROKE_BENCH, "twice"), lost: (Outcome.WORKER_LOST, "killed")}
    data = load_report_data(make_campaign(tmp_path / "c", Made(scenes=3, facts=facts, endings=endings)))
    naive, aware = (confinement_note(data, agent) for agent in (NAIVE, AWARE))
    assert naive is not None
    assert (naive.text, naive.unconfined) == ("How it was confined is not recorded.", False)
    assert aware is not None
    assert not aware.unconfined
    known = "It was confined by landlock in 1 run, with a network of its own."
    assert aware.text == f"{known} How it was confined is not recorded for 1 run."
