"""Nodes over many runs: the means as published, the counts beside them, and how sure they are (reading.md 13, 16, 18)."""

from __future__ import annotations

import numpy as np
import polars as pl

from bench.contracts import Outcome
from decompositions import Decomposition, Level, Policies

from ._difficulty import DECIMALS
from ._intervals import clopper_pearson, effective_size

ALL = "all"
SUMMARY_COLUMNS: dict[str, type[pl.DataType]] = {
    "agent": pl.String,
    "configuration": pl.String,
    "node": pl.String,
    "level": pl.String,
    "title": pl.String,
    "difficulty": pl.Float64,
    "difficulty_low": pl.Float64,
    "difficulty_high": pl.Float64,
    "runs": pl.Int64,
    "excluded": pl.Int64,
    "design_points": pl.Int64,
    "considered": pl.Int64,
    "scored": pl.Int64,
    "score_mean": pl.Float64,
    "passed_score_mean": pl.Float64,
    "raised_by_failure": pl.Boolean,
    "confidence_mean": pl.Float64,
    "confidence_low": pl.Float64,
    "confidence_high": pl.Float64,
    "method": pl.String,
}
"""Columns of the summary: one row for each agent, configuration (and `all` of them together) and node.

`runs` are distinct realizations whose outcome the agent answers for, `excluded` the others; `considered` and `scored` count
runs, `design_points` the considered runs' distinct design points. `difficulty` is null where it differs among the runs.
`raised_by_failure` flags a mean score above `passed_score_mean`, the mean had every failed observable passed at its
threshold. `method` names the interval of the confidence."""

EXACT = "clopper-pearson"
CLUSTERED = "korn-graubard"
NOTHING = "none considered"
_KEYS = ("agent", "configuration", "node")
_FAULTS_OF_THE_BENCH = [str(one) for one in Outcome if not one.counts]


def summary_frame(scores: pl.DataFrame, decomposition: Decomposition | None = None) -> pl.DataFrame:
    """Summarise a score table into the columns SUMMARY_COLUMNS.

    Rows come by agent, then configuration with `all` first, then node, each in the order in which the table first has
    them. `decomposition` gives the titles and the policies; without it titles are empty and the published rules hold.
    """
    if scores.is_empty():
        return pl.DataFrame(schema=SUMMARY_COLUMNS)
    policies = decomposition.policies if decomposition else Policies()
    both = pl.concat([scores.with_columns(pl.lit(ALL).alias("configuration")), scores.drop_nulls("configuration")])
    if "passed_score" not in both.columns:  # a table that another simulator wrote may not know it
        both = both.with_columns(pl.lit(None, dtype=pl.Float64).alias("passed_score"))
    grouped = both.group_by(*_KEYS, maintain_order=True).agg(*_counts(), *_means(policies))
    grouped = grouped.join(_clusters(both), on=list(_KEYS), how="left", maintain_order="left")
    titles = {node.id: node.title for node in decomposition.nodes.values()} if decomposition else {}
    told = grouped.with_columns(
        pl.col("node").replace_strict(titles, default="", return_dtype=pl.String).alias("title"),
        pl.when(pl.col("difficulty_high") - pl.col("difficulty_low") < 10.0**-DECIMALS)
        .then("difficulty_low")
        .alias("difficulty"),
        (pl.col("score_mean") > pl.col("passed_score_mean") + 1e-9).fill_null(False).alias("raised_by_failure"),
    )
    return (
        _with_intervals(told)
        .select(pl.col(name).cast(kind) for name, kind in SUMMARY_COLUMNS.items())
        .sort(_place("agent", scores), pl.col("configuration") != ALL, _place("configuration", scores), maintain_order=True)
    )


def _place(column: str, scores: pl.DataFrame) -> pl.Expr:
    """Order of first appearance."""
    names = scores[column].drop_nulls().unique(maintain_order=True).to_list()
    order = {name: place for place, name in enumerate(names)}
    return pl.col(column).replace_strict(order, default=-1, return_dtype=pl.Int64)


def _counts() -> list[pl.Expr]:
    counts = ~pl.col("outcome").is_in(_FAULTS_OF_THE_BENCH)
    considered = pl.col("confidence").is_not_null()
    return [
        pl.col("level").first(),
        pl.col("difficulty").min().alias("difficulty_low"),
        pl.col("difficulty").max().alias("difficulty_high"),
        pl.col("realization").filter(counts).n_unique().alias("runs"),
        pl.col("realization").filter(~counts).n_unique().alias("excluded"),
        pl.col("design_point").filter(considered).n_unique().alias("design_points"),
        pl.col("confidence").count().alias("considered"),
        pl.col("score").count().alias("scored"),
    ]


def _means(policies: Policies) -> list[pl.Expr]:
    pooled = policies.over_runs == "pooled_counts"
    achieved, asked = pl.col("achieved").sum(), pl.col("considered").sum()
    return [
        pl.col("score").mean().alias("score_mean"),
        pl.col("passed_score").mean().alias("passed_score_mean"),
        (pl.when(asked > 0).then(achieved / asked) if pooled else pl.col("confidence").mean()).alias("confidence_mean"),
    ]


def _clusters(both: pl.DataFrame) -> pl.DataFrame:
    """For each group the sum over its design points of (summed deviations of the ratios from their mean) squared."""
    known = both.drop_nulls("confidence").with_columns(
        (pl.col("confidence") - pl.col("confidence").mean().over(*_KEYS)).alias("deviation")
    )
    points = known.group_by(*_KEYS, "design_point").agg(pl.col("deviation").sum().alias("deviation"))
    return points.group_by(*_KEYS).agg((pl.col("deviation") ** 2).sum().alias("squared"))


def _with_intervals(grouped: pl.DataFrame) -> pl.DataFrame:
    """Exact on the counts of an observable whose runs share no design point; else on effective counts."""
    runs = grouped["considered"].to_numpy().astype(np.float64)
    points = grouped["design_points"].to_numpy().astype(np.float64)
    mean = grouped["confidence_mean"].fill_null(0.0).to_numpy()
    plain = (grouped["level"] == str(Level.OBSERVABLE)).to_numpy() & (points == runs)
    effective = effective_size(mean, runs, points, grouped["squared"].fill_null(0.0).to_numpy())
    tried = np.where(plain, runs, effective)
    low, high = clopper_pearson(np.where(plain, np.round(mean * runs), mean * tried), tried)
    method = np.where(runs == 0, NOTHING, np.where(plain, EXACT, CLUSTERED))
    return grouped.with_columns(
        pl.Series("confidence_low", low),
        pl.Series("confidence_high", high),
        pl.Series("method", method.tolist(), dtype=pl.String),
    )
