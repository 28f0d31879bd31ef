"""Corrects spelling: a word in no list of English words is replaced by the nearest word of the vocabulary."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Protocol

MIN_CORRECTED_LETTERS, LONG_WORD_LETTERS = 4, 8
UNCORRECTABLE_KINDS = frozenset(
    [
        "SUN",
        "CLOCK",
        "DATE",
        "WEATHER",
        "INTENSITY",
        "WIND",
        "WINDS",
        "CALM",
        "CLEAR",
        "GUSTS",
        "MOTION",
        "NUM",
    ]
)
"""Meanings that no correction gives a word: a day that became a sunset, or a wind, would not be noticed."""


class WordMeaning(Protocol):
    """A meaning of a word."""

    @property
    def kind(self) -> str: ...


class KnownWords(Protocol):
    """What correction needs of a vocabulary."""

    @property
    def meanings(self) -> Mapping[str, tuple[WordMeaning, ...]]: ...

    @property
    def plain(self) -> frozenset[str]: ...

    @property
    def correctable(self) -> tuple[str, ...]: ...


@cache
def _english_words() -> frozenset[str]:
    # 0.3 s, so only once a text has a word that is near one of the vocabulary.
    from spellchecker import SpellChecker

    return frozenset(SpellChecker(language="en").word_frequency.dictionary)


def corrected_spelling(text: str, vocabulary: KnownWords, corrections: dict[str, str]) -> str:
    """The word as the vocabulary spells it: unchanged, or the nearest word one or two letters off.

    A word of English stays as it is, whatever it is near to.
    """
    lower = re.sub(r"\s+", " ", text.lower().replace("’", "'"))
    if lower in vocabulary.plain or not lower.isalpha() or len(lower) < MIN_CORRECTED_LETTERS:
        return lower
    if lower not in corrections:
        corrections[lower] = _nearest(lower, vocabulary)
    return corrections[lower]


def _nearest(lower: str, vocabulary: KnownWords) -> str:
    most = 2 if len(lower) >= LONG_WORD_LETTERS else 1
    letters = set(lower)
    distances = {
        candidate: distance
        for candidate in vocabulary.correctable
        if abs(len(candidate) - len(lower)) <= most
        # One edit changes at most two letters, which rules out most candidates before the slow comparison.
        and len(letters.symmetric_difference(candidate)) <= 2 * most
        and (distance := edit_distance(lower, candidate, most)) <= most
    }
    if not distances or lower in _english_words():
        return lower
    best = [candidate for candidate, distance in distances.items() if distance == min(distances.values())]
    # The first letter is rarely the wrong one: it parts words that are equally near.
    best = [candidate for candidate in best if candidate[0] == lower[0]] or best
    # A word that means something by itself goes before one that is only part of a phrase.
    best = [candidate for candidate in best if candidate in vocabulary.meanings] or best
    meanings = [vocabulary.meanings.get(candidate, ()) for candidate in best]
    same = all(meaning == meanings[0] for meaning in meanings)
    return best[0] if same and (meanings[0] or len(best) == 1) else lower


def edit_distance(a: str, b: str, most: int) -> int:
    """Letters dropped, added, changed or swapped with a neighbour between two words; most + 1 when there are
    more.
    """
    before, row = list[int](), list(range(len(b) + 1))
    for i, x in enumerate(a, start=1):
        earlier, before, row = before, row, [i]
        for j, y in enumerate(b, start=1):
            cost = min(before[j] + 1, row[-1] + 1, before[j - 1] + (x != y))
            if i > 1 and j > 1 and x == b[j - 2] and a[i - 2] == y:
                cost = min(cost, earlier[j - 2] + 1)
            row.append(cost)
        # Distances never fall from row to row, so nothing below can be near enough any more.
        if min(row) > most:
            return most + 1
    return row[-1]
