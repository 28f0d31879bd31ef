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
from ._settings import put_fields
from ._sun_times import sun_moment

LEVELS = {2.0: "light", 4.0: "moderate", 7.0: "heavy"}
"""The levels that are offered where a text names weather without one."""
FOG: FieldPath = ("environment", "fog_level")
VISIBILITY: FieldPath = ("environment", "visibility_m")
GUST_PER_TURBULENCE = 3.0 * 0.1 / (0.177 + 0.000823 * 20.0) ** 0.4
"""Three standard deviations of the gusts along the wind, 20 ft high, for a turbulence of 1 m/s (MIL-F-8785C)."""
START: FieldPath = ("environment", "start_utc")


class WeatherReader:
    """Reads weather and light into a draft; each form by the method that `does` names."""

    def __init__(self, draft: Draft, places: PlaceReader) -> None:
        self._draft, self._places = draft, places
        self._open: list[tuple[FieldPath, str, Span]] = []
        self._gusts: list[tuple[Quantity, Span]] = []
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

    def wind(self, part: Part) -> None:
        """Read wind; its gusts become turbulence at the end, when the mean wind is known."""
        put_fields(self._draft, (), part)
        if (gust := part.first("gust")) is not None:
            self._gusts.append((gust, part.span))
            self._draft.acknowledge(part.span)

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
        for gust, span in self._gusts:
            self._put_gusts(gust, span)
        self._see_once()
        if self._starts:
            self._moment()

    def _put_gusts(self, gust: Quantity, span: Span) -> None:
        """The turbulence whose gusts reach a speed: three standard deviations above the mean wind at 6 m."""
        mean = self._draft.entries.get(("environment", "wind", "speed_mps"))
        mean_mps = 0.0 if mean is None else float(mean.value)
        if gust.low <= mean_mps:
            self._draft.fault(
                span, f"gusts of {gust.low:g} m/s are no more than the wind", "state stronger gusts"
            )
            return
        low, high = (round((end - mean_mps) / GUST_PER_TURBULENCE, 6) for end in (gust.low, gust.high))
        note = "gusts reach the wind and three standard deviations"
        path: FieldPath = ("environment", "wind", "turbulence_mps")
        self._draft.vary(path, low, high, span, unit="m/s", note=note)

    def _see_once(self) -> None:
        """Of a visibility and a level of fog one holds."""
        seen, fog = (self._draft.entries.get(path) for path in (VISIBILITY, FOG))
        if seen is None or fog is None or not fog.value:
            return
        assert seen.span is not None
        assert fog.span is not None
        readings = [f"visibility {seen.value:g} m", f"fog level {fog.value:g}"]
        question = "visibility and fog say one thing twice; which holds?"
        kept = self._draft.ask(seen.span.joined(fog.span), question, readings)
        self._draft.forget((FOG, VISIBILITY)[kept])

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
