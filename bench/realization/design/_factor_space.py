"""The factors of a design as a whole: which are free, which follow from others, and what is forbidden."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

from ._expression import Expression, InactiveFactor, parse_expression
from ._factors import INACTIVE, DesignFactor, FactorLevel, FactorLevels

# Points that a sequence may have refused for each one found, until `forbid` leaves too little ...
MAX_DRAWS_PER_POINT = 1000

# ... and for so many that are still to be found.
MIN_POINTS_FOR_LIMIT = 10


@dataclass(frozen=True, slots=True)
class LevelRule:
    """A condition on a point, `broken` or not once the free factors in `names` have levels."""

    names: frozenset[str]
    broken: Callable[[Mapping[str, FactorLevel]], bool]


class FactorSpace:
    """The factors of a design as a whole: free factors, derived factors, and forbidden combinations.

    Raises ValueError for expressions with unknown names or circular formulas.
    """

    def __init__(self, factors: Sequence[DesignFactor], forbid: Sequence[str] = ()) -> None:
        self.factors = tuple(factors)
        self.free = tuple(factor for factor in factors if factor.formula is None)
        by_name = {factor.name: factor for factor in factors}
        self._expressions = {
            factor.name: _parsed(f"factor {factor.name!r}", text, by_name)
            for factor in factors
            if (text := factor.formula or factor.when)
        }
        self._forbidden = [_parsed("forbid", text, by_name) for text in forbid]
        try:
            # Formulas are evaluated in dependency order, so each finds its inputs.
            order = TopologicalSorter(
                {name: self._expressions[name].names if name in self._expressions else () for name in by_name}
            )
            self._derived_factors = [
                by_name[name] for name in order.static_order() if name in self._expressions
            ]
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
        return not self._forbidden and not any(factor.when for factor in self.factors)

    @property
    def unconstrained(self) -> bool:
        """Whether nothing is forbidden, conditional or derived, so that every choice is a point."""
        return not self._forbidden and not self._expressions

    def complete(self, chosen: Mapping[str, FactorLevel]) -> FactorLevels:
        """Levels of all factors, in the design's order, from those of the free ones.

        Raises ValueError where a formula fails.
        """
        levels = dict(chosen)
        for factor in self._derived_factors:
            levels[factor.name] = self._level(factor, levels)
        return {factor.name: levels[factor.name] for factor in self.factors}

    def allows(self, levels: Mapping[str, FactorLevel]) -> bool:
        """Whether no `forbid` expression holds of a complete point.

        An expression that reads an inactive factor forbids nothing.
        """
        return not any(_holds(ban, self._active(levels)) for ban in self._forbidden)

    def choices(self, factor: DesignFactor) -> tuple[FactorLevel, ...]:
        """The levels of a free factor in a design that counts levels, `inactive` included."""
        return (*factor.counted(), INACTIVE) if factor.when else factor.counted()

    def rules(self) -> tuple[LevelRule, ...]:
        """All rules for a choice of levels, `inactive` included."""
        switched = [factor for factor in self.free if factor.when]
        return (
            *(LevelRule(self._support([factor.name]), self._switch_broken(factor)) for factor in switched),
            *(LevelRule(self._support(ban.names), self._ban_broken(ban)) for ban in self._forbidden),
        )

    def whole(self, chosen: Iterable[Mapping[str, FactorLevel]]) -> Iterator[FactorLevels]:
        """Each choice completed, in order, without the forbidden ones."""
        return (levels for levels in map(self.complete, chosen) if self.allows(levels))

    def first(self, chosen: Iterable[Mapping[str, FactorLevel]], count: int) -> list[FactorLevels]:
        """The first `count` allowed points of an endless sequence.

        Raises ValueError when they are too rare.
        """
        allowed: list[FactorLevels] = []
        for drawn, levels in enumerate(map(self.complete, chosen), start=1):
            if self.allows(levels):
                allowed.append(levels)
            if len(allowed) == count:
                break
            # Without a limit, a `forbid` that excludes everything would draw forever.
            if drawn >= MAX_DRAWS_PER_POINT * (len(allowed) + min(count, MIN_POINTS_FOR_LIMIT)):
                raise ValueError(
                    f"`forbid` leaves {len(allowed)} of {drawn} points drawn; {count} are required"
                )
        return allowed

    def every(self, chosen: Sequence[Mapping[str, FactorLevel]], kind: str) -> list[FactorLevels]:
        """All of these points.

        Raises ValueError when one is forbidden: part of a balanced design is not balanced.
        """
        allowed = list(self.whole(chosen))
        if len(allowed) < len(chosen):
            raise ValueError(
                f"{len(chosen) - len(allowed)} of the {len(chosen)} points of the {kind} are forbidden, and it needs them all; "
                "use full_factorial, covering_array, sobol or halton"
            )
        return allowed

    def at(self, shares: Iterable[float]) -> FactorLevels:
        """The free factors' levels at shares in [0, 1], one for each."""
        return {factor.name: factor.at(float(share)) for factor, share in zip(self.free, shares, strict=True)}

    def ranked(self, ranks: Iterable[int], count: int) -> FactorLevels:
        """The free factors' levels at ranks of `count` even steps, one for each."""
        return {
            factor.name: factor.ranked(int(rank), count)
            for factor, rank in zip(self.free, ranks, strict=True)
        }

    def _level(self, factor: DesignFactor, levels: FactorLevels) -> FactorLevel:
        expression = self._expressions[factor.name]
        if factor.formula is None:
            return levels[factor.name] if _holds(expression, self._active(levels)) else INACTIVE
        try:
            value = expression.value(self._active(levels))
        except InactiveFactor as absent:
            raise ValueError(
                f"factor {factor.name!r}: {factor.formula!r} reads {absent}, which is inactive at this point; "
                "give a value for that case: `a if condition else b`"
            ) from None
        return round(value) if factor.integer and isinstance(value, float) else value

    def _active(self, levels: Mapping[str, FactorLevel]) -> dict[str, FactorLevel]:
        inactive = {
            factor.name for factor in self.factors if factor.when and levels.get(factor.name) == INACTIVE
        }
        return {name: level for name, level in levels.items() if name not in inactive}

    def _support(self, names: Iterable[str]) -> frozenset[str]:
        """The free factors on which these depend, themselves included."""
        pending, support = list(names), set[str]()
        while pending:
            name = pending.pop()
            if name not in support:
                support.add(name)
                pending += self._expressions[name].names if name in self._expressions else ()
        return frozenset(support & {factor.name for factor in self.free})

    def _derived(self, levels: Mapping[str, FactorLevel], expression: Expression) -> dict[str, FactorLevel]:
        """Levels with those that a formula gives, as far as this expression needs them."""
        values = dict(levels)
        for factor in self._derived_factors:
            if factor.formula is not None and self._support([factor.name]) <= values.keys():
                values[factor.name] = self._level(factor, values)
        return self._active(values)

    def _switch_broken(self, factor: DesignFactor) -> Callable[[Mapping[str, FactorLevel]], bool]:
        condition = self._expressions[factor.name]
        return lambda levels: (
            _holds(condition, self._derived(levels, condition)) is (levels[factor.name] == INACTIVE)
        )

    def _ban_broken(self, expression: Expression) -> Callable[[Mapping[str, FactorLevel]], bool]:
        return lambda levels: _holds(expression, self._derived(levels, expression))


def _parsed(where: str, text: str, by_name: Mapping[str, DesignFactor]) -> Expression:
    expression = parse_expression(text)
    unknown = sorted(expression.names - by_name.keys())
    if unknown:
        raise ValueError(
            f"{where}: {text!r} names {unknown[0]!r}, which is not a factor (there are: {', '.join(by_name)})"
        )
    for name, value in sorted(expression.compared, key=str):
        _check_compared(where, text, by_name[name], value)
    return expression


def _check_compared(where: str, text: str, factor: DesignFactor, value: str | bool) -> None:
    """Raise ValueError for a text that the factor never takes: a slip would silently forbid nothing."""
    if factor.formula is not None or any(
        level == value and isinstance(level, str | bool) for level in factor.levels
    ):
        return
    value_text = "true" if value is True else "false" if value is False else repr(value)
    levels = ", ".join(map(str, factor.levels))
    if factor.range is not None:
        levels = f"{factor.range.low:g} ... {factor.range.high:g}"
    raise ValueError(
        f"{where}: {text!r} compares {factor.name!r} with {value_text}, which it never is (it has: {levels})"
    )


def _holds(expression: Expression, levels: Mapping[str, FactorLevel]) -> bool:
    try:
        return expression.holds(levels)
    except InactiveFactor:
        return False
