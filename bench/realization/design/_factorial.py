"""Factorial designs: all combinations of levels, and one factor at a time."""

from __future__ import annotations

import itertools
import math
from typing import Literal

from pydantic import Field

from bench.documents import Document

from ._factor_space import FactorSpace
from ._factors import MAX_POINTS, FactorLevels


class FullFactorial(Document):
    """Every combination of all levels, in the order of the factors, the last one changing fastest."""

    kind: Literal["full_factorial"] = "full_factorial"
    take: int | None = Field(
        None, ge=1, description="Draw so many (point, replicate) pairs without replacement; all when absent."
    )

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        del seed
        counted = [factor.counted() for factor in space.free]
        size = math.prod(map(len, counted))
        if size > MAX_POINTS:
            raise ValueError(
                f"the full factorial has {size} points, more than {MAX_POINTS}; use a latin_hypercube or fewer levels"
            )
        names = [factor.name for factor in space.free]
        return _distinct(
            space, [dict(zip(names, levels, strict=True)) for levels in itertools.product(*counted)]
        )


class OneByOne(Document):
    """The first level of every factor, then each other level of each factor with the rest at their first."""

    kind: Literal["one_by_one"] = "one_by_one"

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        del seed
        first: FactorLevels = {factor.name: factor.counted()[0] for factor in space.free}
        changed = [{**first, factor.name: level} for factor in space.free for level in factor.counted()[1:]]
        return _distinct(space, [first, *changed])


def _distinct(space: FactorSpace, chosen: list[FactorLevels]) -> list[FactorLevels]:
    """The allowed points without repetition: combinations that differ in inactive factors alone are equal."""
    if space.unconstrained:
        # No factor has a level twice, so all differ as they are. A campaign counts its points each time it is read.
        return chosen
    distinct = {tuple(map(repr, levels.values())): levels for levels in reversed(list(space.whole(chosen)))}
    return list(reversed(distinct.values()))
