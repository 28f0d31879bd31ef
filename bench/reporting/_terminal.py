"""The scores for the terminal, from the same summary as the page's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import polars as pl
from rich.table import Table
from rich.text import Text

from bench.scoring import NodeFloor

from ._campaign_data import ALL_CONFIGURATIONS, Tally, tallies_of
from .text._format import interval, percent, score, span

COLUMNS = (
    "Agent",
    "Node",
    "Title",
    "Difficulty",
    "Score",
    "Confidence",
    "95 %",
    "Runs",
    "Considered",
    "Scored",
)
FLOOR_COLUMNS = ("Floor", "Ceiling")


def score_table(
    summary: pl.DataFrame, study: Sequence[str] = (), floors: Mapping[str, NodeFloor] | None = None
) -> Table:
    """A table of the studied nodes (every key attribute when `study` is empty) for each agent, over all
    configurations. With `floors`, every confidence stands beside floor and ceiling.
    """
    table = Table(title="Score and confidence over all runs", title_justify="left")
    for place, name in enumerate((*COLUMNS, *FLOOR_COLUMNS) if floors else COLUMNS):
        # In a narrow terminal the title wraps; numbers and ids stay whole.
        table.add_column(name, justify="left" if place < 3 else "right", no_wrap=place != 2)
    previous = None
    for row, tally in _rows(summary, study):
        if previous not in (None, tally.agent):
            table.add_section()
        previous = tally.agent
        # As Text: rich would take an agent's name in brackets for markup.
        table.add_row(*map(Text, (*row, *_floor_cells(floors.get(tally.node))) if floors else row))
    return table


def _floor_cells(node: NodeFloor | None) -> tuple[str, str]:
    return (percent(node.floor), percent(node.ceiling)) if node else (percent(None), percent(None))


def score_lines(summary: pl.DataFrame, study: Sequence[str] = ()) -> list[str]:
    """The same as plain lines, for output that is not a terminal."""
    return [
        f"{tally.agent}: {tally.node} score {score(tally.score)}, confidence {percent(tally.confidence)} ({interval(tally)}), "
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
        tally.agent,
        tally.node,
        title,
        span(tally.difficulty_low, tally.difficulty_high),
        score(tally.score),
        percent(tally.confidence),
        interval(tally),
        str(tally.runs),
        str(tally.considered),
        str(tally.scored),
    )
