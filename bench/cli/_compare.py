"""`rebar compare`: two agents, or one agent of two campaigns, on the scenes that both flew."""

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
    campaigns: Annotated[list[Path], typer.Argument(help="Folder of a campaign, or of two")],
    agents: Annotated[
        tuple[str, str] | None,
        typer.Option(help="First and second agent; of two folders, the first's and the second's. Needless where it is plain"),
    ] = None,
    node: Annotated[list[str] | None, typer.Option(help="Only these nodes; principles and key attributes when not given")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the shuffles behind the divergence's p")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="For a machine to read")] = False,
) -> None:
    """Compare two agents on the scenes that both flew: what differs, how surely, and how many pairs would settle it.

    Example: rebar compare out/demo --agents reference-naive reference-bystander-aware
    """
    from bench.reporting import compare_campaigns

    found = compare_campaigns(campaigns, agents or (), node or (), seed=seed)
    if as_json:
        print(json.dumps(_document(found), indent=1, allow_nan=False))
        return
    console = Console(width=None if Console().is_terminal else 140)
    console.print(_table(found))
    for one in found.nodes:
        print(f"{one.node}: {one.verdict(found.first, found.second)}")


def _document(found: Comparison) -> dict[str, Any]:
    return {
        "first": found.first,
        "second": found.second,
        "scenes": found.scenes,
        "nodes": [
            {
                **asdict(one),
                "pairs": one.counts.pairs,
                "pass_rates": one.counts.rates,
                "settled": one.settled,
                "verdict": one.verdict(found.first, found.second),
            }
            for one in found.nodes
        ],
    }


def _table(found: Comparison) -> Table:
    title = f"{found.first} and {found.second} on {found.scenes} {'scene' if found.scenes == 1 else 'scenes'}"
    table = Table(title=title, title_justify="left", caption="Differences are second minus first.", caption_justify="left")
    table.add_column("node")
    for column in ("pairs", "first", "second", "difference", "95 % interval", "McNemar p", "adjusted", "divergence", "p"):
        table.add_column(column, justify="right")
    for one in found.nodes:
        table.add_row(one.node, str(one.counts.pairs), *_rates(one), _p(one.mcnemar_p), _p(one.p_adjusted), *_divergence(one))
    return table


def _rates(one: NodeComparison) -> tuple[str, str, str, str]:
    if one.counts.rates is None or one.difference is None:
        return "", "", "", ""
    first, second = one.counts.rates
    return (
        f"{first:.0%}",
        f"{second:.0%}",
        f"{one.difference.estimate:+.0%}",
        f"{one.difference.low:+.0%} to {one.difference.high:+.0%}",
    )


def _divergence(one: NodeComparison) -> tuple[str, str]:
    return ("", "") if one.divergence is None else (f"{one.divergence.value:.2f}", _p(one.divergence.p))


def _p(value: float | None) -> str:
    return "" if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"
