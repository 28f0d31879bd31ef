"""Latin hypercubes, orthogonal, nearly so and nested: correlations and strata counted in whole numbers."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from design_plans import WHOLE, design, levels, matrix, ranges, refused

from bench.realization import design_quality
from bench.realization.design._nested_hypercubes import nested_latin_hypercube
from bench.realization.design._orthogonal_hypercubes import (
    largest_correlation,
    nearly_orthogonal_latin_hypercube,
    orthogonal_latin_hypercube,
)

SIZES = [(5, 2), (9, 4), (17, 8), (33, 16), (65, 32), (129, 64), (257, 128)]
OTHER_SIZES = [(16, 8), (32, 16), (48, 8), (49, 8), (25, 4), (24, 4)]


@pytest.mark.parametrize(("points", "columns"), SIZES + OTHER_SIZES)
def test_orthogonal_latin_hypercubes_are_exactly_that(points: int, columns: int) -> None:
    """In whole numbers: columns are permutations about 0; products with others and their squares are 0."""
    square = orthogonal_latin_hypercube(points, columns)

    assert square.shape == (points, columns)
    assert square.dtype == np.int64
    marks = np.arange(points) - points // 2 if points % 2 else 2 * np.arange(points) - (points - 1)
    assert (np.sort(square, axis=0) == marks[:, None]).all()
    products = square.T @ square
    assert not (products - np.diag(np.diag(products))).any()
    assert not (square.T @ square**2).any()


def test_orthogonal_design_over_factors() -> None:
    """Whichever columns the seed picks: ends of the ranges reached, correlation 0, the least points."""
    plan = design(ranges(5), method={"kind": "orthogonal_latin_hypercube"}, seed=4)

    values = np.rint(matrix(plan) * 16 - 8).astype(np.int64)
    assert values.shape == (17, 5)
    assert (np.sort(values, axis=0) == np.arange(-8, 9)[:, None]).all()
    assert largest_correlation(values) == 0.0
    quality = design_quality(plan.space, plan.points())
    assert quality.max_abs_correlation == 0.0
    other = design(ranges(5), method={"kind": "orthogonal_latin_hypercube"}, seed=5)
    assert matrix(other).tolist() != matrix(plan).tolist()
    method = {"kind": "orthogonal_latin_hypercube", "points": 20}
    assert "16 and 17 points do" in refused(ranges(8), method=method)


@pytest.mark.parametrize(("points", "factors"), [(11, 3), (20, 6), (41, 8), (100, 12)])
def test_nearly_orthogonal_latin_hypercubes(points: int, factors: int) -> None:
    """Every column is a permutation, and no correlation reaches the 0.03 by which such designs are known."""
    square = nearly_orthogonal_latin_hypercube(points, factors, seed=1)

    assert (np.sort(square, axis=0) == (2 * np.arange(points) - (points - 1))[:, None]).all()
    assert largest_correlation(square) < 0.03
    assert np.array_equal(square, nearly_orthogonal_latin_hypercube(points, factors, seed=1))
    method = {"kind": "nearly_orthogonal_latin_hypercube", "points": points}
    values = matrix(design(ranges(factors), method=method))
    assert len({round(point, 9) for point in values[:, 0]}) == points


def test_nested_designs_are_latin_twice() -> None:
    """All points fill their strata once each, and the high ones theirs; pairs share levels and scene."""
    rows = nested_latin_hypercube(24, 6, 3, seed=2)

    assert (np.sort((rows * 24).astype(int), axis=0) == np.arange(24)[:, None]).all()
    assert (np.sort((rows[:6] * 6).astype(int), axis=0) == np.arange(6)[:, None]).all()
    method = {"kind": "nested", "points": 24, "high": 6, "fidelity": "rate"}
    plan = design([levels("rate", 10, 50), *ranges(3)], method=method).points()
    low = {tuple(point.levels.values())[1:]: point for point in plan if point.levels["rate"] == 10}
    high = [point for point in plan if point.levels["rate"] == 50]
    assert (len(low), len(high)) == (24, 6)
    assert all(low[tuple(point.levels.values())[1:]].scene == point.scene != point.id for point in high)
    assert len({point.scene for point in plan}) == 24
    method = {"kind": "nested", "points": 9, "high": 4, "fidelity": "f0"}
    assert "multiple of high" in refused(ranges(2), method=method)


def test_every_flight_of_a_nested_design_has_a_scene_of_its_own_but_for_twins() -> None:
    """Points that happen to have the same levels would be one run counted twice."""
    factors = [levels("rate", 10, 50), levels("a", 1, 2), {"name": "b", "formula": "a * rate", "sets": ["b"]}]
    points = design(factors, method={"kind": "nested", "points": 8, "high": 2, "fidelity": "rate"}).points()

    low = [point for point in points if point.levels["rate"] == 10]
    high = [point for point in points if point.levels["rate"] == 50]
    assert [point.scene for point in low] == [point.id for point in low]
    twins = [points[points.index(point) - 1].id for point in high]
    assert [point.scene for point in high] == twins == ["p001", "p003"]


@pytest.mark.parametrize("kind", ["sobol", "halton", "latin_hypercube", "nearly_orthogonal_latin_hypercube"])
def test_whole_numbers_and_levels_are_even(kind: str) -> None:
    """Ends of whole numbers come as often as those between, and so do levels, in any order."""
    factors = [*ranges(1), WHOLE, levels("a", "x", "y", "z", "w")]
    plan = design(factors, method={"kind": kind, "points": 64}).points()

    for name, allowed in (("whole", {3, 4, 5, 6}), ("a", set("xyzw"))):
        values = Counter(point.levels[name] for point in plan)
        assert set(values) == allowed
        assert max(values.values()) - min(values.values()) <= 2


def test_whole_numbers_of_an_orthogonal_design_are_even_and_mirrored() -> None:
    """65 points on 4 numbers: 16 each, the centre, and each point's mirror image."""
    points = design([*ranges(1), WHOLE], method={"kind": "orthogonal_latin_hypercube", "points": 65}).points()

    assert sorted(Counter(point.levels["whole"] for point in points).values()) == [16, 16, 16, 17]
    of = {round(float(point.levels["f0"]), 9): int(point.levels["whole"]) for point in points}
    assert all(of[round(1 - share, 9)] == 9 - whole for share, whole in of.items() if share != 0.5)
