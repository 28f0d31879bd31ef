"""`rebar decomposition check`: what a document promises, what needs no merit, and what agents show."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.errors import SetupError

from ._tables import add_plain_row, plain_console, plain_table, print_lines

if TYPE_CHECKING:
    from rich.table import Table

    from bench.scoring import NodeFloor, Panel
    from decompositions import Decomposition


def check(
    name: Annotated[str, typer.Argument(help="Name or file of a decomposition")],
    floor: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder of a campaign run with --floor: show floor, ceiling and discrimination of every node",
        ),
    ] = None,
    panel: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            help="Folder of a campaign, once or more: show what its agents' runs say about redundancy and discrimination",
        ),
    ] = None,
    order: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="WORSE BETTER", help="With --panel: show where the worse of two agents reaches more"
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Check the document of a decomposition, with --floor what can be had under it without merit, and with --panel
    whether it measures different things and tells agents apart. Exits with 1 where a panel is beyond a bound.

    The nodes that discriminate least come first. An observable is flagged if a null agent reaches more than a
    half, or more than nine tenths of what an agent reaches that is given the truth.

    Example: rebar decomposition check search-and-report

    Example: rebar decomposition check search-and-report --floor out/demo

    Example: rebar decomposition check search-and-report --panel out/demo --order reference-naive reference-bystander-aware
    """
    from bench.campaign import load_measurable_decomposition

    decomposition = load_measurable_decomposition(name)
    nodes = None if floor is None else _floor_nodes(decomposition, name, floor)
    if order and not panel:
        raise SetupError("--order", "compares agents of a panel", "add --panel DIR")
    shown = _panel(decomposition, name, panel, order) if panel else None
    if as_json:
        document: dict[str, Any] = {
            "decomposition": decomposition.name,
            "sha256": decomposition.digest,
            "nodes": len(decomposition.nodes),
            "observables": len(decomposition.observables),
        }
        if nodes is not None:
            document["floor"] = [_as_json(node) for node in nodes]
        if shown is not None:
            document["panel"] = shown.model_dump(mode="json")
        print(json.dumps(document, indent=1))
    else:
        counts = f"{len(decomposition.nodes)} nodes, {len(decomposition.observables)} observables"
        known = f"{decomposition.name}: {counts}, every measure, option and key factor is known"
        print_lines(known)
        if nodes is not None:
            _print_floor(nodes, decomposition)
        if shown is not None:
            _print_panel(shown, decomposition)
    _exit_beyond_bounds(shown)


def _floor_nodes(decomposition: Decomposition, name: str, folder: Path) -> list[NodeFloor]:
    """Floor and ceiling of every node in a campaign's folder, worst first."""
    from bench.campaign import read_runs
    from bench.scoring import worst_first

    # Measured again only with another decomposition than the folder's: that takes a while.
    measured = read_runs(folder)
    if measured.decomposition.digest != decomposition.digest:
        measured = read_runs(folder, name)
    if not measured.floor_runs:
        raise SetupError(folder, "holds no run of a null agent", "fly them: rebar run CAMPAIGN --floor")
    return worst_first(measured.floors())


def _print_floor(nodes: Sequence[NodeFloor], decomposition: Decomposition) -> None:
    print("floor, ceiling and discrimination, worst first:")
    titles = {node.id: node.title for node in decomposition.nodes.values()}
    plain_console().print(_table(nodes, titles))
    flawed = sum(bool(node.flaw) for node in nodes)
    unknown = sum(node.level == "observable" and node.floor is None for node in nodes)
    print_lines(
        f"{flawed} of {len(decomposition.observables)} observables do not discriminate; "
        f"{unknown} were never considered on these scenes"
    )


def _exit_beyond_bounds(panel: Panel | None) -> None:
    if panel is not None and not all(panel.bounds.values()):
        raise typer.Exit(1)


def _panel(
    decomposition: Decomposition, name: str, folders: Sequence[Path], order: tuple[str, str] | None
) -> Panel:
    """What the runs in these folders show. Raises SetupError where they were measured with another decomposition."""
    import polars as pl

    from bench.campaign import read_runs
    from bench.reporting import require_distinct
    from bench.scoring import panel_of, score_table

    require_distinct(folders)
    tested: list[pl.DataFrame] = []
    null: list[pl.DataFrame] = []
    oracle = None
    for number, folder in enumerate(folders):
        measured = read_runs(folder)
        if measured.decomposition.digest != decomposition.digest:
            what = f"its runs were measured with another decomposition than {name}"
            remedy = f"measure them again: rebar score {folder} --decomposition {name}"
            raise SetupError(folder, what, remedy)
        # Folders may use the same ids for other scenes.
        ids = [
            pl.format(f"{number}-{{}}", column).alias(column) for column in ("realization", "design_point")
        ]
        for tables, runs in ((tested, measured.runs), (null, measured.floor_runs)):
            tables.append(score_table(decomposition, runs, measured.study).with_columns(ids))
        oracle = oracle or measured.oracle
    try:
        return panel_of(pl.concat(tested), pl.concat(null), oracle, order)
    except ValueError as error:
        raise SetupError("--order", str(error), "name two of these") from error


def _print_panel(panel: Panel, decomposition: Decomposition) -> None:
    print_lines(
        f"panel: {panel.sessions} sessions of {', '.join(panel.agents)}; {panel.observables} observables about the agent, "
        f"of which {len(panel.constant)} constant ones and {panel.unknown_correlations} pairs have no correlation"
    )
    print("the clearest difference between two agents, and the floor, in percent:")
    table = plain_table(("node", "apart", "noise", "floor", "best", "more, less"), texts=("more, less",))
    for node in panel.nodes:
        same = (
            "separates no two agents"
            if node.noise is not None
            else "not known: both flew no design point twice"
        )
        agents = f"{node.higher}, {node.lower}" if node.separated else same
        shares = (_percent(share) for share in (node.difference, node.noise, node.floor, node.best))
        add_plain_row(table, (node.id, *shares, agents))
    plain_console().print(table)

    def named(node: str) -> str:
        return f"{node} {decomposition.nodes[node].title}"

    lines = [
        f"equal in {count} sessions: {named(first)}; {named(second)}" for first, second, count in panel.equal
    ]
    lines += [f"always passed, {count} times: {named(node)}" for node, count in panel.always_passed.items()]
    for node in panel.worse_is_better:
        lines.append(f"worse is better: {named(node.id)}, {node.higher} by {_percent(node.difference)}")
    lines += [f"{'met' if met else 'NOT MET'}: {bound}" for bound, met in panel.bounds.items()]
    print_lines(*lines)


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
