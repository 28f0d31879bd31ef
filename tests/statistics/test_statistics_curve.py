"""Difficulty-response curves: finite where passes and failures are separated, honest about what is not there."""

from __future__ import annotations

import numpy as np
import pytest
from competence_trials import competence_of

from bench.statistics import CurveState, difficulty_response
from bench.statistics._curve import _dispersion

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
    """At the middle and at the ends, 40 runs each time: 95 % within three points, over 400 seeded campaigns."""
    rng = np.random.default_rng(32)
    inside = []
    for _ in range(400):
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


def test_all_and_none() -> None:
    """Penalised: straight passes are not certainty, and the curve has no half."""
    every = difficulty_response(HARD, np.ones(HARD.size))
    assert (every.state, every.half_at) == (CurveState.ALL_PASSED, None)
    assert 0.9 < every.probability.max() < 1.0
    assert difficulty_response(HARD, np.zeros(HARD.size)).state is CurveState.NONE_PASSED


def test_what_is_not_drawn() -> None:
    """Nine runs, one difficulty, nothing at all: no arrays, and a state that says why."""
    few = difficulty_response(HARD[:36:4], HARD[:36:4] < 50.0)
    same = difficulty_response(np.full(30, 20.0), np.arange(30) % 2)
    none = difficulty_response([], [])
    assert [state.state for state in (few, same, none)] == [
        CurveState.TOO_FEW,
        CurveState.ONE_DIFFICULTY,
        CurveState.TOO_FEW,
    ]
    assert not any(state.drawn for state in (few, same, none))


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
