"""Conditions over the columns of a table, such as `KA-18.passed == false and fog > 3`.

    condition   := conjunction ("or" conjunction)*
    conjunction := negation ("and" negation)*
    negation    := "not" negation | "(" condition ")" | value comparison value
    comparison  := "==" | "!=" | "<" | "<=" | ">" | ">="
    value       := WORD | NUMBER | "text" | 'text' | true | false | none

A word is a column, or what only one column's name begins with before a `_`; in backquotes it may hold any character. A
comparison with an empty cell is neither true nor false, as in SQL, except that `== none` asks for it. `report.js` reads the
same language.
"""

from __future__ import annotations

import difflib
import operator
import re
from collections.abc import Callable

import polars as pl

from bench.errors import SetupError

_TOKEN = re.compile(
    r"""\s*(?:(?P<sign>==|!=|<=|>=|<|>|\(|\))|(?P<text>"[^"]*"|'[^']*')|(?P<number>-?\d+(?:\.\d+)?(?:[eE]-?\d+)?)(?![\w.-])"""
    r"""|(?P<word>`[^`]+`(?:\.\w+)*|\w[\w.-]*))"""
)
_COMPARISONS: dict[str, Callable[[pl.Expr, pl.Expr], pl.Expr]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
# Chosen as for formulas of factors: no person writes deeper ones, and Python allows some hundred.
MAX_DEPTH = 40
# Of a condition, in the error that quotes it.
MAX_QUOTED_CHARACTERS = 120
_CONSTANTS = {"true": True, "false": False, "none": None}


def matching(table: pl.DataFrame, condition: str, option: str) -> pl.DataFrame:
    """The rows for which a condition is true. Raises SetupError, which names `option`, for one that cannot be read."""
    return table.filter(_Condition(table, condition, option).read().fill_null(value=False))


def words_of(table: pl.DataFrame, condition: str, option: str) -> list[str]:
    """The columns that a condition names, in its order. Raises SetupError as `matching`."""
    reader = _Condition(table, condition, option)
    reader.read()
    return list(dict.fromkeys(reader.columns))


class _Condition:
    """One condition while it is read: the tokens that are left, the last one first."""

    def __init__(self, table: pl.DataFrame, text: str, option: str) -> None:
        self.columns: list[str] = []
        self._table, self._schema, self._text, self._option = table, table.schema, text, option
        self._depth = 0
        tokens, place = [], 0
        while text[place:].strip():
            token = _TOKEN.match(text, place)
            if token is None:
                raise self._fault(f"cannot be read from {_quoted(text[place:].strip())} on")
            tokens.append((str(token.lastgroup), token[0].strip()))
            place = token.end()
        self._tokens = [("end", "its end"), *reversed(tokens)]

    def read(self) -> pl.Series:
        """The whole condition."""
        condition = self._either()
        if self._tokens[-1][0] != "end":
            raise self._fault(f"has {self._tokens[-1][1]} where it should end")
        return condition

    def _either(self) -> pl.Series:
        condition = self._both()
        while self._take("or"):
            condition = condition | self._both()
        return condition

    def _both(self) -> pl.Series:
        condition = self._negation()
        while self._take("and"):
            condition = condition & self._negation()
        return condition

    def _negation(self) -> pl.Series:
        if self._take("not"):
            return ~self._nested(self._negation)
        if self._take("("):
            condition = self._nested(self._either)
            if not self._take(")"):
                raise self._fault(f"lacks a ) before {self._tokens[-1][1]}")
            return condition
        return self._comparison()

    def _nested(self, part: Callable[[], pl.Series]) -> pl.Series:
        if self._depth == MAX_DEPTH:
            raise self._fault(f"is nested deeper than {MAX_DEPTH}", "leave out brackets")
        self._depth += 1
        condition = part()
        self._depth -= 1
        return condition

    def _comparison(self) -> pl.Series:
        left, left_kind = self._value()
        _, sign = self._tokens.pop()
        if sign not in _COMPARISONS:
            raise self._fault(f"has {sign} where a comparison should be, such as == or >=")
        right, right_kind = self._value()
        if "none" in (left_kind, right_kind):
            if sign not in ("==", "!="):
                raise self._fault(f"compares none by {sign}")
            empty = (right if left_kind == "none" else left).is_null()
            return self._holds(empty if sign == "==" else ~empty)
        if left_kind != right_kind:
            raise self._fault(f"compares a {left_kind} with a {right_kind}")
        return self._holds(_COMPARISONS[sign](left, right))

    def _holds(self, comparison: pl.Expr) -> pl.Series:
        """Where a comparison is true. At once: on two thousand comparisons in one expression Polars was at work for more than nine minutes."""
        holds = self._table.select(comparison.alias("holds"))["holds"]
        # Two constants have one answer for all rows.
        return holds if len(holds) == self._table.height else holds.new_from_index(0, self._table.height)

    def _value(self) -> tuple[pl.Expr, str]:
        """A value and its kind: number, text, truth value or none."""
        kind, token = self._tokens.pop()
        if kind == "number":
            return pl.lit(float(token)), "number"
        if kind == "text":
            return pl.lit(token[1:-1]), "text"
        if kind != "word":
            raise self._fault(f"has {token} where a value should be")
        if token in _CONSTANTS:
            return pl.lit(_CONSTANTS[token]), "none" if token == "none" else "truth value"
        column = self._column(token.replace("`", ""))
        self.columns.append(column)
        dtype = self._schema[column]
        if dtype.is_numeric():
            return pl.col(column), "number"
        return pl.col(column), "truth value" if dtype == pl.Boolean else "text"

    def _column(self, word: str) -> str:
        if word in self._schema:
            return word
        longer = [name for name in self._schema if name.startswith(f"{word}_")]
        if len(longer) == 1:
            return longer[0]
        similar = longer or difflib.get_close_matches(word, self._schema, n=4)
        remedy = (
            f"did you mean {' or '.join(similar)}?"
            if similar
            else f"words: {', '.join(list(self._schema)[:12])}, ..."
        )
        raise self._fault(f"has the word {word!r}, which is no column", f"{remedy} Text stands in quotes")

    def _take(self, token: str) -> bool:
        if self._tokens[-1] in (("word", token), ("sign", token)):
            self._tokens.pop()
            return True
        return False

    def _fault(self, what: str, remedy: str = "for example: KA-18.passed == false and fog > 3") -> SetupError:
        return SetupError(f"{self._option} {_quoted(self._text)}", what, remedy)


def _quoted(text: str) -> str:
    return repr(text if len(text) <= MAX_QUOTED_CHARACTERS else f"{text[:MAX_QUOTED_CHARACTERS]}...")
