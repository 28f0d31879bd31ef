"""Reads shares of a group: `half of them`, `two of the trucks`, `the rest`. Each share becomes a group of its own."""

from __future__ import annotations

from ..language._phrases import Part, Phrase, Quantity
from ._group_references import GroupReferences


class ShareReader:
    """Divides groups. What was said of a group before holds for all of its parts, what follows for one part."""

    def __init__(self, references: GroupReferences) -> None:
        self._references, self._groups, self._draft = references, references.groups, references.draft

    def share(self, phrase: Phrase) -> bool:
        """Make a share the subject; whether the text tells of whom and how many."""
        portion = phrase.first("FRACTION") or phrase.first("COUNT")
        assert portion is not None
        whole = self._whole(phrase)
        if whole is None or not isinstance(portion.value, Quantity | float):
            return self._leave(phrase, "the text does not say of which group")
        if isinstance(portion.value, Quantity) and self._groups.counts.count_later(
            whole, portion.value, phrase.span
        ):
            # `trucks, two of them`: that is all of them.
            self._draft.used_words.append(phrase.span)
            return True
        number = self._number(whole, portion)
        if number is None:
            return self._leave(phrase, "it is no part of a stated number")
        if self._groups.is_referred_to(whole):
            return self._leave(phrase, "another group stands by its place")
        self._groups.subject = [self._groups.divide(whole, number, phrase)]
        self._draft.used_words.append(phrase.span)
        return True

    def rest(self, phrase: Phrase) -> bool:
        """Make the rest of the group that was divided last the subject; whether there is one."""
        remaining = self._groups.divided
        count = None if remaining is None else self._draft.entries["actors", remaining, "count"].value
        portion = phrase.first("FRACTION") or phrase.first("COUNT")
        asset = phrase.first("ASSET")
        if remaining is None or (asset is not None and asset.value != self._groups.kinds[remaining]):
            return self._leave(phrase, "no group was divided before it")
        if portion is not None and self._number(remaining, portion, of_rest=True) != count:
            return self._leave(phrase, f"there are {count} left")
        self._groups.subject = [remaining]
        self._draft.used_words.append(phrase.span)
        self._draft.acknowledge(phrase.span)
        return True

    def _leave(self, phrase: Phrase, why: str) -> bool:
        self._draft.unread(phrase.span, why, expressible=True)
        self._groups.subject = []
        return False

    def _whole(self, phrase: Phrase) -> str | None:
        """The group that a share is of; None when the text does not tell."""
        things = [part for part in phrase.parts if isinstance(part, Part) and part.kind == "ASSET"]
        if phrase.has("THEM", "OFTHEM"):
            recent = self._groups.mentioned or self._groups.mentioned_before
            several = [group for group in recent if group in self._groups.counts.plural]
            # `one of which` is one of what was named last; `one of them` of any group that was.
            known = self._groups.divided_of(recent[-1:] if phrase.has("OFTHEM") else several)
        else:
            known = [group for group, kind in self._groups.kinds.items() if kind == things[0].value]
            counts = phrase.every("COUNT")[0 if phrase.has("FRACTION") else 1 :]
            if not known and counts:
                # `half of the eight soldiers`, who have not been spoken of.
                ref = Phrase("ref", (counts[-1], things[0]), counts[-1].span.joined(things[0].span))
                known = self._references.named(ref)
            known = self._groups.divided_of(known)
        return known[0] if len(known) == 1 else None

    def _number(self, whole: str, portion: Part, *, of_rest: bool = False) -> int | None:
        """Number of members of a share; None where it is no whole number or leaves nobody."""
        total = self._groups.total(whole)
        if total is None:
            return None
        value = portion.value
        exact = value.low if isinstance(value, Quantity) else float(str(value)) * total
        single = not isinstance(value, Quantity) or value.single
        remaining = int(self._draft.entries["actors", whole, "count"].value)
        number = round(exact)
        fits = single and abs(exact - number) < 1e-6 and 0 < number < remaining + of_rest
        return number if fits else None
