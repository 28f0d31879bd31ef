"""Reads the statements of a text into a draft, in its order; what depends on several of them is read at the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from bench.simspec import Role

from .._draft import Draft
from ..language._grammar import Part, Statement
from ..language._phrases import NounPhrase
from ..language._tokens import Span
from ..language._vocabulary import Vocabulary
from ._events import EventReader
from ._fitting_defaults import fit_defaults
from ._ground import GroundReader
from ._groups import PERSONS
from ._not_read import NotReadError
from ._places import PlaceReader
from ._predicates import PredicateReader, names_itself
from ._roads import RoadReader
from ._scene import Scene
from ._settings import SettingsReader
from ._weather import WeatherReader

FIRST = ("origin", "home")
"""What all places depend on is read before everything else, wherever the text states it."""


class TextReader:
    """Reads statements. `unread` notes where the text holds something that is not read."""

    def __init__(self, draft: Draft, vocabulary: Vocabulary) -> None:
        self.draft = draft
        self.scene = Scene(draft, vocabulary)
        self.places = PlaceReader(draft)
        self.ground = GroundReader(draft, vocabulary.defaults, self.places)
        self.roads = RoadReader(draft, vocabulary.defaults, self.ground, self.places, self.scene)
        self.predicates = PredicateReader(draft, vocabulary, self.scene, self.places, self.ground, self.roads)
        self.weather = WeatherReader(draft, self.places)
        self.settings = SettingsReader(draft, self.scene)
        self.events = EventReader(draft, self.scene, self.places, vocabulary.defaults.uncertainty_m)

    def read_first(self, statements: Sequence[Statement]) -> None:
        """Read where the origin and home are."""
        self._read_all("origin", self.places.set_origin, statements)
        self.places.origin_of(part for statement in statements for part in (statement, *statement.predicates))
        self._read_all("home", self.places.set_home, statements)

    def _read_all(self, name: str, read: Callable[[Part], None], statements: Sequence[Statement]) -> None:
        for statement in statements:
            if statement.form.reader == name:
                self._attempt(statement.span, partial(read, statement))

    def read(self, statement: Statement) -> bool:
        """Read a statement of the sentence with the scene's number; whether it could be read."""
        if statement.form.reader in FIRST:
            return True
        return self._attempt(statement.span, lambda: self._statement(statement))

    def _attempt(self, span: Span, read: Callable[[], None]) -> bool:
        """Read something in whole or not at all, and list it in that case."""
        draft = self.draft
        before = (
            dict(draft.entries),
            list(draft.ranges),
            list(draft.statements),
            dict(draft.remarks_by_place),
        )
        acknowledged = len(draft.acknowledged)
        known, families, subject = (
            len(self.scene.groups),
            [[*family] for family in self.scene.families],
            self.scene.subject,
        )
        draft.reading = span
        try:
            read()
        except NotReadError as error:
            draft.entries, draft.ranges, draft.statements, draft.remarks_by_place = before
            del draft.acknowledged[acknowledged:]
            self.scene.families, self.scene.subject = families, subject
            for group in list(self.scene.groups)[known:]:
                del self.scene.groups[group]
            self.scene.unread = self.scene.sentence
            draft.leave_out(error.span or span, error.why)
            return False
        return True

    def _statement(self, statement: Statement) -> None:
        name = statement.form.reader
        if name == "groups":
            self._groups(statement)
            return
        readers: tuple[object, ...] = (
            self.settings,
            self.weather,
            self.events,
            self.ground,
            self.roads,
            self,
        )
        names = {"ground_kind": "kind"}
        read = next(
            found for reader in readers if (found := getattr(reader, names.get(name, name), None)) is not None
        )
        read(statement)

    def _groups(self, statement: Statement) -> None:
        """Read whom a statement names, and what it says of them."""
        stated = len(self.draft.statements)
        named = [self.scene.subjects(phrase) for phrase in statement.subjects]
        groups = [group for phrase in named for group in phrase]
        self._check_said(statement, groups, anything=len(self.draft.statements) > stated)
        if not groups:
            self.draft.acknowledge(statement.span)
        self.scene.subject = groups
        self._note_references(statement, groups)
        for predicate in statement.predicates:
            for group in self._said_of(predicate, statement.subjects, named):
                self.predicates.read(group, predicate)

    def _check_said(self, statement: Statement, groups: Sequence[str], *, anything: bool) -> None:
        """Something is said, and of somebody: `them` alone is what is left of a clause."""
        if groups and not statement.predicates and not anything:
            raise NotReadError("nothing is said of it")
        if not groups and statement.predicates:
            raise NotReadError("it is said of nobody")

    def _note_references(self, statement: Statement, groups: Sequence[str]) -> None:
        """Whoever is named again is read, although no field is set."""
        for phrase in statement.subjects:
            if phrase.definite or phrase.pronoun:
                self.draft.acknowledge(phrase.span)
        if len(groups) > 1:
            self.scene.subject = list(dict.fromkeys(groups))

    def _said_of(
        self, predicate: Part, phrases: Sequence[NounPhrase], named: Sequence[Sequence[str]]
    ) -> Sequence[str]:
        """The groups of a list that a predicate is said of; asked where it may be all or the last of them."""
        everyone = [group for groups in named for group in groups]
        if len(phrases) == 1:
            return everyone
        last = named[-1]
        if names_itself(predicate, everyone[: len(everyone) - len(last)], self.scene):
            return last
        readings = [", ".join(everyone), ", ".join(last)]
        question = "of which groups is this said?"
        return [everyone, last][self.draft.ask(predicate.span, question, readings)]

    def call_target(self, statement: Statement) -> None:
        """Read whom the text calls its target: persons may be sought or adversaries, others are adversaries."""
        for group in self.scene.named_once(statement.first("group")):
            self._make_target(group, statement)
            self.scene.subject = [group]

    def _make_target(self, group: str, statement: Statement) -> None:
        self.draft.acknowledge(statement.span)
        if self.scene.role(group) in (Role.ADVERSARY, Role.SOUGHT):
            return
        role = Role.ADVERSARY
        if self.scene.asset(group) in PERSONS:
            readings = ["they are sought", "they are adversaries"]
            role = (Role.SOUGHT, Role.ADVERSARY)[
                self.draft.ask(statement.span, "who is the target?", readings)
            ]
        self.scene.set_role(group, role, statement.span)

    def finish(self) -> None:
        """Read what depends on several parts of the text."""
        whole = Span(0, len(self.draft.text))
        for finish in (self.scene.finish, self.weather.finish, self.ground.finish, self.roads.finish, self.settings.finish, self.events.finish):  # fmt: skip
            self._attempt(whole, finish)
        self._turn_fixed()
        fit_defaults(self.draft)

    def _turn_fixed(self) -> None:
        """A group at a fixed place has its heading there."""
        for group in self.scene.groups:
            base = ("actors", group, "placement")
            heading = self.draft.entries.get((*base, "facing", "heading_deg"))
            if heading is not None and (*base, "at", "east_m") in self.draft.entries:
                self.draft.forget((*base, "facing"))
                self.draft.put((*base, "at", "heading_deg"), heading.value, heading.span)
