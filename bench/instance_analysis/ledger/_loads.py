"""Finds what the words of a text say: numbers in SI, and the words that change what a clause says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources

from bench.documents import Document, read_document

from ..language._pattern import SlotParser
from ..language._tokens import Span, Token, tokens_of
from ..language._vocabulary import Vocabulary

KINDS = ("LENGTH", "SPEED", "TIME", "ANGLE", "AREA", "ENERGY", "PERCENT")
_PREPOSITIONS = frozenset(["over", "under", "above", "below", "beyond", "within"])
"""Words that are bounds before a number alone."""
HARD = frozenset(["negation", "condition", "share", "alternative", "lower", "upper", "quantifier"])
"""Loads that a rewrite must quote, and that a sentence has as often as its words."""


class Concepts(Document):
    """The document `concepts.yaml`."""

    loads: dict[str, tuple[str, ...]]
    topics: dict[str, tuple[str, ...]]
    pronouns: tuple[str, ...]
    passives: tuple[str, ...]


@cache
def concepts() -> Concepts:
    """The words of loads and topics."""
    text = resources.files(__package__).joinpath("concepts.yaml").read_text(encoding="utf-8")
    return read_document(text, Concepts, source="concepts.yaml")


@dataclass(frozen=True, slots=True)
class Number:
    """A number of a text in SI units, what it measures, the thing that it counts, and its place."""

    kind: str
    value: float
    span: Span
    thing: str = ""
    figures: tuple[float, ...] = ()
    """As it is written, without its unit."""
    known: bool = False
    """Whether it is the number of something that was told before: `the two trucks`."""

    def is_like(self, other: Number) -> bool:
        """Whether two numbers are one, within a ten-thousandth. A share may be a plain number."""
        plain = {self.kind, other.kind} <= {"COUNT", "PERCENT", "ANGLE"}
        if other.kind == "COUNT" and not other.thing and other.value in self.figures:
            # `gusting 14`, `second 90`: the sentence has the unit that the words leave out.
            return True
        return (self.kind == other.kind or plain) and abs(self.value - other.value) <= 1e-4 * max(
            1.0, abs(other.value)
        )


@dataclass(frozen=True, slots=True)
class Load:
    """A word that changes what its clause says."""

    kind: str
    text: str
    span: Span


class TextLoads:
    """Everything that the words of a text say, as the ledger compares it."""

    def __init__(self, text: str, vocabulary: Vocabulary) -> None:
        self.tokens: Sequence[Token] = [token for token in tokens_of(text) if token.text not in ("\n", '"')]
        self.words = [token.text for token in self.tokens]
        self._parser = SlotParser(self.tokens, vocabulary)
        self._vocabulary = vocabulary
        every = list(self._numbers())
        self.numbers = [number for number in every if not number.known]
        self.known = [number for number in every if number.known]
        self.loads = list(self._loads())

    def counted(self) -> Counter[str]:
        """How many loads there are of each kind."""
        return Counter(load.kind for load in self.loads)

    def has(self, words: Sequence[str]) -> bool:
        """Whether one of some words or stems stands in the text."""
        return any(True for _ in self._places(words))

    def _places(self, words: Sequence[str]) -> Iterator[tuple[int, int]]:
        table = _stems(tuple(words))
        for at in range(len(self.words)):
            for length in sorted(table, reverse=True):
                run = self.words[at : at + length]
                if len(run) == length and any(_fits(run, stem) for stem in table[length]):
                    yield at, at + length
                    break

    def _numbers(self) -> Iterator[Number]:
        at = 0
        while at < len(self.tokens):
            end = at
            for number, after in self._numbers_at(at):
                yield number
                end = max(end, after)
            at = max(end, at + 1)

    def _numbers_at(self, at: int) -> list[tuple[Number, int]]:
        """The numbers of the longest quantity at a token; none where there is none."""
        for read in (self._moments_at, self._sides_at, self._quantity_at):
            if numbers := list(read(at)):
                return numbers
        return []

    def _moments_at(self, at: int) -> Iterator[tuple[Number, int]]:
        """A time of day or a date."""
        parser = self._parser
        for clock, end in parser.slot("clock", at)[:1]:
            yield Number("CLOCK", 60.0 * clock.at.hour + clock.at.minute, parser.span(at, end)), end
        for day, end in parser.slot("date", at)[:1]:
            yield Number("DATE", float(day.toordinal()), parser.span(at, end)), end

    def _sides_at(self, at: int) -> Iterator[tuple[Number, int]]:
        """`600 by 400 m`: the unit stands once, for all of them."""
        for sides, end in self._parser.slot("dim", at)[:1]:
            yield from ((Number("LENGTH", side, self._parser.span(at, end)), end) for side in sides)

    def _quantity_at(self, at: int) -> Iterator[tuple[Number, int]]:
        quantities = [pair for kind in KINDS for pair in self._parser.quantities(kind, at)]
        quantities += self._parser.counts(at)
        if not quantities:
            return
        quantity, end = max(quantities, key=lambda item: item[1])
        known = quantity.kind == "COUNT" and at > 0 and self.words[at - 1] == "the"
        figures = self._figures(at, end)
        span, thing = self._parser.span(at, end), self._thing_after(quantity.kind, end)
        for value in dict.fromkeys((quantity.low, quantity.high)):
            if quantity.kind != "COUNT" or value != 1.0:
                # `a radar` is one radar: a single one is no number that a sentence could lose.
                yield Number(quantity.kind, value, span, thing, figures, known), end

    def _figures(self, at: int, end: int) -> tuple[float, ...]:
        """The numbers as they are written, whatever their unit."""
        return tuple(value for begin in range(at, end) for value, _ in self._parser.numbers(begin))

    def _thing_after(self, kind: str, at: int) -> str:
        """The noun that a number counts, within the next words."""
        if kind != "COUNT":
            return ""
        for begin in range(at, min(at + 3, len(self.words))):
            for entry, _ in self._vocabulary.longest("noun", self.words, begin):
                return entry if isinstance(entry, str) else ""
        return ""

    def _loads(self) -> Iterator[Load]:
        covered: set[int] = set()
        for at, first in enumerate(self.words):
            for kind, stem in _load_stems(first):
                run = self.words[at : at + len(stem)]
                if at not in covered and len(run) == len(stem) and _fits(run[1:], stem[1:]):
                    covered |= set(range(at, at + len(stem)))
                    if not self._is_idle(kind, run, at + len(stem)):
                        yield Load(kind, " ".join(run), self._parser.span(at, at + len(stem)))
                    break

    def _is_idle(self, kind: str, run: Sequence[str], end: int) -> bool:
        """Whether a word changes nothing here: `after 45 s` is no condition, `under rain` no bound."""
        number = bool(self._parser.slot("moment", end)) or any(True for _ in self._parser.numbers(end))
        if kind == "condition":
            return number
        return len(run) == 1 and run[0] in _PREPOSITIONS and not number

    def nouns(self) -> list[tuple[tuple[str, ...], str]]:
        """Every noun of the vocabulary with the entries that it may be, in order."""
        nouns: list[tuple[tuple[str, ...], str]] = []
        at = 0
        while at < len(self.words):
            match = next(iter(self._vocabulary.longest("noun", self.words, at)), None)
            if match is not None:
                entries = (match[0],) if isinstance(match[0], str) else tuple(match[0])
                nouns.append((entries, " ".join(self.words[at : match[1]])))
            at = at + 1 if match is None else match[1]
        return nouns

    def things(self) -> list[tuple[str, str]]:
        """Every entry that a noun of the text may be, with its exact asset, in order."""
        assets = self._vocabulary.assets
        return [(entry, assets[entry].named_by(noun)) for entries, noun in self.nouns() for entry in entries]

    def roles(self) -> list[object]:
        """The roles that stand before a noun: `the link is lost` tells of nobody."""
        return [
            value
            for at in range(len(self.words))
            for value, end in self._vocabulary.longest("role", self.words, at)[:1]
            if any(self._vocabulary.longest("noun", self.words, begin) for begin in range(end, end + 3))
        ]

    def direction(self, at: int) -> float | None:
        """The direction of the compass at a token, where that is none of a longer word before it."""
        entries = self._vocabulary.longest("directions", self.words, at)
        return float(entries[0][0]) if entries else None

    def table(self, name: str) -> list[object]:
        """The values of a table of the vocabulary for the words of the text, in order."""
        return [
            entries[0][0]
            for at in range(len(self.words))
            if (entries := self._vocabulary.longest(name, self.words, at))
        ]


@cache
def _stems(words: tuple[str, ...]) -> Mapping[int, list[list[str]]]:
    table: dict[int, list[list[str]]] = {}
    for word in words:
        table.setdefault(len(word.split()), []).append(word.split())
    return table


@cache
def _every_load() -> list[tuple[str, list[str]]]:
    """The stems of every load with its kind, the longest first."""
    loads = [(kind, word.split()) for kind, words in concepts().loads.items() for word in words]
    return sorted(loads, key=lambda load: -len(load[1]))


@lru_cache(maxsize=10_000)
def _load_stems(first: str) -> list[tuple[str, list[str]]]:
    """The loads that may begin with a word: texts repeat their words, and few of them begin any."""
    return [(kind, stem) for kind, stem in _every_load() if _fits([first], stem[:1])]


def _fits(run: Sequence[str], stem: Sequence[str]) -> bool:
    return all(
        word.startswith(part[:-1])
        if part.endswith("*")
        else word == part or (part == "n't" and word.endswith("n't"))
        for word, part in zip(run, stem, strict=True)
    )
