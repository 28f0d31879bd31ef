"""Key factor tables read backwards: the values that have a rating."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

from decompositions import KeyFactor, Policies


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
