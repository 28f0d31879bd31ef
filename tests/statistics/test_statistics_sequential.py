"""Confidence sequences and stopping: they hold at every look at once, where fixed intervals do not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.statistics import StoppingRule, clopper_pearson, mean_bounds, pass_rate_bounds
from bench.statistics._sequential import PassRateVerdict


def test_the_sequence_covers_at_every_look_at_once() -> None:
    """Over 200 looks at each of 2000 seeded sequences at most 5 % ever miss (three standard errors allowed)."""
    trials = np.arange(1, 201)
    counted, tried = np.meshgrid(np.arange(201), trials)
    low, high = pass_rate_bounds(np.minimum(counted, tried), tried)
    for p in (0.02, 0.3, 0.5, 0.95):
        passes = np.cumsum(np.random.default_rng(21).random((2000, 200)) < p, axis=1)
        missed = (low[trials - 1, passes] > p) | (high[trials - 1, passes] < p)
        assert missed.any(axis=1).mean() <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 2000), p


def test_the_bounds_hold_the_exact_interval() -> None:
    """They are wider than the interval for one look, but not by much."""
    passed = np.random.default_rng(23).random(200) < 0.8
    low, high = pass_rate_bounds(passed.sum(), 200)
    once = clopper_pearson(passed.sum(), 200)
    assert low < once[0] < once[1] < high
    assert high - low < 2.0 * (once[1] - once[0])


def test_straight_runs_settle_it() -> None:
    """2^n / (n + 1) first reaches 20 at n = 8: so many straight passes, or failures, settle a threshold of one half."""
    rule = StoppingRule(0.5)
    assert rule.decided_after([True] * 7) is None
    assert rule.decided_after([True] * 30) == rule.decided_after([False] * 30) == 8
    assert (rule.verdict([True] * 8), rule.verdict([False] * 8), rule.verdict([True, False] * 20)) == (
        PassRateVerdict.ABOVE,
        PassRateVerdict.BELOW,
        PassRateVerdict.OPEN,
    )
    assert rule.verdict([]) is PassRateVerdict.OPEN


@given(
    st.lists(st.booleans(), max_size=40),
    st.lists(st.booleans(), max_size=10),
    st.sampled_from([0.2, 0.5, 0.9]),
)
def test_a_verdict_rests_on_the_trials_up_to_it(
    first: list[bool], later: list[bool], threshold: float
) -> None:
    """What comes after changes nothing, and the rule is that the sequence lies wholly on one side."""
    rule = StoppingRule(threshold)
    after = rule.decided_after(first)
    if after is not None:
        assert rule.decided_after(first + later) == after
        assert rule.verdict(first + later) == rule.verdict(first[:after])
    if first:
        low, high = pass_rate_bounds(np.cumsum(first), np.arange(1, len(first) + 1))
        outside = (low > threshold) | (high < threshold)
        assert after == (int(np.argmax(outside)) + 1 if outside.any() else None)


@pytest.mark.parametrize(("p", "wrong"), [(0.89, PassRateVerdict.ABOVE), (0.91, PassRateVerdict.BELOW)])
def test_a_verdict_is_seldom_wrong(p: float, wrong: PassRateVerdict) -> None:
    """Stopped as soon as it may be, at most 5 % of verdicts are wrong even next to the threshold."""
    rule = StoppingRule(0.9)
    trials = np.random.default_rng(24).random((600, 400)) < p
    assert np.mean([rule.verdict(sequence) is wrong for sequence in trials]) <= 0.05


def test_rules_that_cannot_be() -> None:
    """Nothing settles a threshold at the end of the scale."""
    with pytest.raises(ValueError, match="threshold 1"):
        StoppingRule(1.0)


def test_bounds_of_a_mean_cover_at_every_look_at_once() -> None:
    """Trials of changing expectation, between 0 and 1: the running mean of what was to be expected is held at
    all 50 looks.
    """
    rng = np.random.default_rng(31)
    expected = np.where(np.arange(200) % 3 == 0, 0.95, 0.4)
    values = rng.beta(2.0 * expected, 2.0 * (1.0 - expected), (400, 200))
    looks = np.arange(4, 201, 4)
    summed = np.cumsum(values, axis=1)[:, looks - 1]
    low, high = mean_bounds(summed, np.broadcast_to(looks, summed.shape))
    mean = np.cumsum(expected)[looks - 1] / looks
    assert ((low > mean) | (high < mean)).any(axis=1).mean() <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)
    assert (high - low)[:, -1].mean() < 0.3  # and it says something


def test_after_stopping_the_exact_interval_misses_where_these_hold() -> None:
    """Points whose pass rate is the threshold, ended once settled at 80 % or after 300: how often their own
    trials deny the rate.
    """
    passed = np.random.default_rng(32).random((1000, 300)) < 0.5
    rule = StoppingRule(0.5, level=0.8)
    ends = np.array([rule.decided_after(row) or 300 for row in passed])
    passes = np.cumsum(passed, axis=1)[np.arange(1000), ends - 1]

    def missed(low: np.ndarray, high: np.ndarray) -> float:
        return float(((low > 0.5) | (high < 0.5)).mean())

    assert missed(*clopper_pearson(passes, ends)) > 0.08
    assert missed(*pass_rate_bounds(passes, ends)) <= 0.05
    assert missed(*mean_bounds(passes, ends)) <= 0.05


def test_bounds_hold_what_was_seen_and_mirror() -> None:
    """They lie around the share, a pass is to a failure as low to high, and without trials nothing is known."""
    passes, fails = (np.ravel(bound) for bound in np.meshgrid([0, 1, 5, 40, 3000], [0, 1, 7, 900]))
    for bounds in (pass_rate_bounds, mean_bounds):
        low, high = bounds(passes, passes + fails)
        trials = passes + fails > 0
        share = passes[trials] / (passes + fails)[trials]
        assert ((low[trials] <= share) & (share <= high[trials])).all()
        assert (low[~trials], high[~trials]) == (0.0, 1.0)
        other = bounds(fails, passes + fails)
        np.testing.assert_allclose((low, high), (1.0 - other[1], 1.0 - other[0]), atol=1e-9)
