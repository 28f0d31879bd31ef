"""The groups of a text: whom each noun phrase names, and the parts that a group is divided into."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from bench.simspec import ASSETS, HOME, Role

from .._draft import Draft, FieldPath
from .._result import VariedField
from ..language._coordinates import Coordinates
from ..language._phrases import HOME_PLACE, NounPhrase
from ..language._quantities import Quantity
from ..language._tokens import Span
from ..language._vocabulary import MotionWords, Vocabulary
from ._not_read import NotReadError

SKIN_WORDS = frozenset(["black", "white", "brown"])
"""Colours that may tell of the people themselves."""
RelationTarget = str | Coordinates
"""Whom a relation is to: the id of a group, `home`, or a place."""


def assets_of_class(*labels: str) -> frozenset[str]:
    """The assets of the catalogue with one of these class labels."""
    return frozenset(name for name, asset in ASSETS.items() if asset.class_label in labels)


PERSONS = assets_of_class("civilian", "aid_worker", "combatant")
IMMOVABLE = assets_of_class("building", "tree", "crate", "tent")
VEHICLES = assets_of_class("civilian_vehicle")
ROOFED = assets_of_class("building")
"""What somebody can be inside of."""


@dataclass(slots=True)
class Group:
    """A group as the text has spoken of it so far."""

    entry: str
    plural: bool
    mentioned: int
    """Number of the sentence that has named it last."""
    convoy: bool = False


class Scene:
    """The groups of a text in the order in which it names them."""

    def __init__(self, draft: Draft, vocabulary: Vocabulary) -> None:
        self.draft, self.vocabulary = draft, vocabulary
        self.groups: dict[str, Group] = {}
        self.subject: list[str] = []
        """Whom the last statement was about."""
        self.sentence = 0
        self.unread = -1
        """Number of the last sentence that holds something unread, of which a pronoun may speak."""
        self.families: list[list[str]] = []
        """Groups that are parts of one: what is left, and its shares."""
        self.absent: dict[str, Span] = {}
        """Entries of which the text says that there are none."""

    # What the draft holds of a group.

    def asset(self, group: str) -> str:
        return str(self.draft.entries["actors", group, "asset"].value)

    def role(self, group: str) -> Role:
        return Role(self.draft.entries["actors", group, "role"].value)

    def count(self, group: str) -> int | None:
        """The number of members where it is one stated number."""
        entry = self.draft.entries.get(("actors", group, "count"))
        varied = any(f"actors[{group}].count" in item.paths for item in self.draft.ranges)
        return None if entry is None or varied else int(entry.value)

    def targets(self) -> list[str]:
        """The groups that are to be found: adversaries, or else whoever is sought."""
        roles = {group: self.role(group) for group in self.groups}
        adversaries = [group for group, role in roles.items() if role is Role.ADVERSARY]
        return adversaries or [group for group, role in roles.items() if role is Role.SOUGHT]

    def convoys(self) -> list[str]:
        return [name for name, group in self.groups.items() if group.convoy]

    # Whom a phrase names.

    def subjects(self, phrase: NounPhrase) -> list[str]:
        """The groups that a phrase at the place of the subject names, a new one where it introduces one."""
        groups = self._named(phrase, others=[])
        for group in groups:
            self.groups[group].mentioned = self.sentence
            self._describe(group, phrase)
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
                self._describe(group, phrase)
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
        return [self._add(chosen, phrase, self.vocabulary.assets[chosen].asset)]

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
        return self._add(entry, phrase, asset)

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

    def _add(self, entry: str, phrase: NounPhrase, asset: str) -> str:
        number = 1 + sum(group.entry == entry for group in self.groups.values())
        # Ids are the words of the vocabulary, so that a reader recognizes the groups in the SimSpec.
        name = entry if number == 1 else f"{entry}-{number}"
        self.groups[name] = Group(entry, phrase.plural, self.sentence, convoy=phrase.convoy)
        base: FieldPath = ("actors", name)
        self.draft.put((*base, "id"), name, phrase.span)
        self.draft.put((*base, "asset"), asset, phrase.span)
        self.draft.put((*base, "role"), str(self.vocabulary.role(entry)), phrase.span)
        self._put_count(name, phrase)
        return name

    def _put_count(self, group: str, phrase: NounPhrase) -> None:
        path: FieldPath = ("actors", group, "count")
        count, span = phrase.count, phrase.span
        if phrase.per_km2 is not None and count is not None:
            self.put_density(group, count, phrase.per_km2, span)
        elif count is not None and count.values:
            self._put_levels(group, count.values, span)
        elif count is None and phrase.plural:
            low, high = self.vocabulary.tables["vague"]["some"]
            note = "no number is given: read as `some`"
            self.draft.vary(path, low, high, None, unit=None, integer=True, note=note)
        elif count is None:
            question = f"does {self.draft.quote(span)!r} stand in the scene?"
            if self.draft.ask(span, question, ["yes, one", "no, it is only spoken of"]) == 1:
                raise NotReadError("it is only spoken of")
            self.draft.put(path, 1, span)
        elif phrase.least:
            low = count.low
            chosen = self.draft.ask(
                span, "no upper bound is given; how many?", [f"{low:g}", f"{low:g} to {2 * low:g}"]
            )
            self.draft.vary(path, low, low * (1 + chosen), span, unit=None, integer=True)
        else:
            self.draft.vary(path, count.low, count.high, span, unit=None, integer=True)

    def _put_levels(self, group: str, values: Sequence[float], span: Span) -> None:
        """Let the number of a group be one of several, a factor of the design."""
        levels = tuple(int(value) for value in values)
        if levels != values or len(set(levels)) < len(levels):
            raise NotReadError("its numbers are no different whole numbers")
        self.draft.put(("actors", group, "count"), levels[0], span, "first of several")
        where = (f"actors[{group}].count",)
        self.draft.ranges.append(VariedField(name=f"{group}-count", paths=where, levels=levels))

    def put_density(self, group: str, count: Quantity, per_km2: float, span: Span) -> None:
        """Set the density of a group in the place of its number. Raises NotReadError where the text states a number."""
        stated = self.draft.entries.get(("actors", group, "count"))
        if stated is not None and stated.span is not None:
            raise NotReadError(f"{group} has a number already: state the number or the density")
        self.draft.forget(("actors", group, "count"))
        self.groups[group].plural = True
        path: FieldPath = ("actors", group, "density_per_km2")
        self.draft.vary(path, count.low * per_km2, count.high * per_km2, span, unit="1/km2")

    def _describe(self, group: str, phrase: NounPhrase) -> None:
        """Set what the adjectives of a phrase say."""
        for name, value in phrase.adjectives:
            if name == "role":
                self.set_role(group, Role(value), phrase.span)
            elif name == "concealment":
                self.draft.put(("actors", group, "concealment"), value, phrase.span)
            elif name == "color":
                self._paint(group, value, phrase.span)
            elif isinstance(value, MotionWords):
                self.draft.put(("actors", group, "motion", "kind"), value.kind, phrase.span)
                if value.speed_mps is not None:
                    self.draft.put(
                        ("actors", group, "motion", "speed_mps"),
                        value.speed_mps,
                        None,
                        "the word's own speed",
                    )

    def _paint(self, group: str, color: str, span: Span) -> None:
        if color in SKIN_WORDS and self.asset(group) in PERSONS:
            readings = [f"their clothes are {color}", "it tells of no clothes: leave it out"]
            if self.draft.ask(span, f"of what does {color!r} tell?", readings) == 1:
                return
        self.draft.put(("actors", group, "color"), color, span)

    def set_role(self, group: str, role: Role, span: Span) -> None:
        """Set the role of a group, where its asset may have it."""
        asset = self.asset(group)
        if role is Role.SOUGHT and asset not in PERSONS:
            raise NotReadError(f"no {asset} is sought: only persons are")
        if asset in IMMOVABLE:
            raise NotReadError(f"no {asset} is {role}")
        self.draft.forget(("actors", group, "role"))
        self.draft.put(("actors", group, "role"), str(role), span)

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
        part = self._add(self.groups[whole].entry, NounPhrase(phrase.span, count=count), self.asset(whole))
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
