"""Divides a text into segments that are read together: sentences of the controlled language, free clauses, and gaps.

A free clause is read where soft words are the only difference, or where a pattern of the phrase book gives a sentence
for it that the ledger lets pass. The gaps of a sentence are listed; where one holds a condition, nothing of the
sentence is read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from typing import Literal

from bench.documents import read_document
from bench.errors import SetupError

from ..language._grammar import Parser, Statement, forms
from ..language._pattern import Pattern, SlotParser, compiled
from ..language._tokens import Sentence, Span, Token, ambiguous_numbers, sentences_of, tokens_of
from ..language._vocabulary import Vocabulary, VocabularyDocument
from ..ledger._loads import TextLoads
from ..ledger._pairs import Pair, faults_of

Mode = Literal["controlled", "free", "rewritten", "unread"]
MAX_SENTENCE_TOKENS = 150
"""Words and marks that a sentence may have, so that reading takes time in proportion to the text. Chosen."""
REACHING = frozenset(["condition", "aside"])
"""Loads that reach over their whole sentence; others are listed with their own clause."""
BREAKS = frozenset([",", ":", "(", ")", "-", "–", "—", "and", "with", "while", "but", "plus", "+", "/"])
"""Tokens between which a clause of free text stands."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A passage of the text and what it consists of. `sentence` is what it was rewritten to."""

    span: Span
    mode: Mode
    statements: tuple[Statement, ...] = ()
    sentence: str = ""
    why: str = ""
    assumes: str = ""
    """What a rewrite has taken the words to mean."""
    options: tuple[tuple[str, tuple[Statement, ...]], ...] = ()
    """Other sentences for the words, with their statements."""


@dataclass(slots=True)
class _Division:
    """The segments of one sentence, and the runs of tokens between them."""

    segments: list[Segment] = field(default_factory=list)
    gaps: list[list[Token]] = field(default_factory=list)


class PhraseBook:
    """Patterns of free text, each with its sentence. Slots of the pattern stand in the sentence, with the words of the text."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self._vocabulary = vocabulary
        try:
            shared = forms().shared
            entries = {**vocabulary.phrases, **shipped_phrases()}
            self._entries = [(compiled(text, shared), sentence) for text, sentence in entries.items()]
        except (KeyError, IndexError) as error:
            raise SetupError(
                "vocabulary: phrases", f"has no valid pattern: {error}", "see docs/prose.md"
            ) from error

    def sentences(self, parser: SlotParser, at: int) -> Iterator[tuple[str, int]]:
        """The sentences for what begins at a token, and the token after it."""
        for pattern, sentence in self._entries:
            yield from self._filled(pattern, sentence, parser, at)

    def _filled(
        self, pattern: Pattern, sentence: str, parser: SlotParser, at: int
    ) -> Iterator[tuple[str, int]]:
        for end, captures in pattern.matches(parser, at):
            words = {
                capture.name: _text_of(parser.words[capture.begin : capture.end]) for capture in captures
            }
            if end > at and all(f"{{{name}}}" in sentence for name in words):
                yield sentence.format(**words), end


def _next_break(tokens: Sequence[Token], at: int) -> int:
    """The first break from an index on; the end where there is none."""
    return next((index for index in range(at, len(tokens)) if tokens[index].text in BREAKS), len(tokens))


def _end_of_breaks(tokens: Sequence[Token], at: int) -> int:
    """The first token from an index on that is no break."""
    return next((index for index in range(at, len(tokens)) if tokens[index].text not in BREAKS), len(tokens))


def _text_of(words: Sequence[str]) -> str:
    """Tokens as text that is divided into the same tokens again."""
    return " ".join(words).replace("( ", "(").replace(" )", ")").replace(" ,", ",").replace("- ", "-")


@cache
def _book(vocabulary: Vocabulary) -> PhraseBook:
    return PhraseBook(vocabulary)


@cache
def shipped_phrases() -> dict[str, str]:
    """The phrase book of the bench."""
    text = resources.files(__package__).joinpath("phrases.yaml").read_text(encoding="utf-8")
    return read_document(text, VocabularyDocument, source="phrases.yaml").phrases


class FreeReader:
    """Divides a text into segments."""

    def __init__(self, text: str, vocabulary: Vocabulary) -> None:
        self._text, self._vocabulary = text, vocabulary
        self._book = _book(vocabulary)

    def segments(self) -> Iterator[list[Segment]]:
        """The segments of each sentence of the text, in order."""
        for sentence in sentences_of(self._text):
            yield self.segments_of(sentence)

    def segments_of(self, sentence: Sentence) -> list[Segment]:
        """The segments of a sentence."""
        if sentence.question:
            return [Segment(sentence.span, "unread", why="a question describes nothing")]
        if len(sentence.tokens) > MAX_SENTENCE_TOKENS:
            return [
                Segment(
                    sentence.span, "unread", why=f"it has more than {MAX_SENTENCE_TOKENS} words: divide it"
                )
            ]
        if places := ambiguous_numbers(sentence.tokens):
            return [self._ambiguous(sentence, places)]
        statements = Parser(sentence.tokens, self._vocabulary).whole()
        if statements is not None:
            return [Segment(statement.span, "controlled", (statement,)) for statement in statements]
        return self._free(sentence)

    def _ambiguous(self, sentence: Sentence, places: Sequence[int]) -> Segment:
        """A sentence with `1.500`, read both ways; a person chooses."""
        number = sentence.tokens[places[0]].text
        readings: list[tuple[str, tuple[Statement, ...]]] = []
        for mark in (".", ""):
            tokens = list(sentence.tokens)
            for at in places:
                whole, _, rest = tokens[at].text.partition(".")
                digits = whole + mark + rest.replace(".", "") if mark else tokens[at].text.replace(".", "")
                tokens[at] = replace(tokens[at], text=digits.rstrip("0").rstrip(".") if mark else digits)
            whole_statements = Parser(tokens, self._vocabulary).whole() or ()
            readings.append((_text_of([token.text for token in tokens]), tuple(whole_statements)))
        if not readings[0][1]:
            why = (
                f"{number} may be a decimal or thousands, and the rest is none of the sentences that are read"
            )
            return Segment(sentence.span, "unread", why=why)
        meant, (first, statements) = f"{number} is a decimal", readings[0]
        return Segment(
            sentence.span, "controlled", statements, first, assumes=meant, options=tuple(readings[1:])
        )

    def _free(self, sentence: Sentence) -> list[Segment]:
        tokens = self._without_soft(sentence.tokens)
        if not tokens:
            return [Segment(sentence.span, "unread", why="it is none of the sentences that are read")]
        division = self._clauses(tokens)
        gap_loads = [
            TextLoads(" ".join(token.text for token in run), self._vocabulary) for run in division.gaps
        ]
        reaching = next((load for loads in gap_loads for load in loads.loads if load.kind in REACHING), None)
        if reaching is not None and division.segments:
            why = f"{reaching.text!r} is not read, and may turn around what stands beside it"
            return [Segment(sentence.span, "unread", why=why)]
        unread = [
            Segment(
                run[0].span.joined(run[-1].span), "unread", why="it is none of the sentences that are read"
            )
            for run in division.gaps
        ]
        return sorted([*division.segments, *unread], key=lambda segment: segment.span.start)

    def _without_soft(self, tokens: Sequence[Token]) -> list[Token]:
        """The tokens without soft words and quotation marks."""
        words = [token.text for token in tokens]
        hard: list[Token] = []
        at = 0
        while at < len(tokens):
            soft = self._vocabulary.longest("soft", words, at)
            if soft:
                at = soft[0][1]
                continue
            if words[at] not in ('"', "“", "”", "*"):
                hard.append(tokens[at])
            at += 1
        return hard

    def _clauses(self, tokens: list[Token]) -> _Division:
        """The longest clause from each break of a sentence on, and the gaps between them."""
        division, parser = _Division(), Parser(tokens, self._vocabulary, free=True)
        at = 0
        run: list[Token] = []
        while at < len(tokens):
            segment, end = self._longest_clause(parser, at)
            stop = _end_of_breaks(tokens, end if segment is not None else _next_break(tokens, at + 1))
            if segment is None:
                run += tokens[at:stop]
            else:
                division.segments.append(segment)
            if run and (segment is not None or stop >= len(tokens)):
                division.gaps.append(run)
                run = []
            at = stop
        return division

    def _longest_clause(self, parser: Parser, at: int) -> tuple[Segment | None, int]:
        """The longest clause that begins at a token and ends at a break."""
        for statement in parser.statements(at):
            if self._ends(parser, statement.end):
                return Segment(statement.span, "free", (statement,)), statement.end
        for sentence, end in sorted(self._book.sentences(parser, at), key=lambda item: -item[1]):
            span = parser.span(at, end)
            statements = self.statements_of(sentence, span) if self._ends(parser, end) else None
            if statements and not self.faults(span, sentence, statements):
                return Segment(span, "rewritten", tuple(statements), sentence), end
        return None, at

    def _ends(self, parser: Parser, end: int) -> bool:
        return end == len(parser.tokens) or parser.word(end) in BREAKS

    def statements_of(self, sentence: str, span: Span) -> list[Statement] | None:
        """The statements of one or more sentences of the controlled language that stand for a passage of the text."""
        statements: list[Statement] = []
        for sentence_part in sentences_of(sentence):
            tokens = tokens_of(sentence[sentence_part.span.start : sentence_part.span.end], span)
            parts = Parser(tokens, self._vocabulary).whole() if len(tokens) <= MAX_SENTENCE_TOKENS else None
            if parts is None or sentence_part.question or ambiguous_numbers(tokens):
                return None
            statements += parts
        return statements

    def faults(self, span: Span, sentence: str, statements: Sequence[Statement]) -> list[str]:
        """What the ledger finds wrong with the sentence of the phrase book for a passage."""
        words = TextLoads(self._text[span.start : span.end], self._vocabulary)
        rewritten = TextLoads(sentence, self._vocabulary)
        return faults_of(Pair(words, rewritten, tuple(statements), (), False, self._vocabulary))
