"""ARL scores and confidences of runs, as published (docs/rulings.md 6 to 12).

Inside, "not scored" is a mask beside the numbers; at the face it is None. It is never NaN and never zero.
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

NEAR_MISS_SLACK = 1e-12  # slack at the edge of a near miss alone, where tau - near_miss is a rounded number


@dataclass(frozen=True, slots=True)
class NodeScore:
    """One node in one run. `score` is None where it is not scored, `confidence` None where it is not considered.

    `achieved` and `considered` count the node's distinct descendant observables (0 or 1 for an observable itself).
    """

    node: str
    score: float | None
    confidence: float | None
    achieved: int
    considered: int


@dataclass(frozen=True, slots=True)
class RunScores:
    """Every node in one run, in the decomposition's order."""

    nodes: Mapping[str, NodeScore]

    def __getitem__(self, node: str) -> NodeScore:
        return self.nodes[node]


@dataclass(frozen=True, slots=True)
class MeasuredRuns:
    """Runs as arrays (leaves, runs): difficulty; measured x, 0 where not considered; and where considered."""

    difficulty: Floats
    x: Floats
    considered: Bools


@dataclass(frozen=True, slots=True)
class ScoreArrays:
    """Every node in every run, as arrays (nodes, runs).

    `score` is 0 where `scored` is false, `confidence` 0 where `considered` is 0. `passed_score` is what the score would
    have been had every failed observable passed with x at its threshold; it stands wherever the node is considered.
    `difficulty` is the node's, over all its leaves.
    """

    difficulty: Floats
    score: Floats
    scored: Bools
    confidence: Floats
    achieved: Counts
    considered: Counts
    passed_score: Floats


def score_run(
    decomposition: Decomposition, difficulties: Difficulty | Mapping[str, float], observations: Iterable[Observation]
) -> RunScores:
    """Score one run.

    `difficulties` are those of the observables. An observable without an observation is not considered. Raises ValueError
    for an observation of an unknown observable, a second one of the same, or a considered one without a value.
    """
    plan = arrays_of(decomposition)
    x, considered = measured_column(plan, observations)
    rated = difficulty_column(plan, difficulties)
    scores = score_runs(plan, MeasuredRuns(rated[:, None], x[:, None], considered[:, None]))
    return RunScores({node: _node_score(node, index, scores) for index, node in enumerate(plan.nodes)})


def score_runs(plan: DecompositionArrays, runs: MeasuredRuns) -> ScoreArrays:
    """Score any number of runs at once."""
    tau, partial = plan.threshold[:, None], plan.partial_credit[:, None]
    achieved = runs.considered & (runs.x >= tau)
    near = (
        runs.considered
        & ~achieved
        & (plan.near_miss[:, None] > 0.0)
        & (runs.x >= tau - plan.near_miss[:, None] - NEAR_MISS_SLACK)
    )
    credit = np.where(partial, plan.policies.credit_points * (runs.x - tau), 0.0)
    passed_credit = np.where(achieved, credit, 0.0)
    score, scored = _inner_scores(plan, runs.difficulty + credit, achieved | near)
    passed_score, _ = _inner_scores(plan, runs.difficulty + passed_credit, runs.considered)
    passed, asked = _leaf_counts(plan, achieved), _leaf_counts(plan, runs.considered)
    return ScoreArrays(
        difficulty=_node_difficulty(plan, runs.difficulty),
        score=score,
        scored=scored,
        confidence=_confidence(plan, passed, asked, scored),
        achieved=passed,
        considered=asked,
        passed_score=passed_score,
    )


def difficulty_column(plan: DecompositionArrays, difficulties: Difficulty | Mapping[str, float]) -> Floats:
    """Difficulty of every leaf. Raises ValueError naming those that have none."""
    values = (
        difficulties if isinstance(difficulties, Mapping) else {one: difficulties.of(one) for one in difficulties.observables}
    )
    if missing := [leaf for leaf in plan.leaves if leaf not in values]:
        raise ValueError(f"there is no difficulty of {', '.join(missing)}")
    return np.array([values[leaf] for leaf in plan.leaves], dtype=np.float64)


def measured_column(plan: DecompositionArrays, observations: Iterable[Observation]) -> tuple[Floats, Bools]:
    """Measured value and consideration of every leaf in one run. Raises ValueError as `score_run` says."""
    x, considered = np.zeros(len(plan.leaves)), np.zeros(len(plan.leaves), dtype=np.bool_)
    own = tuple(observations)
    found = {one.observable: one.x if one.considered else None for one in own}
    places = [plan.number.get(name) for name in found]
    if len(found) < len(own) or None in places:
        raise ValueError(_first_fault(plan, own))
    at = np.array(places, dtype=np.int64)
    considered[at] = [one.considered for one in own]
    x[at] = [0.0 if value is None else value for value in found.values()]
    if np.count_nonzero(considered) > len(found) - list(found.values()).count(None):
        raise ValueError(_first_fault(plan, own))
    return x, considered


def _first_fault(plan: DecompositionArrays, observations: Iterable[Observation]) -> str:
    seen = set()
    for one in observations:
        if one.observable not in plan.number:
            return f"there is an observation of {one.observable!r}, which is no observable of this decomposition"
        if one.observable in seen:
            return f"there are two observations of {one.observable} in one run"
        if one.considered and one.x is None:
            return f"the observation of {one.observable} is considered and has no value"
        seen.add(one.observable)
    raise AssertionError("these observations have no fault")


def _inner_scores(plan: DecompositionArrays, leaf_score: Floats, leaf_scored: Bools) -> tuple[Floats, Bools]:
    """Carry scores from the leaves up: the minimum (or mean) over the children that have one."""
    shape = (len(plan.nodes), leaf_score.shape[1])
    score, scored = np.zeros(shape), np.zeros(shape, dtype=np.bool_)
    score[plan.leaf_rows] = np.where(leaf_scored, leaf_score, 0.0)
    scored[plan.leaf_rows] = leaf_scored
    for row, children in plan.inner:
        has = scored[children]
        count = has.sum(axis=0)
        scored[row] = count > 0
        if plan.policies.inner_score == "minimum":
            found = np.where(has, score[children], np.inf).min(axis=0)
        else:
            found = score[children].sum(axis=0) / np.maximum(count, 1)
        score[row] = np.where(scored[row], found, 0.0)
    return score, scored


def _node_difficulty(plan: DecompositionArrays, leaf_difficulty: Floats) -> Floats:
    """Minimum over all distinct descendant leaves, considered or not; carried up, for a minimum of minima is one."""
    lowest = np.zeros((len(plan.nodes), leaf_difficulty.shape[1]))
    lowest[plan.leaf_rows] = leaf_difficulty
    for row, children in plan.inner:
        lowest[row] = lowest[children].min(axis=0)
    return lowest


def _leaf_counts(plan: DecompositionArrays, leaves: Bools) -> Counts:
    """How many of its distinct leaves each node has in each run; exact, for float64 counts far beyond any decomposition."""
    counted: Counts = (plan.under.astype(np.float64) @ leaves.astype(np.float64)).astype(np.int64)
    return counted


def _confidence(plan: DecompositionArrays, passed: Counts, asked: Counts, scored: Bools) -> Floats:
    """Achieved over considered leaves; by the policy `children`, scored over considered children of inner nodes."""
    if plan.policies.confidence == "children":
        leaves_asked, passed, asked = asked, passed.copy(), asked.copy()
        for row, children in plan.inner:
            passed[row] = scored[children].sum(axis=0)
            asked[row] = (leaves_asked[children] > 0).sum(axis=0)
    return np.where(asked > 0, passed / np.maximum(asked, 1), 0.0)


def _node_score(node: str, index: int, scores: ScoreArrays) -> NodeScore:
    considered = int(scores.considered[index, 0])
    return NodeScore(
        node=node,
        score=float(scores.score[index, 0]) if scores.scored[index, 0] else None,
        confidence=float(scores.confidence[index, 0]) if considered else None,
        achieved=int(scores.achieved[index, 0]),
        considered=considered,
    )
