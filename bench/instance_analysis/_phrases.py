"""Words to phrases: at every word, the longest phrase of the grammar that begins there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import cast

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedInput
from lark.parsers.lalr_interactive_parser import InteractiveParser

from ._coordinates import Coordinates
from ._tokens import Span, Word
from ._vocabulary import FieldWords, Meaning

PHRASES = (
    *("nomark", "noreport", "window", "linklost", "standoff", "slow", "loiter", "event", "intelligence", "field", "mean"),
    *(
        "bearing",
        "within",
        "atleast",
        "exact",
        "far",
        "away",
        "near",
        "road",
        "roadgap",
        "roadside",
        "crossroads",
        "inside",
        "behind",
    ),
    *("facing", "hidden", "visible", "between", "apart", "spread", "part", "group", "density", "concealment", "motion", "loop"),
    *("radius", "place", "stretch", "area", "extent", "overfly", "stayin", "landgap", "roads", "axis", "width", "weather"),
    *("clear", "calm", "wind", "gusts", "sun", "clock", "date", "set", "limit", "altitude", "speed", "ground", "when"),
)
"""Rules that may stand by themselves; of two that are equally long the earlier one holds."""
LONGEST = 24
CLAUSES = frozenset({"which", "who", "whose", "where", "when", "while", "then", "but", "because", "if", "though"})
"""Words that begin another clause: no phrase goes on past them."""


ABOUT = frozenset(["about", "approximately", "roughly", "approx", "circa", "the", "perhaps", "maybe", "very"])
"""Words that may stand inside a quantity."""
CONDITIONAL = frozenset(["nomark", "noreport", "slow", "linklost", "stretch"])
"""Rules that have a clause of their own: `no marking when a civilian is within 50 m`."""
TOLERANT = frozenset(["field", "event", "wind", "intelligence", "nomark", "noreport", "standoff"])
"""Rules that go on past words that nobody knows, which are listed all the same."""
MOST_UNKNOWN = 2
DENIALS = frozenset(
    ["not", "never", "nor", "neither", "isn't", "aren't", "don't", "doesn't", "won't", "cannot", "can't", "if", "unless"]
)
_APART = {
    "quantity": {"COUNT", "UNIT"},
    "group": {"COUNT", "ASSET", "AMBIGUOUS"},
    "wind": {"COUNT", "WIND"},
    "field": {"COUNT", "FIELD"},
}
"""What does not follow a comma inside a phrase; COUNT in all others."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number or a range of numbers in SI units, and what it measures."""

    kind: str
    low: float
    high: float
    vague: bool = False

    @property
    def single(self) -> bool:
        return self.low == self.high


@dataclass(frozen=True, slots=True)
class Part:
    """A word of a phrase in the meaning that the phrase gives it."""

    kind: str
    value: object
    span: Span


@dataclass(frozen=True, slots=True)
class Phrase:
    """A phrase with its parts in order; a `ref` is a phrase inside one."""

    rule: str
    parts: tuple[Part | Phrase, ...]
    span: Span

    def first(self, kind: str) -> Part | None:
        """The first part of a kind; None when there is none."""
        return next((one for one in self.parts if isinstance(one, Part) and one.kind == kind), None)

    def every(self, kind: str) -> list[Part]:
        return [one for one in self.parts if isinstance(one, Part) and one.kind == kind]

    @property
    def refs(self) -> list[Phrase]:
        return [one for one in self.parts if isinstance(one, Phrase) and one.rule == "ref"]


def _skipped(word: Word) -> bool:
    """Whether a phrase may go on past a word that nobody knows; past a denial it may not."""
    return word.text.isalpha() and word.text.lower() not in DENIALS


@cache
def _grammar() -> Lark:
    text = resources.files(__package__).joinpath("grammar.lark").read_text(encoding="utf-8")
    return Lark(text, parser="lalr", lexer="basic", start=["quantity", *PHRASES])


@cache
def _beginnings(rule: str) -> frozenset[str]:
    """What a phrase may begin with."""
    return frozenset(_grammar().parse_interactive(start=rule).choices())  # type: ignore[no-untyped-call]


def longest(rule: str, words: Sequence[Word], begin: int) -> tuple[Tree[Token], int] | None:
    """The longest run of words from `begin` on that the rule takes, and where it ends; None when it takes none.

    A word with several meanings is tried in each of them that the rule takes at its place.
    """
    if _beginnings(rule).isdisjoint(one.kind for one in words[begin].meanings):
        return None
    states: list[_State] = [(_grammar().parse_interactive(start=rule), ())]
    found: tuple[_Tokens, int] | None = None
    comma, apart, unknown = False, _APART.get(rule, {"COUNT"}), 0
    for index in range(begin, min(len(words), begin + LONGEST)):
        word = words[index]
        comma = (comma or word.comma) and index > begin
        if word.filler:
            if word.text.lower() in CLAUSES and index > begin and rule not in CONDITIONAL:
                break
            if rule == "quantity" and index > begin and word.text.lower() not in ABOUT:
                break  # in `six, by our count - 25 m away` nothing is 6 to 25
            continue
        if not word.meanings and rule in TOLERANT and unknown < MOST_UNKNOWN and _skipped(word):
            unknown += 1
            continue
        if rule == "quantity" and index > begin and word.text.lower() in ("a", "an", "single", "a single", "the single"):
            break  # `60 m to a radar` is no range
        following: list[_State] = []
        for state, tokens in states:
            taken = state.choices()  # type: ignore[no-untyped-call]
            for number, meaning in enumerate(word.meanings):
                if meaning.kind not in taken or (comma and meaning.kind in apart):
                    continue
                token = Token(meaning.kind, f"{index}:{number}")
                branch = _branch(state)
                try:
                    branch.feed_token(token)
                except UnexpectedInput:
                    continue
                following.append((branch, (*tokens, token)))
        if not following:
            break
        states, comma = following[:16], False
        for state, tokens in states:
            if "$END" not in state.choices():  # type: ignore[no-untyped-call]
                continue
            try:
                _branch(state).feed_eof()  # type: ignore[no-untyped-call]
            except UnexpectedInput:
                continue
            found = tokens, index + 1
            break
    return None if found is None else (_tree(rule, found[0]), found[1])


_Tokens = tuple[Token, ...]
_State = tuple[InteractiveParser, _Tokens]


def _branch(state: InteractiveParser) -> InteractiveParser:
    """A parser to go on with from a state. What it builds is shared with others, and only good to see whether it goes on."""
    return state.copy(deepcopy_values=False)  # type: ignore[no-untyped-call, no-any-return]


def _tree(rule: str, tokens: _Tokens) -> Tree[Token]:
    parser = _grammar().parse_interactive(start=rule)
    for token in tokens:
        parser.feed_token(token)
    found: Tree[Token] = parser.feed_eof()  # type: ignore[no-untyped-call]
    return found


def with_quantities(words: Sequence[Word], unknown: list[tuple[Word, Word]]) -> list[Word]:
    """The words with numbers and their units read as quantities. A number before a word that can only be a unit that
    nobody knows is added to `unknown`."""
    read: list[Word] = []
    index = 0
    while index < len(words):
        word = words[index]
        found = longest("quantity", words, index) if any(one.kind in _BEGINS for one in word.meanings) else None
        if found is None:
            read.append(word)
            index += 1
            continue
        tree, end = found
        quantity = _quantity(tree, words)
        others = tuple(one for one in word.meanings if one.kind not in _BEGINS) if end == index + 1 else ()
        span = word.span.joined(words[end - 1].span)
        if quantity is None:
            read.append(word)
            index += 1
            continue
        read.append(Word(word.text, span, (Meaning(quantity.kind, quantity), *others), comma=word.comma, mended=word.mended))
        if quantity.kind == "COUNT" and word.text not in ("a", "an") and _no_unit(words, end):
            unknown.append((word, words[end]))
        index = end
    return read


NUMBERED = {"ATMINUTE": 60.0, "ATSECOND": 1.0}
"""`at minute three`, `at second 200`: seconds of each."""
_BEGINS = {"NUM", "VAGUE", "LBR", "BETWEEN", "FROM", *NUMBERED}


def _no_unit(words: Sequence[Word], at: int) -> bool:
    """Whether a word that nobody knows stands where a unit would: before `from`, `away`, `of` or another relation."""
    if at + 1 >= len(words) or words[at].meanings or words[at].filler or words[at + 1].comma:
        return False
    return any(one.kind in ("FROM", "AWAY", "APART", "DIR", "BEFORE", "AFTER") for one in words[at + 1].meanings)


def _quantity(tree: Tree[Token], words: Sequence[Word]) -> Quantity | None:
    numbers: list[float] = []
    units: list[tuple[str, float] | None] = []
    by = False
    for token in tree.scan_values(lambda one: isinstance(one, Token)):
        value = _meaning(token, words).value
        if token.type == "VAGUE" and isinstance(value, tuple):
            return Quantity("COUNT", float(value[0]), float(value[1]), vague=True)
        if token.type == "NUM" and isinstance(value, float | int):
            numbers.append(float(value))
            units.append(None)
        elif token.type == "UNIT" and isinstance(value, tuple):
            units[-1] = value
        elif token.type == "BY":
            by = True
        elif token.type in NUMBERED:
            return _moment(token, tree, words)
    last = units[-1]
    filled = [one or last for one in units]
    kinds = {one[0] if one else "COUNT" for one in filled}
    if len(kinds) != 1:
        return None
    values = [number * (one[1] if one else 1.0) for number, one in zip(numbers, filled, strict=True)]
    values = [round(value, 9) for value in values]
    if by:
        return Quantity("DIM", values[0], values[1]) if kinds == {"LENGTH"} else None
    return Quantity(kinds.pop(), values[0], values[-1])


def _moment(before: Token, tree: Tree[Token], words: Sequence[Word]) -> Quantity | None:
    """`at minute three`, `T plus 90`; None where the number has a unit that is none of time."""
    unit = next((one for one in tree.scan_values(lambda one: isinstance(one, Token)) if one.type == "UNIT"), None)
    kind, factor = ("TIME", NUMBERED[before.type]) if unit is None else cast("tuple[str, float]", _meaning(unit, words).value)
    moment_s = factor * _number(tree, words)
    return Quantity("TIME", moment_s, moment_s) if kind == "TIME" else None


def _number(tree: Tree[Token], words: Sequence[Word]) -> float:
    value = next(_meaning(one, words).value for one in tree.scan_values(lambda one: isinstance(one, Token)) if one.type == "NUM")
    assert isinstance(value, float | int)
    return float(value)


def _meaning(token: Token, words: Sequence[Word]) -> Meaning:
    index, number = (int(one) for one in str(token).split(":"))
    return words[index].meanings[number]


def phrases_of(words: Sequence[Word]) -> Iterator[Phrase | Word]:
    """The phrases of a text, in order, and every word between them that belongs to none."""
    index = 0
    while index < len(words):
        best: tuple[str, Tree[Token], int] | None = None
        for rule in PHRASES if words[index].meanings else ():
            found = longest(rule, words, index)
            if found and (best is None or found[1] > best[2]) and not (rule == "field" and _unfit(found[0], words)):
                best = (rule, *found)
        if best is None:
            yield words[index]
            index += 1
            continue
        rule, tree, end = best
        yield _phrase(rule, tree, words)
        yield from (one for one in words[index:end] if not one.meanings and not one.filler)
        index = end


def _unfit(tree: Tree[Token], words: Sequence[Word]) -> bool:
    """Whether a number stands before a word that takes another kind: in `9 m/s, limit 5 min` it is not the limit's."""
    first, *rest = tree.scan_values(lambda one: isinstance(one, Token))
    if first.type == "FIELD":
        return _far_off(first, rest, words)
    word = next((one for one in rest if one.type == "FIELD"), None)
    quantity = _meaning(first, words).value
    if word is None or not isinstance(quantity, Quantity):
        return False
    kinds = {one.value.kind for one in words[int(str(word).split(":")[0])].meanings if isinstance(one.value, FieldWords)}
    return not kinds & {quantity.kind, "NUMBER" if quantity.kind in ("COUNT", "PERCENT") else quantity.kind}


_COUNTED = {"ASSET", "AMBIGUOUS"}


def _far_off(field: Token, rest: Sequence[Token], words: Sequence[Word]) -> bool:
    """Whether a number after a word is of another kind, and others stand between: `battery anomaly: 150 s` is no charge."""
    at = int(str(field).split(":")[0])
    kinds = {one.value.kind for one in words[at].meanings if isinstance(one.value, FieldWords)}
    taken = [int(str(one).split(":")[0]) for one in rest]
    given = [value.kind for one in rest if isinstance(value := _meaning(one, words).value, Quantity)]
    fits = any(kind in kinds or (kind in ("COUNT", "PERCENT") and "NUMBER" in kinds) or kind == "COUNT" for kind in given)
    strange = any(not one.meanings and not one.filler for one in words[at : max(taken, default=at)])
    before = words[at - 1].meanings if at else ()
    fed = any(isinstance(one.value, Quantity) and one.value.kind in kinds for one in before)
    after = next((one for one in words[max(taken, default=at) + 1 :] if not one.filler), None)
    if set(given) == {"COUNT"} and after is not None and not after.comma and any(one.kind in _COUNTED for one in after.meanings):
        return not kinds & {"NUMBER", "PERCENT"}  # `below were thirty civilians`
    return not fits and (strange or fed or words[at].text.lower().endswith(" within"))


def _phrase(rule: str, tree: Tree[Token], words: Sequence[Word]) -> Phrase:
    parts: list[Part | Phrase] = []
    for child in tree.children:
        if isinstance(child, Token):
            index = int(str(child).split(":")[0])
            word, value = words[index], _meaning(child, words).value
            if child.type == "FIELD":  # one word may be of several fields; the quantity's kind decides
                value = tuple(one.value for one in word.meanings if one.kind == "FIELD")
            parts.append(Part(child.type, value, word.span))
        elif str(child.data) in ("ref", "state", "more"):
            parts.append(_phrase(str(child.data), child, words))
        else:
            parts += _phrase(str(child.data), child, words).parts
    if rule == "place" and [one.kind for one in parts if isinstance(one, Part)] == ["AT", "ORIGIN"]:
        parts[1] = Part("POINT", Coordinates(0.0, 0.0), parts[1].span)  # `at the origin`
    spans = [one.span for one in parts]
    return Phrase(rule, tuple(parts), Span(min(s.start for s in spans), max(s.end for s in spans)))
