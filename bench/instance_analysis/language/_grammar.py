"""The sentences of the controlled language: `forms.yaml`, and the parser that finds its statements in tokens."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from bench.documents import Document, read_document

from ._pattern import Captures, Pattern, SlotParser, compiled
from ._phrases import NounPhrase
from ._tokens import Span, Token
from ._vocabulary import Vocabulary


class Form(Document):
    """One form of sentence: what it looks like, what reads it, and what the page and the ledger say of it."""

    match: str = ""
    event: str = ""
    order: str = ""
    kind: str = ""
    sets: dict[str, float | bool | str] = {}
    does: str = ""
    topic: tuple[str, ...] = ()
    carries: tuple[str, ...] = ()
    write: tuple[str, ...] = ()
    shows: str = ""

    @property
    def pattern(self) -> str:
        """The whole pattern, with the time of an event and the deadline of an order."""
        if self.event:
            what = f"({self.event})"
            return f"(<when> [,] {what} / <begin> [,] {what} <lasting> / {what} [,] <when>)"
        if self.order:
            return f"[at] {{moment:at}} [,|:] [<orders>] [a|an] ({self.order}) [[,] <deadline>]"
        return self.match

    @property
    def reader(self) -> str:
        """The name of what reads it."""
        return self.does or ("event" if self.event else "order" if self.order else "sets")


class Section(Document):
    """Forms that stand together on the page."""

    title: str
    note: str = ""
    predicates: bool = False
    forms: tuple[Form, ...]


class Forms(Document):
    """The document `forms.yaml`."""

    shared: dict[str, str]
    sections: tuple[Section, ...]


@dataclass(frozen=True, slots=True)
class Part:
    """A form that matches, with the values of its slots. Slots of one name are kept in order."""

    form: Form
    captures: Captures
    begin: int
    end: int
    span: Span
    spans: tuple[Span, ...] = ()
    words: tuple[str, ...] = ()

    def all(self, name: str) -> list[Any]:
        """The values of every slot of a name."""
        return [capture.value for capture in self.captures if capture.name == name]

    def first(self, name: str) -> Any:
        """The value of the first slot of a name, or None."""
        return next(iter(self.all(name)), None)

    def span_of(self, name: str) -> Span:
        """The words of a slot; those of the whole part where it has none."""
        places = zip(self.captures, self.spans, strict=True)
        return next((span for capture, span in places if capture.name == name), self.span)


@dataclass(frozen=True, slots=True)
class Statement(Part):
    """A part that is a sentence or a clause; of one about groups, whom it names and what it says of them."""

    subjects: tuple[NounPhrase, ...] = ()
    predicates: tuple[Part, ...] = ()


@cache
def forms() -> Forms:
    """The document of the forms."""
    text = resources.files(__package__).joinpath("forms.yaml").read_text(encoding="utf-8")
    return read_document(text, Forms, source="forms.yaml")


@cache
def _patterns() -> tuple[list[tuple[Form, Pattern]], list[tuple[Form, Pattern]]]:
    """The forms of whole sentences and those of what is said of a group, each with its pattern."""
    sentences: list[tuple[Form, Pattern]] = []
    predicates: list[tuple[Form, Pattern]] = []
    for section in forms().sections:
        into = predicates if section.predicates else sentences
        into += [(form, compiled(form.pattern, forms().shared)) for form in section.forms if form.pattern]
    return sentences, predicates


@cache
def _group_form() -> Form:
    return next(form for section in forms().sections for form in section.forms if form.does == "groups")


_VERBS = (
    ("shall", "stand"), ("shall", "be", "placed"), ("shall", "be", "located"), ("shall", "be"), ("must", "be"), ("is", "located"), ("are", "located"), ("is", "placed"), ("are", "placed"),
    ("is", "standing"), ("are", "standing"), ("shall",), ("is",), ("are",), ("was",), ("were",), ("stands",), ("stand",), ("stays",), ("stay",),
    ("has",), ("have",), ("lies",), ("lie",), ("sits",), ("sit",), ("remains",), ("remain",),
)  # fmt: skip
_LINKS = ((",", "and"), (",", "which"), (",", "who"), (",",), ("and",), ("which",), ("who",), ("that",), ())


def _may_be_the_same(first: Statement, joint: tuple[str, ...], second: Statement) -> bool:
    """Whether a noun after a comma may name the group before it once more: `two hikers are missing, a man and a woman`."""
    groups = first.form.does == second.form.does == "groups"
    return groups and joint[0] == "," and not second.predicates


_JOINTS = ((",", "and"), (",",), ("and",))
FRONTED = frozenset(["part", "road", "ground", "near", "within", "at", "inside"])
"""What may stand before its group in free text: `in the north two trucks`."""
MAX_PREDICATES = 8


class Parser(SlotParser):
    """Finds statements in the tokens of one sentence. `free` takes what the page does not promise: fronted predicates."""

    def __init__(self, tokens: Sequence[Token], vocabulary: Vocabulary, *, free: bool = False) -> None:
        super().__init__(tokens, vocabulary)
        self._free = free
        self._hopeless: set[int] = set()
        self._found: dict[int, list[Statement]] = {}

    def whole(self) -> list[Statement] | None:
        """The statements that the sentence consists of; None when some part of it is none."""
        return self._from(0) if self.tokens else None

    def _from(self, at: int) -> list[Statement] | None:
        if at in self._hopeless:
            return None
        for statement in self.statements(at):
            if statement.end == len(self.tokens):
                return [statement]
            for joint in _JOINTS:
                if self.starts(statement.end, *joint):
                    rest = self._from(statement.end + len(joint))
                    if rest is not None and not _may_be_the_same(statement, joint, rest[0]):
                        return [statement, *rest]
        self._hopeless.add(at)
        return None

    def statements(self, at: int) -> list[Statement]:
        """Every statement that begins at a token, the longest first."""
        if at not in self._found:
            found = [
                Statement(part.form, part.captures, part.begin, part.end, part.span, part.spans, part.words)
                for part in self._matching(at, _patterns()[0])
            ]
            found += self._of_groups(at)
            # Of two that are equally long the earlier form holds.
            self._found[at] = sorted(found, key=lambda statement: -statement.end)
        return self._found[at]

    def _matching(self, at: int, patterns: Sequence[tuple[Form, Pattern]]) -> Iterator[Part]:
        for form, pattern in patterns:
            ends: set[int] = set()
            for end, captures in pattern.matches(self, at):
                if end > at and end not in ends:
                    ends.add(end)
                    spans = tuple(self.span_of(capture) for capture in captures)
                    words = tuple(self.words[at:end])
                    yield Part(form, captures, at, end, self.span(at, end), spans, words)

    def _of_groups(self, at: int) -> Iterator[Statement]:
        begin = at + 2 if self.starts(at, "there", "is") or self.starts(at, "there", "are") else at
        for subjects, end in self._subjects(begin):
            for predicates, last in self._predicates(end, 0):
                yield self._group_statement(at, last, subjects, predicates)
        for front in self._fronts(at):
            for joint in ((",",), ("there", "is"), ("there", "are"), ()):
                if self.starts(front.end, *joint):
                    for subjects, end in self._subjects(front.end + len(joint)):
                        for predicates, last in self._predicates(end, 0):
                            yield self._group_statement(at, last, subjects, (front, *predicates))

    def _fronts(self, at: int) -> list[Part]:
        if not self._free:
            return []
        return [part for part in self._matching(at, _patterns()[1]) if part.form.reader in FRONTED]

    def _group_statement(
        self, at: int, end: int, subjects: tuple[NounPhrase, ...], predicates: tuple[Part, ...]
    ) -> Statement:
        words = tuple(self.words[at:end])
        return Statement(_group_form(), (), at, end, self.span(at, end), (), words, subjects, predicates)

    def _subjects(self, at: int) -> Iterator[tuple[tuple[NounPhrase, ...], int]]:
        """A noun phrase, or a list of them with `and` before the last one."""
        for phrase, end in self.slot("group", at):
            for rest, last in self._more_subjects(end):
                yield (phrase, *rest), last
            yield (phrase,), end

    def _more_subjects(self, at: int) -> Iterator[tuple[tuple[NounPhrase, ...], int]]:
        for joint in ((",", "and"), ("and",)):
            if self.starts(at, *joint):
                yield from (((phrase,), end) for phrase, end in self.slot("group", at + len(joint)))
                return
        if self.word(at) == ",":
            for phrase, end in self.slot("group", at + 1):
                yield from (((phrase, *rest), last) for rest, last in self._more_subjects(end))

    def _predicates(self, at: int, depth: int) -> Iterator[tuple[tuple[Part, ...], int]]:
        """Every run of predicates from a token on, the longest first; the empty one last."""
        if depth < MAX_PREDICATES:
            for begin in self._predicate_starts(at, depth):
                for part in sorted(self._matching(begin, _patterns()[1]), key=lambda part: -part.end):
                    yield from (((part, *rest), end) for rest, end in self._predicates(part.end, depth + 1))
        yield (), at

    def _predicate_starts(self, at: int, depth: int) -> Iterator[int]:
        for link in _LINKS if depth or self.word(at) in (",", "which", "who", "that") else ((),):
            if self.starts(at, *link):
                after = at + len(link)
                yield after
                yield from (after + len(verb) for verb in _VERBS if self.starts(after, *verb))
