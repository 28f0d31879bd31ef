"""Reads a text sentence by sentence: tracks the subject and hands each phrase to its reader."""

from __future__ import annotations

import bisect
import re
from collections.abc import Callable, Sequence

from .._draft import Draft
from ..language._phrases import Part, Phrase, Quantity
from ..language._sentences import sentences_of
from ..language._tokens import Span, Word
from ..language._vocabulary import Vocabulary
from ..ledger._clauses import is_stop
from ..ledger._ledger import marked
from ._appositions import AppositionReader
from ._events import EventReader
from ._fitting_defaults import fit_defaults
from ._flight import FlightReader
from ._ground import GroundReader
from ._group_references import GENERIC_PERSONS, GroupReferences
from ._group_statements import GroupStatements
from ._groups import GroupRegister
from ._intelligence import IntelligenceReader
from ._late_counts import LateCounts
from ._place_statements import PlaceStatements
from ._places import PlaceReader, count_places
from ._relations import RelationReader
from ._roads import RoadReader
from ._rules import RuleReader
from ._sentence_context import SentenceContext
from ._shares import ShareReader
from ._subject_words import SubjectWords
from ._targets import TargetReader
from ._traits import TraitReader
from ._unread_subjects import UnreadSubjects
from ._weather import WeatherReader

INSIGNIFICANT_KINDS = frozenset(
    [
        *("OF", "TO", "AT", "FOR", "IN", "AND", "OR", "FROM", "HOME", "THEM"),
        *("COMMA", "DASH", "STOP", "ABOUT", "OVER", "BY", "AWAY", "PART", "FLY", "UNTIL"),
        *("AFTER", "BEFORE", "SQUARE", "DENSITYOF", "KEEP", "AREAWORD", "INTEL", "TARGET", "LBR", "RBR"),
        *("ALONG", "SEEN", "ONAVERAGE", "AGL", "ORIGIN", "LAUNCH", "CORNERS", "ROUTE", "AXIS"),
        *("RUNS", "NTH", "MIDDLE", "CONVOY", "US", "BODY", "NEXTTO", "DEEP", "GROUND", "NAMED", "WIDE"),
        "OFTHEM",
    ]
)
_TIP_AT = re.compile(
    r"\b(?:tip|intel|intelligence|report|sighting|message)\s+(?:at\s+)?(?:[th]\s*[+=]\s*)?\d+\s*(?:s|sec|seconds?|min|minutes?)?$",
    re.IGNORECASE,
)
"""When a report comes in, in as few words as possible."""
_ABOUT = re.compile(r"\b(?:about|concerns?|concerning|regards?|regarding) (?:an? |the )?$", re.IGNORECASE)
"""What stands between a report and whom it is about."""
_WITH = re.compile(r"\bwith (?:an?|the)? ?$", re.IGNORECASE)
ARTICLES = ("a", "an", "one", "single", "a single", "another")
POSSESSIVES = ("his", "her", "its", "their")
GROUP_RULES = RelationReader.RULES | TraitReader.RULES | RoadReader.RULES
UNTOLD_RULES = frozenset(["spread", "group", "clear", "intelligence", "axis", "road"])
"""Phrases that may change nothing: what they say holds already."""


class TextReader:
    """Reads the phrases of a text into a draft, sentence by sentence."""

    def __init__(self, draft: Draft, vocabulary: Vocabulary, left_out: Sequence[Span] = ()) -> None:
        self.draft, self.vocabulary = draft, vocabulary
        self.unread = UnreadSubjects(draft.text, left_out)
        self.groups = GroupRegister(draft, vocabulary, self.unread)
        self.references = GroupReferences(draft, self.groups)
        self.context = SentenceContext()
        self.places = PlaceReader(draft, vocabulary.defaults)
        self.weather_reader = WeatherReader(draft, self.places)
        self.ground = GroundReader(draft, vocabulary.defaults, self.places)
        self.shares = ShareReader(self.references)
        self.roads = RoadReader(draft, vocabulary.defaults, self.ground, self.places)
        self.relations = RelationReader(draft, vocabulary.defaults, self.ground, self.places, self.references)
        self.traits = TraitReader(draft, self.groups, self.relations.refine)
        self.intelligence_reader = IntelligenceReader(draft, self.references)
        self.flight = FlightReader(draft, self.groups, self.ground, self.intelligence_reader)
        self.events = EventReader(draft, self.references, self.intelligence_reader)
        self.rules = RuleReader(draft, self.references)
        self.targets = TargetReader(draft, self.groups)
        self.appositions = AppositionReader(draft, self.groups, self.unread)
        self.late_counts = LateCounts(draft, self.groups, self.context)
        self.subject_words = SubjectWords(draft, self.references, self.context, self.flight, self.targets)
        self.place_statements = PlaceStatements(
            draft, self.references, self.context, self.places, self.ground, self.roads, self.weather_reader
        )
        self.group_statements = GroupStatements(
            draft,
            self.references,
            self.context,
            self.unread,
            self.place_statements,
            self.places,
            (self.relations, self.traits, self.roads),
        )

    def read(self, items: Sequence[Phrase | Word]) -> None:
        """Read all phrases and words into the draft."""
        self._origin_and_home([item for item in items if isinstance(item, Phrase)])
        self.unread.note([item for item in items if isinstance(item, Word)])
        self._stops = [0, *(item.span.end for item in items if is_stop(item))]
        for sentence in sentences_of(items, self.draft):
            self._sentence(sentence)
        self.finish()
        self._list_what_is_lost([item for item in items if isinstance(item, Phrase)])

    def _list_what_is_lost(self, phrases: Sequence[Phrase]) -> None:
        """List every phrase of which no reader made anything: nothing that is known is passed over."""
        draft = self.draft
        unread = (*draft.not_understood, *draft.not_expressible, *draft.remarks)
        touched = [Span(item.start, item.end) for item in unread]
        touched += [Span(choice.start, choice.end) for choice in draft.choices]
        touched += [span for _, _, span in draft.statements] + [span for span, _ in draft.faults]
        touched += [*draft.acknowledged, *draft.used_words, *draft.references]
        marks = marked(len(draft.text), touched)
        for phrase in phrases:
            silent = (
                phrase.rule in UNTOLD_RULES
                or (phrase.rule == "roads" and self.roads.roads)
                or self.ground.is_known(phrase)
            )
            if not silent and not any(marks[phrase.span.start : phrase.span.end]):
                draft.unread(phrase.span, "nothing is read from it", expressible=True)

    def _origin_and_home(self, phrases: Sequence[Phrase]) -> None:
        """Read origin and home first, wherever the text states them: all other places depend on them."""
        placed = [phrase for phrase in phrases if phrase.rule == "place"]
        for phrase in placed:
            if phrase.first("ORIGIN"):
                self.places.set_origin(phrase)
        self.places.origin_of(phrases)
        for phrase in placed:
            if phrase.first("HOME") or phrase.first("LAUNCH"):
                self.places.set_home(phrase)

    def _sentence(self, sentence: list[Phrase | Word]) -> None:
        self.groups.mentioned_before = self.groups.mentioned or self.groups.mentioned_before
        self.groups.in_sentence, self.groups.mentioned = False, []
        self.flight.subject = ""
        self.context.begin(self._stops[bisect.bisect_right(self._stops, sentence[0].span.start) - 1])
        self.intelligence_reader.begin_sentence(spoken_of=any(map(_speaks_of_intelligence, sentence)))
        self.flight.reporting = any(
            isinstance(item, Word) and item.text.lower().startswith("report") for item in sentence
        )
        joins = False
        for index, item in enumerate(sentence):
            if isinstance(item, Word):
                if item.text.lower() == "with" and index and _is_group(sentence[index - 1]):
                    self.context.company = [*self.groups.subject]
                # After a comma, `and` begins another clause.
                joins = (not item.comma and any(m.kind == "AND" for m in item.meanings)) or (
                    joins and (item.filler or item.text.lower() in POSSESSIVES)
                )
                self.subject_words.relative(item, sentence[:index])
                late = self.late_counts.late_count(item, sentence[index - 1] if index else None)
                if not late and not _of_a_rule(item, sentence[index + 1 :]):
                    self._word(item)
                continue
            if self._of_a_rule_before(sentence[:index], item):
                continue
            later = any(isinstance(p, Phrase) and p.rule == "group" for p in sentence[index + 1 :])
            if self.group_statements.escort.announces(item):
                continue
            if later and item.rule in GROUP_RULES and self._of_the_next(item, sentence[index + 1 :]):
                self.context.waiting.append(item)
                joins = False
                continue
            self._phrase(item, joins=joins, later=later)
            joins = False
        for waiting in self.context.waiting:
            self.group_statements.of_group(waiting)

    def _of_the_next(self, phrase: Phrase, rest: Sequence[Phrase | Word]) -> bool:
        """Whether a relation belongs to the next group: `a truck and, 60 m from it, six civilians`; `, in
        sector B a car`.
        """
        before = self.draft.text[: phrase.span.start].lower().rstrip().removesuffix(" some")
        words = before.split()
        if phrase.refs and phrase.refs[0].first("THEM") and words and words[-1].strip(",") in ("and", "plus"):
            return True
        if self.context.waiting:
            return True
        following = next((item for item in rest if not (isinstance(item, Word) and item.filler)), None)
        starts = before.endswith((",", " and"))
        return (
            starts
            and phrase.rule in ("inside", "part")
            and isinstance(following, Phrase)
            and following.rule == "group"
        )

    def _phrase(self, phrase: Phrase, *, joins: bool, later: bool) -> None:
        self.draft.reading = phrase.span
        if phrase.rule == "rest" and self.groups.divided is None and phrase.has("ASSET"):
            # `The rest: two radar vehicles`.
            phrase = Phrase("group", phrase.parts[1:], phrase.span)
        if phrase.rule == "group":
            if not (
                self.late_counts.counts_again(phrase)
                or self._is_walked_around(phrase)
                or self._is_in_brackets_of_unread(phrase)
                or self.appositions.goes_on(phrase)
                or (not joins and not self.context.waiting and self._is_apposed(phrase))
            ):
                self._introduce(phrase, joins=joins)
        elif phrase.rule in ("share", "rest"):
            read = getattr(self.shares, phrase.rule)(phrase)
            self.groups.in_sentence, self.context.topic, self.context.joined, self.context.just_named = (
                read,
                "group",
                [],
                [],
            )
        elif phrase.rule == "axis" and self.place_statements.is_no_road(phrase):
            pass
        elif not (
            phrase.rule == "axis" and self.context.topic == "group" and self.place_statements.moves(phrase)
        ):
            self._statement(phrase, later=later)

    def _is_apposed(self, phrase: Phrase) -> bool:
        """Whether a noun names the person before it once more, so that what follows is said of that person."""
        apposed = self.appositions.read(phrase)
        if apposed:
            self.targets.introduced(self.groups.subject, phrase)
        return apposed

    def _introduce(self, phrase: Phrase, *, joins: bool) -> None:
        """Make the group that a phrase names the subject, and read what was waiting for it."""
        self.flight.subject, self.context.just_named = "group", []
        previous = self.context.joined if joins else []
        self.references.introduce(phrase)
        self.subject_words.seek(self.groups.subject, phrase.span)
        self.targets.introduced(self.groups.subject, phrase)
        accompanies = len(self.context.company) == 1 and _WITH.search(self.draft.text[: phrase.span.start])
        self.context.company = [*self.context.company, *self.groups.subject] if accompanies else []
        if _ABOUT.search(self.draft.text[: phrase.span.start]):
            self.intelligence_reader.about(self.groups.subject, phrase.span)
        self.context.before, self.context.topic, self.context.last = self.context.last, "group", "group"
        self.context.joined = [*previous, *self.groups.subject]
        for waiting in self.context.waiting:
            unread = self.unread.since(self.context.start, waiting.span.start, subjects=True)
            trait = waiting.rule in TraitReader.RULES
            if unread is None or self.group_statements.is_said_of(
                self.groups.subject, waiting, first=not trait
            ):
                self.group_statements.of_group(waiting)
        self.context.waiting = []

    def _statement(self, phrase: Phrase, *, later: bool) -> None:
        """Read what is said of a group, or of anything else."""
        known = set(self.groups.kinds)
        about = self._about_groups(phrase)
        if about is not None:
            if (self.context.waiting or not self.groups.in_sentence) and later and about.rule != "density":
                self.context.waiting.append(about)
                return
            self.group_statements.of_group(about)
            self.group_statements.note_named(about, known)
            if about.refs and (named := [group for group in self.groups.kinds if group not in known]):
                # `two soldiers guard a car, the target`.
                self.targets.introduced(named, about.refs[0])
        elif phrase.rule in ("place", "stretch") or (phrase.rule == "between" and count_places(phrase) == 2):
            self.place_statements.figures(phrase, later=later)
        elif phrase.rule not in GROUP_RULES:
            self.context.has_stranger = self.context.has_stranger or phrase.rule in FlightReader.RULES
            if phrase.rule in ("extent", "overfly", "stayin"):
                self.context.topic = self.context.last = self.context.before = "ground"
            self._handler(phrase.rule)(phrase)
            if phrase.rule == "extent":
                self.context.sized_until = phrase.span.end
        self.context.joined = []

    def _is_in_brackets_of_unread(self, phrase: Phrase) -> bool:
        """Whether a group in brackets only tells who the unread thing before them is: `mortar team (3 pax)`."""
        head = self.draft.text[: phrase.span.start].rstrip()
        named = self.unread.named_in_clause_before(len(head) - 1) if head.endswith("(") else None
        if named is None or self.groups.mentioned_at([*self.groups.kinds]).end > named.start:
            return False
        answers = [("a group of its own", False), ("what is not read: leave it out", True)]
        asset = phrase.first("ASSET")
        if asset is not None and self.draft.quote(asset.span).lower() in GENERIC_PERSONS:
            answers.reverse()
        left_out = answers[self.draft.ask(phrase.span, "who is this?", [name for name, _ in answers])][1]
        if left_out:
            self.draft.unread(phrase.span, "it is said of something that is not read", expressible=True)
        return left_out

    def _is_walked_around(self, phrase: Phrase) -> bool:
        """Whether a group is what the subject moves around, as in `ten people walk around the house`."""
        between = self.draft.text[self.context.moved_until : phrase.span.start]
        around = (
            self.draft.text[: self.context.moved_until].lower().endswith((" around", " past", " through"))
        )
        alone = not phrase.has("COUNT", "NONE") and between.strip().lower() in ("", "the")
        if not (
            around and alone and self.context.moved_until > self.context.start and self.groups.in_sentence
        ):
            return False
        subject = self.groups.subject
        self.references.named(phrase)
        self.groups.subject = subject
        self.draft.unread(
            phrase.span, "moving around something is no relation: give a distance", expressible=True
        )
        return True

    def _about_groups(self, phrase: Phrase) -> Phrase | None:
        """The phrase when it describes a group; None when it describes ground or the vehicle's home."""
        it = bool(phrase.refs and phrase.refs[0].first("THEM")) or (
            phrase.rule == "road" and phrase.has("THEM", "BESIDEIT")
        )
        if it and self.place_statements.is_of_a_road(phrase):
            return self.place_statements.of_the_road(phrase)
        ground = self.context.before == "ground" and self.ground.current not in (None, self.ground.world)
        if it and ground and phrase.rule == "inside":
            return Phrase("inside", (), phrase.span)
        if phrase.rule == "area" and (phrase.first("IN") or phrase.first("INSIDE")):
            self.ground.area(phrase)
            self.context.sized_until = phrase.span.end
            named = phrase.first("GROUND") or phrase.first("NAMED")
            return Phrase("inside", (named,), phrase.span) if named else Phrase("spread", (), phrase.span)
        if self.place_statements.is_of_ground(phrase) or self.place_statements.is_no_motion(phrase):
            return None
        if (
            phrase.rule not in GROUP_RULES
            or self.place_statements.about_ground(phrase)
            or count_places(phrase) > 1
        ):
            return None
        return phrase

    def _handler(self, rule: str) -> Callable[[Phrase], None]:
        """The method that reads a phrase which describes no group."""
        readers: list[tuple[object, frozenset[str]]] = [
            (self.weather_reader, WeatherReader.RULES),
            (self.rules, frozenset(["rule"])),
            (self.flight, FlightReader.RULES),
            (self.ground, frozenset(["extent", "overfly", "stayin"])),
            (self.roads, frozenset(["axis", "width", "course"])),
            (self.events, frozenset(["event", "comply"])),
            (self.intelligence_reader, frozenset(["intelligence", "known"])),
        ]
        self.flight.of_ground = self.context.topic == "ground"
        handlers: dict[str, Callable[[Phrase], None]] = {
            "area": self.place_statements.area,
            "ground": self.place_statements.mention_ground,
            "roads": self.place_statements.mention_roads,
            "when": self._when,
            "standoff": self._standoff,
        }
        reader = next((candidate for candidate, rules in readers if rule in rules), None)
        return handlers[rule] if reader is None else getattr(reader, rule)

    def _of_a_rule_before(self, before: Sequence[Phrase | Word], item: Phrase) -> bool:
        """Whether a group only goes on a rule (`of civilians or aid workers`), so that it is not placed."""
        if item.rule != "group" or item.has("COUNT"):
            return False
        at = next((at for at in reversed(range(len(before))) if isinstance(before[at], Phrase)), None)
        between = before[at + 1 :] if at is not None else ()
        previous = before[at] if at is not None else None
        if not isinstance(previous, Phrase) or not any(_joins(word) for word in between):
            return False
        of_rule = previous.rule == "rule" or (previous.rule == "standoff" and not self.groups.in_sentence)
        if not (of_rule or previous.span in self.context.rule_groups) or not self.references.of_bystanders(
            item
        ):
            return False
        self.context.rule_groups.add(item.span)
        span = between[0].span.joined(item.span)
        self.draft.used_words.append(span)
        self.draft.acknowledge(span)
        return True

    def _word(self, word: Word) -> None:
        kinds = {meaning.kind for meaning in word.meanings}
        if word.text.lower() in ("start", "starts") and self.draft.text.startswith(" to ", word.span.end):
            # `the cars start to drive`.
            return
        subject = self.context.joined or (self.groups.subject if self.groups.in_sentence else [])
        if self.targets.predicated(word, subject):
            self.draft.used_words.append(word.span)
            return
        self.subject_words.change_subject(word, kinds)
        if "FLY" in kinds:
            self.groups.subject_is_mission = True
        if kinds & {"FLY", "HOME", "LIMIT"}:
            self.flight.subject = "drone"
        number = next((meaning.value for meaning in word.meanings if meaning.kind == "REPORTNO"), None)
        if isinstance(number, int):
            self.draft.used_words.append(word.span)
            self.intelligence_reader.count(number)
            return
        if self._is_range_around(word):
            return
        if word.filler or kinds & INSIGNIFICANT_KINDS or word.text.lower() in ARTICLES:
            return
        self.context.has_stranger = True
        self.draft.unread(word.span, "unknown word" if not kinds else "stands by itself", expressible=True)

    def _is_range_around(self, word: Word) -> bool:
        """Read `20 to 40 m` of the group that is spoken of; whether a word is such a range."""
        length = next((meaning.value for meaning in word.meanings if meaning.kind == "LENGTH"), None)
        of_group = self.context.waiting or (self.groups.in_sentence and not self.groups.subject_is_mission)
        if not isinstance(length, Quantity) or length.single or not of_group:
            return False
        self.draft.used_words.append(word.span)
        radius = Phrase("radius", (Part("LENGTH", length, word.span),), word.span)
        self._phrase(radius, joins=False, later=bool(self.context.waiting))
        return True

    def _when(self, phrase: Phrase) -> None:
        time = phrase.first("TIME")
        # `Tip at H+40, 5 min old.`
        if (
            self.intelligence_reader.spoken_of
            and not self.groups.in_sentence
            and time is not None
            and isinstance(time.value, Quantity)
            and _TIP_AT.search(self.draft.text[: phrase.span.end])
        ):
            self.intelligence_reader.field("delivered_s", time.value, phrase.span)
            return
        self.ground.when(phrase, of_ground=self.context.topic == "ground")

    def _standoff(self, phrase: Phrase) -> None:
        if self.groups.in_sentence and self.groups.subject and not self.groups.subject_is_mission:
            read = (
                self.relations.atleast
                if any(map(phrase.first, ("ATLEAST", "APPROACH", "ORMORE")))
                else self.relations.exact
            )
            for group in self.groups.subject:
                read(group, phrase)
            return
        self.rules.standoff(phrase)

    def finish(self) -> None:
        """Read what depends on several parts of the text: start time, ground, roads, routes, report windows,
        the ceiling.
        """
        self.groups.finish()
        self.targets.finish()
        self.events.finish()
        self.intelligence_reader.finish()
        self.weather_reader.finish()
        self.ground.finish()
        self.group_statements.escort.choose(self.places)
        self.roads.finish(self.places.travels)
        self.places.finish(self.roads.laid_out, self.ground.box)
        self.group_statements.escort.finish()
        self.rules.finish()
        fit_defaults(self.draft)


def _is_group(item: Phrase | Word) -> bool:
    return isinstance(item, Phrase) and item.rule == "group"


def _speaks_of_intelligence(item: Phrase | Word) -> bool:
    parts = item.parts if isinstance(item, Phrase) else item.meanings
    return any(not isinstance(part, Phrase) and part.kind in ("INTEL", "KNOWN", "SEEN") for part in parts)


def _of_a_rule(word: Word, rest: Sequence[Phrase | Word]) -> bool:
    """Whether `a target` belongs to a rule (`a target must not be marked`) and so means any target."""
    following = next((item for item in rest if not (isinstance(item, Word) and item.filler)), None)
    targets = any(item.kind == "TARGET" for item in word.meanings)
    return targets and isinstance(following, Phrase) and following.rule == "rule"


def _joins(item: Phrase | Word) -> bool:
    return isinstance(item, Word) and (
        item.comma or any(meaning.kind in ("AND", "OR") for meaning in item.meanings)
    )
