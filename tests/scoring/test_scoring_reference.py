"""The scorer against a brute-force reference: random graphs, many runs at once, every policy of scoring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_decompositions import factor_row, leaf, made_decomposition, observed

from bench.contracts import Outcome
from bench.scoring import ScoredRun, difficulty_of_values, score_table, summary_frame
from decompositions import Decomposition, Policies

GRID = st.sampled_from([0.0, 0.1, 0.25, 0.3, 0.5, 0.7, 0.75, 0.8, 1.0])
FAULTS = {"worker_lost"}

Values = dict[str, float | None]


@dataclass(frozen=True)
class Flown:
    """A run as the reference takes it; what is not in `xs` was not observed, and None is not considered.

    `difficulty` lacks the observables that the situation does not exercise. `sensor` are those about simulated
    detections.
    """

    name: str
    point: str
    agent: str
    outcome: Outcome
    difficulty: dict[str, float]
    xs: Values
    sensor: frozenset[str] = frozenset()

    @property
    def exercised(self) -> Values:
        """What was measured, without what the situation cannot exercise."""
        return {leaf: x if leaf in self.difficulty else None for leaf, x in self.xs.items()}

    @property
    def counted(self) -> Values:
        return {} if str(self.outcome) in FAULTS else self.exercised

    def standing(self, node: str) -> str:
        if node not in self.difficulty:
            considered = str(self.outcome) not in FAULTS and self.xs.get(node) is not None
            return "overruled" if considered else "not exercisable"
        return "configured sensor" if node in self.sensor else "counted"

    def scored_run(self, decomposition: Decomposition) -> ScoredRun:
        return ScoredRun(
            self.name,
            self.point,
            0,
            self.agent,
            self.outcome,
            # Every observable has a factor of its own, named like it, that rates its value as it is.
            difficulty_of_values(decomposition, self.difficulty, "simulated" if self.sensor else "elsewhere"),
            observed(self.xs),
        )


class Reference:
    """The rulings 4 to 17 and 25 read aloud, node by node and run by run; it shares nothing with the implementation."""

    def __init__(self, decomposition: Decomposition) -> None:
        self.decomposition, self.rules = decomposition, decomposition.policies

    def leaves(self, node: str, run: Flown) -> set[str]:
        """An observable itself, or those under a node that are not about the configured sensor."""
        children = self.decomposition.nodes[node].children
        below = {leaf for child in children for leaf in self.leaves(child, run)}
        return below - run.sensor if children else {node}

    def difficulty(self, node: str, run: Flown) -> float | None:
        return min(
            (run.difficulty[leaf] for leaf in self.leaves(node, run) & set(run.difficulty)), default=None
        )

    def considered(self, node: str, run: Flown, xs: Values) -> list[str]:
        return [leaf for leaf in self.leaves(node, run) if xs.get(leaf) is not None]

    def achieved(self, node: str, run: Flown, xs: Values) -> list[str]:
        return [
            leaf
            for leaf in self.considered(node, run, xs)
            if (xs[leaf] or 0.0) >= self.decomposition.observables[leaf].threshold
        ]

    def score(self, node: str, run: Flown, xs: Values) -> float | None:
        children = self.decomposition.nodes[node].children
        if children:
            scores = [
                score
                for score in (self.score(child, run, xs) for child in children if child not in run.sensor)
                if score is not None
            ]
            if not scores:
                return None
            return min(scores) if self.rules.inner_score == "minimum" else fmean(scores)
        rule, x = self.decomposition.observables[node], xs.get(node)
        if x is None:
            return None
        near_miss = rule.near_miss if rule.near_miss is not None else self.rules.near_miss
        credit = self.rules.credit_points * (x - rule.threshold) if rule.partial_credit else 0.0
        close = rule.partial_credit and near_miss > 0 and x >= rule.threshold - near_miss - 1e-12
        return run.difficulty[node] + credit if x >= rule.threshold or close else None

    def confidence(self, node: str, run: Flown, xs: Values) -> float | None:
        considered = self.considered(node, run, xs)
        if not considered:
            return None
        children = self.decomposition.nodes[node].children
        if self.rules.confidence == "observables" or not children:
            return len(self.achieved(node, run, xs)) / len(considered)
        decomposition = [
            child for child in children if child not in run.sensor and self.considered(child, run, xs)
        ]
        return sum(self.score(child, run, xs) is not None for child in decomposition) / len(decomposition)

    def passed_score(self, node: str, run: Flown, xs: Values) -> float | None:
        """The score with every failed observable passed with x at its threshold."""
        best = {
            observable: None if x is None else max(x, self.decomposition.observables[observable].threshold)
            for observable, x in xs.items()
        }
        return self.score(node, run, best)

    def competence(self, node: str, runs: Sequence[Flown], share: float) -> float | None:
        trials = [
            (
                self.difficulty(node, run) or 0.0,
                self.achieved(node, run, run.counted) == self.considered(node, run, run.counted),
            )
            for run in runs
            if self.considered(node, run, run.counted)
        ]
        hard = sorted({d for d, _ in trials})

        def mean(low: float, high: float) -> float:
            return fmean(ok for d, ok in trials if low <= d <= high)

        fits = {d: min(max(mean(a, b) for b in hard if b >= d) for a in hard if a <= d) for d in hard}
        return max((d for d in hard if fits[d] >= share - 1e-9), default=0.0) if trials else None


def graph(draw: st.DrawFn) -> tuple[list[list[dict[str, Any]]], list[str]]:
    """Layers of nodes with many-to-many edges between neighbouring levels, and the names of the observables."""
    counts = [draw(st.integers(1, most)) for most in (3, 3, 5, 6)]
    names = [[f"{letter}{i}" for i in range(count)] for letter, count in zip("PKVO", counts, strict=True)]
    layers = []
    for above, below in pairwise(names):
        children = {name: draw(st.lists(st.sampled_from(below), min_size=1, unique=True)) for name in above}
        for orphan in sorted(set(below) - {child for child_ids in children.values() for child in child_ids}):
            children[draw(st.sampled_from(above))].append(orphan)
        layers.append(
            [
                {"id": name, "title": name, "asks": "?", "children": child_ids}
                for name, child_ids in children.items()
            ]
        )
    return layers, names[3]


@st.composite
def campaigns(draw: st.DrawFn) -> tuple[Decomposition, list[Flown]]:
    """A random decomposition with random policies, and a few runs of it by two agents in three situations."""
    layers, names = graph(draw)
    observables = []
    for name in names:
        partial = draw(st.booleans())
        observables.append(
            leaf(
                name,
                factor_row(name, [0, 100], [0, 100], "1", absent=-1),
                threshold=draw(GRID),
                partial_credit=partial,
                near_miss=draw(st.none() | GRID) if partial else None,
                subject=draw(st.sampled_from(["agent", "agent", "perception"])),
            )
        )
    policies = Policies(
        near_miss=draw(st.sampled_from([0.0, 0.2])),
        credit_points=draw(st.sampled_from([4.0, 0.0, 10.0])),
        inner_score=draw(st.sampled_from(["minimum", "mean"])),
        confidence=draw(st.sampled_from(["observables", "children"])),
        over_runs=draw(st.sampled_from(["mean_of_ratios", "pooled_counts"])),
    )
    decomposition = made_decomposition(
        observables, layers[2], layers[1], layers[0], policies=policies.model_dump()
    )
    hard = st.sampled_from([0.0, 20.0, 33.3, 60.0, 100.0, None])
    drawn = [{name: draw(hard) for name in names} for _ in range(3)]
    situations = [
        {name: value for name, value in situation.items() if value is not None} for situation in drawn
    ]
    simulated = draw(st.booleans())
    sensor = frozenset(str(row["id"]) for row in observables if row["subject"] == "perception" and simulated)
    outcome = st.sampled_from([Outcome.COMPLETED, Outcome.AGENT_CRASHED, Outcome.WORKER_LOST])
    runs = []
    for i in range(draw(st.integers(1, 7))):
        situation = draw(st.integers(0, 2))
        observed = draw(st.lists(st.sampled_from(names), unique=True))
        point, agent = f"p{situation}{draw(st.sampled_from('ab'))}", draw(st.sampled_from(["one", "two"]))
        runs.append(
            Flown(
                f"r{i}",
                point,
                agent,
                draw(outcome),
                situations[situation],
                {n: draw(st.none() | GRID) for n in observed},
                sensor,
            )
        )
    return decomposition, runs


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(campaigns())
def test_tables_and_summaries_are_those_of_the_reference(campaign: tuple[Decomposition, list[Flown]]) -> None:
    """Every row of the score table and of the summary, for every policy of scoring."""
    decomposition, runs = campaign
    reference = Reference(decomposition)
    table = score_table(decomposition, [run.scored_run(decomposition) for run in runs])
    rows = {(row["realization"], row["node"]): row for row in table.iter_rows(named=True)}
    for run in runs:
        for node in decomposition.nodes:
            row, xs = rows[run.name, node], run.counted
            assert row["difficulty"] == approximately(reference.difficulty(node, run))
            leaf = node in decomposition.observables
            assert row["standing"] == (run.standing(node) if leaf else None)
            assert row["score"] == approximately(reference.score(node, run, xs))
            assert row["confidence"] == reference.confidence(node, run, xs)
            assert row["achieved"] == len(reference.achieved(node, run, xs))
            assert row["considered"] == len(reference.considered(node, run, xs))
            assert row["passed_score"] == approximately(reference.passed_score(node, run, xs))
            assert row["x"] == xs.get(node)
    for row in summary_frame(table, decomposition).iter_rows(named=True):
        group = [run for run in runs if run.agent == row["agent"]]
        if row["configuration"] != "all":
            group = [
                run for run in group if rows[run.name, row["node"]]["configuration"] == row["configuration"]
            ]
        same_summary(reference, row, group)


def same_summary(reference: Reference, row: dict[str, Any], group: list[Flown]) -> None:
    """One row of the summary, from its runs."""
    node, counted = row["node"], [run for run in group if str(run.outcome) not in FAULTS]
    decomposition = [run for run in counted if reference.considered(node, run, run.exercised)]
    scores = [
        score for score in (reference.score(node, run, run.exercised) for run in counted) if score is not None
    ]
    passed = [
        score
        for score in (reference.passed_score(node, run, run.exercised) for run in decomposition)
        if score is not None
    ]
    assert (row["runs"], row["excluded"]) == (len(counted), len(group) - len(counted))
    assert (row["considered"], row["scored"]) == (len(decomposition), len(scores))
    assert row["design_points"] == len({run.point for run in decomposition})
    assert row["score_mean"] == approximately(fmean(scores) if scores else None)
    assert row["passed_score_mean"] == approximately(fmean(passed) if passed else None)
    assert row["raised_by_failure"] == bool(scores and fmean(scores) > fmean(passed) + 1e-9)
    ratios = [
        ratio
        for ratio in (reference.confidence(node, run, run.exercised) for run in decomposition)
        if ratio is not None
    ]
    if reference.rules.over_runs == "mean_of_ratios":
        mean = fmean(ratios) if ratios else None
    else:
        total = sum(len(reference.considered(node, run, run.exercised)) for run in decomposition)
        mean = (
            sum(len(reference.achieved(node, run, run.exercised)) for run in decomposition) / total
            if total
            else None
        )
    assert row["confidence_mean"] == approximately(mean)
    passes = sum(
        reference.achieved(node, run, run.exercised) == reference.considered(node, run, run.exercised)
        for run in decomposition
    )
    assert row["passed"] == passes
    assert row["passed_low"] - 1e-12 <= passes / max(len(decomposition), 1) <= row["passed_high"] + 1e-12
    whole = row["configuration"] == "all"
    for name, share in (("competence_50", 0.5), ("competence_90", 0.9)):
        assert row[name] == approximately(reference.competence(node, counted, share) if whole else None)
        if row[name] is not None:
            assert row[f"{name}_low"] <= row[name]


def approximately(value: float | None) -> Any:
    """Equal but for the order in which floats are added."""
    return None if value is None else pytest.approx(value, abs=1e-9)
