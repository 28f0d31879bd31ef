"""Nodes over many runs: the published means, their counts and their intervals (docs/rulings.md 13, 16, 18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import polars as pl
import polars.selectors as cs

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

from ._scene_sums import SceneSums, TextCodes, column_values, scene_sums
from ._table import EXCLUDED_OUTCOMES

SUMMARY_COLUMNS: dict[str, type[pl.DataType]] = {
    **dict.fromkeys(("agent", "configuration", "node", "level", "title"), pl.String),
    **dict.fromkeys(("difficulty", "difficulty_low", "difficulty_high"), pl.Float64),
    **dict.fromkeys(("runs", "excluded", "design_points", "considered", "passed"), pl.Int64),
    **dict.fromkeys(("passed_low", "passed_high"), pl.Float64),
    **dict.fromkeys(("verdict_passed", "verdict_considered"), pl.Int64),
    **dict.fromkeys(("verdict_low", "verdict_high"), pl.Float64),
    "scored": pl.Int64,
    **dict.fromkeys(("score_mean", "score_low", "score_high", "passed_score_mean"), pl.Float64),
    "raised_by_failure": pl.Boolean,
    **dict.fromkeys(("confidence_mean", "confidence_low", "confidence_high"), pl.Float64),
    "method": pl.String,
    **{
        f"competence_{name}{part}": dtype
        for name in COMPETENCE_SHARES
        for part, dtype in (("", pl.Float64), ("_low", pl.Float64), ("_at_least", pl.Boolean))
    },
    "failures_rise": pl.Boolean,
}
"""Columns of the summary: one row for each agent, configuration (and `all` of them together) and node.

`runs` are distinct realizations whose outcome is the agent's responsibility, `excluded` those that the bench
spoilt. `considered` and `scored` count runs, `design_points` counts the distinct design points of the
considered runs. `passed` counts the considered runs in which every considered observable was achieved;
`passed_low` and `passed_high` are the interval of the share of considered runs that pass, by the same rule as
the interval of an observable's confidence. `verdict_passed` of `verdict_considered` runs passed a principle, which is asked of its
essential key attributes alone (ruling 27), with the same interval in `verdict_low` and `verdict_high`; null for other nodes.
`difficulty` is null where it differs among the runs. `raised_by_failure` flags a mean score
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
    scenes = scene_sums(scores)
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


def _mean(total: Floats, count: Counts) -> Floats:
    """Mean, NaN where the count is 0; NaN becomes null before it leaves this module."""
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _summary_rows(scenes: SceneSums, policies: Policies, titles: Mapping[str, str]) -> pl.DataFrame:
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
    stopped_early = (considered > 0) & (scenes.total("until_settled") > 0)
    single_point = leaf & (points == 1)
    confidence_low, confidence_high = _interval(confidence, considered, points, squared, independent, counted)
    if stopped_early.any():
        anytime_low, anytime_high = _anytime_interval(confidence, considered, single_point)
        confidence_low = np.where(stopped_early, anytime_low, confidence_low)
        confidence_high = np.where(stopped_early, anytime_high, confidence_high)
    passes, passed_low, passed_high = _passes(scenes, "passes", "considered", stopped_early)
    verdicts, verdict_low, verdict_high = _passes(scenes, "verdicts_passed", "verdicts", stopped_early)
    # Indices into _METHODS.
    method = np.where(considered == 0, 0, np.where(independent, 1, np.where(counted, 2, 5)))
    method = np.where(stopped_early, np.where(single_point, 3, 4), method)
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
        "verdict_passed": verdicts,
        "verdict_considered": scenes.total("verdicts"),
        "verdict_low": verdict_low,
        "verdict_high": verdict_high,
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
    frame = frame.with_columns(pl.col(pl.Float64).fill_nan(None))
    is_principle = pl.col("level") == str(Level.PRINCIPLE)
    return frame.with_columns(pl.when(is_principle).then(cs.starts_with("verdict_")))


def _gather(texts: Sequence[str], index: Counts) -> pl.Series:
    return pl.Series(texts, dtype=pl.String).gather(index)


def _confidence(scenes: SceneSums, policies: Policies) -> Floats:
    if policies.over_runs == "mean_of_ratios":
        return _mean(scenes.total("confidence"), scenes.total("considered"))
    considered_leaves = scenes.total("asked")
    return np.where(
        considered_leaves > 0, scenes.total("achieved") / np.maximum(considered_leaves, 1.0), np.nan
    )


def _only_passes_and_failures(scenes: SceneSums) -> Bools:
    """Whether every ratio of the block is 0 or 1: only then is its sum of squares its sum."""
    return np.asarray(scenes.total("confidence") - scenes.total("confidence_squared") < 1e-9)


def _passes(
    scenes: SceneSums, passed: str, tried: str, stopped_early: Bools
) -> tuple[Counts, Floats, Floats]:
    """How many runs passed of those tried, and the interval of the share that pass."""
    passes, runs = scenes.total(passed), scenes.total(tried)
    points = np.add.reduceat((scenes.sums[tried] > 0).astype(np.int64), scenes.starts)
    share, squared = _mean(passes, runs), _spread(scenes, points, passed, passed, tried)
    low, high = _interval(share, runs, points, squared, points == runs, np.ones(runs.shape, dtype=np.bool_))
    if stopped_early.any():
        anytime_low, anytime_high = _anytime_interval(share, runs, points == 1)
        low, high = np.where(stopped_early, anytime_low, low), np.where(stopped_early, anytime_high, high)
    return passes, low, high


def _spread(scenes: SceneSums, points: Counts, name: str, squares: str, tried: str = "considered") -> Floats:
    """Sum over design points of the squared sum of the deviations of their values from the mean of the block;
    over runs where there is a single design point, whose replicates have independent seeds. `name` and
    `squares` are the sums of the values and of their squares over the runs counted by `tried`.
    """
    runs = scenes.total(tried)
    mean = np.nan_to_num(_mean(scenes.total(name), runs))
    block = np.cumsum(np.isin(np.arange(scenes.agent.size), scenes.starts)) - 1
    deviation = scenes.sums[name] - scenes.sums[tried] * mean[block]
    over_runs = np.maximum(scenes.total(squares) - runs * mean**2, 0.0)
    return np.where(points == 1, over_runs, np.add.reduceat(deviation**2, scenes.starts))


def _score_ends(scenes: SceneSums) -> tuple[Floats, Floats]:
    """What the mean score of each block would vary if the same design points were flown again."""
    bounds = np.full((2, scenes.starts.size, len(scenes.nodes)), np.nan)
    for block, (first, last) in enumerate(pairwise([*scenes.starts.tolist(), scenes.agent.size])):
        total, squared, scored, runs = (
            scenes.sums[name][first:last] for name in ("score", "score_squared", "scored", "considered")
        )
        bounds[:, block] = replicate_interval(total, squared, scored, runs)
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
    """Of the pass rate where `alone` (an observable with a single design point), else of the mean of the expectations."""
    runs = considered.astype(np.float64)
    total = np.nan_to_num(mean) * runs
    rate, expected = pass_rate_bounds(np.round(total), runs), mean_bounds(total, runs)
    return np.where(alone, rate[0], expected[0]), np.where(alone, rate[1], expected[1])


def _competence(scenes: SceneSums, scores: pl.DataFrame) -> dict[str, pl.Series]:
    """The columns of competence of every agent and node over all configurations, null without a trial (ruling 17)."""
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


def _tally(scenes: SceneSums, groups: int) -> TrialCounts:
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
    agent, node, point = (TextCodes.of(scores[name]) for name in ("agent", "node", "design_point"))
    considered = column_values(scores, "considered")[0]
    is_trial = (considered > 0) & ~scores["outcome"].is_in(EXCLUDED_OUTCOMES).to_numpy()
    group = agent.numbers * np.int64(len(node.names)) + node.numbers
    passed = column_values(scores, "achieved")[0] == considered
    return count_trials(
        Trials(
            group[is_trial],
            column_values(scores, "difficulty")[0][is_trial],
            passed[is_trial],
            point.numbers[is_trial],
        ),
        groups,
    )


def _masked(values: pl.Series, is_known: pl.Series) -> pl.Series:
    return (
        pl.DataFrame({"value": values, "known": is_known}).select(pl.when("known").then("value")).to_series()
    )
