"""Numbers that a text takes back: `Height 150 ft. No, sorry, 120 ft` says 120 ft."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from ._phrases import Quantity
from ._tokens import Span, Word
from ._vocabulary import Meaning

_TAKES_BACK = re.compile(
    r"\b(?:no,?\s+sorry|sorry|correction|scratch\s+that|i\s+mean|make\s+(?:it|that)|or\s+rather|amended\s+to|changed\s+to|so\s+it\s+is)"
    r"\s*[,:]?\s+(?:(?:no|make\s+it|make\s+that|it\s+is|it['’]s|rather|now|that\s+is)\s*,?\s+)*$",
    re.IGNORECASE,
)
"""What makes the number after it replace the one before it."""
MAX_CHARACTERS_BACK = 60
"""How far before a number its words for a correction begin at most. Chosen."""
_FIGURE = re.compile(r"\d+(?:\.\d+)?")


def with_corrections(words: Sequence[Word], text: str) -> tuple[list[Word], list[Span]]:
    """The words with each number that is taken back replaced by the one that stands for it, and where these stand.

    A number is taken back in its own sentence or in the next one, by a number of its kind, or by one without a unit.
    """
    read, corrections = list(words), list[Span]()
    for at, word in enumerate(read):
        number = _quantity(word)
        begin = max(0, word.span.start - MAX_CHARACTERS_BACK)
        match = _TAKES_BACK.search(text[begin : word.span.start]) if number is not None else None
        if match is None or number is None:
            continue
        earlier = _taken_back(read, at, number)
        new = None if earlier is None else _in_unit_of(read[earlier], number, text)
        if earlier is None or new is None:
            continue
        read[earlier] = replace(read[earlier], meanings=(Meaning(new.kind, new),))
        span = Span(begin + match.start(), word.span.end)
        corrections.append(span)
        for index in range(earlier + 1, at + 1):
            if read[index].span.start >= span.start:
                read[index] = replace(read[index], meanings=(), filler=True)
    return read, corrections


def _quantity(word: Word) -> Quantity | None:
    return next((meaning.value for meaning in word.meanings if isinstance(meaning.value, Quantity)), None)


def _taken_back(words: Sequence[Word], at: int, number: Quantity) -> int | None:
    """Which word the number replaces: the last one of its kind, in this sentence or the one before."""
    stops = 0
    for index in range(at - 1, -1, -1):
        stops += any(meaning.kind == "STOP" for meaning in words[index].meanings)
        earlier = _quantity(words[index])
        if stops > 1:
            return None
        if earlier is not None and number.kind in (earlier.kind, "COUNT"):
            return index
    return None


def _in_unit_of(earlier: Word, number: Quantity, text: str) -> Quantity | None:
    """The number, in the unit of the earlier one where it has none itself."""
    before = _quantity(earlier)
    if before is None or before.kind == number.kind:
        return number
    figure = _FIGURE.search(earlier.span_text(text))
    if figure is None or not before.single or not float(figure.group()):
        return None
    scale = before.low / float(figure.group())
    return Quantity(before.kind, round(number.low * scale, 9), round(number.high * scale, 9))
