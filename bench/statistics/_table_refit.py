"""Failure rates in the columns of a rated table, and ratings that follow them monotonically.

Isotonic fit (pool adjacent violators): Ayer, Brunk, Ewing, Reid and Silverman (1955), Annals of Mathematical
Statistics 26(4), 641-647.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

from bench.arrays import Counts, Floats

# A rating has one digit after the point in a refitted table: more would suggest that failures decide it.
RATING_DECIMALS = 1


@dataclass(frozen=True, slots=True)
class ColumnRate:
    """Failures in one column of a table.

    `rate` is adjusted for which agents and observables were tried in the column: the column's effect in a
    linear model with an effect for each of these, shifted so that the mean over all trials is the overall
    rate. It can therefore lie outside [0, 1].
    """

    column: int
    trials: int
    failed: int
    rate: float


def nearest_column(rating: ArrayLike, ratings: Sequence[float]) -> Counts:
    """The column whose rating is nearest to each rating; the lower one of two."""
    distance = np.abs(np.asarray(rating, dtype=np.float64)[:, None] - np.asarray(ratings)[None, :])
    return np.asarray(distance.argmin(axis=1), dtype=np.int64)


def column_rates(column: Counts, failed: ArrayLike, strata: Sequence[object]) -> tuple[ColumnRate, ...]:
    """Failure rates in the columns that have trials, in their order; `strata` says what each trial was of."""
    if not column.size:
        return ()
    fails = np.asarray(failed, dtype=np.float64)
    used, place = np.unique(column, return_inverse=True)
    codes = {name: number for number, name in enumerate(dict.fromkeys(strata))}
    stratum = np.array([codes[name] for name in strata], dtype=np.int64)
    table = np.zeros((len(codes), len(used)))
    np.add.at(table, (stratum, place), 1.0)
    share = table / table.sum(axis=1, keepdims=True)
    trials, failures = table.sum(axis=0), np.bincount(place, weights=fails)
    # The effects of strata are eliminated from the normal equations, which leaves one row for each column.
    stratum_failures = np.bincount(stratum, weights=fails)
    effect = np.linalg.pinv(np.diag(trials) - table.T @ share) @ (failures - share.T @ stratum_failures)
    effect += fails.mean() - float(trials @ effect) / fails.size
    return tuple(
        ColumnRate(int(number), int(count), int(failure), float(rate))
        for number, count, failure, rate in zip(used, trials, failures, effect, strict=True)
    )


def isotonic_rates(columns: Sequence[ColumnRate], *, rising: bool = True) -> Floats:
    """The monotone rates nearest to the columns' own (least squares, weighted by trials)."""
    fit = optimize.isotonic_regression(
        [column.rate for column in columns],
        weights=[column.trials for column in columns],
        increasing=rising,
    )
    return np.asarray(fit.x, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class RefittedTable:
    """Ratings that rise strictly, and the value that has each."""

    ratings: tuple[float, ...]
    values: tuple[float, ...]


def refit_table(
    ratings: Sequence[float], values: Sequence[float], columns: Sequence[ColumnRate], *, rising: bool
) -> RefittedTable | None:
    """A table whose ratings follow the isotonic fit of the failure rates; None where the fit is flat.

    The columns with trials share out the ratings between the lowest and the highest of them in proportion to
    their fitted rates. Columns without trials keep their rating outside of that range, and between two are
    interpolated. With `rising` False the table is turned around: the value that was hardest comes first, and
    columns without trials are dropped, because nothing shows where they belong. Neighbours of equal ratings
    become one column, at the easier value.
    """
    fitted = isotonic_rates(columns, rising=rising)
    places = np.array([column.column for column in columns])
    if np.ptp(fitted) < 1e-9:
        return None
    first, last = float(ratings[places[0]]), float(ratings[places[-1]])
    new = first + (last - first) * (fitted - fitted.min()) / np.ptp(fitted)
    if rising:
        everywhere = np.array(ratings, dtype=np.float64)
        inner = slice(int(places[0]), int(places[-1]) + 1)
        everywhere[inner] = np.interp(everywhere[inner], np.asarray(ratings)[places], new)
        pairs = list(zip(everywhere.tolist(), values, strict=True))
    else:
        pairs = [(float(rating), values[place]) for rating, place in zip(new, places, strict=True)][::-1]
    rounded = [(round(rating, RATING_DECIMALS), value) for rating, value in pairs]
    columns_left = [rounded[0]] + [after for before, after in pairwise(rounded) if after[0] > before[0]]
    return RefittedTable(
        tuple(rating for rating, _ in columns_left), tuple(value for _, value in columns_left)
    )
