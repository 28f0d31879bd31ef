"""Designs that find the few factors that matter: Plackett-Burman and definitive screening.

Box, G. E. P., Hunter, J. S. and Hunter, W. G. (2005), Statistics for Experimenters, chapter 6 (fractions,
resolution). Plackett, R. L. and Burman, J. P. (1946), "The design of optimum multifactorial experiments",
Biometrika 33(4), 305-325. Jones, B. and Nachtsheim, C. J. (2011), "A class of three-level designs for
definitive screening in the presence of second-order effects", Journal of Quality Technology 43(1), 1-15; from
conference matrices: Xiao, L., Lin, D. K. J. and Bai, F. (2012), the same journal 44(1), 2-8. Paley, R. E. A.
C. (1933), "On orthogonal matrices", Journal of Mathematics and Physics 12, 311-320.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from bench.arrays import Counts
from bench.documents import Document

from ._factor_space import FactorSpace
from ._factors import DesignFactor, FactorLevel, FactorLevels
from ._fractional_factorial import points_at, two_level_points
from ._hadamard import conference_matrix, hadamard_matrix

# Chosen, not measured.
MAX_FACTORS = 100


class PlackettBurman(Document):
    """Two levels of up to N - 1 factors in N runs, a multiple of four; with `foldover` mirrored too.

    Main effects are orthogonal; interactions of two factors are confounded with them, unless the design is
    folded over.
    """

    kind: Literal["plackett_burman"] = "plackett_burman"
    foldover: bool = Field(
        False, description="Fly each run mirrored too: twice the runs, main effects free of pairs."
    )

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        del seed
        signs = plackett_burman(len(space.free))
        signs = np.vstack([signs, -signs]) if self.foldover else signs
        return space.every(two_level_points(space.free, signs), self.kind)


class DefinitiveScreening(Document):
    """Three levels of k factors in about 2 k + 1 runs: main effects apart from all of second order."""

    kind: Literal["definitive_screening"] = "definitive_screening"

    def combinations(self, space: FactorSpace, seed: int) -> list[FactorLevels]:
        del seed
        levels = [_three_levels(factor) for factor in space.free]
        points = points_at(space.free, levels, definitive_screening(len(levels)) + 1)
        return space.every(points, self.kind)


def plackett_burman(factors: int) -> Counts:
    """The smallest design of this kind for so many factors, as -1 and +1; the last run is all -1."""
    if factors >= MAX_FACTORS:
        raise ValueError(f"a plackett_burman takes at most {MAX_FACTORS - 1} factors here, not {factors}")
    for runs in range(4 * (factors // 4 + 1), 2 * MAX_FACTORS, 4):
        # A power of two always has a construction, and there is one below twice the start.
        if (square := hadamard_matrix(runs)) is not None:
            # The first column, made constant, would be the mean; the others are balanced against it.
            return -(square[:, 1:] * square[:, :1])[:, :factors]
    raise AssertionError("a Hadamard matrix of a power of two is always there")


def definitive_screening(factors: int) -> Counts:
    """The design as -1, 0 and +1: a conference matrix, its mirror image, and the centre."""
    if not 3 <= factors <= MAX_FACTORS:
        raise ValueError(f"a definitive_screening takes 3 to {MAX_FACTORS} factors, not {factors}")
    order = factors + factors % 2
    # Conference matrices have even orders, and none exists for some of them, such as 22 and 34.
    while (square := conference_matrix(order)) is None:
        order += 2
    columns = square[:, :factors]
    return np.vstack([columns, -columns, np.zeros((1, factors), dtype=np.int64)])


def _three_levels(factor: DesignFactor) -> tuple[FactorLevel, ...]:
    if factor.range is not None:
        # The middle level must be half way, or linear and quadratic effects mix.
        if factor.range.integer and (factor.range.low + factor.range.high) % 2:
            raise ValueError(
                f"factor {factor.name!r}: no whole number is in the middle of its range; move an end by one"
            )
        return tuple(factor.range.at(share) for share in (0.0, 0.5, 1.0))
    numbers = [
        level for level in factor.levels if isinstance(level, int | float) and not isinstance(level, bool)
    ]
    if len(factor.levels) != 3 or len(numbers) != 3:
        raise ValueError(f"factor {factor.name!r}: a definitive_screening takes a range or three numbers")
    return tuple(sorted(numbers))
