"""What is said of groups: whom a phrase describes, and which reader reads it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .._draft import Draft
from ..language._phrases import Phrase
from ..language._vocabulary import MotionWords
from ._escort import EscortReader
from ._group_references import GroupReferences
from ._place_statements import PlaceStatements
from ._places import PlaceReader, count_places
from ._relations import RelationReader
from ._roads import RoadReader
from ._sentence_context import SentenceContext
from ._traits import IMMOVABLE, TraitReader
from ._unread_subjects import UnreadSubjects

_EVERYONE = re.compile(r"\b(?:all|every(?:one|body)|both)\b[^,.;:!?]{0,20}$", re.IGNORECASE)
_VERB = re.compile(
    r"\b(?:stands?|stood|are|is|were|was|lies?|sits?|waits?|shall|must|remains?|stays?|walks?|drives?|moves?)\b",
    re.IGNORECASE,
)
"""What makes `four rescuers with two dogs stand by the house` a statement about all of them."""
_PLURAL_VERB = re.compile(
    r"\s+(?:are|were|stand|wait|walk|move|drive|patrol|run|sit|lie|stay|remain)\b", re.IGNORECASE
)
RULES_FOR_ALL_GROUPS = frozenset(["road", "spread"])
"""Relations that are said of every group before them, and not asked."""


class GroupStatements:
    """Reads the phrases that describe groups."""

    def __init__(
        self,
        draft: Draft,
        references: GroupReferences,
        context: SentenceContext,
        unread: UnreadSubjects,
        place_statements: PlaceStatements,
        places: PlaceReader,
        readers: tuple[RelationReader, TraitReader, RoadReader],
    ) -> None:
        self.draft, self.references, self.context, self.unread = draft, references, context, unread
        self.groups = references.groups
        self.place_statements, self.places, self.readers = place_statements, places, readers
        self.escort = EscortReader(draft, references)

    def of_group(self, phrase: Phrase) -> None:
        """Read what a phrase says of the groups that it describes."""
        if phrase.rule in ("place", "stretch") or count_places(phrase) > 1:
            self.place_statements.figures(phrase, later=False)
            return
        if self._is_of_the_drone(phrase):
            return
        for group in self._subject_of(phrase):
            if phrase.rule == "motion" and self._cannot_move(group, phrase):
                self.draft.unread(
                    phrase.span, f"a {self.groups.kinds[group]} does not move", expressible=True
                )
                continue
            reader = next(item for item in self.readers if phrase.rule in item.RULES)
            getattr(reader, phrase.rule)(group, phrase)
            if phrase.rule in ("motion", "travel"):
                self._patrols(group, phrase)
                self.context.moved_until = phrase.span.end

    def _is_of_the_drone(self, phrase: Phrase) -> bool:
        """Read what is said of the escort, the fence and the place of the start; whether a phrase is that."""
        if self.groups.in_sentence and self.escort.read_passive(phrase):
            return True
        if self.place_statements.is_about_the_drone() and (
            self.place_statements.is_fence(phrase) or self.escort.read(phrase)
        ):
            return True
        return (
            phrase.rule == "part"
            and not self.groups.in_sentence
            and self.place_statements.anchors_the_area(phrase)
        )

    def _cannot_move(self, group: str, phrase: Phrase) -> bool:
        motion = phrase.first("MOTION")
        moves = motion is not None and isinstance(motion.value, MotionWords) and motion.value.kind != "still"
        return moves and self.groups.asset(group) in IMMOVABLE

    def _patrols(self, group: str, phrase: Phrase) -> None:
        motion, direction = phrase.first("MOTION"), phrase.first("DIR")
        if motion is not None and isinstance(motion.value, MotionWords) and motion.value.patrol:
            self.places.patrol(group, phrase.span)
        if direction is not None and isinstance(direction.value, int | float):
            self.places.travel(group, float(direction.value), phrase.span)

    def _subject_of(self, phrase: Phrase) -> list[str]:
        """The groups that a phrase describes; none where the text does not say, or that needs no field."""
        subject = self._everyone(self.groups.subject, phrase)
        if not subject:
            if phrase.rule != "spread" and not (phrase.rule == "inside" and not phrase.refs):
                self.draft.unread(phrase.span, "the text does not say for whom", expressible=True)
                for item in phrase.refs:
                    # A group that is named exists, even if the statement about it cannot be read.
                    self.references.ref(item)
            return []
        if phrase.rule == "inside" and phrase.first("AREAWORD"):
            # The area of interest, where every group is.
            return []
        is_about = self._is_nearest if self.groups.in_sentence else self._still_about
        return (
            self._with_others(self._described(subject, phrase), phrase) if is_about(subject, phrase) else []
        )

    def _with_others(self, subject: list[str], phrase: Phrase) -> list[str]:
        """The subject, or it and the groups that the sentence names with it, as a choice."""
        question = "which groups does this describe?"
        if len(self.context.company) > 1 and self._is_predicate(phrase):
            members = [self.context.company, self.context.company[:1], self.context.company[1:]]
            names = [", ".join(groups) for groups in members]
            subject = self._not_itself(members[self.draft.ask(phrase.span, question, names)], phrase)
        joined = self._not_itself(self.context.joined, phrase)
        if len(joined) > 1 and phrase.rule not in RULES_FOR_ALL_GROUPS and joined[-1:] == subject[-1:]:
            if self._is_plural_verb(subject[-1], phrase):
                # `two ambulances and a bus are parked`.
                self.groups.subject = joined
                return joined
            readings = [", ".join(subject), ", ".join(joined)]
            return [subject, joined][self.draft.ask(phrase.span, question, readings)]
        return subject

    def _not_itself(self, groups: Sequence[str], phrase: Phrase) -> list[str]:
        """The groups without those that a relation is to: a group has no distance from itself."""
        return [group for group in groups if not phrase.refs or group not in self.references.ref(phrase)]

    def _everyone(self, subject: list[str], phrase: Phrase) -> list[str]:
        """All parts of a divided group after `everyone` and `all`, and what was the subject else."""
        family = self.groups.family(subject[-1]) if subject else []
        if len(family) > 1 and _EVERYONE.search(self.draft.text[: phrase.span.start]):
            return family
        return subject

    def _is_plural_verb(self, last: str, phrase: Phrase) -> bool:
        """Whether the verb after the last group, which has one member, is that of several."""
        entry = self.draft.entries.get(("actors", last, "id"))
        if last in self.groups.counts.plural or entry is None or entry.span is None:
            return False
        return _PLURAL_VERB.match(self.draft.text, entry.span.end, phrase.span.end) is not None

    def _is_predicate(self, phrase: Phrase) -> bool:
        """Whether a verb stands between the groups of the sentence and what is said of them."""
        entry = self.draft.entries.get(("actors", self.context.company[-1], "id"))
        start = entry.span.end if entry is not None and entry.span is not None else phrase.span.start
        return _VERB.search(self.draft.text, start, phrase.span.end) is not None

    def _described(self, subject: list[str], phrase: Phrase) -> list[str]:
        """The groups that a phrase describes after a relation to another group that the sentence has just named.

        `soldiers guard a truck parked on the road`: what follows without a comma is nearer to the truck. Either
        way it is a choice, because a sentence does not tell.
        """
        others = [group for group in self.context.just_named if group not in subject]
        between = self.draft.text[self.context.named_until : phrase.span.start]
        if not others or phrase.span.start < self.context.named_until or " and " in between:
            return subject
        candidates = [subject, others] if "," in between else [others, subject]
        readings = [", ".join(groups) for groups in candidates]
        return candidates[self.draft.ask(phrase.span, "of which is this said?", readings)]

    def note_named(self, phrase: Phrase, known: set[str]) -> None:
        """Note the groups that a relation has named for the first time."""
        named = [group for group in self.groups.kinds if group not in known]
        if named and phrase.refs:
            self.context.just_named, self.context.named_until = named, phrase.span.end

    def _still_about(self, subject: Sequence[str], phrase: Phrase) -> bool:
        """Whether a sentence without a subject is about the groups of the sentence before it."""
        answers = [(", ".join(subject), True), ("nobody: leave it out", False)]
        if self.context.has_stranger:
            # `A lifeboat waits half a mile out`: the unknown word is nearer to it.
            answers.reverse()
        if answers[self.draft.ask(phrase.span, "of whom is this said?", [name for name, _ in answers])][1]:
            return True
        self.draft.unread(phrase.span, "it is not said of whom", expressible=True)
        return False

    def _is_nearest(self, subject: Sequence[str], phrase: Phrase) -> bool:
        """Whether a phrase is about the subject, although the text has spoken of something unread after it."""
        mention = self.groups.mentioned_at(subject)
        # `a tank, hidden near trees, in the north`: the sentence is not about the trees.
        begin = self.context.start if self.unread.is_object(mention) else mention.end
        if self.unread.since(begin, phrase.span.start, subjects=True) is None:
            return True
        return self.is_said_of(subject, phrase, first=True)

    def is_said_of(self, subject: Sequence[str], phrase: Phrase, *, first: bool) -> bool:
        """Ask whether a phrase is about a group or about something unread; without an answer the former if `first`."""
        answers = [(", ".join(subject), True), ("what is not read: leave it out", False)]
        if not first:
            answers.reverse()
        if answers[self.draft.ask(phrase.span, "of whom is this said?", [name for name, _ in answers])][1]:
            return True
        self.draft.unread(phrase.span, "it is said of something that is not read", expressible=True)
        return False
