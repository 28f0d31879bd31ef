"""Finds the statements of a text that are read by their signs and not by a grammar: rules, limits and events."""

from __future__ import annotations

from collections.abc import Sequence

from ..language._phrases import Phrase
from ..language._tokens import Span, Word
from ..language._vocabulary import Vocabulary
from ._clause_runs import SentenceRuns
from ._event_clauses import events_in
from ._rule_clauses import rules_in


def statements_in(words: Sequence[Word], text: str, vocabulary: Vocabulary) -> list[Phrase]:
    """The rules and events of a text. Their parts are the words that they claim."""
    stops = [word.span for word in words if any(meaning.kind == "STOP" for meaning in word.meanings)]
    begins = [0, *(stop.end for stop in stops)]
    statements: list[Phrase] = []
    before = 0
    earlier: list[Word] = []
    for begin, end in zip(begins, [*(stop.start for stop in stops), len(text)], strict=True):
        inside = [word for word in words if begin <= word.span.start < end]
        if inside:
            sentence = SentenceRuns(inside, text, Span(begin, end), before, vocabulary, earlier)
            rules, taken = rules_in(sentence)
            statements += [*rules, *events_in(sentence, taken)]
            # What a sentence speaks of may stand in the one before it.
            before, earlier = begin, inside
    return statements
