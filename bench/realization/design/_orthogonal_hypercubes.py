"""Orthogonal and nearly orthogonal Latin hypercubes.

Sun, F., Liu, M.-Q. and Lin, D. K. J. (2009), "Construction of orthogonal Latin hypercube designs", Biometrika
96(4), 971-974; run sizes between: the same (2010), "Construction of orthogonal Latin hypercube designs with
flexible run sizes", Journal of Statistical Planning and Inference 140(11), 3236-3242. All arithmetic, the
search included, is in whole numbers: a correlation of 0 is exact, and every machine finds the same design.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np
from pydantic import Field

from bench.arrays import Counts
from bench.documents import Document

from ._factor_space import FactorSpace
from ._factors import FactorLevels

MAX_ORTHOGONAL_POINTS = 1025

MAX_NEARLY_ORTHOGONAL_POINTS = 500

# Random starts of the search for a nearly orthogonal hypercube; the best result is kept.
SEARCHES = 4

# Random choices of columns that are compared; fewer above MAX_COMPARED_POINTS points: it takes long.
COLUMN_CHOICES = 60

MAX_COMPARED_POINTS = 300

MAX_SWEEPS = 60

# The search stops at correlations below 1 / 500; nearly orthogonal designs are customarily allowed 0.03.
CORRELATION_DIVISOR = 500


class OrthogonalLatinHypercube(Document):
    """A Latin hypercube in which no column correlates with another one, nor with the square of one.

    Up to 2**c factors in r * 2**(c + 1) points, or one more (the centre): 8 in 16, 17, 32, 33, 48 ..., 16 in
    32, 33, 64, 65 ...
    """

    kind: Literal["orthogonal_latin_hypercube"] = "orthogonal_latin_hypercube"
    points: int | None = Field(
        None,
        ge=4,
        le=MAX_ORTHOGONAL_POINTS,
        description="The least with a centre that carries the factors, when absent.",
    )

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        factors = len(space.free)
        points = self.points or least_points(factors)
        columns = _maximin_columns(points, factors, seed)
        return space.every([space.ranked(row, points) for row in _ranks(columns)], self.kind)


class NearlyOrthogonalLatinHypercube(Document):
    """A Latin hypercube of any number of points, searched for small correlations between all columns."""

    kind: Literal["nearly_orthogonal_latin_hypercube"] = "nearly_orthogonal_latin_hypercube"
    points: int = Field(ge=3, le=MAX_NEARLY_ORTHOGONAL_POINTS)

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        square = nearly_orthogonal_latin_hypercube(self.points, len(space.free), seed)
        return space.every([space.ranked(row, self.points) for row in _ranks(square)], self.kind)


def least_points(factors: int) -> int:
    """The smallest 2**(c + 1) + 1 that carries so many factors."""
    return (2 << _exponent(factors)) + 1


def orthogonal_latin_hypercube(points: int, factors: int) -> Counts:
    """All columns that the construction gives for so many points, whole numbers; any of them are orthogonal.

    With a centre each column holds -r ... r once, without one the odd numbers -(2 r - 1) ... 2 r - 1. Raises
    ValueError where the construction has none.
    """
    exponents = _exponents(points, factors)
    if not exponents:
        step = 2 << _exponent(factors)
        nearest = max(step, round(points / step) * step)
        raise ValueError(
            f"no orthogonal Latin hypercube of {points} points carries {factors} factors; {nearest} and {nearest + 1} points do, "
            "and nearly_orthogonal_latin_hypercube takes any number"
        )
    return _constructed(points, exponents[-1])


def _exponents(points: int, factors: int) -> list[int]:
    """Every c with which the construction gives so many points, and 2**c columns enough; rising."""
    size = points - points % 2
    return [c for c in range(_exponent(factors), 12) if size and size % (2 << c) == 0]


def _constructed(points: int, exponent: int) -> Counts:
    signs, places = _halves(exponent)
    blocks = [places + (step << exponent) * signs for step in range((points - points % 2) // (2 << exponent))]
    if points % 2:
        upper = np.vstack(blocks)
        return np.vstack([upper, np.zeros((1, upper.shape[1]), dtype=np.int64), -upper])
    upper = np.vstack([2 * block - signs for block in blocks])
    return np.vstack([upper, -upper])


@lru_cache(maxsize=16)
def _maximin_columns(points: int, factors: int, seed: int) -> Counts:
    """Of several random choices of columns the one whose closest points are farthest apart (maximin).

    Correlations do not depend on which column a factor gets, nor on its sign.
    """
    draws = np.random.default_rng(seed)
    squares = [_constructed(points, exponent) for exponent in _exponents(points, factors)] or [
        orthogonal_latin_hypercube(points, factors)
    ]
    best, farthest = squares[0], -1
    for turn in range(COLUMN_CHOICES if points <= MAX_COMPARED_POINTS else len(squares)):
        square = squares[turn % len(squares)]
        columns = square[:, draws.permutation(square.shape[1])[:factors]] * draws.choice([-1, 1], factors)
        closest = _closest(columns)
        if closest > farthest:
            best, farthest = columns, closest
    return best


def largest_correlation(square: Counts) -> float:
    """The largest absolute correlation between two columns of a Latin hypercube; 0.0 is exact."""
    products = square.T @ square
    apart = np.abs(products - np.diag(np.diag(products)))
    return float(apart.max() / products[0, 0])


@lru_cache(maxsize=16)
def nearly_orthogonal_latin_hypercube(points: int, factors: int, seed: int) -> Counts:
    """Columns that each hold 0, +-2, +-4 ... (or +-1, +-3 ...) once; the most even of a few searches. Not to be changed."""
    draws = np.random.default_rng(seed)
    marks = 2 * np.arange(points, dtype=np.int64) - (points - 1)
    designs = [
        _decorrelated(np.stack([draws.permutation(marks) for _ in range(factors)], axis=1))
        for _ in range(SEARCHES)
    ]
    # Correlations are compared to two decimals; equal ones leave the choice to the spread of the points.
    return min(designs, key=lambda design: (round(largest_correlation(design), 2), -_closest(design)))


def _decorrelated(square: Counts) -> Counts:
    """Swaps in columns, the best first, until all correlations are small or their squares' sum is least.

    Swapping rows a and b of column j, whose values are d apart, changes its product with another column m by
    d times that column's difference; so the change of the whole sum is 2 d (u_a - u_b) + d d w, u being the
    other columns weighted by their products with j, and w the squared distance of the two rows in them.
    """
    square = square.copy()
    for _ in range(MAX_SWEEPS):
        improved = False
        for column in range(square.shape[1]):
            remaining = np.delete(square, column, axis=1)
            if _is_decorrelated(square[:, column], remaining):
                continue
            apart = _squared_distances(remaining)
            while (swap := _best_swap(square[:, column], remaining, apart)) is not None:
                square[list(swap), column] = square[list(reversed(swap)), column]
                improved = True
        if not improved:
            break
    return square


def _is_decorrelated(mine: Counts, columns: Counts) -> bool:
    return not columns.size or CORRELATION_DIVISOR * int(np.abs(columns.T @ mine).max()) <= int(mine @ mine)


def _best_swap(mine: Counts, columns: Counts, distances: Counts) -> tuple[int, int] | None:
    if _is_decorrelated(mine, columns):
        return None
    weighted = columns @ (columns.T @ mine)
    apart = mine[None, :] - mine[:, None]
    change = apart * (2 * (weighted[:, None] - weighted[None, :]) + apart * distances)
    best = int(change.argmin())
    # Only strict improvements: otherwise two swaps of equal value could alternate forever.
    if change.flat[best] >= 0:
        return None
    first, second = divmod(best, len(mine))
    return first, second


def _squared_distances(square: Counts) -> Counts:
    inner = square @ square.T
    norms = np.diag(inner)
    return np.asarray(norms[:, None] + norms[None, :] - 2 * inner)


def _closest(square: Counts) -> int:
    """The squared distance of the two closest points."""
    apart = _squared_distances(square)
    return int(apart[~np.eye(len(apart), dtype=np.bool_)].min())


def _exponent(factors: int) -> int:
    return max(1, (factors - 1).bit_length())


def _halves(exponent: int) -> tuple[Counts, Counts]:
    """S and T of Sun, Liu and Lin (2009): signs, and places 1 ... 2**c with signs; orthogonal columns."""
    signs, places = np.array([[1, 1], [1, -1]], dtype=np.int64), np.array([[1, 2], [2, -1]], dtype=np.int64)
    for step in range(1, exponent):
        high = 2**step
        lifted = places + high * signs
        signs, places = (
            np.block([[signs, -_starred(signs)], [signs, _starred(signs)]]),
            np.block([[places, -_starred(lifted)], [lifted, _starred(places)]]),
        )
    return signs, places


def _starred(square: Counts) -> Counts:
    """The upper half with its signs turned."""
    half = len(square) // 2
    return np.vstack([-square[:half], square[half:]])


def _ranks(square: Counts) -> list[list[int]]:
    """Columns that hold every step once, as ranks from 0."""
    top = int(square.max())
    step = 1 if len(square) == 2 * top + 1 else 2
    ranks: list[list[int]] = ((square + top) // step).tolist()
    return ranks
