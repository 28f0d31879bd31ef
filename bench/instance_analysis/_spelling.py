"""Words as the vocabulary spells them: one that is a letter or two off is taken for the word that it is nearest to."""

from __future__ import annotations

import re

from ._vocabulary import Vocabulary

SHORTEST_MENDED, LONG = 4, 8


def spelled(text: str, vocabulary: Vocabulary, mended_as: dict[str, str]) -> str:
    """The word as the vocabulary spells it: itself, or the one word that it is a letter or two off."""
    lower = re.sub(r"\s+", " ", text.lower().replace("’", "'"))
    if lower in vocabulary.plain or not lower.isalpha() or len(lower) < SHORTEST_MENDED:
        return lower
    if lower not in mended_as:
        most = 2 if len(lower) >= LONG else 1
        letters = set(lower)
        near = {
            other: off
            for other in sorted(vocabulary.single)
            if len(other) >= SHORTEST_MENDED
            and abs(len(other) - len(lower)) <= most
            and len(letters.symmetric_difference(other)) <= 2 * most  # an edit changes two letters at the most
            and (off := edits(lower, other, most)) <= most
        }
        best = [other for other, off in near.items() if off == min(near.values())]
        # The first letter is rarely the wrong one: it parts words that are equally near.
        best = [one for one in best if one[0] == lower[0]] or best
        # A word that means something by itself goes before one that is only part of a phrase.
        best = [one for one in best if one in vocabulary.meanings] or best
        same = best and all(vocabulary.meanings.get(one, one) == vocabulary.meanings.get(best[0], best[0]) for one in best)
        mended_as[lower] = best[0] if same else lower
    return mended_as[lower]


def edits(a: str, b: str, most: int) -> int:
    """Letters dropped, added, changed or swapped with their neighbour between two words; most + 1 where it is more."""
    before, row = list[int](), list(range(len(b) + 1))
    for i, x in enumerate(a, start=1):
        earlier, before, row = before, row, [i]
        for j, y in enumerate(b, start=1):
            cost = min(before[j] + 1, row[-1] + 1, before[j - 1] + (x != y))
            if i > 1 and j > 1 and x == b[j - 2] and a[i - 2] == y:
                cost = min(cost, earlier[j - 2] + 1)
            row.append(cost)
        if min(row) > most:
            return most + 1
    return row[-1]
