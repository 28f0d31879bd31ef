"""Phrases of weather and light to fields: rain, fog, wind, and the moment at which it begins."""

from __future__ import annotations

import datetime as dt

from bench.simspec import Environment

from ._draft import Draft, Path, Varied
from ._light import sun_moment
from ._phrases import Part, Phrase, Quantity
from ._places import Places
from ._tokens import Clock, Span
from ._vocabulary import WeatherWords


class Sky:
    """Reads phrases of weather and light into a draft; `finish` settles the moment when all of the text is known."""

    RULES = frozenset(["weather", "clear", "wind", "calm", "gusts", "sun", "clock", "date"])
    """Rules of the grammar that are read here, each by the method of its name."""

    def __init__(self, draft: Draft, places: Places) -> None:
        self._draft, self._places = draft, places
        self._day_said: tuple[dt.date, Span] | None = None
        self._clock_said: tuple[Clock, Span] | None = None
        self._sun_said: tuple[str, Quantity | None, int, Span] | None = None
        self._winds_unsaid: list[Span] = []
        self._levels_unsaid: list[tuple[Part, Span]] = []

    def weather(self, phrase: Phrase) -> None:
        if phrase.first("AND"):
            for word in phrase.every("WEATHER"):
                self.weather(Phrase("weather", (Phrase("state", (word, *_intensities(phrase)), phrase.span),), phrase.span))
            return
        if (alone := self._only_kind(phrase)) is not None:
            self._levels_unsaid.append((alone, phrase.span))
            return
        found = self._states(phrase)
        first = found[0]
        if len(found) == 1:
            self._draft.vary(tuple(first[0].split(".")), first[1], first[2], phrase.span, unit="level")
            return
        if any(low != high for _, low, high in found):
            self._draft.fault(phrase.span, "a choice between ranges", "give a level to each")
            return
        paths = list(dict.fromkeys(path for path, _, _ in found))
        for path in paths:
            level = first[1] if path == first[0] else 0.0
            self._draft.put(tuple(path.split(".")), level, phrase.span, "first of several")
        if len(paths) == 1:
            levels = tuple(level for _, level, _ in found)
            self._draft.ranges.append(Varied(name="weather", paths=tuple(paths), levels=levels, unit="level"))
            return
        choices = {
            f"{path.split('.')[1].removesuffix('_level')}-{level:g}": dict.fromkeys(paths, 0.0) | {path: level}
            for path, level, _ in found
        }
        self._draft.ranges.append(Varied(name="weather", choices=choices, unit="level"))

    def _only_kind(self, phrase: Phrase) -> Part | None:
        """The one kind of weather that a phrase names without saying how much; None for any other phrase."""
        if len(phrase.parts) != 1 or not isinstance(state := phrase.parts[0], Phrase) or len(state.parts) != 1:
            return None
        word = state.first("WEATHER")
        return word if word is not None and isinstance(word.value, WeatherWords) and word.value.level is None else None

    def _unsaid_levels(self) -> None:
        """How much it rains, and how strong the wind is, is asked where no sentence has said it."""
        path: Path = ("environment", "wind", "speed_mps")
        for span in self._winds_unsaid:
            if path not in self._draft.entries:
                readings = ["3 m/s, light", "6 m/s, moderate", "12 m/s, strong"]
                chosen = self._draft.ask(span, "how strong is the wind?", readings)
                self._draft.put(path, [3.0, 6.0, 12.0][chosen], span)
        for word, span in self._levels_unsaid:
            assert isinstance(word.value, WeatherWords)
            if tuple(word.value.path.split(".")) not in self._draft.entries:
                where, level, _ = self._state(Phrase("state", (word,), span), [])
                self._draft.put(tuple(where.split(".")), level, span)

    def _states(self, phrase: Phrase) -> list[tuple[str, float, float]]:
        """Field and level of each of several; a level by itself is of the kind that is named beside it."""
        word = phrase.first("WEATHER") or next(
            one for part in phrase.parts if isinstance(part, Phrase) for one in part.every("WEATHER")
        )
        found: list[tuple[str, float, float]] = []
        for part in phrase.parts:
            if isinstance(part, Phrase):
                word = part.first("WEATHER") or word
                state = part if part.rule == "state" else Phrase("state", (*part.parts, word), part.span)
                found.append(self._state(state, [level for _, level, _ in found]))
        return found

    def _state(self, state: Phrase, before: list[float]) -> tuple[str, float, float]:
        word = state.first("WEATHER")
        assert word is not None
        assert isinstance(word.value, WeatherWords)
        path = word.value.path
        if state.first("NONE"):
            return path, 0.0, 0.0
        intensities = [float(one.value) for one in state.every("INTENSITY") if isinstance(one.value, float | int)]
        if intensities:
            return path, intensities[0], intensities[-1]
        if (count := state.first("COUNT")) and isinstance(count.value, Quantity):
            return path, count.value.low, count.value.high
        if word.value.level is not None:
            return path, word.value.level, word.value.level
        levels = sorted({2.0, 4.0, 7.0, *before})
        names = {2.0: "light", 4.0: "moderate", 7.0: "heavy"}
        readings = [f"level {one:g}" + (f", {names[one]}" if one in names else "") for one in levels]
        level = levels[self._draft.ask(state.span, f"how much {self._draft.quote(word.span)}?", readings)]
        return path, level, level

    def clear(self, phrase: Phrase) -> None:
        self._draft.put(("environment", "rain_level"), 0.0, phrase.span)
        self._draft.put(("environment", "fog_level"), 0.0, phrase.span)

    def wind(self, phrase: Phrase) -> None:
        base: Path = ("environment", "wind")
        if (speed := phrase.first("SPEED")) and isinstance(speed.value, Quantity):
            self._draft.vary((*base, "speed_mps"), speed.value.low, speed.value.high, phrase.span, unit="m/s")
        elif (word := phrase.first("WINDS")) and isinstance(word.value, float | int):
            self._draft.put((*base, "speed_mps"), float(word.value), phrase.span)
        elif (
            len(phrase.parts) == 2
            and (none := phrase.first("COUNT"))
            and isinstance(none.value, Quantity)
            and not none.value.high
        ):
            self._draft.put((*base, "speed_mps"), 0.0, phrase.span)
            return
        else:
            self._winds_unsaid.append(phrase.span)
        direction = phrase.first("DIR")
        figure = phrase.first("ANGLE") or phrase.first("COUNT")
        if direction is not None:
            self._draft.put((*base, "from_deg"), direction.value, phrase.span)
        elif figure is not None and isinstance(figure.value, Quantity):
            self._draft.vary((*base, "from_deg"), figure.value.low % 360, figure.value.high, phrase.span, unit="deg")

    def calm(self, phrase: Phrase) -> None:
        self._draft.put(("environment", "wind", "speed_mps"), 0.0, phrase.span)

    def gusts(self, phrase: Phrase) -> None:
        speed = phrase.first("SPEED") or phrase.first("COUNT")
        assert speed is not None
        assert isinstance(speed.value, Quantity)
        share = 1.0
        if speed.kind == "COUNT":
            units = {"m/s": 1.0, "km/h": 1 / 3.6, "knots": 0.514444}
            share = units[[*units][self._draft.ask(phrase.span, "in which unit?", [*units])]]
        path: Path = ("environment", "wind", "turbulence_mps")
        low, high = (round(one * share, 6) for one in (speed.value.low, speed.value.high))
        self._draft.vary(path, low, high, phrase.span, unit="m/s")

    def sun(self, phrase: Phrase) -> None:
        word, time = phrase.first("SUN"), phrase.first("TIME")
        assert word is not None
        quantity = time.value if time and isinstance(time.value, Quantity) else None
        self._sun_said = (str(word.value), quantity, -1 if phrase.first("BEFORE") else 1, phrase.span)

    def clock(self, phrase: Phrase) -> None:
        part = phrase.first("CLOCK")
        assert part is not None
        assert isinstance(part.value, Clock)
        self._clock_said = (part.value, phrase.span)

    def date(self, phrase: Phrase) -> None:
        part = phrase.first("DATE")
        assert part is not None
        assert isinstance(part.value, dt.date)
        self._day_said = (part.value, phrase.span)

    def finish(self) -> None:
        """What weather is not told more closely, and the moment at which the scenario begins."""
        self._unsaid_levels()
        self._moment()

    def _moment(self) -> None:
        """From day, hour and sun together."""
        usual = Environment().start_utc
        day, where = self._day_said or (usual.date(), None)
        spans = [one for one in (where, self._clock_said and self._clock_said[1], self._sun_said and self._sun_said[3]) if one]
        if not spans:
            return
        span = spans[-1]
        if self._sun_said and self._clock_said:
            readings = [self._draft.quote(self._clock_said[1]), self._draft.quote(self._sun_said[3])]
            if (
                self._draft.ask(
                    self._clock_said[1].joined(self._sun_said[3]), "two times of day are given; which holds?", readings
                )
                == 0
            ):
                self._sun_said = None
        path: Path = ("environment", "start_utc")
        note = "" if where else f"on {day}, the default"
        if self._sun_said:
            self._by_the_sun(day, note)
        elif self._clock_said:
            clock = self._clock_said[0]
            zone = "" if clock.zoned else "no zone is given: UTC, the default"
            note = "; ".join(one for one in (note, zone) if one)
            moment = dt.datetime.combine(day, clock.at, dt.UTC) - dt.timedelta(hours=clock.ahead_h)
            self._draft.put(path, _stamp(moment), span, note)
        else:
            self._draft.put(path, _stamp(dt.datetime.combine(day, usual.time(), dt.UTC)), span, "at 11:30 UTC, the default")

    def _by_the_sun(self, day: dt.date, note: str) -> None:
        assert self._sun_said is not None
        what, quantity, sign, span = self._sun_said
        origin = self._places.origin
        moment = sun_moment(what, day, origin.latitude_deg, origin.longitude_deg)  # type: ignore[arg-type]
        if moment is None:
            self._draft.fault(span, f"the sun does not {what} there on {day}", "give the time in UTC")
            return
        shifts = [0.0] if quantity is None else [quantity.low] if quantity.single else [quantity.low, quantity.high]
        stamps = [_stamp(moment + sign * dt.timedelta(seconds=one)) for one in shifts]
        self._draft.put(("environment", "start_utc"), stamps[0], span, note)
        if len(stamps) > 1:
            self._draft.ranges.append(Varied(name="start", paths=("environment.start_utc",), levels=tuple(stamps)))


def _stamp(moment: dt.datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def _intensities(phrase: Phrase) -> list[Part]:
    return [one for part in phrase.parts if isinstance(part, Phrase) for one in part.every("INTENSITY")]
