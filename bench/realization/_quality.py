"""How good a design is, whatever made it: what its points say about factors, and which situations they reach.

Centred discrepancy: Hickernell, F. J. (1998), "A generalized discrepancy and quadrature error bound", Mathematics of Computation
67(221), 299-322.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.documents import Document

from ._covering import Possible
from ._design import DesignPoint
from ._factors import INACTIVE, Factor, Level, Space

PARTS = 3
"""A range without steps counts as so many equal parts where combinations of levels are counted."""
MOST_POINTS = 2000
"""More points than this are not measured for discrepancy and distance, whose work grows with their square."""
MOST_COMBINATIONS = 200_000
MOST_SHOWN = 20


class Coverage(Document):
    """How many combinations of levels of any t factors occur, of those that may."""

    t: int
    covered: int
    possible: Annotated[int, Field(description="Without those that are forbidden.")]

    @property
    def share(self) -> float:
        return self.covered / self.possible if self.possible else 1.0


class DesignQuality(Document):
    """Of the points of a design that are flown, each once. A number is null where it cannot be had."""

    points: int
    pairs: Annotated[int, Field(description="Of design point and replicate.")]
    max_abs_correlation: Annotated[
        float | None,
        Field(description="The largest absolute Pearson correlation between two factors that are numbers or have two levels."),
    ] = None
    correlated: tuple[str, ...] = ()
    discrepancy: Annotated[
        float | None, Field(description="Centred L2 discrepancy of the points in the unit cube, squared; 0 is best.")
    ] = None
    min_distance: Annotated[
        float | None,
        Field(description="Of the two closest points, in the unit cube, over its diagonal; 0 where two are the same."),
    ] = None
    coverage: tuple[Coverage, ...] = ()
    configurations: Annotated[dict[str, int], Field(description="Design points in each difficulty configuration.")] = {}
    extendable: Annotated[bool, Field(description="Whether more points of the same method leave these as they are.")] = False

    def lines(self) -> Iterator[str]:
        """What a person reads."""
        if self.max_abs_correlation is not None:
            between = f" ({' and '.join(self.correlated)})" if self.correlated else ""
            yield f"largest correlation {self.max_abs_correlation:.3g}{between}"
        if self.discrepancy is not None and self.min_distance is not None:
            yield f"centred discrepancy {self.discrepancy:.4g}, closest points {self.min_distance:.3g} of the diagonal apart"
        if self.coverage:
            told = (f"{one.covered} of {one.possible} for t = {one.t} ({one.share:.0%})" for one in self.coverage)
            yield f"combinations of t levels: {', '.join(told)}"
        for name, count in list(self.configurations.items())[:MOST_SHOWN]:
            yield f"{count} {'point' if count == 1 else 'points'} in configuration {name}"
        if len(self.configurations) > MOST_SHOWN:
            yield f"and {len(self.configurations) - MOST_SHOWN} more configurations"


def design_quality(
    space: Space,
    points: Sequence[DesignPoint],
    *,
    pairs: int | None = None,
    extendable: bool = False,
    configurations: Sequence[str] = (),
) -> DesignQuality:
    """Measure these points of a design, each flown in some of the `pairs`. `configurations` names the difficulty configuration of each point, in their order, where it is known.

    Factors that follow from others are left out, and so are conditional ones that are inactive in some point.
    """
    numbers = {one.name: column for one in space.free if (column := _column(one, points)) is not None}
    largest, pair = _correlation(numbers)
    cube = [column for one in space.free if (column := numbers.get(one.name, _names_column(one, points))) is not None]
    unit = np.stack(cube, axis=1) if cube else np.zeros((len(points), 0))
    measured = unit.shape[1] > 0 and 2 <= len(points) <= MOST_POINTS
    return DesignQuality(
        points=len(points),
        pairs=len(points) if pairs is None else pairs,
        max_abs_correlation=largest,
        correlated=pair,
        discrepancy=_discrepancy(unit) if measured else None,
        min_distance=_min_distance(unit) if measured else None,
        coverage=tuple(one for t in (2, 3) if (one := coverage(space, points, t)) is not None),
        configurations=dict(sorted(Counter(configurations).items())),
        extendable=extendable,
    )


def coverage(space: Space, points: Sequence[DesignPoint], t: int) -> Coverage | None:
    """How many of the combinations of t factors' levels occur; None where there are fewer factors, or too many combinations."""
    choices = {one.name: _parts(one) for one in space.free}
    places = list(itertools.combinations(range(len(choices)), t))
    sizes = [len(one) for one in choices.values()]
    if not places or sum(math.prod(sizes[at] for at in some) for some in places) > MOST_COMBINATIONS:
        return None
    rows = [[_part(factor, point.levels[factor.name]) for factor in space.free] for point in points]
    covered = {(some, tuple(row[at] for at in some)) for row in rows for some in places}
    try:
        possible = _possible(space, choices, places, sizes)
    except ValueError:  # what is forbidden is too tangled to be counted
        return None
    return Coverage(t=t, covered=len(covered), possible=max(possible, len(covered)))


def _possible(
    space: Space, choices: Mapping[str, Sequence[Level]], places: Sequence[tuple[int, ...]], sizes: Sequence[int]
) -> int:
    """Rules are asked of levels, so they count only where every factor that they name has levels to count."""
    counted = {one.name for one in space.free if one.range is None or one.range.steps is not None}
    rules = [rule for rule in space.rules() if rule.names <= counted]
    possible = Possible(choices, rules)
    bound, count = set(possible.bound), 0
    for some in places:
        if not bound & set(some):
            count += math.prod(sizes[at] for at in some)
            continue
        for numbers in itertools.product(*(range(sizes[at]) for at in some)):
            row = [-1] * len(sizes)
            for at, number in zip(some, numbers, strict=True):
                row[at] = number
            count += possible(row)
    return count


def _parts(factor: Factor) -> tuple[Level, ...]:
    counts = factor.range is None or factor.range.steps is not None
    parts: tuple[Level, ...] = factor.counted() if counts else tuple(range(PARTS))
    return (*parts, INACTIVE) if factor.when else parts


def _part(factor: Factor, level: Level) -> int:
    """The number of a level among those counted: itself, or the nearest of a range's steps, or the part that it lies in."""
    if factor.when and level == INACTIVE:
        return len(_parts(factor)) - 1
    if factor.range is None:
        return factor.levels.index(level)
    assert isinstance(level, int | float)  # a range holds numbers
    share = (level - factor.range.low) / (factor.range.high - factor.range.low)
    if factor.range.steps is not None:
        return round(share * (factor.range.steps - 1))
    return min(int(share * PARTS), PARTS - 1)


def _column(factor: Factor, points: Sequence[DesignPoint]) -> NDArray[np.float64] | None:
    """A factor's levels on [0, 1] of its range, where they are numbers or two; None where it is neither, or off somewhere."""
    levels = [point.levels[factor.name] for point in points]
    if factor.when and INACTIVE in levels:
        return None
    numeric = all(isinstance(one, int | float) and not isinstance(one, bool) for one in (*levels, *factor.levels))
    if not numeric:
        return _names_column(factor, points) if len(factor.levels) == 2 else None
    values = np.array([float(one) for one in levels])
    low, high = _bounds(factor, values)
    return np.asarray((values - low) / (high - low)) if high > low else None


def _bounds(factor: Factor, values: NDArray[np.float64]) -> tuple[float, float]:
    if factor.range is not None:
        return factor.range.low, factor.range.high
    known = [float(one) for one in factor.levels] or values.tolist()
    return min(known, default=0.0), max(known, default=0.0)


def _names_column(factor: Factor, points: Sequence[DesignPoint]) -> NDArray[np.float64] | None:
    """The places of a factor's levels among them all, evenly on [0, 1]; None for a range, one level, or one that is off."""
    if len(factor.levels) < 2 or any(point.levels[factor.name] not in factor.levels for point in points):
        return None
    return np.array([factor.levels.index(point.levels[factor.name]) for point in points]) / (len(factor.levels) - 1)


def _correlation(columns: Mapping[str, NDArray[np.float64]]) -> tuple[float | None, tuple[str, ...]]:
    varied = {name: column - column.mean() for name, column in columns.items() if len(column) and np.ptp(column) > 0.0}
    if len(varied) < 2:
        return None, ()
    rows = np.stack([column / np.linalg.norm(column) for column in varied.values()])
    found = np.abs(np.triu(rows @ rows.T, 1))
    first, second = divmod(int(found.argmax()), len(varied))
    names = list(varied)
    # What is left of an exact 0 after rounding is below what is told.
    largest = float(round(min(1.0, found[first, second]), 9))
    return largest, (names[first], names[second]) if largest else ()


def _discrepancy(unit: NDArray[np.float64]) -> float:
    from scipy.stats import qmc  # half a second to import

    return float(qmc.discrepancy(np.clip(unit, 0.0, 1.0), method="CD"))


def _min_distance(unit: NDArray[np.float64]) -> float:
    from scipy.spatial.distance import pdist

    return float(pdist(unit).min() / math.sqrt(unit.shape[1]))
