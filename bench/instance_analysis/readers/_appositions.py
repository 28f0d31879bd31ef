"""Reads a second noun for one person: `one survivor, a woman, is to be located`, `lost child: a girl of seven`."""

from __future__ import annotations

import re

from bench.simspec import Role

from .._draft import Draft
from ..language._phrases import Phrase, Quantity
from ..language._tokens import Span
from ._groups import GroupRegister
from ._traits import PERSONS
from ._unread_subjects import UnreadSubjects

_PAUSES = (",", "(", ":", "-", "–", "—")
_GENDERED = frozenset(["man", "woman", "boy", "girl", "lady", "gentleman", "male", "female"])
"""Nouns of which one person has one: `a man, a woman` are two."""
_GOES_ON = re.compile(r"\s*(?:,?\s*and\b|,\s*(?:an?|one|two|three|four|five|\d+)\b)", re.IGNORECASE)
"""What follows a noun inside a list: `a civilian, a child and a dog`."""
_NUMBERS = {"a": 1, "an": 1, "one": 1, "two": 2, "three": 3, "four": 4, "five": 5, "six": 6}
_PAIR = re.compile(
    rf"\s+and\s+({'|'.join(_NUMBERS)}|\d)\s+[\w-]+(?=\s*(?:[.,;:)\n]|in their\b|aged\b|who\b|both\b|$))",
    re.IGNORECASE,
)
"""The rest of `a man and two women` at the end of what is said, with its number."""
_VERB = re.compile(
    r"\b(?:stands?|stood|is|are|was|were|lies?|sits?|waits?|shall|must|remains?|stays?|walks?|drives?|moves?|and|or|with|near)\b",
    re.IGNORECASE,
)
"""What ends the noun before it, so that the noun after a comma begins something else."""


class AppositionReader:
    """Asks whether a noun after a comma names the person before it, and gives that person its asset."""

    def __init__(self, draft: Draft, groups: GroupRegister, unread: UnreadSubjects) -> None:
        self._draft, self._groups, self._unread = draft, groups, unread
        self._pair_until = 0
        """Where a pair ends that was said of a group, or of something unread."""

    def goes_on(self, phrase: Phrase) -> bool:
        """Whether a phrase is the second noun of `two hikers, a man and a woman`, which make no groups."""
        if phrase.span.end > self._pair_until:
            return False
        self._draft.references.append(phrase.span)
        return True

    def _is_pair(self, phrase: Phrase) -> bool:
        """Whether `a man and two women` tells who the three persons are that the sentence has named; else it is asked."""
        draft, groups = self._draft, self._groups
        before = draft.text[: phrase.span.start].rstrip()
        pair, asset = _PAIR.match(draft.text, phrase.span.end), phrase.first("ASSET")
        if pair is None or asset is None or not before.endswith((",", ":", "(")):
            return False
        if groups.vocabulary.assets[str(asset.value)].asset not in PERSONS:
            return False
        subject = groups.subject if groups.in_sentence else []
        number = _NUMBERS.get(pair[1].lower()) or int(pair[1])
        count = phrase.first("COUNT")
        if count is not None and isinstance(count.value, Quantity) and count.value.single:
            number += int(count.value.low)
        known = (
            len(subject) == 1 and groups.asset(subject[0]) in PERSONS and groups.total(subject[0]) == number
        )
        unread = None if known else self._unread.named_in_clause_before(len(before) - 1)
        if not known and unread is None:
            return False
        said_of = f"the same as {subject[0]!r} before" if known else "what is not read: leave it out"
        answers = [(said_of, True), ("others", False)]
        if not known:
            answers.reverse()
        span = Span(phrase.span.start, pair.end())
        same = answers[draft.ask(span, "who is this?", [name for name, _ in answers])][1]
        if same:
            self._pair_until = pair.end()
            draft.references.append(phrase.span)
            draft.acknowledge(span)
            if not known:
                draft.unread(span, "it is said of something that is not read", expressible=True)
        return same

    def read(self, phrase: Phrase) -> bool:
        """Whether a phrase names the single person that is the subject; then it makes no group."""
        head, asset = self._head_of(phrase), phrase.first("ASSET")
        if head is None or asset is None:
            return self._is_pair(phrase)
        answers = [(f"the same as {head!r} before", True), ("somebody else", False)]
        if _GOES_ON.match(self._draft.text, phrase.span.end):
            answers.reverse()
        same = answers[self._draft.ask(phrase.span, "who is this?", [name for name, _ in answers])][1]
        if same:
            self._draft.references.append(phrase.span)
            self._groups.mention([head], phrase.span)
            self._describe(head, str(asset.value), phrase)
        return same

    def _head_of(self, phrase: Phrase) -> str | None:
        """The person whom a phrase may name once more; None where it cannot."""
        draft, groups = self._draft, self._groups
        asset, count = phrase.first("ASSET"), phrase.first("COUNT")
        subject = groups.subject if groups.in_sentence else []
        one = count is not None and isinstance(count.value, Quantity) and count.value.high == 1
        if asset is None or not one or len(subject) != 1 or subject[0] in groups.counts.plural:
            return None
        named = draft.entries["actors", subject[0], "asset"].span
        persons = {groups.asset(subject[0]), groups.vocabulary.assets[str(asset.value)].asset} <= PERSONS
        if named is None or not persons or named.end > phrase.span.start:
            return None
        between = draft.text[named.end : phrase.span.start]
        nouns = [draft.quote(span).lower().split()[-1] for span in (named, asset.span)]
        two = nouns[0] == nouns[1] or _GENDERED.issuperset(nouns)
        beside = between.rstrip().endswith(_PAUSES) and not _VERB.search(between) and "." not in between
        return subject[0] if beside and not two else None

    def _describe(self, head: str, name: str, phrase: Phrase) -> None:
        """Let the second noun say who the person is, where the first one says less."""
        draft, words, asset = self._draft, self._groups.vocabulary.assets[name], phrase.first("ASSET")
        if self._groups.kinds[head] != "civilian" or asset is None:
            return
        self._groups.kinds[head] = name
        described = {"asset": words.named_by(draft.quote(asset.span))}
        if described["asset"] == "civilian":
            return
        if self._groups.role(head) is Role.BYSTANDER:
            described["role"] = str(words.role)
        for field, value in described.items():
            draft.forget(("actors", head, field))
            draft.put(("actors", head, field), value, phrase.span)
