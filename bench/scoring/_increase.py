"""How to make a node harder: which factor rules its difficulty, which comes next, and the values to reach.

A node's difficulty is the lowest rating over all rows of all key factor tables under it. Each factor thus has
one rating under a node: the lowest one of its value there. The factor with the lowest of these rules the
difficulty, and raising it alone helps until it reaches the next one. Under the policy `factor_rule: mean` no
factor rules, and the answer is empty.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby

from bench.statistics import DIFFICULTY_DECIMALS
from decompositions import Decomposition, KeyFactor, Policies

from ._difficulty import Difficulty, rate, rated_observables, tension_of

TENSION_POINTS = 20.0
HIGHEST_TENSION = 5


@dataclass(frozen=True, slots=True)
class FactorChange:
    """The value that one factor must reach, in `unit`; `past` means that it must lie beyond `to`, on the harder side.

    `to` is None where no value is enough: the factor's tables end at the rating `most`, or run in opposite
    directions.
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
    """A difficulty, whether it must be exceeded, and all changes that are needed together to get there."""

    difficulty: float
    exceeded: bool
    changes: tuple[FactorChange, ...]

    @property
    def reachable(self) -> bool:
        return all(change.to is not None for change in self.changes)


@dataclass(frozen=True, slots=True)
class DifficultyIncrease:
    """What it takes to make one node harder.

    `ruled_by` are the factors whose rating is the node's difficulty; `following` are the next ones, `margin`
    points above. `takeover` is the goal at which these rule too, None where no factor follows. `tension` is
    the goal of the next tension, None at the highest.
    """

    node: str
    ruled_by: tuple[str, ...]
    following: tuple[str, ...]
    margin: float | None
    takeover: DifficultyGoal | None
    tension: DifficultyGoal | None


def difficulty_increase(
    decomposition: Decomposition, difficulty: Difficulty, node: str
) -> DifficultyIncrease:
    """What it takes to make `node` harder than in the situation that `difficulty` rates.

    Raises KeyError for an unknown node.
    """
    # An observable that is not exercised limits nothing. A change that exercises it may lower the node.
    observables = rated_observables(decomposition, node, difficulty.observables)
    has_ratings = all(difficulty.observables[factor].ratings for factor in observables)
    if decomposition.policies.factor_rule != "minimum" or not observables or not has_ratings:
        return DifficultyIncrease(node, (), (), None, None, None)
    factors = _factors(decomposition, difficulty, observables)
    lowest = min(factor.rating for factor in factors)
    higher_ratings = [factor.rating for factor in factors if factor.rating > lowest]
    next_rating = min(higher_ratings, default=None)
    # A tension ends at its upper boundary inclusive, so the next one begins just above: the goal must be
    # exceeded.
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
    """The easiest value that a table rates at `rating` or more, or above it with `exceeded`; the inverse of `rate`.

    The second item is true where the value itself is not enough, but every harder one is. None where the
    table ends below the rating.
    """
    rules = policies or Policies()
    column = bisect_right(table.ratings, rating) if exceeded else bisect_left(table.ratings, rating)
    if column == len(table.ratings):
        return None
    value = table.values[column]
    if column == 0:
        return value, False
    low, high, previous_value = table.ratings[column - 1], table.ratings[column], table.values[column - 1]
    # One value in two columns (ruling 2): under `lower` the value itself keeps the lower rating, so it must
    # be passed.
    if value == previous_value:
        return value, rules.shared_value == "lower"
    if table.mapping == "step" or (rating == high and not exceeded):
        return value, False
    return previous_value + (value - previous_value) * (rating - low) / (high - low), exceeded


def hardest_value(
    table: KeyFactor, rating: float, policies: Policies | None = None
) -> tuple[float, bool] | None:
    """The hardest value that a table rates at `rating` or less, infinite where it rates all of them so.

    The second item is true where the value itself is rated higher, but no easier one. None where the table begins
    above the rating.
    """
    rules = policies or Policies()
    column = bisect_right(table.ratings, rating)
    if column == 0:
        return None
    if column == len(table.ratings):
        return math.copysign(math.inf, table.values[-1] - table.values[0]), False
    value, previous_value = table.values[column], table.values[column - 1]
    if value == previous_value:
        return value, rules.shared_value != "lower"
    if table.mapping == "step":
        return value, True
    low, high = table.ratings[column - 1], table.ratings[column]
    return previous_value + (value - previous_value) * (rating - low) / (high - low), False


@dataclass(frozen=True, slots=True)
class _FactorUnder:
    """One factor under one node: its value, the table rows that rate it there, and the lowest of their ratings."""

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


def _factors(
    decomposition: Decomposition, difficulty: Difficulty, under: Iterable[str]
) -> list[_FactorUnder]:
    """Every factor under a node with its distinct table rows, the lowest rated factor first."""
    values: Mapping[str, float] = {
        row.factor: row.value for observable in under for row in difficulty.observables[observable].ratings
    }
    # groupby needs equal factors side by side.
    rows = sorted(
        (row for observable in under for row in decomposition.key_factors(observable)),
        key=lambda row: row.factor,
    )
    factors = []
    for name, group in groupby(rows, key=lambda row: row.factor):
        # Several observables may share a table; each row counts once.
        distinct = tuple(dict.fromkeys(group))
        rating = min(rate(row, values[name], decomposition.policies) for row in distinct)
        factors.append(_FactorUnder(name, values[name], distinct, rating, decomposition.policies))
    return sorted(factors, key=lambda factor: factor.rating)


def _goal(factors: Iterable[_FactorUnder], rating: float, *, exceeded: bool) -> DifficultyGoal:
    """The changes of every factor that is below the rating."""
    short = [
        factor
        for factor in factors
        if factor.rating < rating or (exceeded and round(factor.rating, DIFFICULTY_DECIMALS) <= rating)
    ]
    return DifficultyGoal(
        rating, exceeded, tuple(factor.change(rating, exceeded=exceeded) for factor in short)
    )
