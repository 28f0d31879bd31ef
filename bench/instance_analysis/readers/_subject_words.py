"""Words that change what a sentence is about: `it`, `the drone`, `which`, `the target`."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.simspec import Role

from .._draft import Draft
from ..language._phrases import Phrase
from ..language._tokens import Span, Word
from ._flight import FlightReader
from ._group_references import GroupReferences
from ._roads import RoadReader
from ._sentence_context import SentenceContext
from ._targets import TargetReader
from ._traits import PERSONS

_LOOKED_FOR = re.compile(
    r"\b(?:(?:look|search|hunt)(?:s|ed|ing|es)?\s+(?:everywhere\s+)?for|find|locate)\s+(?:the\s+|our\s+)?$",
    re.IGNORECASE,
)
"""What makes the person after it the one who is sought."""


class SubjectWords:
    """Makes what a word means the subject of its sentence."""

    def __init__(
        self,
        draft: Draft,
        references: GroupReferences,
        context: SentenceContext,
        flight: FlightReader,
        targets: TargetReader,
    ) -> None:
        self.draft, self.references, self.context = draft, references, context
        self.groups = references.groups
        self.flight, self.targets = flight, targets

    def relative(self, word: Word, before: Sequence[Phrase | Word]) -> None:
        """After `near a truck that is camouflaged` or `of which there are two` the truck is the subject."""
        if before and isinstance(before[-1], Word) and before[-1].text.lower() == "of":
            before = before[:-1]
        last = before[-1] if before else None
        if not {"that", "which", "who"}.intersection(word.text.lower().split()) or not isinstance(
            last, Phrase
        ):
            return
        if last.rule == "group":
            # `soldiers and civilians, who walk`: the civilians.
            self.context.joined = []
        elif last.rule in RoadReader.RULES:
            self.context.topic = "road"
        elif last.refs:
            groups = [
                group
                for group in self.references.referents.get(last.refs[-1].span, [])
                if group in self.groups.kinds
            ]
            if groups:
                self.groups.subject, self.groups.in_sentence, self.context.joined = (
                    [str(group) for group in groups],
                    True,
                    [],
                )
                self.context.topic = "group"

    def change_subject(self, word: Word, kinds: set[str]) -> None:
        """Make what a word means the subject: the drone, a road or ground, or groups."""
        groups = self.groups
        if kinds & {"HOME", "LAUNCH"}:
            if word.text.lower().startswith("the vehicle "):
                self.draft.remark(word.span, "the vehicle is read as the drone under test")
            groups.in_sentence, groups.subject_is_mission, groups.subject = False, True, []
            self.context.topic = "home"
        elif "THEM" in kinds and self.context.topic == "" and self.context.last in ("ground", "road"):
            self.context.topic = self.context.last
        elif "THEM" in kinds and _LOOKED_FOR.search(self.draft.text[: word.span.start]):
            self.seek(self.references.them(word.span), word.span)
        elif "THEM" in kinds and groups.subject:
            self.references.them_as_subject(word.span)
            groups.in_sentence, self.context.topic = True, "group"
        elif "CONVOY" in kinds and groups.convoys:
            groups.make_subject(groups.convoys)
            self.context.topic = self.flight.subject = "group"
        elif "TARGET" in kinds and (targets := self._targets_called(word)):
            groups.make_subject(groups.choose_one(targets, word.span))
            self.context.topic = "group"

    def _targets_called(self, word: Word) -> list[str]:
        """The targets of the text, after the word that may have called the subject so."""
        self.targets.called(
            word, self.context.joined or (self.groups.subject if self.groups.in_sentence else [])
        )
        return self.groups.targets()

    def seek(self, groups: Sequence[str], span: Span) -> None:
        """Make the persons sought of whom the text says that somebody looks for them."""
        match = _LOOKED_FOR.search(self.draft.text[: span.start])
        for group in groups if match else ():
            if match and self.groups.asset(group) in PERSONS and self.groups.role(group) is Role.BYSTANDER:
                self.groups.seek(group, Span(match.start(), span.end))
