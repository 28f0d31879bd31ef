"""What is said of places: of areas, roads and the drone's home, and where groups stand."""

from __future__ import annotations

import re

from .._draft import Draft
from ..language._phrases import Phrase
from ._ground import KINDS, GroundReader
from ._group_references import GroupReferences
from ._places import PlaceReader, count_places, places_in
from ._roads import RoadReader
from ._sentence_context import SentenceContext
from ._traits import length_of
from ._weather import WeatherReader

MAX_WORDS_TO_DIRECTION = 2
"""Words between a motion and its direction at most. Chosen."""
_START_OF_THE_DRONE = re.compile(
    r"\b(?:take-?off|takes? off|launch\w*|home|lz|start\w*|begins?|base|helipad)\b|\b(?:drone|uav|uas)\s+(?:is|stays|sits|stands)\b",
    re.IGNORECASE,
)
_ROADS = re.compile(
    r"\b(?:\w*roads?|streets?|tracks?|paths?|lanes?|ways?|route|lines?|\w*way)\b", re.IGNORECASE
)
_WINDS = re.compile(r"\b(?:winds?|breezes?|gusts?|blow(?:s|ing)?|gale)\b", re.IGNORECASE)
_RIGHT_AFTER = re.compile(r"[\s,]*(?:\([^()]*\)[\s,]*)?")
_CENTRED = ("centred", "centered", "around", "right around", "exactly around")
RELATIONS_TO_IT = frozenset(["near", "exact", "within", "atleast", "bearing"])
"""Relations to what `it` is, which may be a road."""


class PlaceStatements:
    """Reads phrases that describe ground, a road or the start of the drone, and coordinates of whatever is spoken of."""

    def __init__(
        self,
        draft: Draft,
        references: GroupReferences,
        context: SentenceContext,
        places: PlaceReader,
        ground: GroundReader,
        roads: RoadReader,
        weather_reader: WeatherReader,
    ) -> None:
        self.draft, self.references, self.context = draft, references, context
        self.groups = references.groups
        self.places, self.ground, self.roads, self.weather_reader = places, ground, roads, weather_reader

    def is_of_a_road(self, phrase: Phrase) -> bool:
        """Whether `it` in a phrase is a road, or should be one."""
        of_road = phrase.rule == "road" or (phrase.rule in RELATIONS_TO_IT and self._it_is_a_road(phrase))
        known = self.roads.roads or (self.context.before == "road" and self.roads.known)
        return bool(of_road and (known or phrase.rule == "road"))

    def of_the_road(self, phrase: Phrase) -> Phrase | None:
        """What is said of a place beside `it`, which is a road."""
        if not (self.roads.roads or (self.context.before == "road" and self.roads.known)):
            self.draft.unread(phrase.span, "it is not a road", expressible=True)
        elif phrase.rule == "bearing":
            self.draft.unread(phrase.span, "a SimSpec has no side of a road")
        else:
            return self.roads.as_road_phrase(phrase)
        return None

    def is_of_ground(self, phrase: Phrase) -> bool:
        """Read what is said of ground alone; whether the phrase says nothing else."""
        if (phrase.rule == "midpoint" and self._mid_of_ground(phrase)) or self._centres_ground(phrase):
            return True
        if phrase.rule == "landgap":
            self.ground.mention(phrase).mentioned = True
        if phrase.rule == "inside" and phrase.has("NOFLY", "FENCE"):
            self.mention_ground(phrase)
            return True
        if phrase.rule == "inside" and phrase.has("GROUND", "NAMED"):
            self.ground.mention(phrase)
            self.context.topic = "group"
        return False

    def is_no_motion(self, phrase: Phrase) -> bool:
        """Whether a motion or a direction is that of a road, of ground, of the drone or of nobody."""
        if phrase.rule == "motion" and self.context.topic in ("ground", "road"):
            if self.context.topic == "road" and phrase.has("DIR"):
                # `a road running north-east`.
                self.roads.axis(phrase)
            # `the area runs from ... to`.
            self.draft.acknowledge(phrase.span)
            return True
        if phrase.rule == "travel" and not phrase.has("TOWARDS") and not self._goes_on_a_motion(phrase):
            self.draft.unread(phrase.span, "stands by itself", expressible=True)
            return True
        return phrase.rule == "motion" and not self.groups.in_sentence and self.groups.subject_is_mission

    def is_no_road(self, phrase: Phrase) -> bool:
        """Read `so from the west` of the wind, or list it, where the sentence is about no road; whether it is so."""
        sentence = self.draft.text[self.context.start : phrase.span.start]
        alone = phrase.has("FROM") and not phrase.has("RUNS", "TO", "AXIS")
        if not alone or self.context.topic == "road" or _ROADS.search(sentence):
            return False
        direction = phrase.first("DIR")
        if direction is not None and _WINDS.search(sentence):
            self.weather_reader.direction(direction, phrase.span)
        else:
            self.draft.unread(phrase.span, "it is not said of what", expressible=True)
        return True

    def moves(self, phrase: Phrase) -> bool:
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
        between = self.draft.text[self.context.moved_until : phrase.span.start]
        return (
            self.context.moved_until > self.context.start
            and len(between.split()) <= MAX_WORDS_TO_DIRECTION
            and not {",", ";"}.intersection(between)
        )

    def _mid_of_ground(self, phrase: Phrase) -> bool:
        """Read `centre 250 m north of home` of the ground that the sentence has named; whether it has."""
        place = self.places.place_of(phrase)
        if place is None or not self.ground.named_since(self.context.start):
            return False
        self.ground.middle(place, phrase.span)
        return True

    def _centres_ground(self, phrase: Phrase) -> bool:
        """Read `an area of 400 by 400 m, centred on the launch point`; whether it says that."""
        between = self.draft.text[self.context.sized_until : phrase.span.start]
        words = self.draft.quote(phrase.span).lower()
        beside = _RIGHT_AFTER.fullmatch(between) is not None and self.context.sized_until > self.context.start
        if phrase.rule != "near" or not beside or not words.startswith(_CENTRED):
            return False
        if not words.startswith("cent") and (
            "," in between or not phrase.refs[0].has("HOME", "ORIGIN", "POINT")
        ):
            # `300 by 300 m, around the radar there are five civilians`.
            return False
        for place in self.references.ref(phrase):
            self.ground.middle(place, phrase.span)
        return True

    def _it_is_a_road(self, phrase: Phrase) -> bool:
        """Whether `it` means a road: one was mentioned before the subject, or no group of one member is
        left.
        """
        if self.context.before == "road":
            return True
        if not self.roads.roads or not phrase.refs:
            return False
        single = [
            group
            for group in self.groups.kinds
            if group not in self.groups.counts.plural and group not in self.groups.subject
        ]
        them = phrase.refs[0].first("THEM")
        return them is not None and self.draft.quote(them.span).lower() == "it" and not single

    def about_ground(self, phrase: Phrase) -> bool:
        """Read the phrase if it describes an area or the vehicle's home; whether it did."""
        if self.context.topic == "home" and phrase.rule == "facing":
            self.places.home_heading(phrase)
            return True
        if (
            self.context.topic != "ground"
            or self.ground.current is None
            or self.ground.current is self.ground.world
        ):
            return False
        if phrase.rule in ("near", "within"):
            if phrase.rule == "within":
                self.ground.round(length_of(self.draft, phrase), phrase.span)
            for place in self.references.ref(phrase):
                self.ground.middle(place, phrase.span)
            return True
        return False

    def anchors_the_area(self, phrase: Phrase) -> bool:
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
        if direction is None and self.context.anchored_until > self.context.start:
            # `in the south end, middle`.
            self.draft.acknowledge(phrase.span)
            return True
        self.context.anchored_until = phrase.span.end
        self.ground.anchor(float(value) if isinstance(value, int | float) else None, phrase.span)
        return True

    def is_fence(self, phrase: Phrase) -> bool:
        """Read `the drone stays within 200 m of home`; whether the phrase says that."""
        of_home = phrase.rule == "within" and bool(phrase.refs) and phrase.refs[0].has("HOME", "US")
        if not of_home or not self.groups.subject_is_mission:
            return False
        self.references.ref(phrase)
        self.ground.fence_around_home(length_of(self.draft, phrase), phrase.span)
        return True

    def is_about_the_drone(self) -> bool:
        """Whether the drone is the subject, or nobody, as of an order to the drone."""
        return self.groups.subject_is_mission or not self.groups.in_sentence

    def area(self, phrase: Phrase) -> None:
        """Read the size of an area."""
        if self.groups.in_sentence and not phrase.has(*KINDS):
            # `walks a square of 40 m`.
            self.draft.unread(phrase.span, "the text does not say of what", expressible=True)
            return
        self.ground.area(phrase)
        self.context.sized_until = phrase.span.end
        self.context.topic = self.context.last = self.context.before = "ground"

    def mention_ground(self, phrase: Phrase) -> None:
        """Make the ground that a phrase names what is spoken of."""
        self.ground.mention(phrase)
        self.context.topic = self.context.last = self.context.before = "ground"

    def mention_roads(self, phrase: Phrase) -> None:
        """Make the roads that a phrase names what is spoken of."""
        self.roads.mention(phrase)
        self.context.topic = self.context.last = self.context.before = "road"

    def figures(self, phrase: Phrase, *, later: bool) -> None:
        """Hand coordinates to the reader of the current subject."""
        if phrase.has("HOME", "LAUNCH", "ORIGIN"):
            self.context.topic = "home"
            return
        if self.context.topic == "road":
            self.roads.through(phrase)
        elif phrase.first("CORNERS") or self.context.topic == "ground" or self.places.box(phrase):
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
            self.context.waiting.append(phrase)
        else:
            self._stand(phrase)

    def _is_a_way(self, phrase: Phrase) -> bool:
        """Whether several places are those of a patrol: of somebody who moves, or `from ... to`."""
        moves = any(
            ("actors", group, "motion", "kind") in self.draft.entries for group in self.groups.subject
        )
        return self.groups.in_sentence and (moves or phrase.rule != "place")

    def _stand(self, phrase: Phrase) -> None:
        if not self.groups.in_sentence and self.context.topic != "group":
            self.draft.unread(phrase.span, "the text does not say for whom", expressible=True)
            return
        for group in self.groups.subject:
            place = self.places.place_of(phrase)
            if place is None:
                self.draft.unread(phrase.span, "steps are from home or from the origin", expressible=True)
            else:
                self.places.stand(group, place, phrase.span)
