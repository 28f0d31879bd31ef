"""Reads a second noun for one person: `one survivor, a woman, is to be located`, `lost child: a girl of seven`."""

from __future__ import annotations

import re

from bench.simspec import Role

from .._draft import Draft
from ..language._phrases import Phrase, Quantity
from ._groups import GroupRegister
from ._traits import PERSONS

_PAUSES = (",", "(", ":", "-", "–", "—")
_GENDERED = frozenset(["man", "woman", "boy", "girl", "lady", "gentleman", "male", "female"])
"""Nouns of which one person has one: `a man, a woman` are two."""
_GOES_ON = re.compile(r"\s*(?:,?\s*and\b|,\s*(?:an?|one|two|three|four|five|\d+)\b)", re.IGNORECASE)
"""What follows a noun inside a list: `a civilian, a child and a dog`."""
_VERB = re.compile(
    r"\b(?:stands?|stood|is|are|was|were|lies?|sits?|waits?|shall|must|remains?|stays?|walks?|drives?|moves?|and|or|with|near)\b",
    re.IGNORECASE,
)
"""What ends the noun before it, so that the noun after a comma begins something else."""


class AppositionReader:
    """Asks whether a noun after a comma names the person before it, and gives that person its asset."""

    def __init__(self, draft: Draft, groups: GroupRegister) -> None:
        self._draft, self._groups = draft, groups

    def read(self, phrase: Phrase) -> bool:
        """Whether a phrase names the single person that is the subject; then it makes no group."""
        head, asset = self._head_of(phrase), phrase.first("ASSET")
        if head is None or asset is None:
            return False
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
        if asset is None or not one or len(subject) != 1 or subject[0] in groups.plural:
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
        draft, words = self._draft, self._groups.vocabulary.assets[name]
        if self._groups.kinds[head] != "civilian" or name == "civilian":
            return
        self._groups.kinds[head] = name
        described = {"asset": words.asset}
        if self._groups.role(head) is Role.BYSTANDER:
            described["role"] = str(words.role)
        for field, value in described.items():
            draft.forget(("actors", head, field))
            draft.put(("actors", head, field), value, phrase.span)
