"""Quality of a design, whatever method made it: correlations, aliases, discrepancy, coverage of combinations.

Centred discrepancy: Hickernell, F. J. (1998), "A generalized discrepancy and quadrature error bound",
Mathematics of Computation 67(221), 299-322.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.documents import Document

from ._covering_arrays import PartialAssignments, partial_row
from ._design import DesignPoint
from ._factor_space import FactorSpace
from ._factors import INACTIVE, DesignFactor, FactorLevel

# Equal parts of a range without steps, when combinations of levels are counted.
RANGE_PARTS = 3

# Discrepancy and distance take time by the square of the points, and are not computed above this.
MAX_POINTS_FOR_DISTANCE = 2000

MAX_COMBINATIONS = 200_000

SHOWN_CONFIGURATIONS = 20

SHOWN_ALIASES = 8

# Points times two-factor interactions, above which interactions are not measured.
MAX_INTERACTION_TERMS = 5_000_000

TOLERANCE = 1e-9


class Coverage(Document):
    """The number of combinations of levels of any t factors that occur, and of those that can."""

    t: int
    covered: int
    possible: int = Field(description="Without those that are forbidden.")

    @property
    def share(self) -> float:
        return self.covered / self.possible if self.possible else 1.0


class DesignQuality(Document):
    """Quality of the points that are flown, each counted once.

    A number is null when it cannot be computed.
    """

    points: int
    pairs: int = Field(description="Of design point and replicate.")
    max_abs_correlation: float | None = Field(
        None,
        description="The largest absolute Pearson correlation between two factors that are numbers or have two levels.",
    )
    correlated: tuple[str, ...] = ()
    max_association: float | None = Field(
        None,
        description="The largest canonical correlation of a factor of three or more names with another factor; at 1 one "
        "determines the other. With few points part of it is chance.",
    )
    associated: tuple[str, ...] = ()
    max_interaction: float | None = Field(
        None,
        description="The largest absolute correlation of a main effect with an interaction of two, of numbers or two levels.",
    )
    interacting: tuple[str, ...] = ()
    aliased: tuple[str, ...] = Field(
        (),
        description="Main effects and two-factor interactions that results of these points cannot separate.",
    )
    estimable: bool | None = Field(
        None, description="Whether the main effects of all factors can be estimated together."
    )
    discrepancy: float | None = Field(
        None, description="Centred L2 discrepancy of the points in the unit cube, squared; 0 is best."
    )
    min_distance: float | None = Field(
        None,
        description="Of the two closest points, in the unit cube, over its diagonal; 0 where two are the same.",
    )
    coverage: tuple[Coverage, ...] = ()
    configurations: dict[str, int] = Field({}, description="Design points in each difficulty configuration.")
    extendable: bool = Field(
        False, description="Whether more points of the same method leave these as they are."
    )

    def lines(self) -> Iterator[str]:
        """Lines for people to read."""
        if self.max_abs_correlation is not None:
            yield f"largest correlation {self.max_abs_correlation:.3g}{_in_brackets(self.correlated)}"
        if self.max_association is not None:
            yield f"largest association of names {self.max_association:.3g}{_in_brackets(self.associated)}"
        if self.max_interaction is not None:
            pair = _in_brackets(self.interacting)
            yield f"main effects with interactions of two: correlation up to {self.max_interaction:.3g}{pair}"
        if self.aliased:
            rest = len(self.aliased) - SHOWN_ALIASES
            more = [f"and {rest} more"] if rest > 0 else []
            yield f"cannot be separated: {'; '.join([*self.aliased[:SHOWN_ALIASES], *more])}"
        if self.estimable is False:
            yield "there are too few points, or too similar ones, to estimate the main effects of all factors"
        if self.discrepancy is not None and self.min_distance is not None:
            yield f"centred discrepancy {self.discrepancy:.4g}, closest points {self.min_distance:.3g} of the diagonal apart"
        if self.coverage:
            shares = (
                f"{order.covered} of {order.possible} for t = {order.t} ({order.share:.0%})"
                for order in self.coverage
            )
            yield f"combinations of t levels: {', '.join(shares)}"
        for name, count in list(self.configurations.items())[:SHOWN_CONFIGURATIONS]:
            yield f"{count} {'point' if count == 1 else 'points'} in configuration {name}"
        if len(self.configurations) > SHOWN_CONFIGURATIONS:
            yield f"and {len(self.configurations) - SHOWN_CONFIGURATIONS} more configurations"


def _in_brackets(names: Sequence[str]) -> str:
    return f" ({' and '.join(names)})" if names else ""


def design_quality(
    space: FactorSpace,
    points: Sequence[DesignPoint],
    *,
    pairs: int | None = None,
    extendable: bool = False,
    configurations: Sequence[str] = (),
) -> DesignQuality:
    """Measure these points of a design, each flown in some of the `pairs`. `configurations` names the
    difficulty configuration of each point, in their order, where it is known.

    Factors that follow from others are left out. Conditional ones count in correlations where they are
    active, and in discrepancy and distance only where they always are.
    """
    numbers = {
        factor.name: column for factor in space.free if (column := _column(factor, points)) is not None
    }
    columns = {factor.name: block for factor in space.free if (block := _block(factor, points)) is not None}
    largest, pair = _largest(columns, names=False)
    association, associated = _largest(columns, names=True)
    mixed, mixing, aliased = _interactions(numbers)
    cube = [
        column
        for factor in space.free
        if (column := numbers.get(factor.name, _names_column(factor, points))) is not None
    ]
    unit = np.stack(cube, axis=1) if cube else np.zeros((len(points), 0))
    discrepancy = min_distance = None
    if unit.shape[1] > 0 and 2 <= len(points) <= MAX_POINTS_FOR_DISTANCE:
        # Imported here: scipy.stats takes half a second.
        from scipy.spatial.distance import pdist
        from scipy.stats import qmc

        discrepancy = float(qmc.discrepancy(np.clip(unit, 0.0, 1.0), method="CD"))
        min_distance = float(pdist(unit).min() / math.sqrt(unit.shape[1]))
    return DesignQuality(
        points=len(points),
        pairs=len(points) if pairs is None else pairs,
        max_abs_correlation=largest,
        correlated=pair,
        max_association=association,
        associated=associated,
        max_interaction=mixed,
        interacting=mixing,
        aliased=aliased,
        estimable=_estimable(columns),
        discrepancy=discrepancy,
        min_distance=min_distance,
        coverage=tuple(factor for t in (2, 3) if (factor := coverage(space, points, t)) is not None),
        configurations=dict(sorted(Counter(configurations).items())),
        extendable=extendable,
    )


def coverage(space: FactorSpace, points: Sequence[DesignPoint], t: int) -> Coverage | None:
    """How many combinations of t factors' levels occur; None with fewer factors or too many combinations."""
    choices = {levels.name: _parts(levels) for levels in space.free}
    places = list(itertools.combinations(range(len(choices)), t))
    sizes = [len(levels) for levels in choices.values()]
    if not places or sum(math.prod(sizes[at] for at in chosen) for chosen in places) > MAX_COMBINATIONS:
        return None
    rows = [[_part(factor, point.levels[factor.name]) for factor in space.free] for point in points]
    covered = {(chosen, tuple(row[at] for at in chosen)) for row in rows for chosen in places}
    try:
        # Counting needs the same search as covering arrays and can fail in the same way.
        possible = _possible(space, choices, places, sizes)
    # The forbidden combinations are too complex to be counted.
    except ValueError:
        return None
    return Coverage(t=t, covered=len(covered), possible=max(possible, len(covered)))


def _possible(
    space: FactorSpace,
    choices: Mapping[str, Sequence[FactorLevel]],
    places: Sequence[tuple[int, ...]],
    sizes: Sequence[int],
) -> int:
    """The number of allowed combinations. A rule counts only when all its factors have countable levels."""
    counted = {factor.name for factor in space.free if factor.range is None or factor.range.steps is not None}
    rules = [rule for rule in space.rules() if rule.names <= counted]
    possible = PartialAssignments(choices, rules)
    bound, count = set(possible.bound), 0
    for chosen in places:
        if not bound & set(chosen):
            count += math.prod(sizes[at] for at in chosen)
            continue
        for numbers in itertools.product(*(range(sizes[at]) for at in chosen)):
            count += possible(partial_row(sizes, chosen, numbers))
    return count


def _parts(factor: DesignFactor) -> tuple[FactorLevel, ...]:
    counts = factor.range is None or factor.range.steps is not None
    parts: tuple[FactorLevel, ...] = factor.counted() if counts else tuple(range(RANGE_PARTS))
    return (*parts, INACTIVE) if factor.when else parts


def _part(factor: DesignFactor, level: FactorLevel) -> int:
    """The index of a level: its own, that of the nearest step of a range, or of its part of the range."""
    if factor.when and level == INACTIVE:
        return len(_parts(factor)) - 1
    if factor.range is None:
        return factor.levels.index(level)
    # A range holds numbers.
    assert isinstance(level, int | float)
    share = (level - factor.range.low) / (factor.range.high - factor.range.low)
    if factor.range.steps is not None:
        return round(share * (factor.range.steps - 1))
    return min(int(share * RANGE_PARTS), RANGE_PARTS - 1)


def _column(factor: DesignFactor, points: Sequence[DesignPoint]) -> NDArray[np.float64] | None:
    """Levels scaled to [0, 1], for numbers or two levels; None for others and where some are inactive."""
    levels = [point.levels[factor.name] for point in points]
    if factor.when and INACTIVE in levels:
        return None
    numeric = all(
        isinstance(level, int | float) and not isinstance(level, bool) for level in (*levels, *factor.levels)
    )
    if not numeric:
        return _names_column(factor, points) if len(factor.levels) == 2 else None
    values = np.array([float(level) for level in levels])
    low, high = _bounds(factor, values)
    return np.asarray((values - low) / (high - low)) if high > low else None


def _bounds(factor: DesignFactor, values: NDArray[np.float64]) -> tuple[float, float]:
    if factor.range is not None:
        return factor.range.low, factor.range.high
    levels = [float(level) for level in factor.levels] or values.tolist()
    return min(levels, default=0.0), max(levels, default=0.0)


def _names_column(factor: DesignFactor, points: Sequence[DesignPoint]) -> NDArray[np.float64] | None:
    """Indices of levels scaled to [0, 1]; None for a range, for one level, and where some are inactive."""
    if len(factor.levels) < 2 or any(point.levels[factor.name] not in factor.levels for point in points):
        return None
    places = [factor.levels.index(point.levels[factor.name]) for point in points]
    return np.array(places) / (len(factor.levels) - 1)


def _block(factor: DesignFactor, points: Sequence[DesignPoint]) -> NDArray[np.float64] | None:
    """A factor's columns in a main-effects model: one, or for three or more names one less than the names.

    NaN at points where it is inactive; None when it does not vary.
    """
    active = [not (factor.when and point.levels[factor.name] == INACTIVE) for point in points]
    mine = [point for point, is_active in zip(points, active, strict=True) if is_active]
    column = _column(factor, mine)
    if column is None:
        names = list(dict.fromkeys(point.levels[factor.name] for point in mine))[1:]
        within = np.array(
            [[point.levels[factor.name] == name for name in names] for point in mine], dtype=np.float64
        )
    else:
        within = column[:, None]
    if not within.size or not np.ptp(within, axis=0).any():
        return None
    block = np.full((len(points), within.shape[1]), np.nan)
    block[active] = within
    return block


def _largest(
    blocks: Mapping[str, NDArray[np.float64]], *, names: bool
) -> tuple[float | None, tuple[str, ...]]:
    """The largest correlation of two factors where both are active, with or without those of three names."""
    largest: float | None = None
    pair: tuple[str, ...] = ()
    for (name, first), (other_name, second) in itertools.combinations(blocks.items(), 2):
        if (max(first.shape[1], second.shape[1]) > 1) is not names:
            continue
        together = ~np.isnan(first[:, 0]) & ~np.isnan(second[:, 0])
        bases = [_basis(block[together]) for block in (first, second)]
        if min(base.shape[1] for base in bases) == 0:
            continue
        # Nine decimals, so that the rounding noise of an exact 0 is reported as 0.
        correlation = float(round(min(1.0, np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)[0]), 9))
        if largest is None or correlation > largest:
            largest, pair = correlation, (name, other_name) if correlation or names else ()
    return largest, pair


def _basis(block: NDArray[np.float64]) -> NDArray[np.float64]:
    """Orthonormal columns that span a block less its means."""
    if len(block) < 2:
        return np.zeros((len(block), 0))
    vectors, sizes, _ = np.linalg.svd(block - block.mean(axis=0), full_matrices=False)
    return np.asarray(vectors[:, sizes > TOLERANCE * max(1.0, float(sizes.max(initial=0.0)))])


def _units(columns: Mapping[str, NDArray[np.float64]]) -> tuple[list[str], NDArray[np.float64]]:
    """The columns that vary, less their means and of length 1."""
    centred = {name: column - column.mean() for name, column in columns.items() if len(column)}
    varied = {name: column for name, column in centred.items() if np.linalg.norm(column) > TOLERANCE}
    return list(varied), np.array([column / np.linalg.norm(column) for column in varied.values()]).T


def _interactions(
    columns: Mapping[str, NDArray[np.float64]],
) -> tuple[float | None, tuple[str, ...], tuple[str, ...]]:
    """Correlation of main effects with products of two, the largest pair, and the terms that are alike."""
    names, mains = _units(columns)
    pairs = list(itertools.combinations(range(len(names)), 2))
    if len(names) < 3 or len(pairs) * len(mains) > MAX_INTERACTION_TERMS:
        return None, (), ()
    products = {f"{names[one]} x {names[other]}": mains[:, one] * mains[:, other] for one, other in pairs}
    terms, crossed = _units(products)
    if not terms:
        return None, (), ()
    correlations = np.abs(mains.T @ crossed)
    first, second = divmod(int(correlations.argmax()), len(terms))
    largest = float(round(min(1.0, correlations[first, second]), 9))
    groups: dict[bytes, list[str]] = {}
    for name, column in zip([*names, *terms], np.hstack([mains, crossed]).T, strict=True):
        rounded = np.round(column, 6)
        # Adding 0.0 turns -0.0 into 0.0, which has other bytes.
        turned = rounded * np.sign(rounded[int(np.flatnonzero(rounded)[0])]) + 0.0
        groups.setdefault(turned.tobytes(), []).append(name)
    aliased = tuple(" = ".join(group) for group in groups.values() if len(group) > 1)
    return largest, (names[first], terms[second]) if largest else (), aliased


def _estimable(blocks: Mapping[str, NDArray[np.float64]]) -> bool | None:
    """Whether the blocks that are active everywhere, and a constant, are linearly independent."""
    whole = [_basis(block) for block in blocks.values() if not np.isnan(block).any()]
    if not whole:
        return None
    columns = np.hstack(whole)
    return bool(np.linalg.matrix_rank(columns) == columns.shape[1])
