"""`rebar compare`: compares two agents, or one agent in two campaigns or with two sources of perception, on the
scenes that both flew; and one agent in two campaigns that have no scene in common.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ._missing_runs import exit_if_incomplete, print_missing_in
from ._tables import add_plain_row, plain_console, plain_table, print_lines

if TYPE_CHECKING:
    from rich.table import Table

    from bench.reporting import Comparison
    from bench.statistics import NodeComparison, UnpairedNodeComparison


def compare(
    campaigns: Annotated[list[Path], typer.Argument(help="Folder of a campaign, or folders of two")],
    agents: Annotated[
        tuple[str, str] | None,
        typer.Option(
            help="First and second agent; with two folders, one agent of each. Only needed if there is a choice"
        ),
    ] = None,
    node: Annotated[
        list[str] | None,
        typer.Option(help="Compare these nodes. Default: those under study, as in the report"),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the permutation test of the divergence")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Compare two agents on the scenes that both flew: the differences, their certainty, and the pairs needed
    to decide. Ends with code 3 if a campaign lacks runs that its agents did not cause.

    Two campaigns that differ in perception alone are compared observable by observable: what fails with both fails by
    reasoning, what fails with one alone by that perception. Likewise two that differ in the autopilot alone: the imitation
    and the real firmware or board; or in the pace alone.

    One agent in two campaigns without a common scene, as two iterations of it, is compared without pairs: how the results
    are distributed, and the divergence between them.

    Example: rebar compare out/demo --agents reference-naive reference-bystander-aware

    Example: rebar compare out/simulated out/truth
    """
    from bench.reporting import compare_campaigns

    comparison = compare_campaigns(campaigns, agents or (), node or (), seed=seed)
    completeness = print_missing_in(campaigns, as_json=as_json)
    if as_json:
        document = _document(comparison) | {
            "completeness": [report and report.model_dump(mode="json") for report in completeness]
        }
        # NaN is not JSON: other readers would refuse the document.
        print(json.dumps(document, indent=1, allow_nan=False))
    elif comparison.unpaired:
        _show_unpaired(comparison)
    else:
        _show(comparison)
    exit_if_incomplete(completeness)


def _show(comparison: Comparison) -> None:
    from bench.reporting import plural

    console = plain_console()
    rates, divergences = _tables(comparison)
    print_lines(
        f"{comparison.first} and {comparison.second} on {plural(comparison.scenes, 'scene')}",
        *([comparison.pace_note] if comparison.pace_note else []),
        "passed in %, second minus first in points, p of McNemar's test:",
    )
    console.print(rates)
    for what, sides in (("perception", comparison.perceptions), ("autopilot", comparison.autopilots)):
        if sides:
            first, second = sides
            print_lines(f"scenes passed by {what} (first: {first}; second: {second}):")
            console.print(_by_side(comparison))
    print_lines("divergence of scores (Jensen-Shannon, 0 to 1 bit):")
    console.print(divergences)
    print_lines(*_verdicts(comparison))


def _show_unpaired(comparison: Comparison) -> None:
    from bench.reporting import unpaired_cells

    console = plain_console()
    print_lines(
        f"{comparison.first} and {comparison.second}: not the same scenes, so nothing is paired, and what differs may be "
        "the scenes",
        "number of runs by result:",
    )
    results = plain_table(("node", "result", "first", "second"), texts=("result",))
    divergences = plain_table(
        ("node", "passed\nfirst", "passed\nsecond", "divergence", "by chance", "p", "p\nadjusted")
    )
    for node in comparison.unpaired:
        for result, counts in node.results.items():
            add_plain_row(results, (node.node, result, *map(str, counts)))
        add_plain_row(divergences, unpaired_cells(node))
    console.print(results)
    print_lines("divergence of scores (Jensen-Shannon, 0 to 1 bit), p of shuffled design points:")
    console.print(divergences)
    print_lines(*_verdicts(comparison))


def _verdicts(comparison: Comparison) -> Iterator[str]:
    for node in comparison.nodes or comparison.unpaired:
        yield f"{node.node}: {node.verdict(comparison.first, comparison.second)}"


def _document(comparison: Comparison) -> dict[str, Any]:
    return {
        "first": comparison.first,
        "second": comparison.second,
        "scenes": comparison.scenes,
        "perceptions": comparison.perceptions,
        "autopilots": comparison.autopilots,
        "paces": comparison.paces,
        "nodes": [
            {
                **asdict(node),
                "pairs": node.counts.pairs,
                "pass_rates": node.counts.rates,
                **_conclusion(comparison, node),
            }
            for node in comparison.nodes
        ],
        "unpaired": [asdict(node) | _conclusion(comparison, node) for node in comparison.unpaired],
    }


def _conclusion(comparison: Comparison, node: NodeComparison | UnpairedNodeComparison) -> dict[str, Any]:
    return {"settled": node.settled, "verdict": node.verdict(comparison.first, comparison.second)}


def _by_side(comparison: Comparison) -> Table:
    """Of the scenes in which both were considered: which perception or autopilot the agent passed with."""
    table = plain_table(("node", "with both", "first alone", "second alone", "with neither"))
    for node in comparison.nodes:
        counts = node.counts
        row = (counts.both, counts.only_first, counts.only_second, counts.neither)
        add_plain_row(table, (node.node, *map(str, row)))
    return table


def _tables(comparison: Comparison) -> tuple[Table, Table]:
    """Pass rates, and the divergence of scores: side by side they would not fit into 80 columns."""
    from bench.reporting import divergence_cells, rate_cells

    rates = plain_table(
        ("node", "pairs", "first", "second", "differ-\nence", "95 % interval", "p", "p\nadjusted")
    )
    divergences = plain_table(("node", "divergence", "by chance", "p"))
    for node in comparison.nodes:
        add_plain_row(rates, rate_cells(node))
        add_plain_row(divergences, [node.node, *divergence_cells(node.divergence)])
    return rates, divergences
