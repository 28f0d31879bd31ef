"""`rebar decomposition check`: what a decomposition's document promises, and what needs no merit under it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.errors import Fault, SetupError

from ._tables import add_plain_row, plain_console, plain_table, print_lines

if TYPE_CHECKING:
    from rich.table import Table

    from bench.scoring import NodeFloor


def register(app: typer.Typer) -> None:
    """Add the command group."""
    group = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
    group.command()(check)
    # Without a second command the group would vanish, and `check` with it.
    group.callback(help="Check decompositions.")(lambda: None)
    app.add_typer(group, name="decomposition")


def check(
    name: Annotated[str, typer.Argument(help="Name or file of a decomposition")],
    floor: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder of a campaign run with --floor: show floor, ceiling and discrimination of every node",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Check the document of a decomposition, and with --floor what can be had under it without merit.

    The nodes that discriminate least come first. An observable is flagged if a null agent reaches more than a
    half, or more than nine tenths of what an agent reaches that is given the truth.

    Example: rebar decomposition check search-and-report

    Example: rebar decomposition check search-and-report --floor out/demo
    """
    from bench.campaign import load_measurable_decomposition, read_runs
    from bench.scoring import worst_first

    decomposition = load_measurable_decomposition(name)
    nodes: list[NodeFloor] = []
    if floor is not None:
        # Measured again only with another decomposition than the folder's: that takes a while.
        measured = read_runs(floor)
        if measured.decomposition.digest != decomposition.digest:
            measured = read_runs(floor, name)
        if not measured.floor_runs:
            raise SetupError(
                Fault(str(floor), "holds no run of a null agent", "fly them: rebar run CAMPAIGN --floor")
            )
        nodes = worst_first(measured.floors())
    if as_json:
        document: dict[str, Any] = {
            "decomposition": decomposition.name,
            "sha256": decomposition.digest,
            "nodes": len(decomposition.nodes),
            "observables": len(decomposition.observables),
        }
        if floor is not None:
            document["floor"] = [_as_json(node) for node in nodes]
        print(json.dumps(document, indent=1))
        return
    console = plain_console()
    counts = f"{len(decomposition.nodes)} nodes, {len(decomposition.observables)} observables"
    print_lines(console, [f"{decomposition.name}: {counts}, every measure, option and key factor is known"])
    if floor is not None:
        titles = {node.id: node.title for node in decomposition.nodes.values()}
        print("floor, ceiling and discrimination, worst first:")
        console.print(_table(nodes, titles))
        flawed = sum(bool(node.flaw) for node in nodes)
        unknown = sum(node.level == "observable" and node.floor is None for node in nodes)
        print_lines(
            console,
            [
                f"{flawed} of {len(decomposition.observables)} observables do not discriminate; "
                f"{unknown} were never considered on these scenes"
            ],
        )


def _as_json(node: NodeFloor) -> dict[str, Any]:
    return {
        **node.model_dump(mode="json"),
        "discrimination": node.discrimination,
        "discriminates": None if node.level != "observable" or node.floor is None else not node.flaw,
        "flaw": node.flaw,
    }


def _table(nodes: Sequence[NodeFloor], titles: dict[str, str]) -> Table:
    table = plain_table(
        ("node", "title", "floor", "ceiling", "apart", "scenes", "reached by"),
        texts=("title", "reached by"),
    )
    for node in nodes:
        apart = node.discrimination
        best = node.floor_agents if node.floor else ()
        reached = ", ".join(best[:3]) + (" ..." if len(best) > 3 else "")
        cells = (
            node.id,
            titles.get(node.id, ""),
            _percent(node.floor),
            _percent(node.ceiling),
            "" if apart is None else f"{100 * apart:.0f}",
            str(node.scenes),
            # In one column: two would break the names of the agents.
            f"does not discriminate: {node.flaw}" if node.flaw else reached,
        )
        add_plain_row(table, cells)
    return table


def _percent(share: float | None) -> str:
    return "" if share is None else f"{share:.0%}"
