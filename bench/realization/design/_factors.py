"""What is varied: factors with their levels, those that follow from others, those that others switch on, what is forbidden."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from bench.documents import Document
from bench.simspec import Identifier

from ._expression import MOST_CHARACTERS, Absent, Expression, parse_expression

Level = bool | int | float | str
Levels = dict[str, Level]
MAX_POINTS = 100_000
MOST_REFUSED = 1000
"""Points that a sequence may have refused for each one found, before what is forbidden is said to leave too little ..."""
PATIENCE = 10
"""... and for so many that are still to be found."""
INACTIVE = "inactive"
"""The level of a conditional factor in a point whose other levels do not switch it on; it changes nothing there."""

ExpressionText = Annotated[str, Field(min_length=1, max_length=MOST_CHARACTERS)]


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
        if self.integer and not (self.low.is_integer() and self.high.is_integer()):
            raise ValueError(f"low {self.low} and high {self.high} of whole numbers must be whole")
        if self.integer and self.steps is not None and self.steps > self.high - self.low + 1:
            raise ValueError(
                f"there are {self.high - self.low + 1:.0f} whole numbers from low to high, fewer than steps {self.steps}"
            )
        return self

    def at(self, share: float) -> float | int:
        """The value at a share of the way, 0 at low and 1 at high."""
        value = self.low + share * (self.high - self.low)
        return round(value) if self.integer else value

    def drawn(self, share: float) -> float | int:
        """As `at` for a share that was drawn; whole numbers have equal parts, the first and the last one too."""
        if not self.integer:
            return self.at(share)
        count = int(self.high - self.low) + 1
        return int(self.low) + min(int(share * count), count - 1)


class Factor(Document):
    """Something that is varied: levels, a range or a formula, and the fields of the SimSpec that take its value.

    `sets` are paths that all take the level's value itself; `patches` give, for a level by name, other values for paths
    (an approach of N, E, S or W that moves the vehicle's home).
    """

    name: Identifier
    unit: Annotated[str | None, Field(description="Checked against the unit that the paths' names state.")] = None
    levels: Annotated[tuple[Level, ...], Field(max_length=1000)] = ()
    range: Range | None = None
    formula: Annotated[
        ExpressionText | None, Field(description="The level follows from other factors, for example 'crowd * 0.05 + 2'.")
    ] = None
    integer: Annotated[bool, Field(description="Round what the formula gives to whole numbers.")] = False
    when: Annotated[
        ExpressionText | None, Field(description="Active only where this holds of other factors; elsewhere it changes nothing.")
    ] = None
    sets: tuple[str, ...] = ()
    patches: dict[str, dict[str, Any]] = {}

    @model_validator(mode="after")
    def _varies_something(self) -> Self:
        if bool(self.levels) + (self.range is not None) + (self.formula is not None) != 1:
            raise ValueError(f"factor {self.name!r}: give either levels (at least one) or range or formula")
        twice = [level for level, times in Counter(self.levels).items() if times > 1]
        if twice:
            raise ValueError(f"factor {self.name!r}: level {twice[0]!r} stands twice (numbers that are equal are one level)")
        if not self.sets and not self.patches:
            raise ValueError(f"factor {self.name!r} changes nothing; give sets (paths into the SimSpec) or patches")
        if self.patches and set(self.patches) != set(map(str, self.levels)):
            raise ValueError(
                f"factor {self.name!r}: patches {sorted(self.patches)} must name exactly the levels {list(self.levels)}"
            )
        if self.formula is not None and self.when is not None:
            raise ValueError(f"factor {self.name!r}: give formula or when; a formula may say `a if condition else b`")
        if self.integer and self.formula is None:
            raise ValueError(f"factor {self.name!r}: integer here is of a formula; of a range it stands in the range")
        if self.when is not None and INACTIVE in self.levels:
            raise ValueError(
                f"factor {self.name!r}: the level {INACTIVE!r} means that its `when` does not hold; name it otherwise"
            )
        for text in (self.formula, self.when):
            if text is not None:
                parse_expression(text)
        return self

    def counted(self) -> tuple[Level, ...]:
        """The levels one by one. Raises ValueError for a range without steps."""
        if self.range is None:
            return self.levels
        if self.range.steps is None:
            raise ValueError(f"factor {self.name!r} is a range; this design counts levels: give levels or range.steps")
        return tuple(_plain(self.range.at(step / (self.range.steps - 1))) for step in range(self.range.steps))

    def ends(self) -> tuple[Level, Level]:
        """Its two levels, or the ends of its range. Raises ValueError for any other number of levels."""
        if self.range is not None:
            return self.range.at(0.0), self.range.at(1.0)
        if len(self.levels) != 2:
            raise ValueError(f"factor {self.name!r} has {len(self.levels)} levels; this design takes two, or the ends of a range")
        return self.levels[0], self.levels[1]

    def at(self, share: float) -> Level:
        """The level at a share in [0, 1]: within the range, or the levels (and whole numbers) in equal parts."""
        if self.range is not None:
            return self.range.drawn(share)
        return self.levels[min(int(share * len(self.levels)), len(self.levels) - 1)]

    def ranked(self, rank: int, count: int) -> Level:
        """The level of the rank, from 0, among `count` even steps: a range's ends are reached, whole numbers and levels take turns."""
        if self.range is not None and not self.range.integer:
            return self.range.at(rank / (count - 1))
        return self.at((rank + 0.5) / count)

    def changes(self, level: Level) -> dict[str, object]:
        """Every path that this level sets, with its value; none where the factor is inactive."""
        if self.when is not None and level == INACTIVE:
            return {}
        return dict.fromkeys(self.sets, level) | self.patches.get(str(level), {})


def _plain(value: float | int) -> float | int:
    """Without the noise of rounding: 0.3 and not 0.30000000000000004, which no prohibition of 0.3 would meet."""
    return float(f"{value:.12g}") if isinstance(value, float) else value


@dataclass(frozen=True, slots=True)
class Rule:
    """Something that must not be: `names` are the free factors on which it rests, `broken` is asked once all are known."""

    names: frozenset[str]
    broken: Callable[[Mapping[str, Level]], bool]


class Space:
    """The factors of a design as a whole: what is free to be chosen, what follows, and what is forbidden.

    Raises ValueError for expressions that name no factor or run in a circle.
    """

    def __init__(self, factors: Sequence[Factor], forbid: Sequence[str] = ()) -> None:
        self.factors = tuple(factors)
        self.free = tuple(one for one in factors if one.formula is None)
        known = {one.name: one for one in factors}
        texts = {one.name: one.formula or one.when for one in factors if one.formula or one.when}
        self._rests = {name: _read(f"factor {name!r}", str(text), known) for name, text in texts.items()}
        self._forbidden = [_read("forbid", text, known) for text in forbid]
        try:
            order = TopologicalSorter({name: self._rests[name].names if name in self._rests else () for name in known})
            self._following = [known[name] for name in order.static_order() if name in self._rests]
        except CycleError as error:
            circle = " -> ".join(map(str, reversed(error.args[1])))
            raise ValueError(f"factors follow from each other in a circle: {circle}") from None

    @property
    def bound(self) -> bool:
        """Whether anything is forbidden."""
        return bool(self._forbidden)

    @property
    def plain(self) -> bool:
        """Whether nothing is forbidden and nothing is conditional."""
        return not self._forbidden and not any(one.when for one in self.factors)

    def complete(self, chosen: Mapping[str, Level]) -> Levels:
        """Levels of all factors, in the design's order, from those of the free ones. Raises ValueError where a formula fails."""
        levels = dict(chosen)
        for factor in self._following:
            levels[factor.name] = self._level(factor, levels)
        return {factor.name: levels[factor.name] for factor in self.factors}

    def allows(self, levels: Mapping[str, Level]) -> bool:
        """Whether nothing forbidden holds of a whole point; what comes to an inactive factor forbids nothing."""
        return not any(_holds(one, self._active(levels)) for one in self._forbidden)

    def choices(self, factor: Factor) -> tuple[Level, ...]:
        """What a free factor may be in a design that counts levels, `inactive` included."""
        return (*factor.counted(), INACTIVE) if factor.when else factor.counted()

    def rules(self) -> tuple[Rule, ...]:
        """Everything that a choice of levels, `inactive` included, must not break."""
        switches = [Rule(self._support([one.name]), self._misplaced(one)) for one in self.free if one.when]
        bans = [Rule(self._support(one.names), self._banned(one)) for one in self._forbidden]
        return (*switches, *bans)

    def whole(self, chosen: Iterable[Mapping[str, Level]]) -> Iterator[Levels]:
        """Each choice completed, in order; what is forbidden is left out."""
        return (levels for levels in map(self.complete, chosen) if self.allows(levels))

    def first(self, chosen: Iterable[Mapping[str, Level]], count: int) -> list[Levels]:
        """The first so many allowed points of an endless sequence. Raises ValueError where they are too rare."""
        found: list[Levels] = []
        for drawn, levels in enumerate(map(self.complete, chosen), start=1):
            if self.allows(levels):
                found.append(levels)
            if len(found) == count:
                break
            if drawn >= MOST_REFUSED * (len(found) + min(count, PATIENCE)):
                raise ValueError(f"what is forbidden leaves {len(found)} of {drawn} points drawn; {count} were asked for")
        return found

    def every(self, chosen: Sequence[Mapping[str, Level]], kind: str) -> list[Levels]:
        """All of these points. Raises ValueError where one is forbidden: a balanced design is worth nothing in part."""
        found = list(self.whole(chosen))
        if len(found) < len(chosen):
            raise ValueError(
                f"{len(chosen) - len(found)} of the {len(chosen)} points of the {kind} are forbidden, and it needs them all; "
                "use full_factorial, covering_array, sobol or halton"
            )
        return found

    def at(self, shares: Iterable[float]) -> Levels:
        """The free factors' levels at shares in [0, 1], one for each."""
        return {factor.name: factor.at(float(share)) for factor, share in zip(self.free, shares, strict=True)}

    def ranked(self, ranks: Iterable[int], count: int) -> Levels:
        """The free factors' levels at ranks of `count` even steps, one for each."""
        return {factor.name: factor.ranked(int(rank), count) for factor, rank in zip(self.free, ranks, strict=True)}

    def _level(self, factor: Factor, levels: Levels) -> Level:
        expression = self._rests[factor.name]
        if factor.formula is None:
            return levels[factor.name] if _holds(expression, self._active(levels)) else INACTIVE
        try:
            value = expression.value(self._active(levels))
        except Absent as absent:
            raise ValueError(
                f"factor {factor.name!r}: {factor.formula!r} comes to {absent}, which is inactive there; "
                "say what it is then: `a if condition else b`"
            ) from None
        return round(value) if factor.integer and isinstance(value, float) else value

    def _active(self, levels: Mapping[str, Level]) -> dict[str, Level]:
        off = {one.name for one in self.factors if one.when and levels.get(one.name) == INACTIVE}
        return {name: level for name, level in levels.items() if name not in off}

    def _support(self, names: Iterable[str]) -> frozenset[str]:
        """The free factors on which these rest, themselves included."""
        waiting, found = list(names), set[str]()
        while waiting:
            name = waiting.pop()
            if name not in found:
                found.add(name)
                waiting += self._rests[name].names if name in self._rests else ()
        return frozenset(found & {one.name for one in self.free})

    def _derived(self, levels: Mapping[str, Level], expression: Expression) -> dict[str, Level]:
        """Levels with those that a formula gives, as far as this expression needs them."""
        known = dict(levels)
        for factor in self._following:
            if factor.formula is not None and self._support([factor.name]) <= known.keys():
                known[factor.name] = self._level(factor, known)
        return self._active(known)

    def _misplaced(self, factor: Factor) -> Callable[[Mapping[str, Level]], bool]:
        condition = self._rests[factor.name]
        return lambda levels: _holds(condition, self._derived(levels, condition)) is (levels[factor.name] == INACTIVE)

    def _banned(self, expression: Expression) -> Callable[[Mapping[str, Level]], bool]:
        return lambda levels: _holds(expression, self._derived(levels, expression))


def _read(where: str, text: str, known: Mapping[str, Factor]) -> Expression:
    expression = parse_expression(text)
    strange = sorted(expression.names - known.keys())
    if strange:
        raise ValueError(f"{where}: {text!r} names {strange[0]!r}, which is no factor (there are: {', '.join(known)})")
    for name, value in sorted(expression.compared, key=str):
        _check_compared(where, text, known[name], value)
    return expression


def _check_compared(where: str, text: str, factor: Factor, value: str | bool) -> None:
    """A text that a factor never takes is a slip of the pen, by which something would silently not be forbidden."""
    if factor.formula is not None or any(level == value and isinstance(level, str | bool) for level in factor.levels):
        return
    told = "true" if value is True else "false" if value is False else repr(value)
    levels = ", ".join(map(str, factor.levels)) if factor.range is None else f"{factor.range.low:g} ... {factor.range.high:g}"
    raise ValueError(f"{where}: {text!r} compares {factor.name!r} with {told}, which it never is (it has: {levels})")


def _holds(expression: Expression, levels: Mapping[str, Level]) -> bool:
    try:
        return expression.holds(levels)
    except Absent:
        return False
