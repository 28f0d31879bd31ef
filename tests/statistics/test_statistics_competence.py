"""Competence: the antitonic fit by its definition, a bound that covers, and that failing never raises either."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from competence_trials import competence_of
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.statistics import (
    Direction,
    Trials,
    competence,
    count_trials,
    difficulty_slope,
    failures_rise,
)

HALF, NINE_TENTHS = (1, 2), (9, 10)
Trial = tuple[float, bool, str]

trials = st.lists(
    st.tuples(
        st.sampled_from([0.0, 10.0, 20.0, 30.5, 80.0, 100.0]), st.booleans(), st.sampled_from("abcdef")
    ),
    max_size=40,
)
shares = st.sampled_from([HALF, NINE_TENTHS])


def competence_from(trial_list: list[Trial], share: tuple[int, int]) -> tuple[float, float, bool]:
    return competence_of(
        [d for d, _, _ in trial_list],
        [ok for _, ok, _ in trial_list],
        [point for _, _, point in trial_list],
        share,
    )


def by_definition(trial_list: list[Trial], share: tuple[int, int]) -> float:
    """Largest tested difficulty at which the antitonic fit, by the min-max formula in fractions, reaches the share."""
    hard = sorted({d for d, _, _ in trial_list})

    def mean(low: float, high: float) -> Fraction:
        inside = [ok for d, ok, _ in trial_list if low <= d <= high]
        return Fraction(sum(inside), len(inside))

    def fit(d: float) -> Fraction:
        return min(max(mean(a, b) for b in hard if b >= d) for a in hard if a <= d)

    return max((d for d in hard if fit(d) >= Fraction(*share)), default=0.0)


@settings(deadline=None)
@given(trials, shares)
def test_the_value_is_that_of_the_antitonic_fit(trial_list: list[Trial], share: tuple[int, int]) -> None:
    """For any trials the value equals the fit's by its definition, and the bound does not exceed it."""
    value, low, at_least = competence_from(trial_list, share)
    assert value == by_definition(trial_list, share)
    assert 0.0 <= low <= value
    assert at_least == (
        bool(trial_list) and value == max(d for d, _, _ in trial_list) and by_fit_reached(trial_list, share)
    )


def by_fit_reached(trial_list: list[Trial], share: tuple[int, int]) -> bool:
    """Whether the hardest difficulty is reached; told apart from a competence of 0 because nothing is."""
    top = max(d for d, _, _ in trial_list)
    return by_definition([(d + 1.0, ok, point) for d, ok, point in trial_list], share) == top + 1.0


@settings(deadline=None)
@given(trials, shares, st.data())
def test_failing_never_raises_it(
    trial_list: list[Trial], share: tuple[int, int], data: st.DataObject
) -> None:
    """Any passes turned into failures: value and bound stay or fall, and `at least` is never gained."""
    failing = data.draw(st.lists(st.booleans(), min_size=len(trial_list), max_size=len(trial_list)))
    worse = [(d, ok and not fails, point) for (d, ok, point), fails in zip(trial_list, failing, strict=True)]
    before, after = competence_from(trial_list, share), competence_from(worse, share)
    assert after[0] <= before[0]
    assert after[1] <= before[1]
    assert after[2] <= before[2]


@pytest.mark.parametrize("share", [HALF, NINE_TENTHS])
def test_failing_never_raises_it_over_hundreds_of_difficulties(share: tuple[int, int]) -> None:
    """The same where neighbouring difficulties are bound into classes, from all passes down to none."""
    rng = np.random.default_rng(3)
    hard = np.sort(rng.uniform(0.0, 100.0, 600))
    passed = np.ones(600, dtype=bool)
    last = (100.0, 100.0, True)
    for fails in np.array_split(rng.permutation(600), 60):
        now = competence_of(hard, passed, share=share)
        assert now <= last
        assert now[1] <= last[1]
        passed[fails] = False
        last = now
    assert competence_of(hard, passed, share=share) == (0.0, 0.0, False)


def test_straight_passes() -> None:
    """All passed: at least the hardest tested; the bound needs 5 straight passes for a half and 33 for nine tenths."""
    for share, needed in ((HALF, 5), (NINE_TENTHS, 33)):
        assert competence_from([(40.0, True, str(i)) for i in range(needed)], share) == (40.0, 40.0, True)
        assert competence_from([(40.0, True, str(i)) for i in range(needed - 1)], share) == (40.0, 0.0, True)


def test_what_is_harder_counts_for_what_is_easier() -> None:
    """Few trials at each of many difficulties add up, as far as they pass; a hard level that fails takes
    nothing away below.
    """
    steps = [(float(i), i < 40, str(i)) for i in range(50)]
    assert competence_from(steps, HALF) == (39.0, 35.0, False)
    cliff = [(20.0, True, str(i)) for i in range(40)] + [(80.0, False, f"hard {i}") for i in range(400)]
    assert competence_from(cliff, NINE_TENTHS) == (20.0, 20.0, False)


def test_replicates_of_a_design_point_count_as_one() -> None:
    """Ten replicates in each of four design points are four units for the bound, whatever they have in common."""
    alike = [(40.0, True, str(i % 4)) for i in range(40)]
    assert competence_from(alike, HALF) == (40.0, 0.0, True)
    assert competence_from([(d, ok, str(i)) for i, (d, ok, _) in enumerate(alike)], HALF) == (
        40.0,
        40.0,
        True,
    )


def test_nothing_tried_is_no_competence_of_zero() -> None:
    """A group without a trial says so by its count."""
    empty = np.zeros(0, dtype=np.int64)
    result = competence(count_trials(Trials(empty, np.zeros(0), empty.astype(bool), empty), 2), HALF)
    assert result.trials.tolist() == [0, 0]
    values = competence(
        count_trials(Trials(np.array([1]), np.array([30.0]), np.array([True]), np.array([0])), 2), HALF
    )
    assert (values.trials.tolist(), values.value.tolist(), values.at_least.tolist()) == (
        [0, 1],
        [0.0, 30.0],
        [False, True],
    )


@pytest.mark.parametrize("share", [HALF, NINE_TENTHS])
@pytest.mark.parametrize("spread", [0.0, 0.6])
def test_the_bound_covers_at_least_95_percent(share: tuple[int, int], spread: float) -> None:
    """4000 campaigns at each of three worst cases: pass probabilities that lie a hair below the share from some level on.

    Replicates of a design point share a propensity that is `spread` apart from its mean, as far as it may be:
    with 0.6 they nearly agree. Seeded; 5 % is allowed to be too much, and three standard errors for the
    simulation.
    """
    rng = np.random.default_rng(11)
    q = share[0] / share[1]
    campaigns, points, replicates = 4000, 12, 3
    hard = np.array([10.0, 30.0, 50.0, 70.0])
    for true_level in (0, 1, 3):
        p = np.where(np.arange(4) < true_level, 0.5 * (1.0 + q), q - 1e-9)
        room = spread * np.minimum(p, 1.0 - p)[None, :, None]
        levels = p[None, :, None] + room * rng.choice([-1.0, 1.0], size=(campaigns, 4, points))
        passed = rng.random((campaigns, 4, points, replicates)) < levels[..., None]
        shape = passed.shape
        group = np.broadcast_to(np.arange(campaigns)[:, None, None, None], shape).ravel()
        level = np.broadcast_to(hard[None, :, None, None], shape).ravel()
        point = np.broadcast_to(
            (np.arange(4)[:, None] * points + np.arange(points))[None, :, :, None], shape
        ).ravel()
        result = competence(count_trials(Trials(group, level, passed.ravel(), point), campaigns), share)
        truth = hard[true_level - 1] if true_level else 0.0
        assert (result.low > truth).mean() <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / campaigns)


def test_the_bound_is_worth_having() -> None:
    """An agent that nearly always passes up to 50 and seldom beyond is claimed up to 50 by 70 design points a level."""
    rng = np.random.default_rng(5)
    hard = np.repeat([10.0, 30.0, 50.0, 70.0], 70)
    claimed = [
        competence_of(hard, rng.random(280) < np.where(hard <= 50.0, 0.99, 0.2), share=NINE_TENTHS)[1]
        for _ in range(100)
    ]
    assert np.mean(np.array(claimed) == 50.0) > 0.7
    assert max(claimed) == 50.0


def test_failures_rise_where_a_logistic_slope_with_clusters_says_so() -> None:
    """Beside the fit of `rebar calibrate`, over random campaigns; and where nothing rises, in one of forty at most."""
    rng = np.random.default_rng(11)
    agree, claimed = 0, 0
    for campaign in range(300):
        points, replicates = int(rng.integers(6, 40)), int(rng.integers(1, 4))
        difficulty = np.repeat(rng.choice([20.0, 35.0, 50.0, 80.0], points), replicates)
        slope = 0.0 if campaign % 2 else 0.06
        chance = 1.0 / (1.0 + np.exp(-slope * (difficulty - 50.0)))
        failed = rng.random(points * replicates) < chance
        point = np.repeat(np.arange(points), replicates)
        group = np.zeros(points * replicates, dtype=np.int64)
        rises = bool(failures_rise(count_trials(Trials(group, difficulty, ~failed, point), 1))[0])
        fit = difficulty_slope(difficulty, failed, ["an agent"] * failed.size, point.astype(str).tolist())
        agree += rises == (fit.direction is Direction.RISES)
        claimed += rises and not slope
    assert agree >= 285
    assert claimed <= 8  # 2.5 % of 150, and chance


@pytest.mark.parametrize("failed", [(0, 0, 0, 0, 0, 0), (1, 1, 1, 1, 1, 1)])
def test_nothing_rises_where_all_runs_end_alike_or_are_few(failed: tuple[int, ...]) -> None:
    def rises(difficulty: tuple[float, ...], failures: tuple[int, ...]) -> bool:
        size = len(failures)
        trials = Trials(
            np.zeros(size, dtype=np.int64),
            np.array(difficulty),
            ~np.array(failures, dtype=np.bool_),
            np.arange(size),
        )
        return bool(failures_rise(count_trials(trials, 1))[0])

    assert not rises((10.0, 20.0, 30.0, 40.0, 50.0, 60.0), failed)
    assert not rises((10.0, 20.0, 80.0, 90.0), (0, 0, 1, 1))
    assert rises((10.0, 11.0, 20.0, 80.0, 89.0, 90.0), (0, 0, 0, 1, 1, 1))
