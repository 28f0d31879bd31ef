"""Competence: the antitonic fit by its definition, a bound that covers, and that failing never raises either. Beside it the
difficulty-response curve: finite where passes and failures are separated, honest about what is not there.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from competence_trials import competence_of
from hypothesis import given
from hypothesis import strategies as st

from bench.statistics import (
    CurveState,
    Direction,
    Trials,
    competence,
    count_trials,
    difficulty_response,
    difficulty_slope,
    failures_rise,
)
from bench.statistics._curve import _dispersion

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
    for fails in np.array_split(rng.permutation(600), 30):
        now = competence_of(hard, passed, share=share)
        assert now <= last
        assert now[1] <= last[1]
        passed[fails] = False
        last = now
    assert competence_of(hard, passed, share=share) == (0.0, 0.0, False)


def passed(count: int, points: int) -> list[Trial]:
    """So many passes at one difficulty, in turn at each of so many design points."""
    return [(40.0, True, str(number % points)) for number in range(count)]


@pytest.mark.parametrize(
    ("trial_list", "share", "expected"),
    [
        # All passed: at least the hardest tested. The bound needs 5 straight passes for a half, 33 for nine tenths.
        (passed(5, 5), HALF, (40.0, 40.0, True)),
        (passed(4, 4), HALF, (40.0, 0.0, True)),
        (passed(33, 33), NINE_TENTHS, (40.0, 40.0, True)),
        (passed(32, 32), NINE_TENTHS, (40.0, 0.0, True)),
        # Ten replicates in each of four design points are four units, whatever they have in common.
        (passed(40, 4), HALF, (40.0, 0.0, True)),
        # Few trials at each of many difficulties add up, as far as they pass.
        ([(float(i), i < 40, str(i)) for i in range(50)], HALF, (39.0, 35.0, False)),
        # A hard level that fails takes nothing away below.
        (
            [(20.0, True, str(i)) for i in range(40)] + [(80.0, False, f"hard {i}") for i in range(400)],
            NINE_TENTHS,
            (20.0, 20.0, False),
        ),
    ],
)
def test_the_bound_rests_on_all_that_is_as_hard_or_harder(
    trial_list: list[Trial], share: tuple[int, int], expected: tuple[float, float, bool]
) -> None:
    assert competence_from(trial_list, share) == expected


@pytest.mark.parametrize("tried", [[], [1]])
def test_nothing_tried_is_no_competence_of_zero(tried: list[int]) -> None:
    """Of two groups, one without a trial says so by its count."""
    one = np.ones(len(tried))
    trials = Trials(
        np.array(tried, np.int64), 30.0 * one, one.astype(np.bool_), np.zeros(len(tried), np.int64)
    )
    result = competence(count_trials(trials, 2), HALF)
    assert result.trials.tolist() == [0, len(tried)]
    assert result.value.tolist() == [0.0, 30.0 * len(tried)]
    assert result.at_least.tolist() == [False, bool(tried)]


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
    for campaign in range(120):
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
    assert agree >= 114
    assert claimed <= 4  # 2.5 % of 60, and chance


@pytest.mark.parametrize(
    ("difficulty", "failed", "rises"),
    [
        ((10, 20, 30, 40, 50, 60), (0, 0, 0, 0, 0, 0), False),
        ((10, 20, 30, 40, 50, 60), (1, 1, 1, 1, 1, 1), False),
        ((10, 20, 80, 90), (0, 0, 1, 1), False),
        ((10, 11, 20, 80, 89, 90), (0, 0, 0, 1, 1, 1), True),
    ],
)
def test_nothing_rises_where_all_runs_end_alike_or_are_few(
    difficulty: tuple[float, ...], failed: tuple[int, ...], rises: bool
) -> None:
    group = np.zeros(len(failed), dtype=np.int64)
    passes = ~np.array(failed, dtype=np.bool_)
    trials = Trials(group, np.array(difficulty, dtype=np.float64), passes, np.arange(len(failed)))
    assert bool(failures_rise(count_trials(trials, 1))[0]) is rises


HARD = np.repeat([10.0, 30.0, 50.0, 70.0, 90.0], 8)


def chance(difficulty: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp((difficulty - 50.0) / 12.0))


def test_it_finds_the_curve_that_made_the_runs() -> None:
    """20,000 runs: half chance within a point of the truth, and the curve everywhere."""
    rng = np.random.default_rng(31)
    hard = rng.uniform(0.0, 100.0, 20_000)
    curve = difficulty_response(hard, rng.random(20_000) < chance(hard))
    assert curve.state is CurveState.FITTED
    assert curve.half_at == pytest.approx(50.0, abs=1.0)
    assert np.abs(curve.probability - chance(curve.difficulty)).max() < 0.03
    assert (np.diff(curve.probability) < 0).all()


def test_its_band_covers() -> None:
    """At the middle and at the ends, 40 runs each time: 95 % within three points, over 200 seeded campaigns."""
    rng = np.random.default_rng(32)
    inside = []
    for _ in range(200):
        curve = difficulty_response(HARD, rng.random(HARD.size) < chance(HARD))
        truth = chance(curve.difficulty)
        inside.append(((curve.low <= truth) & (truth <= curve.high))[[0, 50, 100]])
    assert (np.mean(inside, axis=0) >= 0.92).all()


def test_separated_runs_have_a_finite_curve() -> None:
    """All passes below all failures: the likelihood has no maximum, the penalised one has, and the state says so."""
    curve = difficulty_response(HARD, HARD < 40.0)
    assert curve.state is CurveState.SEPARATED
    assert curve.half_at == pytest.approx(40.0, abs=1.0)
    assert np.isfinite(curve.probability).all()
    assert curve.low[50] < 0.01 < 0.5 < curve.high[50]  # what lies between the levels is open
    assert (
        difficulty_response(HARD, HARD > 40.0).half_at is None
    )  # passes what is hard: no fall through one half


def test_what_is_not_drawn() -> None:
    """Nine runs, one difficulty, nothing at all: no arrays, and a state that says why."""
    for difficulty, passed, state in (
        (HARD[:36:4], HARD[:36:4] < 50.0, CurveState.TOO_FEW),
        (np.full(30, 20.0), np.arange(30) % 2, CurveState.ONE_DIFFICULTY),
        ([], [], CurveState.TOO_FEW),
    ):
        curve = difficulty_response(difficulty, passed)
        assert curve.state is state
        assert not curve.drawn
    # Penalised: straight passes are not certainty, and the curve has no half.
    every = difficulty_response(HARD, np.ones(HARD.size))
    assert (every.state, every.half_at) == (CurveState.ALL_PASSED, None)
    assert 0.9 < every.probability.max() < 1.0
    assert difficulty_response(HARD, np.zeros(HARD.size)).state is CurveState.NONE_PASSED


def test_replicates_that_agree_widen_the_band() -> None:
    """Four equal runs in each design point: the band is wider than were they independent, the curve the same."""
    rng = np.random.default_rng(33)
    hard = rng.uniform(0.0, 100.0, 60)
    ok = rng.random(60) < chance(hard)
    points = [f"p{i // 4}" for i in range(240)]
    alone, with_points = (
        difficulty_response(np.repeat(hard, 4), np.repeat(ok, 4), names) for names in (None, points)
    )
    assert np.array_equal(alone.probability, with_points.probability)
    assert (with_points.high - with_points.low > 1.3 * (alone.high - alone.low))[20:80].all()


def test_its_half_rises_where_easy_runs_fail_and_competence_does_not() -> None:
    """Why it is drawn and never the number: failing what is easy flattens the curve, and its half may move up."""
    hard = np.repeat([10.0, 30.0, 50.0, 70.0], 20)
    ok = (np.arange(80) % 20) < np.repeat([20, 19, 10, 1], 20)
    worse = ok & ~((hard == 10.0) & (np.arange(80) % 20 < 8))
    before, after = difficulty_response(hard, ok), difficulty_response(hard, worse)
    assert before.half_at is not None
    assert after.half_at is not None
    assert competence_of(hard, worse)[0] <= competence_of(hard, ok)[0]
    assert np.diff(after.probability)[50] > np.diff(before.probability)[50]


def test_design_points_that_scatter_less_than_chance_do_not_narrow_the_band() -> None:
    """Each of ten design points has two passes and two failures: runs that agree by luck are no more certain."""
    ok = np.tile([1.0, 0.0, 1.0, 0.0], 10)
    hard = np.repeat(np.linspace(10.0, 90.0, 10), 4)
    design = np.column_stack([np.ones(40), (hard - 50.0) / 10.0])
    points = [f"p{number}" for number in np.repeat(np.arange(10), 4)]
    assert _dispersion(design, ok, np.zeros(2), points) == 1.0
    # All four runs of a point agree: four times as much scatter as independent runs have, over eight degrees.
    agreeing = np.repeat(np.tile([1.0, 0.0], 5), 4)
    assert _dispersion(design, agreeing, np.zeros(2), points) == pytest.approx(4.0 * 10 / 8)
    assert _dispersion(design, agreeing, np.zeros(2), None) == 1.0
