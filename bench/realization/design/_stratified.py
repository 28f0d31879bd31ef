"""Stratified designs: points spread evenly over difficulty configurations, whichever levels produce them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document

from ._factor_space import FactorSpace
from ._factors import FactorLevel, FactorLevels
from ._space_filling import halton_shares

Difficulties = Callable[[Mapping[str, FactorLevel]], Mapping[str, float | None]]
"""The difficulties of the studied nodes, by their names, in the situation that the levels produce; None
where a node has no difficulty there.
"""

DECIMALS = 6


class Stratified(Document):
    """The same number of points, as nearly as may be, from every possible difficulty configuration.

    Candidates come from a Halton sequence; each is rated as it would be flown, and configurations take turns. Points added later leave the earlier ones unchanged.
    """

    kind: Literal["stratified"] = "stratified"
    points: int = Field(ge=1, le=10_000)
    candidates: int = Field(
        1000,
        ge=10,
        le=20_000,
        description="Situations that are rated to draw from; not to be changed when points are added.",
    )
    band: float | None = Field(
        None,
        gt=0.0,
        le=100.0,
        description="Width of the difficulties that count as one; 20 is a tension. Exact when absent.",
    )
    scale: Literal["published", "measured"] = Field(
        "published",
        description="Whose difficulties: the published ratings, or the measured scale (docs/calibration.md), with the places of the "
        "base's own seed.",
    )
    above: float | None = Field(
        None, ge=0.0, lt=100.0, description="Only what is harder than this for every studied node."
    )
    up_to: float | None = Field(
        None, gt=0.0, le=100.0, description="Only what is at most so hard for every studied node."
    )

    @model_validator(mode="after")
    def _range_is_not_empty(self) -> Self:
        if self.above is not None and self.up_to is not None and self.above >= self.up_to:
            raise ValueError(
                f"nothing is above {self.above:g} and up to {self.up_to:g}; give above the smaller number"
            )
        return self

    def chosen(self, space: FactorSpace, seed: int, difficulties: Difficulties) -> list[FactorLevels]:
        """The points.

        Raises ValueError where there are more configurations than points, or too few candidates.
        """
        strata: dict[tuple[object, ...], list[FactorLevels]] = {}
        sequence = space.first(map(space.at, halton_shares(len(space.free), seed)), self.candidates)
        # Halton points can round to equal levels; a stratum must not contain one point twice.
        for levels in {tuple(levels.items()): levels for levels in sequence}.values():
            rated = difficulties(levels)
            if self._is_wanted(rated):
                bands = tuple(None if item is None else self._band(item) for item in rated.values())
                strata.setdefault(bands, []).append(levels)
        if len(strata) > self.points:
            raise ValueError(
                f"the candidates fall into {len(strata)} difficulty configurations, more than points {self.points}; raise points, "
                "or give band (20 is a tension), the width of difficulties that count as one"
            )
        # A point of each stratum in turn.
        turns = itertools.zip_longest(*strata.values())
        drawn = [levels for turn in turns for levels in turn if levels is not None][: self.points]
        if len(drawn) < self.points:
            raise ValueError(
                f"only {len(drawn)} different points{self._range_text()} are among the candidates; lower points or raise candidates"
            )
        return drawn

    def _is_wanted(self, difficulties: Mapping[str, float | None]) -> bool:
        if self.above is None and self.up_to is None:
            return True
        low, high = self.above or 0.0, 100.0 if self.up_to is None else self.up_to
        # As with tensions, an edge belongs to the easier side; nothing is easier than 0.
        return all(
            difficulty is not None and (low < difficulty or low == 0.0) and difficulty <= high
            for difficulty in difficulties.values()
        )

    def _range_text(self) -> str:
        low = "" if self.above is None else f" above {self.above:g}"
        return low + ("" if self.up_to is None else f" up to {self.up_to:g}")

    def _band(self, difficulty: float) -> float:
        rounded = round(difficulty, DECIMALS)
        # As with tensions, an edge belongs to the easier band.
        return rounded if self.band is None else max(1, -int(-rounded // self.band))
