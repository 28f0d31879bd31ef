"""A text rewritten into sentences of the controlled language, each with the words that it stands for, and its judge.

Whoever writes it, a model or a person, nothing of it is believed: the parser must read each sentence in full, and the
ledger must find nothing in it that its words do not say. What fails sets nothing and is listed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from bench.documents import Document

from ..language._grammar import Statement
from ..language._tokens import Sentence, Span, sentences_of
from ..language._vocabulary import Vocabulary
from ..ledger._loads import HARD, TextLoads
from ..ledger._pairs import Pair, faults_of
from ._segments import FreeReader, Segment

MAX_PAIRS = 300
"""A model may repeat itself without end. Chosen, not measured."""
Text = Annotated[str, Field(max_length=2000)]
# A line end in it would begin a line of the SimSpec's file, or a line of the terminal.
Line = Annotated[Text, AfterValidator(lambda text: " ".join(text.split()))]
UNQUOTED = "no sentence of the rewrite stands for it"
FAINT = frozenset(
    ["the", "and", "with", "that", "this", "there", "then", "also", "please", "from", "have", "will"]
)
"""Words that need no quote. Shorter words need none either."""
MIN_LETTERS = 4


class Rewritten(Document):
    """Words of the text, and the sentence for them, or that there is none, or that they may mean several things."""

    quotes: tuple[Text, ...] = Field(description="Words of the text, letter by letter.", min_length=1)
    sentence: Line = Field("", description="One or more sentences of the page.")
    taken_to_mean: Line = Field("", description="What the sentence assumes that the words leave open.")
    cannot_say: Line = Field("", description="What the page has no sentence for.")
    unclear: Line = Field("", description="What the words leave open.")
    readings: tuple[Line, ...] = Field(
        (), description="A sentence of the page for each thing that they may mean."
    )


class Rewrite(Document):
    """A whole text, rewritten, in the order of the text."""

    format: Literal["rebar.rewrite/1"] = "rebar.rewrite/1"
    pairs: tuple[Rewritten, ...]


@dataclass(slots=True)
class Judgement:
    """What the judge makes of a rewrite: the segments that hold, and what is wrong with the others."""

    segments: list[Segment] = field(default_factory=list)
    faults: list[tuple[str, str]] = field(default_factory=list)
    """Words, and what is wrong with what was made of them."""
    quoted: list[Span] = field(default_factory=list)

    @property
    def report(self) -> str:
        """The faults as a model is to read them."""
        return "\n".join(f"{quote!r}: {why}" for quote, why in self.faults)


class RewriteJudge:
    """Judges rewrites of one text."""

    def __init__(self, text: str, vocabulary: Vocabulary) -> None:
        self._text, self._vocabulary = text, vocabulary
        self._free = FreeReader(text, vocabulary)
        self._loads = TextLoads(text, vocabulary)

    def judge(self, rewrite: Rewrite) -> Judgement:
        """The segments of a rewrite that hold, and the faults of the rest and of what it leaves out."""
        judgement = Judgement()
        earlier: list[str] = []
        for pair in rewrite.pairs[:MAX_PAIRS]:
            spans = self._places(pair.quotes, judgement.quoted)
            if spans is None:
                judgement.faults.append(
                    ("; ".join(pair.quotes)[:200], "the quote is not in the text, or is quoted twice")
                )
                continue
            judgement.quoted += spans
            segment, why = self._segment(pair, spans, earlier)
            judgement.segments.append(segment)
            if why:
                judgement.faults.append((self._text[spans[0].start : spans[-1].end][:200], why))
            earlier += [entry for entry in self._entries(segment) if entry not in earlier]
        judgement.faults += [
            (self._text[span.start : span.end], UNQUOTED) for span in self._unquoted_loads(judgement.quoted)
        ]
        return judgement

    def _entries(self, segment: Segment) -> list[str]:
        if segment.mode == "unread":
            return []
        return [entry for entry, _ in TextLoads(segment.sentence, self._vocabulary).things()]

    # Quotes.

    def _places(self, quotes: Sequence[str], taken: Sequence[Span]) -> list[Span] | None:
        """Where the quotes stand in the text, in whole words; None where one does not, or tells what another one tells."""
        spans: list[Span] = []
        for quote in quotes:
            places = [
                span
                for span in _occurrences(quote, self._text)
                if not self._tells_again(span, [*taken, *spans])
            ]
            if not places:
                return None
            spans.append(places[0])
        return spans

    def _tells_again(self, span: Span, taken: Sequence[Span]) -> bool:
        """Whether a number or a word that changes its clause is in another quote already."""
        spans = [*(number.span for number in self._loads.numbers), *(load.span for load in self._loads.loads)]
        parts = [part for part in spans if _within(part, span)]
        return any(_within(part, other) for part in parts for other in taken) or any(
            span == other for other in taken
        )

    def _unquoted_loads(self, quoted: Sequence[Span]) -> Iterator[Span]:
        """The numbers and the words that change their clause that stand in no quote."""
        hard = [load.span for load in self._loads.loads if load.kind in HARD]
        for span in sorted(
            [*(number.span for number in self._loads.numbers), *hard], key=lambda span: span.start
        ):
            if not any(_within(span, other) for other in quoted):
                yield span

    # Pairs.

    def _segment(self, pair: Rewritten, spans: Sequence[Span], earlier: Sequence[str]) -> tuple[Segment, str]:
        """The segment of a pair, and what is wrong with it."""
        span = spans[0]
        if pair.cannot_say and not pair.sentence:
            return Segment(span, "unread", why=f"the page has no sentence for it: {pair.cannot_say}"), ""
        assumes = pair.unclear or pair.taken_to_mean
        sentences = pair.readings if pair.unclear else (pair.sentence,)
        words = TextLoads(
            " … ".join(self._text[place.start : place.end] for place in spans), self._vocabulary
        )
        options: list[tuple[str, tuple[Statement, ...]]] = []
        why = "it has no reading"
        for sentence in sentences:
            statements = self._free.statements_of(sentence, span) or []
            why = self._fault_of(words, sentence, statements, earlier, bool(assumes))
            options += [] if why else [(sentence, tuple(statements))]
        if not options:
            return Segment(span, "unread", why=why), why
        sentence, first = options[0]
        return Segment(span, "rewritten", first, sentence, assumes=assumes, options=tuple(options[1:])), ""

    def _fault_of(
        self,
        words: TextLoads,
        sentence: str,
        statements: Sequence[Statement],
        earlier: Sequence[str],
        assumes: bool,
    ) -> str:
        if not statements:
            return f"{sentence[:200]!r} is no sentence of the page"
        rewritten = TextLoads(sentence, self._vocabulary)
        faults = faults_of(
            Pair(words, rewritten, tuple(statements), tuple(earlier), assumes, self._vocabulary)
        )
        return f"{sentence[:200]!r}: {'; '.join(faults)}" if faults else ""

    # The whole text.

    def sentences(self, judgement: Judgement) -> list[list[Segment]]:
        """The segments of each sentence of the text. One that has no quote is read as it would be without a rewrite."""
        return [self._of_sentence(sentence, judgement) for sentence in sentences_of(self._text)]

    def _of_sentence(self, sentence: Sentence, judgement: Judgement) -> list[Segment]:
        segments = [segment for segment in judgement.segments if _begins_in(segment.span, sentence.span)]
        quoted = [
            span
            for span in judgement.quoted
            if span.start < sentence.span.end and sentence.span.start < span.end
        ]
        if not quoted:
            return self._free.segments_of(sentence)
        runs = _uncovered(sentence, quoted)
        gaps = [
            Segment(span, "unread", why=UNQUOTED)
            for span in runs
            if _tells(self._text[span.start : span.end])
        ]
        return sorted([*segments, *gaps], key=lambda segment: segment.span.start)


def _begins_in(span: Span, whole: Span) -> bool:
    return whole.start <= span.start < whole.end


def _within(inner: Span, outer: Span) -> bool:
    return outer.start <= inner.start and inner.end <= outer.end


def _uncovered(sentence: Sentence, quoted: Sequence[Span]) -> list[Span]:
    """The runs of tokens of a sentence that no quote holds."""
    runs: list[Span] = []
    open_run = False
    for token in sentence.tokens:
        covered = any(_within(token.span, span) for span in quoted)
        if not covered and open_run:
            runs[-1] = runs[-1].joined(token.span)
        elif not covered:
            runs.append(token.span)
        open_run = not covered
    return runs


def _tells(text: str) -> bool:
    """Whether a run of words may tell something."""
    words = [word.lower() for word in re.findall(r"\w+", text)]
    return any((len(word) >= MIN_LETTERS and word not in FAINT) or word.isdigit() for word in words)


def _occurrences(quote: str, text: str) -> Iterator[Span]:
    """Occurrences of a quote in the text, in whole words, whatever its white space; none for a quote without a word."""
    words = quote.split()
    if not words or not re.search(r"\w", quote):
        return
    # Without the edges the quote `5 m` would be found in `45 m`.
    edged = (r"(?<!\w)" if re.match(r"\w", words[0]) else "") + r"\s+".join(map(re.escape, words))
    edged += r"(?!\w)" if re.search(r"\w$", words[-1]) else ""
    yield from (Span(*match.span()) for match in re.finditer(edged, text))
