"""The scores for the terminal, from the same summary as the page's."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import polars as pl
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.scoring import NodeFloor

from ._campaign_data import ALL_CONFIGURATIONS, Tally, tallies_of
from .text._format import interval, passed_runs, percent, score, span

COLUMNS = ("Node", "Title", "Passed\n(95 %)", "Difficulty", "Score", "Confidence\n(95 %)", "Runs")
FLOOR_COLUMN = "Floor to ceiling"


def score_tables(
    summary: pl.DataFrame, study: Sequence[str] = (), floors: Mapping[str, NodeFloor] | None = None
) -> list[Table]:
    """For each agent, under its name, a table of the studied nodes (every key attribute when `study` is empty) over
    all configurations. With `floors`, every confidence stands beside floor and ceiling.

    `Passed` counts runs, with the interval of the share that pass; `Confidence` is the mean share of achieved
    observables. The tables fit into 80 columns. `Runs` are those in which the node was considered, of all.
    """
    by_agent = itertools.groupby(_rows(summary, study), key=lambda row: row[1].agent)
    return [_agent_table(agent, list(rows), floors) for agent, rows in by_agent]


def _agent_table(
    agent: str, rows: Sequence[tuple[tuple[str, ...], Tally]], floors: Mapping[str, NodeFloor] | None
) -> Table:
    # No vertical lines, and one space between columns: the titles of the nodes need the room. As Text, because rich
    # would take an agent's name in brackets for markup.
    table = Table(
        title=Text(agent), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False
    )
    for place, name in enumerate((*COLUMNS, FLOOR_COLUMN) if floors else COLUMNS):
        # In a narrow terminal titles and headings wrap; numbers and ids stay whole.
        table.add_column(name, justify="left" if place < 2 else "right", overflow="fold")
    for cells, tally in rows:
        last = (_floor_cell(floors.get(tally.node)),) if floors else ()
        table.add_row(
            *(Text(cell, no_wrap=place != 1) for place, cell in enumerate((*cells, *last))),
        )
    return table


def _floor_cell(node: NodeFloor | None) -> str:
    if node is None or node.floor is None:
        return "–"
    return f"{100 * node.floor:.0f}–{'?' if node.ceiling is None else f'{100 * node.ceiling:.0f}'} %"


def _confidence_cell(tally: Tally) -> str:
    if tally.confidence_low is None or tally.confidence_high is None:
        return percent(tally.confidence)
    return (
        f"{percent(tally.confidence)}\n({100 * tally.confidence_low:.0f}–{100 * tally.confidence_high:.0f} %)"
    )


def _passed_cell(tally: Tally) -> str:
    # In two lines, as the confidence: beside each other the intervals leave no room for the titles.
    if not tally.considered:
        return "–"
    return f"{tally.passed} of {tally.considered}\n({100 * tally.passed_low:.0f}–{100 * tally.passed_high:.0f} %)"


def score_lines(summary: pl.DataFrame, study: Sequence[str] = ()) -> list[str]:
    """The same as plain lines, for output that is not a terminal."""
    return [
        f"{tally.agent}: {tally.node} "
        + (f"passed {passed_runs(tally)}; " if tally.considered else "")
        + f"score {score(tally.score)}; confidence {percent(tally.confidence)} ({interval(tally)}); "
        f"considered in {tally.considered} of {tally.runs} runs, scored in {tally.scored}"
        for _, tally in _rows(summary, study)
    ]


def _rows(summary: pl.DataFrame, study: Sequence[str]) -> list[tuple[tuple[str, ...], Tally]]:
    titles: Mapping[str, str] = (
        dict(zip(summary["node"], summary["title"], strict=True)) if "title" in summary.columns else {}
    )
    tallies = [
        tally
        for (_, configuration, _), tally in tallies_of(summary).items()
        if configuration == ALL_CONFIGURATIONS
    ]
    chosen = [tally for tally in tallies if (tally.node in study if study else tally.level == "ka")]
    agents = list(dict.fromkeys(tally.agent for tally in tallies))
    order = {node: place for place, node in enumerate(study)}
    chosen.sort(key=lambda tally: (agents.index(tally.agent), order.get(tally.node, 0), tally.node))
    return [(_cells(tally, titles.get(tally.node, "")), tally) for tally in chosen]


def _cells(tally: Tally, title: str) -> tuple[str, ...]:
    return (
        tally.node,
        title,
        _passed_cell(tally),
        span(tally.difficulty_low, tally.difficulty_high).replace(" to ", "–"),
        score(tally.score),
        _confidence_cell(tally),
        f"{tally.considered} of {tally.runs}",
    )
