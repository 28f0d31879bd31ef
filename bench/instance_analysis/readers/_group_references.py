"""Which groups a phrase means: known ones by noun or pronoun, or a new one."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.simspec import HOME, PROTECTED_ROLES, Role

from .._draft import Draft
from ..language._coordinates import Coordinates
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span
from ._group_counts import is_definite, is_plural
from ._groups import GroupRegister, noun_of
from ._traits import PERSONS, ROOFED, put_motion

RelationTarget = str | Coordinates
"""Whom a relation is to: the id of a group, `home`, or a place."""
_NOT_THE_SAME = re.compile(r"\b(?:our|my|your|local|other|more)\s+$", re.IGNORECASE)
"""What makes a noun after it no mention of whom the text has named by another word."""
_OF_ANY = re.compile(r"\b(?:each|every|any|no|per|an?|single)\s+$", re.IGNORECASE)
GENERIC_PERSONS = frozenset(
    [
        "pax", "person", "persons", "people", "men", "individual", "individuals", "adult", "adults", "ppl", "human",
        "humans", "civilian", "bystander", "in all",
    ]
)  # fmt: skip
"""Words for anybody, which tell nothing of who is meant."""
_ANYBODY = frozenset(["men", "man", "persons", "person", "guys", "individuals"])
"""Nouns for persons that, with an article, mean whom the text has spoken of by another noun."""
_ONE = ("a", "an", "one")
SINGULAR_PRONOUNS = ("it", "he", "she", "him", "her")


class GroupReferences:
    """Resolves nouns and pronouns to the groups of a register, and adds the groups that they introduce."""

    def __init__(self, draft: Draft, groups: GroupRegister) -> None:
        self.draft, self.groups = draft, groups
        self.referents: dict[Span, list[RelationTarget]] = {}
        """What each phrase that was resolved means."""

    def named(self, phrase: Phrase) -> list[str]:
        """The group or groups that a phrase names: known ones, or a new one."""
        groups = self._groups_named(phrase)
        self.groups.mentioned += groups
        self.groups.mention(groups, phrase.span)
        return groups

    def _groups_named(self, phrase: Phrase) -> list[str]:
        name, span = self._thing(phrase)
        if not name:
            self.groups.subject_is_mission = True
            return []
        count, none = self.groups.counts.number_in(phrase), phrase.first("NONE")
        known = [
            group
            for group, asset in self.groups.kinds.items()
            if asset == name and not self._contradicts(group, phrase)
        ]
        if phrase.has("SOUGHT"):
            known = [group for group in known if self.groups.role(group) is Role.SOUGHT]
        if phrase.rule == "group" and (nth := phrase.first("NTH")):
            return self._next_one(phrase, name, nth, known)
        dense = phrase.first("PERAREA") is not None
        if (
            count is None
            and not none
            and not dense
            and (meant := self._persons_meant(phrase, span)) is not None
        ):
            return meant
        if known and not none and not dense and (count is None or is_definite(self.draft, phrase.span)):
            return self._mentioned_again(phrase, known, count, span)
        some_member = phrase.rule == "ref" and count and self.draft.quote(count.span).lower() in _ONE
        if some_member and (several := [group for group in known if group in self.groups.counts.plural]):
            # `near a crate`, where the text has crates, means near some member of that group.
            assert count is not None
            self.draft.acknowledge(count.span)
            phrase.every("ATLEAST")
            return self.groups.choose_one(several, span)
        if none or (count and isinstance(count.value, Quantity) and count.value.high == 0):
            self.groups.note_absent(phrase, name)
            return []
        return [self._counted(phrase, name, known, count, span)]

    def _thing(self, phrase: Phrase) -> tuple[str, Span]:
        if part := phrase.first("ASSET"):
            return str(part.value), part.span
        part = phrase.first("AMBIGUOUS")
        assert part is not None
        assert isinstance(part.value, tuple)
        quote = self.draft.quote(part.span)
        # `a truck ...; the vehicle` means the truck, because only one of the word's readings was mentioned.
        known = [name for name in part.value if name in self.groups.kinds.values()]
        if len(known) == 1 and is_definite(self.draft, part.span):
            return known[0], part.span
        readings = [
            f"{self.groups.vocabulary.assets[candidate].asset} ({self.groups.vocabulary.assets[candidate].role})"
            for candidate in part.value
        ]
        if is_definite(self.draft, part.span):
            # `the vehicle` may also be the drone.
            readings.append("the drone under test")
        chosen = self.draft.ask(part.span, f"what is meant by {quote!r}?", readings)
        return (str(part.value[chosen]) if chosen < len(part.value) else ""), part.span

    def _counted(
        self, phrase: Phrase, name: str, known: Sequence[str], count: Part | None, span: Span
    ) -> str:
        """A new group, or one that was named before without the number that it gets now."""
        if phrase.rule == "group" and count and phrase.first("PERAREA") is None:
            earlier = self.groups.counts.not_counted(known, there=self.groups.counts.there_are(phrase.span))
            if earlier and self._may_be(earlier, phrase, count) and self._is_counted_now(earlier, phrase):
                self.groups.counts.set_again(earlier, phrase, count, span)
                return earlier
        return self.groups.add(phrase, name, span, count)

    def _persons_meant(self, phrase: Phrase, span: Span) -> list[str] | None:
        """Whom `the men` means, where it may be several groups of persons or somebody unread; None where it is plain."""
        if (
            phrase.rule != "group"
            or self.draft.quote(span).lower() not in _ANYBODY
            or not is_definite(self.draft, span)
        ):
            return None
        several = is_plural(self.draft, span)
        fitting = [
            group
            for group in self.groups.kinds
            if self.groups.asset(group) in PERSONS and (group in self.groups.counts.plural) == several
        ]
        fitting.sort(key=lambda group: -self.groups.mentioned_at([group]).end)
        # The noun of an unknown word may be theirs: `two smugglers load a car; the men are our targets`.
        begin = self.groups.mentioned_at(fitting).end
        stranger = self.groups.unread.since(begin, span.start, subjects=True) is not None
        known = any(self.groups.kinds[group] == "civilian" for group in fitting)
        if len(fitting) + stranger < 2 and (known or not fitting) and not stranger:
            return None
        answers = [(f"the same as {group!r} before", [group]) for group in fitting]
        if stranger:
            answers.insert(0, ("what is not read: leave it out", []))
        asked = len(answers) > 1 or not stranger
        chosen = answers[self.draft.ask(span, "who is this?", [name for name, _ in answers]) if asked else 0][
            1
        ]
        if chosen:
            self.draft.references.append(phrase.span)
        else:
            self.draft.unread(span, "it is somebody who is not read", expressible=True)
        return chosen

    def _mentioned_again(self, phrase: Phrase, known: list[str], count: Part | None, span: Span) -> list[str]:
        """The groups of a name that the text has used before; a new one where that is not meant."""
        if count is not None and len(known) == 1 and known[0] in self.groups.counts.uncounted:
            # `aid workers ...; the 6 aid workers`.
            self.groups.counts.set_again(known[0], phrase, count, span)
        if not self._is_same(known, phrase, span):
            return [self.groups.add(phrase, self.groups.kinds[known[0]], span, count)]
        self.draft.references.append(phrase.span)
        groups = self.groups.choose_one(known, span)
        if count is not None and not self._is_number_of(groups, count):
            count.disown()
        return groups

    def _may_be(self, earlier: str, phrase: Phrase, count: Part) -> bool:
        """Whether a noun with a number can name a group from before: `a grandfather` is not `five anglers`."""
        named, noun = self.draft.entries["actors", earlier, "id"].span, phrase.first("ASSET")
        if (
            earlier in self.groups.counts.plural
            or named is None
            or noun is None
            or not isinstance(count.value, Quantity)
        ):
            return True
        same = _stem(self.draft.quote(named)) == _stem(self.draft.quote(noun.span))
        return same or count.value.high <= 1

    def _is_counted_now(self, earlier: str, phrase: Phrase) -> bool:
        """Whether a number belongs to a group that was named before without one."""
        named = self.draft.entries["actors", earlier, "id"].span
        noun = phrase.first("ASSET")
        same = (
            named is None
            or noun is None
            or _stem(self.draft.quote(named)) == _stem(self.draft.quote(noun.span))
        )
        if self.groups.counts.there_are(phrase.span) or (earlier in self.groups.counts.defined and same):
            return True
        readings = [f"the same as {earlier!r} before, whose number was not said", "others"]
        return self.draft.ask(phrase.span, "who is this?", readings) == 0

    def _is_same(self, known: Sequence[str], phrase: Phrase, span: Span) -> bool:
        """Whether a noun means a group that was named by another word.

        `our people` and `two hostages`, `the driver` and `twenty passengers` need not be the same.
        """
        before = self.draft.text[: span.start]
        one_of_many = (
            self.draft.quote(span).lower() not in GENERIC_PERSONS
            and not is_plural(self.draft, span)
            and all(group in self.groups.counts.plural for group in known)
            and not _OF_ANY.search(before)
        )
        if phrase.rule != "group" or phrase.has("COUNT") or not (one_of_many or _NOT_THE_SAME.search(before)):
            return True
        word = _stem(self.draft.quote(span))
        names = [entry.span for group in known if (entry := self.draft.entries.get(("actors", group, "id")))]
        if any(name is None or _stem(self.draft.quote(name)) == word for name in names):
            return True
        readings = [(f"the same as {known[0]!r} before", True), ("others", False)]
        if one_of_many:
            readings.reverse()
        return readings[self.draft.ask(span, "who is this?", [name for name, _ in readings])][1]

    def _contradicts(self, group: str, phrase: Phrase) -> bool:
        """Whether a noun names an asset that a group of the same vocabulary entry is not: `the women` are not `two men`."""
        words = self.groups.vocabulary.assets[self.groups.kinds[group]]
        exact = {
            asset
            for asset in (self.groups.asset(group), words.named_by(noun_of(self.draft, phrase)))
            if asset in words.kinds
        }
        return len(exact) > 1

    def _next_one(self, phrase: Phrase, name: str, nth: Part, known: Sequence[str]) -> list[str]:
        """`a third soldier`, where two were spoken of, is one more; nobody where the numbers do not fit."""
        counts = [self.groups.total(group) for group in self.groups.divided_of(known)]
        if sum(count or 0 for count in counts) + 1 != nth.value or None in counts:
            self.draft.unread(phrase.span, "the text does not tell which one", expressible=True)
            return []
        self.draft.used_words.append(phrase.span)
        one = Part("COUNT", Quantity("COUNT", 1.0, 1.0), phrase.span)
        return [self.groups.add(phrase, name, phrase.span, one)]

    def _is_number_of(self, groups: Sequence[str], count: Part) -> bool:
        """Whether a number repeats how many members a group has: `the two trucks`, where there are two."""
        counts = [self.draft.entries.get(("actors", group, "count")) for group in groups]
        assert isinstance(count.value, Quantity)
        if any(
            count.span == span.span or (span.span is not None and count.span.joined(span.span) == span.span)
            for span in counts
            if span
        ):
            return True
        ends = {
            varied.high
            for varied in self.draft.ranges
            for group in groups
            if f"actors[{group}].count" in varied.paths
        }
        if len(groups) > 1 and sorted(groups) in map(sorted, self.groups.families):
            fits = self.groups.total(groups[0]) == count.value.low
            if fits:
                self.draft.acknowledge(count.span)
            return fits
        same = [entry is not None and entry.value == count.value.low for entry in counts]
        fits = bool(same) and all(same) and (not ends or count.value.high in ends)
        if fits:
            self.draft.acknowledge(count.span)
        return fits

    def them_as_subject(self, span: Span) -> None:
        """Make the groups that a pronoun means the subject: `it` is one of a single member."""
        pronoun = self.draft.quote(span).lower()
        family = self.groups.family(self.groups.subject[-1]) if self.groups.subject else []
        if pronoun in ("they", "them", "these", "those") and len(family) > len(self.groups.subject):
            readings = [", ".join(family), ", ".join(self.groups.subject)]
            self.groups.subject = [family, self.groups.subject][
                self.draft.ask(span, "of whom is this said?", readings)
            ]
        several = [group for group in self.groups.kinds if group in self.groups.counts.plural]
        if (
            pronoun in ("they", "these", "those")
            and len(self.groups.subject) == 1
            and several
            and self.groups.subject[0] not in several
        ):
            # `a car for the men. They stand ...`: one car is no `they`.
            several.sort(key=lambda group: -self.groups.mentioned_at([group]).end)
            self.groups.subject = self.groups.choose_one([*several, *self.groups.subject], span)
        if pronoun in SINGULAR_PRONOUNS and self.groups.subject:
            self._choose_single(pronoun, span)
        if self.groups.subject and not self.groups.is_meant(self.groups.subject, span):
            self.groups.subject = []

    def _choose_single(self, pronoun: str, span: Span) -> None:
        """Make a group of one member the subject, where there is one that `it` may mean."""
        fitting = [
            group
            for group, name in self.groups.kinds.items()
            if group not in self.groups.counts.plural
            and (pronoun == "it" or self.groups.vocabulary.assets[name].asset in PERSONS)
        ]
        if fitting and self.groups.subject[-1] not in fitting:
            self.groups.subject = self.groups.choose_one(fitting, span)

    def introduce(self, phrase: Phrase) -> None:
        """Make the group that a phrase names the subject."""
        self.groups.subject_is_mission = False
        self.groups.subject = self.named(phrase)
        self.groups.in_sentence = bool(self.groups.subject)
        for group in self.groups.subject:
            self._adjectives(group, phrase)

    def _adjectives(self, group: str, phrase: Phrase) -> None:
        for part in phrase.every("CONCEAL"):
            self.draft.put(("actors", group, "concealment"), part.value, part.span)
        for part in phrase.every("MOVING"):
            put_motion(self.draft, group, part, None)
        for part in phrase.every("SOUGHT"):
            self.groups.seek(group, part.span)

    def ref(self, phrase: Phrase) -> list[RelationTarget]:
        """The targets of a relation: groups, the vehicle's home, or a place.

        The same words always resolve to the same targets.
        """
        ref = phrase.refs[0] if phrase.rule != "ref" else phrase
        # Resolving may ask a question or create a group, which must happen once for each phrase.
        if ref.span not in self.referents:
            targets = self._resolve(ref, indoors=phrase.rule == "inside")
            if (
                len(targets) > 1
                and sorted(map(str, targets)) in map(sorted, self.groups.families)
                and phrase.rule != "atleast"
            ):
                # A distance would be to the nearest member of either part, which a SimSpec cannot say.
                self.draft.unread(phrase.span, "the group is divided: say of which part", expressible=True)
                targets = []
            self.referents[ref.span] = targets
        return self.referents[ref.span]

    def groups_in(self, phrase: Phrase) -> list[str]:
        """The groups among the targets of a phrase."""
        return [
            target for target in self.ref(phrase) if isinstance(target, str) and target in self.groups.kinds
        ]

    def _resolve(self, ref: Phrase, *, indoors: bool) -> list[RelationTarget]:
        if point := ref.first("POINT"):
            assert isinstance(point.value, Coordinates)
            return [point.value]
        if ref.first("ORIGIN"):
            return [Coordinates(0.0, 0.0)]
        if us := ref.first("US"):
            self.draft.remark(us.span, "read as the start of the drone")
        if us or ref.first("HOME"):
            return [HOME]
        return [*self._resolve_groups(ref, indoors=indoors)]

    def _resolve_groups(self, ref: Phrase, *, indoors: bool) -> list[str]:
        for kind, resolve in (("CONVOY", self._convoy), ("TARGET", self._target)):
            if part := ref.first(kind):
                return resolve(part.span)
        if them := ref.first("THEM"):
            self._acknowledge_one_of(ref)
            return self.them(them.span, indoors=indoors)
        groups = self.named(ref)
        for group in groups:
            self._adjectives(group, ref)
        return groups

    def _acknowledge_one_of(self, ref: Phrase) -> None:
        """`inside one of them`: any member."""
        portion = ref.first("COUNT")
        if portion and isinstance(portion.value, Quantity) and portion.value.high == 1:
            self.draft.acknowledge(portion.span)

    def _convoy(self, span: Span) -> list[str]:
        if not self.groups.convoys:
            self.draft.unread(span, "the text does not say of what", expressible=True)
        return self.groups.choose_one(self.groups.convoys, span) if self.groups.convoys else []

    def _target(self, span: Span) -> list[str]:
        adversaries = [group for group in self.groups.targets() if group not in self.groups.subject]
        return self.groups.choose_one(adversaries, span) if adversaries else [self._new_target(span)]

    def them(self, span: Span, *, indoors: bool = False) -> list[str]:
        """The groups beside the subject that a pronoun means."""
        others = [group for group in self.groups.kinds if group not in self.groups.subject]
        # `it` means a group of one member, `them` one of several, where such groups exist.
        single = self.draft.quote(span).lower() in SINGULAR_PRONOUNS
        if indoors:
            others = [group for group in others if self.groups.asset(group) in ROOFED] or others
        fitting = [group for group in others if (group not in self.groups.counts.plural) == single] or others
        if not fitting:
            self.draft.unread(span, "nothing before it that it could refer to", expressible=True)
            return []
        # A group of the same sentence goes before all earlier ones.
        recent = [group for group in fitting if group in self.groups.mentioned]
        groups = recent if len(recent) == 1 else self.groups.choose_one(fitting, span)
        return groups if self.groups.is_meant(groups, span) else []

    def _new_target(self, span: Span) -> str:
        adversaries = [
            asset for asset, words in self.groups.vocabulary.assets.items() if words.role is Role.ADVERSARY
        ]
        chosen = self.draft.ask(
            span, "what is the target?", [self.groups.vocabulary.assets[words].asset for words in adversaries]
        )
        return self.groups.add(
            Phrase("ref", (), span),
            adversaries[chosen],
            span,
            Part("COUNT", Quantity("COUNT", 1.0, 1.0), span),
        )

    def of_bystanders(self, phrase: Phrase) -> bool:
        """Whether a rule is about bystanders. A word for bystanders creates no group here."""
        ref = phrase.refs[-1] if phrase.refs else phrase
        if part := ref.first("ASSET"):
            name = str(part.value)
            return self.groups.vocabulary.role(name) is Role.BYSTANDER
        if ref.first("THEM"):
            return bool(self.groups.subject) and all(
                self.groups.role(group) in PROTECTED_ROLES for group in self.groups.subject
            )
        return False


def _stem(noun: str) -> str:
    return noun.lower().split()[-1].removesuffix("s")
