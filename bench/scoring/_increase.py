"""What a situation would have to become for a node to be harder: which factor rules, which follows, and the values to reach.

A node's difficulty is the least rating over all rows of all key factor tables under it. So each factor has one rating under
a node, the least that its value has there; the factor with the least of these rules, and raising it alone helps until it
meets the next. Under the policy `factor_rule: mean` no factor rules, and nothing is said here.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby

from bench.statistics import DIFFICULTY_DECIMALS
from decompositions import Decomposition, KeyFactor, Policies

from ._difficulty import Difficulty, rate, tension_of

TENSION_POINTS = 20.0
HIGHEST_TENSION = 5


@dataclass(frozen=True, slots=True)
class FactorChange:
    """What one factor must come to, in `unit`; `past` says that it must lie beyond `to`, in the direction that is harder.

    `to` is None where no value is enough: its tables end at the rating `most`, or run in opposite directions.
    """

    factor: str
    unit: str
    value: float
    to: float | None
    past: bool
    harder: str
    most: float


@dataclass(frozen=True, slots=True)
class DifficultyGoal:
    """A difficulty, whether it has to be exceeded, and every change that it takes together."""

    difficulty: float
    exceeded: bool
    changes: tuple[FactorChange, ...]

    @property
    def reachable(self) -> bool:
        return all(one.to is not None for one in self.changes)


@dataclass(frozen=True, slots=True)
class DifficultyIncrease:
    """How one node could be harder.

    `ruled_by` are the factors that have the node's difficulty as their rating, `following` those that come next, `margin`
    points above. `takeover` is what it takes until they rule, None where none follows; `tension` what it takes to enter the
    next tension, None at the highest.
    """

    node: str
    ruled_by: tuple[str, ...]
    following: tuple[str, ...]
    margin: float | None
    takeover: DifficultyGoal | None
    tension: DifficultyGoal | None


def difficulty_increase(decomposition: Decomposition, found: Difficulty, node: str) -> DifficultyIncrease:
    """How `node` could be harder than in the situation that `found` rates. KeyError for an unknown node."""
    under = decomposition.observables_under(node)
    if decomposition.policies.factor_rule != "minimum" or not all(found.observables[one].ratings for one in under):
        return DifficultyIncrease(node, (), (), None, None, None)
    factors = _factors(decomposition, found, under)
    lowest = min(one.rating for one in factors)
    above = [one.rating for one in factors if one.rating > lowest]
    next_rating = min(above, default=None)
    level = tension_of(lowest)
    boundary = TENSION_POINTS * level
    return DifficultyIncrease(
        node=node,
        ruled_by=tuple(one.name for one in factors if one.rating == lowest),
        following=tuple(one.name for one in factors if one.rating == next_rating),
        margin=None if next_rating is None else next_rating - lowest,
        takeover=None if next_rating is None else _goal(factors, next_rating, exceeded=False),
        tension=None if level == HIGHEST_TENSION else _goal(factors, boundary, exceeded=True),
    )


def value_for_rating(
    table: KeyFactor, rating: float, policies: Policies | None = None, *, exceeded: bool = False
) -> tuple[float, bool] | None:
    """The easiest value that a table rates at `rating` or more, or above it where it is to be exceeded; the inverse of `rate`.

    With it whether the value itself is not enough, and what lies beyond it is. None where the table ends before.
    """
    rules = policies or Policies()
    at = bisect_right(table.ratings, rating) if exceeded else bisect_left(table.ratings, rating)
    if at == len(table.ratings):
        return None
    here = table.values[at]
    if at == 0:
        return here, False
    low, high, before = table.ratings[at - 1], table.ratings[at], table.values[at - 1]
    if here == before:  # one value in two columns: the policy says which of them it has
        return here, rules.shared_value == "lower"
    if table.mapping == "step" or (rating == high and not exceeded):
        return here, False
    return before + (here - before) * (rating - low) / (high - low), exceeded


@dataclass(frozen=True, slots=True)
class _FactorUnder:
    """One factor under one node: its value, the rows that rate it there, and the least of their ratings."""

    name: str
    value: float
    rows: tuple[KeyFactor, ...]
    rating: float
    policies: Policies

    def change(self, rating: float, *, exceeded: bool) -> FactorChange:
        rises = {row.values[-1] > row.values[0] for row in self.rows}
        wanted = [value_for_rating(row, rating, self.policies, exceeded=exceeded) for row in self.rows]
        known = [one for one in wanted if one is not None]
        sign = 1.0 if True in rises else -1.0
        reached = max(known, key=lambda one: (sign * one[0], one[1])) if len(known) == len(wanted) and len(rises) == 1 else None
        return FactorChange(
            factor=self.name,
            unit=self.rows[0].unit,
            value=self.value,
            to=None if reached is None else reached[0],
            past=reached is not None and reached[1],
            harder="either way" if len(rises) > 1 else "more" if True in rises else "less",
            most=min(row.ratings[-1] for row in self.rows),
        )


def _factors(decomposition: Decomposition, found: Difficulty, under: Iterable[str]) -> list[_FactorUnder]:
    """The distinct rows of every factor under a node, the lowest rated factor first."""
    values: Mapping[str, float] = {row.factor: row.value for one in under for row in found.observables[one].ratings}
    rows = sorted((row for one in under for row in decomposition.key_factors(one)), key=lambda row: row.factor)
    made = []
    for name, group in groupby(rows, key=lambda row: row.factor):
        distinct = tuple(dict.fromkeys(group))
        rating = min(rate(row, values[name], decomposition.policies) for row in distinct)
        made.append(_FactorUnder(name, values[name], distinct, rating, decomposition.policies))
    return sorted(made, key=lambda one: one.rating)


def _goal(factors: Iterable[_FactorUnder], rating: float, *, exceeded: bool) -> DifficultyGoal:
    """Every factor that is short of the rating."""
    short = [one for one in factors if one.rating < rating or (exceeded and round(one.rating, DIFFICULTY_DECIMALS) <= rating)]
    return DifficultyGoal(rating, exceeded, tuple(one.change(rating, exceeded=exceeded) for one in short))
