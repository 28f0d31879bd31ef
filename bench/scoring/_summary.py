"""Nodes over many runs: the published means, their counts and their intervals (docs/rulings.md 13, 16,
18).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from bench.arrays import Bools, Counts, Floats
from bench.statistics import (
    COMPETENCE_SHARES,
    DIFFICULTY_DECIMALS,
    TrialCounts,
    Trials,
    bounded_mean,
    clopper_pearson,
    competence,
    count_design_points,
    count_trials,
    effective_size,
    failures_rise,
    mean_bounds,
    pass_rate_bounds,
    replicate_interval,
)
from decompositions import Decomposition, Level, Policies

from ._table import EXCLUDED_OUTCOMES

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
    "passed": pl.Int64,
    "passed_low": pl.Float64,
    "passed_high": pl.Float64,
    "scored": pl.Int64,
    "score_mean": pl.Float64,
    "score_low": pl.Float64,
    "score_high": pl.Float64,
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
    "failures_rise": pl.Boolean,
}
"""Columns of the summary: one row for each agent, configuration (and `all` of them together) and node.

`runs` are distinct realizations whose outcome is the agent's responsibility, `excluded` those that the bench
spoilt. `considered` and `scored` count runs, `design_points` counts the distinct design points of the
considered runs. `passed` counts the considered runs in which every considered observable was achieved;
`passed_low` and `passed_high` are the interval of the share of considered runs that pass, by the same rule as
the interval of an observable's confidence. `difficulty` is null where it differs among the runs. `raised_by_failure` flags a mean score
above `passed_score_mean`, the mean that the runs would have if every failed observable had passed at its
threshold. `score_low` and `score_high` are what the mean would vary if the same design were flown again with new seeds; null where too
few design points were flown more than once. `method` names the
interval of the confidence. `competence_*` is over all difficulties: only the rows of `all` have it, and it is
null where the node was never considered. It assumes that failures rise with difficulty; `failures_rise` says whether these
runs show it, by the 95 % interval of the slope of failure on difficulty. Reports give no competence where they do not.
"""


NO_INTERVAL, EXACT_INTERVAL, CLUSTERED_INTERVAL = "none considered", "clopper-pearson", "korn-graubard"
# With early stopping the results decide how many runs there are, and exact intervals for a fixed number do
# not hold.
ANYTIME_PASS_RATE, ANYTIME_MEAN = "anytime-valid (pass rate)", "anytime-valid (mean)"
# Ratios between 0 and 1 vary less than passes and failures, so intervals for counts are too wide for them.
RATIO_INTERVAL = "gaffke"

# Both means come from different sums of the same numbers, so equal ones differ in their last bits.
RAISED_SLACK = 1e-9

_METHODS = (NO_INTERVAL, EXACT_INTERVAL, CLUSTERED_INTERVAL, ANYTIME_PASS_RATE, ANYTIME_MEAN, RATIO_INTERVAL)


def summary_frame(scores: pl.DataFrame, decomposition: Decomposition | None = None) -> pl.DataFrame:
    """Summarise a score table into the columns SUMMARY_COLUMNS.

    Rows are sorted by agent, then configuration with `all` first, then node, each in the order of first
    appearance in the table. `decomposition` gives titles and policies; without it titles are empty and the
    published rules hold.
    """
    if scores.is_empty():
        return pl.DataFrame(schema=SUMMARY_COLUMNS)
    policies = decomposition.policies if decomposition else Policies()
    titles = {node.id: node.title for node in decomposition.nodes.values()} if decomposition else {}
    scenes = _scene_sums(scores)
    by_configuration = _summary_rows(scenes.configured(), policies, titles)
    # The name is reused to free the sums of the configurations, which may be large.
    scenes = scenes.together()
    overall = _summary_rows(scenes, policies, titles).with_columns(**_competence(scenes, scores))
    frame = pl.concat([overall, by_configuration], how="diagonal")
    flown = frame.filter(pl.col("runs") + pl.col("excluded") > 0)
    # `all` has number 0 like the first configuration; it stays before it because it comes first in the
    # concatenation.
    flown = flown.sort("_agent", "_place", maintain_order=True)
    return flown.select(pl.col(name).cast(dtype) for name, dtype in SUMMARY_COLUMNS.items())


@dataclass(frozen=True, slots=True)
class _TextCodes:
    """A column of texts as numbers in the order of first appearance, -1 where a text is null."""

    names: tuple[str, ...]
    numbers: NDArray[np.int32]

    @classmethod
    def of(cls, column: pl.Series) -> _TextCodes:
        distinct = column.drop_nulls().unique(maintain_order=True)
        if column.dtype == pl.Categorical:
            # By their numbers: as texts, a column of a large table would take several times its memory.
            numbers = distinct.to_physical().to_numpy()
            # A null gets the number after all others, at which nothing is placed.
            null = int(numbers.max(initial=0)) + 1
            place = np.full(null + 1, -1, dtype=np.int32)
            place[numbers] = np.arange(len(distinct))
            codes = column.to_physical().fill_null(null).to_numpy()
            return cls(tuple(distinct.cast(pl.String)), place[codes])
        names = distinct.cast(pl.String)
        places = column.cast(pl.String).cast(pl.Enum(names)).to_physical().cast(pl.Int32)
        return cls(tuple(names), places.fill_null(-1).to_numpy())


@dataclass(frozen=True, slots=True)
class _SceneSums:
    """A score table summed over the runs of each scene: an agent in a design point of a configuration.

    Scenes are sorted by the numbers of agent, configuration and design point (-1: none). `sums` are (scenes,
    nodes), added in the order of the table, so that they are the same on any number of cores. `low` and
    `high` are the lowest and highest difficulty.
    """

    agents: tuple[str, ...]
    configurations: tuple[str, ...]
    design_points: tuple[str, ...]
    nodes: tuple[str, ...]
    levels: tuple[str, ...]
    agent: Counts
    configuration: Counts
    point: Counts
    sums: Mapping[str, NDArray[Any]]
    low: Floats
    high: Floats

    def together(self) -> _SceneSums:
        """The same with all configurations merged into one."""
        order = np.lexsort((self.point, self.agent))
        agent, point = self.agent[order], self.point[order]
        first = np.flatnonzero((np.diff(agent, prepend=-2) != 0) | (np.diff(point, prepend=-2) != 0))
        return replace(
            self,
            configurations=(ALL,),
            agent=agent[first],
            configuration=np.zeros(first.size, dtype=np.int64),
            point=point[first],
            sums={name: np.add.reduceat(values[order], first) for name, values in self.sums.items()},
            low=np.minimum.reduceat(self.low[order], first),
            high=np.maximum.reduceat(self.high[order], first),
        )

    def configured(self) -> _SceneSums:
        """The scenes that have a configuration."""
        has = self.configuration >= 0
        if has.all():
            return self
        return replace(
            self,
            agent=self.agent[has],
            configuration=self.configuration[has],
            point=self.point[has],
            sums={name: values[has] for name, values in self.sums.items()},
            low=self.low[has],
            high=self.high[has],
        )

    @property
    def starts(self) -> Counts:
        """Index of the first scene of each block: the scenes of one agent in one configuration."""
        return np.flatnonzero(
            (np.diff(self.agent, prepend=-2) != 0) | (np.diff(self.configuration, prepend=-2) != 0)
        )

    def total(self, name: str) -> NDArray[Any]:
        """Sums over each block, as (blocks, nodes)."""
        values = self.sums[name]
        return np.add.reduceat(
            values, self.starts, dtype=np.float64 if values.dtype.kind == "f" else np.int64
        )


def _scene_sums(scores: pl.DataFrame) -> _SceneSums:
    agent, configuration, point = (
        _TextCodes.of(scores[name]) for name in ("agent", "configuration", "design_point")
    )
    places, points = len(configuration.names) + 1, len(point.names) + 1
    keys, scene = _dense_codes(
        ((agent.numbers + np.int64(1)) * places + configuration.numbers + 1) * points + point.numbers + 1
    )
    names = {"agents": agent.names, "configurations": configuration.names, "design_points": point.names}
    # Arrays as long as the table, which may be large.
    del agent, configuration, point
    node = _TextCodes.of(scores["node"])
    shape = (keys.size, len(node.names))
    slot = scene * shape[1] + node.numbers
    a_row = np.zeros(shape[1], dtype=np.int64)
    # The last row of each node is as good as any other: a node has one level.
    a_row[node.numbers] = np.arange(scores.height)
    low, high = _ends(scores, slot, shape[0] * shape[1])
    return _SceneSums(
        **names,
        nodes=node.names,
        levels=tuple(scores["level"].gather(a_row)),
        agent=keys // (points * places) - 1,
        configuration=keys // points % places - 1,
        point=keys % points - 1,
        sums={name: values.reshape(shape) for name, values in _summed(scores, slot, shape[0] * shape[1])},
        low=low.reshape(shape),
        high=high.reshape(shape),
    )


def _ends(scores: pl.DataFrame, slot: Counts, size: int) -> tuple[Floats, Floats]:
    """Lowest and highest difficulty of each slot; infinite where it has none."""
    low, high = np.full(size, np.inf), np.full(size, -np.inf)
    rated, is_known = _column(scores, "difficulty")
    if not is_known.all():
        slot, rated = slot[is_known], rated[is_known]
    np.minimum.at(low, slot, rated)
    np.maximum.at(high, slot, rated)
    return low, high


def _summed(scores: pl.DataFrame, slot: Counts, size: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Counts of runs and sums of values in each slot, one column at a time, because a table may be large."""

    def count_rows(where: NDArray[Any]) -> NDArray[np.int32]:
        # bincount adds in float64, which is exact for whole numbers.
        return np.bincount(slot, weights=where, minlength=size).astype(np.int32)

    is_counted = (~scores["outcome"].is_in(EXCLUDED_OUTCOMES)).to_numpy()
    yield "runs", count_rows(is_counted)
    yield "excluded", count_rows(~is_counted)
    yield "until_settled", _until_settled(scores, is_counted, slot, size)
    for name, known_name in (("confidence", "considered"), ("score", "scored"), ("passed_score", "passable")):
        values, is_known = _column(scores, name)
        yield known_name, count_rows(is_known)
        yield name, np.bincount(slot, weights=values, minlength=size)
        if name != "passed_score":
            yield f"{name}_squared", np.bincount(slot, weights=values**2, minlength=size)
    achieved, considered = _column(scores, "achieved")[0], _column(scores, "considered")[0]
    yield "achieved", count_rows(achieved)
    yield "asked", count_rows(considered)
    is_trial = is_counted & (considered > 0)
    yield "trials", count_rows(is_trial)
    yield "passes", count_rows(is_trial & (achieved == considered))


def _until_settled(scores: pl.DataFrame, counts: Bools, slot: Counts, size: int) -> NDArray[np.int32]:
    """Number of runs of each slot whose design point stopped early."""
    if "until_settled" not in scores.columns or not scores["until_settled"].any():
        return np.zeros(size, dtype=np.int32)
    looked = counts & scores["until_settled"].fill_null(value=False).to_numpy()
    return np.bincount(slot[looked], minlength=size).astype(np.int32)


def _column(scores: pl.DataFrame, name: str) -> tuple[Floats, Bools]:
    """Values of a column (0 where null) and whether they are known; a column that the table lacks is null in
    every row.
    """
    if name not in scores.columns:
        return np.zeros(scores.height), np.zeros(scores.height, dtype=np.bool_)
    column = scores[name]
    return column.cast(pl.Float64).fill_null(0.0).to_numpy(), column.is_not_null().to_numpy()


def _dense_codes(keys: Counts) -> tuple[Counts, Counts]:
    """Distinct keys, rising, and the number of each entry's; without sorting where the keys are dense
    enough.
    """
    size = int(keys.max()) + 1
    # Sorting is slower than a table over all keys, unless most of that table would be empty. 4 is chosen, not
    # measured.
    if size > 4 * keys.size:
        distinct, number = np.unique(keys, return_inverse=True)
        return distinct, number
    present = np.zeros(size, dtype=np.bool_)
    present[keys] = True
    return np.flatnonzero(present), (np.cumsum(present) - 1)[keys]


def _mean(total: Floats, count: Counts) -> Floats:
    """Mean, NaN where the count is 0; NaN becomes null before it leaves this module."""
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _summary_rows(scenes: _SceneSums, policies: Policies, titles: Mapping[str, str]) -> pl.DataFrame:
    starts, nodes = scenes.starts, scenes.nodes
    considered, scored = scenes.total("considered"), scenes.total("scored")
    low, high = np.minimum.reduceat(scenes.low, starts), np.maximum.reduceat(scenes.high, starts)
    score, passed = (
        _mean(scenes.total("score"), scored),
        _mean(scenes.total("passed_score"), scenes.total("passable")),
    )
    score_low, score_high = _score_ends(scenes)
    confidence = _confidence(scenes, policies)
    points = np.add.reduceat((scenes.sums["considered"] > 0).astype(np.int64), starts)
    leaf = np.array([level == Level.OBSERVABLE for level in scenes.levels])
    counted = leaf | (_only_passes_and_failures(scenes) & (policies.over_runs == "mean_of_ratios"))
    independent = counted & (points == considered)
    squared = _spread(scenes, points, "confidence", "confidence_squared")
    confidence_low, confidence_high = _interval(confidence, considered, points, squared, independent, counted)
    passes = scenes.total("passes")
    passed_share = _mean(passes, considered)
    passed_low, passed_high = _interval(
        passed_share,
        considered,
        points,
        _spread(scenes, points, "passes", "passes"),
        points == considered,
        np.ones_like(counted),
    )
    # Indices into _METHODS.
    method = np.where(considered == 0, 0, np.where(independent, 1, np.where(counted, 2, 5)))
    stopped_early = (considered > 0) & (scenes.total("until_settled") > 0)
    if stopped_early.any():
        single_point = leaf & (points == 1)
        low_end, high_end = _anytime_interval(confidence, considered, single_point)
        confidence_low, confidence_high = (
            np.where(stopped_early, low_end, confidence_low),
            np.where(stopped_early, high_end, confidence_high),
        )
        method = np.where(stopped_early, np.where(single_point, 3, 4), method)
        low_end, high_end = _anytime_interval(passed_share, considered, points == 1)
        passed_low, passed_high = (
            np.where(stopped_early, low_end, passed_low),
            np.where(stopped_early, high_end, passed_high),
        )
    blocks = {
        "_agent": np.repeat(scenes.agent[starts], len(nodes)),
        "_place": np.repeat(scenes.configuration[starts], len(nodes)),
        "difficulty": np.where((high - low < 10.0**-DIFFICULTY_DECIMALS) & np.isfinite(low), low, np.nan),
        "difficulty_low": np.where(np.isfinite(low), low, np.nan),
        "difficulty_high": np.where(np.isfinite(high), high, np.nan),
        "runs": scenes.total("runs"),
        "excluded": scenes.total("excluded"),
        "design_points": points,
        "considered": considered,
        "passed": passes,
        "passed_low": passed_low,
        "passed_high": passed_high,
        "scored": scored,
        "score_mean": score,
        "score_low": np.minimum(score_low, score),
        "score_high": np.maximum(score_high, score),
        "passed_score_mean": passed,
        "raised_by_failure": score > passed + RAISED_SLACK,
        "confidence_mean": confidence,
        "confidence_low": confidence_low,
        "confidence_high": confidence_high,
    }
    of_block, of_node = (
        np.repeat(np.arange(starts.size), len(nodes)),
        np.tile(np.arange(len(nodes)), starts.size),
    )
    texts = {
        "agent": _gather(scenes.agents, scenes.agent[starts][of_block]),
        "configuration": _gather(scenes.configurations, scenes.configuration[starts][of_block]),
        "node": _gather(nodes, of_node),
        "level": _gather(scenes.levels, of_node),
        "title": _gather([titles.get(name, "") for name in nodes], of_node),
        "method": _gather(_METHODS, method.ravel()),
    }
    frame = pl.DataFrame(texts | {name: pl.Series(values.ravel()) for name, values in blocks.items()})
    return frame.with_columns(pl.col(pl.Float64).fill_nan(None))


def _gather(texts: Sequence[str], index: Counts) -> pl.Series:
    return pl.Series(texts, dtype=pl.String).gather(index)


def _confidence(scenes: _SceneSums, policies: Policies) -> Floats:
    if policies.over_runs == "mean_of_ratios":
        return _mean(scenes.total("confidence"), scenes.total("considered"))
    considered_leaves = scenes.total("asked")
    return np.where(
        considered_leaves > 0, scenes.total("achieved") / np.maximum(considered_leaves, 1.0), np.nan
    )


def _only_passes_and_failures(scenes: _SceneSums) -> Bools:
    """Whether every ratio of the block is 0 or 1: only then is its sum of squares its sum."""
    return np.asarray(scenes.total("confidence") - scenes.total("confidence_squared") < 1e-9)


def _spread(scenes: _SceneSums, points: Counts, name: str, squares: str) -> Floats:
    """Sum over design points of the squared sum of the deviations of their values from the mean of the block;
    over runs where there is a single design point, whose replicates have independent seeds. `name` and
    `squares` are the sums of the values and of their squares.
    """
    runs = scenes.total("considered")
    mean = np.nan_to_num(_mean(scenes.total(name), runs))
    block = np.cumsum(np.isin(np.arange(scenes.agent.size), scenes.starts)) - 1
    deviation = scenes.sums[name] - scenes.sums["considered"] * mean[block]
    over_runs = np.maximum(scenes.total(squares) - runs * mean**2, 0.0)
    return np.where(points == 1, over_runs, np.add.reduceat(deviation**2, scenes.starts))


def _score_ends(scenes: _SceneSums) -> tuple[Floats, Floats]:
    """What the mean score of each block would vary if the same design points were flown again."""
    bounds = np.full((2, scenes.starts.size, len(scenes.nodes)), np.nan)
    for block, (first, last) in enumerate(pairwise([*scenes.starts.tolist(), scenes.agent.size])):
        names = ("score", "score_squared", "scored", "considered")
        bounds[:, block] = replicate_interval(*(scenes.sums[name][first:last] for name in names))
    return bounds[0], bounds[1]


def _interval(
    mean: Floats, considered: Counts, points: Counts, squared: Floats, independent: Bools, counted: Bools
) -> tuple[Floats, Floats]:
    """Exact on the counts where `independent` (passes and failures that share no design point), on effective
    counts elsewhere where `counted`, and for the mean of ratios in all other places (ruling 18).
    """
    runs, share = considered.astype(np.float64), np.nan_to_num(mean)
    tried = np.where(independent, runs, effective_size(share, runs, points, squared))
    low, high = clopper_pearson(np.where(independent, np.round(share * runs), share * tried), tried)
    ratio_low, ratio_high = bounded_mean(share, runs, np.where(points == 1, runs, points), squared)
    return np.where(counted, low, ratio_low), np.where(counted, high, ratio_high)


def _anytime_interval(mean: Floats, considered: Counts, alone: Bools) -> tuple[Floats, Floats]:
    """Of the pass rate where `alone` (an observable with a single design point), else of the mean of the
    expectations.
    """
    runs = considered.astype(np.float64)
    total = np.nan_to_num(mean) * runs
    rate, expected = pass_rate_bounds(np.round(total), runs), mean_bounds(total, runs)
    return np.where(alone, rate[0], expected[0]), np.where(alone, rate[1], expected[1])


def _competence(scenes: _SceneSums, scores: pl.DataFrame) -> dict[str, pl.Series]:
    """The columns of competence of every agent and node over all configurations, null without a trial (ruling
    17).
    """
    groups = len(scenes.agents) * len(scenes.nodes)
    has_trials_in_scene = scenes.sums["trials"] > 0
    # A campaign gives a design point one difficulty; then counts by scene are enough, and run by run is the
    # slow way.
    one_difficulty_per_point = np.array_equal(
        scenes.low[has_trials_in_scene], scenes.high[has_trials_in_scene]
    )
    counted = _tally(scenes, groups) if one_difficulty_per_point else _tally_rows(scores, groups)
    first_replicates = (
        _tally_rows(_first_replicates(scores), groups) if scenes.sums["until_settled"].any() else None
    )
    columns: dict[str, pl.Series] = {}
    for name, share in COMPETENCE_SHARES.items():
        result = competence(counted, share)
        has_trials = pl.Series(result.trials > 0)
        low = (
            result.low
            if first_replicates is None
            else np.minimum(result.value, competence(first_replicates, share).low)
        )
        columns_of_share = (("", result.value), ("_low", low), ("_at_least", result.at_least))
        columns |= {
            f"competence_{name}{part}": _masked(pl.Series(values), has_trials)
            for part, values in columns_of_share
        }
    return columns | {"failures_rise": pl.Series(failures_rise(counted))}


def _tally(scenes: _SceneSums, groups: int) -> TrialCounts:
    scene, node = np.nonzero(scenes.sums["trials"])
    group = scenes.agent[scene] * len(scenes.nodes) + node
    trials, passes = scenes.sums["trials"][scene, node], scenes.sums["passes"][scene, node]
    return count_design_points(group, scenes.low[scene, node], trials, passes, groups)


def _first_replicates(scores: pl.DataFrame) -> pl.DataFrame:
    """The scores with only the first replicate considered where design points stop early.

    Only that replicate is there whatever the results were.
    """
    first = pl.col("replicate") == pl.col("replicate").min().over("agent", "design_point")
    return scores.with_columns(
        considered=pl.when(first | ~pl.col("until_settled")).then("considered").otherwise(0)
    )


def _tally_rows(scores: pl.DataFrame, groups: int) -> TrialCounts:
    """Trials counted run by run, for a table from elsewhere whose difficulty varies within a design point."""
    agent, node, point = (_TextCodes.of(scores[name]) for name in ("agent", "node", "design_point"))
    considered = _column(scores, "considered")[0]
    is_trial = (considered > 0) & ~scores["outcome"].is_in(EXCLUDED_OUTCOMES).to_numpy()
    group = agent.numbers * np.int64(len(node.names)) + node.numbers
    passed = _column(scores, "achieved")[0] == considered
    return count_trials(
        Trials(
            group[is_trial],
            _column(scores, "difficulty")[0][is_trial],
            passed[is_trial],
            point.numbers[is_trial],
        ),
        groups,
    )


def _masked(values: pl.Series, is_known: pl.Series) -> pl.Series:
    return (
        pl.DataFrame({"value": values, "known": is_known}).select(pl.when("known").then("value")).to_series()
    )
