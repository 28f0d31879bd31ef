"""Numbers with their units, in SI; times of day and dates."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bench.simspec import Environment

from ._tokens import Token, number_of
from ._vocabulary import Vocabulary

MONTHS = (
    "january", "february", "march", "april", "may", "june", "july", "august", "september", "october", "november",
    "december",
)  # fmt: skip
USUAL_YEAR = Environment().start_utc.year
"""The year of a date that has none: that of a SimSpec without a start."""
ZONES_H = {
    "utc": 0,
    "gmt": 0,
    "z": 0,
    "zulu": 0,
    "cest": 2,
    "cet": 1,
    "bst": 1,
    "eest": 3,
    "eet": 2,
    "msk": 3,
}
_TENS = {"twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety"}
_JOINTS = frozenset(["to", "-", "–", "—", "till"])
_ARTICLES = ("a", "an")


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number or a range of numbers in SI units, and what it measures."""

    kind: str
    low: float
    high: float
    vague: bool = False
    values: tuple[float, ...] = ()
    """Where it is one of several numbers."""

    @property
    def single(self) -> bool:
        return self.low == self.high


@dataclass(frozen=True, slots=True)
class TimeOfDay:
    """A time of day. `zoned` when the prose gives a time zone, `ahead_h` hours ahead of UTC."""

    at: dt.time
    zoned: bool
    ahead_h: int = 0


class QuantityParser:
    """Reads the quantities in a run of tokens. Each method yields what begins at a token and the index after it."""

    def __init__(self, tokens: Sequence[Token], vocabulary: Vocabulary) -> None:
        self.tokens, self.vocabulary = tokens, vocabulary
        self.words = [token.text for token in tokens]
        self._numbers_at: dict[int, tuple[tuple[float, int], ...]] = {}

    def word(self, at: int) -> str:
        """The token at an index; an empty text past the end."""
        return self.words[at] if at < len(self.words) else ""

    def numbers(self, at: int) -> Iterator[tuple[float, int]]:
        """A number in figures or words, the longest first."""
        if at not in self._numbers_at:
            # Each kind of quantity asks for it again.
            self._numbers_at[at] = tuple(self._read_numbers(at))
        return iter(self._numbers_at[at])

    def _read_numbers(self, at: int) -> Iterator[tuple[float, int]]:
        if at >= len(self.tokens):
            return
        value = number_of(self.tokens[at])
        if value is not None:
            yield value, at + 1
            return
        first, _, second = self.words[at].partition("-")
        table = self.vocabulary.tables["numbers"]
        if first in _TENS and second in table:
            yield table[first] + table[second], at + 1
        if second == "odd" and first in table:
            yield table[first], at + 1
        for number, end in self.vocabulary.longest("numbers", self.words, at):
            yield from self._grown(number, end)

    def _grown(self, number: float, end: int) -> Iterator[tuple[float, int]]:
        """A number in words with the hundreds, tens and ones that follow it: `two hundred and forty`."""
        if self.word(end) == "hundred" and 1 < number < 10:
            yield from self._grown(100 * number, end + 1)
        hundreds, tens = number >= 100 and number % 100 == 0, number in range(20, 100, 10)
        after = end + (hundreds and self.word(end) == "and")
        value = self._word_number(after)
        if 0 < value < (100 if hundreds else 10 if tens else 0):
            yield from self._grown(number + value, after + 1)
        yield number, end

    def _word_number(self, at: int) -> float:
        """The whole number that one word is; 0 for another word, and for figures."""
        table = self.vocabulary.tables["numbers"]
        first, _, second = self.word(at).partition("-")
        value = table.get(first, 0) + (table.get(second, 0.5) if second else 0)
        return float(value) if value % 1 == 0 else 0.0

    def units(self, kind: str, at: int) -> Iterator[tuple[float, int]]:
        """The factor of a unit of a kind; a hyphen may stand before it."""
        at += self.word(at) == "-"
        for (name, factor), end in self.vocabulary.longest("unit", self.words, at):
            if name == kind:
                yield factor, end

    def _figures(self, kind: str, at: int) -> Iterator[tuple[float, float, int]]:
        """A number with a unit of the kind, and the unit's factor: `80 m`, `a minute`, `half a minute`."""
        for number, end in self.numbers(at):
            yield from ((round(number * factor, 9), factor, after) for factor, after in self.units(kind, end))
        yield from self._hyphened(kind, at)
        if self.word(at) == "half" and self.word(at + 1) in _ARTICLES:
            yield from ((0.5 * factor, factor, end) for factor, end in self.units(kind, at + 2))
        if self.word(at) in _ARTICLES and self.word(at + 1) not in ("second", "degree"):
            for factor, end in self.units(kind, at + 1):
                if self.words[end : end + 3] == ["and", "a", "half"]:
                    yield 1.5 * factor, factor, end + 3
                yield factor, factor, end

    def _hyphened(self, kind: str, at: int) -> Iterator[tuple[float, float, int]]:
        """`the two-minute mark`."""
        number, _, unit = self.word(at).partition("-")
        value = self.vocabulary.tables["numbers"].get(number)
        name, factor = self.vocabulary.tables["unit"].get(unit, ("", 0.0))
        if value is not None and name == kind:
            yield round(value * factor, 9), factor, at + 1

    def quantities(self, kind: str, at: int) -> Iterator[tuple[Quantity, int]]:
        """A number or a range of numbers with units of the kind; the range first."""
        begin = at + (self.word(at) == "between")
        figures = list(self._figures(kind, begin))
        lows = [(low, 0.0, end) for low, _, end in figures] + [
            (low, 1.0, end) for low, end in self.numbers(begin)
        ]
        for low, bare, end in lows:
            if self._joins(end, between=begin > at):
                for high, factor, after in self._figures(kind, end + 1):
                    # `20 to 40 m`: the unit stands once, for both.
                    yield Quantity(kind, round(low * factor, 9) if bare else low, high), after
        if begin == at:
            yield from ((Quantity(kind, value, value), end) for value, _, end in figures)

    def _joins(self, at: int, *, between: bool) -> bool:
        return self.word(at) in _JOINTS or (between and self.word(at) == "and")

    def counts(self, at: int) -> Iterator[tuple[Quantity, int]]:
        """A whole number or a range of whole numbers without a unit."""
        begin = at + (self.word(at) == "between")
        for low, end in self.numbers(begin):
            if self._joins(end, between=begin > at):
                yield from ((Quantity("COUNT", low, high), after) for high, after in self.numbers(end + 1))
            if begin == at:
                yield Quantity("COUNT", low, low), end

    def shares(self, at: int) -> Iterator[tuple[Quantity, int]]:
        """A share: a percentage, a fraction in words, or a number up to 1."""
        yield from self.quantities("PERCENT", at)
        for value, end in self.vocabulary.longest("fractions", self.words, at):
            yield Quantity("PERCENT", value, value), end
        for count, end in self.counts(at):
            if count.high <= 1.0:
                yield Quantity("PERCENT", count.low, count.high), end

    def dims(self, at: int) -> Iterator[tuple[tuple[float, ...], int]]:
        """Two or three lengths: `600 by 400 m`, `12 x 3 x 30 m`, `a square of 200 m`."""
        sides: list[float] = []
        unit = 0.0
        end = at
        while (number := next(self.numbers(end), None)) is not None:
            sides.append(number[0])
            end = number[1]
            factor = next(self.units("LENGTH", end), None)
            unit, end = factor or (unit, end)
            if self.word(end) not in ("by", "x", "×"):
                break
            end += 1
        if len(sides) in (2, 3) and unit:
            yield tuple(round(side * unit, 6) for side in sides), end

    def clocks(self, at: int) -> Iterator[tuple[TimeOfDay, int]]:
        """A time of day: `14:30 UTC`, `0930Z`, `2200`, `3 pm`."""
        text, after = self.word(at), self.word(at + 1)
        clock = re.fullmatch(r"(\d{1,2}):(\d\d)|(\d\d)(\d\d)", text)
        digits = [int(part) for part in clock.groups() if part] if clock else []
        half = {"am": 0, "pm": 12, "a.m": 0, "p.m": 12}.get(after)
        if half is not None and (clock or re.fullmatch(r"\d{1,2}", text)):
            hour, minute = digits or [int(text), 0]
            yield from self._zoned(hour % 12 + half, minute, at + 2)
        elif clock and (":" in text or after in (*ZONES_H, "hours", "hrs", "h")):
            yield from self._zoned(digits[0], digits[1], at + 1)

    def _zoned(self, hour: int, minute: int, at: int) -> Iterator[tuple[TimeOfDay, int]]:
        at += self.word(at) in ("hours", "hrs", "h")
        zone = ZONES_H.get(self.word(at))
        if hour < 24 and minute < 60:
            yield TimeOfDay(dt.time(hour, minute), zone is not None, zone or 0), at + (zone is not None)

    def dates(self, at: int) -> Iterator[tuple[dt.date, int]]:
        """A day: `3 March 2026`, `March 3, 2026`, `2026-03-03`, `the 3rd of March`."""
        if at < len(self.tokens) and self.tokens[at].kind == "iso":
            year, number, day_of_month = map(int, self.words[at].split("-"))
            yield from _day(year, number, day_of_month, at + 1)
        at += self.word(at) == "the"
        day, end = self._day_of_month(at)
        end += self.word(end) == "of"
        month = _month(self.word(end))
        if day and month:
            yield from self._with_year(month, day, end + 1)
        elif month := _month(self.word(at)):
            day, end = self._day_of_month(at + 1)
            if day:
                yield from self._with_year(month, day, end + (self.word(end) == ","))

    def _day_of_month(self, at: int) -> tuple[int, int]:
        match = re.fullmatch(r"(\d{1,2})", self.word(at))
        ordinal = self.word(at + 1) in ("st", "nd", "rd", "th")
        return (int(match[1]), at + 1 + ordinal) if match else (0, at)

    def _with_year(self, month: int, day: int, at: int) -> Iterator[tuple[dt.date, int]]:
        if re.fullmatch(r"\d{4}", self.word(at)):
            yield from _day(int(self.word(at)), month, day, at + 1)
        yield from _day(USUAL_YEAR, month, day, at - (self.word(at - 1) == ","))


def _month(word: str) -> int:
    """The number of a month, which may be abbreviated to three letters; 0 for another word."""
    return next((n for n, name in enumerate(MONTHS, start=1) if len(word) > 2 and name.startswith(word)), 0)


def _day(year: int, month: int, day: int, end: int) -> Iterator[tuple[dt.date, int]]:
    try:
        yield dt.date(year, month, day), end
    except ValueError:
        return
