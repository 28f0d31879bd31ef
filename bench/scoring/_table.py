"""The score table: one row for each realization and node. Every mean, figure and report is made from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from bench.arrays import Bools, Floats
from bench.contracts import Observation, Outcome, ReportStatements
from decompositions import Decomposition

from ._arrays import DecompositionArrays, arrays_of
from ._configuration import configuration_of
from ._difficulty import Difficulty, Standing
from ._scores import MeasuredRuns, ScoreArrays, difficulty_columns, measured_column, score_runs

SCORE_COLUMNS: dict[str, type[pl.DataType]] = {
    "realization": pl.String,
    "design_point": pl.String,
    "replicate": pl.Int64,
    "agent": pl.String,
    "configuration": pl.String,
    "node": pl.String,
    "level": pl.String,
    "difficulty": pl.Float64,
    "score": pl.Float64,
    "confidence": pl.Float64,
    "achieved": pl.Int64,
    "considered": pl.Int64,
    "x": pl.Float64,
    "outcome": pl.String,
    "passed_score": pl.Float64,
    "until_settled": pl.Boolean,
    "standing": pl.String,
    "verdict": pl.Boolean,
}
"""Columns of the score table. Null means "not scored" in `score`, "not considered" in `confidence` and
`passed_score`, "not an observable, or not considered" in `x`, and "has none" in `difficulty`. `achieved` and `considered` count distinct
descendant observables. `passed_score` is the score that the node would have if every failed observable had
passed with x at its threshold. `until_settled` is true where the results decided how many replicates the
design point has (early stopping), so that only anytime-valid intervals hold. `standing` says what an observable counts for in the run's
configuration: `counted`, `configured sensor`, `not exercisable`, or `overruled` where it is not exercisable and
its measure considered it all the same. It is null for other nodes. `verdict` says whether the run passed a principle: whether it
achieved every considered observable under the essential key attributes (ruling 27). It is null where none was considered, and for
other nodes.
"""

OVERRULED = "overruled"
"""Standing of an observable that its measure considered in a configuration that cannot exercise it."""


EXCLUDED_OUTCOMES = tuple(str(outcome) for outcome in Outcome if not outcome.counts)
"""Outcomes of runs that the bench spoilt: such runs have rows in a score table, and nothing is considered in them."""


@dataclass(frozen=True, slots=True)
class ScoredRun:
    """One realization as input of scoring: its ids, outcome, difficulty and observations."""

    realization: str
    design_point: str
    replicate: int
    agent: str
    outcome: Outcome
    difficulty: Difficulty
    observations: tuple[Observation, ...]
    until_settled: bool = False
    statements: ReportStatements | None = None


def score_table(
    decomposition: Decomposition, runs: Sequence[ScoredRun], study: Sequence[str] = ()
) -> pl.DataFrame:
    """Score runs into a frame with the columns SCORE_COLUMNS, in the order of the runs and of the decomposition.

    A run that the bench spoilt has rows in which nothing is considered. `study` names the key attributes that
    make difficulty configurations. Raises ValueError for a realization that appears twice and as `score_run`,
    and SetupError for a `study` that names other nodes than key attributes.
    """
    arrays = arrays_of(decomposition)
    if not runs:
        return pl.DataFrame(schema=SCORE_COLUMNS)
    realizations: set[str] = set()
    for run in runs:
        require_new(run, realizations)
    measured = _measured(arrays, runs)
    scores = score_runs(arrays, measured)
    of_run = np.repeat(np.arange(len(runs)), len(arrays.nodes))
    of_node = np.tile(np.arange(len(arrays.nodes)), len(runs))
    considered = _rows(scores.considered)
    return pl.DataFrame(
        {
            "realization": _gather([run.realization for run in runs], of_run),
            "design_point": _gather([run.design_point for run in runs], of_run),
            "replicate": np.array([run.replicate for run in runs], dtype=np.int64)[of_run],
            "agent": _gather([run.agent for run in runs], of_run),
            "configuration": _gather(_configurations(decomposition, runs, study), of_run),
            "node": _gather(list(arrays.nodes), of_node),
            "level": _gather([str(decomposition.level_of(node)) for node in arrays.nodes], of_node),
            "difficulty": _where(scores.difficulty, np.isfinite(scores.difficulty)),
            "score": _where(scores.score, scores.scored),
            "confidence": _where(scores.confidence, scores.considered > 0),
            "achieved": _rows(scores.achieved),
            "considered": considered,
            "x": _x(arrays, measured, scores),
            "outcome": _gather([str(run.outcome) for run in runs], of_run),
            "passed_score": _where(scores.passed_score, scores.considered > 0),
            "until_settled": np.array([run.until_settled for run in runs], dtype=np.bool_)[of_run],
            "standing": _standing(arrays, measured),
            "verdict": _verdict(arrays, scores),
        },
        schema=SCORE_COLUMNS,
    )


def absent_pairs(decomposition: Decomposition, runs: Sequence[ScoredRun]) -> int:
    """Number of (run, observable) pairs without an observation, over the runs that count; none is considered."""
    # A run that the bench spoilt was not measured, so nothing is missing from it.
    counted = [run for run in runs if run.outcome.counts]
    return sum(
        len(set(decomposition.observables) - {observation.observable for observation in run.observations})
        for run in counted
    )


def require_new(run: ScoredRun, realizations: set[str]) -> None:
    """Add a run's realization to those that are known. Raises ValueError if it is one of them."""
    if run.realization in realizations:
        raise ValueError(f"the realization {run.realization!r} appears twice")
    realizations.add(run.realization)


def _measured(arrays: DecompositionArrays, runs: Sequence[ScoredRun]) -> MeasuredRuns:
    shape = (len(arrays.leaves), len(runs))
    measured = MeasuredRuns(
        np.empty(shape),
        np.empty(shape),
        np.empty(shape, dtype=np.bool_),
        np.empty(shape, dtype=np.bool_),
        np.empty(shape, dtype=np.bool_),
    )
    # By identity, as in `_configurations`: equality would compare every node.
    difficulties: dict[int, tuple[Floats, Bools, Bools]] = {}
    for number, run in enumerate(runs):
        if id(run.difficulty) not in difficulties:
            difficulties[id(run.difficulty)] = difficulty_columns(arrays, run.difficulty)
        columns = difficulties[id(run.difficulty)]
        measured.difficulty[:, number], measured.exercisable[:, number], measured.counted[:, number] = columns
        column = measured_column(arrays, run.observations if run.outcome.counts else ())
        measured.x[:, number], measured.measured[:, number] = column
    return measured


def _standing(arrays: DecompositionArrays, measured: MeasuredRuns) -> pl.Series:
    names = (Standing.COUNTED, Standing.CONFIGURED_SENSOR, Standing.NOT_EXERCISABLE, OVERRULED)
    of_leaf = np.select(
        [~measured.exercisable & measured.measured, ~measured.exercisable, ~measured.counted], [3, 2, 1], 0
    )
    # -1 is an inner node: no text, so null.
    codes = np.full((len(arrays.nodes), of_leaf.shape[1]), -1)
    codes[arrays.leaf_rows] = of_leaf
    index = pl.Series(_rows(codes))
    return pl.Series([str(name) for name in names]).gather(index.set(index < 0, None))


def _verdict(arrays: DecompositionArrays, scores: ScoreArrays) -> pl.Series:
    # -1 is no verdict, also for nodes that are no principles: null.
    verdicts = np.full(scores.considered.shape, -1)
    verdicts[arrays.principle_rows] = scores.verdict
    passed = pl.Series(_rows(verdicts))
    return (passed == 1).set(passed < 0, None)


def _configurations(
    decomposition: Decomposition, runs: Sequence[ScoredRun], study: Sequence[str]
) -> list[str]:
    """The key of each run's difficulty configuration."""
    # Replicates and agents mostly share their difficulty object, so each is written once; `runs` keeps the
    # ids valid.
    names: dict[int, str] = {}
    for run in runs:
        if id(run.difficulty) not in names:
            names[id(run.difficulty)] = configuration_of(decomposition, run.difficulty, study)
    return [names[id(run.difficulty)] for run in runs]


def _x(arrays: DecompositionArrays, measured: MeasuredRuns, scores: ScoreArrays) -> pl.Series:
    x, is_known = np.zeros_like(scores.score), np.zeros_like(scores.scored)
    x[arrays.leaf_rows], is_known[arrays.leaf_rows] = measured.x, measured.considered
    return _where(x, is_known)


def _rows(array: np.ndarray) -> np.ndarray:
    """An array (nodes, runs) as one column, run by run."""
    return array.T.ravel()


def _where(values: np.ndarray, is_known: np.ndarray) -> pl.Series:
    """An array (nodes, runs) as one column, null where `known` is false."""
    # No score is NaN, so NaN can stand for null on the way from numpy to polars.
    return pl.Series(np.where(is_known.T, values.T, np.nan).ravel()).fill_nan(None)


def _gather(texts: list[str], index: np.ndarray) -> pl.Series:
    return pl.Series(texts, dtype=pl.String).gather(index)
