"""Factors of a design: levels, ranges, formulas, and the fields of a SimSpec that they set."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from bench.documents import Document
from bench.simspec import Identifier

from ._expression import MAX_CHARACTERS, parse_expression

MAX_POINTS = 100_000

FactorLevel = bool | int | float | str

FactorLevels = dict[str, FactorLevel]

# The level of a conditional factor in a point whose other levels do not switch it on: it changes nothing.
INACTIVE = "inactive"

BASE = "base"
"""The path of the whole base SimSpec: the levels of the factor that sets it are names of situations."""

ExpressionText = Annotated[str, Field(min_length=1, max_length=MAX_CHARACTERS)]


class FactorRange(Document):
    """Values between two bounds, both included."""

    low: float
    high: float
    steps: int | None = Field(
        None, ge=2, le=1000, description="Evenly spaced levels for designs that count levels, ends included."
    )
    integer: bool = Field(False, description="Round to whole numbers.")

    @model_validator(mode="after")
    def _rises(self) -> Self:
        if self.high <= self.low:
            raise ValueError(f"high {self.high} must exceed low {self.low}")
        if self.integer and not (self.low.is_integer() and self.high.is_integer()):
            raise ValueError(f"low {self.low} and high {self.high} of whole numbers must be whole")
        if self.integer and self.steps is not None and self.steps > self.high - self.low + 1:
            raise ValueError(
                f"there are {self.high - self.low + 1:.0f} whole numbers from low to high, fewer than steps {self.steps}"
            )
        return self

    def at(self, share: float) -> float | int:
        """The value at a share of the range: 0 is low, 1 is high."""
        value = self.low + share * (self.high - self.low)
        # The ends then get half the share of other numbers; `drawn` is for random shares.
        return round(value) if self.integer else value

    def drawn(self, share: float) -> float | int:
        """As `at`, for a random share: all whole numbers are equally likely, the ends included."""
        if not self.integer:
            return self.at(share)
        count = int(self.high - self.low) + 1
        return int(self.low) + min(int(share * count), count - 1)


class DesignFactor(Document):
    """A factor of a design: levels, a range or a formula, and the fields of the SimSpec that take its value.

    `sets` are paths that all take the level's value itself; `patches` give, for a level by name, other values
    for paths (an approach of N, E, S or W that moves the vehicle's home).
    """

    name: Identifier
    unit: str | None = Field(None, description="Checked against the unit that the paths' names state.")
    levels: tuple[FactorLevel, ...] = Field((), max_length=1000)
    range: FactorRange | None = None
    formula: ExpressionText | None = Field(
        None, description="The level follows from other factors, for example 'crowd * 0.05 + 2'."
    )
    integer: bool = Field(False, description="Round what the formula gives to whole numbers.")
    when: ExpressionText | None = Field(
        None, description="Active only where this holds of other factors; elsewhere it changes nothing."
    )
    sets: tuple[str, ...] = ()
    patches: dict[str, dict[str, Any]] = {}

    @model_validator(mode="after")
    def _varies_something(self) -> Self:
        twice = [level for level, times in Counter(self.levels).items() if times > 1]
        ends = f"low: {self.range.low:g}, high: {self.range.high:g}" if self.range else ""
        # As text: keys in YAML and JSON are text, levels may be numbers.
        unlike = set(self.patches) != set(map(str, self.levels))
        alone = len(self.sets) == 1 and not self.patches and self.when is None
        for is_wrong, text in (
            (
                bool(self.levels) + (self.range is not None) + (self.formula is not None) != 1,
                ": give either levels (at least one) or range or formula",
            ),
            (twice, f": level {[*twice, None][0]!r} stands twice (numbers that are equal are one level)"),
            (
                not self.sets + tuple(self.patches),
                " changes nothing; give sets (paths into the SimSpec) or patches",
            ),
            (
                self.patches and unlike,
                f": patches {sorted(self.patches)} must name exactly the levels {list(self.levels)}",
            ),
            (
                self.formula is not None and self.when is not None,
                ": give formula or when; a formula may say `a if condition else b`",
            ),
            (
                self.integer and self.range is not None,
                f": integer stands beside the range; write it inside: range: {{{ends}, integer: true}}",
            ),
            (
                self.integer and self.formula is None,
                ": integer is for a formula; levels are taken as they are written, so leave it out",
            ),
            (
                self.chooses_base and not alone,
                f" sets {BASE}, the whole situation, so it takes no other path, no patches and no when",
            ),
            (
                self.when is not None and INACTIVE in self.levels,
                f": the level {INACTIVE!r} means that its `when` does not hold; name it otherwise",
            ),
        ):
            if is_wrong:
                raise ValueError(f"factor {self.name!r}{text}")
        for expression in (self.formula, self.when):
            if expression is not None:
                parse_expression(expression)
        return self

    @property
    def chooses_base(self) -> bool:
        """Whether its levels are names of situations, each a base SimSpec of its own."""
        return BASE in self.sets

    def counted(self) -> tuple[FactorLevel, ...]:
        """The levels one by one. Raises ValueError for a range without steps."""
        if self.range is None:
            return self.levels
        if self.range.steps is None:
            raise ValueError(
                f"factor {self.name!r} is a range; this design counts levels: give levels or range.steps"
            )
        values = (self.range.at(step / (self.range.steps - 1)) for step in range(self.range.steps))
        # To 12 digits: 0.3 instead of 0.30000000000000004, so that `forbid` with 0.3 matches it.
        return tuple(float(f"{value:.12g}") if isinstance(value, float) else value for value in values)

    def ends(self) -> tuple[FactorLevel, FactorLevel]:
        """Its two levels, or the ends of its range. Raises ValueError for any other number of levels."""
        if self.range is not None:
            return self.range.at(0.0), self.range.at(1.0)
        if len(self.levels) != 2:
            raise ValueError(
                f"factor {self.name!r} has {len(self.levels)} levels; this design takes two, or the ends of a range"
            )
        return self.levels[0], self.levels[1]

    def at(self, share: float) -> FactorLevel:
        """The level at a share in [0, 1] of the range; levels and whole numbers have equal parts."""
        if self.range is not None:
            return self.range.drawn(share)
        # A share of exactly 1 belongs to the last level.
        return self.levels[min(int(share * len(self.levels)), len(self.levels) - 1)]

    def ranked(self, rank: int, count: int) -> FactorLevel:
        """The level of a rank from 0 among `count` even steps, of which a range has both ends."""
        if self.range is not None and not self.range.integer:
            return self.range.at(rank / (count - 1))
        return self.at((rank + 0.5) / count)

    def changes(self, level: FactorLevel) -> dict[str, object]:
        """Every path that this level sets, with its value; none where the factor is inactive."""
        if self.when is not None and level == INACTIVE:
            return {}
        return dict.fromkeys(self.sets, level) | self.patches.get(str(level), {})
