"""Corrects spelling: a word one or two letters off is replaced by the nearest word of the vocabulary."""

from __future__ import annotations

import re

from ._vocabulary import Vocabulary

MIN_CORRECTED_LETTERS, LONG_WORD_LETTERS = 4, 8


def corrected_spelling(text: str, vocabulary: Vocabulary, corrections: dict[str, str]) -> str:
    """The word as the vocabulary spells it: unchanged, or the nearest word one or two letters off."""
    lower = re.sub(r"\s+", " ", text.lower().replace("’", "'"))
    if lower in vocabulary.plain or not lower.isalpha() or len(lower) < MIN_CORRECTED_LETTERS:
        return lower
    if lower not in corrections:
        most = 2 if len(lower) >= LONG_WORD_LETTERS else 1
        letters = set(lower)
        distances = {
            candidate: distance
            for candidate in sorted(vocabulary.single)
            if len(candidate) >= MIN_CORRECTED_LETTERS
            and abs(len(candidate) - len(lower)) <= most
            # One edit changes at most two letters, which rules out most candidates before the slow
            # comparison.
            and len(letters.symmetric_difference(candidate)) <= 2 * most
            and (distance := edit_distance(lower, candidate, most)) <= most
        }
        best = [candidate for candidate, distance in distances.items() if distance == min(distances.values())]
        # The first letter is rarely the wrong one: it parts words that are equally near.
        best = [candidate_word for candidate_word in best if candidate_word[0] == lower[0]] or best
        # A word that means something by itself goes before one that is only part of a phrase.
        best = [candidate_word for candidate_word in best if candidate_word in vocabulary.meanings] or best
        same = best and all(
            vocabulary.meanings.get(candidate_word, candidate_word)
            == vocabulary.meanings.get(best[0], best[0])
            for candidate_word in best
        )
        corrections[lower] = best[0] if same else lower
    return corrections[lower]


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
