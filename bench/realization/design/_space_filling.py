"""Space-filling designs: Latin hypercubes, and Sobol and Halton sequences, which can be extended."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.documents import Document

from ._factor_space import FactorSpace
from ._factors import MAX_POINTS, FactorLevels

HALTON_BLOCK = 256


class LatinHypercube(Document):
    """Points that take every factor's range in equal strata, once each; of low centred discrepancy."""

    kind: Literal["latin_hypercube"] = "latin_hypercube"
    points: int = Field(ge=1, le=10_000)

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        return space.every([space.at(row) for row in _latin(self.points, len(space.free), seed)], self.kind)


class Halton(Document):
    """The first points of a scrambled Halton sequence: points added later leave the earlier ones."""

    kind: Literal["halton"] = "halton"
    points: int = Field(ge=1, le=MAX_POINTS)

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        return space.first(map(space.at, halton_shares(len(space.free), seed)), self.points)


class Sobol(Document):
    """The first points of a scrambled Sobol sequence, best as powers of two; more leave the earlier ones."""

    kind: Literal["sobol"] = "sobol"
    points: int = Field(ge=1, le=MAX_POINTS)

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        return space.first(map(space.at, _sobol_shares(len(space.free), seed)), self.points)


def halton_shares(factors: int, seed: int) -> Iterator[NDArray[np.float64]]:
    """Rows of a scrambled Halton sequence without end; the same for the same seed."""
    # Imported here: scipy.stats takes half a second, and other designs do not need it.
    from scipy.stats import qmc

    engine = qmc.Halton(d=factors, scramble=True, rng=np.random.default_rng(seed))
    while True:
        yield from engine.random(HALTON_BLOCK)


def _sobol_shares(factors: int, seed: int) -> Iterator[NDArray[np.float64]]:
    # See halton_shares.
    from scipy.stats import qmc

    engine = qmc.Sobol(d=factors, scramble=True, rng=np.random.default_rng(seed))
    yield from engine.random_base2(8)
    for power in itertools.count(8):
        yield from engine.random_base2(power)


@lru_cache(maxsize=4)
def _latin(points: int, factors: int, seed: int) -> NDArray[np.float64]:
    # See halton_shares.
    from scipy.stats import qmc

    # The optimiser takes time by the square of the points. Chosen, not measured.
    optimise: Literal["random-cd"] | None = "random-cd" if 2 <= points <= 500 and factors > 1 else None
    return qmc.LatinHypercube(d=factors, rng=np.random.default_rng(seed), optimization=optimise).random(
        points
    )
