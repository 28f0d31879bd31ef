"""Small expressions over factors: `crowd * 0.05 + 2`, `gps == 'degraded' and not night`.

Numbers, quoted texts, true and false, factors by name; `+ - * / % **`, comparisons, `and`, `or`, `not`, `a if
b else c`, brackets, and min, max, abs, round, floor, ceil, sqrt. There are no attributes, other calls or
loops, so an expression from an untrusted file always ends and has no side effects. Names may contain hyphens:
`fog-level` is one name, `fog - level` is a difference.

Python's own parser reads them, word by word translated; of its syntax only what is listed here passes.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from bisect import bisect, bisect_left
from collections.abc import Callable, Mapping
from dataclasses import dataclass

Value = bool | float | str

MAX_CHARACTERS = 500

MAX_DEPTH = 40

MAX_NUMBER = 1e300

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<text>'[^']*'|\"[^\"]*\")"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*(?:-[A-Za-z0-9_]+)*)|(?P<sign>\*\*|==|!=|<=|>=|[-+*/%()<>,]))"
)

_KEYWORDS = {word: word for word in ("and", "or", "not", "if", "else")} | {"true": "True", "false": "False"}

_WORK: dict[type[ast.AST], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Pow: math.pow,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}

_FUNCTIONS: dict[str, Callable[..., float]] = {
    "min": min,
    "max": max,
    "abs": abs,
    "round": round,
    "floor": math.floor,
    "ceil": math.ceil,
    "sqrt": math.sqrt,
}


class InactiveFactor(Exception):
    """The expression reads an inactive factor and therefore has no value."""


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed expression, the names in it, and the texts and truth values that names are compared with."""

    text: str
    names: frozenset[str]
    compared: frozenset[tuple[str, str | bool]]
    _tree: ast.expr

    def value(self, levels: Mapping[str, object]) -> Value:
        """The value at these levels; every number is a float.

        Raises ValueError with a sentence when there is none (division by zero, a text among numbers), and
        InactiveFactor when it reads a name that `levels` lacks.
        """
        try:
            return _value(self._tree, levels)
        except (ArithmeticError, ValueError) as error:
            shown = ", ".join(f"{name}={levels[name]}" for name in sorted(self.names) if name in levels)
            raise ValueError(f"{self.text!r} has no value at {shown or 'any level'}: {error}") from None

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
    reader = _Reader()
    try:
        tree = reader.read(text)
    except ValueError as error:
        raise ValueError(f"{text!r}: {error}") from None
    return Expression(text, frozenset(reader.names), frozenset(reader.compared), tree)


class _Reader:
    """Reads one expression; fills `names` and `compared` while it does."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self.compared: set[tuple[str, str | bool]] = set()
        self._words: list[str] = []
        self._translated: list[str] = []

    def read(self, text: str) -> ast.expr:
        self._translate(text.rstrip())
        try:
            tree = ast.parse(" ".join(self._translated), mode="eval").body
        except SyntaxError as error:
            raise ValueError(self._explanation(error)) from None
        except (MemoryError, RecursionError):
            raise ValueError(f"is nested deeper than {MAX_DEPTH}") from None
        self._check(tree, 1)
        return tree

    def _translate(self, text: str) -> None:
        """Put it into Python word by word: names become `n0`, `n1` ..., so that none is a word of Python's."""
        place = depth = 0
        while place < len(text):
            match = _TOKEN.match(text, place)
            if match is None:
                raise ValueError(f"{text[place:].strip()[:1]!r} is not allowed in an expression")
            place, kind = match.end(), str(match.lastgroup)
            word = match[kind]
            depth += (word == "(") - (word == ")")
            # A limit far below that of Python's parser: a hostile file gets a sentence, whatever the version.
            if depth > MAX_DEPTH:
                raise ValueError(f"is nested deeper than {MAX_DEPTH}")
            translated = word
            if kind == "number":
                if float(word) > MAX_NUMBER:
                    raise ValueError(f"{word} is larger than {MAX_NUMBER:g}")
                translated = repr(float(word))
            elif kind == "text":
                # Python would join two texts in a row.
                if self._words and self._words[-1][0] in "'\"":
                    raise ValueError(f"{word} cannot stand after {self._words[-1]}")
                translated = repr(word[1:-1])
            elif kind == "name":
                translated = _KEYWORDS.get(word, f"n{len(self._words)}")
            self._words.append(word)
            self._translated.append(translated)

    def _explanation(self, error: SyntaxError) -> str:
        """What Python's parser says, in the words of the expression."""
        if not error.offset:
            return "a number, a text or a factor is missing at the end"
        starts = [sum(len(word) + 1 for word in self._translated[:n]) for n in range(len(self._translated))]
        first = bisect(starts, error.offset - 1) - 1
        if "comma" in error.msg:
            last = bisect_left(starts, (error.end_offset or 0) - 1)
            return f"a sign or a comma is missing in {' '.join(self._words[first:last])!r}"
        if not error.msg.startswith("invalid syntax"):
            return error.msg
        after = f"after {self._words[first - 1]!r}" if first else "at the beginning"
        return f"{self._words[first]!r} cannot stand {after}"

    def _check(self, node: ast.AST, depth: int) -> None:
        """Raise ValueError for whatever the words allow and the language does not; give names their spelling."""
        if depth > MAX_DEPTH:
            raise ValueError(f"is nested deeper than {MAX_DEPTH}")
        children = [child for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr)]
        match node:
            case ast.Name():
                node.id = self._words[int(node.id.removeprefix("n"))]
                self.names.add(node.id)
            case ast.Call():
                children = node.args
                name = self._words[int(node.func.id[1:])] if isinstance(node.func, ast.Name) else "(...)"
                node.func = ast.Name(name)
                if node.keywords:
                    raise ValueError("'*' and '**' stand between two numbers")
                if name not in _FUNCTIONS:
                    raise ValueError(f"there is no function {name!r}; there are {', '.join(_FUNCTIONS)}")
                if len(children) != 1 and not (children and name in ("min", "max")):
                    raise ValueError(f"{name} takes one number, not {len(children)}")
            case ast.Tuple():
                raise ValueError("a comma stands between the arguments of min or max, and nowhere else")
            case ast.Starred():
                raise ValueError("'*' and '**' stand between two numbers")
        for child in children:
            # A long sum is no deep one, although its tree is.
            self._check(child, depth + (child is not getattr(node, "left", None)))
        if isinstance(node, ast.Compare):
            self._note_compared(node)

    def _note_compared(self, node: ast.Compare) -> None:
        for sign, *pair in zip(node.ops, [node.left, *node.comparators], node.comparators, strict=False):
            for terms in (pair, pair[::-1]):
                match sign, *terms:
                    case ast.Eq() | ast.NotEq(), ast.Name(id=name), ast.Constant(
                        value=str() | bool() as value
                    ):
                        self.compared.add((name, value))


def _value(node: ast.expr, levels: Mapping[str, object]) -> Value:
    match node:
        case ast.Name():
            return _level(levels, node.id)
        case ast.Constant(value=bool() | float() | str() as constant):
            return constant
        case ast.BinOp():
            first, second = _number(_value(node.left, levels)), _number(_value(node.right, levels))
            return _number(_WORK[type(node.op)](first, second))
        case ast.Compare():
            return _compare(node, levels)
        case ast.BoolOp():
            decisive = isinstance(node.op, ast.Or)
            return any(_truth(_value(term, levels)) is decisive for term in node.values) is decisive
        case ast.IfExp():
            return _value(node.body if _truth(_value(node.test, levels)) else node.orelse, levels)
        case ast.UnaryOp(op=ast.Not()):
            return not _truth(_value(node.operand, levels))
        case ast.UnaryOp():
            number = _number(_value(node.operand, levels))
            return -number if isinstance(node.op, ast.USub) else number
        case ast.Call(func=ast.Name(id=name)):
            numbers = [_number(_value(argument, levels)) for argument in node.args]
            return float(_FUNCTIONS[name](numbers) if name in ("min", "max") else _FUNCTIONS[name](*numbers))
    raise AssertionError(node)


def _compare(node: ast.Compare, levels: Mapping[str, object]) -> bool:
    first = _value(node.left, levels)
    for sign, term in zip(node.ops, node.comparators, strict=True):
        second = _value(term, levels)
        if isinstance(sign, ast.Eq | ast.NotEq):
            holds = (first == second) is isinstance(sign, ast.Eq)
        else:
            holds = bool(_WORK[type(sign)](_number(first), _number(second)))
        if not holds:
            return False
        first = second
    return True


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
