"""Small expressions over factors: `crowd * 0.05 + 2`, `gps == 'degraded' and not night`.

Numbers, quoted texts, true and false, factors by name; `+ - * / % **`, comparisons, `and`, `or`, `not`, `a if
b else c`, brackets, and min, max, abs, round, floor, ceil, sqrt. There are no attributes, other calls or
loops, so an expression from an untrusted file always ends and has no side effects. Names may contain hyphens:
`fog-level` is one name, `fog - level` is a difference.
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


# By name: the number of arguments (0 means one or more) and the function.
_FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    "min": (0, min),
    "max": (0, max),
    "abs": (1, abs),
    "round": (1, round),
    "floor": (1, math.floor),
    "ceil": (1, math.ceil),
    "sqrt": (1, math.sqrt),
}


Evaluate = Callable[[Mapping[str, object]], Value]


class InactiveFactor(Exception):
    """The expression reads an inactive factor and therefore has no value."""


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed expression, the names in it, and the texts and truth values that names are compared with."""

    text: str
    names: frozenset[str]
    compared: frozenset[tuple[str, str | bool]]
    _evaluate: Evaluate

    def value(self, levels: Mapping[str, object]) -> Value:
        """The value at these levels; every number is a float.

        Raises ValueError with a sentence when there is none (division by zero, a text among numbers), and
        InactiveFactor when it reads a name that `levels` lacks.
        """
        try:
            return self._evaluate(levels)
        except (ArithmeticError, ValueError) as error:
            raise ValueError(f"{self.text!r} has no value at {_shown(self.names, levels)}: {error}") from None

    def holds(self, levels: Mapping[str, object]) -> bool:
        """Whether it is true; raises as `value` does, and ValueError when the value is not a truth value."""
        value = self.value(levels)
        if not isinstance(value, bool):
            raise ValueError(f"{self.text!r} is {value!r}, neither true nor false; compare it with something")
        return value


def parse_expression(text: str) -> Expression:
    """Parse an expression. Raises ValueError that says what is wrong, and where."""
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"an expression has at most {MAX_CHARACTERS} characters, this one {len(text)}")
    reader = _Reader(text)
    evaluate = reader.whole()
    return Expression(text, frozenset(reader.names), frozenset(reader.compared), evaluate)


def _shown(names: frozenset[str], levels: Mapping[str, object]) -> str:
    return ", ".join(f"{name}={levels[name]}" for name in sorted(names) if name in levels) or "any level"


class _Reader:
    """A recursive-descent parser, loosest binding first; fills `names` and `compared` while it parses."""

    def __init__(self, text: str) -> None:
        self.names: set[str] = set()
        self.compared: set[tuple[str, str | bool]] = set()
        self._text = text
        self._tokens = list(self._split())
        self._place = 0
        self._depth = 0

    def whole(self) -> Evaluate:
        evaluate = self._conditional()
        if self._kind():
            self._fail(f"{self._word()!r} is after the end of the expression")
        return evaluate

    def _split(self) -> Iterator[tuple[str, str]]:
        place, text = 0, self._text.rstrip()
        while place < len(text):
            match = _TOKEN.match(text, place)
            if match is None:
                raise ValueError(
                    f"{self._text!r}: {text[place:].strip()[:1]!r} is not allowed in an expression"
                )
            place = match.end()
            kind = str(match.lastgroup)
            word = match[kind]
            yield ("word" if kind == "name" and word in _KEYWORDS else kind), word

    def _kind(self) -> str:
        return self._tokens[self._place][0] if self._place < len(self._tokens) else ""

    def _word(self) -> str:
        return self._tokens[self._place][1] if self._place < len(self._tokens) else "the end"

    def _accept(self, *words: str) -> str | None:
        """Consume one of these words or signs and return it; None if the next token is another."""
        if self._kind() not in ("word", "sign") or self._word() not in words:
            return None
        self._place += 1
        return self._tokens[self._place - 1][1]

    def _expect(self, word: str) -> None:
        if self._accept(word) is None:
            self._fail(f"{word!r} is missing before {self._word()!r}")

    def _fail(self, what: str) -> NoReturn:
        raise ValueError(f"{self._text!r}: {what}")

    def _conditional(self) -> Evaluate:
        self._depth += 1
        # A limit far below Python's recursion limit: a hostile file gets a sentence, not a RecursionError.
        if self._depth > MAX_DEPTH:
            self._fail(f"is nested deeper than {MAX_DEPTH}")
        first = self._disjunction()
        if self._accept("if"):
            condition = self._disjunction()
            self._expect("else")
            other = self._conditional()
            chosen = first
            evaluate: Evaluate = lambda levels: chosen(levels) if _truth(condition(levels)) else other(levels)  # noqa: E731
        else:
            evaluate = first
        self._depth -= 1
        return evaluate

    def _disjunction(self) -> Evaluate:
        evaluate = self._conjunction()
        while self._accept("or"):
            evaluate = _or(evaluate, self._conjunction())
        return evaluate

    def _conjunction(self) -> Evaluate:
        evaluate = self._negation()
        while self._accept("and"):
            evaluate = _and(evaluate, self._negation())
        return evaluate

    def _negation(self) -> Evaluate:
        times = 0
        while self._accept("not"):
            times += 1
        evaluate = self._comparison()
        if not times:
            return evaluate
        return lambda levels: _truth(evaluate(levels)) is (times % 2 == 0)

    def _comparison(self) -> Evaluate:
        places = [self._place]
        terms, signs = [self._sum()], []
        while sign := self._accept(*_EQUALITY, *_COMPARISONS):
            signs.append(sign)
            places.append(self._place)
            terms.append(self._sum())
        self._note_compared(places, signs)
        return _chain(terms, signs) if signs else terms[0]

    def _note_compared(self, places: list[int], signs: list[str]) -> None:
        """Record names that are compared with a text, true or false.

        `places` are the first tokens of terms; the sign lies between.
        """
        ends = [*(place - 1 for place in places[1:]), self._place]
        single_tokens = [
            self._tokens[at] if end == at + 1 else ("", "") for at, end in zip(places, ends, strict=True)
        ]
        for sign, term, next_term in zip(signs, single_tokens, single_tokens[1:], strict=False):
            for (kind, name), (other_kind, other_word) in ((term, next_term), (next_term, term)):
                if sign in _EQUALITY and kind == "name" and other_kind in ("text", "word"):
                    self.compared.add(
                        (name, other_word[1:-1] if other_kind == "text" else other_word == "true")
                    )

    def _sum(self) -> Evaluate:
        evaluate = self._product()
        while sign := self._accept("+", "-"):
            evaluate = _combined(sign, evaluate, self._product())
        return evaluate

    def _product(self) -> Evaluate:
        evaluate = self._signed()
        while sign := self._accept("*", "/", "%"):
            evaluate = _combined(sign, evaluate, self._signed())
        return evaluate

    def _signed(self) -> Evaluate:
        negative, signed = False, False
        while sign := self._accept("-", "+"):
            negative, signed = negative ^ (sign == "-"), True
        evaluate = self._power()
        if not signed:
            return evaluate
        return lambda levels: -_number(evaluate(levels)) if negative else _number(evaluate(levels))

    def _power(self) -> Evaluate:
        evaluate = self._atom()
        if not self._accept("**"):
            return evaluate
        self._depth += 1
        if self._depth > MAX_DEPTH:
            self._fail(f"is nested deeper than {MAX_DEPTH}")
        power = _combined("**", evaluate, self._signed())
        self._depth -= 1
        return power

    def _atom(self) -> Evaluate:
        if self._accept("("):
            inner = self._conditional()
            self._expect(")")
            return inner
        if word := self._accept("true", "false"):
            return lambda _: word == "true"
        kind, word = self._kind(), self._word()
        if kind not in ("number", "text", "name"):
            self._fail(f"a number, a text or a factor is missing before {word!r}")
        self._place += 1
        if kind == "number":
            number = float(word)
            return lambda _: number
        if kind == "text":
            return lambda _: word[1:-1]
        if self._accept("("):
            return self._call(word)
        self.names.add(word)
        return lambda levels: _level(levels, word)

    def _call(self, name: str) -> Evaluate:
        if name not in _FUNCTIONS:
            self._fail(f"there is no function {name!r}; there are {', '.join(_FUNCTIONS)}")
        arguments = [self._conditional()]
        while self._accept(","):
            arguments.append(self._conditional())
        self._expect(")")
        takes, function = _FUNCTIONS[name]
        if takes and len(arguments) != takes:
            self._fail(f"{name} takes one number, not {len(arguments)}")
        if name in ("min", "max"):
            return lambda levels: function([_number(argument(levels)) for argument in arguments])
        return lambda levels: float(function(_number(arguments[0](levels))))


def _level(levels: Mapping[str, object], name: str) -> Value:
    value = levels.get(name)
    if value is None:
        raise InactiveFactor(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else value  # type: ignore[return-value]


def _number(value: Value) -> float:
    if isinstance(value, bool) or not isinstance(value, float):
        raise ValueError(f"{value!r} is no number")
    # Written as `not <=`, so that NaN is refused too.
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
        first_value = terms[0](levels)
        for sign, term in zip(signs, terms[1:], strict=True):
            second_value = term(levels)
            if not (
                _EQUALITY[sign](first_value, second_value)
                if sign in _EQUALITY
                else _COMPARISONS[sign](_number(first_value), _number(second_value))
            ):
                return False
            first_value = second_value
        return True

    return holds
