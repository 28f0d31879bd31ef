"""Nested designs: many points at low fidelity, a few of which are also flown at high fidelity.

Qian, P. Z. G. (2009), "Nested Latin hypercube designs", Biometrika 96(4), 957-970: all points together are a
Latin hypercube, and so are those at high fidelity among themselves.
"""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from bench.documents import Document
from bench.simspec import Identifier

from ._factor_space import FactorSpace
from ._factors import FactorLevels

# Chosen, not measured.
MAXIMIN_DRAWS = 20


class Nested(Document):
    """A Latin hypercube at low fidelity, and some of its points, in the same scenes, at high fidelity."""

    kind: Literal["nested"] = "nested"
    points: int = Field(ge=2, le=10_000, description="Points at low fidelity; a multiple of high.")
    high: int = Field(ge=1, description="How many of them are flown at high fidelity too.")
    fidelity: Identifier = Field(description="The factor with two levels, the low fidelity first.")

    @model_validator(mode="after")
    def _divides(self) -> Self:
        if self.points % self.high or self.points == self.high:
            raise ValueError(f"points {self.points} must be a multiple of high {self.high}, twice it or more")
        return self

    @property
    def twins(self) -> range:
        """The indices of the high-fidelity points, each right after its low-fidelity twin."""
        return range(1, 2 * self.high, 2)

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        """The low points, the first `high` of them followed by their high twins."""
        switch = next((factor for factor in space.free if factor.name == self.fidelity), None)
        if switch is None or switch.when is not None:
            raise ValueError(f"fidelity {self.fidelity!r} is not an unconditional factor")
        low, high = switch.ends()
        remaining = [factor for factor in space.free if factor is not switch]
        rows = nested_latin_hypercube(self.points, self.high, len(remaining), seed)
        chosen: list[FactorLevels] = []
        for place, row in enumerate(rows):
            levels = {
                factor.name: factor.at(float(share)) for factor, share in zip(remaining, row, strict=True)
            }
            chosen.append(levels | {switch.name: low})
            if place < self.high:
                chosen.append(levels | {switch.name: high})
        return space.every(chosen, self.kind)


def nested_latin_hypercube(points: int, high: int, factors: int, seed: int) -> NDArray[np.float64]:
    """Shares in [0, 1): the first `high` rows take each of so many strata once, all rows each of `points`.

    The maximin choice: of several random hypercubes the one whose closest points are farthest apart.
    """
    draws = np.random.default_rng(seed)
    # Above 500 points one draw is kept: comparing distances takes time by the square of the points.
    designs = [
        _drawn_rows(points, high, factors, draws) for _ in range(MAXIMIN_DRAWS if 1 < points <= 500 else 1)
    ]
    return max(designs, key=_closest)


def _drawn_rows(points: int, high: int, factors: int, draws: np.random.Generator) -> NDArray[np.float64]:
    columns = []
    for _ in range(factors):
        finer = points // high
        # One of the fine strata inside each coarse one: the high points are a Latin hypercube too.
        first = draws.permutation(high) * finer + draws.integers(finer, size=high)
        rest = draws.permutation(np.setdiff1d(np.arange(points), first))
        columns.append((np.concatenate([first, rest]) + draws.random(points)) / points)
    return np.stack(columns, axis=1) if columns else np.zeros((points, 0))


def _closest(rows: NDArray[np.float64]) -> float:
    # Imported here, as in `_space_filling`: most designs do not need SciPy.
    from scipy.spatial.distance import pdist

    return float(pdist(rows).min()) if rows.shape[0] > 1 and rows.shape[1] else 0.0
