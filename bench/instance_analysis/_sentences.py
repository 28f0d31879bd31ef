"""Phrases and words in sentences; what only asks something describes nothing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from ._draft import Draft
from ._phrases import Phrase
from ._tokens import Word

_ASKS = re.compile(
    r"(?:and |but |so |then )?(?:how|which|why|who|whose|where|when|may|does|did|is|are|was|were|has|have|will the|what(?! if))\b",
    re.IGNORECASE,
)


def sentences_of(found: Sequence[Phrase | Word], draft: Draft) -> Iterator[list[Phrase | Word]]:
    """The sentences of a text that have anything in them, in order. What only asks is listed, and none of them."""
    parts: list[Phrase | Word] = []
    for one in found:
        if not (isinstance(one, Word) and any(meaning.kind == "STOP" for meaning in one.meanings)):
            parts.append(one)
            continue
        if parts and not _asks(parts, draft, draft.quote(one.span)):
            yield parts
        parts = []
    if parts:
        yield parts


def _asks(parts: list[Phrase | Word], draft: Draft, stop: str) -> bool:
    span = parts[0].span.joined(parts[-1].span)
    asks = stop == "?" and _ASKS.match(draft.quote(span)) is not None
    if asks:
        draft.unread(span, "a question describes nothing", expressible=True)
    return asks
