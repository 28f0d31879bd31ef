"""Finds phrases: at every word, the longest phrase of the grammar that begins there."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
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
    "standoff", "intelligence", "known", "comply",
    "field", "mean", "polar", "midpoint", "bearing", "within", "atleast", "exact", "away", "near", "road", "roadgap", "parallel",
    "inside", "behind", "facing", "hidden", "visible", "between", "apart", "together", "avoids",
    "spread", "part", "group", "share", "rest", "density", "concealment", "sought", "motion", "travel", "depart", "halt", "nonstop", "radius", "place", "stretch",
    "area", "extent", "overfly", "stayin", "landgap", "roads", "course", "axis", "width", "weather", "clear",
    "calm", "wind", "gusts", "sun", "clock", "date", "set", "limit", "altitude", "speed", "ground",
    "when",
)  # fmt: skip
"""Rules that may stand by themselves; of two that are equally long the earlier one holds."""
# Keeps the search linear in the length of the text. Chosen, not measured.
MAX_PHRASE_WORDS = 24
CLAUSES = frozenset(
    {"which", "who", "whose", "where", "when", "while", "then", "but", "because", "if", "though"}
)
"""Words that begin another clause: no phrase goes on past them."""


QUANTITY_FILLERS = frozenset(
    ["about", "approximately", "roughly", "approx", "circa", "the", "perhaps", "maybe", "very"]
)
"""Words that may stand inside a quantity."""
CONDITIONAL_RULES = frozenset(["stretch"])
"""Rules that go on past a word that begins another clause."""
TOLERANT_RULES = frozenset(["field", "wind", "intelligence", "standoff", "overfly"])
"""Rules that go on past words that nobody knows, which are listed all the same."""
MAX_UNKNOWN_WORDS = 2
DENIALS = frozenset(
    [
        "not", "never", "nor", "neither", "isn't", "aren't", "don't", "doesn't", "won't", "cannot", "can't",
        "if", "unless",
    ]
)  # fmt: skip
_NOT_AFTER_COMMA = {
    "quantity": {"COUNT", "UNIT"},
    "group": {"COUNT", "ASSET", "AMBIGUOUS"},
    "share": {"COUNT", "ASSET", "AMBIGUOUS"},
    "rest": {"COUNT", "ASSET", "AMBIGUOUS"},
    "wind": {"COUNT", "WIND"},
    "field": {"COUNT", "FIELD"},
    "intelligence": {"COUNT", "ASSET", "AMBIGUOUS", "THEM"},
    "atleast": {"COUNT", "ASSET", "AMBIGUOUS"},
    "within": {"COUNT", "LENGTH"},
    "radius": {"COUNT", "LENGTH"},
}
"""What does not follow a comma inside a phrase; COUNT in all others."""


_COUNTED = frozenset(["ASSET", "AMBIGUOUS"])
_VERBS = frozenset(["is", "are", "was", "were", "there", "i", "we", "you"])
_NOT_AFTER = {
    "ASSET": frozenset(["says", "said", "say", "asks", "tells"]),
    "COUNT": frozenset(["a", "an", "the", "this", "that", "i", "we", "you"]),
    **dict.fromkeys(("INSIDE", "NEAR", "BEHIND", "BESIDE", "ALONG", "BETWEEN"), _VERBS),
}
"""Fillers past which no phrase goes on after a word: `in this situation is a radar`, `test 33: I need a lane`."""


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


class Part:
    """A word of a phrase, with the meaning that it has in the phrase.

    `used` says whether its reader has asked for the value, so that the ledger knows what nobody used.
    """

    __slots__ = ("_value", "kind", "span", "used")

    def __init__(self, kind: str, value: object, span: Span) -> None:
        self.kind, self.span, self.used = kind, span, False
        self._value = value

    @property
    def value(self) -> object:
        self.used = True
        return self._value

    def disown(self) -> None:
        """Take back the use: the reader looked at the value and made nothing of it."""
        self.used = False


@dataclass(frozen=True, slots=True)
class Phrase:
    """A phrase with its parts in order. A `ref` is a phrase inside another phrase."""

    rule: str
    parts: tuple[Part | Phrase, ...]
    span: Span

    def first(self, kind: str) -> Part | None:
        """The first part of a kind, or None. It counts as used."""
        part = next((part for part in self.parts if isinstance(part, Part) and part.kind == kind), None)
        if part is not None:
            part.used = True
        return part

    def every(self, kind: str) -> list[Part]:
        """All parts of a kind. They count as used."""
        parts = [part for part in self.parts if isinstance(part, Part) and part.kind == kind]
        for part in parts:
            part.used = True
        return parts

    def has(self, *kinds: str) -> bool:
        """Whether a part of these kinds stands in the phrase; it does not count as used."""
        return any(isinstance(part, Part) and part.kind in kinds for part in self.parts)

    @property
    def leaves(self) -> list[Part]:
        """Every part, those of inner phrases included."""
        return [leaf for part in self.parts for leaf in (part.leaves if isinstance(part, Phrase) else [part])]

    @property
    def refs(self) -> list[Phrase]:
        return [part for part in self.parts if isinstance(part, Phrase) and part.rule == "ref"]


def _skipped(word: Word) -> bool:
    """Whether a phrase may continue past an unknown word. It may not continue past a denial."""
    return word.text.isalpha() and word.text.lower() not in DENIALS


def is_adjective(words: Sequence[Word], at: int) -> bool:
    """Whether an unknown word stands right before a thing, as in `two frightened hikers`. It is listed all the same."""
    following = next((word for word in words[at + 1 : at + 3] if word.meanings), None)
    between = words[at : at + 2 if following is not None and words[at + 1] is following else at + 3]
    things = following is not None and any(meaning.kind in _COUNTED for meaning in following.meanings)
    unknown = [word for word in between if word is not following]
    return things and all(
        not word.meanings and not word.filler and _skipped(word) and not words[at + 1].comma
        for word in unknown
    )


@cache
def _grammar() -> Lark:
    text = resources.files(__package__).joinpath("grammar.lark").read_text(encoding="utf-8")
    # LALR, because its interactive parser says after each word which kinds may follow; the lexer is not used.
    return Lark(text, parser="lalr", lexer="basic", start=["quantity", *PHRASES])


@cache
def _first_kinds(rule: str) -> frozenset[str]:
    """Kinds of words that a phrase of this rule may begin with."""
    return frozenset(_grammar().parse_interactive(start=rule).choices())  # type: ignore[no-untyped-call]


def longest_match(rule: str, words: Sequence[Word], begin: int) -> tuple[Tree[Token], int] | None:
    """The longest run of words from `begin` that matches the rule, and the index after it; None when nothing
    matches.

    A word with several meanings is tried in each of them that the rule takes at its place.
    """
    if _first_kinds(rule).isdisjoint(candidate.kind for candidate in words[begin].meanings):
        return None
    states: list[_State] = [(_grammar().parse_interactive(start=rule), ())]
    match: tuple[_Tokens, int] | None = None
    comma, unknown = False, 0
    for index in range(begin, min(len(words), begin + MAX_PHRASE_WORDS)):
        word = words[index]
        comma = (comma or word.comma) and index > begin
        if index > begin and _ends_before(rule, word, states):
            break
        if word.filler:
            continue
        if unknown < MAX_UNKNOWN_WORDS and _is_skipped(rule, words, index, begun=index > begin):
            unknown += 1
            continue
        states, comma = (
            _following(states, index, word, _NOT_AFTER_COMMA.get(rule, {"COUNT"}) if comma else set()),
            False,
        )
        if not states:
            break
        # Not the first match but the longest: the search goes on after a phrase is complete.
        complete = next((tokens for state, tokens in states if _is_complete(state)), None)
        match = match if complete is None else (complete, index + 1)
    return None if match is None else (_tree(rule, match[0]), match[1])


def _is_skipped(rule: str, words: Sequence[Word], index: int, *, begun: bool) -> bool:
    """Whether a phrase goes on past a word that nobody knows, which is listed all the same."""
    if begun and rule != "quantity" and is_adjective(words, index):
        return True
    return not words[index].meanings and rule in TOLERANT_RULES and _skipped(words[index])


def _ends_before(rule: str, word: Word, states: Sequence[_State]) -> bool:
    """Whether a phrase that has begun cannot go on with or past a word."""
    text = word.text.lower()
    if not word.filler:
        # `60 m to a radar` is no range.
        return rule == "quantity" and text in ("a", "an", "single", "a single", "the single")
    last = {tokens[-1].type for _, tokens in states if tokens}
    if last and all(text in _NOT_AFTER.get(kind, ()) for kind in last):
        return True
    if text in CLAUSES and rule not in CONDITIONAL_RULES:
        return True
    # In `six, by our count - 25 m away` nothing is 6 to 25, nor is anything up to one in `the system under test
    # has one radar`.
    numeric = rule == "quantity" or (rule == "group" and not last.isdisjoint(("WITHIN", "ATLEAST")))
    return numeric and text not in QUANTITY_FILLERS


def _following(states: Sequence[_State], index: int, word: Word, barred: set[str]) -> list[_State]:
    """The states after a word, in each of its meanings that a state takes and that is not barred.

    Each word may have several meanings, so the number of states could double with every word: 16 are kept.
    """
    following: list[_State] = []
    for state, tokens in states:
        taken = state.choices()  # type: ignore[no-untyped-call]
        for number, meaning in enumerate(word.meanings):
            if meaning.kind not in taken or meaning.kind in barred:
                continue
            token = Token(meaning.kind, f"{index}:{number}")
            branch = _branch(state)
            try:
                branch.feed_token(token)
            except UnexpectedInput:
                continue
            following.append((branch, (*tokens, token)))
    return following[:16]


def _is_complete(state: InteractiveParser) -> bool:
    """Whether a phrase may end in a state."""
    if "$END" not in state.choices():  # type: ignore[no-untyped-call]
        return False
    try:
        _branch(state).feed_eof()  # type: ignore[no-untyped-call]
    except UnexpectedInput:
        return False
    return True


_Tokens = tuple[Token, ...]
_State = tuple[InteractiveParser, _Tokens]


def _branch(state: InteractiveParser) -> InteractiveParser:
    """A copy of a parser state.

    Its tree is shared with the original, so it only shows whether parsing can continue.
    """
    return state.copy(deepcopy_values=False)  # type: ignore[no-untyped-call, no-any-return]


def _tree(rule: str, tokens: _Tokens) -> Tree[Token]:
    parser = _grammar().parse_interactive(start=rule)
    for token in tokens:
        parser.feed_token(token)
    tree: Tree[Token] = parser.feed_eof()  # type: ignore[no-untyped-call]
    return tree


def with_quantities(words: Sequence[Word], unknown: list[tuple[Word, Word]]) -> list[Word]:
    """The words, with numbers and their units combined to quantities.

    A number before a word that can only be an unknown unit is added to `unknown`."""
    read: list[Word] = []
    index = 0
    while index < len(words):
        word = words[index]
        if word.text in _A_SQUARE_KM and not any(
            m.kind == "COUNT" for last in read[-4:] for m in last.meanings
        ):
            # `on a square kilometre of moor` is ground, `30 people a square kilometre` are not.
            area = Quantity("AREA", 1e6, 1e6)
            word = Word(word.text, word.span, (Meaning("AREA", area),), comma=word.comma)
        match = (
            longest_match("quantity", words, index)
            if any(meaning.kind in _BEGINS for meaning in word.meanings)
            else None
        )
        if match is None:
            read.append(word)
            index += 1
            continue
        tree, end = match
        quantity = _quantity(tree, words)
        others = (
            tuple(meaning for meaning in word.meanings if meaning.kind not in _BEGINS)
            if end == index + 1
            else ()
        )
        span = word.span.joined(words[end - 1].span)
        if quantity is None or (word.text in ("a", "an") and _is_ground(words[end - 1])):
            # `in a yard of 80 by 50 m`.
            read.append(replace(word, meanings=(), filler=True) if quantity else word)
            index += 1
            continue
        read.append(
            Word(
                word.text,
                span,
                (Meaning(quantity.kind, quantity), *others),
                comma=word.comma,
                mended=word.mended,
            )
        )
        if quantity.kind == "COUNT" and word.text not in ("a", "an") and _no_unit(words, end):
            unknown.append((word, words[end]))
        index = end
    return read


_A_SQUARE_KM = ("a square kilometre", "a square kilometer")
NUMBERED = {"ATMINUTE": 60.0, "ATSECOND": 1.0}
"""`at minute three`, `at second 200`: seconds of each."""
_BEGINS = {"NUM", "VAGUE", "LBR", "BETWEEN", "FROM", *NUMBERED}


def _no_unit(words: Sequence[Word], at: int) -> bool:
    """Whether an unknown word stands in the place of a unit: before `from`, `away`, `of` or another
    relation.
    """
    if at + 1 >= len(words) or words[at].meanings or words[at].filler or words[at + 1].comma:
        return False
    return any(
        meaning.kind in ("FROM", "AWAY", "APART", "DIR", "BEFORE", "AFTER")
        for meaning in words[at + 1].meanings
    )


def _is_ground(word: Word) -> bool:
    return any(meaning.kind == "GROUND" for meaning in word.meanings)


def _quantity(tree: Tree[Token], words: Sequence[Word]) -> Quantity | None:
    tokens = _tokens(tree)
    kinds_of_tokens = {token.type for token in tokens}
    if tokens[0].type == "VAGUE" and isinstance(ends := _meaning(tokens[0], words).value, tuple):
        return Quantity("COUNT", float(ends[0]), float(ends[1]), vague=True)
    figures = _figures(tokens, words)
    last = figures[-1][1]
    if [token.type for token in tokens].count("ATSECOND") == 2 and last and figures[0][0] < figures[1][0]:
        # `H+3 to H+4 min`: the unit stands once, for both.
        figures[0] = (figures[0][0], last)
    filled = [(number, unit or last) for number, unit in figures]
    kinds = {unit[0] if unit else "COUNT" for _, unit in filled}
    if len(kinds) != 1 or (kinds != {"TIME"} and kinds_of_tokens & NUMBERED.keys()):
        return None
    [kind] = kinds
    if kind == "TIME" and "UNTIL" in kinds_of_tokens:
        # `from 60 s until 80 s` is a beginning and an end.
        return None
    # `3 ft` is 0.9144 m, and not 0.9144000000000001.
    values = [round(number * (unit[1] if unit else 1.0), 9) for number, unit in filled]
    if "BY" in kinds_of_tokens:
        measured = {"LENGTH": "DIM", "COUNT": "PAIR"}.get(kind)
        return Quantity(measured, values[0], values[1]) if measured else None
    return Quantity(kind, values[0], values[-1])


def _figures(tokens: Sequence[Token], words: Sequence[Word]) -> list[tuple[float, tuple[str, float] | None]]:
    """The numbers of a quantity, each with the unit that stands beside it."""
    figures: list[tuple[float, tuple[str, float] | None]] = []
    unit: tuple[str, float] | None = None
    for token in tokens:
        value = _meaning(token, words).value
        if token.type == "NUM" and isinstance(value, float | int):
            figures.append((float(value), unit))
            unit = None
        elif token.type == "HALF":
            figures[-1] = (figures[-1][0] + 0.5, figures[-1][1])
        elif token.type == "UNIT" and isinstance(value, tuple):
            figures[-1] = (figures[-1][0], value)
        elif token.type in NUMBERED:
            unit = ("TIME", NUMBERED[token.type])
    return figures


def _tokens(tree: Tree[Token]) -> list[Token]:
    return list(tree.scan_values(lambda token: isinstance(token, Token)))


def _meaning(token: Token, words: Sequence[Word]) -> Meaning:
    index, number = (int(part) for part in str(token).split(":"))
    return words[index].meanings[number]


def phrases_of(words: Sequence[Word]) -> Iterator[Phrase | Word]:
    """The phrases of a text in order, with every word that belongs to no phrase."""
    index = 0
    while index < len(words):
        best: tuple[str, Tree[Token], int] | None = None
        for rule in PHRASES if words[index].meanings else ():
            match = longest_match(rule, words, index)
            # Longer phrases win; of two equally long ones the earlier rule of PHRASES.
            if (
                match
                and (best is None or match[1] > best[2])
                and not (rule == "field" and _unfit(match[0], words))
                and not (rule == "altitude" and _is_a_distance(words, match[1]))
            ):
                best = (rule, *match)
        if best is None:
            yield words[index]
            index += 1
            continue
        rule, tree, end = best
        yield _phrase(rule, tree, words)
        yield from (word for word in words[index:end] if not word.meanings and not word.filler)
        index = end


def _is_a_distance(words: Sequence[Word], end: int) -> bool:
    """Whether what follows a length makes it a distance: `searches 50 m south of the chapel`."""
    following = next((word for word in words[end : end + 2] if not word.filler), None)
    kinds = {meaning.kind for meaning in following.meanings} if following is not None else set()
    return not kinds.isdisjoint(("DIR", "FROM", "AWAY", "NEXTTO"))


def _unfit(tree: Tree[Token], words: Sequence[Word]) -> bool:
    """Whether a number does not fit the word after it: in `9 m/s, limit 5 min` the speed is not the limit."""
    first, *rest = _tokens(tree)
    if first.type == "FIELD":
        return _far_off(first, rest, words)
    field = next((token for token in rest if token.type == "FIELD"), None)
    quantity = _meaning(first, words).value
    if field is None or not isinstance(quantity, Quantity):
        return False
    if _LEADING.search(words[int(str(field).split(":")[0])].text):
        # `30 m below them` is no ceiling.
        return True
    kinds = {
        token.value.kind
        for token in words[int(str(field).split(":")[0])].meanings
        if isinstance(token.value, FieldWords)
    }
    return not kinds & {quantity.kind, "NUMBER" if quantity.kind in ("COUNT", "PERCENT") else quantity.kind}


_LEADING = re.compile(r"(?:below|above|under|than|within|exceed)$", re.IGNORECASE)
"""Ends of words that a number follows, and never goes before."""


def _far_off(field: Token, rest: Sequence[Token], words: Sequence[Word]) -> bool:
    """Whether a number after a word belongs to something else: `battery anomaly: 150 s` is not a charge."""
    at = int(str(field).split(":")[0])
    kinds = {item.value.kind for item in words[at].meanings if isinstance(item.value, FieldWords)}
    taken = [int(str(item).split(":")[0]) for item in rest]
    given = [value.kind for item in rest if isinstance(value := _meaning(item, words).value, Quantity)]
    fits = any(
        kind in kinds or (kind in ("COUNT", "PERCENT") and "NUMBER" in kinds) or kind == "COUNT"
        for kind in given
    )
    strange = any(not item.meanings and not item.filler for item in words[at : max(taken, default=at)])
    previous = words[at - 1].meanings if at else ()
    fed = any(isinstance(item.value, Quantity) and item.value.kind in kinds for item in previous)
    after = next((item for item in words[max(taken, default=at) + 1 :] if not item.filler), None)
    if (
        set(given) == {"COUNT"}
        and after is not None
        and not after.comma
        and any(item.kind in _COUNTED for item in after.meanings)
    ):
        # `below were thirty civilians`.
        return not kinds & {"NUMBER", "PERCENT"}
    return not fits and (strange or fed or words[at].text.lower().endswith(" within"))


def _has(tree: Tree[Token], kind: str) -> bool:
    return any(token.type == kind for token in tree.scan_values(lambda token: isinstance(token, Token)))


def _spot(phrase: Phrase, *, from_home: bool) -> Part:
    """A place of a list, given by coordinates or by steps, as one part.

    `from 200 m west to 200 m east of home`: home is named once for all places of the list.
    """
    point = phrase.first("POINT")
    if point is not None:
        return point
    east = north = 0.0
    for length, direction in zip(phrase.every("LENGTH"), phrase.every("DIR"), strict=True):
        east, north = stepped(east, north, cast("Quantity", length.value), cast("float", direction.value))
    return Part("POINT", Coordinates(east, north, from_home=from_home), phrase.span)


def stepped(east_m: float, north_m: float, length: Quantity, direction: float) -> tuple[float, float]:
    """Metres east and north after a step of the length's lower end in a direction in degrees."""
    # Rounded, because the sine of 180 degrees is not exactly 0 in floating point.
    east_m += length.low * round(math.sin(math.radians(direction)), 9)
    north_m += length.low * round(math.cos(math.radians(direction)), 9)
    return round(east_m, 6), round(north_m, 6)


def _phrase(rule: str, tree: Tree[Token], words: Sequence[Word]) -> Phrase:
    parts: list[Part | Phrase] = []
    for child in tree.children:
        if isinstance(child, Token):
            index = int(str(child).split(":")[0])
            word, value = words[index], _meaning(child, words).value
            # One word may name several fields; the kind of the quantity decides.
            if child.type == "FIELD":
                value = tuple(part.value for part in word.meanings if part.kind == "FIELD")
            parts.append(Part(child.type, value, word.span))
        elif str(child.data) == "spot":
            parts.append(_spot(_phrase("spot", child, words), from_home=_has(tree, "HOME")))
        elif str(child.data) in ("ref", "state", "more"):
            parts.append(_phrase(str(child.data), child, words))
        else:
            parts += _phrase(str(child.data), child, words).parts
    if rule == "place" and [part.kind for part in parts if isinstance(part, Part)] == ["AT", "ORIGIN"]:
        # `at the origin`.
        parts[1] = Part("POINT", Coordinates(0.0, 0.0), parts[1].span)
    spans = [part.span for part in parts]
    return Phrase(rule, tuple(parts), Span(min(s.start for s in spans), max(s.end for s in spans)))
