"""Where a text speaks of something that is not read: what follows may be said of it, and not of a known group."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..language._tokens import Span, Word

_ARTICLE = re.compile(
    r"(?:\b(?:an?|the|this|that|another|some|his|her|its|their|our|one|two|three|four|five|six|seven|eight|nine|ten)"
    r"|\d\s*x?)\s+(?:[\w-]+\s+){0,2}$",
    re.IGNORECASE,
)
"""What makes the unknown word after it a thing: `an old tank`, `2x BMP`."""
_NAME = re.compile(r"(?<=[a-z,] )[A-Z][a-z]")
"""A name within a sentence."""
_PREPOSITION = re.compile(
    r"\b(?:on|in|at|of|by|with|near|under|from|to|behind|beside|below|above|over|inside|within|between|along)\s+"
    r"(?:(?:an?|the|some|his|her|its|their|[a-z]+ing)\s+)?(?:[\w-]+\s+){0,1}$",
    re.IGNORECASE,
)
"""What makes the thing after it no subject: `a radar on the hill, camouflaged`."""
CHARACTERS_BEFORE = 200
"""How far before a word its article or preposition is looked for: a search of the whole text before each word took 14 s for
20,000 characters. Three words are shorter.
"""
_BREAK = re.compile(r"[,;:.()\n!?]|\band\b|\bwhich\b|\bwhile\b", re.IGNORECASE)


class UnreadSubjects:
    """The places where an unknown thing is named, or where a clause was left out."""

    def __init__(self, text: str, left_out: Sequence[Span]) -> None:
        self._text, self._left_out = text, left_out
        self._unknown: list[Span] = []
        self._things: list[Span] = []

    def note(self, words: Sequence[Word]) -> None:
        """Take the unknown words of a text, of which those after an article or a number are things."""
        self._unknown = [
            word.span for word in words if not word.meanings and not word.filler and word.text.isalpha()
        ]
        self._things = [
            span
            for span in self._unknown
            if _stands_before(_ARTICLE, self._text, span.start) or _NAME.match(self._text, span.start)
        ]

    def since(self, begin: int, end: int, *, subjects: bool = False) -> Span | None:
        """The first unread thing between two places of the text, or only one that is a subject; None without one.

        An unknown word in the clause of what is said, as `a truck in dull paint parked`, is none.
        """
        spans = [span for span in (*self._things, *self._left_out) if begin <= span.start and span.end <= end]
        if subjects:
            spans = [span for span in spans if not self.is_object(span)]
        return next((span for span in spans if _BREAK.search(self._text[begin:end])), None)

    def named_in_clause_before(self, end: int) -> Span | None:
        """The last unknown word, or clause left out, in the clause that ends at a place; None without one."""
        breaks = [match.end() for match in _BREAK.finditer(self._text, 0, end)]
        begin = breaks[-1] if breaks else 0
        spans = [span for span in (*self._unknown, *self._left_out) if begin < span.end <= end]
        return spans[-1] if spans else None

    def is_object(self, thing: Span) -> bool:
        """Whether a preposition stands before a thing, so that a sentence is not about it."""
        return _stands_before(_PREPOSITION, self._text, thing.start)


def _stands_before(pattern: re.Pattern[str], text: str, at: int) -> bool:
    return pattern.search(text[max(0, at - CHARACTERS_BEFORE) : at]) is not None
