"""Nodes over many runs: the means as published, the counts beside them, and how sure they are (reading.md 13, 16, 18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from bench.contracts import Outcome
from decompositions import Decomposition, Level, Policies

from ._competence import SHARES, Trials, competence, tally
from ._difficulty import DECIMALS
from ._intervals import clopper_pearson, effective_size
from ._plan import Bools, Counts, Floats

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
    "competence_50": pl.Float64,
    "competence_50_low": pl.Float64,
    "competence_50_at_least": pl.Boolean,
    "competence_90": pl.Float64,
    "competence_90_low": pl.Float64,
    "competence_90_at_least": pl.Boolean,
}
"""Columns of the summary: one row for each agent, configuration (and `all` of them together) and node.

`runs` are distinct realizations whose outcome the agent answers for, `excluded` the others; `considered` and `scored` count
runs, `design_points` the considered runs' distinct design points. `difficulty` is null where it differs among the runs.
`raised_by_failure` flags a mean score above `passed_score_mean`, the mean had every failed observable passed at its
threshold. `method` names the interval of the confidence. `competence_*` is over difficulties: it stands in the rows of `all`
alone, and is null where the node was never considered (see `_competence`)."""

EXACT = "clopper-pearson"
CLUSTERED = "korn-graubard"
NOTHING = "none considered"
_FAULTS_OF_THE_BENCH = [str(one) for one in Outcome if not one.counts]


def summary_frame(scores: pl.DataFrame, decomposition: Decomposition | None = None) -> pl.DataFrame:
    """Summarise a score table into the columns SUMMARY_COLUMNS.

    Rows come by agent, then configuration with `all` first, then node, each in the order in which the table first has
    them. `decomposition` gives the titles and the policies; without it titles are empty and the published rules hold.
    """
    if scores.is_empty():
        return pl.DataFrame(schema=SUMMARY_COLUMNS)
    policies = decomposition.policies if decomposition else Policies()
    titles = {node.id: node.title for node in decomposition.nodes.values()} if decomposition else {}
    rows = _Rows.of(scores)
    frames = [_summarised(rows, configurations, policies, titles) for configurations in (rows.together(), rows.apart())]
    place = {name: number for number, name in enumerate((ALL, *rows.configuration.names))}
    order = {name: number for number, name in enumerate(rows.agent.names)}
    return pl.concat(frames).sort(
        pl.col("agent").replace_strict(order, return_dtype=pl.Int64),
        pl.col("configuration").replace_strict(place, return_dtype=pl.Int64),
        maintain_order=True,
    )


@dataclass(frozen=True, slots=True)
class _Texts:
    """A column of texts as numbers in the order of first appearance, -1 where there is none."""

    names: tuple[str, ...]
    numbers: Counts

    @classmethod
    def of(cls, column: pl.Series) -> _Texts:
        names = column.drop_nulls().unique(maintain_order=True).to_list()
        numbers = column.replace_strict(names, list(range(len(names))), default=-1, return_dtype=pl.Int64)
        return cls(tuple(names), numbers.fill_null(-1).to_numpy())


@dataclass(frozen=True, slots=True)
class _Rows:
    """A score table as arrays. Sums over them run in the table's own order: the same on any number of cores."""

    agent: _Texts
    configuration: _Texts
    node: _Texts
    design_point: _Texts
    level: Sequence[str]
    table: pl.DataFrame
    counts: Bools

    @classmethod
    def of(cls, scores: pl.DataFrame) -> _Rows:
        node = _Texts.of(scores["node"])
        levels = dict(scores.select("node", "level").unique(maintain_order=True).iter_rows())
        counts = ~scores["outcome"].is_in(_FAULTS_OF_THE_BENCH)
        return cls(
            _Texts.of(scores["agent"]),
            _Texts.of(scores["configuration"]),
            node,
            _Texts.of(scores["design_point"]),
            [levels[name] for name in node.names],
            scores,
            counts.to_numpy(),
        )

    def together(self) -> _Texts:
        """Every row in one configuration."""
        return _Texts((ALL,), np.zeros(self.table.height, dtype=np.int64))

    def apart(self) -> _Texts:
        """Every row in its own configuration."""
        return self.configuration

    def column(self, name: str) -> tuple[Floats, Bools]:
        """Values of a column, 0 where null, and where they are known; a column that the table lacks is null throughout."""
        if name not in self.table.columns:
            return np.zeros(self.table.height), np.zeros(self.table.height, dtype=np.bool_)
        column = self.table[name]
        return column.cast(pl.Float64).fill_null(0.0).to_numpy(), column.is_not_null().to_numpy()


@dataclass(frozen=True, slots=True)
class _Groups:
    """Rows by agent, configuration and node: `key` is each row's group, or `size` for a row that stands in none."""

    key: Counts
    size: int

    def count(self, where: Bools) -> Counts:
        """Rows of each group for which `where` holds."""
        return np.bincount(self.key[where], minlength=self.size + 1)[: self.size]

    def total(self, values: Floats, where: Bools) -> Floats:
        """Sum over those rows."""
        return _sums(self.key[where], values[where], self.size + 1)[: self.size]

    def mean(self, values: Floats, where: Bools) -> Floats:
        """Mean of each group, NaN in one without any; made null before it leaves this module."""
        count = self.count(where)
        return np.where(count > 0, self.total(values, where) / np.maximum(count, 1), np.nan)

    def ends(self, values: Floats, where: Bools) -> tuple[Floats, Floats]:
        """Least and greatest value of each group, NaN in one without any."""
        low, high = np.full(self.size + 1, np.inf), np.full(self.size + 1, -np.inf)
        np.minimum.at(low, self.key[where], values[where])
        np.maximum.at(high, self.key[where], values[where])
        known = np.isfinite(low[: self.size])
        return np.where(known, low[: self.size], np.nan), np.where(known, high[: self.size], np.nan)

    def clusters(self, values: Floats, where: Bools, points: Counts) -> tuple[Counts, Floats]:
        """Distinct design points of each group, and the sum over them of (summed deviations from the mean) squared."""
        mean = np.append(np.nan_to_num(self.mean(values, where)), 0.0)
        width = int(points.max(initial=0)) + 2
        cluster, member = np.unique(self.key[where] * width + points[where] + 1, return_inverse=True)
        deviation = _sums(member, values[where] - mean[self.key[where]], len(cluster))
        group = cluster // width
        points_in = np.bincount(group, minlength=self.size + 1)[: self.size]
        return points_in, _sums(group, deviation**2, self.size + 1)[: self.size]


def _sums(key: Counts, weights: Floats, length: int) -> Floats:
    return np.asarray(np.bincount(key, weights=weights, minlength=length), dtype=np.float64)


def _summarised(rows: _Rows, configuration: _Texts, policies: Policies, titles: Mapping[str, str]) -> pl.DataFrame:
    shape = (len(rows.agent.names), len(configuration.names), len(rows.node.names))
    groups = _groups(rows, configuration, shape)
    score, scored = rows.column("score")
    passed, _ = rows.column("passed_score")
    ratio, considered = rows.column("confidence")
    low, high = groups.ends(*rows.column("difficulty"))
    points, squared = groups.clusters(ratio, considered, rows.design_point.numbers)
    score_mean, passed_mean = groups.mean(score, scored), groups.mean(passed, rows.column("passed_score")[1])
    confidence = _confidence(rows, groups, policies)
    runs = groups.count(considered)
    agent, place, node = np.unravel_index(np.arange(groups.size), shape)
    level = np.array(rows.level)[node]
    frame = pl.DataFrame(
        {
            "agent": np.array(rows.agent.names)[agent],
            "configuration": np.array(configuration.names)[place],
            "node": np.array(rows.node.names)[node],
            "level": level,
            "title": np.array([titles.get(name, "") for name in rows.node.names])[node],
            "difficulty": np.where(high - low < 10.0**-DECIMALS, low, np.nan),
            "difficulty_low": low,
            "difficulty_high": high,
            "runs": groups.count(rows.counts),
            "excluded": groups.count(~rows.counts),
            "design_points": points,
            "considered": runs,
            "scored": groups.count(scored),
            "score_mean": score_mean,
            "passed_score_mean": passed_mean,
            "raised_by_failure": score_mean > passed_mean + 1e-9,
            "confidence_mean": confidence,
            **_intervals(confidence, runs, points, squared, level == str(Level.OBSERVABLE)),
            **(_competence(rows, groups) if configuration.names == (ALL,) else {}),
        },
    )
    absent = [pl.lit(None, dtype).alias(name) for name, dtype in SUMMARY_COLUMNS.items() if name not in frame.columns]
    frame = frame.with_columns(absent).select(pl.col(name).cast(dtype) for name, dtype in SUMMARY_COLUMNS.items())
    return frame.with_columns(pl.col(pl.Float64).fill_nan(None)).filter(pl.col("runs") + pl.col("excluded") > 0)


def _groups(rows: _Rows, configuration: _Texts, shape: tuple[int, int, int]) -> _Groups:
    size = shape[0] * shape[1] * shape[2]
    key = (rows.agent.numbers * shape[1] + configuration.numbers) * shape[2] + rows.node.numbers
    return _Groups(np.where(configuration.numbers >= 0, key, size), size)


def _confidence(rows: _Rows, groups: _Groups, policies: Policies) -> Floats:
    if policies.over_runs == "mean_of_ratios":
        return groups.mean(*rows.column("confidence"))
    achieved, asked = (groups.total(*rows.column(name)) for name in ("achieved", "considered"))
    return np.where(asked > 0, achieved / np.maximum(asked, 1.0), np.nan)


def _intervals(mean: Floats, considered: Counts, points: Counts, squared: Floats, leaf: Bools) -> dict[str, Any]:
    """Exact on the counts of an observable whose runs share no design point; else on effective counts."""
    runs, share = considered.astype(np.float64), np.nan_to_num(mean)
    plain = leaf & (points == considered)
    tried = np.where(plain, runs, effective_size(share, runs, points, squared))
    low, high = clopper_pearson(np.where(plain, np.round(share * runs), share * tried), tried)
    method = np.where(considered == 0, NOTHING, np.where(plain, EXACT, CLUSTERED))
    return {"confidence_low": low, "confidence_high": high, "method": method}


def _competence(rows: _Rows, groups: _Groups) -> dict[str, pl.Series]:
    """The columns of competence, null in groups without a trial."""
    achieved, _ = rows.column("achieved")
    asked, _ = rows.column("considered")
    difficulty, _ = rows.column("difficulty")
    tried = (asked > 0) & rows.counts & (groups.key < groups.size)
    points = rows.design_point.numbers[tried]
    counted = tally(Trials(groups.key[tried], difficulty[tried], (achieved == asked)[tried], points), groups.size)
    columns: dict[str, pl.Series] = {}
    for name, share in SHARES.items():
        found = competence(counted, share)
        known = pl.Series(found.trials > 0)
        parts = (("", found.value), ("_low", found.low), ("_at_least", found.at_least))
        columns |= {f"competence_{name}{part}": _known(pl.Series(values), known) for part, values in parts}
    return columns


def _known(values: pl.Series, known: pl.Series) -> pl.Series:
    return pl.DataFrame({"value": values, "known": known}).select(pl.when("known").then("value")).to_series()
