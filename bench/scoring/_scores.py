"""ARL scores and confidences of runs, as published (docs/rulings.md 6 to 12).

Inside, "not scored" is a mask beside the numbers; in results it is None. It is never NaN and never zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.contracts import Observation
from decompositions import Decomposition

from ._arrays import DecompositionArrays, arrays_of
from ._difficulty import Difficulty, Standing

# Ruling 8: tau - near_miss is a rounded number. Nothing else has a slack, least of all x >= tau (ruling 7).
NEAR_MISS_SLACK = 1e-12


@dataclass(frozen=True, slots=True)
class NodeScore:
    """One node in one run. `score` is None where the node is not scored, `confidence` is None where it is not considered.

    `achieved` and `considered` count the node's distinct descendant observables (0 or 1 for an observable
    itself).
    """

    node: str
    score: float | None
    confidence: float | None
    achieved: int
    considered: int


@dataclass(frozen=True, slots=True)
class MeasuredRuns:
    """Runs as arrays (leaves, runs): difficulty (infinite where there is none, so that it is never the
    minimum), measured x (0 where not considered), whether the measure considered the leaf, whether the
    configuration can exercise it, and whether it counts for the nodes above it.

    A leaf is considered where both the measure and the configuration say so (ruling 14).
    """

    difficulty: Floats
    x: Floats
    measured: Bools
    exercisable: Bools
    counted: Bools

    @property
    def considered(self) -> Bools:
        return self.measured & self.exercisable


@dataclass(frozen=True, slots=True)
class ScoreArrays:
    """Every node in every run, as arrays (nodes, runs).

    `score` is 0 where `scored` is false, `confidence` is 0 where `considered` is 0. `passed_score` is the
    score that the node would have if every failed observable had passed with x at its threshold; it is valid
    wherever the node is considered. `difficulty` is the minimum over all leaves of the node, infinite where none
    has one. `verdict` (principles, runs) is 1 where the run passed the principle, 0 where it did not, and -1 where it has no
    verdict (ruling 27).
    """

    difficulty: Floats
    score: Floats
    scored: Bools
    confidence: Floats
    achieved: Counts
    considered: Counts
    passed_score: Floats
    verdict: Counts


def score_run(
    decomposition: Decomposition,
    difficulties: Difficulty | Mapping[str, float],
    observations: Iterable[Observation],
) -> dict[str, NodeScore]:
    """Score one run: every node, in the order of the decomposition.

    `difficulties` are those of the observables; as a plain mapping, all of them count. An observable without
    an observation is not considered. Raises ValueError for an observation of an unknown observable, a second one of the same, or a considered
    one without a value.
    """
    arrays = arrays_of(decomposition)
    x, measured = measured_column(arrays, observations)
    difficulty, exercisable, counted = difficulty_columns(arrays, difficulties)
    run = MeasuredRuns(
        difficulty[:, None], x[:, None], measured[:, None], exercisable[:, None], counted[:, None]
    )
    scores = score_runs(arrays, run)
    return {node: _node_score(node, index, scores) for index, node in enumerate(arrays.nodes)}


def score_runs(arrays: DecompositionArrays, runs: MeasuredRuns) -> ScoreArrays:
    """Score any number of runs at once."""
    tau, partial = arrays.threshold[:, None], arrays.partial_credit[:, None]
    considered = runs.considered
    achieved = considered & (runs.x >= tau)
    near_miss = (
        considered
        & ~achieved
        & (arrays.near_miss[:, None] > 0.0)
        & (runs.x >= tau - arrays.near_miss[:, None] - NEAR_MISS_SLACK)
    )
    credit = np.where(partial, arrays.policies.credit_points * (runs.x - tau), 0.0)
    passed_credit = np.where(achieved, credit, 0.0)
    # Without near_miss (its default 0) `near_miss` is false everywhere, and a failed observable has no score:
    # ruling 8.
    score, scored = _inner_scores(arrays, runs.difficulty + credit, achieved | near_miss, runs.counted)
    # Ruling 16: a failed observable that had passed at its threshold would score its difficulty, without
    # credit.
    passed_score, _ = _inner_scores(arrays, runs.difficulty + passed_credit, considered, runs.counted)
    achieved_counts = _leaf_counts(arrays, achieved, runs.counted)
    considered_counts = _leaf_counts(arrays, considered, runs.counted)
    return ScoreArrays(
        difficulty=_node_difficulty(arrays, runs.difficulty, runs.counted),
        score=score,
        scored=scored,
        confidence=_confidence(arrays, achieved_counts, considered_counts, scored, runs.counted),
        achieved=achieved_counts,
        considered=considered_counts,
        passed_score=passed_score,
        verdict=_verdict(arrays, considered & runs.counted, achieved),
    )


def difficulty_columns(
    arrays: DecompositionArrays, difficulties: Difficulty | Mapping[str, float]
) -> tuple[Floats, Bools, Bools]:
    """Difficulty of every leaf (infinite: none), whether it is exercisable, and whether it counts above it.

    Raises ValueError naming the leaves that a mapping lacks.
    """
    if isinstance(difficulties, Difficulty):
        rated = [difficulties.observables[leaf] for leaf in arrays.leaves]
        return (
            np.array(
                [np.inf if row.difficulty is None else row.difficulty for row in rated], dtype=np.float64
            ),
            np.array([row.standing is not Standing.NOT_EXERCISABLE for row in rated], dtype=np.bool_),
            np.array([row.standing is Standing.COUNTED for row in rated], dtype=np.bool_),
        )
    if missing := [leaf for leaf in arrays.leaves if leaf not in difficulties]:
        raise ValueError(f"there is no difficulty of {', '.join(missing)}")
    all_true = np.ones(len(arrays.leaves), dtype=np.bool_)
    return np.array([difficulties[leaf] for leaf in arrays.leaves], dtype=np.float64), all_true, all_true


def measured_column(arrays: DecompositionArrays, observations: Iterable[Observation]) -> tuple[Floats, Bools]:
    """Measured x of every leaf in one run, and whether it is considered. Raises as `score_run`."""
    x, considered = np.zeros(len(arrays.leaves)), np.zeros(len(arrays.leaves), dtype=np.bool_)
    measured = tuple(observations)
    values = {
        observation.observable: observation.x if observation.considered else None for observation in measured
    }
    places = [arrays.number.get(name) for name in values]
    # The slow search for the fault runs only where there is one: this function runs once for every run.
    if len(values) < len(measured) or None in places:
        raise ValueError(_first_fault(arrays, measured))
    numbers = np.array(places, dtype=np.int64)
    considered[numbers] = [observation.considered for observation in measured]
    x[numbers] = [0.0 if value is None else value for value in values.values()]
    if np.count_nonzero(considered) > len(values) - list(values.values()).count(None):
        raise ValueError(_first_fault(arrays, measured))
    return x, considered


def _first_fault(arrays: DecompositionArrays, observations: Iterable[Observation]) -> str:
    observables: set[str] = set()
    for observation in observations:
        if observation.observable not in arrays.number:
            return f"there is an observation of {observation.observable!r}, which is not an observable of this decomposition"
        if observation.observable in observables:
            return f"there are two observations of {observation.observable} in one run"
        if observation.considered and observation.x is None:
            return f"the observation of {observation.observable} is considered but has no value"
        observables.add(observation.observable)
    raise AssertionError("these observations have no fault")


def _inner_scores(
    arrays: DecompositionArrays, leaf_score: Floats, leaf_scored: Bools, counted: Bools
) -> tuple[Floats, Bools]:
    """Scores of all nodes: the minimum (or mean) over children that have one (ruling 9) and count (ruling 25)."""
    # `inner` has children before parents, so every child is final when its parent reads it.
    shape = (len(arrays.nodes), leaf_score.shape[1])
    score, scored = np.zeros(shape), np.zeros(shape, dtype=np.bool_)
    score[arrays.leaf_rows] = np.where(leaf_scored, leaf_score, 0.0)
    # Leaves that do not count are left out while the nodes above them are scored.
    scored[arrays.leaf_rows] = leaf_scored & counted
    for row, children in arrays.inner:
        child_scored = scored[children]
        count = child_scored.sum(axis=0)
        scored[row] = count > 0
        if arrays.policies.inner_score == "minimum":
            children_score = np.where(child_scored, score[children], np.inf).min(axis=0)
        else:
            # Child by child: numpy adds the only column of a single run in another order than columns of many, and
            # a run has one score whatever it is scored with.
            total = sum(np.where(child_scored, score[children], 0.0))
            children_score = total / np.maximum(count, 1)
        score[row] = np.where(scored[row], children_score, 0.0)
    scored[arrays.leaf_rows] = leaf_scored
    return score, scored


def _node_difficulty(arrays: DecompositionArrays, leaf_difficulty: Floats, counted: Bools) -> Floats:
    """Minimum over all distinct descendant leaves that count, considered or not (ruling 14)."""
    lowest = np.zeros((len(arrays.nodes), leaf_difficulty.shape[1]))
    lowest[arrays.leaf_rows] = np.where(counted, leaf_difficulty, np.inf)
    # The minimum over children equals that over distinct leaves, whatever leaves the children share.
    for row, children in arrays.inner:
        lowest[row] = lowest[children].min(axis=0)
    lowest[arrays.leaf_rows] = leaf_difficulty
    return lowest


def _leaf_counts(arrays: DecompositionArrays, leaves: Bools, counted: Bools) -> Counts:
    """Number of each node's distinct leaves that are true in a run and count (ruling 10); a leaf counts for itself."""
    # Products of floats use BLAS, products of integers do not; counts below 2**53 are exact in float64.
    sums: Counts = (arrays.under.astype(np.float64) @ (leaves & counted).astype(np.float64)).astype(np.int64)
    sums[arrays.leaf_rows] = leaves
    return sums


def _verdict(arrays: DecompositionArrays, considered: Bools, achieved: Bools) -> Counts:
    essential = arrays.essential.astype(np.float64)
    has_verdict = essential @ considered.astype(np.float64) > 0
    failed = essential @ (considered & ~achieved).astype(np.float64) > 0
    return np.where(has_verdict, np.where(failed, 0, 1), -1)


def _confidence(
    arrays: DecompositionArrays, achieved: Counts, considered: Counts, scored: Bools, counted: Bools
) -> Floats:
    """Achieved over considered leaves; under the policy `children`, scored over considered children for inner nodes."""
    if arrays.policies.confidence == "children":
        enters = np.ones_like(scored)
        enters[arrays.leaf_rows] = counted
        child_scored, child_considered = scored & enters, (considered > 0) & enters
        achieved, considered = achieved.copy(), considered.copy()
        for row, children in arrays.inner:
            achieved[row] = child_scored[children].sum(axis=0)
            considered[row] = child_considered[children].sum(axis=0)
    return np.where(considered > 0, achieved / np.maximum(considered, 1), 0.0)


def _node_score(node: str, index: int, scores: ScoreArrays) -> NodeScore:
    considered = int(scores.considered[index, 0])
    return NodeScore(
        node=node,
        score=float(scores.score[index, 0]) if scores.scored[index, 0] else None,
        confidence=float(scores.confidence[index, 0]) if considered else None,
        achieved=int(scores.achieved[index, 0]),
        considered=considered,
    )
