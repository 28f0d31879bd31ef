"""The score table of a campaign's folder, as the report needs it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from bench.errors import command_line
from bench.scoring import SCORE_COLUMNS, read_score_table

_NO_SCORES = pl.DataFrame(schema=SCORE_COLUMNS)


def load_scores(folder: Path, notes: list[str]) -> pl.DataFrame:
    """The score table of a campaign, by realizations and nodes; empty, with a note, where it cannot be read."""
    path, remedy = (
        folder / "scores.parquet",
        f"`{command_line('rebar', 'score', Path(folder.name))}` makes it",
    )
    if not path.is_file():
        notes.append(f"There is no scores.parquet: nothing has been scored yet. {remedy}.")
        return _NO_SCORES
    try:
        frame = read_score_table(path)
    except (OSError, pl.exceptions.PolarsError) as error:
        notes.append(f"scores.parquet could not be read ({error}). {remedy} anew.")
        return _NO_SCORES
    if missing := sorted(set(SCORE_COLUMNS) - set(frame.columns)):
        notes.append(f"scores.parquet lacks the columns {', '.join(missing)}. {remedy} anew.")
        return _NO_SCORES
    # The same folder gives the same bytes, whatever the order in which scoring wrote its rows. Column by column: sorted
    # at once, a large table would be in memory twice.
    order = _order(frame)
    for name in frame.columns:
        frame = frame.with_columns(frame[name].gather(order))
    return frame


def _order(frame: pl.DataFrame) -> pl.Series:
    """The rows of a score table in the order of their realizations and nodes."""
    # By the places of the sorted names: sorted by their texts, a large table would take twice its memory.
    places = []
    for name in ("node", "realization"):
        distinct = frame[name].unique().cast(pl.String).sort()
        rank = pl.DataFrame({name: distinct.cast(frame[name].dtype)}).with_row_index("place")
        places.append(frame.select(name).join(rank, on=name, how="left", maintain_order="left")["place"])
    return pl.Series(np.lexsort([place.to_numpy() for place in places]))


def scored_runs(scores: pl.DataFrame) -> dict[str, dict[str, Any]]:
    """What the score table says about each run as a whole."""
    columns = ["realization", "design_point", "replicate", "agent", "configuration"]
    rows = scores.select(columns).unique("realization", keep="first", maintain_order=True)
    # Runs share agents, design points and configurations: each text is one object, however many runs have it.
    texts: dict[Any, Any] = {}
    return {
        row["realization"]: {name: texts.setdefault(row[name], row[name]) for name in columns[1:]}
        for row in rows.iter_rows(named=True)
    }
