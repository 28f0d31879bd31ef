"""The scores for the terminal, from the same summary as the page's."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import polars as pl
from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from bench.scoring import NodeFloor

from ._campaign_data import ALL_CONFIGURATIONS, Tally, tallies_of
from .text._format import percent, plural, score, span, verdict

COLUMNS = (
    "Node",
    "Title",
    "Passed\n(95 %)",
    "Compe-\ntence 90\n(bound)",
    "Score",
    "Confidence\n(95 %)",
    "Difficulty",
)
FLOOR_COLUMN = "Floor to\nceiling"
LEGEND = (
    "Passed: of the runs that considered the node, those that achieved everything considered under it; of a principle, everything "
    "under its essential key attributes. Competence 90: the difficulty up to which nine in ten runs pass; – where failures were not "
    "shown to rise with it. Score and confidence are the paper’s: the mean difficulty of what was achieved, and the mean share of "
    "the considered observables that was."
)
RAISED_LEGEND = " †: failures raised this score."


def score_tables(
    summary: pl.DataFrame,
    study: Sequence[str] = (),
    floors: Mapping[str, NodeFloor] | None = None,
    note: str = "",
) -> list[RenderableType]:
    """For each agent, under its name, the verdicts of the principles and a table of the studied nodes (every key attribute
    when `study` is empty) over all configurations; at the end what the columns mean.

    With `floors`, every confidence stands beside floor and ceiling. `note` stands beside each agent's name. The tables fit
    into 80 columns.
    """
    titles: Mapping[str, str] = dict(zip(summary["node"], summary["title"], strict=True))
    tallies = [tally for tally in tallies_of(summary).values() if tally.configuration == ALL_CONFIGURATIONS]
    order = {node: place for place, node in enumerate(study)}
    parts: list[RenderableType] = []
    raised = False
    for agent, rows in itertools.groupby(tallies, key=lambda tally: tally.agent):
        of_agent = list(rows)
        chosen = [tally for tally in of_agent if (tally.node in order if study else tally.level == "ka")]
        chosen.sort(key=lambda tally: (order.get(tally.node, 0), tally.node))
        raised = raised or any(tally.raised for tally in chosen)
        heading = f"{agent}{note} ({plural(max(tally.runs for tally in of_agent), 'run')})"
        # As Text, because rich would take an agent's name in brackets for markup.
        parts.append(
            Group(Text(heading), *map(Text, verdict_lines(of_agent)), _table(chosen, titles, floors))
        )
    return [*parts, Text(LEGEND + (RAISED_LEGEND if raised else ""))] if parts else []


def verdict_lines(tallies: Sequence[Tally]) -> list[str]:
    """`responsible: passed 11 of 12 runs (62 to 100 %)` for each principle."""
    return [f"{tally.node}: {verdict(tally)}" for tally in tallies if tally.level == "principle"]


def finding(summary: pl.DataFrame, study: Sequence[str]) -> tuple[str, str] | None:
    """On what two agents differ most: a sentence, and the node. None where no two agents differ.

    Compared are the shares of runs that pass a node under study or, where that tells more, a principle.
    """
    titles: Mapping[str, str] = dict(zip(summary["node"], summary["title"], strict=True))
    shares: dict[str, list[tuple[float, int, int, str]]] = {}
    for tally in tallies_of(summary).values():
        is_compared = tally.configuration == ALL_CONFIGURATIONS and tally.passes.runs
        if is_compared and (tally.node in study or tally.level == "principle"):
            passed, runs = tally.passes.passed, tally.passes.runs
            shares.setdefault(tally.node, []).append((passed / runs, runs - passed, runs, tally.agent))
    # A node under study says more than its principle, so it comes first among equals.
    nodes = sorted(shares, key=lambda node: (node not in study, node))
    node = max(nodes, key=lambda node: max(shares[node])[0] - min(shares[node])[0], default=None)
    if node is None or max(shares[node])[0] == min(shares[node])[0]:
        return None
    _, failed, runs, agent = min(shares[node])
    _, best_failed, best_runs, best = max(shares[node])
    title = titles[node]
    return (
        f"{agent} failed {title[:1].lower()}{title[1:]} ({node}) in {failed} of {plural(runs, 'run')}, "
        f"{best} in {best_failed} of {best_runs}.",
        node,
    )


def _table(
    tallies: Sequence[Tally], titles: Mapping[str, str], floors: Mapping[str, NodeFloor] | None
) -> Table:
    # No vertical lines, and one space between columns: the titles of the nodes need the room.
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for place, name in enumerate((*COLUMNS, FLOOR_COLUMN) if floors else COLUMNS):
        # In a narrow terminal titles and headings wrap; numbers and ids stay whole.
        table.add_column(name, justify="left" if place < 2 else "right", overflow="fold")
    for tally in tallies:
        cells = (
            tally.node,
            titles[tally.node],
            _passed_cell(tally),
            _competence_cell(tally),
            ("† " if tally.raised else "") + score(tally.score).replace(" ", "\n"),
            _confidence_cell(tally),
            span(tally.difficulty_low, tally.difficulty_high).replace(" to ", "–"),
            *((_floor_cell(floors.get(tally.node)),) if floors else ()),
        )
        table.add_row(*(Text(cell, no_wrap=place != 1) for place, cell in enumerate(cells)))
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
    passes = tally.passes
    if not passes.runs:
        return "–"
    return f"{passes.passed} of {passes.runs}\n({100 * passes.low:.0f}–{100 * passes.high:.0f} %)"


def _competence_cell(tally: Tally) -> str:
    competence = tally.competence.get("90")
    if competence is None:
        return "–"
    return f"{'≥ ' if competence.at_least else ''}{competence.value:.1f}\n({competence.low:.1f})"
