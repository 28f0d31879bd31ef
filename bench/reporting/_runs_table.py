"""The runs of a campaign as one table: what the page lists, `runs.csv` holds, and `rebar runs --where` asks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from bench.contracts import SessionResult, parse_document
from bench.simspec import FACTORS, factor_values

from ._campaign_data import ReportData, Run
from ._remarks import TABLE_MARKS
from ._simspec_files import situations_of
from .text._format import number
from .text._isolation import isolation_cell
from .text._outcomes import outcome_name

# Rows that a page shows without JavaScript and on paper; runs.csv has all.
LISTED_ROWS = 60


@dataclass(frozen=True, slots=True)
class _Column:
    """A column of every run: its type and value, and its heading on the page, which lists it where runs differ in it."""

    kind: type[pl.DataType]
    value: Callable[[Run], object]
    heading: str = ""


def _counted(kinds: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {text}" for text, count in kinds.items())


def _marks(run: Run) -> str:
    texts = ((mark.label, run.fact(mark.kind)) for mark in TABLE_MARKS)
    return "; ".join(f"{label}: {text}" for label, fact in texts if fact for text in fact.texts)


def _path_in_campaign(run: Run) -> str | None:
    """`runs/RUN/recording.mcap`, or `runs/42/RUN/recording.mcap` in a large campaign."""
    if run.recording is None:
        return None
    parts = run.recording.parts
    return "/".join(parts[-3:] if parts[-3] == "runs" else parts[-4:])


# Columns of every run, before the key factors and the nodes. Of the listed ones the principles come after `failed`.
_COLUMNS = {
    "run": _Column(pl.String, lambda run: run.realization, "Run"),
    "agent": _Column(pl.String, lambda run: run.agent, "Agent"),
    "design_point": _Column(pl.String, lambda run: run.design_point),
    "replicate": _Column(pl.Int64, lambda run: run.replicate),
    # By its key; `runs_table` has the labels.
    "configuration": _Column(pl.String, lambda run: run.configuration, "Difficulty"),
    "outcome": _Column(pl.String, outcome_name, "Outcome"),
    "counts": _Column(pl.Boolean, lambda run: run.counts, "Counts"),
    # Counted from the scores.
    "failed": _Column(pl.Int64, lambda run: None, "Key attributes failed"),
    "simulated_s": _Column(pl.Float64, lambda run: round(run.simulated_s, 3), "Simulated, s"),
    "confined": _Column(pl.String, isolation_cell, "Confined by"),
    "probes": _Column(pl.String, lambda run: _counted(run.probes), "Probes"),
    "mark": _Column(pl.String, _marks, "Mark"),
    "reason": _Column(pl.String, lambda run: run.reason, "Reason"),
    "recording": _Column(pl.String, _path_in_campaign),
    "sha256": _Column(pl.String, lambda run: run.recording_sha256),
    # A text: larger than what JavaScript, and many a spreadsheet, counts with.
    "seed": _Column(pl.String, lambda run: None if run.root_seed is None else str(run.root_seed)),
}


def runs_table(data: ReportData) -> pl.DataFrame:
    """A row for each run, those first that tell most: marked, not completed, with many failed key attributes.

    After the columns of every run come the key factors of the situation, and for each node whether the run passed it, as
    `NODE.passed`: of a principle its verdict. Empty cells: nothing essential was considered, or the run has no scores.
    `failed` counts the key attributes that a run did not pass.
    """
    labels = {configuration.key: configuration.label for configuration in data.configurations}
    factors = {name: factor_values(simspec) for name, simspec in situations_of(data.simspecs)}
    present = [name for name in FACTORS if any(name in values for values in factors.values())]
    rows = [
        {name: column.value(run) for name, column in _COLUMNS.items()}
        | {"configuration": labels.get(run.configuration or "")}
        | {name: factors.get(run.realization, {}).get(name) for name in present}
        for run in data.runs
    ]
    schema = {name: column.kind for name, column in _COLUMNS.items()} | dict.fromkeys(present, pl.Float64)
    table = pl.DataFrame(rows, schema=schema)
    passed = _passed(data)
    attributes = [f"{node.id}.passed" for node in data.nodes.values() if node.level == "ka"]
    failures = [(~pl.col(name)).cast(pl.Int64) for name in attributes if name in passed.columns]
    table = table.join(passed, on="run", how="left", maintain_order="left").with_columns(
        failed=pl.sum_horizontal(failures) if failures else pl.lit(0, pl.Int64)
    )
    completed = pl.col("outcome") == "completed"
    return table.select([*schema, *passed.columns[1:]]).sort(
        pl.col("mark") == "", completed, -pl.col("failed"), "run", maintain_order=True
    )


def _passed(data: ReportData) -> pl.DataFrame:
    """A column for each node, in the order of the decomposition: whether each run passed it."""
    considered = pl.when(pl.col("considered") > 0).then(pl.col("achieved") == pl.col("considered"))
    rows = data.scores.select(
        pl.col("realization").cast(pl.String).alias("run"),
        pl.col("node").cast(pl.String),
        pl.when(pl.col("level").cast(pl.String) == "principle")
        .then(pl.col("verdict"))
        .otherwise(considered)
        .alias("passed"),
    )
    table = rows.pivot(on="node", index="run", values="passed", aggregate_function="first")
    order = [
        *(name for name in data.nodes if name in table.columns),
        *sorted(set(table.columns[1:]) - set(data.nodes)),
    ]
    return table.select("run", *(pl.col(name).alias(f"{name}.passed") for name in order))


@dataclass(frozen=True, slots=True)
class ListedRuns:
    """The table of runs on the page: columns with their headings, the first rows as texts, and what all runs share."""

    heads: tuple[tuple[str, str], ...]
    rows: tuple[tuple[str, ...], ...]
    shared: tuple[str, ...]


def listed_runs(table: pl.DataFrame, data: ReportData) -> ListedRuns:
    """The columns in which runs differ, among them the verdicts of the principles; the others are said once."""
    stated: dict[str, str] = {}
    for name, column in _COLUMNS.items():
        stated |= {name: column.heading} if column.heading else {}
        if name == "failed":
            principles = (node for node in data.nodes.values() if node.level == "principle")
            stated |= {f"{node.id}.passed": node.title for node in principles}
    heads = {name: head for name, head in stated.items() if name in table.columns}
    # A single run shares everything with itself.
    order = [name for name in heads if name == "run" or (table.height > 1 and table[name].n_unique() > 1)]
    first = table.head(LISTED_ROWS).select(order)
    shared = {name: _cell(table[name][0]) for name in heads if name not in order and table.height}
    return ListedRuns(
        tuple((name, heads[name]) for name in order),
        tuple(tuple(map(_cell, row)) for row in first.iter_rows()),
        tuple(
            f"{heads[name][:1].lower()}{heads[name][1:]} {text}"
            for name, text in shared.items()
            if text != "–"
        ),
    )


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "✓" if value else "✗"
    if isinstance(value, float):
        return number(value)
    return "–" if value in (None, "") else str(value)


def failed_stages(table: pl.DataFrame, data: ReportData) -> dict[str, list[tuple[str, str]]]:
    """Of the first runs of the table, for each observable that a run failed and that is about somebody: its id and title,
    and how far the agent came with them.
    """
    folders = {run.realization: run.recording.parent for run in data.runs if run.recording is not None}
    names = [name for name in table.head(LISTED_ROWS)["run"] if name in folders]
    rows = data.scores.filter(
        pl.col("achieved") < pl.col("considered"), pl.col("realization").cast(pl.String).is_in(names)
    )
    failed = set(rows.select(pl.col("realization", "node").cast(pl.String)).iter_rows())
    lines = {}
    for name in names:
        file = folders[name] / "result.json"
        result = parse_document(SessionResult, file.read_bytes()) if file.is_file() else None
        lines[name] = [
            (f"{observation.observable} {data.title(observation.observable)}", observation.stages)
            for observation in (result.observations if result else ())
            if observation.stages and (name, observation.observable) in failed
        ]
    return {name: stages for name, stages in lines.items() if stages}


def runs_document(
    table: pl.DataFrame, boxes: Mapping[str, str], stages: Mapping[str, Sequence[tuple[str, str]]]
) -> dict[str, Any]:
    """The table for the script of the page, column by column; by run, `boxes` are the maps on the page and `stages` those of
    `failed_stages`.

    What all runs share is there once, truth values are a letter each, and texts are numbered.
    """
    return {
        "rows": table.height,
        "columns": [_packed(table[name]) for name in table.columns],
        "maps": dict(boxes),
        "stages": dict(stages),
    }


def _packed(column: pl.Series) -> dict[str, Any]:
    kind = "number" if column.dtype.is_numeric() else "truth value" if column.dtype == pl.Boolean else "text"
    head = {"name": column.name, "kind": kind}
    values = column.to_list()
    if len(set(values)) <= 1:
        return head | {"shared": values[0] if values else None}
    if kind == "truth value":
        return head | {"flags": "".join("-" if value is None else "t" if value else "f" for value in values)}
    if kind == "number":
        return head | {"numbers": [None if value is None else round(value, 6) for value in values]}
    words = {value: place for place, value in enumerate(dict.fromkeys(values))}
    if len(words) == len(values):
        return head | {"numbers": values}
    return head | {"words": list(words), "codes": [words[value] for value in values]}
