"""Skill of stated confidences and errors over many runs: constants have none, whoever knows has some."""

from __future__ import annotations

import numpy as np
import pytest

from bench.arrays import Floats
from bench.statistics import confidence_skill, error_skill

SCENES = [f"scene {number // 3}" for number in range(120)]
RANDOM = np.random.default_rng(11)
CHANCE = RANDOM.uniform(0.05, 1.0, 120)
RIGHT = (RANDOM.random(120) < CHANCE).astype(float)
SIGMA_M = RANDOM.uniform(0.5, 8.0, 120)
ERROR_M = SIGMA_M * RANDOM.rayleigh(1.0, 120)


def brier(confidence: Floats, right: Floats) -> float:
    total = sum((stated - is_right) ** 2 for stated, is_right in zip(confidence, right, strict=True))
    return float(total / len(right))


def interval_score(sigma_m: Floats, error_m: Floats) -> float:
    """Gneiting and Raftery (2007), formula (43) with the lower end at 0."""
    total = 0.0
    for sigma, error in zip(sigma_m, error_m, strict=True):
        radius = sigma * (2.0 * np.log(20.0)) ** 0.5
        total += radius + (2.0 / 0.1) * max(error - radius, 0.0)
    return total / len(error_m)


def test_scores_agree_with_plain_loops_and_no_constant_is_better_than_the_best() -> None:
    confidence = confidence_skill(CHANCE, RIGHT, SCENES)
    error = error_skill(SIGMA_M, ERROR_M, SCENES)
    assert confidence is not None
    assert error is not None
    assert confidence.score == pytest.approx(brier(CHANCE, RIGHT))
    assert error.score == pytest.approx(interval_score(SIGMA_M, ERROR_M))
    constants = np.linspace(0.0, 1.0, 201)
    least = min(brier(np.full(120, value), RIGHT) for value in constants)
    assert least - 1e-4 <= confidence.constant_score <= least
    least_m = min(interval_score(np.full(120, 20.0 * value), ERROR_M) for value in constants)
    assert least_m - 0.5 <= error.constant_score <= least_m + 1e-9
    for skill in (confidence, error):
        assert skill.skill == pytest.approx(1.0 - skill.score / skill.constant_score)
        assert (skill.statements, skill.scenes) == (120, 40)


def test_who_knows_has_skill_and_a_constant_has_none() -> None:
    """0.9 and 5 m always, and a sigma that is five times too wide: as the loophole had it."""
    knows = confidence_skill(CHANCE, RIGHT, SCENES), error_skill(SIGMA_M, ERROR_M, SCENES)
    for skill in knows:
        assert skill is not None
        assert skill.low is not None
        assert skill.low > 0.0
    always = (
        confidence_skill(np.full(120, 0.9), RIGHT, SCENES),
        error_skill(np.full(120, 5.0), ERROR_M, SCENES),
        error_skill(5.0 * SIGMA_M, ERROR_M, SCENES),
    )
    for skill in always:
        assert skill is not None
        assert skill.skill is not None
        assert skill.high is not None
        assert skill.skill <= skill.high <= 0.0
    best = confidence_skill(np.full(120, RIGHT.mean()), RIGHT, SCENES)
    assert best is not None
    assert best.skill == pytest.approx(0.0)


def test_the_order_of_the_runs_decides_nothing_and_the_scene_decides_the_interval() -> None:
    turned = confidence_skill(CHANCE[::-1], RIGHT[::-1], SCENES[::-1])
    straight = confidence_skill(CHANCE, RIGHT, SCENES)
    assert straight is not None
    assert turned is not None
    assert turned.scenes == straight.scenes
    assert turned.skill == pytest.approx(straight.skill)
    alone = confidence_skill(CHANCE, RIGHT, [f"{number}" for number in range(120)])
    # Every statement ten times in its scene is no more knowledge, and every one a scene of its own would be.
    many = np.tile(CHANCE, 10), np.tile(RIGHT, 10)
    tenfold = confidence_skill(*many, [f"{number}" for number in range(120)] * 10)
    separate = confidence_skill(*many, [f"{number}" for number in range(1200)])
    widths = []
    for skill in (alone, tenfold, separate):
        assert skill is not None
        assert skill.low is not None
        assert skill.high is not None
        widths.append(skill.high - skill.low)
    assert widths[1] == pytest.approx(widths[0], rel=0.05)
    assert widths[2] < 0.5 * widths[0]


@pytest.mark.parametrize(("scenes", "has_interval"), [(4, False), (5, True)])
def test_too_few_scenes_have_no_interval(scenes: int, *, has_interval: bool) -> None:
    count = 4 * scenes
    skill = confidence_skill(CHANCE[:count], RIGHT[:count], [f"{row % scenes}" for row in range(count)])
    assert skill is not None
    assert (skill.low is not None) is has_interval


def test_where_the_best_constant_is_perfect_there_is_no_skill() -> None:
    skill = confidence_skill(np.full(20, 0.9), np.ones(20), SCENES[:20])
    assert skill is not None
    assert (skill.best_constant, skill.constant_score, skill.skill, skill.low) == (1.0, 0.0, None, None)
    assert confidence_skill(np.zeros(0), np.zeros(0), []) is None
