"""`rebar history`: versions of an agent over time, a line for each campaign."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._tables import add_plain_row, plain_console, plain_table, print_lines

if TYPE_CHECKING:
    from rich.table import Table

    from bench.reporting import ReportData, Sheet


def history(
    folders: Annotated[list[Path], typer.Argument(help="Folders of campaigns, the oldest first")],
    agent: Annotated[str | None, typer.Option(help="Only this agent")] = None,
) -> None:
    """List what each version of an agent passed, a line for each campaign and agent, and say what makes lines hard to compare.

    Whether two versions differ more than luck allows is a question for rebar compare.

    Example: rebar history out/v1 out/v2 out/v3 --agent mine
    """
    from bench.errors import SetupError
    from bench.reporting import load_report_data, sheets

    campaigns = [(folder, load_report_data(folder)) for folder in folders]
    # By folder: versions usually fly a campaign of one name.
    pages = [(str(folder), page) for folder, data in campaigns for page in sheets(data)]
    agents = [name for name in dict.fromkeys(page.agent for _, page in pages) if agent in (None, name)]
    if not agents:
        flown = ", ".join(dict.fromkeys(page.agent for _, page in pages))
        raise SetupError("--agent", f"{agent} flew in none of the campaigns", f"name one of: {flown}")
    console = plain_console()
    for name in agents:
        own = [(campaign, page) for campaign, page in pages if page.agent == name]
        print_lines(console, [f"{name}: runs passed"])
        console.print(_passed(own))
        print_lines(console, [f"{folder}: {page.version}" for folder, page in own])
        print()
    print_lines(console, _differences(campaigns))


def _passed(pages: list[tuple[str, Sheet]]) -> Table:
    """A row for each folder, a column for each principle."""
    titles = list(dict.fromkeys(row.title for _, page in pages for row in page.rows))
    table = plain_table(["folder", *titles])
    for folder, page in pages:
        passed = {row.title: row.passed.replace(" of ", "/") for row in page.rows}
        add_plain_row(table, [folder, *(passed.get(title, "") for title in titles)])
    return table


def _differences(campaigns: list[tuple[Path, ReportData]]) -> list[str]:
    """What later campaigns do not share with the first."""
    _, first = campaigns[0]
    lines = []
    for folder, data in campaigns[1:]:
        if data.decomposition_sha256 != first.decomposition_sha256:
            lines.append(f"{folder}: another decomposition than in the first; what is asked differs.")
        if {run.scene: run.root_seed for run in data.runs} != {
            run.scene: run.root_seed for run in first.runs
        }:
            lines.append(
                f"{folder}: other scenes than in the first; luck of the scenes is between the lines."
            )
    return lines
