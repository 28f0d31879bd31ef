"""`rebar compare`: compares two agents, or one agent in two campaigns, on the scenes that both flew."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from bench.reporting import Comparison
    from bench.statistics import NodeComparison


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(compare)


def compare(
    campaigns: Annotated[list[Path], typer.Argument(help="Folder of a campaign, or folders of two")],
    agents: Annotated[
        tuple[str, str] | None,
        typer.Option(
            help="First and second agent; with two folders, one agent of each. Only needed if there is a choice"
        ),
    ] = None,
    node: Annotated[
        list[str] | None, typer.Option(help="Only these nodes. Default: principles and key attributes")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the permutation test of the divergence")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Compare two agents on the scenes that both flew: the differences, their certainty, and the pairs needed
    to decide.

    Example: rebar compare out/demo --agents reference-naive reference-bystander-aware
    """
    from bench.reporting import compare_campaigns

    comparison = compare_campaigns(campaigns, agents or (), node or (), seed=seed)
    if as_json:
        # NaN is not JSON: other readers would refuse the document.
        print(json.dumps(_document(comparison), indent=1, allow_nan=False))
        return
    console = Console(width=None if Console().is_terminal else 140, markup=False, emoji=False)
    console.print(_table(comparison))
    for node_comparison in comparison.nodes:
        print(f"{node_comparison.node}: {node_comparison.verdict(comparison.first, comparison.second)}")


def _document(comparison: Comparison) -> dict[str, Any]:
    return {
        "first": comparison.first,
        "second": comparison.second,
        "scenes": comparison.scenes,
        "nodes": [
            {
                **asdict(node),
                "pairs": node.counts.pairs,
                "pass_rates": node.counts.rates,
                "settled": node.settled,
                "verdict": node.verdict(comparison.first, comparison.second),
            }
            for node in comparison.nodes
        ],
    }


def _table(comparison: Comparison) -> Table:
    title = f"{comparison.first} and {comparison.second} on {comparison.scenes} {'scene' if comparison.scenes == 1 else 'scenes'}"
    table = Table(
        title=title,
        title_justify="left",
        caption="Differences are second minus first.",
        caption_justify="left",
    )
    table.add_column("node")
    for column in (
        "pairs",
        "first",
        "second",
        "difference",
        "95 % interval",
        "McNemar p",
        "adjusted",
        "divergence",
        "p",
    ):
        table.add_column(column, justify="right")
    for node in comparison.nodes:
        table.add_row(
            node.node,
            str(node.counts.pairs),
            *_rates(node),
            _p(node.mcnemar_p),
            _p(node.p_adjusted),
            *_divergence(node),
        )
    return table


def _rates(node: NodeComparison) -> tuple[str, str, str, str]:
    if node.counts.rates is None or node.difference is None:
        return "", "", "", ""
    first, second = node.counts.rates
    return (
        f"{first:.0%}",
        f"{second:.0%}",
        f"{node.difference.estimate:+.0%}",
        f"{node.difference.low:+.0%} to {node.difference.high:+.0%}",
    )


def _divergence(node: NodeComparison) -> tuple[str, str]:
    return ("", "") if node.divergence is None else (f"{node.divergence.value:.2f}", _p(node.divergence.p))


# Below 0.001 the digits depend on assumptions of the test more than on the data.
def _p(value: float | None) -> str:
    return "" if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"
