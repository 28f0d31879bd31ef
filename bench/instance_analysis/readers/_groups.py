"""The groups of actors in a text: what each word refers to, and how many members a group has."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.simspec import HOME, PROTECTED_ROLES, Role

from .._draft import Draft, FieldPath
from ..language._coordinates import Coordinates
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span
from ..language._vocabulary import Meaning, Vocabulary
from ._traits import PERSONS, ROOFED, VEHICLES, put_motion
from ._unread_subjects import UnreadSubjects

PLURALS = frozenset(
    [
        "people", "persons", "men", "women", "children", "infantrymen", "gunmen", "insurgents", "troops",
        "civs", "pax", "civvies", "schoolchildren", "cattle", "sheep",
    ]
)  # fmt: skip
DEFINITE = ("the", "these", "those", "both", "all", "that", "this", "same", "said")
RelationTarget = str | Coordinates
"""Whom a relation is to: the id of a group, `home`, or a place."""
COLLECTIVES = frozenset(
    ["squad", "platoon", "section", "family", "team", "crew", "group", "class", "patrol", "party", "infantry"]
)
"""Whom `of nine` counts."""
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


_CONVOY_OF = re.compile(
    r"\b(?:convoy|cvy|column|motorcade)\b(?: of|,|:| with| consists of)?[^.;!?\n]{0,25}$", re.IGNORECASE
)
"""What makes the group after it a convoy."""


class GroupRegister:
    """The groups that a text has mentioned so far.

    `subject` holds the groups that the text is about now; `in_sentence` is true once the current sentence has
    named them.
    """

    def __init__(self, draft: Draft, vocabulary: Vocabulary, unread: UnreadSubjects) -> None:
        self.draft, self.vocabulary = draft, vocabulary
        self._unread = unread
        self._mentions: dict[str, Span] = {}
        """Where the text has last mentioned each group, by a name or a pronoun."""
        self.kinds: dict[str, str] = {}
        """Ids of the groups, and the vocabulary's name of each."""
        self.plural: set[str] = set()
        self.subject: list[str] = []
        self.in_sentence = False
        self.subject_is_mission = False
        self.absent: dict[str, Span] = {}
        """Assets of which the text says that there are none."""
        self._uncounted: set[str] = set()
        """Groups of which it is not said how many there are."""
        self._vague: set[str] = set()
        """Groups of which it is said that there are `some` or `lots`."""
        self._defined: set[str] = set()
        """Groups that began with `the`: whoever counts them later means them."""
        self.mentioned: list[str] = []
        """The groups that this sentence has named; `it` is one of these before it is one of another
        sentence.
        """

        self.mentioned_before: list[str] = []
        """The groups that the last sentence with groups has named."""
        self.referents: dict[Span, list[RelationTarget]] = {}
        self.families: list[list[str]] = []
        """Groups that are parts of one: what is left, and its shares."""
        self.convoys: list[str] = []
        """Groups of which the text says that they are a convoy."""
        self.divided: str | None = None
        """What is left of the group that was divided last."""

    def asset(self, group: str) -> str:
        return str(self.draft.entries["actors", group, "asset"].value)

    def role(self, group: str) -> Role:
        return Role(self.draft.entries["actors", group, "role"].value)

    def targets(self) -> list[str]:
        """The groups that are to be found: adversaries, or else whoever is sought."""
        roles = {group: self.role(group) for group in self.kinds}
        adversaries = [group for group, role in roles.items() if role is Role.ADVERSARY]
        return adversaries or [group for group, role in roles.items() if role is Role.SOUGHT]

    def seek(self, group: str, span: Span) -> None:
        """Make a group of persons the one that is sought."""
        if self.role(group) is Role.ADVERSARY and self.draft.quote(span).lower().endswith("found"):
            # `the truck has to be found`: every adversary has.
            self.draft.acknowledge(span)
            return
        if self.asset(group) not in PERSONS:
            self.draft.unread(span, f"no {self.kinds[group]} is sought: only persons are", expressible=True)
            return
        path: FieldPath = ("actors", group, "role")
        self.draft.forget(path)
        self.draft.put(path, str(Role.SOUGHT), span)

    def choose_one(self, ids: list[str], span: Span) -> list[str]:
        if len(ids) == 1 or sorted(ids) in map(sorted, self.families):
            return ids
        chosen = self.draft.ask(
            span, f"which group is meant by {self.draft.quote(span)!r}?", [*ids, "all of them"]
        )
        return ids if chosen == len(ids) else [ids[chosen]]

    def _thing(self, phrase: Phrase) -> tuple[str, Span]:
        if part := phrase.first("ASSET"):
            return str(part.value), part.span
        part = phrase.first("AMBIGUOUS")
        assert part is not None
        assert isinstance(part.value, tuple)
        quote = self.draft.quote(part.span)
        # `a truck ...; the vehicle` means the truck, because only one of the word's readings was mentioned.
        known = [name for name in part.value if name in self.kinds.values()]
        if len(known) == 1 and self._definite(part.span):
            return known[0], part.span
        readings = [
            f"{self.vocabulary.assets[candidate].asset} ({self.vocabulary.assets[candidate].role})"
            for candidate in part.value
        ]
        if self._definite(part.span):
            # `the vehicle` may also be the drone.
            readings.append("the drone under test")
        chosen = self.draft.ask(part.span, f"what is meant by {quote!r}?", readings)
        return (str(part.value[chosen]) if chosen < len(part.value) else ""), part.span

    def _definite(self, span: Span) -> bool:
        before = self.draft.text[: span.start].rstrip().lower().split()
        return bool(before) and before[-1].strip(",;:(") in DEFINITE

    def _is_plural(self, span: Span) -> bool:
        last = self.draft.quote(span).lower().split()[-1]
        return last in PLURALS or (last.endswith("s") and not last.endswith(("ss", "us")))

    def named(self, phrase: Phrase) -> list[str]:
        """The group or groups that a phrase names: known ones, or a new one."""
        groups = self._groups_named(phrase)
        self.mentioned += groups
        self.mention(groups, phrase.span)
        return groups

    def mention(self, groups: Sequence[str], span: Span) -> None:
        """Note where the text speaks of groups."""
        self._mentions |= dict.fromkeys(groups, span)

    def mentioned_at(self, groups: Sequence[str]) -> Span:
        """Where the text has last spoken of one of the groups; its beginning where it has not."""
        spans = (self._mentions.get(group, Span(0, 0)) for group in groups)
        return max(spans, key=lambda span: span.end, default=Span(0, 0))

    def is_meant(self, groups: Sequence[str], pronoun: Span) -> bool:
        """Whether a pronoun means groups, although the text has spoken of something unread after them."""
        if self._unread.since(self.mentioned_at(groups).end, pronoun.start) is None:
            self.mention(groups, pronoun)
            return True
        readings = [", ".join(groups), "what is not read: leave it out"]
        if self.draft.ask(pronoun, f"who is {self.draft.quote(pronoun)!r}?", readings) == 0:
            self.mention(groups, pronoun)
            return True
        self.draft.unread(pronoun, "it is something that is not read", expressible=True)
        return False

    def _groups_named(self, phrase: Phrase) -> list[str]:
        name, span = self._thing(phrase)
        if not name:
            self.subject_is_mission = True
            return []
        count, none = self._number_in(phrase), phrase.first("NONE")
        known = [
            group
            for group, asset in self.kinds.items()
            if asset == name and not self._contradicts(group, phrase)
        ]
        if phrase.has("SOUGHT"):
            known = [group for group in known if self.role(group) is Role.SOUGHT]
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
        if known and not none and not dense and (count is None or self._definite(phrase.span)):
            return self._mentioned_again(phrase, known, count, span)
        some_member = phrase.rule == "ref" and count and self.draft.quote(count.span).lower() in _ONE
        if some_member and (several := [group for group in known if group in self.plural]):
            # `near a crate`, where the text has crates, means near some member of that group.
            assert count is not None
            self.draft.acknowledge(count.span)
            phrase.every("ATLEAST")
            return self.choose_one(several, span)
        if none or (count and isinstance(count.value, Quantity) and count.value.high == 0):
            self._absent(phrase, name)
            return []
        return [self._counted(phrase, name, known, count, span)]

    def _counted(
        self, phrase: Phrase, name: str, known: Sequence[str], count: Part | None, span: Span
    ) -> str:
        """A new group, or one that was named before without the number that it gets now."""
        if phrase.rule == "group" and count and phrase.first("PERAREA") is None:
            earlier = self._not_counted(known, there=self._there_are(phrase.span))
            if earlier and self._may_be(earlier, phrase, count) and self._is_counted_now(earlier, phrase):
                self._recount(earlier, phrase, count, span)
                return earlier
        return self._new(phrase, name, span, count)

    def _persons_meant(self, phrase: Phrase, span: Span) -> list[str] | None:
        """Whom `the men` means, where it may be several groups of persons or somebody unread; None where it is plain."""
        if (
            phrase.rule != "group"
            or self.draft.quote(span).lower() not in _ANYBODY
            or not self._definite(span)
        ):
            return None
        several = self._is_plural(span)
        fitting = [
            group
            for group in self.kinds
            if self.asset(group) in PERSONS and (group in self.plural) == several
        ]
        fitting.sort(key=lambda group: -self._mentions.get(group, Span(0, 0)).end)
        # The noun of an unknown word may be theirs: `two smugglers load a car; the men are our targets`.
        begin = self.mentioned_at(fitting).end
        stranger = self._unread.since(begin, span.start, subjects=True) is not None
        known = any(self.kinds[group] == "civilian" for group in fitting)
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
        if count is not None and len(known) == 1 and known[0] in self._uncounted:
            # `aid workers ...; the 6 aid workers`.
            self._recount(known[0], phrase, count, span)
        if not self._is_same(known, phrase, span):
            return [self._new(phrase, self.kinds[known[0]], span, count)]
        self.draft.references.append(phrase.span)
        groups = self.choose_one(known, span)
        if count is not None and not self._is_number_of(groups, count):
            count.disown()
        return groups

    def _may_be(self, earlier: str, phrase: Phrase, count: Part) -> bool:
        """Whether a noun with a number can name a group from before: `a grandfather` is not `five anglers`."""
        named, noun = self.draft.entries["actors", earlier, "id"].span, phrase.first("ASSET")
        if earlier in self.plural or named is None or noun is None or not isinstance(count.value, Quantity):
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
        if self._there_are(phrase.span) or (earlier in self._defined and same):
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
            and not self._is_plural(span)
            and all(group in self.plural for group in known)
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
        words = self.vocabulary.assets[self.kinds[group]]
        exact = {
            asset for asset in (self.asset(group), words.named_by(self._noun(phrase))) if asset in words.kinds
        }
        return len(exact) > 1

    def _noun(self, phrase: Phrase) -> str:
        asset = phrase.first("ASSET")
        return self.draft.quote(asset.span) if asset else ""

    def _number_in(self, phrase: Phrase) -> Part | None:
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
        for part in counts[:-1]:
            # Only the last number is used, and `two squads of nine` are not nine.
            part.disown()
        return counts[-1] if counts else None

    def _next_one(self, phrase: Phrase, name: str, nth: Part, known: Sequence[str]) -> list[str]:
        """`a third soldier`, where two were spoken of, is one more; nobody where the numbers do not fit."""
        counts = [self.total(group) for group in self.divided_of(known)]
        if sum(count or 0 for count in counts) + 1 != nth.value or None in counts:
            self.draft.unread(phrase.span, "the text does not tell which one", expressible=True)
            return []
        self.draft.used_words.append(phrase.span)
        one = Part("COUNT", Quantity("COUNT", 1.0, 1.0), phrase.span)
        return [self._new(phrase, name, phrase.span, one)]

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
        if len(groups) > 1 and sorted(groups) in map(sorted, self.families):
            fits = self.total(groups[0]) == count.value.low
            if fits:
                self.draft.acknowledge(count.span)
            return fits
        same = [entry is not None and entry.value == count.value.low for entry in counts]
        fits = bool(same) and all(same) and (not ends or count.value.high in ends)
        if fits:
            self.draft.acknowledge(count.span)
        return fits

    def _absent(self, phrase: Phrase, name: str) -> None:
        """`no civilians`: read where the text has none, which needs no field; else it contradicts the text."""
        if name not in self.kinds.values():
            self.draft.acknowledge(phrase.span)
            self.absent[name] = phrase.span
            return
        for part in phrase.leaves:
            part.disown()

    def _there_are(self, span: Span) -> bool:
        """Whether the sentence only gives a number: `there are four houses and ten trees`."""
        return (
            re.search(r"\bthere (are|were|is|was|will be)\b[^.;\n]*$", self.draft.text[: span.start].lower())
            is not None
        )

    def _not_counted(self, known: Sequence[str], *, there: bool) -> str | None:
        """The single group of these that has no number yet; None when there is none or more than one."""
        countable = self.plural | self._defined | (set(known) if there else set())
        uncounted = [group for group in known if group in self._uncounted and group in countable]
        return uncounted[0] if len(uncounted) == 1 else None

    def _recount(self, group: str, phrase: Phrase, count: Part, span: Span) -> None:
        self.draft.forget(("actors", group, "count"))
        self._count(group, phrase, count, span)

    def _new(self, phrase: Phrase, name: str, span: Span, count: Part | None) -> str:
        words = self.vocabulary.assets[name]
        if name in self.absent:
            self.draft.remark(span, f"the text also says {self.draft.quote(self.absent[name])!r}")
        number = 1 + sum(1 for other in self.kinds.values() if other == name)
        # Ids are the words of the vocabulary, so that a reader recognizes the groups in the SimSpec.
        group = name if number == 1 else f"{name}-{number}"
        self.kinds[group] = name
        if _CONVOY_OF.search(self.draft.text[: span.start]):
            self.convoys.append(group)
        put = self.draft.put
        put(("actors", group, "id"), group, span)
        put(("actors", group, "asset"), words.named_by(self._noun(phrase)), span)
        put(("actors", group, "role"), str(words.role), span)
        if phrase.rule == "group" and (per := phrase.first("PERAREA")):
            if count is None:
                self.draft.fault(phrase.span, "gives `per area` without a number", "write a number before it")
                return group
            self.density_of(group, count, per, phrase.span)
            self.plural.add(group)
            return group
        self._count(group, phrase, count, span)
        return group

    def family(self, group: str) -> list[str]:
        """All parts of the group that a group is a part of; itself alone when nothing was divided."""
        return next((family for family in self.families if group in family), [group])

    def divided_of(self, groups: Sequence[str]) -> list[str]:
        """The groups, with what is left of a divided one in the place of its parts."""
        return list(dict.fromkeys(self.family(group)[0] for group in groups))

    def total(self, group: str) -> int | None:
        """Number of members of a group with all parts of it; None where it is not one stated number."""
        paths = [("actors", part, "count") for part in self.family(group)]
        varied = {path for one in self.draft.ranges for path in one.paths}
        counts = [self.draft.entries.get(path) for path in paths]
        if any(count is None for count in counts) or f"actors[{group}].count" in varied:
            return None
        return sum(int(count.value) for count in counts if count is not None)

    def is_referred_to(self, group: str) -> bool:
        """Whether another group stands by this one, so that it cannot be divided."""
        return any(
            path[0] == "actors"
            and path[1] != group
            and path[-1] in ("of", "first", "second")
            and entry.value == group
            for path, entry in self.draft.entries.items()
        )

    def divide(self, group: str, number: int, phrase: Phrase) -> str:
        """Take a number of members out of a group, as a group with all that was said of it so far."""
        path: FieldPath = ("actors", group, "count")
        before = self.draft.entries[path]
        # `two of them children`, `two of the residents are children`.
        assets = phrase.every("ASSET")
        asset = assets[-1] if assets and (len(assets) > 1 or phrase.has("THEM", "OFTHEM")) else None
        name = self.kinds[group] if asset is None else str(asset.value)
        part = self._new(
            Phrase("ref", (), phrase.span),
            name,
            phrase.span,
            Part("COUNT", Quantity("COUNT", number, number), phrase.span),
        )
        self.draft.forget(("actors", part, "asset"))
        if asset is not None:
            exact = self.vocabulary.assets[name].named_by(self.draft.quote(asset.span))
            self.draft.put(("actors", part, "asset"), exact, asset.span)
        for field, entry in list(self.draft.entries.items()):
            if field[:2] == path[:2] and field[2] not in (
                "id",
                "count",
                *(["role", "asset"] if asset else []),
            ):
                self.draft.put(("actors", part, *field[2:]), entry.value, entry.span, entry.note)
        self.draft.forget(path)
        self.draft.put(path, before.value - number, phrase.span)
        for span in filter(None, (before.span, phrase.span)):
            self.draft.acknowledge(span)
        family = self.family(group)
        if family not in self.families:
            self.families.append(family)
        family.append(part)
        self.divided = group
        return part

    def _said_of(self, group: str) -> dict[FieldPath, object]:
        fields = self.draft.entries.items()
        return {
            path[2:]: entry.value
            for path, entry in fields
            if path[:2] == ("actors", group) and path[2] not in ("id", "count")
        }

    def count_later(self, group: str, quantity: Quantity, span: Span, *, vague: bool = False) -> bool:
        """Set the number of members of a group that has none yet, or with `vague` only `some`. False when it has one."""
        path: FieldPath = ("actors", group, "count")
        entry = self.draft.entries.get(path)
        open_number = group in self._uncounted or (vague and group in self._vague)
        if entry is None or not open_number or quantity.low != int(quantity.low):
            return False
        self._vague.discard(group)
        self._uncounted.discard(group)
        self.draft.forget(path)
        self.draft.vary(path, quantity.low, quantity.high, span, unit=None, integer=True)
        if quantity.high > 1:
            self.plural.add(group)
        return True

    def _count(self, group: str, phrase: Phrase, count: Part | None, span: Span) -> None:
        path: FieldPath = ("actors", group, "count")
        self._uncounted.discard(group)
        if count is None or not isinstance(count.value, Quantity):
            self._uncounted.add(group)
            if self._definite(span):
                self._defined.add(group)
            if self._is_plural(span):
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

    def finish(self) -> None:
        """Ask whether a thing stands in the scene that has no article and no number, or has `the`.

        `missing person search` and `the customer` place nobody.
        """
        for part in [part for family in self.families for part in family[1:]]:
            if self._said_of(part) == self._said_of(self.family(part)[0]):
                span = self.draft.entries["actors", part, "id"].span
                assert span is not None
                self.draft.fault(span, "nothing is said of this part of the group", "say what is different")
        for group in [group for group in self.kinds if self._is_driven(group)]:
            named = self.draft.entries["actors", group, "id"].span
            assert named is not None
            self.draft.forget(("actors", group, "role"))
            self.draft.put(("actors", group, "role"), str(Role.BYSTANDER), named)
            self.draft.remark(named, "people drive it: its role is bystander")
        for group in sorted(self._uncounted - self.plural):
            entry = self.draft.entries.get(("actors", group, "id"))
            if entry is None or entry.span is None:
                continue
            question = f"does {self.draft.quote(entry.span)!r} stand in the scene?"
            if self.draft.ask(entry.span, question, ["yes, one", "no, it is only spoken of"]) == 1:
                self.draft.fault(entry.span, "it is only spoken of", "as you chose")

    def them_as_subject(self, span: Span) -> None:
        """Make the groups that a pronoun means the subject: `it` is one of a single member."""
        pronoun = self.draft.quote(span).lower()
        family = self.family(self.subject[-1]) if self.subject else []
        if pronoun in ("they", "them", "these", "those") and len(family) > len(self.subject):
            readings = [", ".join(family), ", ".join(self.subject)]
            self.subject = [family, self.subject][self.draft.ask(span, "of whom is this said?", readings)]
        several = [group for group in self.kinds if group in self.plural]
        if (
            pronoun in ("they", "these", "those")
            and len(self.subject) == 1
            and several
            and self.subject[0] not in several
        ):
            # `a car for the men. They stand ...`: one car is no `they`.
            several.sort(key=lambda group: -self._mentions.get(group, Span(0, 0)).end)
            self.subject = self.choose_one([*several, *self.subject], span)
        if pronoun in SINGULAR_PRONOUNS and self.subject:
            self._choose_single(pronoun, span)
        if self.subject and not self.is_meant(self.subject, span):
            self.subject = []

    def _choose_single(self, pronoun: str, span: Span) -> None:
        """Make a group of one member the subject, where there is one that `it` may mean."""
        fitting = [
            group
            for group, name in self.kinds.items()
            if group not in self.plural and (pronoun == "it" or self.vocabulary.assets[name].asset in PERSONS)
        ]
        if fitting and self.subject[-1] not in fitting:
            self.subject = self.choose_one(fitting, span)

    def _is_driven(self, group: str) -> bool:
        """Whether a group is of civilian vehicles that move, so that there are people in them."""
        kind = self.draft.entries.get(("actors", group, "motion", "kind"))
        moves = kind is not None and kind.value != "still"
        return moves and self.asset(group) in VEHICLES and self.role(group) is Role.CLUTTER

    def _vague_range(self) -> tuple[int, int]:
        meaning = next(
            (m for m in self.vocabulary.meanings.get("some", ()) if m.kind == "VAGUE"),
            Meaning("VAGUE", (2, 10)),
        )
        assert isinstance(meaning.value, tuple)
        return int(meaning.value[0]), int(meaning.value[1])

    def density_of(self, group: str, count: Part, per: Part, span: Span) -> None:
        assert isinstance(count.value, Quantity)
        assert isinstance(per.value, float | int)
        self.draft.entries.pop(("actors", group, "count"), None)
        self.draft.ranges = [
            varied for varied in self.draft.ranges if f"actors[{group}].count" not in varied.paths
        ]
        low, high = count.value.low * per.value, count.value.high * per.value
        self.draft.vary(("actors", group, "density_per_km2"), low, high, span, unit="1/km2")

    def make_subject(self, groups: Sequence[str]) -> None:
        """Make groups that are known the subject."""
        self.subject, self.in_sentence, self.subject_is_mission = [*groups], True, False

    def introduce(self, phrase: Phrase) -> None:
        """Make the group that a phrase names the subject."""
        self.subject_is_mission = False
        self.subject = self.named(phrase)
        self.in_sentence = bool(self.subject)
        for group in self.subject:
            self._adjectives(group, phrase)

    def _adjectives(self, group: str, phrase: Phrase) -> None:
        for part in phrase.every("CONCEAL"):
            self.draft.put(("actors", group, "concealment"), part.value, part.span)
        for part in phrase.every("MOVING"):
            put_motion(self.draft, group, part, None)
        for part in phrase.every("SOUGHT"):
            self.seek(group, part.span)

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
                and sorted(map(str, targets)) in map(sorted, self.families)
                and phrase.rule != "atleast"
            ):
                # A distance would be to the nearest member of either part, which a SimSpec cannot say.
                self.draft.unread(phrase.span, "the group is divided: say of which part", expressible=True)
                targets = []
            self.referents[ref.span] = targets
        return self.referents[ref.span]

    def groups_in(self, phrase: Phrase) -> list[str]:
        """The groups among the targets of a phrase."""
        return [target for target in self.ref(phrase) if isinstance(target, str) and target in self.kinds]

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
        if not self.convoys:
            self.draft.unread(span, "the text does not say of what", expressible=True)
        return self.choose_one(self.convoys, span) if self.convoys else []

    def _target(self, span: Span) -> list[str]:
        adversaries = [group for group in self.targets() if group not in self.subject]
        return self.choose_one(adversaries, span) if adversaries else [self._new_target(span)]

    def them(self, span: Span, *, indoors: bool = False) -> list[str]:
        """The groups beside the subject that a pronoun means."""
        others = [group for group in self.kinds if group not in self.subject]
        # `it` means a group of one member, `them` one of several, where such groups exist.
        single = self.draft.quote(span).lower() in SINGULAR_PRONOUNS
        if indoors:
            others = [group for group in others if self.asset(group) in ROOFED] or others
        fitting = [group for group in others if (group not in self.plural) == single] or others
        if not fitting:
            self.draft.unread(span, "nothing before it that it could refer to", expressible=True)
            return []
        # A group of the same sentence goes before all earlier ones.
        recent = [group for group in fitting if group in self.mentioned]
        groups = recent if len(recent) == 1 else self.choose_one(fitting, span)
        return groups if self.is_meant(groups, span) else []

    def _new_target(self, span: Span) -> str:
        adversaries = [
            asset for asset, words in self.vocabulary.assets.items() if words.role is Role.ADVERSARY
        ]
        chosen = self.draft.ask(
            span, "what is the target?", [self.vocabulary.assets[words].asset for words in adversaries]
        )
        return self._new(
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
            return self.vocabulary.role(name) is Role.BYSTANDER
        if ref.first("THEM"):
            return bool(self.subject) and all(self.role(group) in PROTECTED_ROLES for group in self.subject)
        return False


def _stem(noun: str) -> str:
    return noun.lower().split()[-1].removesuffix("s")


def _range_of(phrase: Phrase, counts: Sequence[Part]) -> Part:
    """The number of `not less than 5 and not more than 9 civilians`."""
    least, most = (part.value for part in (counts[0], counts[-1]))
    assert isinstance(least, Quantity)
    assert isinstance(most, Quantity)
    return Part("COUNT", Quantity("COUNT", least.low, most.high), counts[0].span.joined(counts[-1].span))
