"""Patterns of sentences: words, slots, options and repetitions, matched against tokens.

`[do] not|never mark (a target / anything) within {length} of <people>`: brackets hold what may be absent, parentheses
alternatives parted by ` / `, `(...)*` what may be repeated, `a|b` single words, `{slot:name}` a phrase that a parser
reads, `<name>` a part that several patterns share.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ._phrases import PhraseParser
from ._tokens import Span

_PART = re.compile(r"\[|\]\*?|\(|\)\*?|/(?=\s)|\{[a-z_]+(?::[a-z_]+)?\}|[^\s\[\]()]+")


@dataclass(frozen=True, slots=True)
class Capture:
    """What a slot holds, and its tokens."""

    name: str
    value: Any
    begin: int
    end: int


Captures = tuple[Capture, ...]
Node = Callable[["SlotParser", int], Iterator[tuple[int, Captures]]]


class SlotParser(PhraseParser):
    """Reads the slots of patterns, each once for each token."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._slots_read: dict[tuple[str, int], list[tuple[Any, int]]] = {}

    def slot(self, kind: str, at: int) -> list[tuple[Any, int]]:
        """Every value of a slot of a kind that begins at an index, with the index after it."""
        key = (kind, at)
        if key not in self._slots_read:
            self._slots_read[key] = [] if at >= len(self.tokens) else list(_SLOTS[kind](self, at))
        return self._slots_read[key]

    def span_of(self, capture: Capture) -> Span:
        return self.span(capture.begin, capture.end)

    def levels(self, at: int) -> Iterator[tuple[tuple[float, float], int]]:
        """`level 3`, `level 2 to 5`, `light`, `light to heavy`, as the lowest and the highest level."""
        begin = at + (self.word(at) == "level")
        if begin > at or self.word(at - 1) in ("level", "at", "of"):
            yield from (((count.low, count.high), end) for count, end in self.counts(begin))
        for low, end in self.vocabulary.longest("intensities", self.words, at):
            for high, after in (
                self.vocabulary.longest("intensities", self.words, end + 1) if self.word(end) == "to" else ()
            ):
                yield (low, high), after
            yield (low, low), end

    def moments(self, at: int) -> Iterator[tuple[float, int]]:
        """A time of the flight in seconds: `90 s`, `t+90 s`, `minute 3`, `1:30`."""
        if self.word(at) in ("t", "h") and self.word(at + 1) in ("+", "=", "plus"):
            yield from self._single_times(at + 2)
            # `t+90`: a time of the flight without a unit is in seconds.
            yield from self.numbers(at + 2)
        yield from self._single_times(at)
        unit = {"minute": 60.0, "second": 1.0}.get(self.word(at))
        if unit is not None:
            yield from ((number * unit, end) for number, end in self.numbers(at + 1))
        clock = re.fullmatch(r"(\d):(\d\d)", self.word(at))
        if clock and self.word(at + 1) not in ("am", "pm", "utc", "z"):
            yield 60.0 * int(clock[1]) + int(clock[2]), at + 1

    def _single_times(self, at: int) -> Iterator[tuple[float, int]]:
        return ((time.low, end) for time, end in self.quantities("TIME", at) if time.single)


def _from_table(name: str) -> Callable[[SlotParser, int], Iterator[tuple[Any, int]]]:
    return lambda parser, at: iter(parser.vocabulary.longest(name, parser.words, at))


def _of_kind(kind: str) -> Callable[[SlotParser, int], Iterator[tuple[Any, int]]]:
    return lambda parser, at: parser.quantities(kind, at)


def _singles(parser: SlotParser, at: int) -> Iterator[tuple[float, int]]:
    return ((count.low, end) for count, end in parser.counts(at) if count.single)


def _days(parser: SlotParser, at: int) -> Iterator[tuple[dt.date, int]]:
    return parser.dates(at)


_SLOTS: Mapping[str, Callable[[SlotParser, int], Iterator[tuple[Any, int]]]] = {
    "length": _of_kind("LENGTH"),
    "time": _of_kind("TIME"),
    "speed": _of_kind("SPEED"),
    "angle": _of_kind("ANGLE"),
    "energy": _of_kind("ENERGY"),
    "surface": _of_kind("AREA"),
    "share": lambda parser, at: parser.shares(at),
    "count": lambda parser, at: parser.counts(at),
    "number": _singles,
    "dim": lambda parser, at: parser.dims(at),
    "moment": lambda parser, at: parser.moments(at),
    "clock": lambda parser, at: parser.clocks(at),
    "date": _days,
    "direction": lambda parser, at: parser.directions(at),
    "place": lambda parser, at: parser.places(at),
    "way": lambda parser, at: parser.ways(at),
    "reference": lambda parser, at: parser.references(at),
    "group": lambda parser, at: parser.noun_phrases(at),
    "ground": lambda parser, at: parser.grounds(at),
    "corners": lambda parser, at: parser.corners(at),
    "level": lambda parser, at: parser.levels(at),
    "people": _from_table("people"),
    "per_area": _from_table("per_area"),
    "axis": _from_table("axes"),
    "sun": _from_table("suns"),
    "weather": _from_table("weather"),
    "winds": _from_table("winds"),
    "motion": _from_table("motion"),
    "concealment": _from_table("concealment"),
    "color": _from_table("color"),
    "role": _from_table("role"),
}


@dataclass(frozen=True, slots=True)
class Pattern:
    """A pattern that can be matched; `first` are the words that it may begin with, None where a slot may begin it."""

    text: str
    node: Node
    first: frozenset[str] | None

    def matches(self, parser: SlotParser, at: int) -> Iterator[tuple[int, Captures]]:
        """Every match from an index on: the index after it, and what the slots hold."""
        if self.first is None or parser.word(at) in self.first:
            yield from self.node(parser, at)


def compiled(text: str, shared: Mapping[str, str]) -> Pattern:
    """A pattern from its text. Raises KeyError for an unknown slot or shared part."""
    for _ in range(3):
        text = re.sub(r"<([a-z_]+)>", lambda match: f"({shared[match.group(1)]})", text)
    parts = _PART.findall(text)
    node, first, end = _alternatives(parts, 0)
    if end != len(parts):
        raise KeyError(text)
    return Pattern(text, node, first)


_First = frozenset[str] | None


def _alternatives(parts: list[str], at: int) -> tuple[Node, _First, int]:
    """The alternatives up to a closing bracket or the end."""
    nodes: list[tuple[Node, _First]] = []
    while True:
        node, first, at = _sequence(parts, at)
        nodes.append((node, first))
        if at >= len(parts) or parts[at] != "/":
            break
        at += 1
    known = [first for _, first in nodes if first is not None]
    joined = frozenset().union(*known) if len(known) == len(nodes) else None
    return _any_of([node for node, _ in nodes]), joined, at


def _any_of(nodes: list[Node]) -> Node:
    def match(parser: SlotParser, at: int) -> Iterator[tuple[int, Captures]]:
        for node in nodes:
            yield from node(parser, at)

    return nodes[0] if len(nodes) == 1 else match


def _sequence(parts: list[str], at: int) -> tuple[Node, _First, int]:
    nodes: list[Node] = []
    first: _First = frozenset()
    is_open = True
    while at < len(parts) and parts[at] not in ("/", "]", ")", ")*", "]*"):
        node, begins, at, optional = _item(parts, at)
        nodes.append(node)
        if is_open:
            first = None if first is None or begins is None else first | begins
            is_open = optional
    if is_open:
        first = None
    return _in_order(nodes), first, at


def _item(parts: list[str], at: int) -> tuple[Node, _First, int, bool]:
    part = parts[at]
    if part in ("[", "("):
        node, first, end = _alternatives(parts, at + 1)
        if parts[end] == ")*":
            return _repeated(node), first, end + 1, True
        return (_optional(node) if part == "[" else node), first, end + 1, part == "["
    if part.startswith("{"):
        kind, _, name = part[1:-1].partition(":")
        if kind not in _SLOTS:
            raise KeyError(kind)
        return _slot(kind, name or kind), None, at + 1, False
    words = frozenset(part.split("|"))
    return _word(words), words, at + 1, False


def _word(words: frozenset[str]) -> Node:
    def match(parser: SlotParser, at: int) -> Iterator[tuple[int, Captures]]:
        if parser.word(at) in words:
            yield at + 1, ()

    return match


def _slot(kind: str, name: str) -> Node:
    def match(parser: SlotParser, at: int) -> Iterator[tuple[int, Captures]]:
        for value, end in parser.slot(kind, at):
            yield end, (Capture(name, value, at, end),)

    return match


def _in_order(nodes: list[Node]) -> Node:
    def match(parser: SlotParser, at: int, number: int = 0) -> Iterator[tuple[int, Captures]]:
        if number == len(nodes):
            yield at, ()
            return
        for end, captures in nodes[number](parser, at):
            for last, others in match(parser, end, number + 1):
                yield last, captures + others

    return match


def _optional(node: Node) -> Node:
    def match(parser: SlotParser, at: int) -> Iterator[tuple[int, Captures]]:
        yield from node(parser, at)
        yield at, ()

    return match


def _repeated(node: Node) -> Node:
    def match(parser: SlotParser, at: int) -> Iterator[tuple[int, Captures]]:
        for end, captures in node(parser, at):
            if end > at:
                yield from ((last, captures + others) for last, others in match(parser, end))
        yield at, ()

    return match
