"""The statements, phrases and words of a text in order: what the readers read."""

from __future__ import annotations

from collections.abc import Sequence

from .language._phrases import Phrase, phrases_of
from .language._tokens import Word
from .language._vocabulary import Vocabulary
from .ledger._ledger import marked
from .readers._statements import statements_in


def items_of(words: Sequence[Word], text: str, vocabulary: Vocabulary) -> list[Phrase | Word]:
    """The statements of a text, and the phrases and words of what they have not claimed, in its order."""
    statements = statements_in(words, text, vocabulary)
    claimed = marked(len(text), [part.span for phrase in statements for part in phrase.leaves])
    items: list[Phrase | Word] = list(statements)
    run: list[Word] = []
    for word in words:
        if any(claimed[word.span.start : word.span.end]):
            items += phrases_of(run)
            run = []
        else:
            run.append(word)
    items += phrases_of(run)
    return sorted(items, key=lambda item: item.span.start)
