"""Groups phrases and words to sentences, and sets questions aside."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from .._draft import Draft
from ._phrases import Phrase
from ._tokens import Word

_QUESTION_START = re.compile(
    r"(?:\w+:\s*)?(?:and |but |so |then )?(?:how|which|why|who|whose|where|when|may|does|did|is|are|was|were|has|have|will the|what(?! if))\b",
    re.IGNORECASE,
)


def sentences_of(items: Sequence[Phrase | Word], draft: Draft) -> Iterator[list[Phrase | Word]]:
    """The non-empty sentences of a text, in order. A question is listed as unread instead."""
    parts: list[Phrase | Word] = []
    for item in items:
        if not (isinstance(item, Word) and any(meaning.kind == "STOP" for meaning in item.meanings)):
            parts.append(item)
            continue
        if parts and not _is_question(parts, draft, draft.quote(item.span)):
            yield parts
        parts = []
    if parts:
        yield parts


def _is_question(parts: list[Phrase | Word], draft: Draft, stop: str) -> bool:
    span = parts[0].span.joined(parts[-1].span)
    is_question = stop == "?" and _QUESTION_START.match(draft.quote(span)) is not None
    if is_question:
        draft.unread(span, "a question describes nothing", expressible=True)
    return is_question
