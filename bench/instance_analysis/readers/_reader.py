"""Reads a text sentence by sentence: tracks the subject and hands each phrase to its reader."""

from __future__ import annotations

import bisect
import re
from collections.abc import Callable, Sequence

from bench.simspec import Role

from .._draft import Draft
from ..language._phrases import Part, Phrase, Quantity
from ..language._sentences import sentences_of
from ..language._tokens import Span, Word
from ..language._vocabulary import MotionWords, Vocabulary
from ..ledger._clauses import is_stop
from ..ledger._ledger import marked
from ._appositions import AppositionReader
from ._escort import EscortReader
from ._events import EventReader
from ._fitting_defaults import fit_defaults
from ._flight import FlightReader
from ._ground import KINDS, GroundReader
from ._groups import GENERIC_PERSONS, GroupRegister
from ._intelligence import IntelligenceReader
from ._places import PlaceReader, count_places, places_in
from ._relations import RelationReader
from ._roads import RoadReader
from ._rules import RuleReader
from ._shares import ShareReader
from ._targets import TargetReader
from ._traits import IMMOVABLE, PERSONS, TraitReader, length_of
from ._unread_subjects import UnreadSubjects
from ._weather import WeatherReader

INSIGNIFICANT_KINDS = frozenset(
    [
        *("OF", "TO", "AT", "FOR", "IN", "AND", "OR", "FROM", "HOME", "THEM"),
        *("COMMA", "DASH", "STOP", "ABOUT", "OVER", "BY", "AWAY", "PART", "FLY", "UNTIL"),
        *("AFTER", "BEFORE", "SQUARE", "DENSITYOF", "KEEP", "AREAWORD", "INTEL", "TARGET", "LBR", "RBR"),
        *("ALONG", "SEEN", "ONAVERAGE", "AGL", "ORIGIN", "LAUNCH", "CORNERS", "ROUTE", "AXIS"),
        *(
            "RUNS",
            "NTH",
            "MIDDLE",
            "CONVOY",
            "US",
            "BODY",
            "NEXTTO",
            "DEEP",
            "GROUND",
            "NAMED",
            "WIDE",
            "OFTHEM",
        ),
    ]
)


MAX_WORDS_TO_DIRECTION = 2
"""Words between a motion and its direction at most. Chosen."""
_START_OF_THE_DRONE = re.compile(
    r"\b(?:take-?off|takes? off|launch\w*|home|lz|start\w*|begins?|base|helipad)\b|\b(?:drone|uav|uas)\s+(?:is|stays|sits|stands)\b",
    re.IGNORECASE,
)
_TIP_AT = re.compile(
    r"\b(?:tip|intel|intelligence|report|sighting|message)\s+(?:at\s+)?(?:[th]\s*[+=]\s*)?\d+\s*(?:s|sec|seconds?|min|minutes?)?$",
    re.IGNORECASE,
)
"""When a report comes in, in as few words as possible."""
_ROADS = re.compile(
    r"\b(?:\w*roads?|streets?|tracks?|paths?|lanes?|ways?|route|lines?|\w*way)\b", re.IGNORECASE
)
_WINDS = re.compile(r"\b(?:winds?|breezes?|gusts?|blow(?:s|ing)?|gale)\b", re.IGNORECASE)
_ABOUT = re.compile(r"\b(?:about|concerns?|concerning|regards?|regarding) (?:an? |the )?$", re.IGNORECASE)
"""What stands between a report and whom it is about."""
_AGE = re.compile(r"[\s-]*(?:years?|yrs?|months?|y/?o|already|o['’]clock)\b", re.IGNORECASE)
"""What makes the number before it an age or an hour."""
_EVERYONE = re.compile(r"\b(?:all|every(?:one|body)|both)\b[^,.;:!?]{0,20}$", re.IGNORECASE)
_NUMBER_ALONE = re.compile(r"\s*(?:$|[.,;:)\n]|x\b|in number\b|in all\b)", re.IGNORECASE)
_PAUSE = re.compile(r"[,:(]\s*(?:about |only |just |say |let us say )?$", re.IGNORECASE)
"""What stands between a noun and its number where the number is added to what is said of them."""
_SAYS_HOW_MANY = re.compile(
    r"\b(?:there (?:are|were|is|was|will be)|(?:are|were) there|of (?:which|whom|them)(?: there)? (?:are|is|were|was)"
    r"|(?:is|are) (?:drawn|sampled|chosen|selected)(?: uniformly)?(?: at random)? from [{\[(]?|number(?:ing| of)|totall?ing|count(?:s|ed|ing)?|how many|in number)[\s:=]*(?:about |only |just |exactly )*$",
    re.IGNORECASE,
)
"""What makes the number after it a number of members."""
_VERB = re.compile(
    r"\b(?:stands?|stood|are|is|were|was|lies?|sits?|waits?|shall|must|remains?|stays?|walks?|drives?|moves?)\b",
    re.IGNORECASE,
)
"""What makes `four rescuers with two dogs stand by the house` a statement about all of them."""
_PLURAL_VERB = re.compile(
    r"\s+(?:are|were|stand|wait|walk|move|drive|patrol|run|sit|lie|stay|remain)\b", re.IGNORECASE
)
_WITH = re.compile(r"\bwith (?:an?|the)? ?$", re.IGNORECASE)
_RIGHT_AFTER = re.compile(r"[\s,]*(?:\([^()]*\)[\s,]*)?")
_CENTRED = ("centred", "centered", "around", "right around", "exactly around")
ARTICLES = ("a", "an", "one", "single", "a single", "another")
POSSESSIVES = ("his", "her", "its", "their")
_LOOKED_FOR = re.compile(
    r"\b(?:(?:look|search|hunt)(?:s|ed|ing|es)?\s+(?:everywhere\s+)?for|find|locate)\s+(?:the\s+|our\s+)?$",
    re.IGNORECASE,
)
"""What makes the person after it the one who is sought."""
RELATIONS_TO_IT = frozenset(["near", "exact", "within", "atleast", "bearing"])
"""Relations to what `it` is, which may be a road."""
GROUP_RULES = RelationReader.RULES | TraitReader.RULES | RoadReader.RULES
UNTOLD_RULES = frozenset(["spread", "group", "clear", "intelligence", "axis", "road"])
"""Phrases that may change nothing: what they say holds already."""
RULES_FOR_ALL_GROUPS = frozenset(["road", "spread"])
"""Relations that are said of every group before them, and not asked."""


class TextReader:
    """Reads the phrases of a text into a draft, sentence by sentence."""

    def __init__(self, draft: Draft, vocabulary: Vocabulary, left_out: Sequence[Span] = ()) -> None:
        self.draft, self.vocabulary = draft, vocabulary
        self.unread = UnreadSubjects(draft.text, left_out)
        self.groups = GroupRegister(draft, vocabulary, self.unread)
        self.joined: list[str] = []
        self.waiting: list[Phrase] = []
        self.topic = ""
        """What places and points are said of: group, home, ground, road; nothing at the beginning of a
        sentence.
        """

        self.last = self.before = ""
        """What was spoken of last, in this sentence or one before; and what before the group that is spoken
        of.
        """

        self.places = PlaceReader(draft, vocabulary.defaults)
        self.weather_reader = WeatherReader(draft, self.places)
        self.ground = GroundReader(draft, vocabulary.defaults, self.places)
        self.shares = ShareReader(self.groups)
        self.roads = RoadReader(draft, vocabulary.defaults, self.ground, self.places)
        self.relations = RelationReader(draft, vocabulary.defaults, self.ground, self.places, self.groups)
        self.traits = TraitReader(draft, self.groups, self.relations.refine)
        self.intelligence_reader = IntelligenceReader(draft, self.groups)
        self.flight = FlightReader(draft, self.groups, self.ground, self.intelligence_reader)
        self.events = EventReader(draft, self.groups, self.intelligence_reader)
        self.rules = RuleReader(draft, self.groups)
        self.escort = EscortReader(draft, self.groups)
        self.targets = TargetReader(draft, self.groups)
        self.appositions = AppositionReader(draft, self.groups, self.unread)

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
        self.groups.in_sentence, self.groups.mentioned, self.joined, self.waiting, self.topic = (
            False,
            [],
            [],
            [],
            "",
        )
        self.flight.subject = ""
        begins = bisect.bisect_right(self._stops, sentence[0].span.start) - 1
        self._sentence_start, self._sized_until = self._stops[begins], 0
        """Where the sentence begins, and where it has last given the size of an area."""
        self._stranger = False
        """Whether this sentence has spoken of something else, which may be its subject."""
        self._rule_groups: set[Span] = set()
        self._just_named: list[str] = []
        self._named_until = self._moved_until = self._anchored_until = 0
        self.intelligence_reader.begin_sentence(spoken_of=any(map(_speaks_of_intelligence, sentence)))
        self.flight.reporting = any(
            isinstance(item, Word) and item.text.lower().startswith("report") for item in sentence
        )
        joins = False
        self._company: list[str] = []
        """The groups before and after `with`: `four rescuers with two dogs`."""
        for index, item in enumerate(sentence):
            if isinstance(item, Word):
                if item.text.lower() == "with" and index and _is_group(sentence[index - 1]):
                    self._company = [*self.groups.subject]
                # After a comma, `and` begins another clause.
                joins = (not item.comma and any(m.kind == "AND" for m in item.meanings)) or (
                    joins and (item.filler or item.text.lower() in POSSESSIVES)
                )
                self._relative(item, sentence[:index])
                late = self._late_count(item, sentence[index - 1] if index else None)
                if not late and not _of_a_rule(item, sentence[index + 1 :]):
                    self._word(item)
                continue
            if self._of_a_rule_before(sentence[:index], item):
                continue
            later = any(isinstance(p, Phrase) and p.rule == "group" for p in sentence[index + 1 :])
            if later and item.rule in GROUP_RULES and self._of_the_next(item, sentence[index + 1 :]):
                self.waiting.append(item)
                joins = False
                continue
            self._phrase(item, joins=joins, later=later)
            joins = False
        for waiting in self.waiting:
            self._of_group(waiting)

    def _of_the_next(self, phrase: Phrase, rest: Sequence[Phrase | Word]) -> bool:
        """Whether a relation belongs to the next group: `a truck and, 60 m from it, six civilians`; `, in
        sector B a car`.
        """
        before = self.draft.text[: phrase.span.start].lower().rstrip().removesuffix(" some")
        words = before.split()
        if phrase.refs and phrase.refs[0].first("THEM") and words and words[-1].strip(",") in ("and", "plus"):
            return True
        if self.waiting:
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
                self._counts_again(phrase)
                or self._is_walked_around(phrase)
                or self._is_in_brackets_of_unread(phrase)
                or self.appositions.goes_on(phrase)
                or (not joins and not self.waiting and self._is_apposed(phrase))
            ):
                self._introduce(phrase, joins=joins)
        elif phrase.rule in ("share", "rest"):
            read = getattr(self.shares, phrase.rule)(phrase)
            self.groups.in_sentence, self.topic, self.joined, self._just_named = read, "group", [], []
        elif phrase.rule == "axis" and self._is_no_road(phrase):
            pass
        elif not (phrase.rule == "axis" and self.topic == "group" and self._moves(phrase)):
            self._statement(phrase, later=later)

    def _is_apposed(self, phrase: Phrase) -> bool:
        """Whether a noun names the person before it once more, so that what follows is said of that person."""
        apposed = self.appositions.read(phrase)
        if apposed:
            self.targets.introduced(self.groups.subject, phrase)
        return apposed

    def _introduce(self, phrase: Phrase, *, joins: bool) -> None:
        """Make the group that a phrase names the subject, and read what was waiting for it."""
        self.flight.subject, self._just_named = "group", []
        previous = self.joined if joins else []
        self.groups.introduce(phrase)
        self._seek(self.groups.subject, phrase.span)
        self.targets.introduced(self.groups.subject, phrase)
        accompanies = len(self._company) == 1 and _WITH.search(self.draft.text[: phrase.span.start])
        self._company = [*self._company, *self.groups.subject] if accompanies else []
        if _ABOUT.search(self.draft.text[: phrase.span.start]):
            self.intelligence_reader.about(self.groups.subject, phrase.span)
        self.before, self.topic, self.last = self.last, "group", "group"
        self.joined = [*previous, *self.groups.subject]
        for waiting in self.waiting:
            unread = self.unread.since(self._sentence_start, waiting.span.start, subjects=True)
            trait = waiting.rule in TraitReader.RULES
            if unread is None or self._is_said_of(self.groups.subject, waiting, first=not trait):
                self._of_group(waiting)
        self.waiting = []

    def _statement(self, phrase: Phrase, *, later: bool) -> None:
        """Read what is said of a group, or of anything else."""
        known = set(self.groups.kinds)
        about = self._about_groups(phrase)
        if about is not None:
            if (self.waiting or not self.groups.in_sentence) and later and about.rule != "density":
                self.waiting.append(about)
                return
            self._of_group(about)
            self._note_named(about, known)
        elif phrase.rule in ("place", "stretch") or (phrase.rule == "between" and count_places(phrase) == 2):
            self._figures(phrase, later=later)
        elif phrase.rule not in GROUP_RULES:
            self._stranger = self._stranger or phrase.rule in FlightReader.RULES
            if phrase.rule in ("extent", "overfly", "stayin"):
                self.topic = self.last = self.before = "ground"
            self._handler(phrase.rule)(phrase)
            if phrase.rule == "extent":
                self._sized_until = phrase.span.end
        self.joined = []

    def _seek(self, groups: Sequence[str], span: Span) -> None:
        """Make the persons sought of whom the text says that somebody looks for them."""
        match = _LOOKED_FOR.search(self.draft.text[: span.start])
        for group in groups if match else ():
            if match and self.groups.asset(group) in PERSONS and self.groups.role(group) is Role.BYSTANDER:
                self.groups.seek(group, Span(match.start(), span.end))

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

    def _counts_again(self, phrase: Phrase) -> bool:
        """`the aid workers, seven persons`: whether a phrase gives the number of the group just named."""
        count, asset = phrase.first("COUNT"), phrase.first("ASSET")
        before = self.draft.text[: phrase.span.start].rstrip()
        if count is None or asset is None or len(phrase.parts) > 2 or not before.endswith((",", "(", ":")):
            return False
        generic = self.draft.quote(asset.span).lower() in GENERIC_PERSONS
        named = self.groups.subject if self.groups.in_sentence and not self.waiting else []
        if not generic or len(named) != 1 or not isinstance(count.value, Quantity):
            return False
        person = self.groups.asset(named[0]) in PERSONS
        return person and self.groups.count_later(named[0], count.value, phrase.span)

    def _is_walked_around(self, phrase: Phrase) -> bool:
        """Whether a group is what the subject moves around, as in `ten people walk around the house`."""
        between = self.draft.text[self._moved_until : phrase.span.start]
        around = self.draft.text[: self._moved_until].lower().endswith((" around", " past", " through"))
        alone = not phrase.has("COUNT", "NONE") and between.strip().lower() in ("", "the")
        if not (around and alone and self._moved_until > self._sentence_start and self.groups.in_sentence):
            return False
        subject = self.groups.subject
        self.groups.named(phrase)
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
        if it and self._is_of_a_road(phrase):
            return self._of_the_road(phrase)
        ground = self.before == "ground" and self.ground.current not in (None, self.ground.world)
        if it and ground and phrase.rule == "inside":
            return Phrase("inside", (), phrase.span)
        if phrase.rule == "area" and (phrase.first("IN") or phrase.first("INSIDE")):
            self.ground.area(phrase)
            self._sized_until = phrase.span.end
            named = phrase.first("GROUND") or phrase.first("NAMED")
            return Phrase("inside", (named,), phrase.span) if named else Phrase("spread", (), phrase.span)
        if self._is_of_ground(phrase) or self._is_no_motion(phrase):
            return None
        if phrase.rule not in GROUP_RULES or self._about_ground(phrase) or count_places(phrase) > 1:
            return None
        return phrase

    def _is_of_a_road(self, phrase: Phrase) -> bool:
        """Whether `it` in a phrase is a road, or should be one."""
        of_road = phrase.rule == "road" or (phrase.rule in RELATIONS_TO_IT and self._it_is_a_road(phrase))
        known = self.roads.roads or (self.before == "road" and self.roads.known)
        return bool(of_road and (known or phrase.rule == "road"))

    def _of_the_road(self, phrase: Phrase) -> Phrase | None:
        """What is said of a place beside `it`, which is a road."""
        if not (self.roads.roads or (self.before == "road" and self.roads.known)):
            self.draft.unread(phrase.span, "it is not a road", expressible=True)
        elif phrase.rule == "bearing":
            self.draft.unread(phrase.span, "a SimSpec has no side of a road")
        else:
            return self.roads.as_road_phrase(phrase)
        return None

    def _is_of_ground(self, phrase: Phrase) -> bool:
        """Read what is said of ground alone; whether the phrase says nothing else."""
        if (phrase.rule == "midpoint" and self._mid_of_ground(phrase)) or self._centres_ground(phrase):
            return True
        if phrase.rule == "landgap":
            self.ground.mention(phrase).mentioned = True
        if phrase.rule == "inside" and phrase.has("NOFLY", "FENCE"):
            self._ground(phrase)
            return True
        if phrase.rule == "inside" and phrase.has("GROUND", "NAMED"):
            self.ground.mention(phrase)
            self.topic = "group"
        return False

    def _is_no_motion(self, phrase: Phrase) -> bool:
        """Whether a motion or a direction is that of a road, of ground, of the drone or of nobody."""
        if phrase.rule == "motion" and self.topic in ("ground", "road"):
            if self.topic == "road" and phrase.has("DIR"):
                # `a road running north-east`.
                self.roads.axis(phrase)
            # `the area runs from ... to`.
            self.draft.acknowledge(phrase.span)
            return True
        if phrase.rule == "travel" and not phrase.has("TOWARDS") and not self._goes_on_a_motion(phrase):
            self.draft.unread(phrase.span, "stands by itself", expressible=True)
            return True
        return phrase.rule == "motion" and not self.groups.in_sentence and self.groups.subject_is_mission

    def _is_no_road(self, phrase: Phrase) -> bool:
        """Read `so from the west` of the wind, or list it, where the sentence is about no road; whether it is so."""
        sentence = self.draft.text[self._sentence_start : phrase.span.start]
        alone = phrase.has("FROM") and not phrase.has("RUNS", "TO", "AXIS")
        if not alone or self.topic == "road" or _ROADS.search(sentence):
            return False
        direction = phrase.first("DIR")
        if direction is not None and _WINDS.search(sentence):
            self.weather_reader.direction(direction, phrase.span)
        else:
            self.draft.unread(phrase.span, "it is not said of what", expressible=True)
        return True

    def _moves(self, phrase: Phrase) -> bool:
        """Read `from west to east` of groups that travel; whether the subject does."""
        words = self.draft.quote(phrase.span).lower().replace("-", " ").split()
        subject = self.groups.subject if self.groups.in_sentence else []
        direction = next(
            (m.value for m in self.groups.vocabulary.meanings[words[-1]] if m.kind == "DIR"), None
        )
        patrols = all(self.places.patrols(group) for group in subject)
        if not subject or not patrols or not isinstance(direction, int | float):
            return False
        for group in subject:
            self.places.travel(group, float(direction), phrase.span)
        return True

    def _goes_on_a_motion(self, phrase: Phrase) -> bool:
        """Whether a direction alone says where somebody moves: `walks slowly north`."""
        between = self.draft.text[self._moved_until : phrase.span.start]
        return (
            self._moved_until > self._sentence_start
            and len(between.split()) <= MAX_WORDS_TO_DIRECTION
            and not {",", ";"}.intersection(between)
        )

    def _mid_of_ground(self, phrase: Phrase) -> bool:
        """Read `centre 250 m north of home` of the ground that the sentence has named; whether it has."""
        place = self.places.place_of(phrase)
        if place is None or not self.ground.named_since(self._sentence_start):
            return False
        self.ground.middle(place, phrase.span)
        return True

    def _centres_ground(self, phrase: Phrase) -> bool:
        """Read `an area of 400 by 400 m, centred on the launch point`; whether it says that."""
        between = self.draft.text[self._sized_until : phrase.span.start]
        words = self.draft.quote(phrase.span).lower()
        beside = _RIGHT_AFTER.fullmatch(between) is not None and self._sized_until > self._sentence_start
        if phrase.rule != "near" or not beside or not words.startswith(_CENTRED):
            return False
        if not words.startswith("cent") and (
            "," in between or not phrase.refs[0].has("HOME", "ORIGIN", "POINT")
        ):
            # `300 by 300 m, around the radar there are five civilians`.
            return False
        for place in self.groups.ref(phrase):
            self.ground.middle(place, phrase.span)
        return True

    def _it_is_a_road(self, phrase: Phrase) -> bool:
        """Whether `it` means a road: one was mentioned before the subject, or no group of one member is
        left.
        """
        if self.before == "road":
            return True
        if not self.roads.roads or not phrase.refs:
            return False
        single = [
            group
            for group in self.groups.kinds
            if group not in self.groups.plural and group not in self.groups.subject
        ]
        them = phrase.refs[0].first("THEM")
        return them is not None and self.draft.quote(them.span).lower() == "it" and not single

    def _about_ground(self, phrase: Phrase) -> bool:
        """Read the phrase if it describes an area or the vehicle's home; whether it did."""
        if self.topic == "home" and phrase.rule == "facing":
            self.places.home_heading(phrase)
            return True
        if self.topic != "ground" or self.ground.current is None or self.ground.current is self.ground.world:
            return False
        if phrase.rule in ("near", "within"):
            if phrase.rule == "within":
                self.ground.round(length_of(self.draft, phrase), phrase.span)
            for place in self.groups.ref(phrase):
                self.ground.middle(place, phrase.span)
            return True
        return False

    def _figures(self, phrase: Phrase, *, later: bool) -> None:
        """Hand coordinates to the reader of the current subject."""
        if phrase.has("HOME", "LAUNCH", "ORIGIN"):
            self.topic = "home"
            return
        if self.topic == "road":
            self.roads.through(phrase)
        elif phrase.first("CORNERS") or self.topic == "ground" or self.places.box(phrase):
            self.ground.corners(phrase)
        else:
            self._figures_of_groups(phrase, later=later)

    def _figures_of_groups(self, phrase: Phrase, *, later: bool) -> None:
        several = count_places(phrase)
        if phrase.first("ROUTE") or (several > 1 and self._is_a_way(phrase)):
            for group in self.groups.subject:
                self.places.walk(group, places_in(phrase), phrase.span)
        elif several > 1 and self.groups.in_sentence:
            self.draft.unread(
                phrase.span, "one place can be given: make each member a group of its own", expressible=True
            )
        elif several > 2:
            self.ground.corners(phrase)
        elif later and not self.groups.in_sentence:
            self.waiting.append(phrase)
        else:
            self._stand(phrase)

    def _is_a_way(self, phrase: Phrase) -> bool:
        """Whether several places are those of a patrol: of somebody who moves, or `from ... to`."""
        moves = any(
            ("actors", group, "motion", "kind") in self.draft.entries for group in self.groups.subject
        )
        return self.groups.in_sentence and (moves or phrase.rule != "place")

    def _stand(self, phrase: Phrase) -> None:
        if not self.groups.in_sentence and self.topic != "group":
            self.draft.unread(phrase.span, "the text does not say for whom", expressible=True)
            return
        for group in self.groups.subject:
            place = self.places.place_of(phrase)
            if place is None:
                self.draft.unread(phrase.span, "steps are from home or from the origin", expressible=True)
            else:
                self.places.stand(group, place, phrase.span)

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
        self.flight.of_ground = self.topic == "ground"
        reader = next((candidate for candidate, rules in readers if rule in rules), None)
        handler: Callable[[Phrase], None] = (
            getattr(self, f"_{rule}") if reader is None else getattr(reader, rule)
        )
        return handler

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
        if not (of_rule or previous.span in self._rule_groups) or not self.groups.of_bystanders(item):
            return False
        self._rule_groups.add(item.span)
        span = between[0].span.joined(item.span)
        self.draft.used_words.append(span)
        self.draft.acknowledge(span)
        return True

    def _relative(self, word: Word, before: Sequence[Phrase | Word]) -> None:
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
            self.joined = []
        elif last.rule in RoadReader.RULES:
            self.topic = "road"
        elif last.refs:
            groups = [
                group
                for group in self.groups.referents.get(last.refs[-1].span, [])
                if group in self.groups.kinds
            ]
            if groups:
                self.groups.subject, self.groups.in_sentence, self.joined = (
                    [str(group) for group in groups],
                    True,
                    [],
                )
                self.topic = "group"

    def _late_count(self, word: Word, before: Phrase | Word | None) -> bool:
        """Use a number on its own as the number of the subject: `soldiers: 4`, `there are two`."""
        count = next((meaning.value for meaning in word.meanings if meaning.kind == "COUNT"), None)
        of_them = re.match(r"\s+of (?:them|these|those)\b", self.draft.text[word.span.end :], re.IGNORECASE)
        spoken_of = (self.groups.in_sentence or of_them) and len(self.groups.subject) == 1
        if not isinstance(count, Quantity) or not spoken_of or self.topic in ("road", "home"):
            return False
        if not of_them and not self._counts_the_subject(word.span):
            return False
        start = before.span if isinstance(before, Phrase) and before.rule == "group" else word.span
        if not self.groups.count_later(self.groups.subject[0], count, start.joined(word.span)):
            return False
        # `there are 20 of them`, `of which there are 20`: the words around the number are read with it.
        text = self.draft.text
        preceding = re.search(
            r"\b(?:of|among) (?:which|whom|them) (?:there )?(?:are|is|were|was) $",
            text[: word.span.start],
            re.I,
        )
        start_at = preceding.start() if preceding else word.span.start
        self.draft.used_words.append(Span(start_at, word.span.end + (of_them.end() if of_them else 0)))
        return True

    def _counts_the_subject(self, number: Span) -> bool:
        """Whether a number after a noun says how many there are: `soldiers: 4`, `there are two`, `trucks, 2 of them`.

        `House number 12`, `the girl is six`, `she has 9 years` name, age and measure: only a plural is counted,
        and nothing but a stop mark may stand between it and its number, or the words that say that it counts.
        """
        group = self.groups.subject[0]
        text = self.draft.text
        if _AGE.match(text, number.end) or text.startswith(" of ", number.end):
            return False
        if _SAYS_HOW_MANY.search(text[: number.start]):
            return True
        entry = self.draft.entries.get(("actors", group, "id"))
        if entry is None or entry.span is None:
            return False
        between = text[entry.span.end : number.start]
        if re.search(r"\d|[(,]\s*(?:was|were)\b", between):
            # `the number of kids to 4 (was 6)`.
            return False
        if group not in self.groups.plural:
            # `truck: 2`, and `radar 1`, which is no name of it.
            return between.strip(" :=x") == "" and (":" in between or text[number.start : number.end] == "1")
        alone = _NUMBER_ALONE.match(text, number.end) is not None
        which_are = self.groups.kinds[group] not in PERSONS and re.search(r"\bwhich are $", between)
        return between.strip(" ,:(=x-\t\n") == "" or (
            alone and (_PAUSE.search(between) or which_are) is not None
        )

    def _word(self, word: Word) -> None:
        kinds = {meaning.kind for meaning in word.meanings}
        if word.text.lower() in ("start", "starts") and self.draft.text.startswith(" to ", word.span.end):
            # `the cars start to drive`.
            return
        self._change_subject(word, kinds)
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
        self._stranger = True
        self.draft.unread(word.span, "unknown word" if not kinds else "stands by itself", expressible=True)

    def _change_subject(self, word: Word, kinds: set[str]) -> None:
        """Make what a word means the subject: the drone, a road or ground, or groups."""
        groups = self.groups
        if kinds & {"HOME", "LAUNCH"}:
            if word.text.lower().startswith("the vehicle "):
                self.draft.remark(word.span, "the vehicle is read as the drone under test")
            groups.in_sentence, groups.subject_is_mission, groups.subject = False, True, []
            self.topic = "home"
        elif "THEM" in kinds and self.topic == "" and self.last in ("ground", "road"):
            self.topic = self.last
        elif "THEM" in kinds and _LOOKED_FOR.search(self.draft.text[: word.span.start]):
            self._seek(groups.them(word.span), word.span)
        elif "THEM" in kinds and groups.subject:
            groups.them_as_subject(word.span)
            groups.in_sentence, self.topic = True, "group"
        elif "CONVOY" in kinds and groups.convoys:
            groups.make_subject(groups.convoys)
            self.topic = self.flight.subject = "group"
        elif "TARGET" in kinds and (targets := self._targets_called(word)):
            groups.make_subject(groups.choose_one(targets, word.span))
            self.topic = "group"

    def _targets_called(self, word: Word) -> list[str]:
        """The targets of the text, after the word that may have called the subject so."""
        self.targets.called(word, self.joined or (self.groups.subject if self.groups.in_sentence else []))
        return self.groups.targets()

    def _is_range_around(self, word: Word) -> bool:
        """Read `20 to 40 m` of the group that is spoken of; whether a word is such a range."""
        length = next((meaning.value for meaning in word.meanings if meaning.kind == "LENGTH"), None)
        of_group = self.waiting or (self.groups.in_sentence and not self.groups.subject_is_mission)
        if not isinstance(length, Quantity) or length.single or not of_group:
            return False
        self.draft.used_words.append(word.span)
        radius = Phrase("radius", (Part("LENGTH", length, word.span),), word.span)
        self._phrase(radius, joins=False, later=bool(self.waiting))
        return True

    # What is said of a group.

    def _of_group(self, phrase: Phrase) -> None:
        if phrase.rule in ("place", "stretch") or count_places(phrase) > 1:
            self._figures(phrase, later=False)
            return
        if self._is_of_the_drone(phrase):
            return
        for group in self._subject_of(phrase):
            if phrase.rule == "motion" and self._cannot_move(group, phrase):
                self.draft.unread(
                    phrase.span, f"a {self.groups.kinds[group]} does not move", expressible=True
                )
                continue
            reader = next(
                item for item in (self.relations, self.traits, self.roads) if phrase.rule in item.RULES
            )
            getattr(reader, phrase.rule)(group, phrase)
            if phrase.rule in ("motion", "travel"):
                self._patrols(group, phrase)
                self._moved_until = phrase.span.end

    def _is_of_the_drone(self, phrase: Phrase) -> bool:
        """Read what is said of the escort, the fence and the place of the start; whether a phrase is that."""
        if self.groups.in_sentence and self.escort.read_passive(phrase):
            return True
        if self._of_the_drone() and (self._is_fence(phrase) or self.escort.read(phrase)):
            return True
        return phrase.rule == "part" and not self.groups.in_sentence and self._anchors_the_area(phrase)

    def _subject_of(self, phrase: Phrase) -> list[str]:
        """The groups that a phrase describes; none where the text does not say, or that needs no field."""
        subject = self._everyone(self.groups.subject, phrase)
        if not subject:
            if phrase.rule != "spread" and not (phrase.rule == "inside" and not phrase.refs):
                self.draft.unread(phrase.span, "the text does not say for whom", expressible=True)
                for item in phrase.refs:
                    # A group that is named exists, even if the statement about it cannot be read.
                    self.groups.ref(item)
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
        if len(self._company) > 1 and self._is_predicate(phrase):
            members = [self._company, self._company[:1], self._company[1:]]
            names = [", ".join(groups) for groups in members]
            subject = self._not_itself(members[self.draft.ask(phrase.span, question, names)], phrase)
        joined = self._not_itself(self.joined, phrase)
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
        return [group for group in groups if not phrase.refs or group not in self.groups.ref(phrase)]

    def _anchors_the_area(self, phrase: Phrase) -> bool:
        """Read `its south-west corner being the take-off point`, `we launch from its middle`; whether it is that."""
        text = self.draft.text
        begin = max(text.rfind(mark, 0, phrase.span.start) for mark in ",;.\n(")
        end = min(
            at for mark in ",;.\n)" if (at := text.find(mark, phrase.span.end)) >= 0 or (at := len(text))
        )
        if not self.ground.world.size_m or not _START_OF_THE_DRONE.search(text[begin + 1 : end]):
            return False
        direction = phrase.first("DIR")
        value = direction.value if direction is not None else None
        if direction is None and self._anchored_until > self._sentence_start:
            # `in the south end, middle`.
            self.draft.acknowledge(phrase.span)
            return True
        self._anchored_until = phrase.span.end
        self.ground.anchor(float(value) if isinstance(value, int | float) else None, phrase.span)
        return True

    def _is_fence(self, phrase: Phrase) -> bool:
        """Read `the drone stays within 200 m of home`; whether the phrase says that."""
        of_home = phrase.rule == "within" and bool(phrase.refs) and phrase.refs[0].has("HOME", "US")
        if not of_home or not self.groups.subject_is_mission:
            return False
        self.groups.ref(phrase)
        self.ground.fence_around_home(length_of(self.draft, phrase), phrase.span)
        return True

    def _of_the_drone(self) -> bool:
        """Whether the drone is the subject, or nobody, as of an order to the drone."""
        return self.groups.subject_is_mission or not self.groups.in_sentence

    def _everyone(self, subject: list[str], phrase: Phrase) -> list[str]:
        """All parts of a divided group after `everyone` and `all`, and what was the subject else."""
        family = self.groups.family(subject[-1]) if subject else []
        if len(family) > 1 and _EVERYONE.search(self.draft.text[: phrase.span.start]):
            return family
        return subject

    def _cannot_move(self, group: str, phrase: Phrase) -> bool:
        motion = phrase.first("MOTION")
        moves = motion is not None and isinstance(motion.value, MotionWords) and motion.value.kind != "still"
        return moves and self.groups.asset(group) in IMMOVABLE

    def _is_plural_verb(self, last: str, phrase: Phrase) -> bool:
        """Whether the verb after the last group, which has one member, is that of several."""
        entry = self.draft.entries.get(("actors", last, "id"))
        if last in self.groups.plural or entry is None or entry.span is None:
            return False
        return _PLURAL_VERB.match(self.draft.text, entry.span.end, phrase.span.end) is not None

    def _is_predicate(self, phrase: Phrase) -> bool:
        """Whether a verb stands between the groups of the sentence and what is said of them."""
        entry = self.draft.entries.get(("actors", self._company[-1], "id"))
        start = entry.span.end if entry is not None and entry.span is not None else phrase.span.start
        return _VERB.search(self.draft.text, start, phrase.span.end) is not None

    def _described(self, subject: list[str], phrase: Phrase) -> list[str]:
        """The groups that a phrase describes after a relation to another group that the sentence has just named.

        `soldiers guard a truck parked on the road`: what follows without a comma is nearer to the truck. Either
        way it is a choice, because a sentence does not tell.
        """
        others = [group for group in self._just_named if group not in subject]
        between = self.draft.text[self._named_until : phrase.span.start]
        if not others or phrase.span.start < self._named_until or " and " in between:
            return subject
        candidates = [subject, others] if "," in between else [others, subject]
        readings = [", ".join(groups) for groups in candidates]
        return candidates[self.draft.ask(phrase.span, "of which is this said?", readings)]

    def _note_named(self, phrase: Phrase, known: set[str]) -> None:
        """Note the groups that a relation has named for the first time."""
        named = [group for group in self.groups.kinds if group not in known]
        if named and phrase.refs:
            self._just_named, self._named_until = named, phrase.span.end

    def _still_about(self, subject: Sequence[str], phrase: Phrase) -> bool:
        """Whether a sentence without a subject is about the groups of the sentence before it."""
        answers = [(", ".join(subject), True), ("nobody: leave it out", False)]
        if self._stranger:
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
        begin = self._sentence_start if self.unread.is_object(mention) else mention.end
        if self.unread.since(begin, phrase.span.start, subjects=True) is None:
            return True
        return self._is_said_of(subject, phrase, first=True)

    def _is_said_of(self, subject: Sequence[str], phrase: Phrase, *, first: bool) -> bool:
        """Ask whether a phrase is about a group or about something unread; without an answer the former if `first`."""
        answers = [(", ".join(subject), True), ("what is not read: leave it out", False)]
        if not first:
            answers.reverse()
        if answers[self.draft.ask(phrase.span, "of whom is this said?", [name for name, _ in answers])][1]:
            return True
        self.draft.unread(phrase.span, "it is said of something that is not read", expressible=True)
        return False

    def _patrols(self, group: str, phrase: Phrase) -> None:
        motion, direction = phrase.first("MOTION"), phrase.first("DIR")
        if motion is not None and isinstance(motion.value, MotionWords) and motion.value.patrol:
            self.places.patrol(group, phrase.span)
        if direction is not None and isinstance(direction.value, int | float):
            self.places.travel(group, float(direction.value), phrase.span)

    # What is said of the rest.

    def _area(self, phrase: Phrase) -> None:
        if self.groups.in_sentence and not phrase.has(*KINDS):
            # `walks a square of 40 m`.
            self.draft.unread(phrase.span, "the text does not say of what", expressible=True)
            return
        self.ground.area(phrase)
        self._sized_until = phrase.span.end
        self.topic = self.last = self.before = "ground"

    def _ground(self, phrase: Phrase) -> None:
        self.ground.mention(phrase)
        self.topic = self.last = self.before = "ground"

    def _roads(self, phrase: Phrase) -> None:
        self.roads.mention(phrase)
        self.topic = self.last = self.before = "road"

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
        self.ground.when(phrase, of_ground=self.topic == "ground")

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

    # At the end, when everything is known.

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
        self.roads.finish(self.places.travels)
        self.places.finish(self.roads.laid_out, self.ground.box)
        self.escort.finish()
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
