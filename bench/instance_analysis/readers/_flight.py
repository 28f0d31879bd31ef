"""Reads phrases about the flight: height, speed, time, and other numbers beside a word of the vocabulary."""

from __future__ import annotations

import re

from .._draft import Draft
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span
from ..language._vocabulary import FieldWords, SetWords
from ._ground import GroundReader
from ._groups import GroupRegister
from ._intelligence import IntelligenceReader
from ._rules import UNIT_NAMES
from ._traits import IMMOVABLE, length_of, put_speed

UNITS = {
    "LENGTH": {"m": 1.0, "ft": 0.3048},
    "SPEED": {"m/s": 1.0, "km/h": 1 / 3.6, "knots": 0.514444},
    "TIME": {"s": 1.0, "min": 60.0},
}
WRITTEN = {
    "LENGTH": {"m": "m|metres?|meters?|km", "ft": "ft|feet|yards?|miles?"},
    "SPEED": {"m/s": "m/s|mps|met(?:re|er)s per second", "km/h": "km/h|kph", "knots": "knots|kts?|mph"},
}
"""How units are written behind a number."""
BOUNDS = {
    "mission.altitude_m": {"WITHIN": "max_altitude_m", "ATLEAST": "min_altitude_m"},
    "mission.speed_mps": {"WITHIN": "max_speed_mps"},
}
LIMITS = ("time_limit_s", "report_deadline_s", "max_altitude_m", "max_speed_mps")

_TOLD = re.compile(
    r"\b(?:operator|pilot|he|she|they|we|control)\s+(?:says?|said|tells?|told|asks?|asked|orders?|ordered)\b[^.;!?\n]*$",
    re.IGNORECASE,
)
"""What makes `come back` an order at some time."""


_PACE = re.compile(
    r"\b(?:walking|running|driving|marching|cycling|riding|jogging)[\s-]+(?:speed|pace)\b", re.IGNORECASE
)
"""A speed of somebody on the ground."""
_OF_THE_DRONE = re.compile(
    r"\b(?:drone|uav|uas|aircraft|quad\w*|agent|mission|fl(?:y|ies|ying|ight|t)|search\w*|cruis\w*|altitude|height|alt|ground\s?speed|airspeed)\b",
    re.IGNORECASE,
)
"""What makes a speed after it the drone's."""
_COMPARISON = re.compile(
    r"(?P<negation>\b(?:not|never|no|cannot|(?:\w+n['’]t))\b(?:\s+(?!above\b|below\b|under\b|over\b)\w+){0,3}?\s+)?"
    r"(?:(?P<much>(?:more(?:\s+\w+)?|higher|faster|quicker|greater)\s+(?:than|as)|above|over|beyond|exceeding)"
    r"|(?P<little>(?:less(?:\s+\w+)?|lower|slower|smaller)\s+(?:than|as)|below|under))\s+(?:about\s+)?$",
    re.IGNORECASE,
)
"""What makes the number after it a bound: `always more high than 30 m`."""


class FlightReader:
    """Reads numbers and settings into a draft.

    Each rule of the grammar is read by the method with its name.
    """

    RULES = frozenset(["field", "altitude", "speed", "limit", "set"])

    def __init__(
        self, draft: Draft, cast: GroupRegister, ground: GroundReader, reports: IntelligenceReader
    ) -> None:
        self._draft, self._groups, self._ground, self._intelligence = draft, cast, ground, reports
        self.subject = ""
        """What the sentence has spoken of last: the drone, a group, or nothing yet."""
        self.reporting = False
        """Whether the sentence is about reports."""
        self.of_ground = False
        """Whether a piece of ground is spoken of, whose radius a radius is."""

    def field(self, phrase: Phrase) -> None:
        word = phrase.first("FIELD")
        given = next(
            part.value for part in phrase.parts if isinstance(part, Part) and isinstance(part.value, Quantity)
        )
        assert word is not None
        assert isinstance(word.value, tuple)
        assert isinstance(given, Quantity)
        fields = [words for words in word.value if isinstance(words, FieldWords)]
        fitting = [words for words in fields if _fits(words, given)]
        if fitting:
            self._field(fitting[0], given, phrase, word.span)
        elif given.kind == "COUNT":
            self._without_unit(fields[0], given, phrase, word.span)
        else:
            wanted = " or ".join(sorted({f"{words.path} is a {words.kind.lower()}" for words in fields}))
            self._draft.fault(
                phrase.span, f"{wanted}, not a {given.kind.lower()}", "give it in a unit that fits"
            )

    def _without_unit(self, field: FieldWords, number: Quantity, phrase: Phrase, word: Span) -> None:
        """Read a number in the unit of all others, or in the one that a choice names."""
        if field.kind in ("ANGLE", "PERCENT"):
            self._plain_number(field, number, phrase)
            return
        units = UNITS.get(field.kind)
        if units is None:
            self._draft.fault(phrase.span, f"{field.path} takes a number with a unit", "write its unit")
            return
        unit = self._usual_unit(field.kind, phrase.span)
        unit = unit or [*units][self._draft.ask(phrase.span, "in which unit?", [*units])]
        low, high = (round(end * units[unit], 6) for end in (number.low, number.high))
        self._field(field, Quantity(field.kind, low, high), phrase, word)

    def _field(self, field: FieldWords, quantity: Quantity, phrase: Phrase, word: Span) -> None:
        """Set a field, or what its word means of ground, of a report, of the wind or of a group."""
        if field.path == "intelligence.uncertainty_m" and self.of_ground and not self._intelligence.spoken_of:
            self._ground.round(quantity, phrase.span)
        elif field.path.startswith("intelligence."):
            self._intelligence.field(field.path.split(".")[1], quantity, phrase.span)
        elif field.kind == "SPEED" and self._of_the_wind(word):
            self._draft.unread(phrase.span, "it is said of the wind", expressible=True)
        elif field.path == "mission.speed_mps" and _PACE.search(self._clause_up_to(phrase.span)):
            self._pace(quantity, phrase)
        elif self._bounds(field, phrase) or self._compares(field.path, phrase):
            pass
        elif field.path == "mission.speed_mps" and self._is_of_walkers():
            for group in self._groups.subject:
                put_speed(self._draft, group, quantity, phrase.span)
        elif field.path == "mission.speed_mps" and self._may_be_of_the_subject(phrase.span):
            self._ask_whose_speed(field, quantity, phrase)
        else:
            self._set(field, quantity, phrase)

    def _may_be_of_the_subject(self, span: Span) -> bool:
        """Whether the sentence of a speed has named a group that may move, and not the drone."""
        groups = self._groups
        if not groups.in_sentence or groups.subject_is_mission or len(groups.subject) != 1:
            return False
        text = self._draft.text
        begin = 1 + max(text.rfind(mark, 0, span.start) for mark in (";", ". ", "\n"))
        if _OF_THE_DRONE.search(text, begin, span.end):
            return False
        named = groups.mentioned_at(groups.subject)
        return named.start >= begin and groups.asset(groups.subject[0]) not in IMMOVABLE

    def _ask_whose_speed(self, field: FieldWords, quantity: Quantity, phrase: Phrase) -> None:
        """Read `a soldier at a speed of 2 m/s`, which may be the drone's speed only if a person says so."""
        [group] = self._groups.subject
        if self._draft.ask(phrase.span, "whose speed is this?", [group, "the drone's"]):
            self._set(field, quantity, phrase)
            return
        self._draft.put(("actors", group, "motion", "kind"), "wander", phrase.span)
        put_speed(self._draft, group, quantity, phrase.span)

    def _pace(self, quantity: Quantity, phrase: Phrase) -> None:
        """Read `at a walking speed of 1.4 m/s`: it is never the drone's."""
        if self._is_of_walkers():
            for group in self._groups.subject:
                put_speed(self._draft, group, quantity, phrase.span)
            return
        for part in phrase.leaves:
            part.disown()
        self._draft.unread(phrase.span, "the text does not say who moves", expressible=True)

    def _clause_up_to(self, span: Span) -> str:
        """The text from the beginning of the clause up to the end of a span; a point inside a number is no end."""
        text = self._draft.text
        begin = max(text.rfind(mark, 0, span.start) for mark in (",", ";", ". ", "\n", "("))
        return text[begin + 1 : span.end]

    def _compares(self, path: str, phrase: Phrase) -> bool:
        """Read `always more high than 30 m` as the bound that it is; whether the number is compared."""
        number = next(
            part for part in phrase.parts if isinstance(part, Part) and isinstance(part.value, Quantity)
        )
        match = _COMPARISON.search(self._clause_up_to(Span(number.span.start, number.span.start)))
        names = BOUNDS.get(path, {})
        if match is None or not names:
            return False
        lower = bool(match["much"]) != bool(match["negation"])
        name = names.get("ATLEAST" if lower else "WITHIN")
        assert isinstance(number.value, Quantity)
        if name is None or not number.value.single:
            for part in phrase.leaves:
                part.disown()
            self._draft.unread(phrase.span, "it is a bound that a SimSpec does not have", expressible=True)
            return True
        unit = "m" if name.endswith("_m") else "m/s"
        self._draft.vary(("rules", name), number.value.low, number.value.low, phrase.span, unit=unit)
        return True

    def _is_of_walkers(self) -> bool:
        """Whether a speed is that of the groups that the sentence is about, because they move."""
        return self._groups.in_sentence and not self._groups.subject_is_mission and self._moving()

    def _set(self, field: FieldWords, quantity: Quantity, phrase: Phrase) -> None:
        if field.path.startswith("mission."):
            self._groups.subject_is_mission, self.subject = True, "drone"
        if field.path.endswith(LIMITS):
            # `time limit at most 5 min`: the field is a largest value itself.
            phrase.every("WITHIN")
        self._draft.vary(
            tuple(field.path.split(".")),
            quantity.low,
            quantity.high,
            phrase.span,
            unit=UNIT_NAMES.get(field.kind),
            integer=field.path.startswith("seeds."),
        )

    def _of_the_wind(self, word: Span) -> bool:
        """Whether the clause of a speed has the wind as its subject: `the wind speed shall not exceed 4 m/s`."""
        clause = re.split(r"[,;.\n]|\band\b", self._draft.text[: word.start])[-1]
        return re.search(r"\b(?:winds?|gusts?|breezes?)\b", clause, re.IGNORECASE) is not None

    def _usual_unit(self, kind: str, span: Span) -> str | None:
        """The unit of all other numbers of a kind in the text; None when there is none, or more than one."""
        used = {
            unit
            for unit, pattern in WRITTEN.get(kind, {}).items()
            if re.search(rf"\d\s?-?(?:{pattern})\b", self._draft.text)
        }
        if len(used) != 1:
            return None
        [unit] = used
        self._draft.remark(span, f"no unit is given: read in {unit}, as all others in the text")
        return unit

    def _plain_number(self, field: FieldWords, quantity: Quantity, phrase: Phrase) -> None:
        """Angles are degrees. A share up to 1 is a fraction, above 1 it is a percentage."""
        share = 0.01 if field.kind == "PERCENT" and quantity.high > 1 else 1.0
        low, high = (round(part * share, 9) for part in (quantity.low, quantity.high))
        self._draft.vary(
            tuple(field.path.split(".")), low, high, phrase.span, unit=UNIT_NAMES.get(field.kind)
        )

    def _moving(self) -> bool:
        return all(
            ("actors", group, "motion", "kind") in self._draft.entries for group in self._groups.subject
        )

    def _bounds(self, field: FieldWords, phrase: Phrase) -> bool:
        """`height not more than 100 m, not less than 25 m` sets rules, not the mission's height."""
        names = BOUNDS.get(field.path, {})
        taken, bound = False, ""
        for part in phrase.parts:
            if isinstance(part, Part) and part.kind in ("WITHIN", "ATLEAST"):
                bound = part.kind
                part.used = bound in names
            elif (
                isinstance(part, Part)
                and bound in names
                and isinstance(part.value, Quantity)
                and part.value.kind in (field.kind, "COUNT")
            ):
                unit = UNIT_NAMES.get(field.kind)
                self._draft.vary(
                    ("rules", names[bound]), part.value.low, part.value.high, phrase.span, unit=unit
                )
                taken = True
            elif isinstance(part, Part) and bound in names and isinstance(part.value, Quantity):
                part.disown()
        return taken

    def altitude(self, phrase: Phrase) -> None:
        length = length_of(self._draft, phrase)
        if not self._of_the_drone(phrase, "the height of the mission"):
            return
        self._groups.subject_is_mission = True
        if self._compares("mission.altitude_m", phrase):
            return
        self._draft.vary(("mission", "altitude_m"), length.low, length.high, phrase.span, unit="m")

    def _of_the_drone(self, phrase: Phrase, meaning: str) -> bool:
        """Whether a bare number is the drone's: its sentence has spoken of the flight last. Else it is left out.

        A number that nobody claims is a choice, and never a height, a speed or a time limit by itself.
        """
        if phrase.has("FLY") or self.subject == "drone":
            self.subject = "drone"
            return True
        if self._draft.ask(
            phrase.span, "what is this number?", ["nothing that is known: leave it out", meaning]
        ):
            return True
        for part in phrase.leaves:
            part.disown()
        self._draft.unread(phrase.span, "it is not said of what", expressible=True)
        return False

    def speed(self, phrase: Phrase) -> None:
        part = phrase.first("SPEED")
        assert part is not None
        assert isinstance(part.value, Quantity)
        if (
            self.subject == "group"
            and self._groups.in_sentence
            and self._groups.subject
            and not phrase.has("FLY")
        ):
            for group in self._groups.subject:
                if ("actors", group, "motion", "route") not in self._draft.entries:
                    self._draft.put(("actors", group, "motion", "kind"), "wander", phrase.span)
                put_speed(self._draft, group, part.value, phrase.span)
        elif _PACE.search(self._clause_up_to(phrase.span)):
            self._pace(part.value, phrase)
        elif self._of_the_drone(phrase, "the speed of the mission") and not self._compares(
            "mission.speed_mps", phrase
        ):
            self._draft.vary(
                ("mission", "speed_mps"), part.value.low, part.value.high, phrase.span, unit="m/s"
            )

    def limit(self, phrase: Phrase) -> None:
        part = phrase.first("TIME")
        assert part is not None
        assert isinstance(part.value, Quantity)
        low, high = part.value.low, part.value.high
        readings = ["the time from intelligence to the report on it", "the time limit of the mission"]
        if phrase.has("DELIVERY") or (
            self.reporting and self._draft.ask(phrase.span, "which time is this?", readings) == 0
        ):
            self._draft.vary(("rules", "report_deadline_s"), low, high, phrase.span, unit="s")
        elif self.reporting or self._of_the_drone(phrase, "the time limit of the mission"):
            self._draft.vary(("mission", "time_limit_s"), low, high, phrase.span, unit="s")

    def set(self, phrase: Phrase) -> None:
        part = phrase.first("SET")
        assert part is not None
        assert isinstance(part.value, SetWords)
        if "mission.return_home" in part.value.set and _TOLD.search(self._draft.text[: phrase.span.start]):
            self._draft.unread(phrase.span, "it is an order, and its time is not said here", expressible=True)
            return
        for path, value in part.value.set.items():
            self._draft.put(tuple(path.split(".")), value, phrase.span)


def _fits(field: FieldWords, quantity: Quantity) -> bool:
    if field.kind == "NUMBER":
        return quantity.kind in ("COUNT", "PERCENT")
    return quantity.kind == field.kind
