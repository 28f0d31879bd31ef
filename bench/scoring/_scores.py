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
from ._difficulty import Difficulty

# Ruling 8: tau - near_miss is a rounded number. Nothing else has a slack, least of all x >= tau (ruling 7).
NEAR_MISS_SLACK = 1e-12


@dataclass(frozen=True, slots=True)
class NodeScore:
    """One node in one run. `score` is None where the node is not scored, `confidence` is None where it is not
    considered.

    `achieved` and `considered` count the node's distinct descendant observables (0 or 1 for an observable
    itself).
    """

    node: str
    score: float | None
    confidence: float | None
    achieved: int
    considered: int


@dataclass(frozen=True, slots=True)
class RunScores:
    """Every node in one run, in the order of the decomposition."""

    nodes: Mapping[str, NodeScore]

    def __getitem__(self, node: str) -> NodeScore:
        return self.nodes[node]


@dataclass(frozen=True, slots=True)
class MeasuredRuns:
    """Runs as arrays (leaves, runs): difficulty, measured x (0 where not considered), and whether
    considered.
    """

    difficulty: Floats
    x: Floats
    considered: Bools


@dataclass(frozen=True, slots=True)
class ScoreArrays:
    """Every node in every run, as arrays (nodes, runs).

    `score` is 0 where `scored` is false, `confidence` is 0 where `considered` is 0. `passed_score` is the
    score that the node would have if every failed observable had passed with x at its threshold; it is valid
    wherever the node is considered. `difficulty` is the minimum over all leaves of the node.
    """

    difficulty: Floats
    score: Floats
    scored: Bools
    confidence: Floats
    achieved: Counts
    considered: Counts
    passed_score: Floats


def score_run(
    decomposition: Decomposition,
    difficulties: Difficulty | Mapping[str, float],
    observations: Iterable[Observation],
) -> RunScores:
    """Score one run.

    `difficulties` are those of the observables. An observable without an observation is not considered.
    Raises ValueError for an observation of an unknown observable, a second one of the same, or a considered
    one without a value.
    """
    arrays = arrays_of(decomposition)
    x, considered = measured_column(arrays, observations)
    difficulty = difficulty_column(arrays, difficulties)
    scores = score_runs(arrays, MeasuredRuns(difficulty[:, None], x[:, None], considered[:, None]))
    return RunScores({node: _node_score(node, index, scores) for index, node in enumerate(arrays.nodes)})


def score_runs(arrays: DecompositionArrays, runs: MeasuredRuns) -> ScoreArrays:
    """Score any number of runs at once."""
    tau, partial = arrays.threshold[:, None], arrays.partial_credit[:, None]
    achieved = runs.considered & (runs.x >= tau)
    near_miss = (
        runs.considered
        & ~achieved
        & (arrays.near_miss[:, None] > 0.0)
        & (runs.x >= tau - arrays.near_miss[:, None] - NEAR_MISS_SLACK)
    )
    credit = np.where(partial, arrays.policies.credit_points * (runs.x - tau), 0.0)
    passed_credit = np.where(achieved, credit, 0.0)
    # Without near_miss (its default 0) `near_miss` is false everywhere, and a failed observable has no score:
    # ruling 8.
    score, scored = _inner_scores(arrays, runs.difficulty + credit, achieved | near_miss)
    # Ruling 16: a failed observable that had passed at its threshold would score its difficulty, without
    # credit.
    passed_score, _ = _inner_scores(arrays, runs.difficulty + passed_credit, runs.considered)
    achieved_counts, considered_counts = _leaf_counts(arrays, achieved), _leaf_counts(arrays, runs.considered)
    return ScoreArrays(
        difficulty=_node_difficulty(arrays, runs.difficulty),
        score=score,
        scored=scored,
        confidence=_confidence(arrays, achieved_counts, considered_counts, scored),
        achieved=achieved_counts,
        considered=considered_counts,
        passed_score=passed_score,
    )


def difficulty_column(arrays: DecompositionArrays, difficulties: Difficulty | Mapping[str, float]) -> Floats:
    """Difficulty of every leaf. Raises ValueError naming those that have none."""
    values = (
        difficulties
        if isinstance(difficulties, Mapping)
        else {observable: difficulties.of(observable) for observable in difficulties.observables}
    )
    if missing := [leaf for leaf in arrays.leaves if leaf not in values]:
        raise ValueError(f"there is no difficulty of {', '.join(missing)}")
    return np.array([values[leaf] for leaf in arrays.leaves], dtype=np.float64)


def measured_column(arrays: DecompositionArrays, observations: Iterable[Observation]) -> tuple[Floats, Bools]:
    """Measured x of every leaf in one run, and whether it is considered. Raises as `score_run`."""
    x, considered = np.zeros(len(arrays.leaves)), np.zeros(len(arrays.leaves), dtype=np.bool_)
    given = tuple(observations)
    values = {
        observation.observable: observation.x if observation.considered else None for observation in given
    }
    places = [arrays.number.get(name) for name in values]
    # The slow search for the fault runs only where there is one: this function runs once for every run.
    if len(values) < len(given) or None in places:
        raise ValueError(_first_fault(arrays, given))
    numbers = np.array(places, dtype=np.int64)
    considered[numbers] = [observation.considered for observation in given]
    x[numbers] = [0.0 if value is None else value for value in values.values()]
    if np.count_nonzero(considered) > len(values) - list(values.values()).count(None):
        raise ValueError(_first_fault(arrays, given))
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
    arrays: DecompositionArrays, leaf_score: Floats, leaf_scored: Bools
) -> tuple[Floats, Bools]:
    """Scores of all nodes from those of the leaves: the minimum (or mean) over the children that have a score
    (ruling 9).
    """
    # `inner` has children before parents, so every child is final when its parent reads it.
    shape = (len(arrays.nodes), leaf_score.shape[1])
    score, scored = np.zeros(shape), np.zeros(shape, dtype=np.bool_)
    score[arrays.leaf_rows] = np.where(leaf_scored, leaf_score, 0.0)
    scored[arrays.leaf_rows] = leaf_scored
    for row, children in arrays.inner:
        child_scored = scored[children]
        count = child_scored.sum(axis=0)
        scored[row] = count > 0
        if arrays.policies.inner_score == "minimum":
            children_score = np.where(child_scored, score[children], np.inf).min(axis=0)
        else:
            children_score = score[children].sum(axis=0) / np.maximum(count, 1)
        score[row] = np.where(scored[row], children_score, 0.0)
    return score, scored


def _node_difficulty(arrays: DecompositionArrays, leaf_difficulty: Floats) -> Floats:
    """Minimum over all distinct descendant leaves, considered or not (ruling 14)."""
    lowest = np.zeros((len(arrays.nodes), leaf_difficulty.shape[1]))
    lowest[arrays.leaf_rows] = leaf_difficulty
    # The minimum over children equals that over distinct leaves, whatever leaves the children share.
    for row, children in arrays.inner:
        lowest[row] = lowest[children].min(axis=0)
    return lowest


def _leaf_counts(arrays: DecompositionArrays, leaves: Bools) -> Counts:
    """Number of each node's distinct leaves that are true in each run (ruling 10)."""
    # Products of floats use BLAS, products of integers do not; counts below 2**53 are exact in float64.
    counted: Counts = (arrays.under.astype(np.float64) @ leaves.astype(np.float64)).astype(np.int64)
    return counted


def _confidence(arrays: DecompositionArrays, achieved: Counts, considered: Counts, scored: Bools) -> Floats:
    """Achieved over considered leaves; under the policy `children`, scored over considered children for inner
    nodes.
    """
    if arrays.policies.confidence == "children":
        leaves_considered, achieved, considered = considered, achieved.copy(), considered.copy()
        for row, children in arrays.inner:
            achieved[row] = scored[children].sum(axis=0)
            considered[row] = (leaves_considered[children] > 0).sum(axis=0)
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
