"""Prose to base SimSpec: the same text always gives the same document.

A text is divided into segments once. Its statements are read as often as it takes until the SimSpec's own checks find
nothing more to leave out. So a fault in one clause costs that clause and what depends on it, and never the document.
"""

from __future__ import annotations

import bisect
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bench.errors import SetupError

from ._draft import ChoiceKey, Draft, dotted
from ._result import BaseSimSpec, Choice, ClauseReading, ClauseStatus, UnreadText
from .language._grammar import Statement
from .language._tokens import Span
from .language._vocabulary import Vocabulary
from .readers._reader import TextReader
from .rewriting._rewrite import Rewrite, RewriteJudge
from .rewriting._segments import FreeReader, Segment

MAX_CHARACTERS = 20_000
MAX_SINGLE_CUTS = 40
"""Statements that are left out one by one for a fault of the SimSpec; after these, all that set anything. Chosen."""
_FIELD = re.compile(r"[a-z_0-9]+(?:(?:\.[a-z_0-9]+|\[[^]]*\])*(?:\.[a-z_0-9]+|\[[^]]*\]))")
"""A field as a fault names it: `rules.max_altitude_m`, `actors[truck].count`."""


def read_prose(
    text: str, vocabulary: Vocabulary, answers: Sequence[int] = (), rewrite: Rewrite | None = None
) -> BaseSimSpec:
    """Read a text into a base SimSpec with ranges, choices, and a receipt for every field.

    There is always a document: what is uncertain is a choice, what cannot hold is left out, and both are
    listed. `answers` take readings of the choices, in their order, counted from 1. A `rewrite` is read in the place
    of the words that it quotes, as far as the ledger lets it pass. Raises SetupError for a text without a word or of
    more than 20,000 characters, and for an answer that is no reading.
    """
    check_text(text)
    if rewrite is None:
        sentences = list(FreeReader(text, vocabulary).segments())
    else:
        judge = RewriteJudge(text, vocabulary)
        sentences = judge.sentences(judge.judge(rewrite))
    return Reading(text, vocabulary, sentences, answers).result()


@dataclass(frozen=True, slots=True)
class Cut:
    """A passage that sets no field, and why."""

    span: Span
    why: str


class Reading:
    """The segments of a text, sentence by sentence, as a document."""

    def __init__(
        self,
        text: str,
        vocabulary: Vocabulary,
        sentences: Sequence[Sequence[Segment]],
        answers: Sequence[int] = (),
    ) -> None:
        self.text, self.vocabulary, self._sentences = text, vocabulary, sentences
        self._segments = [segment for sentence in sentences for segment in sentence]
        self.draft = self._answered(answers)

    def result(self) -> BaseSimSpec:
        """The finished document."""
        draft = self.draft
        simspec = draft.checked()
        return BaseSimSpec(
            prose=self.text,
            simspec=simspec,
            ranges=tuple(draft.ranges),
            receipts=tuple(draft.receipts(simspec)),
            choices=tuple(draft.choices),
            clauses=tuple(self._clauses()),
            not_understood=tuple(sorted(draft.not_understood, key=lambda item: item.start)),
            remarks=tuple(draft.remarks),
        )

    # Reading.

    def _answered(self, answers: Sequence[int]) -> Draft:
        """Read with the answers of a person. An answer may raise further choices, which the next one takes."""
        chosen: dict[ChoiceKey, int] = {}
        draft = self._settled(chosen)
        for number, answer in enumerate(answers, start=1):
            choice = next((choice for choice in draft.choices if not choice.answered), None)
            if choice is None:
                raise SetupError("--accept", f"there is no choice {number}", "leave it out")
            if not 1 <= answer <= len(choice.readings):
                what = f"choice {number}, {choice.quote[:80]!r}, has {len(choice.readings)} readings, and no {answer}."
                raise SetupError("--accept", what, "take one of them")
            chosen[_key(choice)] = answer - 1
            draft = self._settled(chosen)
        return draft

    def _settled(self, answers: Mapping[ChoiceKey, int]) -> Draft:
        """The reading in which nothing has to be left out any more."""
        cuts: list[Cut] = []
        while True:
            draft = self._read(answers, cuts)
            new_cuts = [
                Cut(self._grown(span), f"{fault.what} ({fault.remedy})") for span, fault in draft.faults
            ]
            new_cuts = new_cuts or self._invalid(draft, cuts)
            if not new_cuts:
                return draft
            cuts += new_cuts

    def _read(self, answers: Mapping[ChoiceKey, int], cuts: Sequence[Cut]) -> Draft:
        draft = Draft(self.text, answers)
        reader = TextReader(draft, self.vocabulary)
        segments = [segment for segment in self._segments if not _touches(segment.span, cuts)]
        reader.read_first([statement for segment in segments for statement in segment.statements])
        for number, sentence in enumerate(self._sentences):
            reader.scene.sentence = number
            for segment in sentence:
                self._segment(segment, reader, _touches(segment.span, cuts))
        reader.finish()
        draft.put(("name",), "prose", None)
        draft.describe()
        return draft

    def _segment(self, segment: Segment, reader: TextReader, cut: Cut | None) -> None:
        draft = reader.draft
        statements = () if cut is not None or segment.mode == "unread" else self._chosen(segment, draft)
        if not statements:
            why = cut.why if cut is not None else segment.why or "you left it out"
            draft.leave_out(segment.span, why)
            reader.scene.unread = reader.scene.sentence
        for statement in statements:
            reader.read(statement)

    def _chosen(self, segment: Segment, draft: Draft) -> Sequence[Statement]:
        """The statements of a segment; of one that assumes something those that a person takes, which may be none."""
        if not segment.assumes:
            return segment.statements
        options = [(segment.sentence, segment.statements), *segment.options, ("leave it out", ())]
        chosen = draft.ask(
            segment.span, f"taken to mean: {segment.assumes}", [sentence for sentence, _ in options]
        )
        return options[chosen][1]

    def _grown(self, span: Span) -> Span:
        """A span, and the segments that it touches."""
        for segment in self._segments:
            if _overlap(segment.span, span):
                span = span.joined(segment.span)
        return span

    def _invalid(self, draft: Draft, cuts: Sequence[Cut]) -> list[Cut]:
        """The segment that makes the SimSpec invalid; nothing when it is valid."""
        try:
            draft.checked()
        except SetupError as error:
            fault = error.faults[0]
            candidates = self._segments_that_set(draft, f"{fault.where} {fault.what}", cuts)
            if not candidates:
                raise
            if len(cuts) > MAX_SINGLE_CUTS:
                return [Cut(segment.span, str(fault)) for segment in candidates]
            why = "; ".join(map(str, error.faults))
            words = self._quote(candidates[0].span)
            # What is wrong in one is wrong in all that say the same.
            twins = [segment for segment in candidates if self._quote(segment.span) == words]
            return [Cut(segment.span, why) for segment in twins]
        return []

    def _quote(self, span: Span) -> str:
        return self.text[span.start : span.end]

    def _segments_that_set(self, draft: Draft, where: str, cuts: Sequence[Cut]) -> list[Segment]:
        """The segments that set fields; first those of the fields that a fault names, from the last to the first."""
        names = [
            _by_id(name, draft.document()) for name in (where.split(" ")[0], *_FIELD.findall(where)) if name
        ]
        blamed = _spans_of(draft, names) or _spans_of(
            draft, [re.sub(r"\[\d+\].*", "", name) for name in names]
        )
        setting = [
            segment
            for segment in reversed(self._segments)
            if _touches(segment.span, cuts) is None
            and any(
                _overlap(span, segment.span) for path, _, span in draft.statements if path != ("description",)
            )
        ]
        return sorted(setting, key=lambda segment: not any(_overlap(span, segment.span) for span in blamed))

    # The account of every clause.

    def _clauses(self) -> Iterator[ClauseReading]:
        segments = sorted(self._segments, key=lambda segment: segment.span.start)
        accounts = _accounts(self.draft, [segment.span for segment in segments])
        unread = {id(segment) for segment, account in zip(segments, accounts, strict=True) if account.unread}
        # What is not read in a sentence may be said of what stands beside it.
        beside = {
            id(part)
            for sentence in self._sentences
            if any(id(part) in unread for part in sentence)
            for part in sentence
        }
        for segment, account in zip(segments, accounts, strict=True):
            notes = [f"{_short(item.quote)!r}: {item.why}" for item in account.unread]
            notes += [
                f"{choice.ask} Read as: {choice.readings[choice.chosen - 1]}" for choice in account.choices
            ]
            yield ClauseReading(
                quote=self._quote(segment.span),
                start=segment.span.start,
                end=segment.span.end,
                status=_status(segment, account, alone=id(segment) not in beside),
                sentence=segment.sentence,
                fields=tuple(account.fields),
                notes=tuple(dict.fromkeys([*notes, *account.remarks])),
            )


@dataclass(slots=True)
class _Account:
    """What the reading holds about one segment."""

    fields: list[str] = field(default_factory=list)
    unread: list[UnreadText] = field(default_factory=list)
    choices: list[Choice] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def _accounts(draft: Draft, spans: Sequence[Span]) -> list[_Account]:
    """What the reading holds, divided among the segments that it touches, which are in order."""
    accounts = [_Account() for _ in spans]
    starts, ends = (
        [span.start for span in spans],
        list(itertools.accumulate((span.end for span in spans), max)),
    )
    for span, part, item in _passages(draft):
        first, last = bisect.bisect_right(ends, span.start), bisect.bisect_left(starts, span.end)
        for account, place in zip(accounts[first:last], spans[first:last], strict=True):
            if _overlap(place, span):
                getattr(account, part).append(item)
    return accounts


def _passages(draft: Draft) -> Iterator[tuple[Span, str, object]]:
    """Every passage that the reading holds something about, the part of an account that it is for, and the entry."""
    for path, entry in draft.entries.items():
        if entry.span is not None and path != ("description",):
            yield entry.span, "fields", dotted(path)
        elif entry.span is None and entry.note and entry.beside is not None:
            yield entry.beside, "remarks", f"{dotted(path)} = {entry.value}: {entry.note}"
    for unread in draft.not_understood:
        yield Span(unread.start, unread.end), "unread", unread
    yield from ((Span(choice.start, choice.end), "choices", choice) for choice in draft.choices)
    yield from ((Span(remark.start, remark.end), "remarks", remark.why) for remark in draft.remarks)


def _status(segment: Segment, account: _Account, *, alone: bool) -> ClauseStatus:
    if account.unread:
        return "in part" if account.fields and segment.mode != "unread" else "not understood"
    if any(not choice.answered for choice in account.choices):
        return "choice"
    if segment.mode != "controlled" or not alone:
        return "check"
    return "default" if account.remarks else "understood"


def _touches(span: Span, cuts: Sequence[Cut]) -> Cut | None:
    return next((cut for cut in cuts if _overlap(cut.span, span)), None)


def _overlap(first: Span, second: Span) -> bool:
    return first.start < second.end and second.start < first.end


def _spans_of(draft: Draft, names: Sequence[str]) -> list[Span]:
    """Where the text states fields, the parts of them, or what they are parts of."""
    spans = (
        entry.span or entry.beside
        for path, entry in draft.entries.items()
        if any(dotted(path).startswith(name) or name.startswith(dotted(path)) for name in names)
    )
    return [span for span in spans if span is not None]


def _by_id(name: str, document: dict[str, Any]) -> str:
    """A field as a fault names it, with the ids of members in the place of their numbers."""
    match = re.match(r"((?:\w+\.)?\w+)\[(\d+)\]", name)
    if match is None:
        return name
    members: Any = document
    for part in match[1].split("."):
        members = members.get(part, {}) if isinstance(members, dict) else {}
    number = int(match[2])
    member = members[number] if isinstance(members, list) and number < len(members) else {}
    return f"{match[1]}[{member.get('id', number)}]{name[match.end() :]}"


def _short(quote: str) -> str:
    quote = " ".join(quote.split())
    return quote if len(quote) <= 60 else f"{quote[:57]}..."


def _key(choice: Choice) -> ChoiceKey:
    return Span(choice.start, choice.end), choice.ask


def check_text(text: str) -> None:
    """Raises SetupError for a text that is too long, or has no word."""
    if len(text) > MAX_CHARACTERS:
        what = f"has {len(text)} characters, more than {MAX_CHARACTERS}"
        raise SetupError("prose", what, "describe one situation")
    if not any(character.isalnum() for character in text):
        remedy = "write who is where: 'a radar vehicle, five civilians within 50 m of it'"
        raise SetupError("prose", "it is empty", remedy)
