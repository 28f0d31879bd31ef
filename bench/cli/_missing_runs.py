"""The first line of every output about a campaign that lacks runs, and the exit code that goes with it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from bench.campaign import Completeness
    from bench.scoring import CompletenessReport

INCOMPLETE_EXIT_CODE = 3
"""Numbers were printed, over fewer runs than the campaign has. 1 and 2 are errors, 130 an interruption."""


def print_missing(completeness: Completeness, folder: Path, *, as_json: bool = False) -> None:
    """Print which runs are missing and how to get them; nothing for a complete campaign.

    Call it before anything else is printed. With `as_json` it goes to stderr, because stdout is one document.
    """
    for line in completeness.lines(folder):
        print(line, file=sys.stderr if as_json else sys.stdout, flush=True)


def completeness_report(completeness: Completeness, folder: Path) -> CompletenessReport:
    """The same for JSON."""
    from bench.scoring import CompletenessReport

    return CompletenessReport(
        folder=str(folder),
        complete=completeness.complete,
        running=completeness.writer is not None,
        total=completeness.total,
        missing=dict(sorted(completeness.missing.items())),
        accepted=completeness.accepted,
    )


def print_missing_in(folders: Sequence[Path], *, as_json: bool = False) -> list[CompletenessReport | None]:
    """`print_missing` for every folder of a command that reads campaigns; None where nothing is known.

    End such a command with `exit_if_incomplete`.
    """
    from bench.campaign import campaign_completeness

    reports: list[CompletenessReport | None] = []
    for folder in folders:
        completeness = campaign_completeness(folder)
        if completeness is not None:
            print_missing(completeness, folder, as_json=as_json)
        reports.append(None if completeness is None else completeness_report(completeness, folder))
    return reports


def exit_if_incomplete(reports: Sequence[Completeness | CompletenessReport | None]) -> None:
    """Raises typer.Exit with INCOMPLETE_EXIT_CODE if a campaign lacks runs."""
    if any(report is not None and not report.complete for report in reports):
        raise typer.Exit(INCOMPLETE_EXIT_CODE)


def print_rewritten(names: Sequence[str]) -> None:
    """Say that files which somebody had changed were written again, to stderr."""
    for name in names:
        print(f"{name} had been changed since its manifest was written; it is written again", file=sys.stderr)
