"""Regular fractions of two-level factorials, by resolution, by runs, or by generators.

Box, G. E. P., Hunter, J. S. and Hunter, W. G. (2005), Statistics for Experimenters, chapter 6 (fractions,
resolution).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from bench.arrays import Counts
from bench.documents import Document
from bench.simspec import Identifier

from ._factor_space import FactorSpace
from ._factors import DesignFactor, FactorLevel, FactorLevels

MAX_RUNS = 4096

# Columns that the search for a fraction looks at before it takes more runs instead.
MAX_COLUMNS_TRIED = 20_000


class FractionalFactorial(Document):
    """A regular fraction of the two-level full factorial: by resolution, by runs, or by its generators.

    Resolution III keeps main effects apart from each other, IV also from interactions of two, V those from
    each other too.
    """

    kind: Literal["fractional_factorial"] = "fractional_factorial"
    resolution: int | None = Field(
        None, ge=3, le=8, description="The least runs that have at least this resolution."
    )
    runs: int | None = Field(
        None, ge=4, le=MAX_RUNS, description="A power of two; the best resolution that the search finds."
    )
    generators: dict[Identifier, tuple[Identifier, ...]] = Field(
        {}, description="For each factor that is not a base one: the base factors whose product it is."
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.resolution is not None) + (self.runs is not None) + bool(self.generators) != 1:
            raise ValueError("give one of resolution, runs and generators")
        if self.runs is not None and self.runs & (self.runs - 1):
            raise ValueError(f"runs {self.runs} is no power of two")
        return self

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        del seed
        signs = _runs_of(self._columns([factor.name for factor in space.free]))
        return space.every(two_level_points(space.free, signs), self.kind)

    def _columns(self, names: Sequence[str]) -> tuple[int, ...]:
        """Each factor's column as the set of base factors whose product it is, a bit each."""
        if self.generators:
            return _generator_columns(names, self.generators)
        if self.resolution is not None:
            return fraction(len(names), self.resolution)
        # One of the three is given.
        assert self.runs is not None
        bases = self.runs.bit_length() - 1
        if len(names) <= bases:
            raise ValueError(
                f"{len(names)} factors have {2 ** len(names)} combinations, no more than runs {self.runs}; use full_factorial"
            )
        # The best resolution first; below III main effects would be aliased with each other.
        for resolution in range(8, 2, -1):
            if columns := _search(len(names), bases, resolution):
                return columns
        raise ValueError(f"{self.runs} runs carry at most {self.runs - 1} factors, not {len(names)}")


def fraction(factors: int, resolution: int) -> tuple[int, ...]:
    """The columns of the smallest fraction found with at least this resolution, else all base factors."""
    for bases in range(2, factors):
        if columns := _search(factors, bases, resolution):
            return columns
    return tuple(1 << place for place in range(factors))


@lru_cache(maxsize=64)
def _search(factors: int, bases: int, resolution: int) -> tuple[int, ...]:
    """Columns of a fraction in 2**bases runs; none where none are found.

    It has the resolution where no fewer columns multiply to a constant: a new one may not be a product of up
    to resolution - 2 that are there.
    """
    if factors > 2**bases - 1:
        return ()
    # Columns of many base factors first: products of few factors are the first to become aliased.
    order = sorted(range(1, 2**bases), key=lambda candidate: (-candidate.bit_count(), candidate))
    start = [1 << place for place in range(bases)]
    tried = itertools.count(1)

    def further(columns: list[int], reached: list[set[int]], place: int) -> list[int]:
        if len(columns) == factors:
            return columns
        for at in range(place, len(order) - (factors - len(columns)) + 1):
            if next(tried) > MAX_COLUMNS_TRIED:
                return []
            if not any(order[at] in products for products in reached):
                chosen = further([*columns, order[at]], _extended_products(reached, order[at]), at + 1)
                if chosen:
                    return chosen
        return []

    reached: list[set[int]] = [{0}, *(set() for _ in range(resolution - 2))]
    for column in start:
        reached = _extended_products(reached, column)
    chosen = further(start, reached, 0)
    if not chosen and resolution == 4 and factors <= 2 ** (bases - 1):
        # Columns of odd weight: an odd number of them never multiplies to a constant, nor do two that differ.
        chosen = [candidate for candidate in [*start, *order] if candidate.bit_count() % 2][:factors]
    return tuple(chosen)


def _extended_products(reached: list[set[int]], column: int) -> list[set[int]]:
    """Products of n columns, for each n, once there is another column."""
    return [
        reached[0],
        *(
            products | {product ^ column for product in fewer}
            for fewer, products in itertools.pairwise(reached)
        ),
    ]


def _generator_columns(names: Sequence[str], generators: Mapping[str, Sequence[str]]) -> tuple[int, ...]:
    bases = [name for name in names if name not in generators]
    for name, words in generators.items():
        places = [(name, names), *((word, bases) for word in words)]
        unknown = next((word for word, known in places if word not in known), None)
        if unknown is not None:
            raise ValueError(
                f"generators: {name!r} from {list(words)}: {unknown!r} is no {'base ' if unknown in names else ''}factor"
            )
        if len(set(words)) != len(words) or len(words) < 2:
            raise ValueError(f"generators: {name!r} needs at least two base factors, each once")
    if 2 ** len(bases) > MAX_RUNS:
        raise ValueError(f"{len(bases)} base factors make {2 ** len(bases)} runs, more than {MAX_RUNS}")
    place = {name: 1 << at for at, name in enumerate(bases)}
    columns = tuple(sum(place[word] for word in generators.get(name, (name,))) for name in names)
    twice = next((name for at, name in enumerate(names) if columns[at] in columns[:at]), None)
    if twice is not None:
        raise ValueError(
            f"generators: {twice!r} has the same column as another factor, so their effects could not be told apart"
        )
    return columns


def _runs_of(columns: Sequence[int]) -> Counts:
    """The runs of a fraction: base factors in standard order, the last one changing fastest."""
    bases = max(columns).bit_length()
    runs = np.arange(2**bases)
    base = [2 * (runs >> (bases - 1 - place) & 1) - 1 for place in range(bases)]
    products = [
        np.prod([signs for place, signs in enumerate(base) if column >> place & 1], axis=0)
        for column in columns
    ]
    return np.stack(products, axis=1)


def two_level_points(factors: Sequence[DesignFactor], signs: Counts) -> list[FactorLevels]:
    """Points from signs (points, factors): the first level for -1, the second for +1."""
    return points_at(factors, [factor.ends() for factor in factors], (signs + 1) // 2)


def points_at(
    factors: Sequence[DesignFactor], levels: Sequence[Sequence[FactorLevel]], places: Counts
) -> list[FactorLevels]:
    """Points from the places (points, factors) of each factor's level among its `levels`."""
    names = [factor.name for factor in factors]
    return [
        {name: choices[place] for name, choices, place in zip(names, levels, row, strict=True)}
        for row in places.tolist()
    ]
