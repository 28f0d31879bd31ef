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
        return all(change.to is not None for change in self.changes)


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


def difficulty_increase(decomposition: Decomposition, difficulty: Difficulty, node: str) -> DifficultyIncrease:
    """How `node` could be harder than in the situation that `found` rates. KeyError for an unknown node."""
    observables = decomposition.observables_under(node)
    if decomposition.policies.factor_rule != "minimum" or not all(
        difficulty.observables[factor].ratings for factor in observables
    ):
        return DifficultyIncrease(node, (), (), None, None, None)
    factors = _factors(decomposition, difficulty, observables)
    lowest = min(factor.rating for factor in factors)
    higher_ratings = [factor.rating for factor in factors if factor.rating > lowest]
    next_rating = min(higher_ratings, default=None)
    level = tension_of(lowest)
    boundary = TENSION_POINTS * level
    return DifficultyIncrease(
        node=node,
        ruled_by=tuple(factor.name for factor in factors if factor.rating == lowest),
        following=tuple(factor.name for factor in factors if factor.rating == next_rating),
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
    column = bisect_right(table.ratings, rating) if exceeded else bisect_left(table.ratings, rating)
    if column == len(table.ratings):
        return None
    value = table.values[column]
    if column == 0:
        return value, False
    low, high, previous_value = table.ratings[column - 1], table.ratings[column], table.values[column - 1]
    if value == previous_value:  # one value in two columns: the policy says which of them it has
        return value, rules.shared_value == "lower"
    if table.mapping == "step" or (rating == high and not exceeded):
        return value, False
    return previous_value + (value - previous_value) * (rating - low) / (high - low), exceeded


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
        targets = [value_for_rating(row, rating, self.policies, exceeded=exceeded) for row in self.rows]
        reachable_targets = [target for target in targets if target is not None]
        sign = 1.0 if True in rises else -1.0
        hardest_target = (
            max(reachable_targets, key=lambda target: (sign * target[0], target[1]))
            if len(reachable_targets) == len(targets) and len(rises) == 1
            else None
        )
        return FactorChange(
            factor=self.name,
            unit=self.rows[0].unit,
            value=self.value,
            to=None if hardest_target is None else hardest_target[0],
            past=hardest_target is not None and hardest_target[1],
            harder="either way" if len(rises) > 1 else "more" if True in rises else "less",
            most=min(row.ratings[-1] for row in self.rows),
        )


def _factors(decomposition: Decomposition, difficulty: Difficulty, under: Iterable[str]) -> list[_FactorUnder]:
    """The distinct rows of every factor under a node, the lowest rated factor first."""
    values: Mapping[str, float] = {row.factor: row.value for one in under for row in difficulty.observables[one].ratings}
    rows = sorted((row for one in under for row in decomposition.key_factors(one)), key=lambda row: row.factor)
    factors = []
    for name, group in groupby(rows, key=lambda row: row.factor):
        distinct = tuple(dict.fromkeys(group))
        rating = min(rate(row, values[name], decomposition.policies) for row in distinct)
        factors.append(_FactorUnder(name, values[name], distinct, rating, decomposition.policies))
    return sorted(factors, key=lambda one: one.rating)


def _goal(factors: Iterable[_FactorUnder], rating: float, *, exceeded: bool) -> DifficultyGoal:
    """Every factor that is short of the rating."""
    short = [
        factor
        for factor in factors
        if factor.rating < rating or (exceeded and round(factor.rating, DIFFICULTY_DECIMALS) <= rating)
    ]
    return DifficultyGoal(rating, exceeded, tuple(factor.change(rating, exceeded=exceeded) for factor in short))
