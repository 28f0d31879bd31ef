"""The first line of every output about a campaign that lacks runs, and the exit code that goes with it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.campaign import Completeness

INCOMPLETE_EXIT_CODE = 3
"""Numbers were printed, over fewer runs than the campaign has. 1 and 2 are errors, 130 an interruption."""


def print_missing(completeness: Completeness, folder: Path, *, as_json: bool = False) -> None:
    """Print which runs are missing and how to get them; nothing for a complete campaign.

    Call it before anything else is printed. With `as_json` it goes to stderr, because stdout is one document.
    """
    for line in completeness.lines(folder):
        print(line, file=sys.stderr if as_json else sys.stdout, flush=True)


def print_rewritten(names: Sequence[str]) -> None:
    """Say that files which somebody had changed were written again, to stderr."""
    for name in names:
        print(f"{name} had been changed since its manifest was written; it is written again", file=sys.stderr)
