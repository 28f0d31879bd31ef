"""The groups of a text as the draft holds them: what each is, how many, and what its noun phrase says of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.simspec import ASSETS, Role

from .._draft import Draft, FieldPath
from .._result import VariedField
from ..language._phrases import NounPhrase
from ..language._quantities import Quantity
from ..language._tokens import Span
from ..language._vocabulary import MotionWords, Vocabulary
from ._not_read import NotReadError

SKIN_WORDS = frozenset(["black", "white", "brown"])
"""Colours that may tell of the people themselves."""


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


class Groups:
    """The groups of a text in the order in which it names them."""

    def __init__(self, draft: Draft, vocabulary: Vocabulary) -> None:
        self.draft, self.vocabulary = draft, vocabulary
        self.groups: dict[str, Group] = {}
        self.sentence = 0

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

    def add(self, entry: str, phrase: NounPhrase, asset: str) -> str:
        """Id of a new group."""
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

    def describe(self, group: str, phrase: NounPhrase) -> None:
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
