"""Reads noun phrases, references, places and pieces of ground in a run of tokens."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from ._coordinates import Coordinates
from ._quantities import Quantity, QuantityParser
from ._tokens import Span
from ._vocabulary import MotionWords

_SINGULAR, _PLURAL = (
    frozenset(["it", "he", "she", "him", "her"]),
    frozenset(["they", "them", "these", "those"]),
)
PRONOUNS = _SINGULAR | _PLURAL
_DEFINITE = (
    ("all", "of", "the"), ("all", "the"), ("both", "the"), ("each", "of", "the"), ("these",), ("those",), ("both",), ("all",),
    ("the",), ("each",),
)  # fmt: skip
_HOMES = (
    ("home",), ("the", "start"), ("its", "start"), ("the", "launch", "point"), ("the", "take-off", "point"), ("the", "takeoff", "point"),
    ("the", "drone's", "start"), ("the", "home", "position"), ("the", "launch", "site"), ("the", "start", "point"), ("home", "position"),
)  # fmt: skip
_ORIGINS = (("the", "origin"), ("the", "reference", "point"))
_NAMED = frozenset(
    ["sector", "zone", "area", "box", "objective", "site", "district", "block", "field", "compound", "village"]
)  # fmt: skip
_NAMES = re.compile(
    r"alpha|alfa|bravo|charlie|delta|echo|foxtrot|golf|hotel|red|blue|green|yellow|[b-z]|\d{1,2}"
)
_TARGETS = frozenset(["target", "targets", "enemy", "enemies", "adversary", "adversaries"])
MAX_ADJECTIVES = 3


@dataclass(frozen=True, slots=True)
class NounPhrase:
    """Whom a phrase names: `five civilians`, `the truck`, `them`, `half of them`, `the rest`."""

    span: Span
    noun: str = ""
    entries: tuple[str, ...] = ()
    """Entries of the vocabulary that the noun may be."""
    count: Quantity | None = None
    article: bool = False
    """Whether the count is `a`."""
    definite: bool = False
    none: bool = False
    least: bool = False
    """Whether the count is a lower bound alone."""
    adjectives: tuple[tuple[str, Any], ...] = ()
    pronoun: str = ""
    portion: Quantity | None = None
    rest: bool = False
    target: bool = False
    convoy: bool = False
    per_km2: float | None = None
    size_m: tuple[float, ...] = ()

    @property
    def plural(self) -> bool:
        """Whether the phrase is one of several: by its number, or by its noun."""
        if self.pronoun:
            return self.pronoun in _PLURAL
        if self.count is not None:
            return self.count.high > 1
        last = self.noun.split()[-1] if self.noun else ""
        return last in _IRREGULAR or (last.endswith("s") and not last.endswith(("ss", "us")))


_IRREGULAR = frozenset(
    ["people", "persons", "men", "women", "children", "infantrymen", "gunmen", "troops", "cattle", "sheep", "firemen", "policemen"]
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Ground:
    """Ground that has a name, such as `the village`."""

    span: Span
    id: str
    definite: bool


@dataclass(frozen=True, slots=True)
class Determiner:
    """What begins a noun phrase."""

    end: int
    count: Quantity | None = None
    fields: dict[str, Any] = field(default_factory=dict)


HOME_PLACE = Coordinates(0.0, 0.0, from_home=True)


class PhraseParser(QuantityParser):
    """Reads phrases. Each method yields what begins at a token, the longest first, and the index after it."""

    def span(self, begin: int, end: int) -> Span:
        return self.tokens[begin].span.joined(self.tokens[end - 1].span)

    def starts(self, at: int, *words: str) -> bool:
        """Whether these words stand at an index."""
        return tuple(self.words[at : at + len(words)]) == words

    def _first(self, at: int, choices: tuple[tuple[str, ...], ...]) -> int:
        """The index after the first of some phrases that stands at an index; 0 where none does."""
        return next((at + len(words) for words in choices if self.starts(at, *words)), 0)

    # Noun phrases.

    def noun_phrases(self, at: int) -> Iterator[tuple[NounPhrase, int]]:
        """Every noun phrase that begins at an index."""
        if at >= len(self.tokens):
            return
        if self.word(at) in PRONOUNS:
            yield NounPhrase(self.span(at, at + 1), pronoun=self.word(at)), at + 1
        yield from self._portions(at)
        yield from self._convoys(at)
        yield from self._targets(at)
        for determiner in self._determiners(at):
            yield from self._nouns(at, determiner)

    def _determiners(self, at: int) -> Iterator[Determiner]:
        if end := self._first(at, _DEFINITE):
            for count, after in self.counts(end):
                yield Determiner(after, count, {"definite": True})
            yield Determiner(end, None, {"definite": True})
            return
        if self.word(at) in ("no", "without", "neither"):
            yield Determiner(at + 1, None, {"none": True})
            return
        yield from self._bounded(at)
        for (low, high), end in self.vocabulary.longest("vague", self.words, at):
            yield Determiner(end, Quantity("COUNT", low, high, vague=True))
        yield from self._several_counts(at)
        for count, end in self.counts(at):
            # `2 x vans`.
            yield Determiner(end + (self.word(end) in ("x", "×")), count)
        if self.word(at) in ("a", "an"):
            yield Determiner(at + 1, Quantity("COUNT", 1, 1), {"article": True})
        yield Determiner(at)

    def _several_counts(self, at: int) -> Iterator[Determiner]:
        """`1, 4 or 9`: a number of each run."""
        begin = at + (self.word(at) == "either")
        values: list[float] = []
        for value, end in self.numbers(begin):
            values, joint = [value], self.word(end)
            while joint in (",", "or") and (
                following := next(self.numbers(end + 1 + (self.word(end + 1) == "or")), None)
            ):
                values.append(following[0])
                last, (_, end), joint = (
                    joint == "or" or self.word(end + 1) == "or",
                    following,
                    self.word(following[1]),
                )
                if last:
                    yield Determiner(end, Quantity("COUNT", min(values), max(values), values=tuple(values)))
                    return

    def _bounded(self, at: int) -> Iterator[Determiner]:
        """`at least 5 and at most 9`, `up to 10`, `at least 5`."""
        least, most = (
            (("at", "least"), ("not", "less", "than"), ("not", "fewer", "than"), ("no", "fewer", "than")),
            (("at", "most"), ("up", "to"), ("not", "more", "than"), ("no", "more", "than")),
        )
        if end := self._first(at, most):
            yield from (
                Determiner(after, Quantity("COUNT", 0, count.high)) for count, after in self.counts(end)
            )
        if end := self._first(at, least):
            for low, after in self.counts(end):
                begin = after + (self.word(after) == "and")
                if upper := self._first(begin, most):
                    for high, last in self.counts(upper):
                        yield Determiner(last, Quantity("COUNT", low.low, high.high))
                yield Determiner(after, low, {"least": True})

    def _nouns(self, begin: int, determiner: Determiner) -> Iterator[tuple[NounPhrase, int]]:
        for adjectives, at in self._adjectives(determiner.end):
            for entry, end in self.vocabulary.longest("noun", self.words, at):
                phrase = NounPhrase(
                    self.span(begin, end),
                    noun=" ".join(self.words[at:end]),
                    entries=(entry,) if isinstance(entry, str) else tuple(entry),
                    count=determiner.count,
                    adjectives=adjectives,
                    **determiner.fields,
                )
                if determiner.count is not None:
                    for factor, after in self.vocabulary.longest("per_area", self.words, end):
                        yield replace(phrase, per_km2=factor, span=self.span(begin, after)), after
                yield phrase, end
            yield from self._generic(begin, determiner, at)

    def _adjectives(self, at: int) -> Iterator[tuple[tuple[tuple[str, Any], ...], int]]:
        """Every run of adjectives from an index on, the empty one first."""
        runs: list[tuple[tuple[tuple[str, Any], ...], int]] = [((), at)]
        while len(runs) <= MAX_ADJECTIVES:
            adjectives, end = runs[-1]
            match = next(
                ((name, value, after) for name in ("role", "concealment", "moving", "color")
                 for value, after in self.vocabulary.longest(name, self.words, end)),
                None,
            )  # fmt: skip
            if match is None:
                break
            runs.append(((*adjectives, match[:2]), match[2]))
        return iter(runs)

    def _generic(self, begin: int, determiner: Determiner, at: int) -> Iterator[tuple[NounPhrase, int]]:
        """A thing that the catalogue does not have, with its size: `a crane 12 by 3 by 30 m`."""
        if determiner.count is None or at >= len(self.tokens) or self.tokens[at].kind != "word":
            return
        for sides, end in self.dims(at + 1):
            if len(sides) == 3:
                yield (
                    NounPhrase(self.span(begin, end), self.words[at], count=determiner.count, size_m=sides),
                    end,
                )

    def _portions(self, at: int) -> Iterator[tuple[NounPhrase, int]]:
        """`half of them`, `two of the trucks`, `none of them`, `the rest`."""
        rests = (
            ("the", "rest", "of", "them"),
            ("the", "rest"),
            ("the", "others"),
            ("the", "remaining", "ones"),
        )
        if end := self._first(at, rests):
            yield NounPhrase(self.span(at, end), rest=True), end
        if self.starts(at, "the", "remaining") or self.starts(at, "the", "other"):
            for phrase, end in self._nouns(at, Determiner(at + 2)):
                yield replace(phrase, rest=True), end
        for value, after in self._parts(at):
            if self.word(after) == "of":
                yield from self._shares_of(at, value, after + 1)

    def _shares_of(self, at: int, value: Quantity, begin: int) -> Iterator[tuple[NounPhrase, int]]:
        """The share of a group that is named at an index."""
        if self.word(begin) in ("them", "these", "those", "which", "whom"):
            yield NounPhrase(self.span(at, begin + 1), pronoun="them", portion=value), begin + 1
        for determiner in self._determiners(begin):
            if determiner.fields.get("definite"):
                nouns = self._nouns(at, determiner)
                yield from ((replace(whole, portion=value), end) for whole, end in nouns)

    def _parts(self, at: int) -> Iterator[tuple[Quantity, int]]:
        if self.word(at) == "none":
            yield Quantity("COUNT", 0, 0), at + 1
        yield from self.counts(at)
        for value, end in self.vocabulary.longest("fractions", self.words, at):
            yield Quantity("PERCENT", value, value), end

    def _convoys(self, at: int) -> Iterator[tuple[NounPhrase, int]]:
        if self.starts(at, "the", "convoy"):
            yield NounPhrase(self.span(at, at + 2), convoy=True, definite=True), at + 2
        if self.starts(at, "a", "convoy", "of"):
            for phrase, end in self.noun_phrases(at + 3):
                yield replace(phrase, convoy=True, span=self.span(at, end)), end

    def _targets(self, at: int) -> Iterator[tuple[NounPhrase, int]]:
        for determiner in self._determiners(at):
            word, end = self.word(determiner.end), determiner.end + 1
            if word in _TARGETS and determiner.end > at:
                said = determiner.fields
                yield NounPhrase(self.span(at, end), word, (), determiner.count, target=True, **said), end

    # Places.

    def directions(self, at: int) -> Iterator[tuple[float, int]]:
        """A direction of the compass, in degrees."""
        begin = at + (self.word(at) == "due")
        yield from self.vocabulary.longest("directions", self.words, begin)

    def places(self, at: int) -> Iterator[tuple[Coordinates, int]]:
        """A place: metres in brackets, degrees, home, the origin, or steps from one of them."""
        yield from self._brackets(at)
        yield from self._degrees(at)
        for words, base in ((_HOMES, HOME_PLACE), (_ORIGINS, Coordinates(0.0, 0.0))):
            if end := self._first(at, words):
                yield base, end
        for place, end in self.steps(at):
            after = end + 1 if self.word(end) in ("of", "from") else 0
            for home in (_HOMES, _ORIGINS) if after else ():
                if last := self._first(after, home):
                    yield replace(place, from_home=home is _HOMES), last

    def steps(self, at: int) -> Iterator[tuple[Coordinates, int]]:
        """`120 m east and 40 m south`, from home."""
        for length, end in self.quantities("LENGTH", at):
            for degrees, after in self.directions(end):
                place = HOME_PLACE.moved(*_step(length, degrees))
                following = after + (self.word(after) in ("and", ","))
                for second, last in self.quantities("LENGTH", following):
                    for across, stop in self.directions(last):
                        if length.single and second.single:
                            yield place.moved(*_step(second, across)), stop
                if length.single:
                    yield place, after

    def _signed(self, at: int) -> Iterator[tuple[float, int]]:
        sign = -1.0 if self.word(at) in ("-", "−", "–") else 1.0
        begin = at + (self.word(at) in ("-", "−", "–", "+"))
        for value, end in self.numbers(begin):
            yield sign * value, end + (self.word(end) == "m")

    def _brackets(self, at: int) -> Iterator[tuple[Coordinates, int]]:
        if self.word(at) != "(":
            return
        for east, end in self._signed(at + 1):
            for north, after in self._signed(end + 1) if self.word(end) in (",", "/") else ():
                if self.word(after) == ")":
                    yield Coordinates(east, north), after + 1

    def _degrees(self, at: int) -> Iterator[tuple[Coordinates, int]]:
        for latitude, end in self._side(at, ("n", "north"), ("s", "south")):
            after = end + (self.word(end) == ",")
            for longitude, last in self._side(after, ("e", "east"), ("w", "west")):
                yield Coordinates(latitude, longitude, degrees=True), last

    def _side(self, at: int, ahead: tuple[str, ...], behind: tuple[str, ...]) -> Iterator[tuple[float, int]]:
        for value, end in self.numbers(at):
            end += self.word(end) in ("°", "degrees")
            if self.word(end) in ahead + behind:
                yield (value if self.word(end) in ahead else -value), end + 1

    # Ground.

    def grounds(self, at: int) -> Iterator[tuple[Ground, int]]:
        """Ground that has a name: `the village`, `sector Bravo`."""
        begin = at + (self.word(at) in ("the", "a", "an"))
        definite = self.word(at) not in ("a", "an")
        if self.word(begin) in _NAMED and _NAMES.fullmatch(self.word(begin + 1)):
            name = f"{self.word(begin)}-{self.word(begin + 1)}"
            yield Ground(self.span(at, begin + 2), name, definite), begin + 2
        for word, end in self.vocabulary.longest("ground", self.words, begin):
            yield Ground(self.span(at, end), re.sub(r"[^a-z]+", "-", word), definite), end

    def corners(self, at: int) -> Iterator[tuple[tuple[Coordinates, ...], int]]:
        """Three places or more, one after another."""
        corners: list[Coordinates] = []
        end = at
        while (place := next(self.places(end), None)) is not None:
            corners.append(place[0])
            at = place[1]
            end = at + (self.word(at) == ",")
            end += self.word(end) == "and"
        if len(corners) >= 3:
            yield tuple(corners), at

    def ways(self, at: int) -> Iterator[tuple[tuple[Coordinates, ...], int]]:
        """Two places or more, one after another: `(0, 0) to (50, 0)`, `between ... and ...`."""
        places: list[Coordinates] = []
        end, ends = at, []
        while (
            place := next((pair for read in (self.places, self.steps) for pair in read(end)), None)
        ) is not None:
            places.append(place[0])
            ends.append(place[1])
            joint = place[1] + (self.word(place[1]) == ",")
            end = joint + (self.word(joint) in ("to", "and", "via", "over", "then"))
            if end == place[1]:
                break
        for number in range(len(places), 1, -1):
            yield tuple(places[:number]), ends[number - 1]

    def references(self, at: int) -> Iterator[tuple[Any, int]]:
        """Whom or what a relation is to: a place, or a noun phrase."""
        yield from self.places(at)
        yield from self.noun_phrases(at)

    def motions(self, at: int) -> Iterator[tuple[MotionWords, int]]:
        """A verb of motion."""
        yield from self.vocabulary.longest("motion", self.words, at)


def step_of(length: float, degrees: float) -> tuple[float, float]:
    angle = math.radians(degrees)
    return length * round(math.sin(angle), 9), length * round(math.cos(angle), 9)


def _step(length: Quantity, degrees: float) -> tuple[float, float]:
    return step_of(length.low, degrees)
