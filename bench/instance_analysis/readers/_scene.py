"""Whom each noun phrase of a text names, and the parts that a group is divided into."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.simspec import ASSETS, HOME, Role

from .._draft import Draft
from ..language._coordinates import Coordinates
from ..language._phrases import HOME_PLACE, NounPhrase
from ..language._quantities import Quantity
from ..language._tokens import Span
from ..language._vocabulary import Vocabulary
from ._groups import IMMOVABLE, PERSONS, VEHICLES, Groups
from ._not_read import NotReadError

RelationTarget = str | Coordinates
"""Whom a relation is to: the id of a group, `home`, or a place."""


class Scene(Groups):
    """Whom the phrases of a text name."""

    def __init__(self, draft: Draft, vocabulary: Vocabulary) -> None:
        super().__init__(draft, vocabulary)
        self.subject: list[str] = []
        """Whom the last statement was about."""
        self.unread = -1
        """Number of the last sentence that holds something unread, of which a pronoun may speak."""
        self.families: list[list[str]] = []
        """Groups that are parts of one: what is left, and its shares."""
        self.absent: dict[str, Span] = {}
        """Entries of which the text says that there are none."""

    # Whom a phrase names.

    def subjects(self, phrase: NounPhrase) -> list[str]:
        """The groups that a phrase at the place of the subject names, a new one where it introduces one."""
        groups = self._named(phrase, others=[])
        for group in groups:
            self.groups[group].mentioned = self.sentence
            self.describe(group, phrase)
        return groups

    def references(
        self, target: NounPhrase | Coordinates, subject: Sequence[str] = ()
    ) -> list[RelationTarget]:
        """Whom or what a relation is to; `subject` is whom it is said of."""
        if isinstance(target, Coordinates):
            return [HOME] if target == HOME_PLACE else [target]
        return [*self.named_once(target, subject)]

    def named_once(self, phrase: NounPhrase, subject: Sequence[str] = ()) -> list[str]:
        """The groups that a phrase outside of the subject names."""
        some_member = phrase.portion is not None and phrase.portion.high == 1
        if some_member:
            phrase = NounPhrase(
                phrase.span, phrase.noun, phrase.entries, definite=True, pronoun=phrase.pronoun
            )
        groups = self._again_or_new(phrase, subject) or self._named(phrase, others=subject)
        for group in groups:
            self.groups[group].mentioned = self.sentence
            if not phrase.definite:
                self.describe(group, phrase)
        return groups

    def _again_or_new(self, phrase: NounPhrase, subject: Sequence[str]) -> list[str]:
        """`Two houses. A soldier within 20 m of a house`: one of those that the text has named, or another one."""
        if not phrase.article or phrase.definite or phrase.target or not phrase.entries:
            return []
        known = [group for group in self._known(phrase) if group not in subject]
        if not known:
            return []
        question = f"is {self.draft.quote(phrase.span)!r} one that the text has named before?"
        chosen = self.draft.ask(phrase.span, question, [*known, "no, another one"])
        return known[chosen : chosen + 1]

    def single_group(self, phrase: NounPhrase) -> str:
        """The single group that a phrase names."""
        groups = self.named_once(phrase)
        if len(groups) != 1:
            raise NotReadError("it is about one group, and the text does not say which")
        return groups[0]

    def _named(self, phrase: NounPhrase, others: Sequence[str]) -> list[str]:
        if phrase.rest:
            return [self._rest(phrase)]
        if phrase.portion is not None:
            return [self._share(phrase, phrase.portion)]
        if phrase.pronoun:
            return self._meant(phrase, others)
        if phrase.convoy and phrase.definite:
            return self._chosen(self.convoys(), phrase.span, "the text names no convoy")
        if phrase.target:
            return self._target(phrase)
        return self._by_noun(phrase)

    def _by_noun(self, phrase: NounPhrase) -> list[str]:
        """The groups that a noun names, or the new one that it introduces."""
        known = self._known(phrase) if phrase.definite else []
        if known:
            return self._again(phrase, known)
        if phrase.definite and phrase.plural and phrase.count is None:
            raise NotReadError(f"the text has named no {phrase.noun} before: say how many there are")
        if phrase.none:
            self._note_absent(phrase)
            return []
        self._note_repeated(phrase)
        return [self._new(phrase)]

    def _known(self, phrase: NounPhrase) -> list[str]:
        """The groups that have been named by the noun of a phrase."""
        exact = {self._exact(entry, phrase.noun) for entry in phrase.entries} - {""}
        roles = {value for name, value in phrase.adjectives if name == "role"}
        return [
            name
            for name, group in self.groups.items()
            if group.entry in phrase.entries
            and (not exact or self.asset(name) in exact)
            and (not roles or self.role(name) in roles)
        ]

    def _exact(self, entry: str, noun: str) -> str:
        """The asset that a noun names more exactly than its entry does."""
        words = self.vocabulary.assets[entry]
        return words.named_by(noun) if words.named_by(noun) != words.asset else ""

    def _again(self, phrase: NounPhrase, known: list[str]) -> list[str]:
        """Groups that the text has named before; a number must be theirs."""
        if phrase.count is not None:
            return self._again_so_many(phrase.count.low, phrase.span, known)
        chosen = self._chosen(known, phrase.span)
        if not phrase.plural and self.groups[chosen[0]].plural:
            self.draft.remark(phrase.span, f"read as all of {', '.join(chosen)}, which are several")
        return chosen

    def _again_so_many(self, count: float, span: Span, known: list[str]) -> list[str]:
        """One of the known groups that has this number, or all of them where they have it together."""
        fitting = [group for group in known if self.count(group) == count]
        if not fitting and sum(self.count(group) or 0 for group in known) == count:
            return known
        if not fitting:
            raise NotReadError(f"the text names no group of {count:g} before")
        return self._chosen(fitting, span)

    def _chosen(self, groups: list[str], span: Span, why: str = "it is nobody") -> list[str]:
        """One of some groups, or all of them; a family is one."""
        if not groups:
            raise NotReadError(why)
        if len(groups) == 1 or sorted(groups) in map(sorted, self.families):
            return groups
        question = f"which group is meant by {self.draft.quote(span)!r}?"
        chosen = self.draft.ask(span, question, [*groups, "all of them"])
        return groups if chosen == len(groups) else [groups[chosen]]

    def _meant(self, phrase: NounPhrase, others: Sequence[str]) -> list[str]:
        """The groups that a pronoun means: those of the last sentence that names any, but never past something unread."""
        if not others and self._is_subject(phrase):
            return self.subject
        mentioned = {name: group.mentioned for name, group in self.groups.items() if name not in others}
        fitting = [name for name in mentioned if self._fits([name], phrase)]
        last = max((mentioned[name] for name in fitting), default=-1)
        if last <= self.unread:
            quote = self.draft.quote(phrase.span)
            raise NotReadError(f"{quote!r} may be something that is not read, or that is not named")
        recent = [name for name in fitting if mentioned[name] == last]
        # `Four fishermen. A car is parked. They stand ...`
        choose = self._doubtful if last < max(mentioned.values()) else self._chosen
        return choose(recent, phrase.span)

    def _doubtful(self, groups: list[str], span: Span) -> list[str]:
        """Groups that a pronoun may mean although another one was named after them."""
        chosen = self.draft.ask(
            span, f"who is {self.draft.quote(span)!r}?", [*groups, "nobody: leave it out"]
        )
        if chosen == len(groups):
            raise NotReadError("it is said of nobody")
        return [groups[chosen]]

    def _fits(self, groups: Sequence[str], phrase: NounPhrase) -> bool:
        plural = len(groups) > 1 or self.groups[groups[0]].plural
        person = phrase.pronoun not in ("he", "she", "him", "her") or self.asset(groups[0]) in PERSONS
        return plural == phrase.plural and person

    def _is_subject(self, phrase: NounPhrase) -> bool:
        """Whether a pronoun means whom the last statement was about, with nothing unread since."""
        fresh = all(self.groups[group].mentioned > self.unread for group in self.subject)
        return bool(self.subject) and fresh and self._fits(self.subject, phrase)

    def _target(self, phrase: NounPhrase) -> list[str]:
        """`the target`: whoever is to be found; `a target`: a new adversary, of which kind is asked."""
        targets = self.targets()
        if targets and (phrase.definite or phrase.article):
            return self._chosen(targets, phrase.span)
        if phrase.definite:
            raise NotReadError("nobody in the scene is an adversary or sought")
        entries = [name for name, words in self.vocabulary.assets.items() if words.role is Role.ADVERSARY]
        readings = [self.vocabulary.assets[name].asset for name in entries]
        chosen = entries[self.draft.ask(phrase.span, "what is the target?", readings)]
        return [self.add(chosen, phrase, self.vocabulary.assets[chosen].asset)]

    # New groups.

    def _note_absent(self, phrase: NounPhrase) -> None:
        """`no civilians`: true of a text that names none; of one that does it is a contradiction."""
        self.draft.acknowledge(phrase.span)
        self.absent |= dict.fromkeys(phrase.entries, phrase.span)

    def _note_repeated(self, phrase: NounPhrase) -> None:
        """`Five civilians. Two civilians walk`: they are others, although many who write so mean two of the five."""
        if phrase.count is None or not phrase.count.single:
            return
        larger = [
            group
            for group in self._known(phrase)
            if (count := self.count(group)) is None or count > phrase.count.low
        ]
        if larger:
            self.draft.remark(
                phrase.span, f"read as others than {', '.join(larger)}: `of them` would mean some of those"
            )

    def _new(self, phrase: NounPhrase) -> str:
        entry, asset = self._kind(phrase)
        return self.add(entry, phrase, asset)

    def _kind(self, phrase: NounPhrase) -> tuple[str, str]:
        """Entry and asset of a new group; asked where the noun is ambiguous or unknown."""
        if phrase.size_m:
            return self._by_size(phrase)
        entries = phrase.entries
        if len(entries) > 1:
            assets = self.vocabulary.assets
            readings = [f"{assets[name].asset} ({assets[name].role})" for name in entries]
            chosen = self.draft.ask(phrase.span, f"what is meant by {phrase.noun!r}?", readings)
            entries = (entries[chosen],)
        return entries[0], self.vocabulary.assets[entries[0]].named_by(phrase.noun)

    def _by_size(self, phrase: NounPhrase) -> tuple[str, str]:
        """The things of the catalogue that are nearest in size to one that it does not have."""
        wanted = [*sorted(phrase.size_m[:2], reverse=True), phrase.size_m[2]]
        lifeless = [name for name in ASSETS if name in IMMOVABLE | VEHICLES]

        def difference(name: str) -> float:
            asset = ASSETS[name]
            sizes = (asset.length_m, asset.width_m, asset.height_m)
            return sum(abs(math.log(size / want)) for size, want in zip(sizes, wanted, strict=True))

        nearest = sorted(lifeless, key=difference)[:3]
        readings = [f"{name}, {ASSETS[name].length_m:g} by {ASSETS[name].width_m:g} by {ASSETS[name].height_m:g} m" for name in nearest]  # fmt: skip
        question = f"the catalogue has no {phrase.noun!r}; which of its things is nearest?"
        asset = nearest[self.draft.ask(phrase.span, question, readings)]
        return next(name for name, words in self.vocabulary.assets.items() if words.asset == asset), asset

    # Parts of groups.

    def _whole(self, phrase: NounPhrase) -> str:
        """The group that a share is of."""
        if phrase.pronoun:
            last = max((group.mentioned for group in self.groups.values()), default=-1)
            known = [name for name, group in self.groups.items() if group.mentioned == last and group.plural]
            known = [group for group in self.subject if group in known] or known
        else:
            known = self._known(phrase)
        wholes = list(dict.fromkeys(self.family(group)[0] for group in known))
        if len(wholes) != 1 or self.groups[wholes[0]].mentioned <= self.unread:
            raise NotReadError("the text does not say of which group")
        return wholes[0]

    def family(self, group: str) -> list[str]:
        """All parts of the group that a group is a part of; itself alone when nothing was divided."""
        return next((family for family in self.families if group in family), [group])

    def _share(self, phrase: NounPhrase, portion: Quantity) -> str:
        """A part of a group as a group of its own, with all that was said of the whole so far."""
        whole = self._whole(phrase)
        counts = [count for part in self.family(whole) if (count := self.count(part)) is not None]
        if len(counts) < len(self.family(whole)):
            raise NotReadError("it is a part of a group without one stated number")
        exact = portion.low * sum(counts) if portion.kind == "PERCENT" else portion.low
        number = round(exact)
        if not portion.single or abs(exact - number) > 1e-6 or not 0 < number <= counts[0]:
            raise NotReadError("it is no part of a stated number")
        return whole if number == counts[0] else self._divided(whole, number, phrase)

    def _divided(self, whole: str, number: int, phrase: NounPhrase) -> str:
        if self._is_referred_to(whole):
            raise NotReadError("another group stands by its place")
        before = {path: entry for path, entry in self.draft.entries.items() if path[:2] == ("actors", whole)}
        count = Quantity("COUNT", number, number)
        part = self.add(self.groups[whole].entry, NounPhrase(phrase.span, count=count), self.asset(whole))
        for path, entry in before.items():
            if path[2] not in ("id", "count"):
                self.draft.forget(("actors", part, *path[2:]))
                self.draft.put(("actors", part, *path[2:]), entry.value, entry.span, entry.note)
        left = before["actors", whole, "count"]
        self.draft.forget(("actors", whole, "count"))
        self.draft.put(("actors", whole, "count"), left.value - number, phrase.span)
        self.draft.acknowledge(phrase.span)
        family = self.family(whole)
        if family not in self.families:
            self.families.append(family)
        family.append(part)
        return part

    def _rest(self, phrase: NounPhrase) -> str:
        if not self.families:
            raise NotReadError("no group was divided before it")
        rest = self.families[-1][0]
        if phrase.entries and self.groups[rest].entry not in phrase.entries:
            raise NotReadError("no such group was divided before it")
        self.draft.acknowledge(phrase.span)
        return rest

    def _is_referred_to(self, group: str) -> bool:
        """Whether another group stands by this one, so that it cannot be divided."""
        return any(
            path[0] == "actors"
            and path[1] != group
            and path[-1] in ("of", "first", "second")
            and entry.value == group
            for path, entry in self.draft.entries.items()
        )

    # At the end.

    def finish(self) -> None:
        """Tell of contradictions, and give cars with people in them their role."""
        for entry, span in self.absent.items():
            present = [name for name in self.groups if self._contradicts(entry, name)]
            if present:
                readings = [f"there are {', '.join(present)}", "leave this out"]
                self.draft.ask(span, f"the text also names {', '.join(present)}; is it so?", readings)
        for group in self.groups:
            if self.role(group) is Role.CLUTTER and self._is_driven(group):
                named = self.draft.entries["actors", group, "id"].span
                assert named is not None
                self.set_role(group, Role.BYSTANDER, named)
                self.draft.remark(named, "people drive it: its role is bystander")

    def _contradicts(self, entry: str, group: str) -> bool:
        """Whether a group is there although the text says that there are none of an entry: children are civilians too."""
        protected = self.vocabulary.role(entry) is self.role(group) is Role.BYSTANDER
        return self.groups[group].entry == entry or protected

    def _is_driven(self, group: str) -> bool:
        kind = self.draft.entries.get(("actors", group, "motion", "kind"))
        return kind is not None and kind.value != "still" and self.asset(group) in VEHICLES
