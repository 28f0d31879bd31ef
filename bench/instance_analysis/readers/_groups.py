"""The groups of actors in a text: their assets and roles, and the parts that a group is divided into."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.simspec import Role

from .._draft import Draft, FieldPath
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span
from ..language._vocabulary import Vocabulary
from ._group_counts import GroupCounts
from ._traits import PERSONS, VEHICLES
from ._unread_subjects import UnreadSubjects

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
        self.draft, self.vocabulary, self.unread = draft, vocabulary, unread
        self.counts = GroupCounts(draft, vocabulary)
        self._mentions: dict[str, Span] = {}
        """Where the text has last mentioned each group, by a name or a pronoun."""
        self.kinds: dict[str, str] = {}
        """Ids of the groups, and the vocabulary's name of each."""
        self.subject: list[str] = []
        self.in_sentence = False
        self.subject_is_mission = False
        self.absent: dict[str, Span] = {}
        """Assets of which the text says that there are none."""
        self.mentioned: list[str] = []
        """The groups that this sentence has named; `it` is one of these before it is one of another
        sentence.
        """

        self.mentioned_before: list[str] = []
        """The groups that the last sentence with groups has named."""
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

    def mention(self, groups: Sequence[str], span: Span) -> None:
        """Note where the text speaks of groups."""
        self._mentions |= dict.fromkeys(groups, span)

    def mentioned_at(self, groups: Sequence[str]) -> Span:
        """Where the text has last spoken of one of the groups; its beginning where it has not."""
        spans = (self._mentions.get(group, Span(0, 0)) for group in groups)
        return max(spans, key=lambda span: span.end, default=Span(0, 0))

    def is_meant(self, groups: Sequence[str], pronoun: Span) -> bool:
        """Whether a pronoun means groups, although the text has spoken of something unread after them."""
        if self.unread.since(self.mentioned_at(groups).end, pronoun.start) is None:
            self.mention(groups, pronoun)
            return True
        readings = [", ".join(groups), "what is not read: leave it out"]
        if self.draft.ask(pronoun, f"who is {self.draft.quote(pronoun)!r}?", readings) == 0:
            self.mention(groups, pronoun)
            return True
        self.draft.unread(pronoun, "it is something that is not read", expressible=True)
        return False

    def note_absent(self, phrase: Phrase, name: str) -> None:
        """`no civilians`: read where the text has none, which needs no field; else it contradicts the text."""
        if name not in self.kinds.values():
            self.draft.acknowledge(phrase.span)
            self.absent[name] = phrase.span
            return
        for part in phrase.leaves:
            part.disown()

    def add(self, phrase: Phrase, name: str, span: Span, count: Part | None) -> str:
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
        put(("actors", group, "asset"), words.named_by(noun_of(self.draft, phrase)), span)
        put(("actors", group, "role"), str(words.role), span)
        if phrase.rule == "group" and (per := phrase.first("PERAREA")):
            if count is None:
                self.draft.fault(phrase.span, "gives `per area` without a number", "write a number before it")
                return group
            self.density_of(group, count, per, phrase.span)
            self.counts.plural.add(group)
            return group
        self.counts.set(group, phrase, count, span)
        return group

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

    def _is_driven(self, group: str) -> bool:
        """Whether a group is of civilian vehicles that move, so that there are people in them."""
        kind = self.draft.entries.get(("actors", group, "motion", "kind"))
        moves = kind is not None and kind.value != "still"
        return moves and self.asset(group) in VEHICLES and self.role(group) is Role.CLUTTER

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
        for group in sorted(self.counts.uncounted - self.counts.plural):
            entry = self.draft.entries.get(("actors", group, "id"))
            if entry is None or entry.span is None:
                continue
            question = f"does {self.draft.quote(entry.span)!r} stand in the scene?"
            if self.draft.ask(entry.span, question, ["yes, one", "no, it is only spoken of"]) == 1:
                self.draft.fault(entry.span, "it is only spoken of", "as you chose")

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
        part = self.add(
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


def noun_of(draft: Draft, phrase: Phrase) -> str:
    """The noun by which a phrase names a group."""
    asset = phrase.first("ASSET")
    return draft.quote(asset.span) if asset else ""
