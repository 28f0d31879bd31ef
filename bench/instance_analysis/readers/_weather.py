"""Reads weather and light: rain, fog, dust, wind, and the start time."""

from __future__ import annotations

import datetime as dt

from bench.simspec import Environment

from .._draft import Draft, FieldPath
from .._result import VariedField
from ..language._grammar import Part
from ..language._quantities import Quantity
from ..language._tokens import Span
from ._not_read import NotReadError
from ._places import PlaceReader
from ._sun_times import sun_moment

LEVELS = {2.0: "light", 4.0: "moderate", 7.0: "heavy"}
"""The levels that are offered where a text names weather without one."""
START: FieldPath = ("environment", "start_utc")


class WeatherReader:
    """Reads weather and light into a draft; each form by the method that `does` names."""

    def __init__(self, draft: Draft, places: PlaceReader) -> None:
        self._draft, self._places = draft, places
        self._open: list[tuple[FieldPath, str, Span]] = []
        self._starts: list[Part] = []

    def weather(self, part: Part) -> None:
        """Read a level of rain, fog or dust; two levels with `or` are a factor of the design."""
        word, level, other = part.first("weather"), part.first("level"), part.first("other")
        path: FieldPath = tuple(word.path.split("."))
        name = path[1].removesuffix("_level") if isinstance(path[1], str) else ""
        if level is None and word.level is None:
            self._open.append((path, name, part.span))
            self._draft.acknowledge(part.span)
            return
        low, high = level or (word.level, word.level)
        if other is None:
            self._draft.vary(path, low, high, part.span, unit="level")
            return
        self._draft.put(path, low, part.span, "first of several")
        levels = (low, other[0])
        self._draft.ranges.append(VariedField(name=name, paths=(word.path,), levels=levels, unit="level"))

    def start(self, part: Part) -> None:
        """Note what a sentence says of the start; it is put together at the end."""
        self._starts.append(part)
        self._draft.acknowledge(part.span)

    def finish(self) -> None:
        """Ask for missing levels, and set the start time."""
        for path, name, span in self._open:
            if path not in self._draft.entries:
                readings = [f"level {level:g}, {word}" for level, word in LEVELS.items()]
                level = list(LEVELS)[self._draft.ask(span, f"how much {name}?", readings)]
                self._draft.put(path, level, span)
        if self._starts:
            self._moment()

    def _moment(self) -> None:
        """Combine day, time of day and sun to the start time."""
        usual = Environment().start_utc
        days = [(part.first("date"), part.span) for part in self._starts if part.first("date")]
        day, note = (days[0][0], "") if days else (usual.date(), f"on {usual.date()}, the default")
        timed = [part for part in self._starts if part.first("clock") or part.first("sun")]
        for part in timed:
            if part.first("sun"):
                self._by_the_sun(part, day, note)
            else:
                self._by_the_clock(part, day, note)
        if not timed:
            stamp = _stamp(dt.datetime.combine(day, usual.time(), dt.UTC))
            self._draft.put(START, stamp, days[0][1], "at 11:30 UTC, the default")

    def _by_the_clock(self, part: Part, day: dt.date, note: str) -> None:
        clock = part.first("clock")
        zone = "" if clock.zoned else "no zone is given: UTC, the default"
        moment = dt.datetime.combine(day, clock.at, dt.UTC) - dt.timedelta(hours=clock.ahead_h)
        self._draft.put(START, _stamp(moment), part.span, "; ".join(filter(None, (note, zone))))
        if zone:
            self._draft.remark(part.span, zone)

    def _by_the_sun(self, part: Part, day: dt.date, note: str) -> None:
        origin = self._places.origin
        moment = sun_moment(part.first("sun"), day, origin.latitude_deg, origin.longitude_deg)
        if moment is None:
            raise NotReadError(
                f"the sun does not {part.first('sun')} there on {day}: give the time in UTC", span=part.span
            )
        shift: Quantity = part.first("time") or Quantity("TIME", 0.0, 0.0)
        sign = -1 if "before" in part.words else 1
        stamps = [
            _stamp(moment + sign * dt.timedelta(seconds=end))
            for end in dict.fromkeys((shift.low, shift.high))
        ]
        self._draft.put(START, stamps[0], part.span, note)
        if len(stamps) > 1:
            self._draft.ranges.append(
                VariedField(name="start", paths=("environment.start_utc",), levels=tuple(stamps))
            )


def _stamp(moment: dt.datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")
