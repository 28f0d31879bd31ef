"""Scores of runs: the paper's worked example to the digit, credit and near misses."""

from __future__ import annotations

from typing import Any

import pytest
from made_decompositions import (
    WORKED,
    leaf,
    made_decomposition,
    observed,
    worked_decomposition,
)

from bench.contracts import Observation
from bench.scoring import score_run
from decompositions import Decomposition


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
