"""Divides what was read of a text into clauses: the parts between stops, commas and conjunctions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..language._phrases import Phrase
from ..language._tokens import Span, Word

_PUNCTUATION = re.compile(r"[,;:()\[\]\n—–]|\s-+\s")
_CONJUNCTIONS = frozenset(
    ["and", "but", "while", "whereas", "which", "who", "whose", "where", "that", "then", "plus"]
)
MAX_LABEL_WORDS = 3
"""Words before a colon that are a label, as in `Wind: 5 m/s`, and no clause."""


@dataclass(frozen=True, slots=True)
class Clause:
    """One clause: its place in the text, its sentence, and the items in it."""

    span: Span
    sentence: int
    items: tuple[Phrase | Word, ...]


def is_stop(item: Phrase | Word) -> bool:
    """Whether an item ends a sentence."""
    return isinstance(item, Word) and any(meaning.kind == "STOP" for meaning in item.meanings)


def clauses_of(text: str, items: Sequence[Phrase | Word]) -> list[Clause]:
    """The clauses of a text in order. No phrase is divided between two."""
    clauses: list[Clause] = []
    run: list[Phrase | Word] = []
    sentence = 0

    def close() -> None:
        if run:
            # A phrase goes on past words that it does not know, which come after it in the run.
            ends = max(item.span.end for item in run)
            clauses.append(Clause(Span(run[0].span.start, ends), sentence, tuple(run)))
            run.clear()

    for item in items:
        if is_stop(item):
            close()
            sentence += 1
            continue
        if run and _begins(text[run[-1].span.end : item.span.start], item, run):
            close()
        run.append(item)
    close()
    return clauses


def _begins(gap: str, item: Phrase | Word, run: Sequence[Phrase | Word]) -> bool:
    """Whether a clause begins with an item, after what lies between it and the clause before."""
    if ":" in gap and len(run) <= MAX_LABEL_WORDS and all(isinstance(word, Word) for word in run):
        return False
    if _PUNCTUATION.search(gap):
        return True
    # A clause of conjunctions alone, as in `and then`, is none.
    if isinstance(run[-1], Word) and run[-1].text.lower().split()[-1] in ("of", "among"):
        # `two trucks, one of which is camouflaged`.
        return False
    several = not all(isinstance(word, Word) and word.text.lower() in _CONJUNCTIONS for word in run)
    return isinstance(item, Word) and item.text.lower() in _CONJUNCTIONS and several
