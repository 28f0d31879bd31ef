"""The design of an experiment: factors, the combinations of their levels, and how often each is repeated.

Three ids are kept apart: a *design point* (`p017`, one combination of levels), a *replicate* (its n-th repetition, with
seeds of its own) and a *realization* (the one SimSpec that one agent flies, `p017-r1-reference-naive`).
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from bench.documents import Document
from bench.simspec import Identifier

Level = bool | int | float | str
MAX_POINTS = 100_000


class Range(Document):
    """Values between two bounds, both included."""

    low: float
    high: float
    steps: Annotated[
        int | None, Field(ge=2, le=1000, description="Evenly spaced levels for designs that count levels, ends included.")
    ] = None
    integer: Annotated[bool, Field(description="Round to whole numbers.")] = False

    @model_validator(mode="after")
    def _rises(self) -> Self:
        if self.high <= self.low:
            raise ValueError(f"high {self.high} must exceed low {self.low}")
        return self

    def at(self, share: float) -> float | int:
        """The value at a share of the way, 0 at low and 1 at high."""
        value = self.low + share * (self.high - self.low)
        return round(value) if self.integer else value


class Factor(Document):
    """Something that is varied: levels or a range, and the fields of the SimSpec that take its value.

    `sets` are paths that all take the level's value itself; `patches` give, for a level by name, other values for paths
    (an approach of N, E, S or W that moves the vehicle's home).
    """

    name: Identifier
    unit: Annotated[str | None, Field(description="Checked against the unit that the paths' names state.")] = None
    levels: Annotated[tuple[Level, ...], Field(max_length=1000)] = ()
    range: Range | None = None
    sets: tuple[str, ...] = ()
    patches: dict[str, dict[str, Any]] = {}

    @model_validator(mode="after")
    def _varies_something(self) -> Self:
        if bool(self.levels) == (self.range is not None):
            raise ValueError(f"factor {self.name!r}: give either levels (at least one) or range")
        twice = [level for level, times in Counter(self.levels).items() if times > 1]
        if twice:
            raise ValueError(f"factor {self.name!r}: level {twice[0]!r} stands twice (numbers that are equal are one level)")
        if not self.sets and not self.patches:
            raise ValueError(f"factor {self.name!r} changes nothing; give sets (paths into the SimSpec) or patches")
        if self.patches and set(self.patches) != set(map(str, self.levels)):
            raise ValueError(
                f"factor {self.name!r}: patches {sorted(self.patches)} must name exactly the levels {list(self.levels)}"
            )
        return self

    def counted(self) -> tuple[Level, ...]:
        """The levels one by one. Raises ValueError for a range without steps."""
        if self.range is None:
            return self.levels
        if self.range.steps is None:
            raise ValueError(f"factor {self.name!r} is a range; this design counts levels: give levels or range.steps")
        return tuple(self.range.at(step / (self.range.steps - 1)) for step in range(self.range.steps))

    def at(self, share: float) -> Level:
        """The level at a share in [0, 1): within the range, or the levels in equal parts."""
        if self.range is not None:
            return self.range.at(share)
        return self.levels[min(int(share * len(self.levels)), len(self.levels) - 1)]

    def changes(self, level: Level) -> dict[str, object]:
        """Every path that this level sets, with its value."""
        return dict.fromkeys(self.sets, level) | self.patches.get(str(level), {})


Levels = dict[str, Level]


class FullFactorial(Document):
    """Every combination of all levels, in the order of the factors, the last one changing fastest."""

    kind: Literal["full_factorial"] = "full_factorial"
    take: Annotated[
        int | None, Field(ge=1, description="Draw so many (point, replicate) pairs without replacement; all when absent.")
    ] = None

    def combinations(self, factors: Sequence[Factor], seed: int) -> list[Levels]:
        del seed
        counted = [factor.counted() for factor in factors]
        size = math.prod(map(len, counted))
        if size > MAX_POINTS:
            raise ValueError(
                f"the full factorial has {size} points, more than {MAX_POINTS}; use a latin_hypercube or fewer levels"
            )
        return [dict(zip([f.name for f in factors], combination, strict=True)) for combination in itertools.product(*counted)]


class OneByOne(Document):
    """The first level of every factor, then each other level of each factor with the rest at their first."""

    kind: Literal["one_by_one"] = "one_by_one"

    def combinations(self, factors: Sequence[Factor], seed: int) -> list[Levels]:
        del seed
        first: Levels = {factor.name: factor.counted()[0] for factor in factors}
        others = ({**first, factor.name: level} for factor in factors for level in factor.counted()[1:])
        return [first, *others]


class LatinHypercube(Document):
    """Points that take every factor's range in equal strata, once each; optimised for low centred discrepancy."""

    kind: Literal["latin_hypercube"] = "latin_hypercube"
    points: Annotated[int, Field(ge=1, le=10_000)]

    def combinations(self, factors: Sequence[Factor], seed: int) -> list[Levels]:
        from scipy.stats import qmc  # half a second to import, so only who samples pays for it

        # The optimiser's time grows with the square of the points; above this it would cost more than it brings.
        optimise: Literal["random-cd"] | None = "random-cd" if 2 <= self.points <= 500 and len(factors) > 1 else None
        engine = qmc.LatinHypercube(d=len(factors), rng=np.random.default_rng(seed), optimization=optimise)
        return _spread(factors, engine.random(self.points))


class Halton(Document):
    """The first points of a scrambled Halton sequence: space-filling, and more points later leave the earlier ones alone."""

    kind: Literal["halton"] = "halton"
    points: Annotated[int, Field(ge=1, le=MAX_POINTS)]

    def combinations(self, factors: Sequence[Factor], seed: int) -> list[Levels]:
        from scipy.stats import qmc  # see LatinHypercube

        engine = qmc.Halton(d=len(factors), scramble=True, rng=np.random.default_rng(seed))
        return _spread(factors, engine.random(self.points))


Method = Annotated[FullFactorial | OneByOne | LatinHypercube | Halton, Field(discriminator="kind")]


def _spread(factors: Sequence[Factor], shares: NDArray[np.float64]) -> list[Levels]:
    return [{factor.name: factor.at(float(share)) for factor, share in zip(factors, row, strict=True)} for row in shares]


@dataclass(frozen=True, slots=True)
class DesignPoint:
    """One combination of levels; `id` is its place in the design, from p001."""

    id: str
    levels: Mapping[str, Level]


class Design(Document):
    """Which situations are flown: factors, the method that combines them, replicates, and the seed of all of it."""

    factors: tuple[Factor, ...] = ()
    method: Method = FullFactorial()
    replicates: Annotated[int, Field(ge=1, le=10_000, description="Repetitions of each point, each with seeds of its own.")] = 1
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        twice = [name for name, times in Counter(factor.name for factor in self.factors).items() if times > 1]
        if twice:
            raise ValueError(f"two factors are called {twice[0]!r}")
        pairs = len(self.points()) * self.replicates
        take = self.method.take if isinstance(self.method, FullFactorial) else None
        if take is not None and take > pairs:
            raise ValueError(
                f"take {take} exceeds the {pairs} pairs of design point and replicate; raise replicates or lower take"
            )
        if pairs > MAX_POINTS:
            raise ValueError(f"the design has {pairs} pairs of design point and replicate, more than {MAX_POINTS}")
        return self

    def points(self) -> list[DesignPoint]:
        """Every design point, in the design's own order; the same for the same document."""
        combinations = self.method.combinations(self.factors, self.seed) if self.factors else [{}]
        return [DesignPoint(f"p{number:03d}", levels) for number, levels in enumerate(combinations, start=1)]

    def pairs(self) -> list[tuple[DesignPoint, int]]:
        """The (point, replicate) pairs to fly, ordered by point and replicate, replicates from 1.

        Where `take` draws some of them, each pair's place in the draw depends on nothing but the seed and the pair:
        a larger `take` keeps those already drawn.
        """
        pairs = [(point, replicate) for point in self.points() for replicate in range(1, self.replicates + 1)]
        take = self.method.take if isinstance(self.method, FullFactorial) else None
        if take is None:
            return pairs
        drawn = {(point.id, replicate) for point, replicate in sorted(pairs, key=self._lot)[:take]}
        return [pair for pair in pairs if (pair[0].id, pair[1]) in drawn]

    def _lot(self, pair: tuple[DesignPoint, int]) -> bytes:
        point, replicate = pair
        return hashlib.blake2b(f"{self.seed}/{point.id}/{replicate}".encode()).digest()
