"""A bounded sample of the messages of one run, whose number an agent chooses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

# Chosen: a thousand crosses are 0.2 MB of the page and are drawn at once, and more hide the map and each other.
MAX_DRAWN = 1000


def chosen_rows(count: int, groups: Iterable[Sequence[int]]) -> list[int]:
    """All of `count` rows, or MAX_DRAWN of them, in order. Of the groups, each gets at most half of the rows that are
    left by the groups before it; the others get the rest.
    """
    if count <= MAX_DRAWN:
        return list(range(count))
    chosen: set[int] = set()
    for group in groups:
        # Half, so that a flood of one kind leaves something of every other to be seen.
        chosen |= set(_spread([row for row in group if row not in chosen], (MAX_DRAWN - len(chosen)) // 2))
    remaining = [row for row in range(count) if row not in chosen]
    return sorted(chosen | set(_spread(remaining, MAX_DRAWN - len(chosen))))


def row_ends(keys: Iterable[object]) -> list[int]:
    """The first and the last row of each key, in order."""
    first: dict[object, int] = {}
    last: dict[object, int] = {}
    for row, key in enumerate(keys):
        first.setdefault(key, row)
        last[key] = row
    return sorted({*first.values(), *last.values()})


def _spread(rows: Sequence[int], count: int) -> list[int]:
    """At most `count` of the rows, evenly spread, the first and the last among them where `count` is 2 or more."""
    if len(rows) <= count:
        return list(rows)
    return [rows[round(place)] for place in np.linspace(0, len(rows) - 1, count)]
