"""Small expressions over factors: `crowd * 0.05 + 2`, `gps == 'degraded' and not night`.

Numbers, quoted texts, true and false, factors by name; `+ - * / % **`, comparisons, `and`, `or`, `not`, `a if b else c`, brackets,
and min, max, abs, round, floor, ceil, sqrt. Nothing else can be reached from here: no attribute, no call of anything else, no loop,
so that an expression from a stranger's file ends, soon, and touches nothing. A name takes its hyphens with it: `fog-level` is one
name, `fog - level` a difference.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NoReturn

Value = bool | float | str


MAX_CHARACTERS = 500


MAX_DEPTH = 40


MAX_NUMBER = 1e300


_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<text>'[^']*'|\"[^\"]*\")"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*(?:-[A-Za-z0-9_]+)*)|(?P<sign>\*\*|==|!=|<=|>=|[-+*/%()<>,]))"
)


_KEYWORDS = frozenset({"and", "or", "not", "if", "else", "true", "false"})


_EQUALITY: dict[str, Callable[[object, object], bool]] = {"==": operator.eq, "!=": operator.ne}


_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


_ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "%": operator.mod,
    "**": math.pow,
}


_FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    "min": (0, min),
    "max": (0, max),
    "abs": (1, abs),
    "round": (1, round),
    "floor": (1, math.floor),
    "ceil": (1, math.ceil),
    "sqrt": (1, math.sqrt),
}
"""By name: how many arguments (0: one or more), and what is worked out."""


Evaluate = Callable[[Mapping[str, object]], Value]


class InactiveFactor(Exception):
    """A factor that an expression came to is inactive, so the expression says nothing."""


@dataclass(frozen=True, slots=True)
class Expression:
    """An expression that was read, the names that stand in it, and the texts, true or false that names are compared with."""

    text: str
    names: frozenset[str]
    compared: frozenset[tuple[str, str | bool]]
    _evaluate: Evaluate

    def value(self, levels: Mapping[str, object]) -> Value:
        """The value at these levels; every number is a float.

        Raises ValueError with a sentence where it has none (a division by zero, a text among numbers), and Absent where it
        comes to a name that `levels` does not hold.
        """
        try:
            return self._evaluate(levels)
        except (ArithmeticError, ValueError) as error:
            raise ValueError(f"{self.text!r} has no value at {_shown(self.names, levels)}: {error}") from None

    def holds(self, levels: Mapping[str, object]) -> bool:
        """Whether it is true; raises as `value` does, and ValueError where it is neither true nor false."""
        value = self.value(levels)
        if not isinstance(value, bool):
            raise ValueError(f"{self.text!r} is {value!r}, neither true nor false; compare it with something")
        return value


def parse_expression(text: str) -> Expression:
    """Read an expression. Raises ValueError saying what stands wrong, and where."""
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"an expression has at most {MAX_CHARACTERS} characters, this one {len(text)}")
    reader = _Reader(text)
    evaluate = reader.whole()
    return Expression(text, frozenset(reader.names), frozenset(reader.compared), evaluate)


def _shown(names: frozenset[str], levels: Mapping[str, object]) -> str:
    return ", ".join(f"{name}={levels[name]}" for name in sorted(names) if name in levels) or "any level"


class _Reader:
    """Reads by recursive descent, loosest binding first; `names` and `compared` fill up as it goes."""

    def __init__(self, text: str) -> None:
        self.names: set[str] = set()
        self.compared: set[tuple[str, str | bool]] = set()
        self._text = text
        self._tokens = list(self._split())
        self._place = 0
        self._depth = 0

    def whole(self) -> Evaluate:
        found = self._choice()
        if self._kind():
            self._wrong(f"{self._word()!r} stands where the expression should end")
        return found

    def _split(self) -> Iterator[tuple[str, str]]:
        place, text = 0, self._text.rstrip()
        while place < len(text):
            match = _TOKEN.match(text, place)
            if match is None:
                raise ValueError(f"{self._text!r}: {text[place:].strip()[:1]!r} means nothing in an expression")
            place = match.end()
            kind = str(match.lastgroup)
            word = match[kind]
            yield ("word" if kind == "name" and word in _KEYWORDS else kind), word

    def _kind(self) -> str:
        return self._tokens[self._place][0] if self._place < len(self._tokens) else ""

    def _word(self) -> str:
        return self._tokens[self._place][1] if self._place < len(self._tokens) else "the end"

    def _next(self, *words: str) -> str | None:
        """Step over one of these words or signs and return it; None where something else stands here."""
        if self._kind() not in ("word", "sign") or self._word() not in words:
            return None
        self._place += 1
        return self._tokens[self._place - 1][1]

    def _need(self, word: str) -> None:
        if self._next(word) is None:
            self._wrong(f"{word!r} is missing before {self._word()!r}")

    def _wrong(self, what: str) -> NoReturn:
        raise ValueError(f"{self._text!r}: {what}")

    def _choice(self) -> Evaluate:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            self._wrong(f"is nested deeper than {MAX_DEPTH}")
        first = self._either()
        if self._next("if"):
            condition = self._either()
            self._need("else")
            other = self._choice()
            yes = first
            found: Evaluate = lambda levels: yes(levels) if _truth(condition(levels)) else other(levels)  # noqa: E731
        else:
            found = first
        self._depth -= 1
        return found

    def _either(self) -> Evaluate:
        found = self._both()
        while self._next("or"):
            found = _or(found, self._both())
        return found

    def _both(self) -> Evaluate:
        found = self._denied()
        while self._next("and"):
            found = _and(found, self._denied())
        return found

    def _denied(self) -> Evaluate:
        times = 0
        while self._next("not"):
            times += 1
        found = self._compared()
        if not times:
            return found
        return lambda levels: _truth(found(levels)) is (times % 2 == 0)

    def _compared(self) -> Evaluate:
        places = [self._place]
        terms, signs = [self._sum()], []
        while sign := self._next(*_EQUALITY, *_COMPARISONS):
            signs.append(sign)
            places.append(self._place)
            terms.append(self._sum())
        self._note_compared(places, signs)
        return _chain(terms, signs) if signs else terms[0]

    def _note_compared(self, places: list[int], signs: list[str]) -> None:
        """Remember names beside a text, true or false. `places` are where terms begin; a term ends a token before the next."""
        ends = [*(place - 1 for place in places[1:]), self._place]
        alone = [self._tokens[at] if end == at + 1 else ("", "") for at, end in zip(places, ends, strict=True)]
        for sign, one, other in zip(signs, alone, alone[1:], strict=False):
            for (kind, name), (beside, word) in ((one, other), (other, one)):
                if sign in _EQUALITY and kind == "name" and beside in ("text", "word"):
                    self.compared.add((name, word[1:-1] if beside == "text" else word == "true"))

    def _sum(self) -> Evaluate:
        found = self._product()
        while sign := self._next("+", "-"):
            found = _combined(sign, found, self._product())
        return found

    def _product(self) -> Evaluate:
        found = self._signed()
        while sign := self._next("*", "/", "%"):
            found = _combined(sign, found, self._signed())
        return found

    def _signed(self) -> Evaluate:
        negative, signed = False, False
        while sign := self._next("-", "+"):
            negative, signed = negative ^ (sign == "-"), True
        found = self._power()
        if not signed:
            return found
        return lambda levels: -_number(found(levels)) if negative else _number(found(levels))

    def _power(self) -> Evaluate:
        found = self._atom()
        if not self._next("**"):
            return found
        self._depth += 1
        if self._depth > MAX_DEPTH:
            self._wrong(f"is nested deeper than {MAX_DEPTH}")
        power = _combined("**", found, self._signed())
        self._depth -= 1
        return power

    def _atom(self) -> Evaluate:
        if self._next("("):
            inner = self._choice()
            self._need(")")
            return inner
        if word := self._next("true", "false"):
            return lambda _: word == "true"
        kind, word = self._kind(), self._word()
        if kind not in ("number", "text", "name"):
            self._wrong(f"a number, a text or a factor is missing before {word!r}")
        self._place += 1
        if kind == "number":
            number = float(word)
            return lambda _: number
        if kind == "text":
            return lambda _: word[1:-1]
        if self._next("("):
            return self._call(word)
        self.names.add(word)
        return lambda levels: _level(levels, word)

    def _call(self, name: str) -> Evaluate:
        if name not in _FUNCTIONS:
            self._wrong(f"there is no function {name!r}; there are {', '.join(_FUNCTIONS)}")
        arguments = [self._choice()]
        while self._next(","):
            arguments.append(self._choice())
        self._need(")")
        takes, function = _FUNCTIONS[name]
        if takes and len(arguments) != takes:
            self._wrong(f"{name} takes one number, not {len(arguments)}")
        if name in ("min", "max"):
            return lambda levels: function([_number(one(levels)) for one in arguments])
        return lambda levels: float(function(_number(arguments[0](levels))))


def _level(levels: Mapping[str, object], name: str) -> Value:
    value = levels.get(name)
    if value is None:
        raise InactiveFactor(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else value  # type: ignore[return-value]


def _number(value: Value) -> float:
    if isinstance(value, bool) or not isinstance(value, float):
        raise ValueError(f"{value!r} is no number")
    if not abs(value) <= MAX_NUMBER:
        raise ValueError("a number grows too large")
    return value


def _truth(value: Value) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{value!r} is neither true nor false")
    return value


def _and(first: Evaluate, second: Evaluate) -> Evaluate:
    return lambda levels: _truth(first(levels)) and _truth(second(levels))


def _or(first: Evaluate, second: Evaluate) -> Evaluate:
    return lambda levels: _truth(first(levels)) or _truth(second(levels))


def _combined(sign: str, first: Evaluate, second: Evaluate) -> Evaluate:
    work = _ARITHMETIC[sign]
    return lambda levels: _number(work(_number(first(levels)), _number(second(levels))))


def _chain(terms: list[Evaluate], signs: list[str]) -> Evaluate:
    def holds(levels: Mapping[str, object]) -> bool:
        left = terms[0](levels)
        for sign, term in zip(signs, terms[1:], strict=True):
            right = term(levels)
            if not (_EQUALITY[sign](left, right) if sign in _EQUALITY else _COMPARISONS[sign](_number(left), _number(right))):
                return False
            left = right
        return True

    return holds
