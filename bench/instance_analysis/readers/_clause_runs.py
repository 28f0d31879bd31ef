"""The clauses of one sentence, one by one or several that stand beside each other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..language._phrases import Part, Quantity
from ..language._tokens import Span, Word
from ..language._vocabulary import CompiledForm, Vocabulary
from ..ledger._loaded_words import LoadedWord, loaded_words

EXCEPTION = re.compile(
    r"(?:,?\s*(?:except|apart\s+from|excluding|other\s+than)[^,.;:!?]{0,20}\b(?:take-?off|start)\s+(?:and|or)\s+(?:the\s+)?landing)"
    r"|\s+either(?=\s*(?:$|[,.;]))"
    r"|,?\s+(?:once|when|after)\s+(?:it\s+is\s+)?(?:clear\s+of\s+home|airborne|aloft|in\s+the\s+air|up|out\s+of\s+the\s+launch\s+area)\b",
    re.IGNORECASE,
)
"""What a lowest height always excepts, and a word that repeats a denial."""
_JOINT = re.compile(
    r"[,:]\s+(?:(?:and|but)\s+)?|\s+(?:and|but|then)\s+|\s+(?=nor\s)|\s+[-–—]\s+", re.IGNORECASE
)
_BETWEEN = re.compile(r"\bbetween (?:the )?\w+$", re.IGNORECASE)
"""`the link between drone and operator` is one clause."""
_DENIAL_ALONE = re.compile(r"\s(?:nor|never)\s*$", re.IGNORECASE)
"""`nor, once airborne, below 30 m`: a denial belongs to what follows it."""
_OF_THE_BATTERY = re.compile(
    r"\s+(?:of\s+)?(?:(?:its|the|a|all)\s+)*(?:battery|charge|accu|camera|frames?|pictures?|images?)\b|\s+(?:must|shall|should|has\s+to|is\s+to)\s+(?:be\s+left|remain)",
    re.IGNORECASE,
)
_MARGIN = " ,\n"


@dataclass(frozen=True, slots=True)
class Run:
    """One or several clauses that stand beside each other. `plain` is their text with spaces for what it excepts."""

    span: Span
    words: tuple[Word, ...]
    plain: str

    @property
    def quantities(self) -> list[Part]:
        """The numbers, but `one`, `a`, `single` and `some`, which count nobody; a fraction only of the battery or of pictures."""
        of_battery = [
            Part("PERCENT", Quantity("PERCENT", fraction.value, fraction.value), word.span)
            for word in self.words
            for fraction in word.meanings
            if fraction.kind == "FRACTION" and isinstance(fraction.value, float)
            if _OF_THE_BATTERY.match(self.plain, word.span.end - self.span.start)
        ]
        return of_battery + [
            Part(meaning.kind, meaning.value, word.span)
            for word in self.words
            for meaning in word.meanings
            if isinstance(meaning.value, Quantity)
            and not (meaning.kind == "COUNT" and (meaning.value.low, meaning.value.high) == (1.0, 1.0))
            and not (meaning.value.vague and word.text.lower() == "some")
        ]

    @property
    def loaded(self) -> list[LoadedWord]:
        """Its loaded words, with their places in the whole text."""
        begin = self.span.start
        return [
            LoadedWord(word.load, word.text, Span(word.span.start + begin, word.span.end + begin))
            for word in loaded_words(self.plain)
        ]

    def signs(self, form: CompiledForm, context: str | None) -> list[Span] | None:
        """Where the signs of a form stand in the text; None where one is missing."""
        spans = form.spans(self.plain, context)
        begin = self.span.start
        return None if spans is None else [Span(start + begin, end + begin) for start, end in spans]


class SentenceRuns:
    """A sentence, divided into clauses. `context` is the sentence with the one before it."""

    def __init__(
        self,
        words: Sequence[Word],
        text: str,
        span: Span,
        before: int,
        vocabulary: Vocabulary,
        earlier: Sequence[Word] = (),
    ) -> None:
        self.text, self.context, self.vocabulary = text, text[before : span.end], vocabulary
        self.earlier = (*earlier, *words)
        self._words, self._begin = words, span.start
        self._plain = blanked(EXCEPTION, text[span.start : span.end])
        numbers = [word.span for word in words if any(isinstance(m.value, Quantity) for m in word.meanings)]
        matches = [
            match
            for match in _JOINT.finditer(self._plain)
            if not _BETWEEN.search(self._plain[: match.start()])
            and not _DENIAL_ALONE.search(self._plain[: match.start()])
        ]
        spans = [Span(match.start() + span.start, match.end() + span.start) for match in matches]
        joints = [joint for joint in spans if not any(overlap(number, joint) for number in numbers)]
        starts = [span.start, *(joint.end for joint in joints)]
        self._bounds = list(zip(starts, [*(joint.start for joint in joints), span.end], strict=True))

    def __len__(self) -> int:
        return len(self._bounds)

    def run(self, first: int, last: int | None = None) -> Run:
        """The clauses from the first to the last; one clause when no last one is given."""
        begin, end = self._bounds[first][0], self._bounds[first if last is None else last][1]
        text = self.text[begin:end]
        span = Span(begin + len(text) - len(text.lstrip(_MARGIN)), begin + len(text.rstrip(_MARGIN)))
        words = tuple(word for word in self._words if begin < word.span.end and word.span.start < end)
        return Run(span, words, self._plain[span.start - self._begin : span.end - self._begin])

    @property
    def names_a_group(self) -> bool:
        """Whether the sentence speaks of people or things, which may be its subject."""
        kinds = {meaning.kind for word in self._words for meaning in word.meanings}
        return not kinds.isdisjoint(("ASSET", "AMBIGUOUS", "CONVOY")) or any(
            word.filler and "convoy" in word.text.lower() for word in self._words
        )

    @property
    def loaded(self) -> list[LoadedWord]:
        """The loaded words of the whole sentence."""
        return loaded_words(self._plain)


def blanked(pattern: re.Pattern[str], text: str) -> str:
    """A text of the same length with spaces in the place of what the pattern finds."""
    return pattern.sub(lambda match: " " * len(match.group()), text)


def overlap(one: Span, other: Span) -> bool:
    """Whether two spans have a character in common."""
    return one.start < other.end and other.start < one.end
