"""Reads weather and light: rain, fog, wind, and the start time."""

from __future__ import annotations

import datetime as dt
import re

from bench.simspec import Environment

from .._draft import Draft, FieldPath
from .._result import VariedField
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import ZONES_OF_UTC, Span, TimeOfDay
from ..language._vocabulary import WeatherWords
from ._places import PlaceReader
from ._sun_times import sun_moment

# `0:30` with neither zone nor half of the day may be half a minute into the flight.
_MINUTES = re.compile(r"(at\s+)?[0-5]:\d\d", re.IGNORECASE)


_START = re.compile(r"\b(?:starts?|begins?|h-hour|t-?0|20\d\d)\b", re.IGNORECASE)
"""What stands beside the time of the start."""
_DISTANCE_BEFORE = re.compile(r"\d\s*(?:m|k?met(?:re|er)s?|km)\b[^.;\n]{0,15}$", re.IGNORECASE)
_DISTANCE_AFTER = re.compile(r"[^.;\n]{0,15}?\d\s*(?:m|k?met(?:re|er)s?|km)\b", re.IGNORECASE)
REACH_OF_A_DISTANCE = 30
"""Characters around a clock direction among which its distance is looked for. Chosen."""


class WeatherReader:
    """Reads weather and light into a draft. `finish` sets the start time once the whole text is read."""

    RULES = frozenset(["weather", "clear", "wind", "calm", "gusts", "sun", "clock", "date"])
    """Rules of the grammar that are read here, each by the method of its name."""

    def __init__(self, draft: Draft, places: PlaceReader) -> None:
        self._draft, self._places = draft, places
        self._stated_day: tuple[dt.date, Span] | None = None
        self._stated_time: tuple[TimeOfDay, Span] | None = None
        self._stated_sun: tuple[str, Quantity | None, int, Span] | None = None
        self._winds_without_speed: list[Span] = []
        self._weather_without_level: list[tuple[Part, Span]] = []

    def weather(self, phrase: Phrase) -> None:
        if phrase.first("AND"):
            for word in phrase.every("WEATHER"):
                self.weather(
                    Phrase(
                        "weather", (Phrase("state", (word, *_intensities(phrase)), phrase.span),), phrase.span
                    )
                )
            return
        if (alone := self._only_kind(phrase)) is not None:
            self._weather_without_level.append((alone, phrase.span))
            return
        states = self._states(phrase)
        first = states[0]
        if len(states) == 1:
            self._draft.vary(tuple(first[0].split(".")), first[1], first[2], phrase.span, unit="level")
            return
        if any(low != high for _, low, high in states):
            self._draft.fault(phrase.span, "a choice between ranges", "give a level to each")
            return
        paths = list(dict.fromkeys(path for path, _, _ in states))
        for path in paths:
            level = first[1] if path == first[0] else 0.0
            # The base SimSpec holds the first choice; the design varies the rest.
            self._draft.put(tuple(path.split(".")), level, phrase.span, "first of several")
        if len(paths) == 1:
            levels = tuple(level for _, level, _ in states)
            self._draft.ranges.append(
                VariedField(name="weather", paths=tuple(paths), levels=levels, unit="level")
            )
            return
        choices = {
            f"{path.split('.')[1].removesuffix('_level')}-{level:g}": dict.fromkeys(paths, 0.0)
            | {path: level}
            for path, level, _ in states
        }
        self._draft.ranges.append(VariedField(name="weather", choices=choices, unit="level"))

    def _only_kind(self, phrase: Phrase) -> Part | None:
        """The weather word of a phrase that states no level; None for any other phrase."""
        if (
            len(phrase.parts) != 1
            or not isinstance(state := phrase.parts[0], Phrase)
            or len(state.parts) != 1
        ):
            return None
        word = state.first("WEATHER")
        return (
            word
            if word is not None and isinstance(word.value, WeatherWords) and word.value.level is None
            else None
        )

    def _ask_missing_levels(self) -> None:
        """Ask for the level of rain and the strength of wind when no sentence states them."""
        path: FieldPath = ("environment", "wind", "speed_mps")
        for span in self._winds_without_speed:
            if path not in self._draft.entries:
                # The vocabulary's speeds of these words, after the Beaufort scale.
                readings = ["3 m/s, light", "6 m/s, moderate", "12 m/s, strong"]
                chosen = self._draft.ask(span, "how strong is the wind?", readings)
                self._draft.put(path, [3.0, 6.0, 12.0][chosen], span)
        for word, span in self._weather_without_level:
            assert isinstance(word.value, WeatherWords)
            if tuple(word.value.path.split(".")) not in self._draft.entries:
                where, level, _ = self._state(Phrase("state", (word,), span), [])
                self._draft.put(tuple(where.split(".")), level, span)

    def _states(self, phrase: Phrase) -> list[tuple[str, float, float]]:
        """Field and level of each state. A level without a weather word takes the word beside it."""
        word = phrase.first("WEATHER") or next(
            weather_part
            for part in phrase.parts
            if isinstance(part, Phrase)
            for weather_part in part.every("WEATHER")
        )
        states: list[tuple[str, float, float]] = []
        for part in phrase.parts:
            if isinstance(part, Phrase):
                word = part.first("WEATHER") or word
                state = part if part.rule == "state" else Phrase("state", (*part.parts, word), part.span)
                states.append(self._state(state, [level for _, level, _ in states]))
        return states

    def _state(self, state: Phrase, before: list[float]) -> tuple[str, float, float]:
        word = state.first("WEATHER")
        assert word is not None
        assert isinstance(word.value, WeatherWords)
        path = word.value.path
        if state.first("NONE"):
            return path, 0.0, 0.0
        intensities = [
            float(candidate.value)
            for candidate in state.every("INTENSITY")
            if isinstance(candidate.value, float | int)
        ]
        if intensities:
            return path, intensities[0], intensities[-1]
        if (count := state.first("COUNT")) and isinstance(count.value, Quantity):
            return path, count.value.low, count.value.high
        if word.value.level is not None:
            return path, word.value.level, word.value.level
        # Light, moderate and heavy in the vocabulary, and the levels of other weather in the same phrase.
        levels = sorted({2.0, 4.0, 7.0, *before})
        names = {2.0: "light", 4.0: "moderate", 7.0: "heavy"}
        readings = [
            f"level {candidate:g}" + (f", {names[candidate]}" if candidate in names else "")
            for candidate in levels
        ]
        level = levels[self._draft.ask(state.span, f"how much {self._draft.quote(word.span)}?", readings)]
        return path, level, level

    def clear(self, phrase: Phrase) -> None:
        if self._draft.text[phrase.span.end :].lstrip().lower().startswith("of "):
            # `keep well clear of the children`.
            self._draft.unread(phrase.span, "it is not said of the weather", expressible=True)
            return
        self._draft.put(("environment", "rain_level"), 0.0, phrase.span)
        self._draft.put(("environment", "fog_level"), 0.0, phrase.span)

    def wind(self, phrase: Phrase) -> None:
        base: FieldPath = ("environment", "wind")
        if (speed := phrase.first("SPEED")) and isinstance(speed.value, Quantity):
            self._draft.vary((*base, "speed_mps"), speed.value.low, speed.value.high, phrase.span, unit="m/s")
        elif (word := phrase.first("WINDS")) and isinstance(word.value, float | int):
            self._draft.put((*base, "speed_mps"), float(word.value), phrase.span)
        elif len(phrase.parts) == 2 and (bare := phrase.first("COUNT")) and isinstance(bare.value, Quantity):
            if bare.value.high:
                # `wind 5 Bft`: neither a speed in a known unit nor a direction.
                bare.disown()
                self._draft.unread(phrase.span, "the number has no unit", expressible=True)
            else:
                self._draft.put((*base, "speed_mps"), 0.0, phrase.span)
            return
        else:
            self._winds_without_speed.append(phrase.span)
        direction = phrase.first("DIR")
        figure = phrase.first("ANGLE") or phrase.first("COUNT")
        if direction is not None:
            self._draft.put((*base, "from_deg"), direction.value, phrase.span)
        elif figure is not None and isinstance(figure.value, Quantity):
            self._draft.vary(
                (*base, "from_deg"), figure.value.low % 360, figure.value.high, phrase.span, unit="deg"
            )

    def direction(self, part: Part, span: Span) -> None:
        """Set where the wind comes from, which a sentence about the wind says by itself."""
        self._draft.put(("environment", "wind", "from_deg"), part.value, span)

    def calm(self, phrase: Phrase) -> None:
        self._draft.put(("environment", "wind", "speed_mps"), 0.0, phrase.span)

    def gusts(self, phrase: Phrase) -> None:
        word = phrase.first("GUSTS")
        assert word is not None
        path: FieldPath = ("environment", "wind", "turbulence_mps")
        if (strength := phrase.first("WINDS")) and isinstance(strength.value, float | int):
            # The Beaufort speed of the word: no standard says what `moderate gusts` are near the ground.
            low = float(strength.value)
            readings = [f"a turbulence of {low:g} m/s", "leave it out"]
            if self._draft.ask(phrase.span, "how strong are the gusts?", readings) == 0:
                self._draft.put(path, low, phrase.span)
            return
        if "turbulen" not in self._draft.quote(word.span).lower():
            why = "a SimSpec has no speed of gusts: write `turbulence` for the wind that scales them"
            self._draft.unread(phrase.span, why)
            return
        speed = phrase.first("SPEED") or phrase.first("COUNT")
        assert speed is not None
        assert isinstance(speed.value, Quantity)
        share = 1.0
        if speed.kind == "COUNT":
            units = {"m/s": 1.0, "km/h": 1 / 3.6, "knots": 0.514444}
            # `gusts 15` may be metres per second or knots, which differ by a factor of two.
            share = units[[*units][self._draft.ask(phrase.span, "in which unit?", [*units])]]
        low, high = (round(speed_value * share, 6) for speed_value in (speed.value.low, speed.value.high))
        self._draft.vary(path, low, high, phrase.span, unit="m/s")

    def sun(self, phrase: Phrase) -> None:
        word, time = phrase.first("SUN"), phrase.first("TIME")
        assert word is not None
        quantity = time.value if time and isinstance(time.value, Quantity) else None
        if self._draft.quote(word.span).lower() in ("dusk", "dawn"):
            self._draft.remark(phrase.span, "dusk and dawn are read as sunset and sunrise")
        self._stated_sun = (str(word.value), quantity, -1 if phrase.first("BEFORE") else 1, phrase.span)

    def clock(self, phrase: Phrase) -> None:
        part = phrase.first("CLOCK")
        assert part is not None
        assert isinstance(part.value, TimeOfDay)
        if self._is_a_direction(phrase.span):
            self._draft.unread(
                phrase.span, "a direction by the clock: write it by the compass", expressible=True
            )
            return
        if _MINUTES.fullmatch(self._draft.quote(phrase.span)):
            readings = ["a time of day", "minutes and seconds after the start: leave it out"]
            if self._draft.ask(phrase.span, "is this a time of day?", readings):
                return
        if self._stated_time is not None and self._stated_time[0] != part.value:
            # A log has many times, of which none may be the start.
            times = [self._stated_time, (part.value, phrase.span)]
            if self._begins(times[1]) > self._begins(times[0]):
                times.reverse()
            for _, where in times:
                self._draft.acknowledge(where)
            readings = [self._draft.quote(where) for _, where in times]
            ask = "several times of day are given; when does it start?"
            self._stated_time = times[self._draft.ask(phrase.span, ask, readings)]
            return
        self._stated_time = (part.value, phrase.span)

    def _begins(self, time: tuple[TimeOfDay, Span]) -> int:
        """How much speaks for a time as that of the start: a zone, a date or a start beside it."""
        clause = re.split(r"[.;\n]", self._draft.text[: time[1].start])[-1][-40:]
        rest = re.split(r"[.;\n]", self._draft.text[time[1].end :])[0][:40]
        return time[0].zoned + len(_START.findall(clause + rest))

    def _is_a_direction(self, span: Span) -> bool:
        """Whether `two o'clock` stands beside a distance: `a truck at two o'clock, 150 m`."""
        text, quote = self._draft.text, self._draft.quote(span).lower()
        around = (
            text[max(0, span.start - REACH_OF_A_DISTANCE) : span.start],
            text[span.end : span.end + REACH_OF_A_DISTANCE],
        )
        beside = _DISTANCE_BEFORE.search(around[0]) or _DISTANCE_AFTER.match(around[1])
        return "clock" in quote and not any(zone in quote for zone in ZONES_OF_UTC) and beside is not None

    def date(self, phrase: Phrase) -> None:
        part = phrase.first("DATE")
        assert part is not None
        assert isinstance(part.value, dt.date)
        self._stated_day = (part.value, phrase.span)

    def finish(self) -> None:
        """Ask for missing levels and set the start time."""
        self._ask_missing_levels()
        self._moment()

    def _moment(self) -> None:
        """Combine day, time of day and sun to the start time."""
        usual = Environment().start_utc
        day, where = self._stated_day or (usual.date(), None)
        spans = [
            item
            for item in (
                where,
                self._stated_time and self._stated_time[1],
                self._stated_sun and self._stated_sun[3],
            )
            if item
        ]
        if not spans:
            return
        for item in spans:
            self._draft.acknowledge(item)
        span = spans[-1]
        if self._stated_sun and self._stated_time:
            readings = [self._draft.quote(self._stated_time[1]), self._draft.quote(self._stated_sun[3])]
            if (
                self._draft.ask(
                    self._stated_time[1].joined(self._stated_sun[3]),
                    "two times of day are given; which holds?",
                    readings,
                )
                == 0
            ):
                self._stated_sun = None
        path: FieldPath = ("environment", "start_utc")
        note = "" if where else f"on {day}, the default"
        if self._stated_sun:
            self._by_the_sun(day, note)
        elif self._stated_time:
            clock = self._stated_time[0]
            zone = "" if clock.zoned else "no zone is given: UTC, the default"
            note = "; ".join(item for item in (note, zone) if item)
            moment = dt.datetime.combine(day, clock.at, dt.UTC) - dt.timedelta(hours=clock.ahead_h)
            self._draft.put(path, _stamp(moment), span, note)
        else:
            self._draft.put(
                path,
                _stamp(dt.datetime.combine(day, usual.time(), dt.UTC)),
                span,
                "at 11:30 UTC, the default",
            )

    def _by_the_sun(self, day: dt.date, note: str) -> None:
        assert self._stated_sun is not None
        what, quantity, sign, span = self._stated_sun
        origin = self._places.origin
        moment = sun_moment(what, day, origin.latitude_deg, origin.longitude_deg)  # type: ignore[arg-type]
        if moment is None:
            self._draft.fault(span, f"the sun does not {what} there on {day}", "give the time in UTC")
            return
        shifts = (
            [0.0]
            if quantity is None
            else [quantity.low]
            if quantity.single
            else [quantity.low, quantity.high]
        )
        stamps = [_stamp(moment + sign * dt.timedelta(seconds=shift_s)) for shift_s in shifts]
        self._draft.put(("environment", "start_utc"), stamps[0], span, note)
        if len(stamps) > 1:
            self._draft.ranges.append(
                VariedField(name="start", paths=("environment.start_utc",), levels=tuple(stamps))
            )


def _stamp(moment: dt.datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def _intensities(phrase: Phrase) -> list[Part]:
    return [
        intensity
        for part in phrase.parts
        if isinstance(part, Phrase)
        for intensity in part.every("INTENSITY")
    ]
