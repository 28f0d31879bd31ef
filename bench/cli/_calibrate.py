"""`rebar calibrate`: checks rated difficulty against the outcomes of several agents."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from bench.errors import Fault, SetupError

from ._missing_runs import exit_if_incomplete, print_missing_in
from ._tables import plain_console, print_lines

if TYPE_CHECKING:
    from bench.reporting import Calibration, NodeCalibration, TableCalibration
    from bench.statistics import AgentAbility, DifficultySlope

# Beside it, the numbers of the widest row fit into 80 columns.
MAX_TABLE_NAME_CHARACTERS = 29
TEXT_COLUMNS = ("node", "table", "result")
MAX_ODDS_RATIO = 1000.0
SEPARATED = "* separated: Firth's penalised likelihood, a design point counts as one run"
READING = {"rises": "discriminates", "falls": "reversed", "open": "open"}


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(calibrate)


def calibrate(
    campaigns: Annotated[list[Path], typer.Argument(help="Folders of campaigns over one decomposition")],
    agent: Annotated[
        list[str] | None,
        typer.Option(help="Only these agents. Default: all but null agents and the oracle"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="File to write with refitted tables for review; it must not exist yet"),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the shuffles behind p values")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Check rated difficulty against outcomes: does failure rise with it, and which tables are contradicted?

    Changes no decomposition. Needs two agents or more. Ends with code 3 if a campaign lacks runs.

    Example: rebar calibrate out/demo out/mine --out tables.yaml
    """
    from bench.reporting import calibrate as calibrate_campaigns
    from bench.reporting import table_proposal

    if out is not None and os.path.lexists(out):
        raise SetupError(Fault(str(out), "already exists and is not overwritten", "name another file"))
    calibration = calibrate_campaigns(campaigns, agent or (), seed=seed)
    if out is not None and calibration.contradicted:
        out.write_text(table_proposal(calibration), encoding="utf-8")
    completeness = print_missing_in(campaigns, as_json=as_json)
    if as_json:
        document = _document(calibration) | {
            "completeness": [report and report.model_dump(mode="json") for report in completeness]
        }
        # NaN is not JSON: other readers would refuse the document.
        print(json.dumps(document, indent=1, allow_nan=False))
    else:
        _show(calibration)
        if out is not None:
            print(
                f"{out}: review it; nothing applies it"
                if calibration.contradicted
                else f"{out}: not written, because no table is contradicted"
            )
    exit_if_incomplete(completeness)


def _document(calibration: Calibration) -> dict[str, Any]:
    return {
        "campaigns": [str(folder) for folder in calibration.folders],
        "decomposition": calibration.decomposition.name,
        "decomposition_sha256": calibration.decomposition.digest,
        "agents": calibration.agents,
        "excluded_agents": calibration.excluded,
        "runs": calibration.runs,
        "design_points": calibration.design_points,
        "notes": calibration.notes,
        "overall": _slope_document(calibration.overall),
        "nodes": [
            {"node": node.node, "title": node.title, **_slope_document(node.slope)}
            for node in calibration.nodes
        ],
        "tables": [_table_document(table) for table in calibration.tables],
    }


def _slope_document(slope: DifficultySlope) -> dict[str, Any]:
    return {**asdict(slope), "direction": slope.direction}


def _table_document(table: TableCalibration) -> dict[str, Any]:
    return {
        "table": table.name,
        "factor": table.row.factor,
        "observables": table.observables,
        "result": table.result,
        **asdict(table.association),
        "columns": [
            {
                **asdict(column),
                "rating": table.row.ratings[column.column],
                "value": table.row.values[column.column],
            }
            for column in table.columns
        ],
        "disorders": [asdict(disorder) for disorder in table.disorders],
        "proposed": None if table.proposed is None else asdict(table.proposed),
        "no_proposal": table.no_proposal,
    }


def _show(calibration: Calibration) -> None:
    console = plain_console()
    print_lines(console, _heading(calibration))
    fitted = [node for node in calibration.nodes if node.slope.slope is not None]
    slopes = [calibration.overall, *(node.slope for node in fitted)]
    if fitted or calibration.overall.slope is not None:
        print_lines(console, ["Odds of failure for each 10 points of rated difficulty"])
        console.print(_table_of_nodes(calibration.overall, fitted))
    if any(slope.state == "separated" for slope in slopes):
        print_lines(console, [SEPARATED])
    rest = [(str(node.slope.state), node.node) for node in calibration.nodes if node not in fitted]
    print_lines(console, _grouped(rest))
    tested = [table for table in calibration.tables if table.association.p is not None]
    if tested:
        print_lines(console, ["Key factor tables: rank correlation (tau-b) of rating and failure"])
        console.print(_table_of_tables(tested))
    untested = [(table.association.note, table.name) for table in calibration.tables if table not in tested]
    print_lines(console, [*_grouped(untested), *_contradictions(calibration), _chance(len(tested))])


def _heading(calibration: Calibration) -> list[str]:
    lines = [
        f"{calibration.decomposition.name}: {calibration.runs} runs of {len(calibration.agents)} agents at "
        f"{calibration.design_points} design points",
        *(_ability(ability, calibration.overall) for ability in calibration.overall.agents),
    ]
    if calibration.excluded:
        lines.append(f"left out: {', '.join(calibration.excluded)} (--agent names the agents that count)")
    return [*lines, *calibration.notes]


def _ability(ability: AgentAbility, overall: DifficultySlope) -> str:
    counts = f"{ability.agent}: {ability.failed} of {ability.trials} trials of observables failed"
    # Without a slope above 0 there is no such place, or anywhere could be it.
    if ability.even_chance_at is None or overall.direction != "rises":
        return counts
    # The scale ends at 0 and 100; what lies beyond was not flown.
    where = (
        "below 0"
        if ability.even_chance_at < 0.0
        else "above 100"
        if ability.even_chance_at > 100.0
        else f"at {ability.even_chance_at:.0f}"
    )
    return f"{counts}; every second {where}"


def _table(columns: tuple[str, ...]) -> Table:
    """A table without lines: with them the numbers would not fit."""
    table = Table(box=None, padding=(0, 1), collapse_padding=True, pad_edge=False)
    for column in columns:
        # Names and results wrap where they are long; numbers and intervals stay whole.
        is_text = column in TEXT_COLUMNS
        table.add_column(column, justify="left" if is_text else "right", no_wrap=not is_text, overflow="fold")
    return table


def _table_of_nodes(overall: DifficultySlope, nodes: list[NodeCalibration]) -> Table:
    table = _table(("node", "trials", "points", "ratings", "odds x", "95 %", "p", "result"))
    if overall.slope is not None:
        table.add_row(*map(Text, _slope_cells("all observables", overall)))
    for node in nodes:
        table.add_row(*map(Text, _slope_cells(node.node, node.slope)))
    return table


def _slope_cells(name: str, slope: DifficultySlope) -> tuple[str, ...]:
    mark = "*" if slope.state == "separated" else ""
    return (
        name,
        str(slope.trials),
        str(slope.design_points),
        str(slope.difficulties),
        f"{_odds_ratio(slope.slope)}{mark}",
        f"{_odds_ratio(slope.low)} to {_odds_ratio(slope.high)}",
        _p(slope.p),
        READING[slope.direction],
    )


def _odds_ratio(log_odds: float | None) -> str:
    """An odds ratio in three digits; a bound that does not exist is a dash."""
    if log_odds is None:
        return "-"
    limit = math.log(MAX_ODDS_RATIO)
    if abs(log_odds) > limit:
        return f"> {MAX_ODDS_RATIO:g}" if log_odds > 0.0 else f"< 1/{MAX_ODDS_RATIO:g}"
    return f"{math.exp(log_odds):.3g}"


def _table_of_tables(tables: list[TableCalibration]) -> Table:
    # The result stands above the tables that have it: beside them, their names would have to be broken.
    shown = _table(("table", "trials", "points", "ratings", "tau-b", "95 %", "p"))
    order = ("contradicted", "columns out of order", "open", "agrees")
    heading = ""
    for table in sorted(tables, key=lambda table: (order.index(table.result), table.association.note)):
        association = table.association
        ends = (
            "-"
            if association.low is None or association.high is None
            else f"{association.low:.2f} to {association.high:.2f}"
        )
        result = f"{table.result}, {association.note}:" if association.note else f"{table.result}:"
        if result != heading:
            shown.add_row(Text(result))
            heading = result
        cells = (
            _table_name(table.name),
            str(association.trials),
            str(association.design_points),
            str(association.ratings),
            "" if association.tau is None else f"{association.tau:.2f}",
            ends,
            _p(association.p),
        )
        shown.add_row(*map(Text, cells))
    return shown


def _table_name(name: str) -> str:
    """The name in one line, or observable and factor in two, each whole."""
    return name if len(name) <= MAX_TABLE_NAME_CHARACTERS else name.replace("/", "/\n")


def _contradictions(calibration: Calibration) -> list[str]:
    from bench.reporting import disorder_text

    lines = []
    for table in calibration.contradicted:
        lines += [f"{table.name}: {disorder_text(table.row, disorder)}" for disorder in table.disorders]
        if table.proposed is not None:
            pairs = zip(table.proposed.values, table.proposed.ratings, strict=True)
            columns = ", ".join(f"{value:g}: {rating:g}" for value, rating in pairs)
            lines.append(f"{table.name}: proposed ratings by value ({table.row.unit}): {columns}")
        else:
            lines.append(f"{table.name}: no table is proposed: {table.no_proposal}")
    return lines


def _chance(tested: int) -> str:
    if not tested:
        return "No table could be tested: fly more design points at more ratings."
    # 2.5 of 100 for the table as a whole, and as many for all of its neighbouring columns together.
    return (
        f"{tested} tables tested. If no factor had an effect, chance alone would contradict at most about "
        f"{0.05 * tested:.1f} of them."
    )


def _grouped(reasons: list[tuple[str, str]]) -> list[str]:
    """Names by the reason for which they have no number."""
    names: dict[str, list[str]] = {}
    for reason, name in reasons:
        names.setdefault(reason, []).append(name)
    return [f"{reason}: {', '.join(members)}" for reason, members in names.items()]


# Below 0.001 shuffles cannot tell.
def _p(value: float | None) -> str:
    return "" if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"
