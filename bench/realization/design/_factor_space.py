"""The factors of a design as a whole: which are free, which follow from others, and what is forbidden."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

from ._expression import Expression, InactiveFactor, parse_expression
from ._factors import INACTIVE, DesignFactor, FactorLevel, FactorLevels

MAX_DRAWS_PER_POINT = 1000
"""Points that a sequence may have refused for each one found, before what is forbidden is said to leave too little ..."""


MIN_POINTS_FOR_LIMIT = 10
"""... and for so many that are still to be found."""


@dataclass(frozen=True, slots=True)
class LevelRule:
    """Something that must not be: `names` are the free factors on which it rests, `broken` is asked once all are known."""

    names: frozenset[str]
    broken: Callable[[Mapping[str, FactorLevel]], bool]


class FactorSpace:
    """The factors of a design as a whole: what is free to be chosen, what follows, and what is forbidden.

    Raises ValueError for expressions that name no factor or run in a circle.
    """

    def __init__(self, factors: Sequence[DesignFactor], forbid: Sequence[str] = ()) -> None:
        self.factors = tuple(factors)
        self.free = tuple(one for one in factors if one.formula is None)
        known = {one.name: one for one in factors}
        texts = {one.name: one.formula or one.when for one in factors if one.formula or one.when}
        self._rests = {name: _parsed(f"factor {name!r}", str(text), known) for name, text in texts.items()}
        self._forbidden = [_parsed("forbid", text, known) for text in forbid]
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

    def complete(self, chosen: Mapping[str, FactorLevel]) -> FactorLevels:
        """Levels of all factors, in the design's order, from those of the free ones. Raises ValueError where a formula fails."""
        levels = dict(chosen)
        for factor in self._following:
            levels[factor.name] = self._level(factor, levels)
        return {factor.name: levels[factor.name] for factor in self.factors}

    def allows(self, levels: Mapping[str, FactorLevel]) -> bool:
        """Whether nothing forbidden holds of a whole point; what comes to an inactive factor forbids nothing."""
        return not any(_holds(one, self._active(levels)) for one in self._forbidden)

    def choices(self, factor: DesignFactor) -> tuple[FactorLevel, ...]:
        """What a free factor may be in a design that counts levels, `inactive` included."""
        return (*factor.counted(), INACTIVE) if factor.when else factor.counted()

    def rules(self) -> tuple[LevelRule, ...]:
        """Everything that a choice of levels, `inactive` included, must not break."""
        switches = [LevelRule(self._support([one.name]), self._misplaced(one)) for one in self.free if one.when]
        bans = [LevelRule(self._support(one.names), self._banned(one)) for one in self._forbidden]
        return (*switches, *bans)

    def whole(self, chosen: Iterable[Mapping[str, FactorLevel]]) -> Iterator[FactorLevels]:
        """Each choice completed, in order; what is forbidden is left out."""
        return (levels for levels in map(self.complete, chosen) if self.allows(levels))

    def first(self, chosen: Iterable[Mapping[str, FactorLevel]], count: int) -> list[FactorLevels]:
        """The first so many allowed points of an endless sequence. Raises ValueError where they are too rare."""
        found: list[FactorLevels] = []
        for drawn, levels in enumerate(map(self.complete, chosen), start=1):
            if self.allows(levels):
                found.append(levels)
            if len(found) == count:
                break
            if drawn >= MAX_DRAWS_PER_POINT * (len(found) + min(count, MIN_POINTS_FOR_LIMIT)):
                raise ValueError(f"what is forbidden leaves {len(found)} of {drawn} points drawn; {count} were asked for")
        return found

    def every(self, chosen: Sequence[Mapping[str, FactorLevel]], kind: str) -> list[FactorLevels]:
        """All of these points. Raises ValueError where one is forbidden: a balanced design is worth nothing in part."""
        found = list(self.whole(chosen))
        if len(found) < len(chosen):
            raise ValueError(
                f"{len(chosen) - len(found)} of the {len(chosen)} points of the {kind} are forbidden, and it needs them all; "
                "use full_factorial, covering_array, sobol or halton"
            )
        return found

    def at(self, shares: Iterable[float]) -> FactorLevels:
        """The free factors' levels at shares in [0, 1], one for each."""
        return {factor.name: factor.at(float(share)) for factor, share in zip(self.free, shares, strict=True)}

    def ranked(self, ranks: Iterable[int], count: int) -> FactorLevels:
        """The free factors' levels at ranks of `count` even steps, one for each."""
        return {factor.name: factor.ranked(int(rank), count) for factor, rank in zip(self.free, ranks, strict=True)}

    def _level(self, factor: DesignFactor, levels: FactorLevels) -> FactorLevel:
        expression = self._rests[factor.name]
        if factor.formula is None:
            return levels[factor.name] if _holds(expression, self._active(levels)) else INACTIVE
        try:
            value = expression.value(self._active(levels))
        except InactiveFactor as absent:
            raise ValueError(
                f"factor {factor.name!r}: {factor.formula!r} comes to {absent}, which is inactive there; "
                "say what it is then: `a if condition else b`"
            ) from None
        return round(value) if factor.integer and isinstance(value, float) else value

    def _active(self, levels: Mapping[str, FactorLevel]) -> dict[str, FactorLevel]:
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

    def _derived(self, levels: Mapping[str, FactorLevel], expression: Expression) -> dict[str, FactorLevel]:
        """Levels with those that a formula gives, as far as this expression needs them."""
        known = dict(levels)
        for factor in self._following:
            if factor.formula is not None and self._support([factor.name]) <= known.keys():
                known[factor.name] = self._level(factor, known)
        return self._active(known)

    def _misplaced(self, factor: DesignFactor) -> Callable[[Mapping[str, FactorLevel]], bool]:
        condition = self._rests[factor.name]
        return lambda levels: _holds(condition, self._derived(levels, condition)) is (levels[factor.name] == INACTIVE)

    def _banned(self, expression: Expression) -> Callable[[Mapping[str, FactorLevel]], bool]:
        return lambda levels: _holds(expression, self._derived(levels, expression))


def _parsed(where: str, text: str, known: Mapping[str, DesignFactor]) -> Expression:
    expression = parse_expression(text)
    strange = sorted(expression.names - known.keys())
    if strange:
        raise ValueError(f"{where}: {text!r} names {strange[0]!r}, which is no factor (there are: {', '.join(known)})")
    for name, value in sorted(expression.compared, key=str):
        _check_compared(where, text, known[name], value)
    return expression


def _check_compared(where: str, text: str, factor: DesignFactor, value: str | bool) -> None:
    """A text that a factor never takes is a slip of the pen, by which something would silently not be forbidden."""
    if factor.formula is not None or any(level == value and isinstance(level, str | bool) for level in factor.levels):
        return
    told = "true" if value is True else "false" if value is False else repr(value)
    levels = ", ".join(map(str, factor.levels)) if factor.range is None else f"{factor.range.low:g} ... {factor.range.high:g}"
    raise ValueError(f"{where}: {text!r} compares {factor.name!r} with {told}, which it never is (it has: {levels})")


def _holds(expression: Expression, levels: Mapping[str, FactorLevel]) -> bool:
    try:
        return expression.holds(levels)
    except InactiveFactor:
        return False
