"""The design of an experiment: factors, the combinations of their levels, and the number of repetitions.

Three ids are kept apart: a *design point* (`p017`, one combination of levels), a *replicate* (its n-th
repetition, with seeds of its own) and a *realization* (the one SimSpec that one agent flies,
`p017-r1-reference-naive`).
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Self

from pydantic import Field, model_validator

from bench.documents import Document

from ._covering_arrays import CoveringArray
from ._factor_space import FactorSpace
from ._factorial import FullFactorial, OneByOne
from ._factors import MAX_POINTS, DesignFactor, ExpressionText, FactorLevel, FactorLevels
from ._fractional_factorial import FractionalFactorial
from ._nested_hypercubes import Nested
from ._orthogonal_hypercubes import NearlyOrthogonalLatinHypercube, OrthogonalLatinHypercube
from ._screening import DefinitiveScreening, PlackettBurman
from ._space_filling import Halton, LatinHypercube, Sobol
from ._stratified import Difficulties, Stratified

Method = Annotated[
    FullFactorial
    | OneByOne
    | FractionalFactorial
    | PlackettBurman
    | DefinitiveScreening
    | LatinHypercube
    | OrthogonalLatinHypercube
    | NearlyOrthogonalLatinHypercube
    | Sobol
    | Halton
    | CoveringArray
    | Nested
    | Stratified,
    Field(discriminator="kind"),
]
"""Documents: a campaign gives the `kind` and its options. `combinations(space, seed)` has the points in order, with the levels
of all factors, and raises ValueError with a sentence.
"""

GROWING = (Halton, Sobol, Stratified)
"""Methods of which more points leave the earlier ones as they were."""


@dataclass(frozen=True, slots=True)
class DesignPoint:
    """One combination of levels; `id` numbers the points of a design from p001.

    `scene` is the id of the point whose seeds it takes: its own, or for a point at high fidelity that of its
    low-fidelity twin.
    """

    id: str
    levels: Mapping[str, FactorLevel]
    scene: str = ""

    def __post_init__(self) -> None:
        if not self.scene:
            # The class is frozen, and this default depends on another field.
            object.__setattr__(self, "scene", self.id)


class Design(Document):
    """The situations that are flown: factors, the method that combines them, replicates, and the seed."""

    factors: tuple[DesignFactor, ...] = ()
    forbid: tuple[ExpressionText, ...] = Field(
        (),
        max_length=200,
        description="Combinations that are not flown, for example \"fog > 3 and approach == 'N'\".",
    )
    method: Method = FullFactorial()
    then: tuple[Method, ...] = Field(
        (),
        max_length=20,
        description="Further points, numbered after all earlier ones, which stay as they are.",
    )
    replicates: int = Field(
        1, ge=1, le=10_000, description="Repetitions of each point, each with seeds of its own."
    )
    seed: int = Field(0, ge=0, lt=2**63)

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        twice = [name for name, times in Counter(factor.name for factor in self.factors).items() if times > 1]
        if twice:
            raise ValueError(f"two factors are called {twice[0]!r}")
        combined = any((self.forbid, self.then, not isinstance(self.method, FullFactorial)))
        if combined and not self.factors:
            raise ValueError("the design has no factors to combine")
        if self.factors and not self.space.free:
            raise ValueError("every factor has a formula; give at least one levels or a range")
        counts = [self._count(method, place) * self.replicates for place, method in enumerate(self.methods)]
        for method, pairs in zip(self.methods, counts, strict=True):
            take = method.take if isinstance(method, FullFactorial) else None
            if (take or 0) > pairs:
                raise ValueError(
                    f"take {take} exceeds the {pairs} pairs of design point and replicate; raise replicates or lower take"
                )
        # Counted before anything is drawn, so that a slip in a range does not fill the memory.
        if sum(counts) > MAX_POINTS:
            raise ValueError(
                f"the design has {sum(counts)} pairs of design point and replicate, more than {MAX_POINTS}"
            )
        if not sum(counts):
            raise ValueError("every point is forbidden")
        return self

    @model_validator(mode="after")
    def _has_one_scale(self) -> Self:
        if len(self.scales) > 1:
            raise ValueError("stratified methods of one design have one scale; give them all the same")
        return self

    @property
    def methods(self) -> tuple[Method, ...]:
        """The first method and those of `then`."""
        return (self.method, *self.then)

    @property
    def grows(self) -> bool:
        """Whether points can be added later."""
        return isinstance(self.methods[-1], GROWING)

    @property
    def space(self) -> FactorSpace:
        """The factors as a whole."""
        return FactorSpace(self.factors, self.forbid)

    @property
    def rated(self) -> bool:
        """Whether the points depend on difficulties, so that `points` needs them."""
        return bool(self.scales)

    @property
    def scales(self) -> set[str]:
        """Whose difficulties the points depend on: `published`, `measured`, or neither."""
        return {method.scale for method in self.methods if isinstance(method, Stratified)}

    def points(self, difficulties: Difficulties | None = None) -> list[DesignPoint]:
        """Every design point, in the design's own order; the same for the same document and difficulties."""
        return [point for block in self._blocks(difficulties) for point in block]

    def pairs(self, difficulties: Difficulties | None = None) -> list[tuple[DesignPoint, int]]:
        """The (point, replicate) pairs to fly, ordered by point and replicate, replicates from 1.

        When `take` draws some of them, a pair's rank in the draw depends on the seed and the pair alone: a
        larger `take` keeps those already drawn.
        """
        blocks = zip(self.methods, self._blocks(difficulties), strict=True)
        return [pair for method, block in blocks for pair in self._pairs(method, block)]

    def _blocks(self, difficulties: Difficulties | None) -> list[list[DesignPoint]]:
        if not self.factors:
            return [[DesignPoint("p001", {})]]
        space, number = self.space, 0
        blocks: list[list[DesignPoint]] = []
        for place, method in enumerate(self.methods):
            if isinstance(method, Stratified):
                if difficulties is None:
                    raise ValueError("a stratified design is drawn by difficulty, and no rating was given")
                combinations = method.chosen(space, self._seed(place), difficulties)
            else:
                combinations = method.combinations(space, self._seed(place))
            blocks.append(_numbered(combinations, number, method.twins if isinstance(method, Nested) else ()))
            number += len(combinations)
        return blocks

    def _pairs(self, method: Method, block: Sequence[DesignPoint]) -> list[tuple[DesignPoint, int]]:
        pairs = [(point, replicate) for point in block for replicate in range(1, self.replicates + 1)]
        take = method.take if isinstance(method, FullFactorial) else None
        if take is None:
            return pairs
        # A hash ranks each pair independently of the others, which a random stream would not.
        lot = {
            (point.id, replicate): hashlib.blake2b(f"{self.seed}/{point.id}/{replicate}".encode()).digest()
            for point, replicate in pairs
        }
        drawn = set(sorted(lot, key=lot.__getitem__)[:take])
        return [pair for pair in pairs if (pair[0].id, pair[1]) in drawn]

    def _count(self, method: Method, place: int) -> int:
        if isinstance(method, Stratified):
            return method.points
        if not self.factors:
            return 1
        if isinstance(method, LatinHypercube) and self.space.unconstrained:
            # Optimised, it takes seconds to draw.
            return method.points
        return len(method.combinations(self.space, self._seed(place)))

    def _seed(self, place: int) -> int:
        """The design's seed for its first method, and a derived seed for each further one."""
        if place == 0:
            return self.seed
        return int.from_bytes(hashlib.blake2b(f"{self.seed}/then/{place}".encode()).digest()[:7], "big")


def _numbered(combinations: Sequence[FactorLevels], before: int, twins: Container[int]) -> list[DesignPoint]:
    """Points numbered from `before` + 1. Those at places in `twins` share the scene of the point before them.

    Other points with equal levels get scenes of their own: two flights of one scene would count as two
    trials.
    """
    names = [f"p{number:03d}" for number in range(before + 1, before + 1 + len(combinations))]
    return [
        DesignPoint(name, levels, names[place - 1] if place in twins else name)
        for place, (name, levels) in enumerate(zip(names, combinations, strict=True))
    ]
