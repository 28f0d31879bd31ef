"""Scores of runs: the paper's worked example to the digit, credit and near misses, and a brute-force reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_decompositions import (
    WORKED,
    leaf,
    made_decomposition,
    node,
    observed,
    worked_decomposition,
)

from bench.contracts import Observation
from bench.scoring import score_run
from decompositions import Decomposition, Level


def node_of(threshold: float = 0.5, **changes: Any) -> Decomposition:
    """A single observable under a single key attribute."""
    return made_decomposition(
        [leaf("O", threshold=threshold, **changes)], {"V": ["O"]}, {"KA": ["V"]}, given=True
    )


@pytest.fixture
def worked() -> Decomposition:
    """The graph of the paper's scoring example."""
    return worked_decomposition()


def test_the_worked_example_to_the_digit(worked: Decomposition) -> None:
    """Run 1: 30 (2/2), 50, 30 (3/3). Run 2, where OBS1 fails: 80 (1/2), 50, 50 (2/3)."""
    first = score_run(worked, WORKED, observed({"OBS1": 1.0, "OBS2": 1.0, "OBS3": 1.0}))
    assert [first[n].score for n in ("OBS1", "OBS2", "VAB1", "OBS3", "VAB2", "KA1")] == [
        30,
        80,
        30,
        50,
        50,
        30,
    ]
    assert [(first[n].achieved, first[n].considered) for n in ("VAB1", "VAB2", "KA1")] == [
        (2, 2),
        (1, 1),
        (3, 3),
    ]
    assert first["KA1"].confidence == 1.0

    second = score_run(worked, WORKED, observed({"OBS1": 0.0, "OBS2": 1.0, "OBS3": 1.0}))
    assert [second[n].score for n in ("OBS1", "OBS2", "VAB1", "OBS3", "VAB2", "KA1")] == [
        None,
        80,
        80,
        50,
        50,
        50,
    ]
    assert [(second[n].achieved, second[n].considered) for n in ("VAB1", "VAB2", "KA1")] == [
        (1, 2),
        (1, 1),
        (2, 3),
    ]
    assert second["OBS1"].confidence == 0.0
    assert second["VAB1"].confidence == 0.5
    assert second["KA1"].confidence == 2 / 3


def test_the_papers_text_is_a_policy() -> None:
    """Its text divides over children: then both children of KA1 scored in run 2, and its confidence is 2/2."""
    other = worked_decomposition(policies={"confidence": "children"})
    second = score_run(other, WORKED, observed({"OBS1": 0.0, "OBS2": 1.0, "OBS3": 1.0}))
    assert (second["VAB1"].confidence, second["KA1"].confidence) == (0.5, 1.0)
    unscored = score_run(other, WORKED, observed({"OBS1": 0.0, "OBS2": 0.0, "OBS3": None}))
    assert (unscored["VAB2"].confidence, unscored["KA1"].confidence) == (None, 0.0)


def test_not_considered_is_a_state_of_its_own(worked: Decomposition) -> None:
    """An observable that the run did not exercise has neither score nor confidence, and does not weigh above it."""
    scores = score_run(worked, WORKED, observed({"OBS1": None, "OBS2": 1.0}))
    assert (scores["OBS1"].score, scores["OBS1"].confidence, scores["OBS1"].considered) == (None, None, 0)
    assert (scores["VAB1"].score, scores["VAB1"].confidence) == (80.0, 1.0)
    assert (scores["VAB2"].score, scores["VAB2"].confidence) == (
        None,
        None,
    )  # without an observation: not considered
    assert (scores["KA1"].achieved, scores["KA1"].considered) == (1, 1)


def test_failed_is_not_not_considered(worked: Decomposition) -> None:
    """Everything failed: no score anywhere, and a confidence of 0 that counts."""
    scores = score_run(worked, WORKED, observed({"OBS1": 0.0, "OBS2": 0.0, "OBS3": 0.0}))
    assert (scores["KA1"].score, scores["KA1"].confidence) == (None, 0.0)


@pytest.mark.parametrize(
    ("x", "tau", "partial", "near_miss", "d", "score", "achieved"),
    [
        (0.5, 0.5, False, None, 40.0, 40.0, 1),  # x >= tau exactly
        (0.9, 0.5, False, None, 40.0, 40.0, 1),
        (0.9, 0.5, True, None, 40.0, 40.0 + 4 * (0.9 - 0.5), 1),
        (0.4999999999999999, 0.5, True, None, 40.0, None, 0),  # no slack at the threshold
        (1.0, 0.0, True, None, 100.0, 104.0, 1),  # not clipped above
        (0.0, 0.9, True, 0.9, 0.0, -3.6, 0),  # nor below
        (
            0.45,
            0.5,
            True,
            0.1,
            40.0,
            40.0 + 4 * (0.45 - 0.5),
            0,
        ),  # a near miss scores below d; its confidence stays 0
        (0.39, 0.5, True, 0.1, 40.0, None, 0),
        (
            0.7,
            0.8,
            True,
            0.1,
            40.0,
            40.0 + 4 * (0.7 - 0.8),
            0,
        ),  # 0.8 - 0.1 is a hair above 0.7: the slack of 1e-12
        (0.45, 0.5, True, 0.0, 40.0, None, 0),
    ],
)
def test_credit_and_near_misses(
    x: float, tau: float, partial: bool, near_miss: float | None, d: float, score: float | None, achieved: int
) -> None:
    """d + 4 (x - tau) with partial credit, d without; near misses only where asked for; nothing is clipped."""
    scores = score_run(
        node_of(tau, partial_credit=partial, near_miss=near_miss), {"O": d}, observed({"O": x})
    )
    assert scores["O"].score == scores["KA"].score == score
    assert (scores["O"].achieved, scores["O"].considered, scores["O"].confidence) == (
        achieved,
        1,
        float(achieved),
    )


def test_credit_points_are_a_policy() -> None:
    """The paper's four points can be others."""
    other = made_decomposition(
        [leaf("O", partial_credit=True)],
        {"V": ["O"]},
        {"KA": ["V"]},
        given=True,
        policies={"credit_points": 10.0, "inner_score": "mean"},
    )
    assert score_run(other, {"O": 40.0}, observed({"O": 1.0}))["KA"].score == 45.0


def test_what_cannot_be_scored_is_refused(worked: Decomposition) -> None:
    """Unknown and repeated observables, considered ones without a value, and missing difficulties are bugs upstream."""
    with pytest.raises(ValueError, match="OBS9"):
        score_run(worked, WORKED, observed({"OBS9": 1.0}))
    with pytest.raises(ValueError, match="two observations of OBS1"):
        score_run(worked, WORKED, observed({"OBS1": 1.0}) * 2)
    with pytest.raises(ValueError, match="has no value"):
        score_run(worked, WORKED, [Observation(observable="OBS1", considered=True)])
    with pytest.raises(ValueError, match="no difficulty of OBS3"):
        score_run(worked, {"OBS1": 30.0, "OBS2": 80.0}, ())


@dataclass(frozen=True)
class Expected:
    score: float | None
    confidence: float | None
    achieved: int
    considered: int


def brute_force(
    decomposition: Decomposition, difficulties: Mapping[str, float], xs: Mapping[str, float | None]
) -> dict[str, Expected]:
    """The rulings read aloud, node by node, with nothing shared with the implementation."""
    node_scores: dict[str, Expected] = {}

    def leaves(name: str) -> set[str]:
        children = decomposition.nodes[name].children
        return {name} if not children else {leaf for child in children for leaf in leaves(child)}

    def achieved(name: str) -> bool:
        x = xs.get(name)
        return x is not None and x >= decomposition.observables[name].threshold

    def score(name: str) -> float | None:
        children = decomposition.nodes[name].children
        if children:
            scores = [s for s in map(score, children) if s is not None]
            return min(scores) if scores else None
        rule, x = decomposition.observables[name], xs.get(name)
        if x is None:
            return None
        near_miss = rule.near_miss if rule.near_miss is not None else decomposition.policies.near_miss
        close = rule.partial_credit and near_miss > 0 and x >= rule.threshold - near_miss - 1e-12
        if not (achieved(name) or close):
            return None
        return difficulties[name] + (4 * (x - rule.threshold) if rule.partial_credit else 0.0)

    for name in decomposition.nodes:
        considered = [observable for observable in leaves(name) if xs.get(observable) is not None]
        passed = sum(achieved(observable) for observable in considered)
        node_scores[name] = Expected(
            score(name), passed / len(considered) if considered else None, passed, len(considered)
        )
    return node_scores


@st.composite
def situations(draw: st.DrawFn) -> tuple[Decomposition, dict[str, float], dict[str, float | None]]:
    """A random DAG with many-to-many edges, thresholds, credit and near misses; difficulties; values, some absent."""
    grid = st.sampled_from([0.0, 0.1, 0.25, 0.3, 0.5, 0.7, 0.75, 0.8, 1.0])
    counts = [draw(st.integers(1, max_count)) for max_count in (3, 4, 6, 8)]
    names = [[f"{letter}{i}" for i in range(count)] for letter, count in zip("PKVO", counts, strict=True)]
    layers = []
    for above, below in pairwise(names):
        children = {name: draw(st.lists(st.sampled_from(below), min_size=1, unique=True)) for name in above}
        for orphan in set(below) - {child for child_ids in children.values() for child in child_ids}:
            children[draw(st.sampled_from(above))].append(orphan)
        layers.append([node(name, child_ids) for name, child_ids in children.items()])
    observables = []
    for name in names[3]:
        partial = draw(st.booleans())
        near_miss = draw(st.none() | grid) if partial else None
        observables.append(leaf(name, threshold=draw(grid), partial_credit=partial, near_miss=near_miss))
    policies = {"near_miss": draw(st.sampled_from([0.0, 0.2]))}
    decomposition = made_decomposition(
        observables, layers[2], layers[1], layers[0], given=True, policies=policies
    )
    difficulties = {name: draw(st.floats(0, 100)) for name in names[3]}
    values = draw(st.lists(st.sampled_from(names[3]), unique=True))
    return decomposition, difficulties, {name: draw(st.none() | grid | st.floats(0, 1)) for name in values}


@settings(max_examples=200, deadline=None)
@given(situations())
def test_scores_are_those_of_a_brute_force_reference(
    situation: tuple[Decomposition, dict[str, float], dict[str, float | None]],
) -> None:
    """On random many-to-many DAGs with missing and not considered values, every node comes out exactly the same."""
    decomposition, difficulties, xs = situation
    scores = score_run(decomposition, difficulties, observed(xs))
    for name, expected in brute_force(decomposition, difficulties, xs).items():
        got = scores[name]
        assert Expected(got.score, got.confidence, got.achieved, got.considered) == expected, name


@settings(max_examples=50, deadline=None)
@given(situations())
def test_a_shared_observable_counts_once(
    situation: tuple[Decomposition, dict[str, float], dict[str, float | None]],
) -> None:
    """No node counts more than its distinct descendants, and a principle's count is that of a set."""
    decomposition, difficulties, _ = situation
    scores = score_run(decomposition, difficulties, observed(dict.fromkeys(decomposition.observables, 1.0)))
    for name in decomposition.at_level(Level.PRINCIPLE):
        assert scores[name].considered == len(set(decomposition.observables_under(name)))
