"""Designs that find the few factors that matter: two-level fractions, Plackett-Burman, and definitive screening.

Box, G. E. P., Hunter, J. S. and Hunter, W. G. (2005), Statistics for Experimenters, chapter 6 (fractions, resolution). Plackett,
R. L. and Burman, J. P. (1946), "The design of optimum multifactorial experiments", Biometrika 33(4), 305-325. Jones, B. and
Nachtsheim, C. J. (2011), "A class of three-level designs for definitive screening in the presence of second-order effects",
Journal of Quality Technology 43(1), 1-15; from conference matrices: Xiao, L., Lin, D. K. J. and Bai, F. (2012), the same journal
44(1), 2-8. Paley, R. E. A. C. (1933), "On orthogonal matrices", Journal of Mathematics and Physics 12, 311-320.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from bench.arrays import Counts
from bench.documents import Document
from bench.simspec import Identifier

from ._factors import Factor, Level, Levels, Space

MOST_RUNS = 4096
MOST_TRIED = 20_000
"""Columns that the search for a fraction looks at before it takes more runs instead."""
LARGEST = 100


class FractionalFactorial(Document):
    """A regular fraction of the two-level full factorial: by resolution, by runs, or by its generators.

    Resolution III keeps main effects apart from each other, IV also from interactions of two, V those from each other too.
    """

    grows: ClassVar[bool] = False
    kind: Literal["fractional_factorial"] = "fractional_factorial"
    resolution: Annotated[int | None, Field(ge=3, le=8, description="The least runs that have at least this resolution.")] = None
    runs: Annotated[
        int | None, Field(ge=4, le=MOST_RUNS, description="A power of two; the best resolution that the search finds.")
    ] = None
    generators: Annotated[
        dict[Identifier, tuple[Identifier, ...]],
        Field(description="For each factor that is not a base one: the base factors whose product it is."),
    ] = {}

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.resolution is not None) + (self.runs is not None) + bool(self.generators) != 1:
            raise ValueError("give one of resolution, runs and generators")
        if self.runs is not None and self.runs & (self.runs - 1):
            raise ValueError(f"runs {self.runs} is no power of two")
        return self

    def combinations(self, space: Space, seed: int) -> list[Levels]:
        del seed
        return space.every(_two_level(space.free, _signs_of(self._columns([one.name for one in space.free]))), self.kind)

    def _columns(self, names: Sequence[str]) -> tuple[int, ...]:
        """Each factor's column as the set of base factors whose product it is, a bit each."""
        if self.generators:
            return _generated(names, self.generators)
        if self.resolution is not None:
            return fraction(len(names), self.resolution)
        assert self.runs is not None  # one of the three is given
        bases = self.runs.bit_length() - 1
        if len(names) <= bases:
            raise ValueError(
                f"{len(names)} factors have {2 ** len(names)} combinations, no more than runs {self.runs}; use full_factorial"
            )
        for resolution in range(8, 2, -1):
            if found := _search(len(names), bases, resolution):
                return found
        raise ValueError(f"{self.runs} runs carry at most {self.runs - 1} factors, not {len(names)}")


class PlackettBurman(Document):
    """Two levels of up to N - 1 factors in N runs, N a multiple of four; with `foldover` also every run mirrored.

    Main effects are apart from each other; interactions of two blur into them, unless folded over.
    """

    grows: ClassVar[bool] = False
    kind: Literal["plackett_burman"] = "plackett_burman"
    foldover: Annotated[bool, Field(description="Fly each run mirrored too: twice the runs, main effects free of pairs.")] = False

    def combinations(self, space: Space, seed: int) -> list[Levels]:
        del seed
        signs = plackett_burman(len(space.free))
        return space.every(_two_level(space.free, np.vstack([signs, -signs]) if self.foldover else signs), self.kind)


class DefinitiveScreening(Document):
    """Three levels (low, middle, high) of k factors in about 2 k + 1 runs: main effects apart from all second-order effects."""

    grows: ClassVar[bool] = False
    kind: Literal["definitive_screening"] = "definitive_screening"

    def combinations(self, space: Space, seed: int) -> list[Levels]:
        del seed
        levels = [_three(factor) for factor in space.free]
        rows = definitive_screening(len(levels))
        names = [factor.name for factor in space.free]
        points = [{name: three[sign + 1] for name, three, sign in zip(names, levels, row, strict=True)} for row in rows.tolist()]
        return space.every(points, self.kind)


def fraction(factors: int, resolution: int) -> tuple[int, ...]:
    """The columns of the smallest fraction found with at least this resolution; all base factors where only the whole has it."""
    for bases in range(2, factors):
        if found := _search(factors, bases, resolution):
            return found
    return tuple(1 << place for place in range(factors))


def plackett_burman(factors: int) -> Counts:
    """The smallest design of this kind for so many factors, as -1 and +1; the last run is all -1."""
    if factors >= LARGEST:
        raise ValueError(f"a plackett_burman takes at most {LARGEST - 1} factors here, not {factors}")
    for runs in range(4 * (factors // 4 + 1), 2 * LARGEST, 4):
        if (square := _hadamard(runs)) is not None:
            return -(square[:, 1:] * square[:, :1])[:, :factors]
    raise AssertionError("a Hadamard matrix of a power of two is always there")


def definitive_screening(factors: int) -> Counts:
    """The design as -1, 0 and +1: a conference matrix, its mirror image, and the centre."""
    if not 3 <= factors <= LARGEST:
        raise ValueError(f"a definitive_screening takes 3 to {LARGEST} factors, not {factors}")
    order = factors + factors % 2
    while (square := conference_matrix(order)) is None:
        order += 2
    kept = square[:, :factors]
    return np.vstack([kept, -kept, np.zeros((1, factors), dtype=np.int64)])


def conference_matrix(order: int) -> Counts | None:
    """C with 0 on the diagonal, -1 and +1 elsewhere, C'C = (order - 1) I; None where this construction has none."""
    field = _field(order - 1)
    if field is not None:
        border = 1 if (order - 1) % 4 == 1 else -1
        square = np.ones((order, order), dtype=np.int64)
        square[0, 0], square[1:, 0], square[1:, 1:] = 0, border, field
        return square
    half = conference_matrix(order // 2) if order % 4 == 0 else None
    if half is None or not np.array_equal(half.T, -half):
        return None
    unit = np.eye(order // 2, dtype=np.int64)
    return np.block([[half, half + unit], [half - unit, -half]])


def _hadamard(order: int) -> Counts | None:
    """A Hadamard matrix, first row and column +1 up to sign; None where neither Paley nor doubling gives one.

    From Paley's first kind the rest of it is cyclic, with the rows that Plackett and Burman printed for 8, 12, 20 and 24 runs.
    """
    if order in (1, 2):
        return np.array([[1, 1], [1, -1]], dtype=np.int64)[:order, :order]
    prime = order - 1
    if prime % 4 == 3 and _is_prime(prime):
        square = np.ones((order, order), dtype=np.int64)
        residues = _quadratic(prime)
        residues[0] = 1
        square[:-1, 1:] = -np.array([np.roll(residues, turn) for turn in range(prime)])
        return square
    if order % 2 == 0 and (half := _hadamard(order // 2)) is not None:
        return np.block([[half, half], [half, -half]])
    field = _field(order // 2 - 1) if order % 4 == 0 and (order // 2 - 1) % 4 == 1 else None
    if field is None:
        return None
    core = np.pad(field, ((1, 0), (1, 0)), constant_values=1)
    core[0, 0] = 0
    unit = np.eye(order // 2, dtype=np.int64)
    return np.block([[core + unit, core - unit], [core - unit, -core - unit]])


def _field(size: int) -> Counts | None:
    """Jacobsthal's matrix of the field with so many elements, a prime or a prime's square: +1 where a difference is a square."""
    if size % 2 == 1 and _is_prime(size):
        signs = _quadratic(size)
        return np.array([[signs[(one - other) % size] for one in range(size)] for other in range(size)])
    root = round(size**0.5)
    if root * root != size or root == 2 or not _is_prime(root):
        return None
    return _square_field(root)


def _square_field(prime: int) -> Counts:
    """As `_field`, for pairs a + b x over a prime's field with x x = n, n no square there."""
    residues = _quadratic(prime)
    odd = next(n for n in range(2, prime) if residues[n] < 0)
    pairs = list(itertools.product(range(prime), repeat=2))
    squares = {((a * a + odd * b * b) % prime, 2 * a * b % prime) for a, b in pairs if (a, b) != (0, 0)}

    def sign(a: int, b: int) -> int:
        return 0 if (a, b) == (0, 0) else 1 if (a, b) in squares else -1

    return np.array([[sign((a - c) % prime, (b - d) % prime) for a, b in pairs] for c, d in pairs], dtype=np.int64)


def _quadratic(prime: int) -> Counts:
    """For each remainder 0, or +1 where it is a square, else -1."""
    signs = np.full(prime, -1, dtype=np.int64)
    signs[[n * n % prime for n in range(1, prime)]] = 1
    signs[0] = 0
    return signs


def _is_prime(number: int) -> bool:
    return number > 1 and all(number % factor for factor in range(2, int(number**0.5) + 1))


@lru_cache(maxsize=64)
def _search(factors: int, bases: int, resolution: int) -> tuple[int, ...] | None:
    """Columns of a fraction in 2**bases runs; None where none is found.

    It has the resolution where no fewer columns multiply to a constant: a new one may not be a product of up to
    resolution - 2 that are there.
    """
    if factors > 2**bases - 1:
        return None
    order = sorted(range(1, 2**bases), key=lambda one: (-one.bit_count(), one))
    start = [1 << place for place in range(bases)]
    tried = itertools.count(1)

    def further(columns: list[int], reached: list[set[int]], place: int) -> list[int] | None:
        if len(columns) == factors:
            return columns
        for at in range(place, len(order)):
            if len(order) - at < factors - len(columns) or next(tried) > MOST_TRIED:
                return None
            if not any(order[at] in products for products in reached):
                found = further([*columns, order[at]], _extended(reached, order[at]), at + 1)
                if found:
                    return found
        return None

    reached: list[set[int]] = [{0}, *(set() for _ in range(resolution - 2))]
    for column in start:
        reached = _extended(reached, column)
    found = further(start, reached, 0)
    if not found and resolution == 4 and factors <= 2 ** (bases - 1):
        # Columns of odd weight: an odd number of them never multiplies to a constant, nor do two that differ.
        found = [*start, *(one for one in order if one.bit_count() % 2 and one not in start)][:factors]
    return tuple(found) if found else None


def _extended(reached: list[set[int]], column: int) -> list[set[int]]:
    """Products of n columns, for each n, once there is another column."""
    return [reached[0], *(have | {one ^ column for one in fewer} for fewer, have in itertools.pairwise(reached))]


def _generated(names: Sequence[str], generators: Mapping[str, Sequence[str]]) -> tuple[int, ...]:
    bases = [name for name in names if name not in generators]
    for name, words in generators.items():
        strange = next((one for one in (name, *words) if one not in names or (one != name and one not in bases)), None)
        if strange is not None:
            raise ValueError(
                f"generators: {name!r} from {list(words)}: {strange!r} is no {'base ' if strange in names else ''}factor"
            )
        if len(set(words)) != len(words) or len(words) < 2:
            raise ValueError(f"generators: {name!r} needs at least two base factors, each once")
    if 2 ** len(bases) > MOST_RUNS:
        raise ValueError(f"{len(bases)} base factors make {2 ** len(bases)} runs, more than {MOST_RUNS}")
    place = {name: 1 << at for at, name in enumerate(bases)}
    columns = tuple(sum(place[one] for one in generators.get(name, (name,))) for name in names)
    twice = next((name for at, name in enumerate(names) if columns[at] in columns[:at]), None)
    if twice is not None:
        raise ValueError(f"generators: {twice!r} has the same column as another factor, so their effects could not be told apart")
    return columns


def _signs_of(columns: Sequence[int]) -> Counts:
    """The runs of a fraction: base factors in standard order, the last one changing fastest."""
    bases = max(columns).bit_length()
    base = [one for one in columns if one.bit_count() == 1]
    place = {one: bases - 1 - at for at, one in enumerate(sorted(base))}
    runs = np.arange(2**bases)
    raised = {one: 2 * (runs >> place[one] & 1) - 1 for one in base}
    return np.stack([_product(raised, one) for one in columns], axis=1)


def _product(raised: Mapping[int, Counts], column: int) -> Counts:
    return np.asarray(np.prod([raised[one] for one in _bits(column)], axis=0), dtype=np.int64)


def _bits(column: int) -> Iterator[int]:
    return (1 << place for place in range(column.bit_length()) if column >> place & 1)


def _two_level(factors: Sequence[Factor], signs: Counts) -> list[Levels]:
    ends = [factor.ends() for factor in factors]
    names = [factor.name for factor in factors]
    return [{name: end[sign > 0] for name, end, sign in zip(names, ends, row, strict=True)} for row in signs.tolist()]


def _three(factor: Factor) -> tuple[Level, ...]:
    if factor.range is not None:
        if factor.range.integer and (factor.range.low + factor.range.high) % 2:
            raise ValueError(f"factor {factor.name!r}: no whole number is in the middle of its range; move an end by one")
        return tuple(factor.range.at(share) for share in (0.0, 0.5, 1.0))
    numbers = [one for one in factor.levels if isinstance(one, int | float) and not isinstance(one, bool)]
    if len(factor.levels) != 3 or len(numbers) != 3:
        raise ValueError(f"factor {factor.name!r}: a definitive_screening takes a range or three numbers")
    return tuple(sorted(numbers))
