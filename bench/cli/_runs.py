"""`rebar runs` and `rebar check`: questions about the runs and the scores of a campaign, for people and pipelines."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.errors import SetupError, command_line

from ._missing_runs import exit_if_incomplete, print_missing_in
from ._tables import add_plain_row, plain_console, plain_table, print_lines

Folder = Annotated[Path, typer.Argument(help="Folder of a campaign")]
NOT_MET_EXIT_CODE = 1


def runs(
    folder: Folder,
    where: Annotated[
        str | None, typer.Option(help="Only runs for which this holds; rebar runs DIR --csv has all words")
    ] = None,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print CSV with every column")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON with every column")] = False,
) -> None:
    """List the runs of a campaign, those that failed first.

    Example: rebar runs out/demo --where 'KA-18.passed == false and fog > 3'

    Example: rebar runs out/demo --where 'outcome != "completed"' --csv
    """
    from bench.reporting import csv_text, load_report_data, matching, plural, runs_table, words_of

    if as_csv and as_json:
        raise SetupError("--csv", "cannot be given together with --json", "give either")
    table = runs_table(load_report_data(folder))
    chosen = table if where is None else matching(table, where, "--where")
    if as_csv:
        print(csv_text(chosen), end="")
        return
    if as_json:
        print(chosen.write_json())
        return
    asked = [] if where is None else words_of(table, where, "--where")
    # A column that has one value in all runs says nothing; one that was asked for is shown.
    usual = [name for name in ("outcome", "failed") if table[name].n_unique() > 1]
    columns = list(dict.fromkeys(["run", *usual, *asked]))
    shown = plain_table([name.replace(".", ".\n") for name in columns])
    for row in chosen.select(columns).iter_rows():
        add_plain_row(shown, [_cell(value) for value in row])
    console = plain_console()
    if len(chosen):
        console.print(shown)
    print_lines(f"{len(chosen)} of {plural(len(table), 'run')}")
    if len(chosen) and (path := chosen["recording"][0]):
        console.print(f"why: {command_line('rebar', 'explain', (folder / path).parent)}", soft_wrap=True)


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def check(
    folder: Folder,
    require: Annotated[list[str], typer.Option(help="What must hold for every agent; may be repeated")],
) -> None:
    """Check the scores of a campaign against requirements. Ends with code 0 if all hold for every agent, 1 if one does not,
    2 if one cannot be read or the folder was changed, 3 if runs are missing.

    About each node: passed, passed.share, passed.low, passed.high, runs, competence_90, competence_90.low, competence_50,
    competence_50.low, score, confidence, confidence.low, confidence.high, floor; measured_90 and so on, where competence is
    given on the scale of measured difficulty. What was not shown meets no requirement.

    Example: rebar check out/demo --require 'KA-18.passed.low >= 0.9'

    Example: rebar check out/demo --require "agent != 'mine' or responsible.passed.low >= 0.9"
    """
    from bench.campaign import verify_folder
    from bench.reporting import load_report_data, matching, requirements_table, words_of

    missing = print_missing_in([folder])
    if faults := verify_folder(folder):
        raise SetupError(faults)
    table = requirements_table(load_report_data(folder))
    if table.is_empty():
        raise SetupError(folder, "has no agent with scores", "run the campaign first")
    is_met = True
    for requirement in require:
        met = set(matching(table, requirement, "--require")["agent"])
        words = words_of(table, requirement, "--require")
        for row in table.iter_rows(named=True):
            values = ", ".join(f"{word} {_cell(row[word])}" for word in words if word != "agent")
            holds = row["agent"] in met
            is_met = is_met and holds
            print(f"{'holds' if holds else 'NOT MET'}: {requirement} for {row['agent']} ({values})")
    exit_if_incomplete(missing)
    if not is_met:
        raise typer.Exit(NOT_MET_EXIT_CODE)
