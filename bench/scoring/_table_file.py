"""A score table as a file: made batch by batch, and read back with its texts as numbers.

A campaign has tens of rows for each run, so a whole table with its texts would be most of what scoring holds in memory.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import polars as pl

from decompositions import Decomposition

from ._table import SCORE_COLUMNS, ScoredRun, require_new, score_table

RUNS_AT_ONCE = 500
"""Runs that are scored together. Chosen: some 20 MB of arrays and texts, and scoring one by one is slower."""

ROWS_PER_GROUP = 122_880
"""Rows of a group in the file, about: as many as Polars puts into one when it writes a frame that is in memory, so
that a table made in batches has the bytes of one that was made at once (observed with Polars 2.1)."""


class ScoreTableWriter:
    """Collects runs and makes the file of their score table.

    Of each run it keeps its id and its compressed rows, some hundred bytes together. `at_once` runs are scored together;
    the file is the same for any number.
    """

    def __init__(
        self, decomposition: Decomposition, study: Sequence[str] = (), at_once: int = RUNS_AT_ONCE
    ) -> None:
        self._decomposition, self._study, self._at_once = decomposition, study, at_once
        self._realizations: set[str] = set()
        self._waiting: list[ScoredRun] = []
        self._parts: list[bytes] = []
        self._rows = 0

    def add(self, run: ScoredRun) -> None:
        """Take up a run. Raises ValueError for a realization that was added before, and as `score_table`."""
        require_new(run, self._realizations)
        self._waiting.append(run)
        if len(self._waiting) >= self._at_once:
            self._score()

    def content(self) -> bytes:
        """The file (parquet) over all runs so far, with the columns SCORE_COLUMNS."""
        self._score()
        buffer = io.BytesIO()
        if self._parts:
            pl.scan_parquet(self._parts).sink_parquet(buffer, row_group_size=_group_size(self._rows))
        else:
            pl.DataFrame(schema=SCORE_COLUMNS).write_parquet(buffer)
        return buffer.getvalue()

    def _score(self) -> None:
        if self._waiting:
            part, buffer = score_table(self._decomposition, self._waiting, self._study), io.BytesIO()
            part.write_parquet(buffer)
            self._parts.append(buffer.getvalue())
            self._rows += part.height
            self._waiting = []


def read_score_table(source: Path | bytes) -> pl.DataFrame:
    """The score table in a file, or in the content of one, with its texts as categories: half of the memory.

    Columns are those of the file. Raises OSError or PolarsError for a file that is none.
    """
    columns = pl.read_parquet_schema(source)
    # Column by column: all texts of a large table at once would take more than the table that is made of them.
    return pl.DataFrame([_column(source, name) for name in columns])


def _column(source: Path | bytes, name: str) -> pl.Series:
    column = pl.read_parquet(source, columns=[name])[name]
    return column.cast(pl.Categorical) if column.dtype == pl.String else column


def _group_size(rows: int) -> int:
    """Rows of each group of a file, so that groups are equal and as near to ROWS_PER_GROUP as can be."""
    fewer = max(1, rows // ROWS_PER_GROUP)
    groups = min((fewer, fewer + 1), key=lambda count: abs(rows / count - ROWS_PER_GROUP))
    return -(-rows // groups)
