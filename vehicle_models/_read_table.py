"""Tables of this package: CSV files beside the modules that read them."""

from __future__ import annotations

import csv
from pathlib import Path


def read_table(path: Path) -> list[dict[str, str]]:
    """The rows of a table, each with its cells by column."""
    with path.open(newline="", encoding="ascii") as file:
        return list(csv.DictReader(file))
