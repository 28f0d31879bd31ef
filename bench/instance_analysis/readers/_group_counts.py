"""How many members the groups of a text have."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .._draft import Draft, FieldPath
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span
from ..language._vocabulary import Meaning, Vocabulary

PLURALS = frozenset(
    [
        "people", "persons", "men", "women", "children", "infantrymen", "gunmen", "insurgents", "troops",
        "civs", "pax", "civvies", "schoolchildren", "cattle", "sheep",
    ]
)  # fmt: skip
DEFINITE = ("the", "these", "those", "both", "all", "that", "this", "same", "said")
COLLECTIVES = frozenset(
    ["squad", "platoon", "section", "family", "team", "crew", "group", "class", "patrol", "party", "infantry"]
)
"""Whom `of nine` counts."""


class GroupCounts:
    """Reads the numbers of groups into the draft."""

    def __init__(self, draft: Draft, vocabulary: Vocabulary) -> None:
        self.draft, self.vocabulary = draft, vocabulary
        self.plural: set[str] = set()
        """Groups of several members."""
        self.uncounted: set[str] = set()
        """Groups of which it is not said how many there are."""
        self.defined: set[str] = set()
        """Groups that began with `the`: whoever counts them later means them."""
        self._vague: set[str] = set()
        """Groups of which it is said that there are `some` or `lots`."""

    def set(self, group: str, phrase: Phrase, count: Part | None, span: Span) -> None:
        path: FieldPath = ("actors", group, "count")
        self.uncounted.discard(group)
        if count is None or not isinstance(count.value, Quantity):
            self.uncounted.add(group)
            if is_definite(self.draft, span):
                self.defined.add(group)
            if is_plural(self.draft, span):
                few, most = self._vague_range()
                self.plural.add(group)
                self.draft.vary(
                    path, few, most, None, unit=None, integer=True, note="no number is given: read as `some`"
                )
            else:
                self.draft.put(path, 1, span)
            return
        quantity = count.value
        low, high = quantity.low, quantity.high
        if quantity.vague:
            self._vague.add(group)
        where = count.span.joined(span)
        bound, upper = phrase.first("ATLEAST"), phrase.first("WITHIN")
        if bound and upper:
            where = bound.span.joined(where)
        elif bound:
            readings = [f"{low:g}", f"{low:g} to {2 * low:g}"]
            high = (
                low
                if self.draft.ask(bound.span.joined(where), "no upper bound is given; how many?", readings)
                == 0
                else 2 * low
            )
        elif upper and quantity.single:
            # `up to 10`.
            low = 0.0
        if high > 1:
            self.plural.add(group)
        self.draft.vary(path, low, high, where, unit=None, integer=True)

    def set_again(self, group: str, phrase: Phrase, count: Part, span: Span) -> None:
        self.draft.forget(("actors", group, "count"))
        self.set(group, phrase, count, span)

    def count_later(self, group: str, quantity: Quantity, span: Span, *, vague: bool = False) -> bool:
        """Set the number of members of a group that has none yet, or with `vague` only `some`. False when it has one."""
        path: FieldPath = ("actors", group, "count")
        entry = self.draft.entries.get(path)
        open_number = group in self.uncounted or (vague and group in self._vague)
        if entry is None or not open_number or quantity.low != int(quantity.low):
            return False
        self._vague.discard(group)
        self.uncounted.discard(group)
        self.draft.forget(path)
        self.draft.vary(path, quantity.low, quantity.high, span, unit=None, integer=True)
        if quantity.high > 1:
            self.plural.add(group)
        return True

    def not_counted(self, known: Sequence[str], *, there: bool) -> str | None:
        """The single group of these that has no number yet; None when there is none or more than one."""
        countable = self.plural | self.defined | (set(known) if there else set())
        uncounted = [group for group in known if group in self.uncounted and group in countable]
        return uncounted[0] if len(uncounted) == 1 else None

    def there_are(self, span: Span) -> bool:
        """Whether the sentence only gives a number: `there are four houses and ten trees`."""
        return (
            re.search(r"\bthere (are|were|is|was|will be)\b[^.;\n]*$", self.draft.text[: span.start].lower())
            is not None
        )

    def _vague_range(self) -> tuple[int, int]:
        meaning = next(
            (m for m in self.vocabulary.meanings.get("some", ()) if m.kind == "VAGUE"),
            Meaning("VAGUE", (2, 10)),
        )
        assert isinstance(meaning.value, tuple)
        return int(meaning.value[0]), int(meaning.value[1])

    def number_in(self, phrase: Phrase) -> Part | None:
        """The number of members that a phrase gives: the last one, as in `a squad of nine`."""
        counts = phrase.every("COUNT")
        if phrase.has("ATLEAST") and phrase.has("WITHIN"):
            return _range_of(phrase, counts)
        words = self.draft.quote(phrase.span).lower().split()
        if phrase.has("OF") and phrase.rule == "ref":
            # `inside one of the houses`: any member.
            portion, *counts = counts
            if isinstance(portion.value, Quantity) and portion.value.high == 1:
                self.draft.acknowledge(portion.span)
            else:
                portion.disown()
        elif phrase.has("OF") and not COLLECTIVES.intersection(words):
            # `a resident of 81`: the number after it counts nobody.
            age = counts.pop()
            age.disown()
            self.draft.used_words.append(age.span)
            self.draft.unread(age.span, "an age is no field", expressible=True)
        noun = phrase.first("ASSET") or phrase.first("AMBIGUOUS")
        if counts and noun and ":" in self.draft.text[counts[-1].span.end : noun.span.start]:
            # `Target 2: a truck`, `house number 3: a truck`: the number is a label.
            counts.pop().disown()
        for part in counts[:-1]:
            # Only the last number is used, and `two squads of nine` are not nine.
            part.disown()
        return counts[-1] if counts else None


def is_definite(draft: Draft, span: Span) -> bool:
    """Whether an article before a noun says that it is known: `the`, `these`, `both`."""
    before = draft.text[: span.start].rstrip().lower().split()
    return bool(before) and before[-1].strip(",;:(") in DEFINITE


def is_plural(draft: Draft, span: Span) -> bool:
    """Whether a noun is one of several."""
    last = draft.quote(span).lower().split()[-1]
    return last in PLURALS or (last.endswith("s") and not last.endswith(("ss", "us")))


def _range_of(phrase: Phrase, counts: Sequence[Part]) -> Part:
    """The number of `not less than 5 and not more than 9 civilians`."""
    least, most = (part.value for part in (counts[0], counts[-1]))
    assert isinstance(least, Quantity)
    assert isinstance(most, Quantity)
    return Part("COUNT", Quantity("COUNT", least.low, most.high), counts[0].span.joined(counts[-1].span))
