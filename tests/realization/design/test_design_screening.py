"""Plackett-Burman designs, definitive screening and fractions: rows as printed, and what each can tell apart."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from design_plans import WHOLE, design, levels, matrix, ranges, refused
from numpy.typing import NDArray

from bench.realization.design._fractional_factorial import fraction
from bench.realization.design._hadamard import conference_matrix
from bench.realization.design._screening import definitive_screening, plackett_burman


def signs(factors: list[dict[str, Any]], **method: Any) -> NDArray[np.float64]:
    """A design of two levels as -1 and 1."""
    return 2 * matrix(design(factors, method=method)) - 1


@pytest.mark.parametrize(
    ("runs", "printed"),
    [
        (8, "+++-+--"),
        (12, "++-+++---+-"),
        (20, "++--++++-+-+----++-"),
        (24, "+++++-+-++--++--+-+----"),
    ],
)
def test_plackett_burman_rows_as_printed(runs: int, printed: str) -> None:
    """The first row that Plackett and Burman (1946) print, turned, and a row of lows."""
    rows = ["".join("+" if sign > 0 else "-" for sign in row) for row in plackett_burman(runs - 1)]
    turned = [printed[-turn:] + printed[:-turn] for turn in range(1, runs - 1)]
    assert rows == [printed, *turned, "-" * (runs - 1)]


@pytest.mark.parametrize(
    "factors", [3, 7, 11, 15, 19, 23, 27, 31, 35, 39, 43, 47, 51, 55, 59, 63, 71, 75, 83, 99]
)
def test_plackett_burman_is_balanced_and_orthogonal(factors: int) -> None:
    """Every factor is high in half the runs, and every two are high together in a quarter."""
    rows = plackett_burman(factors)

    assert len(rows) == factors + 1
    assert not rows.sum(axis=0).any()
    assert np.array_equal(rows.T @ rows, len(rows) * np.eye(factors, dtype=np.int64))


def test_foldover_frees_main_effects_of_pairs() -> None:
    """Folded over, no main effect goes with any product of two factors; as it is, some do."""
    plain, folded = (signs(ranges(5), kind="plackett_burman", foldover=fold) for fold in (False, True))

    def blurred(rows: NDArray[np.float64]) -> float:
        pairs = np.stack([rows[:, a] * rows[:, b] for a, b in itertools.combinations(range(5), 2)], axis=1)
        return float(np.abs(rows.T @ pairs).max())

    assert len(folded) == 2 * len(plain) == 16
    assert blurred(plain) > 0.0
    assert blurred(folded) == 0.0


def test_conference_matrices_are_orthogonal() -> None:
    for order in (4, 6, 8, 10, 12, 14, 16, 18, 20, 24, 26, 30, 32, 38, 50):
        values = conference_matrix(order)
        assert values is not None
        assert np.array_equal(values.T @ values, (order - 1) * np.eye(order, dtype=np.int64))
    assert conference_matrix(22) is None  # 21 is no sum of two squares, so there is none


@pytest.mark.parametrize(
    ("factors", "runs"), [(3, 9), (4, 9), (5, 13), (6, 13), (7, 17), (10, 21), (11, 25), (21, 49)]
)
def test_definitive_screening_separates_what_it_says(factors: int, runs: int) -> None:
    """Main effects are orthogonal to each other, to every square and to every product of two, exactly."""
    rows = definitive_screening(factors)

    assert rows.shape == (runs, factors)
    products = rows.T @ rows
    assert not (products - np.diag(np.diag(products))).any()
    second = np.stack(
        [rows[:, a] * rows[:, b] for a, b in itertools.combinations_with_replacement(range(factors), 2)],
        axis=1,
    )
    assert not (rows.T @ second).any()
    assert not rows[-1].any()


def test_definitive_screening_over_factors() -> None:
    """Low, middle and high of ranges, and three numbers in their order."""
    plan = design([*ranges(2), levels("fog", 4, 0, 1)], method={"kind": "definitive_screening"})
    points = [tuple(point.levels.values()) for point in plan.points()]

    assert {value for point in points for value in point[:2]} == {0.0, 0.5, 1.0}
    assert points[-1] == (0.5, 0.5, 1)


@pytest.mark.parametrize(
    ("factors", "resolution", "runs"),
    [
        # Box, Hunter and Hunter (2005), table 6.22: the least runs of a regular fraction.
        *[(3, 3, 4), (5, 3, 8), (7, 3, 8), (15, 3, 16), (31, 3, 32)],
        *[(4, 4, 8), (6, 4, 16), (7, 4, 16), (8, 4, 16), (9, 4, 32), (11, 4, 32)],
        *[(16, 4, 32), (17, 4, 64), (32, 4, 64)],
        *[(5, 5, 16), (8, 5, 64), (10, 5, 128), (11, 5, 128), (6, 6, 32), (9, 6, 128), (7, 7, 64)],
    ],
)
def test_fractions_have_their_resolution_in_the_least_runs(factors: int, resolution: int, runs: int) -> None:
    """No product of fewer columns is a constant, by multiplying all; no more runs than the tables."""
    columns = fraction(factors, resolution)

    assert 2 ** max(columns).bit_length() == runs
    for count in range(1, resolution if factors < 12 else min(resolution, 4)):
        for chosen in itertools.combinations(columns, count):
            product = 0
            for column in chosen:
                product ^= column
            assert product
    plan = signs(ranges(factors), kind="fractional_factorial", resolution=resolution)
    assert plan.shape == (runs, factors)
    assert np.array_equal(plan.T @ plan, runs * np.eye(factors))


def test_fraction_by_generators_and_by_runs() -> None:
    """Half of 2^4 by d = a b c has every level of d the product of the others'; by runs too."""
    four = [{**point, "name": name} for point, name in zip(ranges(4), "abcd", strict=True)]
    by_hand = signs(four, kind="fractional_factorial", generators={"d": ["a", "b", "c"]})
    values = signs(four, kind="fractional_factorial", runs=8)

    assert (by_hand[:, 3] == by_hand[:, 0] * by_hand[:, 1] * by_hand[:, 2]).all()
    assert by_hand[:, :3].tolist() == [list(point) for point in itertools.product([-1, 1], repeat=3)]
    assert np.array_equal(values, by_hand)


@pytest.mark.parametrize(
    ("method", "why"),
    [
        ({"generators": {"d": ["a", "c"], "c": ["a", "b"]}}, "no base factor"),
        ({"generators": {"d": ["a", "b"], "c": ["a", "b"]}}, "same column"),
        ({"runs": 8, "resolution": 4}, "give one of"),
        ({"runs": 12}, "no power of two"),
        ({"runs": 16}, "use full_factorial"),
        ({"runs": 4}, "at most 3 factors"),
    ],
)
def test_fractions_that_cannot_be(method: dict[str, Any], why: str) -> None:
    four = [{**point, "name": name} for point, name in zip(ranges(4), "abcd", strict=True)]
    assert why in refused(four, method={"kind": "fractional_factorial", **method})


@pytest.mark.parametrize(
    ("kind", "third", "why"),
    [
        ("fractional_factorial", levels("d", 1, 2, 3), "takes two"),
        ("definitive_screening", levels("approach", "N", "S"), "three numbers"),
        # Between 3 and 6 no whole number is in the middle: main effects would go with squares.
        ("definitive_screening", WHOLE, "in the middle"),
    ],
)
def test_factors_that_a_method_cannot_take(kind: str, third: dict[str, Any], why: str) -> None:
    more = {"resolution": 3} if kind == "fractional_factorial" else {}
    assert why in refused([*ranges(2), third], method={"kind": kind, **more})
